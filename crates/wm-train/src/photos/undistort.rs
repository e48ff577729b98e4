//! Photos as a pinhole would have taken them.

use super::picture::Lens;
use crate::maps::{Filter, Map};

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

/// A map over the photo of [`Lens::photo`], of any size, as one over the picture of [`Lens::ideal`] of `size`.
///
/// Between four finite values it is linear, unless `filter` is [`Filter::Nearest`]; beside holes the nearest one is
/// taken. Where the map is made smaller by means, a pixel with a part of a hole is a hole.
pub(super) fn undistort_map(map: &Map, lens: &Lens, size: (u32, u32), filter: Filter) -> Map {
    let ideal = lens.ideal.resized(size.0, size.1);
    // Made smaller before, as photos are, but as large as the pinhole's pixels.
    let scaled = |side: u32, new: u32, old: u32| {
        ((f64::from(side) * f64::from(new) / f64::from(old)).round() as u32).max(1)
    };
    let smaller = (
        scaled(lens.photo.width, size.0, lens.ideal.width).min(map.width),
        scaled(lens.photo.height, size.1, lens.ideal.height).min(map.height),
    );
    let map = match filter {
        Filter::Nearest => map.clone(),
        Filter::Bilinear | Filter::Area => map.resampled(smaller.0, smaller.1, Filter::Area),
    };
    let photo = lens.photo.resized(map.width, map.height);
    let (width, channels) = (map.width as usize, map.channels as usize);
    let (right, below) = (f64::from(map.width) - 1.0, f64::from(map.height) - 1.0);
    let mut values = Vec::with_capacity(size.0 as usize * size.1 as usize * channels);
    for row in 0..size.1 {
        for column in 0..size.0 {
            let x = (f64::from(column) + 0.5 - ideal.cx) / ideal.fx;
            let y = (f64::from(row) + 0.5 - ideal.cy) / ideal.fy;
            let (u, v) = lens.distortion.distort(x, y);
            let px = (photo.fx * u + photo.cx - 0.5).clamp(0.0, right);
            let py = (photo.fy * v + photo.cy - 0.5).clamp(0.0, below);
            let (left, top) = (px as usize, py as usize);
            let (next, under) = ((left + 1).min(width - 1), (top + 1).min(map.height as usize - 1));
            let (dx, dy) = ((px - left as f64) as f32, (py - top as f64) as f32);
            for lane in 0..channels {
                let at = |x: usize, y: usize| map.values[(y * width + x) * channels + lane];
                let corners = [at(left, top), at(next, top), at(left, under), at(next, under)];
                let is_linear = filter != Filter::Nearest && corners.iter().all(|v| v.is_finite());
                values.push(if is_linear {
                    let [a, b, c, d] = corners;
                    let (upper, lower) = (a + dx * (b - a), c + dx * (d - c));
                    upper + dy * (lower - upper)
                } else {
                    corners[usize::from(dx > 0.5) + 2 * usize::from(dy > 0.5)]
                });
            }
        }
    }
    Map { width: size.0, height: size.1, values, ..map }
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

    #[test]
    fn a_distorted_map_comes_back_with_its_holes() {
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
        let distortion = Distortion::of([-0.15, 0.02, 0.003, -0.002]);
        let lens = Lens { photo, distortion, ideal: distortion.undistorted(&photo).unwrap() };
        // A map half as large of 1 + x + y / 2 with a hole left of the middle.
        let half = photo.resized(160, 120);
        let value = |u: f64, v: f64| {
            if (-0.3..-0.1).contains(&u) { f32::NAN } else { (1.0 + u + 0.5 * v) as f32 }
        };
        let mut values = Vec::new();
        for row in 0..120 {
            for column in 0..160 {
                let x = (f64::from(column) + 0.5 - half.cx) / half.fx;
                let y = (f64::from(row) + 0.5 - half.cy) / half.fy;
                let (u, v) = distortion.undistort(x, y).unwrap();
                values.push(value(u, v));
            }
        }
        let map = Map::new(160, 120, 1, values);
        for (filter, size, mean) in [
            // The linear one is off where the lens bends; nearest by a quarter of a pixel in each of x and y.
            (Filter::Bilinear, (160, 120), 2e-4),
            (Filter::Area, (50, 40), 1e-3),
            (Filter::Nearest, (160, 120), 3e-3),
        ] {
            let found = undistort_map(&map, &lens, size, filter);
            assert_eq!(
                (found.width, found.height, found.values.len()),
                (size.0, size.1, (size.0 * size.1) as usize)
            );
            let found_count = found.values.len() as f32;
            let ideal = lens.ideal.resized(size.0, size.1);
            let (mut worst, mut sum, mut wrong) = (0.0f32, 0.0, 0);
            for (index, found) in found.values.iter().enumerate() {
                let (column, row) = (index as u32 % size.0, index as u32 / size.0);
                let x = (f64::from(column) + 0.5 - ideal.cx) / ideal.fx;
                let y = (f64::from(row) + 0.5 - ideal.cy) / ideal.fy;
                let expected = value(x, y);
                if found.is_nan() != expected.is_nan() {
                    wrong += 1;
                } else if !found.is_nan() {
                    worst = worst.max((found - expected).abs());
                    sum += (found - expected).abs() / found_count;
                }
            }
            // Half a pixel in x and y beside holes; at each of two borders of the hole a pixel a row, or two where
            // blocks are averaged.
            let pixel = if filter == Filter::Area { 0.02 } else { 0.008 };
            assert!(worst < pixel && sum < mean && wrong <= 4 * size.1, "{filter:?}: {worst} {sum} {wrong}");
        }
    }
}
