//! The surfaces that get wet: one a splat, with its reflectance, the rain that reaches it, and the
//! puddle that it may lie under.

use super::SlantedRain;
use super::basins::NO_BASIN;
use super::column::{Drainage, MOST_SHARE};
use super::ground_map::{GroundMap, ON_GROUND};
use super::optics::{self, STEPS};
use super::relief;
use super::sheen::{NO_SKY, SkySheen, skyline_of};
use super::state::WetState;
use crate::cover::ground::FarFloor;
use crate::fused_surfaces::FusedSurfaces;
use crate::light::{CaptureLight, GREEN, apply_gains};
use crate::open_water::OpenWater;
use crate::optics::Site;
use crate::shelter::Shelter;
use crate::threads::map;
use glam::Vec3;
use serde::{Deserialize, Serialize};
use wm_base::color::srgb_decode;
use wm_render::hooks::{Attribute, AttributeBlock};
use wm_scene::Splats;
use wm_scene::sh;

/// Bounds of reflectances.
const ALBEDOS: [f64; 2] = [0.02, 0.9];
/// Cosine between up and the normal from which ground is nearly level.
const LEVEL: f32 = 0.85;
/// Share of the rain that leaves get, which turn to all sides, and how porous they are.
const LEAF_RAIN_SHARE: f32 = 0.6;
const LEAF_POROSITY: f32 = 0.3;
/// Height above ground and distance from walls at which shelter is requested, m: captured surfaces
/// are rough.
const LIFT: f32 = 0.25;
const OFF_WALL: f32 = 0.4;
/// Radius about a point over which shelter is averaged, m: on the ground and on walls.
const SOFT: [f32; 2] = [0.4, 0.2];
/// Height above and below the bottom of a puddle within which a splat belongs to it, m.
const IN_PUDDLE: [f32; 2] = [0.05, 0.3];
/// Standard deviation of splats that are too wide for the edge of a puddle, m.
const MAX_EDGE_SIGMA_M: f64 = 0.3;
/// Depth over which the edge of a puddle goes over into the ground, m.
const EDGE: f32 = 0.002;
/// Least light of a surface over which the sky that it mirrors is a factor.
const DARKEST: f64 = 2e-3;
/// Steps of the share of the rain, and the classes: of level, steep and leafy surfaces, and of
/// those that stay dry.
const SHARES: usize = 64;
const DRY: u8 = 3 * SHARES as u8;
const CLASSES: usize = DRY as usize + 1;
/// Steps of the share of the ground that is lower than a splat.
const LOWER: usize = 16;

/// The surfaces of a scene, and its ground.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WetSurfaces {
    splats: Vec<WetSplat>,
    /// The puddles that splats may lie under.
    ponds: Vec<Pond>,
    /// Normals look to the outside; else to either side.
    is_oriented: bool,
    ground: GroundMap,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct WetSplat {
    point: [f32; 3],
    /// Normal times 127; zero of leaves.
    normal: [i8; 3],
    albedo: [u8; 3],
    /// The colour that does not depend on the direction, display-referred.
    color: [u8; 3],
    /// Elevation up to which something hides the sky, by [`skyline_of`]; [`NO_SKY`] of what is not
    /// steep.
    skyline: u8,
    /// Share of the ground that is lower, in [`LOWER`] steps: hollows get wet first.
    lower: u8,
    /// Sky, and open water.
    stays: bool,
    pond: u32,
}

/// A place in a basin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Pond {
    basin: u32,
    /// Height of the ground, m.
    height: f32,
}

impl WetSurfaces {
    /// Returns true if its parts fit each other and a scene of `splats` splats, as an asset that a
    /// stranger made may not.
    #[must_use]
    pub fn is_consistent(&self, splats: usize) -> bool {
        let is_pond =
            |pond: &Pond| (pond.basin as usize) < self.ground.basins.all.len() && pond.height.is_finite();
        let is_splat = |splat: &WetSplat| {
            usize::from(splat.lower) < LOWER
                && (splat.pond == NO_BASIN || (splat.pond as usize) < self.ponds.len())
        };
        self.splats.len() == splats
            && self.splats.iter().all(is_splat)
            && self.ponds.iter().all(is_pond)
            && self.ground.is_consistent(splats)
    }

