//! The light of lamps on a place, with the shadows that they cast.
//!
//! Around each lamp the fused surfaces of the place are drawn on the six faces of a cube: what is
//! behind the first of them is in its shadow. The ground under a lamp is a light of its own, since
//! it returns a fifth.
//!
//! Each splat gets the sum of the light of all lamps once; frames only add light that moves
//! (`moving.rs`). The light of lamps in the air is in `lamp_glow/`.

use super::capture::CaptureLight;
use super::lamps::{LampKind, LampLight, LampLights};
use super::quantile::median;
use crate::level::level_axes;
use crate::optics::Site;
use crate::threads::map;
use fearless_simd::{Select, SimdBase, SimdFloat};
use glam::{DMat3, DVec3, Vec3};
use serde::{Deserialize, Serialize};
use wm_render::hooks::GROUP;
use wm_render::simd::Lanes;
use wm_render::{
    CpuConfig, CpuRenderer, DrawPass, Frame, MedianDepth, Outputs, RenderBackend, RenderConfig, RenderError,
    SetView,
};
use wm_scene::splats::shortest_axis;
use wm_scene::{Camera, Group, Splats, quat};

/// Texels along the side of a face, of lamps, and of windows and lit ground.
const LAMP_FACE_TEXELS: u32 = 128;
const COARSE_FACE_TEXELS: u32 = 48;
/// Distance from a lamp within which nothing casts shadows, m: its head and its arm.
const LAMP_RADIUS_M: f64 = 0.45;
/// Distances from a lamp between which surfaces tell whether it stands inside of something, m:
/// nearer ones may be its lantern.
const ENCLOSURE_DISTANCES_M: [f64; 2] = [LAMP_RADIUS_M, 1.2];
/// Least number of surfaces that decide it, and the share of them that must have the lamp behind.
const MIN_ENCLOSING_SURFACES: usize = 20;
const MIN_ENCLOSED_SHARE: f64 = 0.8;
/// Tolerance of the depth test: a share of the distance, and m.
const SLACK_SHARE: f32 = 0.02;
const SLACK_M: f64 = 0.12;
/// Texels are of one surface if their distances differ by no more than this share.
const MAX_DISTANCE_STEP_SHARE: f32 = 0.4;
/// Height by which surfaces are lifted along their normals before they look for a lamp, m: in
/// multiples of the roughness of the ground, between these; and as a share of the distance. Rough
/// ground that is lit at a low angle hides itself.
const LIFT_LIMITS_M: [f32; 2] = [0.06, 0.8];
const ROUGHNESS_LIFT_FACTOR: f32 = 2.5;
const DISTANCE_LIFT_SHARE: f32 = 0.012;
/// Width of the columns in which the roughness of ground is found, m, and the fewest surfaces of
/// one.
const COLUMN_WIDTH_M: f64 = 0.5;
const MIN_COLUMN_SURFACES: usize = 4;
/// Least cosine between up and the normal of ground.
const MIN_GROUND_COSINE: f64 = 0.8;
/// Incidence on leaves, which turn to all sides.
const LEAF_INCIDENCE: f32 = 0.5;
/// Illuminance below which the light of a lamp is left out, lx.
const MIN_ILLUMINANCE_LX: f32 = 2e-3;

/// The lamps of a place, what they shine on and what is in their shadows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LampShadows {
    /// The lamps that it was made for.
    lamps: LampLights,
    /// The lights with their shadows; after the lamps comes the ground that they light.
    lights: Vec<(LampLight, DepthCube)>,
    /// Irradiance of each splat, linear RGB, lx.
    lit: Vec<[f32; 3]>,
    /// The lamps that stand inside of something, by their place in the list.
    enclosed: Vec<u32>,
    metres_per_unit: f32,
    /// See [`LIFT_LIMITS_M`].
    lift: f32,
}

impl LampShadows {
    /// Returns true if its parts fit each other and a scene of `splats` splats, as an asset that a
    /// stranger made may not.
    #[must_use]
    pub fn is_consistent(&self, splats: usize) -> bool {
        let is_cube = |cube: &DepthCube| {
            let texels = 6 * u64::from(cube.side).pow(2);
            (1..=1 << 14).contains(&cube.side)
                && cube.inverse.len() as u64 == texels
                && cube.behind.is_finite()
        };
        self.lit.len() == splats
            && self.lit.as_flattened().iter().all(|light| light.is_finite())
            && self.lights.iter().all(|(_, cube)| is_cube(cube))
            && self.enclosed.iter().all(|lamp| (*lamp as usize) < self.lamps.lights.len())
            && self.metres_per_unit.is_finite()
            && self.lift.is_finite()
    }

