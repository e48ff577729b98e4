//! Light in air: extinction and airlight, for fog, haze, smog and whatever else floats.
//!
//! Along a ray of length `s` (metres, not view z) through air of extinction `sigma_t`,
//! `L = L0 T + A (1 - T)`, `T = exp(-optical_depth)`, in linear light: Koschmieder's law, which the
//! paper's `eq:fog style` has in display-referred colour and along z. `sigma_t = -ln(0.05) / MOR`
//! (WMO: 5 % of the light is left at the meteorological optical range); by the older 2 % visual
//! range `V` it is `3.912 / V`. Small particles scatter blue more:
//! `sigma_t ~ wavelength^-angstrom`.
//!
//! With a scale height `H` the air thins upwards, `sigma(z) = sigma_0 exp(-(z - z0) / H)`, and the
//! optical depth over length `s` from height `zc` with rise `dz` a metre is, in closed form,
//! `sigma_0 exp(-(zc - z0) / H) s (1 - e^-x) / x`, `x = s dz / H`.
//!
//! The drops of rain and snow that are drawn do their own part: the air leaves it to them
//! ([`crate::particles::residual`]).
//!
//! Several layers at once: optical depths add, and the airlight is the mean of theirs weighted by
//! optical depth: exact where the layers have one profile, and close to it otherwise.
//!
//! The air changes each splat when it is shaded, by the length of the splat's own ray. So
//! silhouettes have no halos, which one depth per pixel cannot avoid. The hook is two primitives,
//! transmittance and airlight along a ray ([`wm_render::hooks::Medium`]); shading, the parts of a
//! picture and the f64 reference are made of these two. `optics.wgsl` is the same for GPUs.

use crate::level::dot;
use crate::particles::Residual;
use crate::particles::residual::{FARTHEST_NODE, NEAREST_NODE, NODES};
use fearless_simd::{Select, SimdBase, SimdFloat};
use std::borrow::Cow;
use std::f32::consts::LOG2_E;
use std::sync::LazyLock;
use wm_render::dispatch;
use wm_render::hooks::{AirGroup, AirOnRay, GROUP, Medium, ShadeGroup, WgslSource};
use wm_render::simd::{self, Lanes, SimdPath, exp2};
use wm_scene::survey::SunnySide;

pub use wm_scene::metadata::MOR_DEPTH;
pub use wm_scene::survey::CapturedSky;
/// `-ln(0.02)`: optical depth of Koschmieder's visual range.
const VISUAL_RANGE_DEPTH: f64 = 3.912_023_005_428_146;
/// Wavelengths that stand for the display's primaries.
pub(crate) const WAVELENGTHS_NM: [f64; 3] = [610.0, 550.0, 465.0];
/// Distance of the sky and the background, m: beyond any atmosphere, yet safe in f32.
pub(crate) const SKY_DISTANCE_M: f64 = 1e7;
/// Longest path through a layer, m at its base density: finite, so that mean airlights stay
/// numbers.
const MAX_LAYER_PATH_M: f64 = 1e30;

/// Extinction a metre, green, of a meteorological optical range in metres.
#[must_use]
pub fn sigma_of_mor(mor: f64) -> f64 {
    MOR_DEPTH / mor
}

/// Extinction a metre of a visual range (2 %) in metres.
pub(crate) fn sigma_of_visual_range(range: f64) -> f64 {
    VISUAL_RANGE_DEPTH / range
}

/// Extinction of the three channels relative to green (550 nm) for an Angstrom exponent.
pub(crate) fn spectrum(angstrom: f64) -> [f64; 3] {
    WAVELENGTHS_NM.map(|wavelength| (wavelength / WAVELENGTHS_NM[1]).powf(-angstrom))
}

/// One kind of floating particles, homogeneous across, thinning upwards or not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct AirLayer {
    /// Extinction at the base, 1/m, by channel.
    pub(crate) sigma_t: [f64; 3],
    /// Radiance of an endless path through it, linear RGB.
    pub(crate) airlight: [f64; 3],
    /// Height over which it thins to 1/e, m; infinite for none.
    pub(crate) scale_height: f64,
    /// Height above the ground at which `sigma_t` holds, m.
    pub(crate) base_height: f64,
}

/// How well the airlight of a site is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Daylight {
    /// It was given, or is that of the sky that the scene has.
    Known,
    /// It was guessed from the surfaces: a sky that the weather brings knows it better.
    Guessed,
}