    /// Finds the surfaces of a scene, by its fused surfaces and its captured light, and the ground
    /// about a path (world, scene units) without its open water.
    #[must_use]
    #[allow(
        clippy::too_many_arguments,
        reason = "the scene, its water, the path and the site are independent"
    )]
    pub fn of(
        splats: &Splats,
        found: &FusedSurfaces<'_>,
        capture: &CaptureLight,
        water: &OpenWater,
        path: [[f64; 3]; 2],
        is_up_known: bool,
        site: &Site,
    ) -> Self {
        let mut ground = GroundMap::new(found, water, path, is_up_known, site);
        let points = found.places(splats);
        let mean = capture.mean(&capture.light);
        let reflectance = |index: usize| -> [f64; 3] {
            let stride = splats.sh_stride();
            let sh = &splats.sh[index * stride..];
            let irradiance = capture.surface(index, site.up).irradiance(&capture.light, mean);
            std::array::from_fn(|k| {
                let light = srgb_decode((0.5 + sh::C0 * f64::from(sh[k])).clamp(0.0, 1.0));
                light / (capture.white(irradiance[k])).max(1e-3)
            })
        };
        let up = Vec3::from_array(site.up.map(|v| v as f32));
        let floor = FarFloor::new(found, site);
        let wide = (MAX_EDGE_SIGMA_M / site.metres_per_unit).ln() as f32;
        let with_ponds = map(splats.len(), |index| {
            let point = points[index];
            // Pools are as wet as they can be.
            let stays = capture.is_sky(index) || water.covers(point.map(f64::from));
            let albedo = if stays { [0.0; 3] } else { reflectance(index) };
            let albedo = albedo.map(|v| v.clamp(ALBEDOS[0], ALBEDOS[1]));
            let normal = capture.normal(index);
            let is_level = normal.dot(up).abs() > LEVEL;
            let is_green = albedo[1] > GREEN * albedo[0].max(albedo[2]);
            // Lawns turn to all sides, however flat they were captured.
            let normal = if is_green && is_level { Vec3::ZERO } else { normal };
            // Whatever way it lies, what shows through the ground is a part of it.
            let normal = if ground.depth_below(point) > ON_GROUND { up } else { normal };
            // Ground in the round of the water's surface has its own reflection.
            let is_wall =
                normal != Vec3::ZERO && normal.dot(up).abs() < LEVEL && !floor.holds(point.map(f64::from));
            let stride = splats.sh_stride();
            let sh = &splats.sh[index * stride..];
            let splat = WetSplat {
                color: std::array::from_fn(|k| {
                    (255.0 * (0.5 + sh::C0 * f64::from(sh[k])).clamp(0.0, 1.0)).round() as u8
                }),
                skyline: match is_wall {
                    true => skyline_of(capture.surface(index, site.up).open[0]),
                    false => NO_SKY,
                },
                point,
                normal: (127.0 * normal).to_array().map(|v| v.round() as i8),
                albedo: albedo.map(|v| (v * (STEPS - 1) as f64).round() as u8),
                lower: (ground.lower_share(point.map(f64::from)) * (LOWER - 1) as f32).round() as u8,
                stays,
                pond: NO_BASIN,
            };
            let (place, height) = ground.locate(point.map(f64::from));
            let faces_up = normal == Vec3::ZERO || normal.dot(up).abs() > LEVEL;
            let is_wide = splats.log_scales[index].into_iter().any(|scale| scale > wide);
            let pond = ground.basin_at(place).filter(|(_, bottom)| {
                let above = height as f32 - bottom;
                !stays && !is_wide && faces_up && (-IN_PUDDLE[1]..IN_PUDDLE[0]).contains(&above)
            });
            (splat, pond)
        });
        let mut ponds = Vec::new();
        let with_ponds = with_ponds.into_iter().map(|(splat, pond)| match pond {
            Some((basin, height)) => {
                ponds.push(Pond { basin, height });
                WetSplat { pond: ponds.len() as u32 - 1, ..splat }
            }
            None => splat,
        });
        let made: Vec<WetSplat> = with_ponds.collect();
        let shown = made.iter().enumerate().filter(|(_, splat)| !splat.stays).map(|(index, splat)| {
            let [a, b, c] = splats.scales(index).map(|scale| scale as f32);
            let area = (a * b).max(a * c).max(b * c);
            (splat.point, splats.opacity(index) as f32 * area, splat.albedo.map(f32::from))
        });
        ground.find_matte(shown);
        Self { splats: made, ponds, is_oriented: found.oriented > 0, ground }
    }

    /// The ground.
    #[must_use]
    pub fn ground(&self) -> &GroundMap {
        &self.ground
    }

    /// The number of splats.
    pub(crate) fn len(&self) -> usize {
        self.splats.len()
    }

    /// The share of the rain that a splat gets, and its class.
    fn class(&self, splat: &WetSplat, rain: &SlantedRain, shelter: Option<&Shelter>, site: &Site) -> u8 {
        if splat.stays {
            return DRY;
        }
        let up = Vec3::from_array(site.up.map(|v| v as f32));
        let driving = Vec3::from_array(rain.driving.map(|v| v as f32));
        let mut normal = Vec3::from_array(splat.normal.map(|v| f32::from(v) / 127.0));
        if !self.is_oriented && normal.dot(up) < 0.3 {
            // Either side may be outside: that which rain falls on.
            let is_under = normal.dot(up) < -0.3 || normal.dot(driving) > 0.0;
            normal = if is_under { -normal } else { normal };
        }
        let upright = normal.dot(up);
        let is_leaf = normal == Vec3::ZERO;
        let metres = site.metres_per_unit as f32;
        let level = if is_leaf { 1.0 } else { upright.clamp(0.0, 1.0) };
        let above = LIFT * level + self.ground.depth_below(splat.point);
        let off = up * above + normal * (OFF_WALL * (1.0 - level));
        let at = Vec3::from_array(splat.point) + off / metres;
        let radius = SOFT[1] + (SOFT[0] - SOFT[1]) * level;
        let open = shelter.map_or(1.0, |shelter| shelter.exposure(at.to_array(), radius));
        let falls =
            if is_leaf { LEAF_RAIN_SHARE } else { upright.max(0.0) + (-normal.dot(driving)).max(0.0) };
        let share = (open * falls / MOST_SHARE as f32).clamp(0.0, 1.0).sqrt();
        let kind = if is_leaf { 2 } else { usize::from(upright < LEVEL) };
        (kind * SHARES) as u8 + (share * (SHARES - 1) as f32).round() as u8
    }
}

