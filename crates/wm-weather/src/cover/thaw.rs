//! Melting of snow at different paces in sun and shade.
//!
//! Where the share `s` of what falls on open level ground comes to lie, and `f` of what can melt
//! there melts (the whole in the open, half in full shade), `s` times as much is left as of a pack
//! on open level ground that melts `f / s` times as fast, its *pace*: both sides of the balance,
//! what falls and what melts, are `s` times as much. So packs at some paces tell what is left at
//! every place, in a drift in the shade as in a dusting in the sun, whatever has fallen and melted
//! when. Each is a pure function of time without a jump, and so is what is mixed of two of them.

/// Paces that are kept, from a deep drift in the shade to next to nothing in the sun; narrow where
/// most places are.
pub(crate) const MELT_PACES: [f64; PACE_COUNT] = [
    0.0625, 0.09, 0.125, 0.18, 0.25, 0.3, 0.36, 0.43, 0.5, 0.55, 0.6, 0.67, 0.75, 0.82, 0.9, 1.0, 1.1, 1.25,
    1.5, 2.0, 3.0, 6.0,
];
const PACE_COUNT: usize = 22;
/// Melt rate in full shade, as a share of that in the open.
const SHADE_MELT_SHARE: f32 = 0.5;

/// The depth that is left on level ground at each of [`MELT_PACES`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thaw {
    /// Depth, m.
    pub(crate) depth: [f32; PACE_COUNT],
    /// Water on the ground against what makes it quite wet, 0 and more.
    pub(crate) wet: [f32; PACE_COUNT],
}

/// The cover that is left at a place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct CoverState {
    /// Depth, m.
    pub(crate) depth: f32,
    /// Wetness of the ground, 0-1.
    pub(crate) wet: f32,
}

impl Thaw {
    /// Removes the water from the ground.
    pub(crate) fn dry(self) -> Self {
        Self { wet: [0.0; PACE_COUNT], ..self }
    }

    /// Returns true if nothing is left, not even wet ground.
    pub(crate) fn is_over(&self) -> bool {
        self.depth.iter().chain(&self.wet).all(|left| *left <= 0.0)
    }

    /// Returns the depth where it melts the slowest, m: sliding uses it, since what has slid does
    /// not go back when it melts.
    pub(crate) fn deepest(&self) -> f64 {
        f64::from(self.depth[0])
    }

    /// Returns the state of a place where `share` of the fall on open level ground came to lie, lit
    /// by `shade`, 0 to 1.
    pub(crate) fn at(&self, share: f32, shade: f32) -> CoverState {
        if share <= 0.0 {
            return CoverState::default();
        }
        let (above, part) = place_of((SHADE_MELT_SHARE + (1.0 - SHADE_MELT_SHARE) * shade) / share);
        let mix = |values: &[f32; PACE_COUNT]| {
            share * (values[above - 1] + (values[above] - values[above - 1]) * part)
        };
        CoverState { depth: mix(&self.depth), wet: mix(&self.wet).min(1.0) }
    }
}

/// The place of a pace among [`MELT_PACES`]: the next one above it, and the share of the way to
/// that from the one below.
fn place_of(pace: f32) -> (usize, f32) {
    let [first, last] = [MELT_PACES[0], MELT_PACES[PACE_COUNT - 1]].map(|pace| pace as f32);
    let pace = pace.clamp(first, last);
    let above = MELT_PACES.partition_point(|known| (*known as f32) < pace).max(1);
    let [low, high] = [MELT_PACES[above - 1], MELT_PACES[above]].map(|pace| pace as f32);
    (above, (pace - low) / (high - low))
}

/// Melt water and bare ground until an instant, at each of [`MELT_PACES`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MeltSample {
    /// All that has melted until then where all of the fall comes to lie, mm.
    pub(crate) melted: [f64; PACE_COUNT],
    /// Share of the ground that nothing lies on, 0-1.
    pub(crate) bare: [f64; PACE_COUNT],
}

impl MeltSample {
    /// Nothing has fallen yet.
    pub(crate) const NONE: Self = Self { melted: [0.0; PACE_COUNT], bare: [1.0; PACE_COUNT] };

    /// Returns what has melted, mm, and the bare share of the ground, at a place where `share` of
    /// the fall on open level ground came to lie. A place that less falls on is taken to lie in the
    /// shade of what keeps the fall off: as much less melts there.
    pub(crate) fn at(&self, share: f64) -> [f64; 2] {
        if share <= 0.0 {
            return [0.0, 1.0];
        }
        let shaded = f64::from(SHADE_MELT_SHARE);
        let (above, part) = place_of(((shaded + (1.0 - shaded) * share) / share) as f32);
        let mix = |values: &[f64; PACE_COUNT]| {
            values[above - 1] + (values[above] - values[above - 1]) * f64::from(part)
        };
        [share * mix(&self.melted), mix(&self.bare)]
    }

    /// Returns the sample at a share of the way from one to another, 0-1.
    pub(crate) fn between(&self, other: &Self, part: f64) -> Self {
        let mix = |a: &[f64; PACE_COUNT], b: &[f64; PACE_COUNT]| {
            std::array::from_fn(|k| a[k] + (b[k] - a[k]) * part)
        };
        Self { melted: mix(&self.melted, &other.melted), bare: mix(&self.bare, &other.bare) }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Place of the pace of open level ground.
    pub(crate) const OPEN_GROUND_PACE: usize = 15;

    impl Thaw {
        /// Builds the state of a depth that fell at once, of which `melts` could have melted in the
        /// open since, m.
        pub(crate) fn new(depth: f64, melts: f64, wet: f64) -> Self {
            Self {
                depth: MELT_PACES.map(|pace| (depth - pace * melts).max(0.0) as f32),
                wet: MELT_PACES.map(|pace| if pace * melts > 0.0 { wet as f32 } else { 0.0 }),
            }
        }
    }

    #[test]
    fn paces_rise_and_the_open_is_one_of_them() {
        assert!(MELT_PACES.windows(2).all(|pair| pair[0] < pair[1]));
        assert_eq!(MELT_PACES[OPEN_GROUND_PACE], 1.0);
        let thaw = Thaw::new(0.1, 0.04, 1.0);
        assert!((thaw.at(1.0, 1.0).depth - 0.06).abs() < 1e-6);
        // In full shade half as much, and a drift of twice the depth loses no more than level snow.
        assert!((thaw.at(1.0, 0.0).depth - 0.08).abs() < 1e-6);
        assert!((thaw.at(2.0, 1.0).depth - 0.16).abs() < 1e-6);
        assert_eq!(thaw.at(0.0, 1.0), CoverState::default());
    }

    proptest! {
        /// Against the balance of the place itself: what came to lie there less what melts there.
        #[test]
        fn a_place_has_what_it_got_less_what_melts_there(
            share in 0.1..4.0f32,
            shade in 0.0..1.0f32,
            melts in 0.0..0.5f64,
        ) {
            let left = Thaw::new(0.1, melts, 1.0).at(share, shade);
            let own = (0.1 * share - melts as f32 * (0.5 + 0.5 * shade)).max(0.0);
            // Paces lie up to a quarter apart about where the last of it melts, and farther for
            // thin snow.
            let apart = if share > 0.5 { 0.012 } else { 0.03 };
            prop_assert!(left.depth >= own - 1e-6 && left.depth - own < apart * share, "{left:?} {own}");
            // It does melt, within half as long again.
            if melts as f32 * (0.5 + 0.5 * shade) > 0.1 * share * 2.0 {
                prop_assert_eq!(left.depth, 0.0);
            }
        }
    }
}
