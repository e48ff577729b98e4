//! Draws views as bytes, and says what they show.

use crate::encode::{join_columns, to_bytes};
use crate::state::{Pose, ViewOutput, ViewState};
use crate::view::View;
use serde_json::{Map, Value, json};
use weather_magician::lidar::PointOverlay;
use weather_magician::{
    FrameRequest, Layers, MovingCamera, Patience, Picture, PictureLayer, PreparedPlace, Renderer, Result,
};
use wm_image::color::Dither;
use wm_render::{Frame, Stats};
use wm_scene::Camera;
use wm_scene::survey::Survey;
use wm_weather::{PreparedWeather, Site, Weather};

/// Depth that gets the middle colour, scene radii.
const HALF_DEPTH: f64 = 0.3;

/// Returns the depth that gets the middle colour in pictures of a scene, scene units.
pub fn half_depth(survey: &Survey) -> f64 {
    HALF_DEPTH * survey.radius
}

impl ViewOutput {
    /// Returns the layer of the picture that is shown.
    pub fn layer(self) -> PictureLayer {
        match self {
            Self::Rgb => PictureLayer::Color,
            Self::Depth => PictureLayer::Depth,
            Self::Normal => PictureLayer::Normal,
            Self::Alpha => PictureLayer::Alpha,
        }
    }
}

/// The size and the effort of a drawing.
#[derive(Clone, Copy, Debug)]
pub struct PaintOptions {
    /// Width and height, px: those of the view, or others for a draft.
    pub size: (u32, u32),
    /// The treatment of missing assets.
    pub patience: Patience,
    /// The quantisation of colours.
    pub dither: Dither,
}

/// Draws views, and keeps the memory of their frames from one to the next. In a browser others work
/// while a GPU draws; elsewhere every future is done when it is first polled, so
/// [`wm_render::at_once()`] gives its value.
#[derive(Default)]
pub struct ViewPainter {
    picture: Picture,
    clear: Picture,
}

impl ViewPainter {
    /// Draws a view as bytes `[H, W, 3]`, without weather left of its divider, and with the points
    /// of its lidar if they are given.
    ///
    /// # Errors
    /// As [`Renderer::render_into`].
    pub async fn draw(
        &mut self,
        renderer: &mut Renderer,
        place: &mut PreparedPlace,
        view: &View,
        overlay: Option<&PointOverlay>,
        options: PaintOptions,
    ) -> Result<(Vec<u8>, Stats)> {
        let ViewState { time, output, divider, .. } = view.state;
        let PaintOptions { size, patience, dither } = options;
        let mut layers = Layers::COLOR | output.layer().into();
        if overlay.is_some() {
            // They hide points.
            layers |= Layers::DEPTH | Layers::MEDIAN_DEPTH;
        }
        let clear = Weather::clear();
        let camera = view.motion_for(size).at(time, place.site().metres_per_unit);
        let half = half_depth(place.survey());
        let shown = |frame: &Frame, camera: &Camera| {
            let mut bytes = to_bytes(frame, output, half, dither);
            if let Some(overlay) = overlay {
                overlay.draw(&mut bytes, frame, camera);
            }
            bytes
        };
        // Columns without weather.
        let cut = divider.map_or(0, |share| (share * f64::from(size.0)).round() as u32);
        let (mut left, mut right, mut stats) = (Vec::new(), Vec::new(), Stats::default());
        if cut > 0 {
            let camera = crop_columns(&camera.camera, 0, cut);
            let request = FrameRequest { layers, ..FrameRequest::new(&clear, camera, time) };
            stats += renderer.render_async(place, &request, &mut self.clear, &mut ()).await?;
            left = shown(&self.clear.frame, &camera);
        }
        if cut < size.0 {
            let camera = MovingCamera { camera: crop_columns(&camera.camera, cut, size.0 - cut), ..camera };
            let request = FrameRequest { layers, patience, ..FrameRequest::new(&view.weather, camera, time) };
            stats += renderer.render_async(place, &request, &mut self.picture, &mut ()).await?;
            right = shown(&self.picture.frame, &camera.camera);
        }
        Ok((join_columns((left, cut), (right, size.0 - cut)), stats))
    }

