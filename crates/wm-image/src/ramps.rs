//! Colours for numbers, sRGB.

/// A colour for a number in 0-1.
pub type ColorRamp = fn(f64) -> [u8; 3];

fn bytes(rgb: [f64; 3]) -> [u8; 3] {
    rgb.map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8)
}

/// Depth: red for 0, blue for 1. The polynomial that Google published for its colour map Turbo (A.
/// Mikhailov, R. Du, 2019, Apache-2.0), the other way round: near things are warm.
pub fn turbo(t: f64) -> [u8; 3] {
    const POLYNOMIALS: [[f64; 6]; 3] = [
        [0.13572138, 4.61539260, -42.66032258, 132.13108234, -152.94239396, 59.28637943],
        [0.09140261, 2.19418839, 4.84296658, -14.18503333, 4.27729857, 2.82956604],
        [0.10667330, 12.64194608, -60.58204836, 110.36276771, -89.90310912, 27.34824973],
    ];
    // The ends are nearly black, which pixels without depth are on a dark page.
    let t = 0.05 + 0.9 * (1.0 - t.clamp(0.0, 1.0));
    bytes(POLYNOMIALS.map(|powers| powers.iter().rev().fold(0.0, |sum, power| sum * t + power)))
}

/// Errors without a sign: black, red, yellow, white, each channel a third of the way.
pub fn heat(t: f64) -> [u8; 3] {
    let t = 3.0 * t.clamp(0.0, 1.0);
    bytes([t, t - 1.0, t - 2.0])
}

/// Errors with a sign: blue for 0, white in the middle, red for 1.
pub fn signed(t: f64) -> [u8; 3] {
    const END_COLORS: [[f64; 3]; 2] = [[0.10, 0.30, 0.75], [0.80, 0.10, 0.12]];
    let t = 2.0 * t.clamp(0.0, 1.0) - 1.0;
    let end = END_COLORS[usize::from(t > 0.0)];
    bytes(end.map(|end| 0.97 + (end - 0.97) * t.abs()))
}

/// Colour of pixels that have no value, or whose value is not known.
pub const UNKNOWN_COLOR: [u8; 3] = [128, 128, 128];
/// Colour of pixels whose value is known, but was not rendered.
pub const MISSING_COLOR: [u8; 3] = [230, 40, 220];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_are_as_they_are_said() {
        let [near, far] = [turbo(0.0), turbo(1.0)];
        assert!(near[0] > 150 && near[2] < 60 && far[2] > far[0], "{near:?} {far:?}");
        assert_eq!([heat(0.0), heat(1.0 / 3.0), heat(1.0)], [[0; 3], [255, 0, 0], [255; 3]]);
        assert_eq!(signed(0.5), [247; 3]);
        assert!(signed(0.0)[2] > 180 && signed(1.0)[0] > 180);
        assert_eq!(signed(f64::NEG_INFINITY), signed(0.0));
    }
}