/// The few bytes of a splat that every frame reads, in any order. Splats in puddles and steep ones
/// need their [`WetSplat`] too.
#[derive(Clone, Copy, Debug, PartialEq)]
struct WetLook {
    class: u8,
    /// Share of the ground that is lower, in [`LOWER`] steps.
    lower: u8,
    albedo: [u8; 3],
    /// [`IN_POND`] and [`MIRRORS`].
    flags: u8,
}

/// Flags of [`WetLook`]: the splat may lie under a puddle, and may mirror the sky.
const IN_POND: u8 = 1;
const MIRRORS: u8 = 2;
/// The look of what stays as it is.
const STAYS: WetLook = WetLook { class: DRY, lower: 0, albedo: [0; 3], flags: 0 };

/// The shares of a slanted rain that reach surfaces and ground.
#[derive(Clone, Debug, PartialEq)]
pub struct WetShares {
    /// The rain.
    pub rain: SlantedRain,
    /// One for each splat.
    looks: Vec<WetLook>,
    /// The share of each cell of the ground or of open water, 0-1; 0 where there is neither.
    pub(crate) ground: Vec<f32>,
}

impl WetShares {
    /// The shares under a shelter map of the rain's direction; `None` to ignore what stands above.
    #[must_use]
    pub fn of(surfaces: &WetSurfaces, rain: &SlantedRain, shelter: Option<&Shelter>, site: &Site) -> Self {
        let looks = map(surfaces.len(), |index| {
            let splat = &surfaces.splats[index];
            let class = surfaces.class(splat, rain, shelter, site);
            let is_steep = (SHARES as u8..2 * SHARES as u8).contains(&class);
            let mirrors = if is_steep && splat.skyline != NO_SKY { MIRRORS } else { 0 };
            let in_pond = if splat.pond != NO_BASIN { IN_POND } else { 0 };
            WetLook { class, lower: splat.lower, albedo: splat.albedo, flags: mirrors | in_pond }
        });
        let map_of_ground = &surfaces.ground;
        let [columns, _] = map_of_ground.size();
        let ground = map(map_of_ground.ground.len(), |at| {
            let height = map_of_ground.surface(at, map_of_ground.ground[at]);
            if height.is_nan() {
                return 0.0;
            }
            let middle = [(at % columns) as f64 + 0.5, (at / columns) as f64 + 0.5];
            let point = map_of_ground.point(middle, f64::from(height + LIFT)).map(|v| v as f32);
            shelter.map_or(1.0, |shelter| shelter.exposure(point, SOFT[1]))
        });
        Self { rain: *rain, looks, ground }
    }
}

