//! The hooks by which weather acts on a pass.
//!
//! | acts on | when | hook |
//! |---|---|---|
//! | splats and background: extinction, airlight | when each is shaded | [`Medium`] |
//! | what stands behind all splats | after blending | [`Backdrop`] |
//! | pixels: drops, flakes, against depth | after the background | [`Particles`] |
//! | pixels | last | [`PixelEffect`] |
//!
//! [`SplatAttributes`] act on single splats (wet, relit, under snow) before projection and when
//! they are shaded; they come with a splat set.
//!
//! A hook is a pure function of its own parameters: it has the weather of one instant in it, and is
//! called from many threads in any order.

pub use crate::attributes::{Attribute, AttributeBlock, Revision, SplatAttributes};
use crate::dispatch;
use crate::simd::{self, Lanes, SimdPath};
pub use crate::sizes::{GROUP, PATCH, PATCH_PIXELS};
use fearless_simd::{SimdBase, SimdFloat};
use std::borrow::Cow;
use wm_base::color::{srgb_decode, srgb_encode};
use wm_scene::Camera;

/// The weather of one draw pass.
#[derive(Clone, Default)]
pub struct Hooks<'a> {
    /// The background behind all splats, instead of that of the render's configuration.
    pub background: Option<&'a dyn Backdrop>,
    /// The air: applied to each splat when it is shaded, and to the background.
    pub medium: Option<&'a dyn Medium>,
    /// The particles, in any order.
    pub particles: Vec<&'a dyn Particles>,
    /// Applied to finished pixels, in order.
    pub pixels: Vec<&'a dyn PixelEffect>,
}

impl Hooks<'_> {
    /// The treatment of the splats of a scene's own sky.
    pub(crate) fn sky_splats(&self) -> SkySplats {
        self.background.map_or(SkySplats::Kept, Backdrop::sky_splats)
    }
}

/// Sixteen splats (or points of the background) that are seen through the air, as a structure of
/// arrays, so that a hook works on whole vectors. Lanes without a splat hold finite numbers.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct ShadeGroup {
    /// Length of the ray from the camera, scene units; infinite for the sky.
    pub distance: [f32; GROUP],
    /// Unit direction of the ray, world axes: an array for each axis.
    pub direction: [[f32; GROUP]; 3],
    /// Display-referred colour (sRGB-encoded), not below 0, changed in place.
    pub rgb: [[f32; GROUP]; 3],
}

impl Default for ShadeGroup {
    fn default() -> Self {
        Self { distance: [1.0; GROUP], direction: [[0.0; GROUP]; 3], rgb: [[0.0; GROUP]; 3] }
    }
}

/// A background behind all splats, at infinity.
pub trait Backdrop: Sync {
    /// Writes the colour in the directions of `groups`, display-referred, not below 0.
    ///
    /// `pixel` is the largest angle that a pixel takes, radians: finer detail must be averaged.
    fn paint(&self, pixel: f64, groups: &mut [ShadeGroup]);

    /// Returns the colour in one unit direction (world axes), in f64: the reference of
    /// [`Self::paint`].
    fn reference(&self, pixel: f64, direction: [f64; 3]) -> [f64; 3];

    /// Returns the colour if it is the same in all directions.
    fn uniform(&self) -> Option<[f32; 3]> {
        None
    }

    /// Returns the fineness of the detail.
    fn detail(&self) -> Detail {
        Detail::Smooth
    }

    /// The treatment of the splats of [`wm_scene::Group::Sky`].
    fn sky_splats(&self) -> SkySplats {
        SkySplats::Kept
    }
}

/// The fineness of a backdrop's detail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// Detail of half a degree and more.
    Smooth,
    /// Detail down to the size of a pixel.
    Fine,
}

/// The treatment of the splats of a scene's own sky.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SkySplats {
    /// It is drawn, in front of the backdrop.
    #[default]
    Kept,
    /// It is left out, and the backdrop is seen.
    LeftOut,
}

/// The air along sixteen rays, one array per channel. Light `L` at the far end arrives as
/// `L transmittance + airlight`, in linear light.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct AirGroup {
    /// The share of light that the air lets through, 0-1.
    pub transmittance: [[f32; GROUP]; 3],
    /// The light that the air adds, linear RGB, 0 or more.
    pub airlight: [[f32; GROUP]; 3],
}

