//! Snow as splats: flat, opaque, on the snow's own surface.

use super::ground::{GroundGrid, NEIGHBOUR_STEPS};
use crate::optics::{Site, SiteLight};
use crate::particles::random::RandomSequence;
use crate::surfel::surfel;
use crate::threads::map;
use glam::DVec3;
use wm_base::color::srgb_encode;
use wm_scene::Splats;

/// Depth below which the ground shows between flakes.
const DUSTING_DEPTH_M: f32 = 0.006;
/// Standard deviation of a surfel along the surface, in cells: amid others, so wide that nothing is
/// seen between them, and at an edge; how far off the middle it is at most; and through, m.
const SURFEL_SIGMAS_CELLS: [f64; 2] = [0.8, 0.55];
const MAX_OFFSETS_CELLS: [f64; 2] = [0.2, 0.1];
const SURFEL_SIGMA_M: f64 = 0.004;
/// Opacity of a surfel of deep snow.
pub(super) const SNOW_OPACITY: f64 = 0.985;
/// Least depth that is drawn, m.
const MIN_DEPTH_M: f32 = 0.000_5;
/// Height above its surface at which thin cover is drawn where it hides it, m, and the depth from
/// which on it is drawn as deep as it is: it then hides what it lies on, however rough that is.
const THIN_COVER_LIFT_M: f32 = 0.012;
const LIFTED_DEPTH_M: f32 = 0.05;
/// Height above its surface at which cover is drawn at its edges, m, however deep: leaves and
/// ridges are roughest, and stand out of it.
const RIM_LIFT_M: f32 = 0.018;
/// Coverage above which nothing below is visible.
const OPAQUE_COVERAGE: f32 = 0.995;
/// Unevenness of the surface, m and as a slope, at most; and how far above the mean of it what is
/// seen lies, as a share: of splats that overlap the uppermost.
const MAX_UNEVENNESS_M: f64 = 0.004;
const SEEN_UNEVENNESS: f64 = 0.55;
const MAX_UNEVEN_SLOPE: f64 = 0.06;

/// Nodes that one thread draws at a time.
const PART_NODE_COUNT: usize = 4096;
/// Wet ground: height at which it is drawn, m, width, in cells, how much light it takes at most,
/// and its own colour, sRGB.
const FILM_LIFT_M: f64 = 0.004;
const FILM_SIGMA_CELLS: f64 = 0.55;
const MAX_DARKENING: f64 = 0.38;
/// The darkening below which none is drawn.
const MIN_DARKENING: f64 = 0.004;
const FILM_COLOR: [f32; 3] = [0.1, 0.11, 0.12];

/// The colours of a cover in sun and shade.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoverMaterial {
    /// Linear RGB of it in the open.
    pub color: [f64; 3],
    /// Colour where nothing but the sky shines on it.
    pub shade: [f64; 3],
}

impl CoverMaterial {
    /// A material of this albedo by channel, no brighter than `most`, at a site; `shade` is the
    /// share of the light that is left in the shade of the capture's sun. In the light of a weather
    /// it has its own colour everywhere, and that light falls on it.
    pub(crate) fn at(albedo: [f64; 3], shade: [f64; 3], most: f64, site: &Site) -> Self {
        if site.light == SiteLight::OfWeather {
            return Self { color: albedo, shade: albedo };
        }
        // Level ground sees all of the sky, of which the airlight is the part near the horizon.
        let color: [f64; 3] = std::array::from_fn(|k| (site.airlight[k] * albedo[k]).min(most));
        Self { color, shade: std::array::from_fn(|k| color[k] * shade[k]) }
    }
}

/// Returns the share of the ground that a depth covers, 0-1: 0 where nothing is drawn, so that
/// cover fades out.
pub(crate) fn coverage(depth: f32) -> f32 {
    (1.0 - (-depth.max(0.0) / DUSTING_DEPTH_M).exp()) * (depth / MIN_DEPTH_M - 1.0).clamp(0.0, 1.0)
}

/// A cover on a ground, one value per node.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CoverLayer<'a> {
    /// Depth, m.
    pub(crate) depth: &'a [f32],
    /// Height of its top, m.
    pub(crate) top: &'a [f32],
    /// Wetness of the ground below it, 0-1.
    pub(crate) wet: &'a [f32],
    /// Depth of the covers above it, m; empty where there are none.
    pub(crate) above: &'a [f32],
}

