//! Compares a scene with the photos of a data set, and with ground-truth maps where there are some.
//!
//! [`evaluate`] renders every photo's view over black, in the air of the photos, and scores it;
//! [`TruthMaps`] finds and reads maps of depth, normals and sky.

mod truth;

pub use truth::{TrueMaps, TruthError, TruthFolder, TruthMaps, TruthOptions, TruthWarning};

use crate::dataset::Dataset;
use crate::haze::PhotoHaze;
use crate::metrics::{
    DepthErrors, FloaterShare, Floaters, NormalErrors, Ssim, SurfaceLost, depth_errors, fit_exposure,
    normal_errors, sharpness, sky_covered, surface_lost,
};
use crate::photos::{BadPhotos, PhotoError};
use crate::session::ObserverError;
use serde::Serialize;
use std::ops::ControlFlow;
use thiserror::Error;
use wm_image::quality::psnr;
use wm_render::hooks::{Attribute, AttributeBlock, Hooks, Medium, SplatAttributes};
use wm_render::{
    AnyRenderer, DrawPass, EvenAir, Frame, Geometry, MedianDepth, Outputs, RenderBackend, RenderConfig,
    RenderError, SetId, SetView,
};
use wm_scene::{Camera, Group, Scene};

/// A correction of the render before its colours are compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ExposureFit {
    /// None.
    #[default]
    None,
    /// One affine change of colour per photo, that which brings the render nearest to it.
    Affine,
}

/// The air between cameras and scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum EvaluationAir {
    /// The haze in which the scene's photos were taken, if its metadata states one: the photos to
    /// compare with show it too.
    #[default]
    Photos,
    /// Clear air.
    Clear,
}

/// Options of an evaluation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EvaluationOptions {
    /// The correction of colours.
    pub exposure_fit: ExposureFit,
    /// The treatment of damaged photos.
    pub bad: BadPhotos,
    /// Depth and normals that are rendered even where there is no ground truth of them.
    pub geometry: Geometry,
    /// The air between cameras and scene.
    pub air: EvaluationAir,
}

/// The scores of one view.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ViewScores {
    /// Peak signal-to-noise ratio against the photo, dB.
    pub psnr: f64,
    /// Structural similarity to the photo, 1 for equal images.
    pub ssim: f64,
    /// Mean gradient of the render over that of the photo.
    pub sharpness: Option<f64>,
    /// Errors of expected depth.
    pub expected_depth: Option<DepthErrors>,
    /// Errors of median depth.
    pub median_depth: Option<DepthErrors>,
    /// Errors of normals.
    pub normal: Option<NormalErrors>,
    /// The share of the true sky that splats other than the sky's cover, 0-1.
    pub sky_covered: Option<f64>,
    /// Shares of true surfaces that are lost.
    pub surface_lost: Option<SurfaceLost>,
}

/// A photo and its scores.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotoScores {
    /// The name of the photo.
    pub name: String,
    /// The width of the photo as it was compared, px.
    pub width: u32,
    /// The height of the photo as it was compared, px.
    pub height: u32,
    /// The scores.
    pub scores: ViewScores,
}

/// The scores of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Evaluation {
    /// The scores of each photo.
    pub photos: Vec<PhotoScores>,
    /// Splats that hang in front of true surfaces, where there is true depth.
    pub floaters: Option<FloaterShare>,
}

/// A photo with what was rendered of it; images are `[H, W, 3]`, 0-1.
#[derive(Clone, Copy, Debug)]
pub struct EvaluatedPhoto<'a> {
    /// The index of the photo in [`Dataset::places`].
    pub index: usize,
    /// The name of the photo.
    pub name: &'a str,
    /// The photo.
    pub photo: &'a [f32],
    /// The render as it was compared.
    pub image: &'a [f32],
    /// The render with all splats.
    pub frame: &'a Frame,
    /// The render without the sky's splats.
    pub solid: &'a Frame,
    /// The ground truth.
    pub truth: &'a TrueMaps,
    /// The scores.
    pub scores: ViewScores,
}