impl Default for AirGroup {
    fn default() -> Self {
        Self { transmittance: [[1.0; GROUP]; 3], airlight: [[0.0; GROUP]; 3] }
    }
}

/// The air along one ray in f64; see [`AirGroup`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AirOnRay {
    /// The share of light that the air lets through, 0-1.
    pub transmittance: [f64; 3],
    /// The light that the air adds, linear RGB, 0 or more.
    pub airlight: [f64; 3],
}

impl AirOnRay {
    /// Air that does nothing.
    pub const CLEAR: Self = Self { transmittance: [1.0; 3], airlight: [0.0; 3] };
}

/// The air between the camera and the scene.
///
/// It tells the transmittance and the airlight along a ray, from which colours seen through the air
/// follow. `origin` is where rays begin, in world axes, scene units.
pub trait Medium: Sync {
    /// Writes the transmittance and the airlight along the rays of `rays`, whose colours are not
    /// read.
    fn evaluate(&self, path: SimdPath, origin: [f32; 3], rays: &[ShadeGroup], out: &mut [AirGroup]);

    /// Writes the transmittance along the rays of `rays`.
    fn transmittance(
        &self,
        path: SimdPath,
        origin: [f32; 3],
        rays: &[ShadeGroup],
        out: &mut [[[f32; GROUP]; 3]],
    ) {
        evaluate_each(self, path, origin, rays, out, |air| air.transmittance);
    }

    /// Writes the airlight along the rays of `rays`, linear RGB.
    fn airlight(&self, path: SimdPath, origin: [f32; 3], rays: &[ShadeGroup], out: &mut [[[f32; GROUP]; 3]]) {
        evaluate_each(self, path, origin, rays, out, |air| air.airlight);
    }

    /// Changes the colours of `groups` to those seen through the air:
    /// `encode(decode(rgb) transmittance + airlight)`. An air that evaluates both in registers may
    /// do so in one go.
    fn shade(&self, path: SimdPath, origin: [f32; 3], groups: &mut [ShadeGroup]) {
        let mut air = [AirGroup::default(); GROUP];
        for groups in groups.chunks_mut(air.len()) {
            let air = &mut air[..groups.len()];
            self.evaluate(path, origin, groups, air);
            dispatch!(path, s => seen_through(s, air, groups));
        }
    }

    /// The colour of everything at infinity, if it is one in all directions.
    fn far_color(&self) -> Option<[f32; 3]> {
        None
    }

    /// The transmittance and the airlight along one ray in f64: the reference.
    fn evaluate_reference(&self, origin: [f64; 3], direction: [f64; 3], distance: f64) -> AirOnRay;

    /// A display-referred colour as seen through the air, in f64.
    fn reference(&self, origin: [f64; 3], direction: [f64; 3], distance: f64, rgb: [f64; 3]) -> [f64; 3] {
        let AirOnRay { transmittance, airlight } = self.evaluate_reference(origin, direction, distance);
        std::array::from_fn(|k| match (transmittance[k], airlight[k]) {
            // Exactly, whatever the encoding rounds.
            (1.0, 0.0) => rgb[k],
            (kept, added) => srgb_encode(srgb_decode(rgb[k]) * kept + added),
        })
    }

    /// The air as WGSL, seen from `origin`; `None` where it has no such form, and the GPU back end
    /// refuses.
    fn wgsl(&self, origin: [f32; 3]) -> Option<WgslSource> {
        let _ = origin;
        None
    }

    /// The name in messages.
    fn name(&self) -> &'static str {
        "this air"
    }
}

/// Evaluates the air a few groups at a time, and keeps one of the two results.
fn evaluate_each<M: Medium + ?Sized>(
    medium: &M,
    path: SimdPath,
    origin: [f32; 3],
    rays: &[ShadeGroup],
    out: &mut [[[f32; GROUP]; 3]],
    answer: impl Fn(&AirGroup) -> [[f32; GROUP]; 3],
) {
    let mut air = [AirGroup::default(); GROUP];
    for (rays, out) in rays.chunks(air.len()).zip(out.chunks_mut(GROUP)) {
        medium.evaluate(path, origin, rays, &mut air[..rays.len()]);
        out.iter_mut().zip(&air).for_each(|(out, air)| *out = answer(air));
    }
}

