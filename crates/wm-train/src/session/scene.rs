//! Prepares the first splats and the sky of a training, and finishes its scene: labels, up, ground
//! and scale.

use super::data::TrainData;
use super::error::SessionError;
use super::observer::{TrainNotice, TrainObserver, TrainWarning};
use super::options::SessionOptions;
use super::painted_sky::label_painted_sky;
use super::part::TrainPart;
use super::priors::{PriorView, prior_views};
use crate::brightness::PhotoGains;
use crate::config::{HazeMode, TrainConfig};
use crate::dataset::{Dataset, site};
use crate::fill::{FillView, fill};
use crate::haze::{FarGround, PhotoHaze, settle};
use crate::priors::{Priors, SkyClass};
use crate::start::{self, SkyPhotos, StartConfig};
use glam::DVec3;
use std::ops::Range;
use std::path::Path;
use wm_base::color::srgb_decode;
use wm_capture::ground::{CARRIED_HEIGHT_M, CaptureGround, CaptureGroundError, ground};
use wm_capture::up::{CaptureUp, UpEvidence};
use wm_scene::survey::{Confidence, Survey, label_sky};
use wm_scene::{Camera, Metadata, Scene, Splats};

/// Least cosine between the normal of the ground under a walk and up: 15 degrees, so that steep
/// streets pass.
const MIN_GROUND_COSINE: f64 = 0.966;
/// Weight of that normal against up from the splats. The normal is within 0.25 degrees on level
/// ground and off by the slope elsewhere; splats of a drive can be off by 6 degrees to one side.
const GROUND_WEIGHT: f64 = 0.7;
/// Error of up from GPS, degrees, below which the splats are not used for it.
const MAX_GPS_ERROR_DEG: f64 = 3.0;
/// Least extent of the GPS positions in units of their residual for a reliable scale: about 5 %.
const MIN_GPS_EXTENT: f64 = 20.0;

/// Returns the splats that a training starts with.
pub(super) fn start(
    dataset: &Path,
    config: &TrainConfig,
    data: &TrainData,
    priors: Option<&Priors>,
    haze: Option<&PhotoHaze>,
    gains: Option<&PhotoGains>,
    part: Option<&TrainPart>,
) -> Result<Splats, SessionError> {
    let begin = StartConfig {
        opacity: config.start_opacity,
        scale: config.start_scale,
        most: config.densify.strategy().max_splats().unwrap_or(usize::MAX),
        sh_degree: config.sh_degree,
        seed: config.seed,
    };
    let mut points = data.set.capture.points.clone();
    if let Some(haze) = haze {
        haze.clear_points(&data.set.capture, &mut points);
    }
    let views = priors.map_or(Ok(Vec::new()), |priors| prior_views(data, priors, gains))?;
    if !points.is_empty() {
        let most = (config.start_fill * begin.most as f64) as usize;
        let views: Vec<FillView<'_>> = views
            .iter()
            .map(|PriorView { camera, prior, photo, .. }| FillView { camera, prior, photo })
            .collect();
        fill(&mut points, &views, most, haze);
    }
    let cameras = data.cameras();
    let extent = start::extent(&cameras);
    let mut splats = match points.is_empty() {
        true => start::blind(&cameras, extent, &begin),
        false => start::from_points(&points, extent, &begin),
    };
    if splats.is_empty() {
        return Err(SessionError::NoFinitePoint(dataset.to_owned()));
    }
    match part {
        Some(part) => part.add_sky(&mut splats),
        None if config.sky_splats > 0 && priors.is_some_and(Priors::has_sky) => {
            add_sky(&mut splats, data, &views, config.sky_splats, haze);
        }
        None => {}
    }
    Ok(splats)
}