/// Receives the progress of [`evaluate`] and can stop it; `()` is the silent observer.
pub trait EvaluationObserver {
    /// Called before every photo. [`ControlFlow::Break`] ends the evaluation with
    /// [`EvaluationError::Stopped`].
    fn proceed(&mut self) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    /// Called for a photo that is damaged and left out.
    fn on_left_out(&mut self, _error: &PhotoError) {}

    /// Called after every photo.
    ///
    /// # Errors
    /// An error ends the evaluation.
    fn on_photo(&mut self, _photo: &EvaluatedPhoto<'_>) -> Result<(), ObserverError> {
        Ok(())
    }
}

impl EvaluationObserver for () {}

/// A reason why a scene cannot be evaluated.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum EvaluationError {
    /// A photo is damaged.
    #[error(transparent)]
    Photo(#[from] PhotoError),
    /// Ground truth cannot be used.
    #[error(transparent)]
    Truth(#[from] TruthError),
    /// The renderer failed.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// All photos were left out.
    #[error("no photo is left to compare with; copy them again")]
    NoPhotos,
    /// No camera sees any splat.
    #[error("no splat is seen by any camera; give the data set that the scene was made from")]
    NothingSeen,
    /// The observer stopped the evaluation.
    #[error("stopped")]
    Stopped,
    /// The observer failed.
    #[error("{0}")]
    Observer(ObserverError),
}

/// Renders the view of every photo of `data` and compares it with the photo and with `truth`.
///
/// `set` names the splats of `scene` in `renderer`.
///
/// # Errors
/// [`EvaluationError`] if a photo or map cannot be read, the renderer fails, no photo is left, or
/// none shows a splat.
pub fn evaluate(
    renderer: &mut AnyRenderer,
    set: SetId,
    scene: &Scene,
    data: &Dataset,
    truth: &TruthMaps,
    options: &EvaluationOptions,
    observer: &mut dyn EvaluationObserver,
) -> Result<Evaluation, EvaluationError> {
    let rasterization = scene.metadata.rasterization.unwrap_or_default();
    let mut ssim = Ssim::new(renderer.path());
    let mut floaters = truth.depth.as_ref().map(|_| Floaters::new(&scene.splats, rasterization));
    let mut views = Views::new(renderer, set, scene, options, truth);
    let mut evaluation = Evaluation::default();
    let mut is_seen = false;
    for (index, place) in data.places.iter().enumerate() {
        if observer.proceed().is_break() {
            return Err(EvaluationError::Stopped);
        }
        if let Some(next) = data.places.get(index + 1) {
            data.photos.prefetch(*next, 0);
        }
        let photo = match data.photos.get(*place, 0) {
            Ok(photo) => photo,
            Err(error) if options.bad == BadPhotos::Skip => {
                observer.on_left_out(&error);
                continue;
            }
            Err(error) => return Err(error.into()),
        };
        let name = data.name(*place);
        let (rgb, mask) = (photo.rgb_f32(), photo.mask_f32());
        let maps = truth.read(name, &photo.camera, mask.as_deref())?;
        // The scene and the capture may have origins of their own.
        let camera = photo.camera.moved(data.capture.origin - scene.metadata.origin_or_zero());
        views.render(&camera)?;
        let (frame, solid) = (&views.frame, &views.solid);
        is_seen |= frame.alpha.iter().any(|alpha| *alpha > 0.0);
        let (scores, image) = views.renderer.pool().install(|| {
            if let (Some(floaters), Some(depth)) = (&mut floaters, &maps.depth) {
                floaters.add(&camera, depth);
            }
            // Images are what a screen shows: 0 to 1.
            let mut image: Vec<f32> = frame.rgb.iter().map(|v| v.clamp(0.0, 1.0)).collect();
            if options.exposure_fit == ExposureFit::Affine {
                image = fit_exposure(&image, &rgb, mask.as_deref());
                image.iter_mut().for_each(|v| *v = v.clamp(0.0, 1.0));
            }
            let width = photo.width as usize;
            let ssim = ssim.masked_value(&image, &rgb, mask.as_deref(), width);
            let psnr = psnr(&image, &rgb, mask.as_deref());
            let sharpness = sharpness(&image, &rgb, mask.as_deref(), width);
            (ViewScores { psnr, ssim, sharpness, ..against(frame, solid, &maps) }, image)
        });
        let shown =
            EvaluatedPhoto { index, name, photo: &rgb, image: &image, frame, solid, truth: &maps, scores };
        observer.on_photo(&shown).map_err(EvaluationError::Observer)?;
        let Camera { width, height, .. } = photo.camera;
        evaluation.photos.push(PhotoScores { name: name.to_owned(), width, height, scores });
    }
    if evaluation.photos.is_empty() {
        return Err(EvaluationError::NoPhotos);
    }
    if !is_seen {
        return Err(EvaluationError::NothingSeen);
    }
    evaluation.floaters = floaters.and_then(|floaters| floaters.share());
    Ok(evaluation)
}

/// Renders views with all splats and without the sky's.
struct Views<'a> {
    renderer: &'a mut AnyRenderer,
    set: SetId,
    groups: &'a [Group],
    config: RenderConfig,
    air: Option<EvenAir>,
    frame: Frame,
    solid: Frame,
}