/// The place of a site on Earth, and the time of its capture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EarthPlace {
    /// North, level, world axes, length 1.
    pub north: [f64; 3],
    /// Latitude and longitude, degrees, WGS 84.
    pub location: [f64; 2],
    /// Seconds since 1970, UTC.
    pub captured: Option<f64>,
}

/// The lamps that a weather asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LampSource {
    /// The lamps that the scene states.
    Scene,
    /// The lamps that the scene states; where it states none, a row along the path of the photos.
    Path,
}

/// Illuminance of the ground that the lamps of a site light, lx: the mean of it, the lighter parts
/// counting more.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LampLevels {
    /// Illuminance by the lamps that the scene states.
    pub scene: f64,
    /// Illuminance by those, or by lamps along the path of the photos where it states none.
    pub path: f64,
}

impl LampLevels {
    /// Level of the lamps that a weather asks for.
    pub(crate) fn of(&self, source: LampSource) -> f64 {
        match source {
            LampSource::Scene => self.scene,
            LampSource::Path => self.path,
        }
    }
}

/// The light in which a site lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SiteLight {
    /// The light of the capture.
    #[default]
    Captured,
    /// One that the weather brings: what it lays on the place is lit by that.
    OfWeather,
}

/// Properties of a place that weather depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Site {
    /// The point of the world that is zero in the scene, scene units.
    pub origin: [f64; 3],
    /// Metres a scene unit.
    pub metres_per_unit: f64,
    /// Up, world axes, length 1.
    pub up: [f64; 3],
    /// Height of the ground along up, scene units.
    pub ground: f64,
    /// Radiance of the sky near the horizon, linear RGB.
    pub airlight: [f64; 3],
    /// Brightness of a white card on level ground in the open as the photos would show it, linear,
    /// 1 = display white; `None` where nobody states it.
    pub white_card: Option<f64>,
    /// Says if the airlight is known or guessed.
    pub daylight: Daylight,
    /// The sky that the place was captured under.
    pub captured_sky: CapturedSky,
    /// The side from which a sun lights most of the place.
    pub sunny_side: SunnySide,
    /// North, place and time, where they are known.
    pub earth: Option<EarthPlace>,
    /// The light of its lamps.
    pub lamps: LampLevels,
    /// The light in which it lies.
    pub light: SiteLight,
    /// Depth that the paper's relative depth takes for 1, m.
    pub far: f64,
}

impl Site {
    /// Open ground at height 0 with z up and a unit of one metre, under a pale sky; nothing else is
    /// known of it.
    pub const PLAIN: Self = Self {
        origin: [0.0; 3],
        metres_per_unit: 1.0,
        up: [0.0, 0.0, 1.0],
        ground: 0.0,
        airlight: [0.8; 3],
        white_card: None,
        daylight: Daylight::Known,
        captured_sky: CapturedSky::Unknown,
        sunny_side: SunnySide::NONE,
        earth: None,
        lamps: LampLevels { scene: 0.0, path: 0.0 },
        light: SiteLight::Captured,
        far: 100.0,
    };
}

/// All layers over one site: the renderer's air.
#[derive(Clone, Debug, PartialEq)]
pub struct Atmosphere {
    layers: Vec<AirLayer>,
    /// Parts of the layers that are drawn drop by drop.
    drawn: Vec<Residual>,
    site: Site,
}

impl Atmosphere {
    /// The layers over a site; layers without extinction are dropped.
    pub(crate) fn new(layers: Vec<AirLayer>, site: Site) -> Self {
        let layers = layers.into_iter().filter(|layer| layer.sigma_t.iter().any(|s| *s > 0.0)).collect();
        Self { layers, drawn: Vec::new(), site }
    }

    /// Leaves out what is drawn drop by drop.
    pub(crate) fn without(mut self, drawn: Vec<Residual>) -> Self {
        self.drawn = drawn;
        self
    }

    /// Returns true if the air is clear.
    pub(crate) fn is_clear(&self) -> bool {
        self.layers.is_empty()
    }

    /// Height above the ground of a world point, m.
    fn height(&self, point: [f64; 3]) -> f64 {
        (dot(point, self.site.up) - self.site.ground) * self.site.metres_per_unit
    }

