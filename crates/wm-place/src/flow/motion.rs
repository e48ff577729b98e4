//! Motion vectors of games: from each pixel to where the frame before showed the same point.
//!
//! The convention is that of temporal upscalers (DLSS, FSR, XeSS) and of antialiasing over time:
//! current to previous, px of this picture, to the right and down, without jitter. So the colour of
//! pixel `p` is looked up at `p + vector` in the frame before. Over the width and the height they
//! are in UV; `(2 u / width, -2 v / height)` in normalised device coordinates with y up.

use super::FlowView;
use crate::drawing::Drawing;
use crate::layers::{LaterFrame, LayerSpan, Row, Source};
use crate::{Picture, PictureLayer, Result};
use rayon::prelude::*;
use wm_render::Stats;

pub(crate) const ROW: Row = Row {
    note: "motion vectors of games: to the frame 1/fps before, px right and down, 0 in the first: one render without colour",
    source: Source::Later(|drawing, frame, picture| Box::pin(drawing.motion(frame, picture))),
    span: LayerSpan::ToPrevious,
    values: |picture| picture.later(PictureLayer::Motion).into(),
    ..super::ROW
};

/// The vectors from a view to that of the frame before; 0 for points that the view before could not
/// show.
fn motion_vectors(from: &FlowView<'_>, to: &FlowView<'_>) -> Vec<f32> {
    let to_from_from = to.camera.viewmat * from.camera.viewmat.inverse();
    let vector = |pixel: usize| {
        super::move_pixel(from, to, &to_from_from, pixel)
            .map_or([0.0; 2], |moved| moved.vector.map(|v| v as f32))
    };
    (0..from.depth.len()).into_par_iter().map(vector).collect::<Vec<_>>().into_flattened()
}

impl Drawing<'_> {
    /// Finds the motion vectors by the depth of surfaces, as optical flow: what falls has none.
    async fn motion(&mut self, frame: &LaterFrame<'_>, picture: &mut Picture) -> Result<Stats> {
        let vectors = match &frame.previous {
            None => vec![0.0; 2 * picture.frame.pixels()],
            Some(previous) => {
                let lens = frame.camera.lens();
                let depth = self.own_surface_depth(frame, picture).await?;
                let from = FlowView::new(lens, &frame.shot.camera.camera, depth);
                let to = FlowView::new(lens, previous, &[]);
                self.renderer.backend().pool().install(|| motion_vectors(&from, &to))
            }
        };
        picture.later.insert(PictureLayer::Motion, vectors);
        Ok(Stats::default())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{SIZE, camera, middle_of, wall};
    use super::*;
    use crate::testing::renderer;
    use crate::{Camera, FrameRequest, Layers};
    use glam::DVec3;
    use wm_scene::{Scene, Splats};
    use wm_weather::Weather;

    /// The place of the wall `x = WALL_X`.
    const WALL_X: f64 = 4.0;

    /// The way from a pixel to where `previous` shows the point of the wall that the ray of the
    /// pixel meets, or the sky behind its edge: by rays and points in world axes alone.
    fn expected(camera: &Camera, previous: &Camera, pixel: usize, is_wall: bool) -> [f64; 2] {
        let at = middle_of(pixel);
        let Camera { fx, fy, cx, cy, .. } = *camera;
        let ray = camera.rotation().transpose() * DVec3::new((at[0] - cx) / fx, (at[1] - cy) / fy, 1.0);
        let seen = match is_wall {
            true => camera.center() + ray * ((WALL_X - camera.center().x) / ray.x),
            // A direction: as from the eye of the frame before.
            false => previous.center() + ray,
        };
        let (x, y, _) = previous.project(seen).unwrap();
        [x - at[0], y - at[1]]
    }

    #[test]
    fn a_rendered_wall_and_the_sky_have_the_vectors_of_their_points() {
        let mut splats = Splats::with_capacity(0, 0);
        wall(WALL_X as f32, 0.0, -4.0, &mut splats);
        let mut renderer = renderer();
        let mut place = renderer.load(Scene { splats, ..Scene::default() }).unwrap();
        let (weather, now) = (Weather::clear(), camera([0.3, 0.1, 0.05], [10.0, -0.4, 0.3]));
        let mut render = |previous: Option<Camera>| {
            let request =
                FrameRequest { layers: Layers::MOTION, previous, ..FrameRequest::new(&weather, now, 0.0) };
            renderer.render(&mut place, &request).unwrap().layer(PictureLayer::Motion).into_owned()
        };
        assert_eq!(render(None), vec![0.0; 2 * (SIZE.0 * SIZE.1) as usize], "the first frame");
        let before = |share: f64| {
            camera([0.3 - 0.3 * share, 0.1 - 0.1 * share, 0.05], [10.0, -0.4 + 0.5 * share, 0.3])
        };
        let edge = now.project(DVec3::new(WALL_X, 0.0, 0.0)).unwrap().0;
        // A tenth of the way too much is told apart.
        for (share, is_right) in [(1.0, true), (1.1, false)] {
            let vectors = render(Some(before(share)));
            let mut worst = [0.0f64; 2];
            for (pixel, vector) in vectors.as_chunks::<2>().0.iter().enumerate() {
                let right = middle_of(pixel)[0] - edge;
                // Splats reach a little beyond the edge.
                if right.abs() < 4.0 {
                    continue;
                }
                let want = expected(&now, &before(1.0), pixel, right > 0.0);
                let error = (0..2).map(|k| (f64::from(vector[k]) - want[k]).abs()).fold(0.0, f64::max);
                let worst = &mut worst[usize::from(right < 0.0)];
                *worst = worst.max(error);
            }
            let [of_wall, of_sky] = worst;
            assert_eq!(of_wall < 0.01 && of_sky < 0.01, is_right, "{worst:?} px");
            assert_eq!(of_wall > 0.1 && of_sky > 0.1, !is_right, "{worst:?} px");
        }
    }
}