    /// Lights a scene: `points` are the places of its splats, `surfaces` the fused surfaces, whose
    /// splats cast the shadows. Equal for any number of threads.
    ///
    /// # Errors
    /// [`RenderError`] if the shadows cannot be drawn.
    pub fn of(
        lamps: &LampLights,
        surfaces: &Splats,
        capture: &CaptureLight,
        points: &[[f32; 3]],
        site: &Site,
    ) -> Result<Self, RenderError> {
        let threads = Some(rayon::current_num_threads());
        let mut renderer = CpuRenderer::new(CpuConfig { threads, ..CpuConfig::default() })?;
        let set = renderer.load(surfaces)?;
        let sets = [SetView::plain(set)];
        let mut frame = Frame::default();
        let near = LAMP_RADIUS_M / site.metres_per_unit;
        let up = DVec3::from_array(site.up);
        let (mut lights, mut grounds, mut enclosed) = (Vec::new(), Vec::new(), Vec::new());
        for (index, lamp) in lamps.lights.iter().enumerate() {
            if lamp.kind == LampKind::Ball && is_behind(Vec3::from_array(lamp.at), points, capture, site) {
                enclosed.push(index as u32);
            }
            let mut draw = |light: &LampLight, side: u32| {
                DepthCube::draw(&mut renderer, &sets, &mut frame, light, side, near)
            };
            let cube =
                draw(lamp, if lamp.kind == LampKind::Ball { LAMP_FACE_TEXELS } else { COARSE_FACE_TEXELS })?;
            // The first surface below, or the ground of the place.
            let height = up.dot(Vec3::from_array(lamp.at).as_dvec3()) - site.ground;
            let below = cube.first(-up.as_vec3()).map_or(height, f64::from);
            if let Some(ground) = lamp.ground_under(below * site.metres_per_unit, up, site.metres_per_unit) {
                let cube = draw(&ground, COARSE_FACE_TEXELS)?;
                grounds.push((ground, cube));
            }
            lights.push((*lamp, cube));
        }
        lights.append(&mut grounds);
        let mut lit = Self {
            lamps: lamps.clone(),
            lights,
            lit: Vec::new(),
            enclosed,
            metres_per_unit: site.metres_per_unit as f32,
            lift: (ROUGHNESS_LIFT_FACTOR * roughness(surfaces, site))
                .clamp(LIFT_LIMITS_M[0], LIFT_LIMITS_M[1]),
        };
        lit.lit = map(points.len(), |index| {
            if capture.is_sky(index) {
                return [0.0; 3];
            }
            lit.irradiance(Vec3::from_array(points[index]), capture.normal(index)).to_array()
        });
        Ok(lit)
    }

    /// The lamps that it was made for.
    #[must_use]
    pub fn lamps(&self) -> &LampLights {
        &self.lamps
    }

    /// The places of the lamps that stand inside of something, world axes, scene units: surfaces
    /// around them look away.
    pub fn enclosed(&self) -> impl Iterator<Item = [f32; 3]> {
        self.enclosed.iter().map(|index| self.lights[*index as usize].0.at)
    }

    /// Irradiance of a splat of the scene, linear RGB, lx.
    pub(crate) fn lit(&self, index: usize) -> [f32; 3] {
        self.lit[index]
    }

    /// Lamps and windows with their shadows, without the ground that they light.
    pub fn sources(&self) -> impl Iterator<Item = (&LampLight, &DepthCube)> {
        self.lights
            .iter()
            .filter(|(light, _)| light.kind != LampKind::Ground)
            .map(|(light, cube)| (light, cube))
    }

    /// Irradiance of a small surface at a point (world axes, scene units), linear RGB, lx. A normal
    /// of zero is that of leaves.
    pub(crate) fn irradiance(&self, point: Vec3, normal: Vec3) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for (light, cube) in &self.lights {
            let offset = point - Vec3::from_array(light.at);
            let metres = offset * self.metres_per_unit;
            let squared = metres.length_squared();
            let intensity = Vec3::from_array(light.intensity);
            let softened = squared + light.radius * light.radius;
            if intensity.max_element() < MIN_ILLUMINANCE_LX * softened {
                continue;
            }
            let direction = metres / squared.sqrt().max(1e-6);
            let incidence = if normal == Vec3::ZERO { LEAF_INCIDENCE } else { -direction.dot(normal) };
            let share = light.share(direction) * incidence / softened;
            if incidence > 0.0 && share * intensity.max_element() > MIN_ILLUMINANCE_LX {
                let lift = (DISTANCE_LIFT_SHARE * squared.sqrt()).max(self.lift) / self.metres_per_unit;
                sum += intensity * (share * cube.open(offset + normal * lift));
            }
        }
        sum
    }
}