    /// Optical depth of one layer along a ray, relative to `sigma_t`, m.
    fn path_length(layer: &AirLayer, height: f64, rise: f64, metres: f64) -> f64 {
        let metres = metres.min(SKY_DISTANCE_M);
        if layer.scale_height.is_infinite() {
            return metres;
        }
        // Kept from overflowing far below the base, where nothing is seen anyway.
        let density = (-(height - layer.base_height) / layer.scale_height).clamp(-80.0, 80.0).exp();
        let x = metres * rise / layer.scale_height;
        let decay = (-x * std::f64::consts::LOG2_E).clamp(-126.0, 126.0).exp2();
        let mean = if x.abs() < 1e-4 { 1.0 - x / 2.0 } else { (1.0 - decay) / x };
        (metres * density * mean).min(MAX_LAYER_PATH_M)
    }

    /// Optical depth in one channel of the layers along a ray: from `origin` (world axes, scene
    /// units) through `distance` (scene units) along a unit direction.
    pub(crate) fn layers_depth(
        &self,
        origin: [f64; 3],
        direction: [f64; 3],
        distance: f64,
        channel: usize,
    ) -> f64 {
        let height = self.height(origin);
        let rise = dot(direction, self.site.up);
        let metres = distance * self.site.metres_per_unit;
        let of = |layer: &AirLayer| layer.sigma_t[channel] * Self::path_length(layer, height, rise, metres);
        self.layers.iter().map(of).sum()
    }

    /// Extinction at a point (world axes, scene units), 1/m, by channel.
    pub(crate) fn extinction_at(&self, point: [f64; 3]) -> [f64; 3] {
        let height = self.height(point);
        let density =
            |layer: &AirLayer| (-(height - layer.base_height) / layer.scale_height).clamp(-80.0, 80.0).exp();
        std::array::from_fn(|k| self.layers.iter().map(|layer| layer.sigma_t[k] * density(layer)).sum())
    }

    /// Meteorological optical range of green light at a point (world axes, scene units), m;
    /// infinite in clear air.
    #[must_use]
    pub fn mor_at(&self, point: [f64; 3]) -> f64 {
        // The same law both ways.
        sigma_of_mor(self.extinction_at(point)[1])
    }

    /// The air as seen from `origin` (world axes, scene units).
    pub(crate) fn seen_from(&self, origin: [f32; 3]) -> AirView<'_> {
        let height = self.height(origin.map(f64::from));
        let layers: Vec<LayerView> = self.layers.iter().map(|layer| LayerView::new(layer, height)).collect();
        let is_grey = layers.iter().all(LayerView::is_grey);
        AirView { layers, drawn: &self.drawn, up: self.site.up.map(|v| v as f32), is_grey }
    }

    #[inline(always)]
    fn shade_groups<S: Lanes>(&self, simd: S, origin: [f32; 3], groups: &mut [ShadeGroup]) {
        let view = self.seen_from(origin);
        let metres_per_unit = self.site.metres_per_unit as f32;
        for group in groups {
            for first in (0..GROUP).step_by(S::N) {
                let (metres, direction) = ray(simd, group, first, metres_per_unit);
                let mut color = [simd.set(0.0); 3];
                for k in 0..3 {
                    color[k] = simd.load(&group.rgb[k][first..]);
                }
                let seen = view.through(simd, metres, &direction, simd::srgb_decode(simd, color));
                let shown = simd::srgb_encode(simd, seen);
                for k in 0..3 {
                    shown[k].store_slice(&mut group.rgb[k][first..first + S::N]);
                }
            }
        }
    }

    #[inline(always)]
    fn evaluate_groups<S: Lanes>(
        &self,
        simd: S,
        origin: [f32; 3],
        rays: &[ShadeGroup],
        out: &mut [AirGroup],
    ) {
        let view = self.seen_from(origin);
        let metres_per_unit = self.site.metres_per_unit as f32;
        for (group, out) in rays.iter().zip(out) {
            for first in (0..GROUP).step_by(S::N) {
                let (metres, direction) = ray(simd, group, first, metres_per_unit);
                let (kept, endless) = view.along(simd, metres, &direction);
                for k in 0..3 {
                    let added = endless[k] * (simd.set(1.0) - kept[k]);
                    kept[k].store_slice(&mut out.transmittance[k][first..first + S::N]);
                    added.store_slice(&mut out.airlight[k][first..first + S::N]);
                }
            }
        }
    }
}