    /// Renders the picture of a view that `render` writes: of its size, without divider and points.
    ///
    /// # Errors
    /// As [`Renderer::render_into`].
    pub async fn render(
        &mut self,
        renderer: &mut Renderer,
        place: &mut PreparedPlace,
        view: &View,
    ) -> Result<&Picture> {
        let time = view.state.time;
        let camera = view.motion().at(time, place.site().metres_per_unit);
        let layers = Layers::COLOR | view.state.output.layer().into();
        let request = FrameRequest { layers, ..FrameRequest::new(&view.weather, camera, time) };
        renderer.render_async(place, &request, &mut self.picture, &mut ()).await?;
        Ok(&self.picture)
    }

    /// Returns the point of the scene that is seen at `at` (x and y, 0-1) of the picture; `None`
    /// where there is nothing.
    ///
    /// # Errors
    /// As [`Renderer::render_into`].
    pub async fn pick(
        &mut self,
        renderer: &mut Renderer,
        place: &mut PreparedPlace,
        view: &View,
        at: [f64; 2],
    ) -> Result<Option<[f64; 3]>> {
        let [width, height] = view.state.size.map(|side| (side / 4).max(1));
        let camera = view.motion_for((width, height)).camera(view.state.time);
        let clear = Weather::clear();
        let layers = Layers::COLOR | Layers::DEPTH;
        let request = FrameRequest { layers, ..FrameRequest::new(&clear, camera, view.state.time) };
        renderer.render_async(place, &request, &mut self.clear, &mut ()).await?;
        let [column, row] = [(at[0], width), (at[1], height)]
            .map(|(share, side)| ((share * f64::from(side)) as u32).min(side - 1));
        let depth = self.clear.frame.depth[self.clear.frame.index(column, row)];
        let ray = camera.ray(f64::from(column) + 0.5, f64::from(row) + 0.5);
        let reach = f64::from(depth) / ray.dot(camera.forward());
        Ok((depth > 0.0).then(|| (camera.center() + ray * reach).to_array()))
    }
}

/// Crops a camera to `width` columns from `first` on.
fn crop_columns(camera: &Camera, first: u32, width: u32) -> Camera {
    Camera { width, cx: camera.cx - f64::from(first), ..*camera }
}

/// A frame of a view, as its header tells it.
#[derive(Clone, Copy, Debug)]
pub struct FrameReport<'a> {
    /// The sequence number of the request.
    pub seq: u64,
    /// Width and height, px.
    pub size: (u32, u32),
    /// True if nothing is missing: no asset, and no sweep.
    pub is_whole: bool,
    /// Statistics of the drawing.
    pub stats: &'a Stats,
    /// Time of drawing and of encoding, s.
    pub seconds: [f64; 2],
}

impl FrameReport<'_> {
    /// Returns the JSON header that is sent with the frame of a view; `lidar` is the report of its
    /// sweep.
    pub fn header(&self, view: &View, site: &Site, lidar: Value) -> Value {
        let time = view.state.time;
        let sky: PreparedWeather = view.weather.at(time).prepare(site);
        let camera = view.camera();
        let mor = sky.air.mor_at(camera.center().to_array());
        let rate = |name: &str| -> f64 {
            sky.falling.iter().filter(|fall| fall.kind.name == name).map(|fall| fall.rate).sum()
        };
        let falls: Map<String, Value> =
            sky.falling.iter().map(|fall| (fall.kind.name.to_owned(), fall.rate.into())).collect();
        let [draw, encode] = self.seconds;
        json!({
            "seq": self.seq, "width": self.size.0, "height": self.size.1, "whole": self.is_whole, "time": time,
            "draw_ms": draw * 1e3, "encode_ms": encode * 1e3,
            "splats": self.stats.visible, "drops": self.stats.particles,
            "mor": mor.is_finite().then_some(mor), "rain": rate("rain"), "snow": rate("snow"), "falls": falls,
            "camera": Pose::of(&camera), "lidar": lidar,
        })
    }
}