/// The roughness of level ground, m: the median over columns of the standard deviation of the
/// heights of its surfaces.
fn roughness(surfaces: &Splats, site: &Site) -> f32 {
    let [east, north, up] = level_axes(site.up).map(DVec3::from_array);
    let mut heights: Vec<([i32; 3], f64)> = Vec::new();
    for index in (0..surfaces.len()).filter(|index| surfaces.groups[*index] != Group::Sky) {
        let rows = quat::to_matrix(surfaces.quats[index].map(f64::from));
        let axis = shortest_axis(surfaces.log_scales[index]);
        if up.dot(DVec3::from_array(rows.map(|row| row[axis]))).abs() > MIN_GROUND_COSINE {
            let point = DVec3::from_array(surfaces.means[index].map(f64::from)) * site.metres_per_unit;
            let height = point.dot(up);
            // What is a storey higher is another surface.
            let column = [point.dot(east), point.dot(north), 0.25 * height]
                .map(|v| (v / COLUMN_WIDTH_M).floor() as i32);
            heights.push((column, height));
        }
    }
    heights.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let deviation = |column: &[([i32; 3], f64)]| {
        let count = column.len() as f64;
        let mean = column.iter().map(|(_, height)| height).sum::<f64>() / count;
        (column.iter().map(|(_, height)| (height - mean).powi(2)).sum::<f64>() / count).sqrt()
    };
    let columns = heights.chunk_by(|a, b| a.0 == b.0).filter(|column| column.len() >= MIN_COLUMN_SURFACES);
    median(columns.map(deviation).collect()).unwrap_or(0.0) as f32
}

/// Returns true if the surfaces around a place look away from it.
fn is_behind(at: Vec3, points: &[[f32; 3]], capture: &CaptureLight, site: &Site) -> bool {
    let [near, far] = ENCLOSURE_DISTANCES_M.map(|metres| (metres / site.metres_per_unit) as f32);
    let (mut behind, mut all) = (0, 0);
    for (index, point) in points.iter().enumerate() {
        let to_lamp = at - Vec3::from_array(*point);
        let is_around = (near * near..far * far).contains(&to_lamp.length_squared());
        if is_around && !capture.is_sky(index) && capture.normal(index) != Vec3::ZERO {
            all += 1;
            behind += usize::from(to_lamp.dot(capture.normal(index)) < 0.0);
        }
    }
    all >= MIN_ENCLOSING_SURFACES && behind as f64 >= MIN_ENCLOSED_SHARE * all as f64
}

/// The distance to the first surface around a point, on the faces of a cube.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DepthCube {
    side: u32,
    /// Reciprocal of the distance along the face's axis, scene units; 0 where there is nothing:
    /// `[6, side, side]`.
    inverse: Vec<f32>,
    /// Scene units.
    behind: f32,
}

/// Right, down and forward of a face, world axes.
const fn face_axes(face: usize) -> [[f32; 3]; 3] {
    match face {
        0 => [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]],
        1 => [[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]],
        2 => [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]],
        3 => [[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]],
        4 => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        _ => [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
    }
}

