//! The look of wet surfaces: factors on their light.

use super::column::{Drainage, MAX_RAIN_SHARE};
use super::optics::{self, ALBEDO_STEP_COUNT};
use super::relief;
use super::sheen::SkySheen;
use super::state::WetState;
use super::surfaces::{
    DRY_CLASS, IN_POND, LOWER_SHARE_COUNT, MIRRORS, RAIN_SHARE_BIN_COUNT, WetLook, WetShares, WetSurfaces,
};
use crate::light::apply_gains;
use glam::Vec3;
use wm_base::color::srgb_decode;
use wm_render::hooks::{Attribute, AttributeBlock};
use wm_scene::Splats;

/// Depth over which the edge of a puddle goes over into the ground.
const PUDDLE_EDGE_DEPTH_M: f32 = 0.002;
/// Least light of a surface over which the sky that it mirrors is a factor.
const MIN_SURFACE_LIGHT: f64 = 2e-3;
/// The classes of surfaces.
const CLASS_COUNT: usize = DRY_CLASS as usize + 1;
/// Porosity of leaves.
const LEAF_POROSITY: f32 = 0.3;
/// The look of what stays as it is.
const DRY_LOOK: WetLook = WetLook { class: DRY_CLASS, lower: 0, albedo: [0; 3], flags: 0 };

/// The look of the wet splats of a scene at one instant: factors on their light, and fades
/// ([`Attribute::Fade`]).
#[derive(Clone, Debug)]
pub struct WetGains<'a> {
    surfaces: &'a WetSurfaces,
    shares: &'a WetShares,
    levels: &'a [f32],
    /// Strengths by class, and by the share of the ground that is lower.
    strengths: Box<[[Strength; LOWER_SHARE_COUNT]; CLASS_COUNT]>,
    /// Strength under deep water.
    deep: Strength,
    /// The changes by reflectance.
    table: Box<[[f32; 2]; ALBEDO_STEP_COUNT]>,
    /// The sky that steep surfaces mirror, if an eye sees it.
    sheen: Option<SheenGains>,
}

/// The light that steep surfaces mirror, as a part of the factors on their own.
#[derive(Clone, Debug)]
struct SheenGains {
    sky: SkySheen,
    /// Wet share, and film in depths of the texture, by the class of steep surfaces.
    wet: [[f32; 2]; RAIN_SHARE_BIN_COUNT],
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
            let (kind, bin) = (class / RAIN_SHARE_BIN_COUNT, class % RAIN_SHARE_BIN_COUNT);
            let (drainage, porosity) = match kind {
                0 => (Drainage::Level, porosity),
                1 => (Drainage::Steep, porosity),
                2 => (Drainage::Steep, LEAF_POROSITY * porosity),
                _ => return [Strength::default(); LOWER_SHARE_COUNT],
            };
            let share = MAX_RAIN_SHARE * (bin as f64 / (RAIN_SHARE_BIN_COUNT - 1) as f64).powi(2);
            let wet = state.wet(drainage, share);
            std::array::from_fn(|step| {
                let lower = step as f32 / (LOWER_SHARE_COUNT - 1) as f32;
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
            let share = MAX_RAIN_SHARE * (bin as f64 / (RAIN_SHARE_BIN_COUNT - 1) as f64).powi(2);
            let wet = state.wet(Drainage::Steep, share);
            [wet.pores, wet.film + wet.depth / texture as f32]
        });
        let inverse = Box::new(std::array::from_fn(|value| {
            (1.0 / srgb_decode(value as f64 / 255.0).max(MIN_SURFACE_LIGHT)) as f32
        }));
        self.sheen = Some(SheenGains { sky, wet, inverse });
        self
    }

    /// The sky that a steep splat mirrors, as an addition to the factors on its light; `None` for
    /// no mirrored sky.
    #[inline]
    fn mirrored(&self, index: usize, class: u8) -> Option<[f32; 3]> {
        let SheenGains { sky, wet, inverse } = self.sheen.as_ref()?;
        let [share, film] = wet[usize::from(class) - RAIN_SHARE_BIN_COUNT];
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
        let mut looks = [DRY_LOOK; AttributeBlock::MAX_SPLATS];
        for (look, index) in looks.iter_mut().zip(indices) {
            // What pads the last group has no splat.
            *look = self.shares.looks.get(*index as usize).copied().unwrap_or(DRY_LOOK);
        }
        let mut fades = [0.0; AttributeBlock::MAX_SPLATS];
        let [red, green, blue] = block.gains_mut();
        let rows = red.iter_mut().zip(green).zip(blue).zip(&mut fades);
        for ((index, look), (((red, green), blue), fade)) in indices.iter().zip(&looks).zip(rows) {
            if look.class == DRY_CLASS {
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
        let look = self.shares.looks.get(index).filter(|look| look.class != DRY_CLASS)?;
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
        let covered =
            ((self.levels[pond.basin as usize] - pond.height) / PUDDLE_EDGE_DEPTH_M).clamp(0.0, 1.0);
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
