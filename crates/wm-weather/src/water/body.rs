//! Water that has depth: what is seen through it, and its own light.

/// `(c + K_d) Z` where a white disc goes out of sight at the Secchi depth `Z` (Tyler 1968).
const SECCHI: f64 = 8.69;
/// Share of `c + K_d` that is beam attenuation: the rest is that of daylight on its way down. Of turbid inland water.
const BEAM: f64 = 0.75;
/// Share of upward radiance under the surface that gets out, times the share of daylight that gets in.
const OUT: f64 = 0.54;
/// Secchi depths of brown and of clear water, m, with their irradiance reflectances and tints.
const KINDS: [(f64, f64, [f64; 3]); 2] = [(0.1, 0.08, [1.0, 0.8, 0.55]), (10.0, 0.02, [0.55, 0.9, 1.0])];

/// Water as a volume.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaterBody {
    /// Beam attenuation, 1/m.
    pub beam: f32,
    /// Attenuation of daylight on its way down, 1/m.
    pub daylight: f32,
    /// Radiance that comes out of endlessly deep water in clear air, linear RGB.
    pub glow: [f32; 3],
}

impl WaterBody {
    /// Water of a Secchi depth, m, under daylight that gives a white level board the radiance `white`, linear RGB. Its colour
    /// is `tint` (linear RGB, the largest 1), or that of its clearness.
    #[must_use]
    pub fn new(secchi: f64, tint: Option<[f64; 3]>, white: [f64; 3]) -> Self {
        let [(brown, strong, dull), (clear, weak, blue)] = KINDS;
        let share = ((secchi / brown).ln() / (clear / brown).ln()).clamp(0.0, 1.0);
        let between = |from: f64, to: f64| from + (to - from) * share;
        let reflectance = between(strong, weak);
        let tint = tint.unwrap_or_else(|| std::array::from_fn(|k| between(dull[k], blue[k])));
        let both = SECCHI / secchi;
        Self {
            beam: (BEAM * both) as f32,
            daylight: ((1.0 - BEAM) * both) as f32,
            glow: std::array::from_fn(|k| (OUT * reflectance * tint[k] * white[k]) as f32),
        }
    }

    /// The share of a bottom's light that is left after `path` metres in water, under water `depth` metres deep.
    #[inline(always)]
    #[must_use]
    pub fn left(&self, path: f32, depth: f32) -> f32 {
        (-(self.beam * path + self.daylight * depth)).exp()
    }
}