/// Height, m, that what lies is drawn up to: what lies on it is drawn above that.
pub(crate) fn drawn(top: f32, depth: f32) -> f32 {
    top + lift(depth)
}

/// Returns the height that is added to thin cover when it is drawn, m.
fn lift(depth: f32) -> f32 {
    THIN_COVER_LIFT_M * coverage(depth) * (1.0 - depth / LIFTED_DEPTH_M).max(0.0)
}

/// The surface of what lies on heights `base`: height of its top at each node, m; smoother than
/// those the deeper it is.
pub(crate) fn surface(ground: &GroundGrid, base: &[f32], depth: &[f32]) -> Vec<f32> {
    let mut top: Vec<f32> = base.iter().zip(depth).map(|(height, depth)| height + depth).collect();
    for _ in 0..2 {
        top = map(top.len(), |node| {
            if depth[node] <= MIN_DEPTH_M {
                return top[node];
            }
            // Never below what it lies on, and level only as far as there is snow to level.
            let [level] = ground.mean_about(node, |other| (depth[other] > MIN_DEPTH_M).then(|| [top[other]]));
            level.clamp(top[node] - 0.5 * depth[node], top[node] + 0.5 * depth[node])
        });
    }
    top
}

/// Adds the splats of what lies on a ground.
pub(crate) fn add(
    ground: &GroundGrid,
    layer: &CoverLayer<'_>,
    metres_per_unit: f64,
    material: &CoverMaterial,
    splats: &mut Splats,
) {
    let painter = Painter {
        ground,
        layer,
        material,
        metres_per_unit,
        axes: ground.places.axes().map(DVec3::from_array),
        cell: f64::from(ground.cell),
    };
    let nodes = ground.len();
    let parts = map(nodes.div_ceil(PART_NODE_COUNT), |part| {
        let mut splats = Splats::with_capacity(0, 0);
        for node in part * PART_NODE_COUNT..nodes.min((part + 1) * PART_NODE_COUNT) {
            painter.paint(node, &mut splats);
        }
        splats
    });
    parts.iter().for_each(|part| splats.append(part));
}

/// The inputs for the splats of a node.
struct Painter<'a> {
    ground: &'a GroundGrid,
    layer: &'a CoverLayer<'a>,
    material: &'a CoverMaterial,
    metres_per_unit: f64,
    /// Axes of the grid.
    axes: [DVec3; 3],
    /// m.
    cell: f64,
}

