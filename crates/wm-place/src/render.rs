//! Renders what a request describes: the picture itself, then the layers that are pictures of their
//! own.

use crate::camera_model::CameraModel;
use crate::drawing::Drawing;
use crate::frame_camera::FrameCamera;
use crate::layers::{LaterFrame, LayerPasses, LayerSpan, Layers, Source};
use crate::picture::WaterLayers;
use crate::place::{PreparedPlace, check_owner};
use crate::shot::{PinholeContent, PinholeShot};
use crate::tags::picture_tags;
use crate::{Error, FrameRequest, LensView, NextFrame, Picture, PictureLayer, Progress, Renderer, Result};
use wm_render::parts::PictureParts;
use wm_render::{Frame, Stats, at_once};
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

    /// Renders a frame into `picture`, whose memory is used again and whose tags stay. Returns the
    /// counts and times of the passes that draw its colours.
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
        let leads_to_next = |layer: PictureLayer| layer.row().span == LayerSpan::ToNext;
        if request.next.is_none() && request.layers.iter().any(leads_to_next) {
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
        let mut drawing = Drawing { renderer: self, place, progress };
        let mut stats = Stats::default();
        if passes.picture {
            stats += drawing.of_camera(camera, index, &shot, picture).await?;
        } else {
            let size = camera.lens().map_or(&shot.camera.camera, LensView::intrinsics);
            picture.frame = Frame { width: size.width, height: size.height, ..Frame::default() };
            (picture.parts, picture.water) = (PictureParts::default(), WaterLayers::default());
            picture.stages = PaperStages::default();
        }
        picture.metres_per_unit = drawing.place.site().metres_per_unit;
        picture.clear_later();
        let next = request.next.map(|NextFrame { time, camera }| PinholeShot { time, camera, ..shot });
        let frame = LaterFrame { shot, camera, index, next, previous: request.previous };
        for layer in passes.later.iter() {
            if let Source::Later(draw) = layer.row().source {
                stats += draw(&mut drawing, &frame, picture).await?;
            }
        }
        // The depth may have been drawn for another layer alone.
        if !passes.later.contains(Layers::SURFACE_DEPTH) {
            picture.later.remove(&PictureLayer::SurfaceDepth);
        }
        Ok(stats)
    }
}
