//! Removes the distortion of lenses from photos and maps.

use wm_image::maps::{Filter, Map};
use wm_scene::Camera;
use wm_scene::camera::Distortion;

/// The cameras before and after a lens is undone.
#[derive(Clone, Debug)]
pub(super) struct Lens {
    /// The camera of the photo at the size that it is resized to; it has the distortion.
    pub(crate) photo: Camera,
    pub(crate) distortion: Distortion,
    /// The pinhole camera.
    pub(crate) ideal: Camera,
}

/// The four pixels around a point of an image, and how far between them the point is.
struct Corners {
    left: usize,
    right: usize,
    upper: usize,
    lower: usize,
    /// 0 at `left`, 1 at `right`.
    dx: f32,
    /// 0 at `upper`, 1 at `lower`.
    dy: f32,
}

/// Calls `take` for every pixel of `ideal`, row by row, with the point of `photo` at which the lens
/// shows the ray of its centre. Pixel centres are at halves; beyond the outer ones the border is
/// continued.
#[inline(always)]
fn for_each_pixel(ideal: &Camera, photo: &Camera, distortion: &Distortion, mut take: impl FnMut(Corners)) {
    let (width, height) = (photo.width as usize, photo.height as usize);
    let (last_x, last_y) = (f64::from(photo.width) - 1.0, f64::from(photo.height) - 1.0);
    for row in 0..ideal.height {
        let y = (f64::from(row) + 0.5 - ideal.cy) / ideal.fy;
        for column in 0..ideal.width {
            let x = (f64::from(column) + 0.5 - ideal.cx) / ideal.fx;
            let (u, v) = distortion.distort(x, y);
            let px = (photo.fx * u + photo.cx - 0.5).clamp(0.0, last_x);
            let py = (photo.fy * v + photo.cy - 0.5).clamp(0.0, last_y);
            let (left, upper) = (px as usize, py as usize);
            take(Corners {
                left,
                right: (left + 1).min(width - 1),
                upper,
                lower: (upper + 1).min(height - 1),
                dx: (px - left as f64) as f32,
                dy: (py - upper as f64) as f32,
            });
        }
    }
}

/// Returns the undistorted image of a photo of `N` channels, `[H, W, N]` of [`Lens::ideal`].
///
/// The photo is sampled linearly between four pixels. A photo that is reduced is reduced before
/// this: where the lens changes the scale by some per cent nothing aliases then.
pub(super) fn undistort<const N: usize>(pixels: &[u8], lens: &Lens) -> Vec<u8> {
    let Lens { photo, ideal, distortion } = lens;
    let width = photo.width as usize;
    let (pixels, _) = pixels.as_chunks::<N>();
    assert_eq!(pixels.len(), width * photo.height as usize, "an image of the size of its camera");
    let mut out = Vec::with_capacity(ideal.width as usize * ideal.height as usize * N);
    for_each_pixel(ideal, photo, distortion, |Corners { left, right, upper, lower, dx, dy }| {
        let (a, b) = (&pixels[upper * width + left], &pixels[upper * width + right]);
        let (c, d) = (&pixels[lower * width + left], &pixels[lower * width + right]);
        for lane in 0..N {
            let corners = [a[lane], b[lane], c[lane], d[lane]].map(f32::from);
            out.push((bilinear(corners, dx, dy) + 0.5) as u8);
        }
    });
    out
}

/// Returns a map over the photo of [`Lens::photo`], of any size, as one over the image of
/// [`Lens::ideal`] of `size`.
///
/// Between four finite values it is linear, unless `filter` is [`Filter::Nearest`]; beside holes
/// the nearest value is taken. Where the map is reduced by means, a pixel with a part of a hole is
/// a hole.
pub(super) fn undistort_map(map: &Map, lens: &Lens, size: (u32, u32), filter: Filter) -> Map {
    let ideal = lens.ideal.resized(size.0, size.1);
    // Reduced before, as photos are, but to pixels as large as the pinhole's.
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
    let mut values = Vec::with_capacity(size.0 as usize * size.1 as usize * channels);
    for_each_pixel(&ideal, &photo, &lens.distortion, |Corners { left, right, upper, lower, dx, dy }| {
        for lane in 0..channels {
            let at = |x: usize, y: usize| map.values[(y * width + x) * channels + lane];
            let corners = [at(left, upper), at(right, upper), at(left, lower), at(right, lower)];
            let is_linear = filter != Filter::Nearest && corners.iter().all(|v| v.is_finite());
            values.push(match is_linear {
                true => bilinear(corners, dx, dy),
                false => corners[usize::from(dx > 0.5) + 2 * usize::from(dy > 0.5)],
            });
        }
    });
    Map { width: size.0, height: size.1, values, ..map }
}

/// Returns the value between four corners: upper left, upper right, lower left, lower right.
#[inline(always)]
fn bilinear(corners: [f32; 4], dx: f32, dy: f32) -> f32 {
    let [a, b, c, d] = corners;
    let (upper, lower) = (a + dx * (b - a), c + dx * (d - c));
    upper + dy * (lower - upper)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat4;

    /// The camera of a distorted photo.
    fn distorted() -> Camera {
        Camera {
            width: 320,
            height: 240,
            fx: 250.0,
            fy: 255.0,
            cx: 158.0,
            cy: 123.0,
            viewmat: DMat4::IDENTITY,
            near: 0.2,
        }
    }

    /// A smooth picture of the plane z = 1, as a function of the ray: what the lens bends.
    fn scene(x: f64, y: f64) -> [f64; 3] {
        [(x * 40.0).sin(), (y * 40.0).cos(), ((x + y) * 25.0).sin()].map(|v| 127.5 + 100.0 * v)
    }

    #[test]
    fn a_distorted_picture_comes_back() {
        let photo = distorted();
        for coefficients in [[-0.15, 0.02, 0.003, -0.002, 0.01], [0.12, 0.01, 0.0, 0.0, 0.0]] {
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
            // Linear interpolation of a sine of amplitude 100 and 40 / 250 radians a pixel is off
            // by at most 100 (0.16)^2 / 8 = 0.32 along each axis; half a step each for two
            // roundings.
            assert!(worst < 2.0, "{worst}");
        }
    }

    #[test]
    fn a_distorted_map_comes_back_with_its_holes() {
        let photo = distorted();
        let distortion = Distortion::of([-0.15, 0.02, 0.003, -0.002, 0.0]);
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
            // The linear one is off where the lens bends; nearest by a quarter of a pixel in each
            // of x and y.
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
            // Half a pixel in x and y beside holes; at each of two borders of the hole a pixel a
            // row, or two where blocks are averaged.
            let pixel = if filter == Filter::Area { 0.02 } else { 0.008 };
            assert!(worst < pixel && sum < mean && wrong <= 4 * size.1, "{filter:?}: {worst} {sum} {wrong}");
        }
    }
}