impl Painter<'_> {
    /// Adds the splats of a node.
    fn paint(&self, node: usize, splats: &mut Splats) {
        let Self { ground, layer: CoverLayer { depth, top, above, .. }, material, axes, cell, .. } = *self;
        let is_hidden = above.get(node).is_some_and(|depth| coverage(*depth) > OPAQUE_COVERAGE);
        if is_hidden || ground.is_elsewhere(node) {
            return;
        }
        self.wet(node, splats);
        if depth[node] <= MIN_DEPTH_M {
            return;
        }
        let [column, row] = ground.place(node);
        let beside = ground.beside(node);
        let level = |way: usize| {
            beside[way].filter(|other| depth[*other] > MIN_DEPTH_M).map(|other| f64::from(top[other]))
        };
        let here = f64::from(top[node]);
        let slope = |high: Option<f64>, low: Option<f64>| match (low, high) {
            (Some(low), Some(high)) => (high - low) / (2.0 * cell),
            (Some(low), None) => (here - low) / cell,
            (None, Some(high)) => (high - here) / cell,
            (None, None) => 0.0,
        };
        let mut draws = RandomSequence::new(node as u64 ^ 0x5e0f_0000_0000);
        let mut off = |most: f64| most * (2.0 * draws.uniform() - 1.0);
        let dx = slope(level(0), level(2)).clamp(-1.7, 1.7) + off(MAX_UNEVEN_SLOPE);
        let dy = slope(level(1), level(3)).clamp(-1.7, 1.7) + off(MAX_UNEVEN_SLOPE);
        let goes_on = |[x, y]: [i64; 2]| match ground.cell_of(column + x, row + y) {
            // Beyond the grid's end it goes on, and on an inner ground.
            None => true,
            Some(next) => ground.nodes_of(next).any(|other| ground.is_elsewhere(other)),
        };
        let is_edge = usize::from((0..4).any(|way| level(way).is_none() && !goes_on(NEIGHBOUR_STEPS[way])));
        let place = [column, row].map(|v| v as f64 + 0.5 + off(MAX_OFFSETS_CELLS[is_edge]));
        let lift = off(MAX_UNEVENNESS_M) - SEEN_UNEVENNESS * MAX_UNEVENNESS_M;
        let cover = f64::from(coverage(depth[node]));
        let rim = if is_edge == 1 { f64::from(RIM_LIFT_M) * cover } else { 0.0 };
        // Splats are rough: what covers the ground must be above what they show of it.
        let lift = lift.min(f64::from(depth[node]) * 0.3) + f64::from(self::lift(depth[node])).max(rim);
        let normal = (axes[2] - axes[0] * dx - axes[1] * dy).normalize();
        let shade = f64::from(ground.shade[node]) * (0.7 + 0.3 * normal.dot(axes[2]));
        let color: [f64; 3] =
            std::array::from_fn(|k| material.shade[k] + (material.color[k] - material.shade[k]) * shade);
        let speckle = 1.0 + off(0.025);
        let rgb = color.map(|v| srgb_encode((v * speckle).max(0.0)) as f32);
        let wide = SURFEL_SIGMAS_CELLS[is_edge] * cell * (1.0 + dx * dx + dy * dy).sqrt().min(1.6);
        let at = ground.places.point(place, here + lift);
        self.put(at, normal, [wide, wide, SURFEL_SIGMA_M], rgb, SNOW_OPACITY * cover, splats);
        // The sides of deep snow, where its surface ends; they come and go evenly.
        let own = f64::from(depth[node]);
        let deep = (10.0 * (own / cell - 0.45)).clamp(0.0, 1.0);
        if deep <= 0.0 || ground.is_crown(node) {
            return;
        }
        for (way, [x, y]) in NEIGHBOUR_STEPS.into_iter().enumerate() {
            let ends = level(way).map_or(1.0, |other| (10.0 * ((here - other) / own - 0.65)).clamp(0.0, 1.0));
            if ends <= 0.0 || goes_on([x, y]) {
                continue;
            }
            let outward = axes[0] * x as f64 + axes[1] * y as f64;
            let edge = [column as f64 + 0.5 + 0.4 * x as f64, row as f64 + 0.5 + 0.4 * y as f64];
            let side = color.map(|v| srgb_encode(0.93 * v) as f32);
            let at = ground.places.point(edge, here - 0.45 * own);
            self.put(
                at,
                outward,
                [SURFEL_SIGMAS_CELLS[1] * cell, 0.4 * own, SURFEL_SIGMA_M],
                side,
                SNOW_OPACITY * cover * deep * ends,
                splats,
            );
        }
    }

    /// Adds what wets a node, between what lies there. It is laid by the ground alone, so that it
    /// stays as it is when the last of that goes.
    fn wet(&self, node: usize, splats: &mut Splats) {
        let Self { ground, layer: CoverLayer { depth, top, wet, .. }, axes, cell, .. } = *self;
        let soaked = MAX_DARKENING * f64::from(wet[node] * (1.0 - coverage(depth[node])));
        if soaked <= MIN_DARKENING {
            return;
        }
        let [dx, dy] = ground.slope[node].map(|slope| f64::from(slope).clamp(-1.7, 1.7));
        let normal = (axes[2] - axes[0] * dx - axes[1] * dy).normalize();
        let wide = FILM_SIGMA_CELLS * cell * (1.0 + dx * dx + dy * dy).sqrt().min(1.6);
        let at = ground.places.point(ground.middle(node), f64::from(top[node]) + FILM_LIFT_M);
        self.put(at, normal, [wide, wide, SURFEL_SIGMA_M], FILM_COLOR, soaked, splats);
    }

    /// Adds one: at a place (world, scene units), as wide as `scales` (m).
    fn put(
        &self,
        at: [f64; 3],
        normal: DVec3,
        scales: [f64; 3],
        rgb: [f32; 3],
        opacity: f64,
        splats: &mut Splats,
    ) {
        let scales = scales.map(|metres| metres / self.metres_per_unit);
        splats.push(&surfel(at, normal, self.axes[2], scales, rgb, opacity));
    }
}

/// Colour of what lies, sRGB, from 0 in the shade to 1 in the open.
pub(super) fn lit(material: &CoverMaterial, light: f64) -> [f32; 3] {
    std::array::from_fn(|k| {
        let color = material.shade[k] + (material.color[k] - material.shade[k]) * light;
        srgb_encode(color.max(0.0)) as f32
    })
}