/// Lengths (m) and directions of a vector of rays of a group.
#[inline(always)]
fn ray<S: Lanes>(simd: S, group: &ShadeGroup, first: usize, metres_per_unit: f32) -> (S::F, [S::F; 3]) {
    let metres = simd.load(&group.distance[first..]) * metres_per_unit;
    let mut direction = [simd.set(0.0); 3];
    for k in 0..3 {
        direction[k] = simd.load(&group.direction[k][first..]);
    }
    (metres, direction)
}

/// The air as seen from one point.
pub(crate) struct AirView<'a> {
    layers: Vec<LayerView>,
    drawn: &'a [Residual],
    up: [f32; 3],
    is_grey: bool,
}

impl AirView<'_> {
    /// Returns true if the air takes as much of each channel.
    pub(crate) fn is_grey(&self) -> bool {
        self.is_grey
    }

    /// Light, linear RGB, that comes from `metres` away along unit directions (world axes), as it
    /// arrives.
    #[inline(always)]
    pub(crate) fn through<S: Lanes>(
        &self,
        simd: S,
        metres: S::F,
        direction: &[S::F; 3],
        light: [S::F; 3],
    ) -> [S::F; 3] {
        let (kept, airlight) = self.along(simd, metres, direction);
        let mut seen = light;
        for k in 0..3 {
            seen[k] = (light[k] - airlight[k]).mul_add(kept[k], airlight[k]);
        }
        seen
    }

    /// The transmittance over `metres` along unit directions (world axes), and the radiance (linear
    /// RGB) of an endless path through the same air: the airlight is that times
    /// `1 - transmittance`.
    #[inline(always)]
    pub(crate) fn along<S: Lanes>(
        &self,
        simd: S,
        metres: S::F,
        direction: &[S::F; 3],
    ) -> ([S::F; 3], [S::F; 3]) {
        let Self { layers, drawn, up, is_grey } = self;
        let metres = metres.min(simd.set(SKY_DISTANCE_M as f32));
        let (mut depth, mut added) = ([simd.set(0.0); 3], [simd.set(0.0); 3]);
        for layer in layers {
            let path = if layer.per_height > 0.0 {
                let [dx, dy, dz] = direction;
                let rise = dx.mul_add(simd.set(up[0]), dy.mul_add(simd.set(up[1]), *dz * up[2]));
                let mean = mean_density(simd, metres * rise * layer.per_height);
                (metres * mean * layer.density).min(simd.set(MAX_LAYER_PATH_M as f32))
            } else {
                metres
            };
            for k in 0..3 {
                let own = path * layer.sigma_t[k];
                depth[k] += own;
                added[k] = own.mul_add(simd.set(layer.airlight[k]), added[k]);
            }
        }
        for drawn in *drawn {
            let own = drawn.tabled(simd, metres) * -LOG2_E;
            for k in 0..3 {
                depth[k] += own;
                added[k] = own.mul_add(simd.set(drawn.airlight[k] as f32), added[k]);
            }
        }
        let mut exponent = depth;
        for k in 0..3 {
            exponent[k] = (-depth[k]).max(simd.set(-126.0)).min(simd.set(0.0));
        }
        let kept = if *is_grey { [exp2(simd, [exponent[0]])[0]; 3] } else { exp2(simd, exponent) };
        let mut endless = added;
        for k in 0..3 {
            endless[k] = match &layers[..] {
                [only] if drawn.is_empty() => simd.set(only.airlight[k]),
                _ => added[k] / depth[k].max(simd.set(1e-30)),
            };
        }
        (kept, endless)
    }
}

/// A layer relative to the height of a camera, in f32.
struct LayerView {
    /// Extinction a metre, scaled so that transmittance is a power of two.
    sigma_t: [f32; 3],
    airlight: [f32; 3],
    /// Density at the camera.
    density: f32,
    /// 1 / scale height; 0 for none.
    per_height: f32,
}

impl LayerView {
    fn new(layer: &AirLayer, height: f64) -> Self {
        let density = (-(height - layer.base_height) / layer.scale_height).clamp(-80.0, 80.0).exp();
        Self {
            sigma_t: layer.sigma_t.map(|sigma| (sigma * std::f64::consts::LOG2_E) as f32),
            airlight: layer.airlight.map(|v| v as f32),
            density: if layer.scale_height.is_finite() { density as f32 } else { 1.0 },
            per_height: (1.0 / layer.scale_height) as f32,
        }
    }