/// The look of the wet splats of a scene at one instant: factors on their light, and fades
/// ([`Attribute::Fade`]).
#[derive(Clone, Debug)]
pub struct WetGains<'a> {
    surfaces: &'a WetSurfaces,
    shares: &'a WetShares,
    levels: &'a [f32],
    /// By class, and by the share of the ground that is lower.
    strengths: Box<[[Strength; LOWER]; CLASSES]>,
    /// Under deep water.
    deep: Strength,
    /// The changes by reflectance.
    table: Box<[[f32; 2]; STEPS]>,
    /// The sky that steep surfaces mirror, if an eye sees it.
    sheen: Option<SheenGains>,
}

/// The light that steep surfaces mirror, as a part of the factors on their own.
#[derive(Clone, Debug)]
struct SheenGains {
    sky: SkySheen,
    /// By the class of steep surfaces: the share that is wet, and the film in depths of the
    /// texture.
    wet: [[f32; 2]; SHARES],
    /// Reciprocal of the light of a display-referred value in 8 bits.
    inverse: Box<[f32; 256]>,
}

/// Strength of the change of a surface by water.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Strength {
    /// Shares of the change by full pores, and of that by a film, 0-1.
    pores: f32,
    film: f32,
    /// Share of what depends on the direction that is gone, 0-1.
    fade: f32,
}

impl Strength {
    fn mix(self, other: Self, share: f32) -> Self {
        let mix = |a: f32, b: f32| a + (b - a) * share;
        Self {
            pores: mix(self.pores, other.pores),
            film: mix(self.film, other.film),
            fade: mix(self.fade, other.fade),
        }
    }
}

impl<'a> WetGains<'a> {
    /// The look of surfaces in a state of water. `porosity` is a factor on the darkening, 0-1.
    #[must_use]
    pub fn new(surfaces: &'a WetSurfaces, shares: &'a WetShares, state: &'a WetState, porosity: f64) -> Self {
        let porosity = porosity as f32;
        let strengths = Box::new(std::array::from_fn(|class| {
            let (kind, bin) = (class / SHARES, class % SHARES);
            let (drainage, porosity) = match kind {
                0 => (Drainage::Level, porosity),
                1 => (Drainage::Steep, porosity),
                2 => (Drainage::Steep, LEAF_POROSITY * porosity),
                _ => return [Strength::default(); LOWER],
            };
            let share = MOST_SHARE * (bin as f64 / (SHARES - 1) as f64).powi(2);
            let wet = state.wet(drainage, share);
            std::array::from_fn(|step| {
                let lower = step as f32 / (LOWER - 1) as f32;
                let [pores, film] = match drainage {
                    Drainage::Level if !state.is_even() => relief::patchy([wet.pores, wet.film], lower),
                    _ => [wet.pores, wet.film],
                };
                let strength = porosity * pores;
                Strength { pores: strength * (1.0 - film), film: strength * film, fade: pores }
            })
        }));
        let deep = Strength { pores: 0.0, film: porosity, fade: 1.0 };
        let table = Box::new(optics::table());
        Self { surfaces, shares, levels: &state.levels, strengths, deep, table, sheen: None }
    }

    /// Adds the sky that steep surfaces mirror. `state` is the water, on a texture of mean depth
    /// `texture`, mm.
    #[must_use]
    pub fn with_sheen(mut self, sky: SkySheen, state: &WetState, texture: f64) -> Self {
        let wet = std::array::from_fn(|bin| {
            let share = MOST_SHARE * (bin as f64 / (SHARES - 1) as f64).powi(2);
            let wet = state.wet(Drainage::Steep, share);
            [wet.pores, wet.film + wet.depth / texture as f32]
        });
        let inverse = Box::new(std::array::from_fn(|value| {
            (1.0 / srgb_decode(value as f64 / 255.0).max(DARKEST)) as f32
        }));
        self.sheen = Some(SheenGains { sky, wet, inverse });
        self
    }