/// Changes colours to those seen through the air.
#[inline(always)]
fn seen_through<S: Lanes>(simd: S, air: &[AirGroup], groups: &mut [ShadeGroup]) {
    for (group, air) in groups.iter_mut().zip(air) {
        for first in (0..GROUP).step_by(S::N) {
            let mut light = [simd.set(0.0); 3];
            for k in 0..3 {
                light[k] = simd.load(&group.rgb[k][first..]);
            }
            light = simd::srgb_decode(simd, light);
            for k in 0..3 {
                let kept = simd.load(&air.transmittance[k][first..]);
                light[k] = light[k].mul_add(kept, simd.load(&air.airlight[k][first..]));
            }
            let shown = simd::srgb_encode(simd, light);
            for k in 0..3 {
                shown[k].store_slice(&mut group.rgb[k][first..first + S::N]);
            }
        }
    }
}

/// A [`Medium`] as WGSL.
#[derive(Clone, Debug, PartialEq)]
pub struct WgslSource {
    /// The text, which defines `fn evaluate_air(direction: vec3<f32>, distance: f32) -> AirOnRay`:
    /// what [`Medium::evaluate`] says about one ray, where
    /// `struct AirOnRay { transmittance: vec3<f32>, airlight: vec3<f32> }` is declared before the
    /// text. A distance of `FAR_AWAY` is infinity. The text may use the parameters as
    /// `air: array<f32>`. Functions `transmittance(direction, distance)` and
    /// `airlight(direction, distance)` are made from it.
    pub wgsl: Cow<'static, str>,
    /// Numbers that change from frame to frame.
    pub parameters: Vec<f32>,
}

/// A falling drop, flake or stone: a 3D Gaussian, averaged over the exposure.
///
/// The covariance is `sigma^2 I + sum reach reach^T`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Particle {
    /// From the camera's centre, world axes, scene units.
    pub offset: [f32; 3],
    /// Standard deviation in all directions, scene units.
    pub sigma: f32,
    /// Further reach along two directions, standard deviations, world axes, scene units: the shape
    /// of the particle, and its motion during the exposure.
    pub reach: [[f32; 3]; 2],
    /// Area that it hides, scene units^2; motion spreads it and does not change it.
    pub area: f32,
    /// Radiance as seen through the air, linear RGB, 0 or more.
    pub rgb: [f32; 3],
}

/// Sixteen particles, one array a number; see [`Particle`]. Lanes without one have no area.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
pub struct ParticleGroup {
    /// From the camera's centre, world axes, scene units, one array per axis.
    pub offset: [[f32; GROUP]; 3],
    /// Standard deviation in all directions, scene units.
    pub sigma: [f32; GROUP],
    /// Further reach along two directions, scene units, one array per axis.
    pub reach: [[[f32; GROUP]; 3]; 2],
    /// Area that it hides, scene units^2.
    pub area: [f32; GROUP],
    /// Radiance as seen through the air, linear RGB, one array per channel.
    pub rgb: [[f32; GROUP]; 3],
}

impl ParticleGroup {
    /// Makes a group of the first sixteen particles of a list.
    #[must_use]
    pub fn of(particles: &[Particle]) -> Self {
        let mut group = Self::default();
        for (lane, particle) in particles.iter().take(GROUP).enumerate() {
            for k in 0..3 {
                group.offset[k][lane] = particle.offset[k];
                group.rgb[k][lane] = particle.rgb[k];
                for direction in 0..2 {
                    group.reach[direction][k][lane] = particle.reach[direction][k];
                }
            }
            group.sigma[lane] = particle.sigma;
            group.area[lane] = particle.area;
        }
        group
    }

    /// Returns the particles that have an area.
    pub fn particles(&self) -> impl Iterator<Item = Particle> {
        let lanes = (0..GROUP).filter(|lane| self.area[*lane] > 0.0);
        lanes.map(|lane| Particle {
            offset: self.offset.map(|axis| axis[lane]),
            sigma: self.sigma[lane],
            reach: self.reach.map(|direction| direction.map(|axis| axis[lane])),
            area: self.area[lane],
            rgb: self.rgb.map(|channel| channel[lane]),
        })
    }
}