    fn is_grey(&self) -> bool {
        self.sigma_t[0] == self.sigma_t[1] && self.sigma_t[1] == self.sigma_t[2]
    }
}

impl Medium for Atmosphere {
    fn evaluate(&self, path: SimdPath, origin: [f32; 3], rays: &[ShadeGroup], out: &mut [AirGroup]) {
        dispatch!(path, s => self.evaluate_groups(s, origin, rays, out));
    }

    fn shade(&self, path: SimdPath, origin: [f32; 3], groups: &mut [ShadeGroup]) {
        dispatch!(path, s => self.shade_groups(s, origin, groups));
    }

    fn far_color(&self) -> Option<[f32; 3]> {
        let endless =
            |layer: &AirLayer| layer.scale_height.is_infinite() && layer.sigma_t.iter().all(|s| *s > 0.0);
        if !self.layers.iter().all(endless) {
            return None;
        }
        Some(self.reference([0.0; 3], self.site.up, f64::INFINITY, [0.0; 3]).map(|v| v as f32))
    }

    fn wgsl(&self, origin: [f32; 3]) -> Option<WgslSource> {
        static WGSL: LazyLock<String> = LazyLock::new(|| {
            let mut constants = format!("const NODES: u32 = {NODES}u;\n");
            for (name, metres) in [
                ("TABLE_NEAR", f64::from(NEAREST_NODE)),
                ("TABLE_FAR", f64::from(FARTHEST_NODE)),
                ("FAR_METRES", SKY_DISTANCE_M),
                ("LONGEST_METRES", MAX_LAYER_PATH_M),
            ] {
                constants += &format!("const {name}: f32 = {metres:e};\n");
            }
            constants + include_str!("optics.wgsl")
        });
        let view = self.seen_from(origin);
        let mut parameters = vec![view.layers.len() as f32, self.drawn.len() as f32];
        parameters.push(self.site.metres_per_unit as f32);
        parameters.extend(view.up);
        for LayerView { sigma_t, airlight, density, per_height } in &view.layers {
            parameters.extend(sigma_t.iter().chain(airlight).chain([density, per_height]));
        }
        for drawn in &self.drawn {
            parameters.extend(drawn.airlight.map(|v| v as f32));
            parameters.extend(drawn.table.as_flattened());
        }
        Some(WgslSource { wgsl: Cow::Borrowed(&WGSL), parameters })
    }

    fn evaluate_reference(&self, origin: [f64; 3], direction: [f64; 3], distance: f64) -> AirOnRay {
        let height = self.height(origin);
        let rise = dot(direction, self.site.up);
        let metres = distance * self.site.metres_per_unit;
        let paths: Vec<f64> =
            self.layers.iter().map(|layer| Self::path_length(layer, height, rise, metres)).collect();
        let mut air = AirOnRay::CLEAR;
        for k in 0..3 {
            let layers = self.layers.iter().zip(&paths);
            let layers = layers.map(|(layer, path)| (layer.sigma_t[k] * path, layer.airlight[k]));
            let drawn =
                self.drawn.iter().map(|drawn| (-drawn.depth(metres.min(SKY_DISTANCE_M)), drawn.airlight[k]));
            let parts = layers.chain(drawn);
            let total: f64 = parts.clone().map(|(depth, _)| depth).sum();
            if total > 0.0 {
                let light: f64 = parts.map(|(depth, airlight)| depth * airlight).sum();
                let (kept, endless) = ((-total).exp(), light / total);
                air.transmittance[k] = kept;
                air.airlight[k] = endless - endless * kept;
            }
        }
        air
    }
}

/// `(1 - e^-x) / x`: mean density along a ray that rises through `x` scale heights.
#[inline(always)]
fn mean_density<S: Lanes>(simd: S, x: S::F) -> S::F {
    // The quotient loses digits at small x, the series at large: they meet where both have six.
    let series = [-1.0 / 720.0, 1.0 / 120.0, -1.0 / 24.0, 1.0 / 6.0, -0.5, 1.0];
    let mut small = simd.set(series[0]);
    for coefficient in &series[1..] {
        small = small.mul_add(x, simd.set(*coefficient));
    }
    let decay = exp2(simd, [(x * -LOG2_E).max(simd.set(-126.0)).min(simd.set(126.0))])[0];
    let large = (simd.set(1.0) - decay) / x;
    (x * x).simd_lt(simd.set(0.25 * 0.25)).select(small, large)
}

#[cfg(test)]
mod tests;
