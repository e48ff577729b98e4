//! The surfaces of a place under a point of a picture and under a camera, and water over them.

use super::prepared::PreparedPlace;
use crate::assets::WithoutSky;
use crate::{Error, Renderer, Result};
use glam::DVec3;
use wm_render::{AnyRenderer, DrawPass, Frame, MedianDepth, Outputs, RenderBackend, SetView, Stats};
use wm_scene::Camera;
use wm_scene::survey::{FactSource, NearGround};
use wm_weather::{PreparedWeather, Site, Weather};

/// Least height of the picture of which a part is rendered to find a surface, px.
const SURFACE_HEIGHT: u32 = 2160;

/// Share by which depths differ that are of one surface.
const ONE_SURFACE: f64 = 0.1;

impl Renderer {
    /// Returns the point of the scene (scene units) that is seen at the point `[x, y]` (px) of a
    /// camera's picture, by the median depth without weather; `None` where less than half of the
    /// light is that of surfaces, such as in the sky.
    ///
    /// # Errors
    /// As [`Self::render`]; [`crate::Error::Unsupported`] after [`PreparedPlace::release_splats`].
    pub fn surface_at(
        &mut self,
        place: &PreparedPlace,
        camera: &Camera,
        at: [f64; 2],
    ) -> Result<Option<DVec3>> {
        let backend = self.backend_of(place)?;
        place.check_splats()?;
        let [x, y] = at;
        let is_inside =
            (0.0..=f64::from(camera.width)).contains(&x) && (0.0..=f64::from(camera.height)).contains(&y);
        if !is_inside {
            return Ok(None);
        }
        // A small picture about the point, which is in its middle: a finer one than the camera's,
        // since pixels blur depth where a surface is seen at a low angle.
        let finer = SURFACE_HEIGHT.div_ceil(camera.height.max(1));
        let fine = camera.resized(camera.width * finer, camera.height * finer);
        let (x, y) = (x * f64::from(finer), y * f64::from(finer));
        let reach = fine.height / 45;
        let side = 2 * reach + 1;
        let middle = f64::from(side) / 2.0;
        let part =
            Camera { width: side, height: side, cx: fine.cx - x + middle, cy: fine.cy - y + middle, ..fine };
        let outputs = Outputs { median_depth: MedianDepth::On, ..Outputs::default() };
        let config = place.config(outputs);
        let without_sky = WithoutSky::of(&place.scene);
        let sets = [SetView::plain(place.set).with_attributes(Some(&without_sky))];
        let mut frame = Frame::default();
        backend.render(&DrawPass::new(&sets, &part, &config), &mut frame)?;
        Ok(middle_depth(&frame.median_depth).map(|depth| {
            let ray = fine.ray(x, y);
            camera.center() + ray * (depth / ray.dot(camera.forward()))
        }))
    }
}

impl PreparedPlace {
    /// Draws the splat that has the median depth at each pixel, without any weather: see
    /// [`Frame::median_splat`].
    pub(crate) fn draw_median_splats(
        &self,
        backend: &mut AnyRenderer,
        camera: &Camera,
        frame: &mut Frame,
    ) -> Result<Stats> {
        let outputs = Outputs { median_depth: MedianDepth::Splat, ..Outputs::default() };
        let config = self.config(outputs);
        Ok(backend.render(&DrawPass::new(&[SetView::plain(self.set)], camera, &config), frame)?)
    }

    /// The level surfaces of the place, found when they are first asked for.
    pub(super) fn near_ground(&mut self) -> &NearGround {
        self.near_ground.get_or_insert_with(|| NearGround::of(&self.scene.splats, self.survey.up.value))
    }

    /// Checks that the water of an instant can be drawn from an eye.
    pub(super) fn check_water(
        &mut self,
        weather: &Weather,
        prepared: &PreparedWeather,
        camera: &Camera,
    ) -> Result<()> {
        let Some(track) = weather.at(0.0).track("flood", "level").cloned() else { return Ok(()) };
        if self.survey.ground.source == FactSource::Assumed
            && flood_follows_camera(weather)
            && self.ground_under(camera).is_none()
        {
            let fault = "flood.level is over the ground, and the height of the ground is not known here: give --ground, or \
                         flood.ground";
            return Err(Error::Unsupported(fault.into()));
        }
        if !prepared.paper_falls.is_empty() {
            let fault = "flood cannot be drawn together with rain or snow of fidelity `paper`: use fidelity `physical`";
            return Err(Error::Unsupported(fault.into()));
        }
        if track.most() <= 0.0 && !self.warnings.iter().any(|warning| warning.starts_with("flood.level")) {
            self.warnings.push("flood.level is not above the ground: no water is drawn".into());
        }
        let Some(map) = prepared.water(None) else { return Ok(()) };
        let over = prepared.flood().and_then(|flood| flood.ground).unwrap_or(0.0);
        let ground = self.site.ground * self.site.metres_per_unit + over;
        let eye = map.height_of(camera.center().to_array());
        match map.heights() {
            Some([_, high]) if eye <= high => Err(Error::Unsupported(format!(
                "the camera is under water: flood.level is {:.2} m over the ground, the eye {:.2} m; raise the camera or lower the level",
                high - ground,
                eye - ground,
            ))),
            _ => Ok(()),
        }
    }

    /// The weather of a shot that starts with a camera: what follows the camera by itself is what
    /// it is there. A flood whose `ground` is `auto` stands at one level over the whole shot then.
    #[must_use]
    pub fn weather_of_shot(&mut self, weather: &Weather, camera: &Camera) -> Weather {
        if !flood_follows_camera(weather) {
            return weather.clone();
        }
        let ground = self.ground_under(camera);
        // Without any, and at a height out of range, it stays as it is.
        ground
            .and_then(|ground| weather.clone().set("flood.ground", ground).ok())
            .unwrap_or_else(|| weather.clone())
    }

    /// Height of the ground straight under a camera over the ground of the site, m; `None` where
    /// there is none near by.
    pub(super) fn ground_under(&mut self, camera: &Camera) -> Option<f64> {
        let eye = camera.center();
        if let Some((_, height)) = self.last_ground.filter(|(known, _)| *known == eye) {
            return height;
        }
        let Site { ground, metres_per_unit, .. } = self.site;
        let height = self.near_ground().height_under(eye, metres_per_unit);
        let height = height.map(|height| (height - ground) * metres_per_unit);
        self.last_ground = Some((eye, height));
        height
    }
}

/// Returns the depth in the middle of a square of median depths, of which 0 is nothing. Depths of
/// splats are steps; the reciprocal depth of a plane is linear over the picture, so that its mean
/// over points to both sides is that in the middle.
fn middle_depth(depths: &[f32]) -> Option<f64> {
    let middle = f64::from(*depths.get(depths.len() / 2)?);
    if middle <= 0.0 {
        return None;
    }
    let is_near = |depth: f64| (depth / middle - 1.0).abs() < ONE_SURFACE;
    let pairs = depths.iter().zip(depths.iter().rev()).map(|(a, b)| [f64::from(*a), f64::from(*b)]);
    let near: Vec<f64> = pairs.filter(|pair| pair.iter().all(|depth| is_near(*depth))).flatten().collect();
    Some(near.len() as f64 / near.iter().map(|depth| depth.recip()).sum::<f64>())
}

/// Returns true if a weather has a flood whose level counts from the ground under the camera.
pub(super) fn flood_follows_camera(weather: &Weather) -> bool {
    weather.at(0.0).track("flood", "ground").is_some_and(|track| track.at(0.0).number().is_none())
}