/// Returns the splats of the sky over the whole data set, which begin a training and stay as they
/// are.
pub(super) fn sky(
    config: &TrainConfig,
    data: &TrainData,
    priors: Option<&Priors>,
    haze: Option<&PhotoHaze>,
    gains: Option<&PhotoGains>,
) -> Result<Splats, SessionError> {
    let mut splats = Splats::with_capacity(0, config.sh_degree);
    if let Some(priors) = priors.filter(|priors| config.sky_splats > 0 && priors.has_sky()) {
        add_sky(&mut splats, data, &prior_views(data, priors, gains)?, config.sky_splats, haze);
    }
    Ok(splats)
}

/// Returns the ground that the haze hides from `cameras`, if up is known.
fn far_ground<'a>(
    data: &TrainData,
    cameras: &'a [Camera],
    haze: Option<&PhotoHaze>,
) -> Option<FarGround<'a>> {
    FarGround::new(cameras, &data.set.capture.points, data.up?.up, haze?)
}

/// Adds the sky where the priors say that photos show it, and where haze looks like it.
fn add_sky(splats: &mut Splats, data: &TrainData, views: &[PriorView], count: u32, haze: Option<&PhotoHaze>) {
    let Some(up) = data.up else { return };
    let views: Vec<&PriorView> = views.iter().filter(|view| !view.prior.sky.is_empty()).collect();
    let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
    let look = |index: usize, [x, y]: [f64; 2]| {
        let PriorView { prior, photo, .. } = views[index];
        let (width, height) = (f64::from(prior.width), f64::from(prior.height));
        let class = prior.sky[(y * height) as usize * prior.width as usize + (x * width) as usize];
        (class, photo.at_share(x, y))
    };
    let gain = |index: usize| views[index].gain;
    let training_cameras = data.cameras();
    let lowest = far_ground(data, &training_cameras, haze).map(|ground| ground.lowest());
    let photos = SkyPhotos { cameras: &cameras, look: &look, gain: &gain, up: up.up, lowest };
    let extent = start::extent(&training_cameras);
    start::add_sky(splats, &photos, &data.set.capture.points, extent, count as usize);
}

/// Returns the haze of the training photos, as the configuration has it, and their gains; tells the
/// observer of it.
pub(super) fn haze(
    mode: HazeMode,
    data: &TrainData,
    priors: Option<&Priors>,
    options: &SessionOptions,
    observer: &mut dyn TrainObserver,
) -> Result<Option<(PhotoHaze, PhotoGains)>, SessionError> {
    if let Some(part) = &options.part {
        return Ok(part.haze_of(&data.set));
    }
    if mode == HazeMode::Keep {
        return Ok(None);
    }
    let horizon = priors.map_or(Ok(None), |priors| horizon(data, priors))?;
    let Dataset { capture, photos, places } = &data.set;
    let metres_per_unit = || {
        let found = scale(data, options.camera_height, &ground(capture));
        options.facts.metres_per_unit.or_else(|| Some(found?.metres_per_unit))
    };
    let found = match mode {
        HazeMode::Keep => None,
        HazeMode::Auto => PhotoHaze::measured(capture, photos, places, horizon),
        HazeMode::Mor(mor) => {
            let extinction = PhotoHaze::extinction_of(mor / metres_per_unit().unwrap_or(1.0));
            PhotoHaze::given(capture, photos, places, extinction, horizon)
        }
    };
    match &found {
        Some((haze, _)) => {
            let mut known = Metadata { metres_per_unit: metres_per_unit(), ..Metadata::default() };
            haze.note(&mut known);
            observer.on_notice(&TrainNotice::Haze(known.haze().unwrap_or_default()));
        }
        None if matches!(mode, HazeMode::Mor(_)) => observer.on_warning(&TrainWarning::NoHaze),
        None => {}
    }
    Ok(found)
}

/// Sines of elevations at which the sky is as bright as endless haze: up to 8 degrees.
const LOW_SKY_SINES: Range<f64> = 0.0..0.14;
/// Fewest pixels of low sky for its colour.
const MIN_LOW_SKY_PIXELS: usize = 200;
/// Display-referred value from which the sky is clipped.
const CLIPPED_VALUE: f64 = 0.97;

/// Rank of the sky's colour among these pixels: some belong to distant trees and houses, which are
/// darker.
const SKY_COLOR_RANK: f64 = 0.8;

