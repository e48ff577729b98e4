//! SSIM against its definition, in f64.

use super::band::TAPS;
use super::*;
use wm_base::random::uniform;

fn picture(width: usize, height: usize, seed: u64) -> Vec<f32> {
    (0..width * height * 3).map(|i| uniform(seed, i as u64) as f32).collect()
}

/// Brute force in f64, straight from the definition.
fn referee(x: &[f32], y: &[f32], width: usize) -> f64 {
    let height = x.len() / (3 * width);
    let gauss: Vec<f64> = (0..TAPS).map(|t| (-((t as f64 - 5.0) / 1.5).powi(2) / 2.0).exp()).collect();
    let total: f64 = gauss.iter().sum();
    let mut sum = 0.0;
    for row in 0..height {
        for column in 0..width {
            for k in 0..3 {
                let mut e = [0.0; 5];
                for (dy, gy) in gauss.iter().enumerate() {
                    for (dx, gx) in gauss.iter().enumerate() {
                        let (Some(r), Some(c)) = ((row + dy).checked_sub(5), (column + dx).checked_sub(5))
                        else {
                            continue;
                        };
                        if r < height && c < width {
                            let at = 3 * (r * width + c) + k;
                            let (w, x, y) = (gx * gy / total / total, f64::from(x[at]), f64::from(y[at]));
                            for (e, v) in e.iter_mut().zip([x, y, x * x, y * y, x * y]) {
                                *e += w * v;
                            }
                        }
                    }
                }
                let [mx, my, xx, yy, xy] = e;
                let (c1, c2) = (1e-4, 9e-4);
                sum += (2.0 * mx * my + c1) * (2.0 * (xy - mx * my) + c2)
                    / ((mx * mx + my * my + c1) * (xx - mx * mx + yy - my * my + c2));
            }
        }
    }
    sum / x.len() as f64
}

fn paths() -> Vec<SimdPath> {
    SimdPath::available()
}

/// f32 sums of 121 products: 1e-6 in the means, up to 1e-4 where variances are as small as the
/// constants; far less in the mean over a picture.
#[test]
fn it_is_what_the_definition_says() {
    for path in paths() {
        // Bands begin again at 64 rows; 3 px are less than a vector.
        for (width, height) in [(23, 17), (3, 40), (41, 2), (6, 150), (5, 131)] {
            let (x, y) = (picture(width, height, 1), picture(width, height, 2));
            let mixed: Vec<f32> = x.iter().zip(&y).map(|(x, y)| 0.7 * x + 0.3 * y).collect();
            let got = Ssim::new(path).value(&x, &mixed, width);
            let want = referee(&x, &mixed, width);
            assert!((got - want).abs() < 1e-5, "{path} {width}x{height}: {got}, want {want}");
            assert!((Ssim::new(path).value(&x, &x, width) - 1.0).abs() < 1e-6);
        }
    }
}

#[test]
fn what_a_mask_hides_does_not_count() {
    let (width, height, kept) = (40, 21, 23);
    let (x, y) = (picture(width, height, 5), picture(width, height, 6));
    let mixed: Vec<f32> = x.iter().zip(&y).map(|(x, y)| 0.7 * x + 0.3 * y).collect();
    let mask: Vec<f32> = (0..width * height).map(|i| f32::from(u8::from(i % width < kept))).collect();
    let crop = |rgb: &[f32]| -> Vec<f32> {
        rgb.chunks_exact(3 * width).flat_map(|row| &row[..3 * kept]).copied().collect()
    };
    for path in paths() {
        let mut ssim = Ssim::new(path);
        let got = ssim.masked_value(&x, &mixed, Some(&mask), width);
        // The same windows; at most some thousand f32 numbers up to 1 are summed in another order.
        let want = ssim.value(&crop(&x), &crop(&mixed), kept);
        assert!((got - want).abs() < 1e-6, "{path}: {got}, want {want}");
        let garbage = picture(width, height, 7);
        let spoilt: Vec<f32> =
            (0..x.len()).map(|i| if mask[i / 3] == 0.0 { 1e3 * garbage[i] } else { x[i] }).collect();
        assert_eq!(ssim.masked_value(&spoilt, &mixed, Some(&mask), width), got, "{path}");
        let (all, plain) = (
            ssim.masked_value(&x, &mixed, Some(&vec![1.0; mask.len()]), width),
            ssim.value(&x, &mixed, width),
        );
        assert!((all - plain).abs() < 1e-6, "{path}: {all}, want {plain}");
        assert_eq!(ssim.masked_value(&x, &mixed, Some(&vec![0.0; mask.len()]), width), 1.0);
    }
}

/// Central differences of the f64 referee, step 1e-3: its own error is the third derivative's,
/// some 1e-6 of a slope of 1; pictures are f32.
#[test]
fn its_derivative_is_that_of_the_definition() {
    for (width, height) in [(19, 14), (4, 70)] {
        check_derivative(width, height);
    }
}

fn check_derivative(width: usize, height: usize) {
    let (x, y) = (picture(width, height, 3), picture(width, height, 4));
    let mixed: Vec<f32> = x.iter().zip(&y).map(|(x, y)| 0.6 * x + 0.4 * y).collect();
    for path in paths() {
        let mut gradient = vec![0.0; x.len()];
        Ssim::new(path).add_gradient(&mixed, &y, width, 1.0, &mut gradient);
        let (mut off, mut size) = (0.0, 0.0);
        for at in (0..x.len()).step_by(7) {
            let moved = |by: f32| {
                let mut moved = mixed.clone();
                moved[at] += by;
                (referee(&moved, &y, width), f64::from(moved[at]))
            };
            let ((high, above), (low, below)) = (moved(1e-3), moved(-1e-3));
            let want = (high - low) / (above - below);
            off += (f64::from(gradient[at]) - want).powi(2);
            size += want * want;
        }
        assert!((off / size).sqrt() < 1e-4, "{path}: {}", (off / size).sqrt());
    }
}
