//! Water that has depth: what is seen through it, and its own light.

use super::foam;

/// `(c + K_d) Z` where a white disc goes out of sight at the Secchi depth `Z` (Tyler 1968).
const SECCHI_CONSTANT: f64 = 8.69;
/// Share of `c + K_d` that is beam attenuation: the rest is that of daylight on its way down. Of
/// turbid inland water.
const BEAM_ATTENUATION_SHARE: f64 = 0.75;
/// Light that comes out of deep water over that of a white level board (water-leaving reflectance,
/// pi L / E), linear RGB, by Secchi depth, m: brown floods and estuaries (Doxaran et al. 2002, Luo
/// et al. 2018: 0.03 to 0.06 a sr in red where much is suspended), lakes and the sea.
const WATER_KINDS: [(f64, [f64; 3]); 6] = [
    (0.05, [0.19, 0.145, 0.08]),
    (0.1, [0.17, 0.135, 0.075]),
    (0.3, [0.125, 0.105, 0.06]),
    (1.0, [0.04, 0.05, 0.03]),
    (3.0, [0.008, 0.02, 0.018]),
    (10.0, [0.002, 0.008, 0.018]),
];

/// Water as a volume.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaterBody {
    /// Beam attenuation, 1/m.
    pub(crate) beam: f32,
    /// Attenuation of daylight on its way down, 1/m.
    pub(crate) daylight: f32,
    /// Radiance that comes out of endlessly deep water in clear air, linear RGB.
    pub(crate) glow: [f32; 3],
    /// Radiance of foam on it in clear air, linear RGB.
    pub(crate) foam: [f32; 3],
}

/// The reflectance of deep water of a Secchi depth, m: between [`WATER_KINDS`], even in logarithms.
fn reflectance(secchi: f64) -> [f64; 3] {
    let after = WATER_KINDS.partition_point(|(depth, _)| *depth < secchi).clamp(1, WATER_KINDS.len() - 1);
    let [(low, from), (high, to)] = [WATER_KINDS[after - 1], WATER_KINDS[after]];
    let share = ((secchi / low).ln() / (high / low).ln()).clamp(0.0, 1.0);
    std::array::from_fn(|k| from[k] * (to[k] / from[k]).powf(share))
}

impl WaterBody {
    /// Water of a Secchi depth, m, under daylight that gives a white level board the radiance
    /// `white`, linear RGB. Its colour is `tint` (linear RGB, the largest 1), or that of its
    /// clearness.
    pub(crate) fn new(secchi: f64, tint: Option<[f64; 3]>, white: [f64; 3]) -> Self {
        let own = reflectance(secchi);
        let reflectance = match tint {
            Some(tint) => tint.map(|v| v * own.into_iter().fold(0.0, f64::max)),
            None => own,
        };
        let both = SECCHI_CONSTANT / secchi;
        Self {
            beam: (BEAM_ATTENUATION_SHARE * both) as f32,
            daylight: ((1.0 - BEAM_ATTENUATION_SHARE) * both) as f32,
            glow: std::array::from_fn(|k| (reflectance[k] * white[k]) as f32),
            foam: white.map(|light| (foam::FOAM_REFLECTANCE * light) as f32),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Brown water is brightest in red, the sea in blue, and the more floats in it the brighter it
    /// is.
    #[test]
    fn the_colour_is_that_of_its_clearness() {
        let glow = |secchi: f64| WaterBody::new(secchi, None, [1.0; 3]).glow;
        let [brown, lake, sea] = [0.1, 1.0, 30.0].map(glow);
        assert!(
            brown[0] > brown[1] && brown[1] > 1.5 * brown[2] && (0.15..0.2).contains(&brown[0]),
            "{brown:?}"
        );
        assert!(
            lake[1] > lake[0] && lake[1] > lake[2] && sea[2] > sea[1] && sea[1] > sea[0],
            "{lake:?} {sea:?}"
        );
        for pair in [0.02, 0.05, 0.07, 0.2, 0.5, 2.0, 8.0, 60.0].windows(2) {
            let [a, b] = [0, 1].map(|i| glow(pair[i]));
            assert!(a[0] >= b[0] && a[1] >= b[1], "{pair:?}");
        }
        let green = WaterBody::new(0.1, Some([0.0, 1.0, 0.0]), [1.0; 3]).glow;
        assert!(green[0] == 0.0 && green[1] == brown[0]);
    }
}
