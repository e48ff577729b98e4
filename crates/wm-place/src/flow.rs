//! Optical flow of the scene: where what a pixel shows is in the next picture.
//!
//! Each pixel's surface is found by its depth, moved to the camera of the next picture and
//! projected by that camera's own lens. The depth of the next picture says whether it is still seen
//! there. Both depths are drawn for it, without air, particles or drops on the lens, so the flow of
//! a frame needs no other frame. A surface's depth is the expected depth where that is near the
//! median depth, and the median depth elsewhere: on surfaces of many splats the first has no steps,
//! at edges the second is no mixture.

pub(crate) mod motion;
pub(crate) mod particles;

use crate::drawing::Drawing;
use crate::layers::{LaterFrame, LayerForm, LayerSpan, Layers, Row, Source};
pub use crate::picture::SceneFlow;
use crate::shot::{MovingCamera, PinholeContent, PinholeShot};
use crate::{LensView, Picture, PictureLayer, Result};
use glam::{DMat4, DVec3};
use rayon::prelude::*;
use std::collections::btree_map::Entry;
use wm_render::{Frame, Stats};
use wm_scene::{Camera, LensModel};

pub(crate) const ROW: Row = Row {
    note: "optical flow of the scene to the frame 1/fps later, px: two renders without colour; .png is KITTI's",
    channels: &["U", "V"],
    source: Source::Later(|drawing, frame, picture| Box::pin(drawing.flow(frame, picture))),
    span: LayerSpan::ToNext,
    form: LayerForm::Flow,
    values: |picture| (&picture.flow.vectors).into(),
};

pub(crate) const MASK_ROW: Row = Row {
    note: "0 visible, 1 occluded, 2 outside, 3 unknown",
    channels: &["STATE"],
    source: Source::With(Layers::FLOW),
    form: LayerForm::States,
    values: |picture| picture.flow.states.iter().map(|state| f32::from(*state)).collect(),
    ..ROW
};

pub(crate) const DEPTH_ROW: Row = Row {
    note: "metres, of surfaces without what falls: one more",
    channels: &["Z"],
    source: Source::Later(|drawing, frame, picture| {
        Box::pin(async { drawing.own_surface_depth(frame, picture).await.map(|_| Stats::default()) })
    }),
    span: LayerSpan::Exposure,
    form: LayerForm::Depth,
    values: |picture| picture.metres(picture.later(PictureLayer::SurfaceDepth)),
};

/// Relative tolerance between expected and median depth on one surface. At edges the expected depth
/// mixes near and far and differs by more.
const SAME_SURFACE_TOLERANCE: f32 = 0.02;
/// Depths of four pixels are interpolated if they differ by less than this share.
const INTERPOLATION_TOLERANCE: f32 = 0.1;
/// A point is hidden if it lies behind the surface of the next picture by more than this share.
const OCCLUSION_TOLERANCE: f64 = 0.02;

/// The fate of what a pixel shows in the next picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlowState {
    /// It is seen there.
    Visible = 0,
    /// Something hides it: it lies more than 2 % behind the surface that is seen there.
    Occluded = 1,
    /// It is out of the picture; the vector says where.
    Outside = 2,
    /// It has no vector: the lens shows nothing here, or the next camera has it behind itself or
    /// beyond its lens.
    Unknown = 3,
}

/// One of the two pictures: its camera, its lens and the depth of its surfaces.
#[derive(Clone, Copy, Debug)]
struct FlowView<'a> {
    /// The pose, and the intrinsics that the lens uses.
    camera: Camera,
    /// The lens; `None` for a pinhole.
    lens: Option<LensModel>,
    /// The depth of the surface at each pixel, scene units, `[H, W]`: along the view axis for a
    /// pinhole, from the eye for a lens. 0 is no surface, infinitely far.
    depth: &'a [f32],
}

impl<'a> FlowView<'a> {
    /// The view of a pinhole, or of a lens at the pose of the pinhole.
    fn new(lens: Option<&LensView>, camera: &Camera, depth: &'a [f32]) -> Self {
        let camera = match lens {
            None => *camera,
            Some(lens) => Camera { viewmat: camera.viewmat, near: camera.near, ..*lens.intrinsics() },
        };
        Self { camera, lens: lens.map(LensView::lens), depth }
    }

    /// The direction of a pixel in camera axes, by which its depth counts; `None` where the lens
    /// shows nothing.
    fn ray(&self, at: [f64; 2]) -> Option<DVec3> {
        let Camera { fx, fy, cx, cy, .. } = self.camera;
        match self.lens {
            None => Some(DVec3::new((at[0] - cx) / fx, (at[1] - cy) / fy, 1.0)),
            Some(lens) => lens.ray(&self.camera, at),
        }
    }