impl<'a> Views<'a> {
    fn new(
        renderer: &'a mut AnyRenderer,
        set: SetId,
        scene: &'a Scene,
        options: &EvaluationOptions,
        truth: &TruthMaps,
    ) -> Self {
        let geometry = if truth.is_empty() { options.geometry } else { Geometry::DepthNormal };
        let outputs = Outputs { geometry, median_depth: MedianDepth::On, ..Outputs::default() };
        let rasterization = scene.metadata.rasterization.unwrap_or_default();
        // Over black, as in training.
        let config = RenderConfig { outputs, rasterization, ..RenderConfig::default() };
        let (frame, solid) = (Frame::default(), Frame::default());
        let haze = PhotoHaze::of(&scene.metadata).filter(|_| options.air == EvaluationAir::Photos);
        let air = haze.map(|haze| haze.air());
        Self { renderer, set, groups: &scene.splats.groups, config, air, frame, solid }
    }

    fn render(&mut self, camera: &Camera) -> Result<(), RenderError> {
        let not_sky = NotSky(self.groups);
        let (renderer, set) = (&mut *self.renderer, self.set);
        let medium = self.air.as_ref().map(|air| air as &dyn Medium);
        let mut render =
            |attributes: Option<&dyn SplatAttributes>, config: &RenderConfig, frame: &mut Frame| {
                let sets = [SetView::plain(set).with_attributes(attributes)];
                let hooks = Hooks { medium, ..Hooks::default() };
                renderer.render(&DrawPass { hooks, ..DrawPass::new(&sets, camera, config) }, frame).map(drop)
            };
        render(None, &self.config, &mut self.frame)?;
        if !self.groups.contains(&Group::Sky) {
            self.solid.clone_from(&self.frame);
            return Ok(());
        }
        let outputs = Outputs { geometry: Geometry::None, ..self.config.outputs };
        render(Some(&not_sky), &RenderConfig { outputs, ..self.config }, &mut self.solid)
    }
}

/// Shows all splats but the sky's.
struct NotSky<'a>(&'a [Group]);

impl SplatAttributes for NotSky<'_> {
    fn fill(&self, indices: &[u32], block: &mut AttributeBlock) {
        for (index, out) in indices.iter().zip(block.column_mut(Attribute::Visibility)) {
            *out = f32::from(u8::from(self.0[*index as usize] != Group::Sky));
        }
    }
}

/// Returns the scores against maps; `solid` is without the sky's splats.
fn against(frame: &Frame, solid: &Frame, maps: &TrueMaps) -> ViewScores {
    let depth = maps.depth.as_deref();
    ViewScores {
        expected_depth: depth.and_then(|depth| depth_errors(&frame.depth, depth)),
        median_depth: depth.and_then(|depth| depth_errors(&frame.median_depth, depth)),
        surface_lost: depth.and_then(|depth| surface_lost(&solid.alpha, &solid.median_depth, depth)),
        normal: maps.normal.as_deref().and_then(|normal| normal_errors(&frame.normal, normal)),
        sky_covered: maps.sky.as_deref().and_then(|sky| sky_covered(&solid.alpha, sky)),
        ..ViewScores::default()
    }
}