/// A camera in the form that particles need: its view frustum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParticleView {
    /// The camera's centre, world axes, scene units.
    pub center: [f64; 3],
    /// Rows of the rotation from world to view.
    pub rotation: [[f32; 3]; 3],
    /// Focal lengths, px.
    pub(crate) focal: [f32; 2],
    /// Principal point, px.
    pub(crate) principal: [f32; 2],
    /// Picture size, px.
    pub(crate) size: [f32; 2],
    /// Normals of the planes of the picture's four sides, world axes, length 1, into the view.
    pub sides: [[f32; 3]; 4],
    /// Nearest view z, scene units.
    pub(crate) near: f32,
}

impl ParticleView {
    /// Makes the view of a camera.
    #[must_use]
    pub fn new(camera: &Camera) -> Self {
        let rotation = camera.rotation();
        let [x, y, z] = [0, 1, 2].map(|k| rotation.row(k));
        let (left, top) = (camera.cx / camera.fx, camera.cy / camera.fy);
        let right = (f64::from(camera.width) - camera.cx) / camera.fx;
        let bottom = (f64::from(camera.height) - camera.cy) / camera.fy;
        let sides = [x + z * left, z * right - x, y + z * top, z * bottom - y];
        Self {
            center: camera.center().to_array(),
            rotation: [x, y, z].map(|row| row.to_array().map(|v| v as f32)),
            focal: [camera.fx as f32, camera.fy as f32],
            principal: [camera.cx as f32, camera.cy as f32],
            size: [camera.width as f32, camera.height as f32],
            sides: sides.map(|side| side.normalize().to_array().map(|v| v as f32)),
            near: camera.near as f32,
        }
    }

    /// Returns the mean focal length, px: the pixels of a length of 1 at view z 1.
    #[must_use]
    pub fn pixels(&self) -> f32 {
        (self.focal[0] * self.focal[1]).sqrt()
    }

    /// Returns true if a ball about `offset` (from the centre, world axes, scene units) may be in
    /// the picture.
    #[inline]
    #[must_use]
    pub fn may_see(&self, offset: [f32; 3], radius: f32) -> bool {
        let along = |n: &[f32; 3]| n[0] * offset[0] + n[1] * offset[1] + n[2] * offset[2];
        along(&self.rotation[2]) > self.near - radius && self.sides.iter().all(|side| along(side) > -radius)
    }
}

/// Falling particles. Their order does not matter: their cover is added up in whole numbers.
pub trait Particles: Sync {
    /// Returns the pieces of work for a view, in any form that [`Self::gather`] understands.
    fn parts(&self, view: &ParticleView) -> Vec<[i32; 4]>;

    /// Estimates the cells of space that all pieces search, so that a frame which would take
    /// minutes is refused before.
    fn cells(&self, _view: &ParticleView) -> f64 {
        0.0
    }

    /// Passes the particles of one piece that may be in view to `take`. Over all pieces each
    /// particle comes once.
    fn gather(
        &self,
        path: SimdPath,
        view: &ParticleView,
        part: [i32; 4],
        take: &mut dyn FnMut(&ParticleGroup),
    );
}

/// The pixels of one patch, row by row, after blending and background.
pub struct PixelBatch<'a> {
    /// Picture column of the first pixel.
    pub x: u32,
    /// Picture row of the first pixel.
    pub y: u32,
    /// Display-referred colour, one array per channel, changed in place.
    pub rgb: &'a mut [[f32; PATCH_PIXELS]; 3],
    /// Coverage, 0-1.
    pub alpha: &'a [f32; PATCH_PIXELS],
    /// Sum of weight times view z over the splats, scene units, not divided by the coverage.
    pub depth_sum: &'a [f32; PATCH_PIXELS],
}

/// A change of each finished pixel by itself, by its colour and its depth. A change that reads
/// neighbours is a [`PictureEffect`](crate::PictureEffect).
pub trait PixelEffect: Sync {
    /// Changes the pixels of one patch.
    fn apply(&self, path: SimdPath, pixels: &mut PixelBatch<'_>);
}

impl<T: PixelEffect + ?Sized> PixelEffect for &T {
    fn apply(&self, path: SimdPath, pixels: &mut PixelBatch<'_>) {
        (**self).apply(path, pixels);
    }
}