    /// The picture point of a point or a direction in camera axes.
    fn project(&self, point: DVec3) -> Option<[f64; 2]> {
        let Camera { fx, fy, cx, cy, .. } = self.camera;
        match self.lens {
            None if point.z <= 1e-9 * point.length() => None,
            None => Some([fx * point.x / point.z + cx, fy * point.y / point.z + cy]),
            Some(lens) => lens.project(&self.camera, point.normalize()),
        }
    }

    /// The depth of a point in camera axes.
    fn depth_of(&self, point: DVec3) -> f64 {
        if self.lens.is_some() { point.length() } else { point.z }
    }

    /// The farther of the nearest pixel's depth and that between the four pixels about a point: at
    /// edges the nearest counts, since what is between is far nearer than what is behind, and on
    /// ground that is seen at a low angle depth changes much from pixel to pixel.
    fn farthest_at(&self, at: [f64; 2]) -> f64 {
        let around = DepthsAround::new(self.depth, (self.camera.width, self.camera.height), at);
        let reciprocal = around.reciprocal().min(reciprocal_of(around.nearest));
        f64::from(reciprocal).recip()
    }
}

/// The depths about a point of a picture.
struct DepthsAround {
    /// The depth of the pixel that holds the point.
    nearest: f32,
    /// The depths of the four pixels whose centres surround the point: above left, above right,
    /// below left, below right.
    four: [f32; 4],
    /// The position between these centres, to the right and down, 0-1.
    between: [f32; 2],
}

/// The reciprocal of a depth; 0 for none, which is infinitely far.
fn reciprocal_of(depth: f32) -> f32 {
    if depth > 0.0 { depth.recip() } else { 0.0 }
}

impl DepthsAround {
    fn new(depth: &[f32], size: (u32, u32), point: [f64; 2]) -> Self {
        let (width, height) = (size.0 as usize, size.1 as usize);
        let [x, y] = point;
        let pixel = |x: f64, y: f64| {
            let (x, y) = (x.floor().max(0.0) as usize, y.floor().max(0.0) as usize);
            depth[y.min(height - 1) * width + x.min(width - 1)]
        };
        let (left, top) = ((x - 0.5).floor(), (y - 0.5).floor());
        Self {
            nearest: pixel(x, y),
            four: [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(i, j)| pixel(left + i, top + j)),
            between: [(x - 0.5 - left) as f32, (y - 0.5 - top) as f32],
        }
    }

    /// The reciprocal depth between the four, which is linear over a plane.
    fn reciprocal(&self) -> f32 {
        let [right, down] = self.between;
        let [a, b, c, d] = self.four.map(reciprocal_of);
        let (above, below) = (a + right * (b - a), c + right * (d - c));
        above + down * (below - above)
    }

    /// The depth at the point: interpolated on one surface, that of the nearest pixel at an edge.
    fn depth(&self) -> f32 {
        let (least, most) = self
            .four
            .iter()
            .fold((f32::MAX, 0.0f32), |(low, high), depth| (low.min(*depth), high.max(*depth)));
        let is_even = least > 0.0 && most <= (1.0 + INTERPOLATION_TOLERANCE) * least;
        if is_even { self.reciprocal().recip() } else { self.nearest }
    }
}

/// The depth of the surface at each pixel of a frame with expected and median depth; 0 where there
/// is none.
fn depth_of_surfaces(frame: &Frame) -> Vec<f32> {
    let depth = |expected: f32, median: f32| {
        if (expected - median).abs() < SAME_SURFACE_TOLERANCE * median { expected } else { median }
    };
    frame.depth.iter().zip(&frame.median_depth).map(|(expected, median)| depth(*expected, *median)).collect()
}

/// The point that a pixel shows, in another view.
struct MovedPixel {
    /// The way from the middle of the pixel, px to the right and down.
    vector: [f64; 2],
    /// The place in the other picture, px.
    found: [f64; 2],
    /// The depth there; infinite in the sky.
    depth: f64,
}

