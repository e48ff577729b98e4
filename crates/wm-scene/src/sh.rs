//! Real spherical harmonics to degree 3, in the order and signs of the 3DGS files.
//!
//! A splat's colour towards a viewer is `0.5 + sum_k basis_k(direction) * sh_k`, clamped at 0,
//! where `direction` runs from the camera centre to the splat in world axes. The result is
//! display-referred (sRGB-encoded), since that is what scenes are trained on.

/// Highest degree that the format stores.
pub const MAX_DEGREE: u8 = 3;

/// The constants of the basis functions, generated once for every back end.
pub const C0: f64 = 0.282_094_791_773_878_14;
/// Degree 1.
pub const C1: f64 = 0.488_602_511_902_919_9;
/// Degree 2.
pub const C2: [f64; 5] = [
    1.092_548_430_592_079_2,
    -1.092_548_430_592_079_2,
    0.315_391_565_252_520_05,
    -1.092_548_430_592_079_2,
    0.546_274_215_296_039_6,
];
/// Degree 3.
pub const C3: [f64; 7] = [
    -0.590_043_589_926_643_5,
    2.890_611_442_640_554,
    -0.457_045_799_464_465_8,
    0.373_176_332_590_115_4,
    -0.457_045_799_464_465_8,
    1.445_305_721_320_277,
    -0.590_043_589_926_643_5,
];

/// Nodes (cosines of the polar angle) and weights of Gauss-Legendre quadrature: with eight even
/// steps around they integrate products of two functions of degree 3 over the sphere exactly.
pub(crate) const QUADRATURE: [(f64, f64); 4] = [
    (-0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
    (-0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
    (0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
    (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
];

/// Number of coefficients a colour channel of `degree`: 1, 4, 9, 16.
#[must_use]
pub const fn coefficients(degree: u8) -> usize {
    (degree as usize + 1) * (degree as usize + 1)
}

/// The degree with `count` coefficients a channel, if there is one.
#[must_use]
pub(crate) fn degree_of(count: usize) -> Option<u8> {
    (0..=MAX_DEGREE).find(|degree| coefficients(*degree) == count)
}

/// The 16 basis functions at the unit vector `direction`.
#[must_use]
pub fn basis(direction: [f64; 3]) -> [f64; 16] {
    let [x, y, z] = direction;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        C0,
        -C1 * y,
        C1 * z,
        -C1 * x,
        C2[0] * x * y,
        C2[1] * y * z,
        C2[2] * (2.0 * zz - xx - yy),
        C2[3] * x * z,
        C2[4] * (xx - yy),
        C3[0] * y * (3.0 * xx - yy),
        C3[1] * x * y * z,
        C3[2] * y * (4.0 * zz - xx - yy),
        C3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        C3[4] * x * (4.0 * zz - xx - yy),
        C3[5] * z * (xx - yy),
        C3[6] * x * (xx - 3.0 * yy),
    ]
}

/// The display-referred colour of one splat, not clamped.
///
/// `sh` is `[K, 3]` flat, K as [`coefficients`] says for the scene's degree.
#[must_use]
pub fn color(sh: &[f32], direction: [f64; 3]) -> [f64; 3] {
    let basis = basis(direction);
    let mut rgb = [0.5; 3];
    for (coefficient, weight) in sh.chunks_exact(3).zip(basis) {
        for channel in 0..3 {
            rgb[channel] += weight * f64::from(coefficient[channel]);
        }
    }
    rgb
}

/// The degree-0 coefficient that shows `color` (display-referred, 0-1) from everywhere.
#[must_use]
pub fn dc_of(color: f64) -> f64 {
    (color - 0.5) / C0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The basis is orthonormal over the sphere: checked by a Fibonacci quadrature, whose error for
    /// polynomials of degree 6 at 20,000 points is far below the tolerance.
    #[test]
    fn basis_is_orthonormal() {
        let n = 20_000;
        let mut gram = [[0.0; 16]; 16];
        for i in 0..n {
            let b = basis(wm_base::linear::direction(i, n).to_array());
            for j in 0..16 {
                for k in 0..16 {
                    gram[j][k] += b[j] * b[k] * 4.0 * std::f64::consts::PI / n as f64;
                }
            }
        }
        for (j, row) in gram.iter().enumerate() {
            for (k, value) in row.iter().enumerate() {
                let expected = f64::from(u8::from(j == k));
                assert!((value - expected).abs() < 1e-3, "{j} {k}: {value}");
            }
        }
    }

    #[test]
    fn dc_gives_its_color_back() {
        let sh: Vec<f32> = [0.1, 0.5, 0.9].iter().map(|c| dc_of(*c) as f32).collect();
        let rgb = color(&sh, [0.6, 0.0, 0.8]);
        for (got, want) in rgb.iter().zip([0.1, 0.5, 0.9]) {
            assert!((got - want).abs() < 1e-6);
        }
    }

    #[test]
    fn degrees_and_counts_agree() {
        for degree in 0..=MAX_DEGREE {
            assert_eq!(degree_of(coefficients(degree)), Some(degree));
        }
        assert_eq!(degree_of(5), None);
    }
}
