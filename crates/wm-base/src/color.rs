//! Conversion between display-referred colours, which splats hold, and linear light, which weather
//! needs.

/// sRGB to linear light, IEC 61966-2-1; extended above 1, 0 below 0.
#[must_use]
pub fn srgb_decode(value: f64) -> f64 {
    if value <= 0.040_45 { value.max(0.0) / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// Linear light to sRGB, IEC 61966-2-1; extended above 1, 0 below 0.
#[must_use]
pub fn srgb_encode(value: f64) -> f64 {
    if value <= 0.003_130_8 { value.max(0.0) * 12.92 } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}

/// Luminance of a linear RGB colour with the primaries of sRGB, ITU-R BT.709.
#[must_use]
pub fn luminance(rgb: [f64; 3]) -> f64 {
    0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn decode_undoes_encode(v in 0.0..4.0f64) {
            prop_assert!((srgb_decode(srgb_encode(v)) - v).abs() < 1e-6);
        }
    }

    #[test]
    fn points_of_the_standard() {
        // Mid grey, and the join of line and power.
        assert!((srgb_decode(0.5) - 0.214_041_140_482_232_55).abs() < 1e-15);
        assert!((srgb_decode(0.040_45) - 0.003_130_804_953_560_371).abs() < 1e-15);
    }

    #[test]
    fn white_and_black_stay() {
        assert_eq!(srgb_encode(0.0), 0.0);
        assert!((srgb_encode(1.0) - 1.0).abs() < 1e-12);
        assert_eq!(srgb_decode(-0.5), 0.0);
        assert!((luminance([1.0; 3]) - 1.0).abs() < 1e-12);
    }
}