impl DepthCube {
    /// Draws what is around a light; nothing nearer than `near` along the axis of a face.
    fn draw(
        renderer: &mut CpuRenderer,
        sets: &[SetView<'_>],
        frame: &mut Frame,
        light: &LampLight,
        side: u32,
        near: f64,
    ) -> Result<Self, RenderError> {
        let eye = Vec3::from_array(light.at).as_dvec3();
        let outputs = Outputs { median_depth: MedianDepth::On, ..Outputs::default() };
        let config = RenderConfig { outputs, ..RenderConfig::default() };
        let mut inverse = Vec::with_capacity(6 * (side * side) as usize);
        for face in 0..6 {
            let [right, down, forward] = face_axes(face).map(|axis| Vec3::from_array(axis).as_dvec3());
            let rotation = DMat3::from_cols(right, down, forward).transpose();
            let camera = Camera { near, ..Camera::posed((side, side), 90.0, eye, rotation) };
            renderer.render(&DrawPass::new(sets, &camera, &config), frame)?;
            inverse.extend(
                frame.median_depth.iter().map(|depth| if *depth > 0.0 { depth.recip() } else { 0.0 }),
            );
        }
        Ok(Self { side, inverse, behind: (SLACK_M * near / LAMP_RADIUS_M) as f32 })
    }

    /// The face that an offset points to, its place on it in texels, and its distance along the
    /// face's axis.
    #[inline]
    fn locate(&self, offset: Vec3) -> (usize, [f32; 2], f32) {
        let size = offset.abs();
        let axis = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let face = 2 * axis + usize::from(offset[axis] < 0.0);
        let [right, down, _] = face_axes(face).map(Vec3::from_array);
        let depth = size[axis].max(1e-9);
        let half = 0.5 * self.side as f32;
        (face, [right, down].map(|axis| half * (1.0 + axis.dot(offset) / depth)), depth)
    }

    /// The texel of a face, the nearest of it where the place is beyond its edge.
    #[inline]
    fn texel(&self, face: usize, x: i32, y: i32) -> f32 {
        let last = self.side as i32 - 1;
        let at = (y.clamp(0, last) * self.side as i32 + x.clamp(0, last)) as usize;
        self.inverse[face * (self.side * self.side) as usize + at]
    }

    /// The distance to the first surface in a direction, scene units; `None` where there is none.
    fn first(&self, direction: Vec3) -> Option<f32> {
        let (face, [x, y], depth) = self.locate(direction);
        let inverse = self.texel(face, x as i32, y as i32);
        (inverse > 0.0).then(|| direction.length() / (depth * inverse))
    }

    /// The share of the light that reaches a point at an offset from it (world axes, scene units),
    /// 0-1.
    pub(crate) fn open(&self, offset: Vec3) -> f32 {
        let (face, [x, y], depth) = self.locate(offset);
        let (x, y) = (x - 0.5, y - 0.5);
        let (column, row) = (x.floor() as i32, y.floor() as i32);
        let (u, v) = (x - column as f32, y - row as f32);
        let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        let texels = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| self.texel(face, column + i, row + j));
        // Nothing stands nearer than that.
        let limit = 1.0 / (depth * (1.0 - SLACK_SHARE) - self.behind).max(1e-9);
        let (low, high) = texels.iter().fold((f32::INFINITY, 0.0f32), |(l, h), v| (l.min(*v), h.max(*v)));
        if high <= limit {
            return 1.0;
        }
        if low >= high * (1.0 - MAX_DISTANCE_STEP_SHARE) {
            // One surface: its inverse distance is linear over the face where it is flat.
            let here: f32 = (0..4).map(|k| weights[k] * texels[k]).sum();
            return if here <= limit { 1.0 } else { 0.0 };
        }
        (0..4).map(|k| if texels[k] <= limit { weights[k] } else { 0.0 }).sum()
    }

    /// Returns true if the nearest texel is open.
    #[inline]
    pub(crate) fn is_open(&self, offset: Vec3) -> bool {
        let (face, [x, y], depth) = self.locate(offset);
        self.texel(face, x as i32, y as i32) * (depth * (1.0 - SLACK_SHARE) - self.behind) <= 1.0
    }

    /// [`Self::is_open`] of a vector of offsets: 1 where a point is open, 0 where not.
    #[inline(always)]
    pub(crate) fn open_each<S: Lanes>(&self, simd: S, offset: &[S::F; 3]) -> S::F {
        let [x, y, z] = *offset;
        let size = [x.abs(), y.abs(), z.abs()];
        let (side, zero, one) = (self.side as f32, simd.set(0.0), simd.set(1.0));
        let is_x = size[0].simd_ge(size[1]) & size[0].simd_ge(size[2]);
        let is_y = size[1].simd_ge(size[2]);
        let depth = is_x.select(size[0], is_y.select(size[1], size[2])).max(simd.set(1e-9));
        // As `face_axes` has it.
        let sign = is_x.select(x, is_y.select(y, z)).simd_lt(zero).select(-one, one);
        let right = is_x.select(-(y * sign), is_y.select(x * sign, x));
        let down = is_x.select(-z, is_y.select(-z, y * sign));
        let face = is_x.select(zero, is_y.select(simd.set(2.0), simd.set(4.0))) + (one - sign) * 0.5;
        let texel = |along: S::F| {
            let place = (along / depth + 1.0) * (0.5 * side);
            place.floor().max(zero).min(simd.set(side - 1.0))
        };
        // Whole numbers below 2^24: exact.
        let at = face.mul_add(simd.set(side * side), texel(down).mul_add(simd.set(side), texel(right)));
        let mut lanes = [0.0f32; GROUP];
        at.store_slice(&mut lanes[..S::N]);
        for lane in &mut lanes[..S::N] {
            *lane = self.inverse[*lane as usize];
        }
        let limit = depth.mul_add(simd.set(1.0 - SLACK_SHARE), simd.set(-self.behind));
        (simd.load(&lanes) * limit).simd_le(one).select(one, zero)
    }
}
