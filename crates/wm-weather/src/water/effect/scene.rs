//! The water of a picture, and the numbers that all of its pixels share.

use crate::water::body::WaterBody;
use crate::water::map::WaterMap;
use crate::water::mirror::{MirrorView, MirroredPicture};
use crate::water::motion::WaterMotion;
use crate::water::surface::{WaterSurface, ray_axes};
use fearless_simd::SimdFloat;
use wm_render::hooks::{GROUP, Medium, PixelEffect};
use wm_render::simd::Lanes;
use wm_scene::Camera;

/// Water as a picture pass: its picture is drawn with [`wm_render::DrawPass::surface`], its only
/// input is the mirrored one.
pub struct WaterEffect<'a> {
    /// The water of the place.
    pub map: &'a WaterMap,
    /// The water that the picture shows.
    pub surface: &'a WaterSurface,
    /// The mirrored eye.
    pub mirror: &'a MirrorView,
    /// Waves of the water.
    pub motion: &'a WaterMotion,
    /// Clarity of the water and its own light.
    pub body: WaterBody,
    /// The brightest light that it mirrors, linear
    /// ([`PreparedWeather::brightest`](crate::PreparedWeather::brightest)).
    pub white: f32,
    /// The camera of the picture.
    pub camera: &'a Camera,
    /// The air before it.
    pub medium: Option<&'a dyn Medium>,
    /// The effects on finished pixels, in order.
    pub effects: &'a [&'a dyn PixelEffect],
}

/// Water in sixteen pixels, one array per number.
pub(super) struct Water {
    /// Share of light that is reflected.
    pub(super) reflected: [f32; GROUP],
    /// Mirrored light, linear.
    pub(super) mirrored: [[f32; GROUP]; 3],
    /// Share of the light behind that comes through.
    pub(super) left: [f32; GROUP],
    /// Foam, where there may be some.
    pub(super) foam: Option<FoamPixels>,
}

/// Foam in sixteen pixels, and the numbers that it follows from.
pub(super) struct FoamPixels {
    /// Depth of a flood, m; infinite for other water.
    pub(super) depth: [f32; GROUP],
    /// Square of the slope, both axes together, and its variance along one axis that the pixel is
    /// too wide to show.
    pub(super) slopes: [[f32; GROUP]; 2],
    /// Share that foam covers.
    pub(super) share: [f32; GROUP],
}

impl FoamPixels {
    pub(super) const NONE: Self =
        Self { depth: [f32::INFINITY; GROUP], slopes: [[0.0; GROUP]; 2], share: [0.0; GROUP] };
}

impl Water {
    pub(super) fn new(may_foam: bool) -> Self {
        let foam = if may_foam { Some(FoamPixels::NONE) } else { None };
        Self { reflected: [0.0; GROUP], mirrored: [[0.0; GROUP]; 3], left: [1.0; GROUP], foam }
    }
}

/// Sixteen pixels of a row that are looked into.
pub(super) struct Pixels {
    /// Middles of their columns, and of their row, px.
    pub(super) x: [f32; GROUP],
    pub(super) y: f32,
    /// View z of the water, NaN where there is none.
    pub(super) z: [f32; GROUP],
    /// Slopes that do not move.
    pub(super) still: [f32; GROUP],
    /// Reciprocal of the distance to what they mirror, 1/m; NaN where that is not known.
    pub(super) reach: [f32; GROUP],
}

/// Numbers that all pixels share: metres along level axes from the eye, heights from the mirror's
/// plane.
pub(super) struct Scene<'a> {
    pub(super) of: &'a WaterEffect<'a>,
    pub(super) mirrored: &'a MirroredPicture,
    /// A ray through picture point (x, y), at view z 1: `axes[0] x + axes[1] y + axes[2]`, m along
    /// level axes.
    pub(super) axes: [[f32; 3]; 3],
    /// Place of the eye along the two level axes, m.
    pub(super) eye: [f64; 2],
    /// Height of the eye over the mirror's plane, m.
    pub(super) height: f32,
    /// Rows of the mirrored view's rotation, level axes.
    pub(super) view: [[f32; 3]; 3],
    pub(super) focal: [f32; 2],
    pub(super) principal: [f32; 2],
    pub(super) metres: f32,
    /// Level axes in world axes.
    pub(super) level: [[f32; 3]; 3],
    /// Angle of a pixel, logarithm to base 2.
    pub(super) pixel: f32,
    /// The eye's place on the tiles of the waves.
    pub(super) phases: Vec<[f32; 2]>,
}

impl<'a> Scene<'a> {
    pub(super) fn new(of: &'a WaterEffect<'a>, mirrored: &'a MirroredPicture) -> Self {
        let map = of.map;
        let to_level = |v: glam::DVec3| map.axes.map(|axis| glam::DVec3::from_array(axis).dot(v));
        let camera = of.camera;
        let metres = map.metres_per_unit;
        let single = |v: [f64; 3]| v.map(|v| v as f32);
        let eye = to_level(camera.center()).map(|v| v * metres);
        let view = of.mirror.camera;
        let rotation = view.rotation();
        Self {
            of,
            mirrored,
            axes: ray_axes(map, camera).map(single),
            height: (eye[2] - of.surface.level) as f32,
            view: [0, 1, 2].map(|k| single(to_level(rotation.row(k)))),
            focal: [view.fx as f32, view.fy as f32],
            principal: [view.cx as f32, view.cy as f32],
            metres: metres as f32,
            level: map.axes.map(single),
            pixel: camera.widest_pixel().log2() as f32,
            eye: [eye[0], eye[1]],
            phases: of.motion.phases([eye[0], eye[1]]),
        }
    }

    /// Directions through picture points of a row, metres along level axes, of length 1; and the
    /// lengths that they have at view z 1, m.
    #[inline(always)]
    pub(super) fn toward<S: Lanes>(&self, simd: S, x: S::F, y: f32) -> ([S::F; 3], S::F) {
        let mut toward = [simd.set(0.0); 3];
        for k in 0..3 {
            toward[k] = x.mul_add(simd.set(self.axes[0][k]), simd.set(self.axes[1][k] * y + self.axes[2][k]));
        }
        let long = dot::<S>(&toward, &toward).sqrt();
        for toward in &mut toward {
            *toward /= long;
        }
        (toward, long)
    }
}

#[inline(always)]
pub(super) fn dot<S: Lanes>(a: &[S::F; 3], b: &[S::F; 3]) -> S::F {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}
