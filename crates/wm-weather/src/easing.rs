//! Easings between keyframes.

use crate::param::meant;

/// The way from a key to the next. With `s` the share of the time between the two that has passed,
/// 0-1, and `f(s)` the share of the way that is done:
///
/// | easing | `f(s)` | speed |
/// |---|---|---|
/// | `linear` | `s` | the same all the way |
/// | `hold` | `0` | none: the value jumps at the next key |
/// | `smooth` | `s^2 (3 - 2 s)` | 0 at both keys, 1.5 times the mean in the middle |
/// | `ease-in` | `s^2` | from 0 to twice the mean |
/// | `ease-out` | `s (2 - s)` | from twice the mean to 0 |
///
/// None goes backwards or beyond its keys.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Easing {
    /// Evenly.
    #[default]
    Linear,
    /// Not at all until the next key.
    Hold,
    /// Slow at both ends (smoothstep).
    Smooth,
    /// Slow at first (quadratic).
    EaseIn,
    /// Slow at last (quadratic).
    EaseOut,
}

impl Easing {
    /// Every easing.
    pub const ALL: [Self; 5] = [Self::Linear, Self::Hold, Self::Smooth, Self::EaseIn, Self::EaseOut];

    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Hold => "hold",
            Self::Smooth => "smooth",
            Self::EaseIn => "ease-in",
            Self::EaseOut => "ease-out",
        }
    }

    /// The easing of a name.
    ///
    /// # Errors
    /// That there is none, with the nearest name, to be put after the parameter's name.
    pub fn parse(text: &str) -> Result<Self, String> {
        let text = text.trim();
        Self::ALL.into_iter().find(|easing| easing.name() == text).ok_or_else(|| {
            let near = meant(text, Self::ALL.into_iter().map(Self::name));
            let all = Self::ALL.map(Self::name).join(", ");
            format!("has the easing `{text}`{near}; the easings are {all}")
        })
    }

    /// Share of the way that is done, 0-1, after the share `s` of the time, 0-1.
    #[must_use]
    pub fn share(self, s: f64) -> f64 {
        match self {
            Self::Linear => s,
            Self::Hold => 0.0,
            Self::Smooth => s * s * (3.0 - 2.0 * s),
            Self::EaseIn => s * s,
            Self::EaseOut => s * (2.0 - s),
        }
    }

    /// Integral of [`Self::share`] from 0 to `s`, 0-1.
    #[must_use]
    pub fn integral(self, s: f64) -> f64 {
        match self {
            Self::Linear => s * s / 2.0,
            Self::Hold => 0.0,
            Self::Smooth => s * s * s * (1.0 - s / 2.0),
            Self::EaseIn => s * s * s / 3.0,
            Self::EaseOut => s * s * (1.0 - s / 3.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ways_begin_and_end_at_their_keys_and_never_turn_back() {
        for easing in Easing::ALL {
            assert_eq!(easing.share(0.0), 0.0);
            let end = if easing == Easing::Hold { 0.0 } else { 1.0 };
            assert_eq!(easing.share(1.0), end, "{}", easing.name());
            let shares: Vec<f64> = (0..=1000).map(|i| easing.share(f64::from(i) / 1000.0)).collect();
            assert!(shares.windows(2).all(|pair| pair[1] >= pair[0]), "{}", easing.name());
        }
    }

    /// Values worked out by hand, so that two easings cannot be exchanged.
    #[test]
    fn each_has_its_own_form() {
        for (easing, share, integral) in [
            (Easing::Linear, 0.25, 0.031_25),
            (Easing::Hold, 0.0, 0.0),
            (Easing::Smooth, 0.156_25, 0.013_671_875),
            (Easing::EaseIn, 0.0625, 0.015_625 / 3.0),
            (Easing::EaseOut, 0.4375, 0.0625 - 0.015_625 / 3.0),
        ] {
            assert_eq!(easing.share(0.25), share, "{}", easing.name());
            assert!((easing.integral(0.25) - integral).abs() < 1e-16, "{}", easing.name());
        }
    }

    /// Derivatives of the integrals by central differences, whose error is below h^2 times the
    /// third derivative of the integral, 6 at most, over 6.
    #[test]
    fn integrals_are_those_of_the_shares() {
        let h = 1e-4;
        for easing in Easing::ALL {
            assert_eq!(easing.integral(0.0), 0.0);
            for i in 1..100 {
                let s = f64::from(i) / 100.0;
                let slope = (easing.integral(s + h) - easing.integral(s - h)) / (2.0 * h);
                assert!((slope - easing.share(s)).abs() < 1.1e-8, "{} at {s}", easing.name());
            }
        }
    }

    #[test]
    fn names_are_read_and_misspelt_ones_get_their_nearest() {
        for easing in Easing::ALL {
            assert_eq!(Easing::parse(&format!(" {} ", easing.name())), Ok(easing));
        }
        let all = "the easings are linear, hold, smooth, ease-in, ease-out";
        let near = format!("has the easing `easein`, did you mean `ease-in`?; {all}");
        assert_eq!(Easing::parse("easein").unwrap_err(), near);
        assert_eq!(Easing::parse("bounce").unwrap_err(), format!("has the easing `bounce`; {all}"));
    }
}