/// Finds the point that a pixel shows in another view; `None` if the lens shows nothing at the
/// pixel, or the other camera has the point behind itself or beyond its lens.
fn move_pixel(
    from: &FlowView<'_>,
    to: &FlowView<'_>,
    to_from_from: &DMat4,
    pixel: usize,
) -> Option<MovedPixel> {
    let width = from.camera.width as usize;
    let at = [(pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5];
    let (ray, depth) = (from.ray(at)?, f64::from(from.depth[pixel]));
    // What is infinitely far turns with the camera alone.
    let (point, depth) = if depth > 0.0 {
        let point = to_from_from.transform_point3(ray * depth);
        (point, to.depth_of(point))
    } else {
        (to_from_from.transform_vector3(ray), f64::INFINITY)
    };
    let found = to.project(point)?;
    let mut vector = [0, 1].map(|k| found[k] - at[k]);
    if to.lens == Some(LensModel::Equirectangular) {
        // The shorter way around.
        let width = f64::from(to.camera.width);
        vector[0] = found[0] - (vector[0] / width).round() * width - at[0];
    }
    Some(MovedPixel { vector, found, depth })
}

/// The flow from one view to the next.
///
/// # Panics
/// If a depth has another size than its camera.
fn scene_flow(from: &FlowView<'_>, to: &FlowView<'_>) -> SceneFlow {
    let (width, height) = (from.camera.width as usize, from.camera.height as usize);
    assert_eq!(from.depth.len(), width * height, "a depth per pixel");
    let to_from_from = to.camera.viewmat * from.camera.viewmat.inverse();
    let size = [to.camera.width, to.camera.height].map(f64::from);
    let moved = |pixel: usize| {
        let Some(MovedPixel { vector, found, depth }) = move_pixel(from, to, &to_from_from, pixel) else {
            return ([f32::NAN; 2], FlowState::Unknown as u8);
        };
        let is_inside = (0..2).all(|k| (0.0..=size[k]).contains(&found[k]));
        let state = match () {
            () if !is_inside => FlowState::Outside,
            () if depth > (1.0 + OCCLUSION_TOLERANCE) * to.farthest_at(found) => FlowState::Occluded,
            () => FlowState::Visible,
        };
        (vector.map(|v| v as f32), state as u8)
    };
    let (vectors, states) = (0..width * height).into_par_iter().map(moved).unzip::<_, _, Vec<_>, _>();
    SceneFlow { vectors: vectors.into_flattened(), states }
}

impl Drawing<'_> {
    /// Finds the flow of the scene to the next frame by the depth of their surfaces: what lies on
    /// the scene at each instant counts, and the surface of water.
    async fn flow(&mut self, frame: &LaterFrame<'_>, picture: &mut Picture) -> Result<Stats> {
        let Some(next) = &frame.next else { return Ok(Stats::default()) };
        let lens = frame.camera.lens();
        let depth = self.own_surface_depth(frame, picture).await?;
        let next_depth = self.surface_depth(lens, next).await?;
        let from = FlowView::new(lens, &frame.shot.camera.camera, depth);
        let to = FlowView::new(lens, &next.camera.camera, &next_depth);
        picture.flow = self.renderer.backend().pool().install(|| scene_flow(&from, &to));
        Ok(Stats::default())
    }

    /// Returns the depth of the surfaces in the frame itself, which several layers share.
    async fn own_surface_depth<'p>(
        &mut self,
        frame: &LaterFrame<'_>,
        picture: &'p mut Picture,
    ) -> Result<&'p [f32]> {
        if let Entry::Vacant(entry) = picture.later.entry(PictureLayer::SurfaceDepth) {
            entry.insert(self.surface_depth(frame.camera.lens(), &frame.shot).await?);
        }
        Ok(picture.later(PictureLayer::SurfaceDepth))
    }

    /// Draws the depth of the surfaces in a frame without the scene's own sky, see
    /// [`FlowView::depth`].
    async fn surface_depth(&mut self, lens: Option<&LensView>, shot: &PinholeShot<'_>) -> Result<Vec<f32>> {
        // The sky of a reconstruction hangs some hundred metres away and shines through walls: it
        // is infinitely far.
        let weather = &shot.weather.clone().set("sky.scene_sky", "replace")?;
        let shot = PinholeShot { weather, parts: &[], content: PinholeContent::Geometry, ..*shot };
        let mut picture = Picture::default();
        let Some(lens) = lens else {
            self.pinhole(&shot, &mut picture).await?;
            return Ok(depth_of_surfaces(&picture.frame));
        };
        let mut sides = Vec::new();
        for camera in lens.cameras(&shot.camera.camera) {
            let own = PinholeShot { camera: MovingCamera { camera, ..shot.camera }, ..shot };
            self.pinhole(&own, &mut picture).await?;
            sides.push(depth_of_surfaces(&picture.frame));
        }
        let pixels = lens.intrinsics().width as usize * lens.intrinsics().height as usize;
        let distance = |pixel: usize| {
            let Some(point) = lens.side_of(pixel) else { return 0.0 };
            point.long * DepthsAround::new(&sides[point.side], point.size, point.at).depth()
        };
        Ok(self.renderer.backend().pool().install(|| (0..pixels).into_par_iter().map(distance).collect()))
    }
}

#[cfg(test)]
mod tests;