    /// The sky that a steep splat mirrors, as an addition to the factors on its light; `None` for
    /// no mirrored sky.
    #[inline]
    fn mirrored(&self, index: usize, class: u8) -> Option<[f32; 3]> {
        let SheenGains { sky, wet, inverse } = self.sheen.as_ref()?;
        let [share, film] = wet[usize::from(class) - SHARES];
        if share <= 0.0 {
            return None;
        }
        let splat = &self.surfaces.splats[index];
        let normal = Vec3::from_array(splat.normal.map(f32::from)) / 127.0;
        let light = sky.light(Vec3::from_array(splat.point), normal, film, splat.skyline);
        Some(std::array::from_fn(|k| share * light[k] * inverse[usize::from(splat.color[k])]))
    }

    /// Multiplies the gains of splats, and writes their fade.
    pub fn fill_light(&self, indices: &[u32], block: &mut AttributeBlock) {
        // All at once: they lie anywhere in memory.
        let mut looks = [STAYS; AttributeBlock::SPLATS];
        for (look, index) in looks.iter_mut().zip(indices) {
            // What pads the last group has no splat.
            *look = self.shares.looks.get(*index as usize).copied().unwrap_or(STAYS);
        }
        let mut fades = [0.0; AttributeBlock::SPLATS];
        let [red, green, blue] = block.gains_mut();
        let rows = red.iter_mut().zip(green).zip(blue).zip(&mut fades);
        for ((index, look), (((red, green), blue), fade)) in indices.iter().zip(&looks).zip(rows) {
            if look.class == DRY {
                continue;
            }
            let strength = self.strength_of(*index as usize, look);
            let [r, g, b] = self.gain(strength, look.albedo);
            (*red, *green, *blue, *fade) = (*red * r, *green * g, *blue * b, strength.fade);
            if look.flags & MIRRORS != 0
                && let Some([r, g, b]) = self.mirrored(*index as usize, look.class)
            {
                (*red, *green, *blue) = (*red + r, *green + g, *blue + b);
            }
        }
        block.column_mut(Attribute::Fade)[..indices.len()].copy_from_slice(&fades[..indices.len()]);
    }

    /// The strength of the change of a splat, and its reflectance; `None` for one that stays as it
    /// is.
    fn strength(&self, index: usize) -> Option<(Strength, [u8; 3])> {
        let look = self.shares.looks.get(index).filter(|look| look.class != DRY)?;
        Some((self.strength_of(index, look), look.albedo))
    }

    /// The strength of the change of a splat that does not stay as it is.
    #[inline(always)]
    fn strength_of(&self, index: usize, look: &WetLook) -> Strength {
        let strength = self.strengths[usize::from(look.class)][usize::from(look.lower)];
        if look.flags & IN_POND == 0 {
            return strength;
        }
        let pond = &self.surfaces.ponds[self.surfaces.splats[index].pond as usize];
        let covered = ((self.levels[pond.basin as usize] - pond.height) / EDGE).clamp(0.0, 1.0);
        strength.mix(self.deep, covered)
    }

    /// Returns the shares of a splat's surface whose pores are full of water without a film, and
    /// that lie under a film, 0-1; `None` for one that stays as it is. Both have the factor
    /// `porosity` of [`Self::new`].
    #[must_use]
    pub fn shares(&self, index: usize) -> Option<[f32; 2]> {
        self.strength(index).map(|(strength, _)| [strength.pores, strength.film])
    }

    /// The factors on the light of a surface.
    #[inline]
    fn gain(&self, strength: Strength, albedo: [u8; 3]) -> [f32; 3] {
        albedo.map(|albedo| {
            let [by_pores, by_film] = self.table[usize::from(albedo)];
            1.0 + strength.pores * by_pores + strength.film * by_film
        })
    }

    /// Changes splats to what they look like wet, for programs that know no gains.
    pub fn apply(&self, splats: &mut Splats) {
        let looks: Vec<_> =
            (0..splats.len().min(self.surfaces.len())).map(|index| self.strength(index)).collect();
        let gains: Vec<[f32; 3]> =
            looks.iter().map(|look| look.map_or([1.0; 3], |(wet, albedo)| self.gain(wet, albedo))).collect();
        let stride = splats.sh_stride();
        for (index, look) in looks.iter().enumerate() {
            let kept = 1.0 - look.map_or(0.0, |(wet, _)| wet.fade);
            let sh = &mut splats.sh[index * stride..(index + 1) * stride];
            sh.iter_mut().skip(3).for_each(|v| *v *= kept);
        }
        apply_gains(&gains, splats);
    }
}