/// Returns the colour of the sky just above the horizon, linear RGB, where photos show it and are
/// not clipped.
fn horizon(data: &TrainData, priors: &Priors) -> Result<Option<[f64; 3]>, SessionError> {
    let Some(up) = data.up.filter(|_| priors.has_sky()) else { return Ok(None) };
    let mut shown: [Vec<u8>; 3] = Default::default();
    for PriorView { camera, prior, photo, .. } in prior_views(data, priors, None)? {
        let (width, height) = (prior.width as usize, prior.height as usize);
        for at in (0..prior.sky.len()).filter(|at| prior.sky[*at] == SkyClass::Sky) {
            let [x, y] = [(at % width) as f64 + 0.5, (at / width) as f64 + 0.5];
            let [x, y] = [x / width as f64, y / height as f64];
            let ray = camera.ray(x * f64::from(camera.width), y * f64::from(camera.height));
            if LOW_SKY_SINES.contains(&ray.normalize().dot(up.up)) {
                let rgb = photo.at_share(x, y);
                (0..3).for_each(|c| shown[c].push(rgb[c]));
            }
        }
    }
    if shown[0].len() < MIN_LOW_SKY_PIXELS {
        return Ok(None);
    }
    let sky = shown.map(|mut values| {
        let rank = (SKY_COLOR_RANK * values.len() as f64) as usize;
        f64::from(*values.select_nth_unstable(rank).1) / 255.0
    });
    Ok(sky.iter().all(|v| *v < CLIPPED_VALUE).then(|| sky.map(srgb_decode)))
}

