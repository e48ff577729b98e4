//! Photos as a pinhole would have taken them.

use super::picture::Lens;

/// The undistorted picture of a photo of `N` channels, `[H, W, N]` of [`Lens::ideal`].
///
/// For the centre of each new pixel the photo is sampled where the lens shows that ray, linearly
/// between the four pixels around. A photo that is made smaller is made so before: where the lens
/// changes the scale by some per cent nothing aliases then.
pub(super) fn undistort<const N: usize>(pixels: &[u8], lens: &Lens) -> Vec<u8> {
    let (photo, ideal) = (&lens.photo, &lens.ideal);
    let (width, height) = (photo.width as usize, photo.height as usize);
    let (pixels, _) = pixels.as_chunks::<N>();
    assert_eq!(pixels.len(), width * height, "a picture of the size of its camera");
    let (right, below) = (width as f64 - 1.0, height as f64 - 1.0);
    let mut out = Vec::with_capacity(ideal.width as usize * ideal.height as usize * N);
    for row in 0..ideal.height {
        let y = (f64::from(row) + 0.5 - ideal.cy) / ideal.fy;
        for column in 0..ideal.width {
            let x = (f64::from(column) + 0.5 - ideal.cx) / ideal.fx;
            let (u, v) = lens.distortion.distort(x, y);
            // Pixel centres are at halves; beyond the outer ones the border is continued.
            let px = (photo.fx * u + photo.cx - 0.5).clamp(0.0, right);
            let py = (photo.fy * v + photo.cy - 0.5).clamp(0.0, below);
            let (left, top) = (px as usize, py as usize);
            let (next, under) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
            let (dx, dy) = ((px - left as f64) as f32, (py - top as f64) as f32);
            let (a, b) = (&pixels[top * width + left], &pixels[top * width + next]);
            let (c, d) = (&pixels[under * width + left], &pixels[under * width + next]);
            for lane in 0..N {
                let [a, b, c, d] = [a[lane], b[lane], c[lane], d[lane]].map(f32::from);
                let (upper, lower) = (a + dx * (b - a), c + dx * (d - c));
                out.push((upper + dy * (lower - upper) + 0.5) as u8);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat4;
    use wm_scene::{Camera, capture::Distortion};

    /// A smooth picture of the plane z = 1, as a function of the ray: what the lens bends.
    fn scene(x: f64, y: f64) -> [f64; 3] {
        [(x * 40.0).sin(), (y * 40.0).cos(), ((x + y) * 25.0).sin()].map(|v| 127.5 + 100.0 * v)
    }

    #[test]
    fn a_distorted_picture_comes_back() {
        let photo = Camera {
            width: 320,
            height: 240,
            fx: 250.0,
            fy: 255.0,
            cx: 158.0,
            cy: 123.0,
            viewmat: DMat4::IDENTITY,
            near: 0.2,
        };
        for coefficients in [[-0.15, 0.02, 0.003, -0.002], [0.12, 0.01, 0.0, 0.0]] {
            let distortion = Distortion::of(coefficients);
            let mut pixels = Vec::new();
            for row in 0..photo.height {
                for column in 0..photo.width {
                    let x = (f64::from(column) + 0.5 - photo.cx) / photo.fx;
                    let y = (f64::from(row) + 0.5 - photo.cy) / photo.fy;
                    let (u, v) = distortion.undistort(x, y).unwrap();
                    pixels.extend(scene(u, v).map(|c| c.round() as u8));
                }
            }
            let ideal = distortion.undistorted(&photo).unwrap();
            let lens = Lens { photo, distortion, ideal };
            let found = undistort::<3>(&pixels, &lens);
            assert_eq!(found.len(), (ideal.width * ideal.height * 3) as usize);
            let mut worst = 0f64;
            for (index, rgb) in found.chunks(3).enumerate() {
                let (column, row) = (index as u32 % ideal.width, index as u32 / ideal.width);
                let x = (f64::from(column) + 0.5 - ideal.cx) / ideal.fx;
                let y = (f64::from(row) + 0.5 - ideal.cy) / ideal.fy;
                for (found, expected) in rgb.iter().zip(scene(x, y)) {
                    worst = worst.max((f64::from(*found) - expected).abs());
                }
            }
            // Linear interpolation of a sine of amplitude 100 and 40 / 250 radians a pixel is off by
            // at most 100 (0.16)^2 / 8 = 0.32 along each axis; half a step each for two roundings.
            assert!(worst < 2.0, "{worst}");
        }
    }
}
