//! The rendering of frames, one at a time.

use super::args::RenderArgs;
use super::camera::CameraPlan;
use super::stages;
use crate::progress::Reporter;
use crate::scene::OpenScene;
use anyhow::Result;
use std::path::Path;
use weather_magician::camera_model::{CameraModel, SensorCamera};
use weather_magician::output::{LayerPlacement, PictureStyle};
use weather_magician::{
    Camera, FrameRequest, Layers, NextFrame, Picture, PreparedPlace, Renderer, Weather, picture_tags,
};
use wm_image::png::DepthScale;
use wm_render::Stats;

/// The scene, the weather and the camera of the frames to render.
pub(super) struct RenderJob {
    pub(super) renderer: Renderer,
    pub(super) place: PreparedPlace,
    pub(super) weather: Weather,
    pub(super) plan: CameraPlan,
    /// The camera that takes the pictures.
    pub(super) camera: SensorCamera,
    pub(super) layers: Layers,
}

impl RenderJob {
    /// Prepares the scene for the weather.
    pub(super) fn new(
        mut loaded: OpenScene,
        weather: Weather,
        plan: CameraPlan,
        model: CameraModel,
        layers: Layers,
    ) -> Result<Self> {
        let weather = loaded.place.weather_of_shot(&weather, &plan.motion.camera(plan.time(0)));
        loaded.prepare(&weather)?;
        let OpenScene { renderer, place } = loaded;
        let camera = SensorCamera::new(model, plan.motion.clone());
        Ok(Self { renderer, place, weather, plan, camera, layers })
    }

    /// Renders the frame at `time`, seconds.
    pub(super) fn render(&mut self, time: f64, picture: &mut Picture) -> Result<Stats> {
        let Self { renderer, place, weather, camera, layers, plan } = self;
        let metres = place.site().metres_per_unit;
        let (after, moving) = plan.next(time, metres);
        let request = FrameRequest {
            index: plan.index(time),
            layers: *layers,
            next: Some(NextFrame { time: after, camera: moving }),
            previous: plan.previous(time, metres),
            ..FrameRequest::new(weather, &*camera, time)
        };
        Ok(renderer.render_into(place, &request, picture, &mut Reporter::default())?)
    }

    /// Returns the camera at `time`, seconds, with the size and the intrinsics of the pictures.
    pub(super) fn camera(&self, time: f64) -> Camera {
        let camera = self.plan.motion.camera(time);
        match &self.camera.model.lens {
            Some(lens) => Camera { viewmat: camera.viewmat, near: camera.near, ..*lens.intrinsics() },
            None => camera,
        }
    }

    /// Renders one picture into a file.
    pub(super) fn picture(&mut self, path: &Path, args: &RenderArgs) -> Result<()> {
        let mut picture = Picture::default();
        let style = self.style(args, DepthScale::Auto, args.output.time());
        let stats = self.render(args.output.time(), &mut picture)?;
        let mut beside = style.write(&picture, path)?;
        if args.output.stages {
            beside.extend(stages::write(&picture, &style, path)?);
        }
        let frame = &picture.frame;
        println!(
            "{}: {}x{}, {}, {:.0} ms ({})",
            path.display(),
            frame.width,
            frame.height,
            self.weather.name,
            stats.wall * 1e3,
            self.renderer.describe()
        );
        for line in beside {
            println!("{line}");
        }
        Ok(())
    }

    /// Returns the style in which the frame at `time` is written.
    pub(super) fn style(&self, args: &RenderArgs, depth_scale: DepthScale, time: f64) -> PictureStyle {
        let (scene, site) = (args.scene.scene.display().to_string(), self.place.site());
        let camera = self.camera(time);
        let mut tags = picture_tags(&scene, site, self.renderer.backend(), &self.weather, time, &camera);
        let model = &self.camera.model;
        if let Some(lens) = &model.lens {
            tags.push(("lens".into(), format!("{:?}", lens.lens())));
        }
        if let Some(settings) = model.settings() {
            tags.push(("camera".into(), settings));
        }
        PictureStyle {
            also: args.output.also.clone(),
            place: if args.output.layers { LayerPlacement::Layers } else { LayerPlacement::Beside },
            dither: args.output.dither,
            depth_scale,
            tags,
        }
    }
}