/// Returns the scene of trained splats: with the sky labelled, the photos' cameras, and in its
/// metadata what they and the splats tell of up, ground and scale.
pub(super) fn finish(
    mut splats: Splats,
    config: &TrainConfig,
    data: &TrainData,
    options: &SessionOptions,
    priors: Option<&Priors>,
    haze: Option<&PhotoHaze>,
    observer: &mut dyn TrainObserver,
) -> Result<Scene, SessionError> {
    let given = &options.facts;
    // Up from GPS, where that is accurate enough without the splats.
    let is_accurate =
        |up: &CaptureUp| matches!(up.evidence, UpEvidence::Gps { .. }) && up.error < MAX_GPS_ERROR_DEG;
    let measured = data.up.filter(|up| given.up.is_none() && is_accurate(up));
    let facts = Metadata { up: given.up.or(measured.map(|up| up.up)), ..given.clone() };
    label_sky(&mut splats);
    // Through haze, splats have other colours than the photos.
    if let (Some(priors), None, true) = (priors, haze, config.sky_splats > 0) {
        let views = prior_views(data, priors, data.first_exposures(config.exposure, None))?;
        label_painted_sky(&mut splats, &views, config.rasterization, options.cpu)?;
    }
    if let Some(haze) = haze {
        let cameras = data.cameras();
        settle(&mut splats, &cameras, &haze.air());
        if let Some(ground) = far_ground(data, &cameras, Some(haze)) {
            ground.add(&mut splats, start::extent(&cameras), haze);
        }
    }
    let origin = data.set.capture.origin;
    let mut metadata = Metadata {
        origin: (origin != DVec3::ZERO).then_some(origin),
        rasterization: Some(config.rasterization),
        provenance: Some(format!(
            "weather-magician {}, {} photos, {} steps",
            env!("CARGO_PKG_VERSION"),
            data.set.places.len(),
            config.steps
        )),
        ..Metadata::default()
    };
    if let Some(haze) = haze {
        haze.note(&mut metadata);
    }
    let mut scene = Scene { splats, metadata, views: data.views(), ..Scene::default() };
    let mut survey = Survey::of(&scene, &facts);
    let ground = ground(&data.set.capture);
    if let (None, Ok(ground)) = (facts.up, &ground)
        && ground.up.dot(survey.up.value) > MIN_GROUND_COSINE
    {
        let estimate = survey.up_estimate.take();
        let up = GROUND_WEIGHT * ground.up + (1.0 - GROUND_WEIGHT) * survey.up.value;
        scene.metadata.up = Some(up.normalize());
        scene.metadata.up_source = Some("the splats, and the ground along the path of the photos".into());
        scene.metadata.up_confidence = Some(survey.up.confidence).filter(|up| *up != Confidence::Sure);
        survey = Survey::of(&scene, &facts);
        survey.up_estimate = estimate;
    }
    let mut known = survey.metadata();
    if let Some(up) = measured {
        known.up_source = Some(up.evidence.to_string());
        known.up_confidence = None;
    }
    known.location = facts.location;
    (known.captured, known.captured_span) = (facts.captured, facts.captured_span);
    known.sun = facts.sun;
    site(&data.set.capture, &data.set.photos, survey.up.value).note(&mut known);
    if facts.ground.is_none()
        && let Ok(ground) = &ground
        && ground.up.dot(survey.up.value) > MIN_GROUND_COSINE
    {
        // The ground is measured from points in many photos, which is better than from trained
        // splats.
        known.ground = Some(ground.under.dot(survey.up.value));
        // The height of the cameras over the ground is as accurate as up.
        known.ground_confidence = Some(survey.up.confidence.max(Confidence::Likely));
        known.camera_height = Some(ground.height);
    }
    if known.metres_per_unit.is_none() {
        let found = scale(data, options.camera_height, &ground);
        if let (Err(reason), true) = (&ground, found.is_none() || options.camera_height.is_some()) {
            observer.on_notice(&TrainNotice::NoScaleFromHeight(*reason));
        }
        if let Some(FoundScale { metres_per_unit, source, confidence }) = found {
            observer.on_notice(&TrainNotice::Scale { metres_per_unit, source: source.clone() });
            known.metres_per_unit = Some(metres_per_unit);
            known.scale_source = Some(source);
            known.scale_confidence = Some(confidence).filter(|known| *known != Confidence::Sure);
        }
    }
    if let Some(warning) = survey.up_warning() {
        observer.on_warning(&TrainWarning::DoubtfulUp(warning));
    }
    scene.metadata = known.or(std::mem::take(&mut scene.metadata));
    if scene.metadata.metres_per_unit.is_none()
        && let Some(warning) = survey.warning()
    {
        observer.on_warning(&TrainWarning::NoScale(warning));
    }
    Ok(scene)
}

/// A scale and its source.
struct FoundScale {
    metres_per_unit: f64,
    source: String,
    confidence: Confidence,
}

/// Returns metres per scene unit and their source: the given height of the cameras, else the GPS
/// positions of the photos, else the height at which people hold cameras.
fn scale(
    data: &TrainData,
    camera_height: Option<f64>,
    ground: &Result<CaptureGround, CaptureGroundError>,
) -> Option<FoundScale> {
    let by_height = |metres: f64, confidence: Confidence| {
        let metres_per_unit = metres / ground.as_ref().ok()?.height;
        let source = format!("the camera height of {metres} m above the ground");
        let is_scale = metres_per_unit.is_finite() && metres_per_unit > 0.0;
        is_scale.then_some(FoundScale { metres_per_unit, source, confidence })
    };
    let by_gps = || {
        let gps = data.gps?;
        let source = format!("the GPS of {} photos, met within {:.1} m", gps.photos, gps.residual);
        let is_sure = gps.extent > MIN_GPS_EXTENT * gps.residual.max(1.0);
        let confidence = if is_sure { Confidence::Sure } else { Confidence::Likely };
        Some(FoundScale { metres_per_unit: gps.metres_per_unit, source, confidence })
    };
    let given = camera_height.and_then(|metres| by_height(metres, Confidence::Sure));
    // This is approximate: people differ in height, and a drone may fly as level as a person
    // walks.
    given.or_else(by_gps).or_else(|| match camera_height {
        Some(_) => None,
        None => by_height(CARRIED_HEIGHT_M, Confidence::Likely),
    })
}
