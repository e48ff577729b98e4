//! From linear radiance to display values.
//!
//! `display = encode(shoulder(exposure * radiance))`, each channel alone. The shoulder is straight
//! up to 0.55 and bends from there towards 1 as `1 - exp` does, with equal value and slope where
//! the two meet: nothing clips, and what lies below keeps its contrast. `encode` is the sRGB curve.

/// Factor of radiance.
const EXPOSURE_FACTOR: f64 = 0.84;
/// The value at which the shoulder begins.
const KNEE: f64 = 0.55;

/// Display-referred sRGB, 0 to 1, of linear radiance (0 and above).
#[must_use]
pub fn display_of(radiance: [f64; 3]) -> [f64; 3] {
    radiance.map(|v| encode(shoulder(EXPOSURE_FACTOR * v.max(0.0))))
}

/// Linear display light, 0 to 1: [`display_of`] without the sRGB curve.
#[must_use]
pub fn exposed(radiance: [f64; 3]) -> [f64; 3] {
    radiance.map(|v| shoulder(EXPOSURE_FACTOR * v.max(0.0)))
}

fn shoulder(value: f64) -> f64 {
    if value <= KNEE {
        return value;
    }
    KNEE + (1.0 - KNEE) * (1.0 - (-(value - KNEE) / (1.0 - KNEE)).exp())
}

fn encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_is_smooth_rising_and_never_clips() {
        let mut last = -1.0;
        for step in 0..400 {
            let value = f64::from(step) * 0.02;
            let shown = display_of([value; 3])[0];
            assert!(shown > last && shown < 1.0);
            last = shown;
        }
        let slope = (shoulder(KNEE + 1e-6) - shoulder(KNEE - 1e-6)) / 2e-6;
        assert!((slope - 1.0).abs() < 1e-4);
    }
}
