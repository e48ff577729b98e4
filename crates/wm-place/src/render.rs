//! Renders what a request describes: the picture itself, then the layers that are pictures of their
//! own.

use crate::camera_model::CameraModel;
use crate::drawing::Drawing;
use crate::layers::LayerPasses;
use crate::picture::WaterLayers;
use crate::place::{PreparedPlace, check_owner};
use crate::shot::{PinholeContent, PinholeShot};
use crate::tags::picture_tags;
use crate::{Error, FrameCamera, FrameRequest, LensView, NextFrame, Picture, Progress, Renderer, Result};
use wm_render::parts::PictureParts;
use wm_render::{Frame, Outputs, Stats, at_once};
use wm_weather::Weather;
use wm_weather::paper::PaperStages;

impl Renderer {
    /// Renders a frame. Assets that the weather needs and the place does not have yet, such as the
    /// ground under snow, are made first. This takes seconds, once.
    ///
    /// # Errors
    /// [`crate::Error`] if the camera or the place cannot be rendered with, or cannot have a layer.
    pub fn render(&mut self, place: &mut PreparedPlace, request: &FrameRequest<'_>) -> Result<Picture> {
        let mut picture = Picture::default();
        self.render_into(place, request, &mut picture, &mut ())?;
        let camera = request.camera.at(request.time, place)?.camera;
        picture.tags = picture_tags("", place.site(), self.backend(), request.weather, request.time, &camera);
        Ok(picture)
    }

    /// Renders a frame into `picture`, whose memory is used again and whose tags stay, and returns
    /// what its colour took.
    ///
    /// # Errors
    /// As [`Self::render`]; [`crate::Error::Stopped`] if `progress` asks to stop.
    pub fn render_into(
        &mut self,
        place: &mut PreparedPlace,
        request: &FrameRequest<'_>,
        picture: &mut Picture,
        progress: &mut dyn Progress,
    ) -> Result<Stats> {
        at_once(self.render_async(place, request, picture, progress))
    }

    /// [`Self::render_into`] for a program that must not wait: in a browser others work while the
    /// GPU draws. Elsewhere the future is done when it is first polled.
    ///
    /// # Errors
    /// As [`Self::render_into`].
    pub async fn render_async(
        &mut self,
        place: &mut PreparedPlace,
        request: &FrameRequest<'_>,
        picture: &mut Picture,
        progress: &mut dyn Progress,
    ) -> Result<Stats> {
        check_owner(place, self.id())?;
        match request.camera {
            FrameCamera::Device(camera) => request.layers.check(&camera.model, request.weather)?,
            _ => request.layers.check(&CameraModel::default(), request.weather)?,
        }
        let passes = LayerPasses::of(request.layers);
        if (passes.flow || passes.particle_flow) && request.next.is_none() {
            return Err(Error::Unsupported(
                "layers flow, flow-mask and particle-flow need the next frame: name its time and camera"
                    .into(),
            ));
        }
        let FrameRequest { weather, camera, time, index, patience, .. } = *request;
        let shot = PinholeShot {
            weather,
            time,
            camera: camera.at(time, place)?,
            whole: None,
            outputs: passes.outputs,
            parts: &passes.parts,
            stages: passes.stages,
            patience,
            content: PinholeContent::Picture,
        };
        let lens = camera.lens();
        let mut drawing = Drawing { renderer: self, place, progress };
        let mut stats = Stats::default();
        if passes.picture {
            stats += drawing.of_camera(camera, index, &shot, picture).await?;
        } else {
            let size = lens.map_or(&shot.camera.camera, LensView::intrinsics);
            picture.frame = Frame { width: size.width, height: size.height, ..Frame::default() };
            (picture.parts, picture.water) = (PictureParts::default(), WaterLayers::default());
            picture.stages = PaperStages::default();
        }
        picture.metres_per_unit = drawing.place.site().metres_per_unit;
        let next = request.next.map(|NextFrame { time, camera }| PinholeShot { time, camera, ..shot });
        picture.particle_flow.clear();
        if let Some(next) = next.as_ref().filter(|_| passes.particle_flow) {
            picture.particle_flow = drawing.particle_flow(&shot, next).await?;
        }
        picture.surface_depth.clear();
        if passes.surface_depth || passes.flow {
            picture.surface_depth = drawing.surface_depth(lens, &shot).await?;
        }
        picture.flow = Default::default();
        if let Some(next) = next.as_ref().filter(|_| passes.flow) {
            let depth = drawing.surface_depth(lens, next).await?;
            picture.flow = drawing.flow(lens, [&shot, next], [&picture.surface_depth, &depth]);
        }
        if !passes.surface_depth {
            picture.surface_depth.clear();
        }
        picture.labels = Default::default();
        if passes.labels {
            picture.labels = drawing.labels(lens, &shot.camera.camera)?;
        }
        picture.clear.clear();
        if passes.clear {
            let weather = &Weather::clear();
            let outputs = Outputs::default();
            let shot = PinholeShot { weather, outputs, parts: &[], stages: false, ..shot };
            let mut clear = std::mem::take(&mut drawing.renderer.clear);
            stats += drawing.of_camera(camera, index, &shot, &mut clear).await?;
            std::mem::swap(&mut picture.clear, &mut clear.frame.rgb);
            drawing.renderer.clear = clear;
        }
        Ok(stats)
    }
}

impl Drawing<'_> {
    /// Draws a picture of a request's camera.
    async fn of_camera(
        &mut self,
        camera: FrameCamera<'_>,
        index: u32,
        shot: &PinholeShot<'_>,
        picture: &mut Picture,
    ) -> Result<Stats> {
        match camera {
            FrameCamera::Device(camera) => self.expose(camera, index, shot, picture).await,
            FrameCamera::Pinhole(_) | FrameCamera::LookAt(_) => self.pinhole(shot, picture).await,
        }
    }
}
