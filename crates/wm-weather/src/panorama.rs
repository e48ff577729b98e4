//! Equirectangular pictures of all directions, sampled without shimmer.
//!
//! Columns run around, rows from straight up to straight down: pixel `(x, y)` of `W x H` is seen at
//! the longitude `2 pi ((x + 0.5) / W - 1/2)`, clockwise from above, and the elevation
//! `pi (1/2 - (y + 0.5) / H)`. Kept in steps of 1/8192 of display white, display-referred, up to 8
//! (130 times the light of white: a sun is brighter, and clipped), with halved sizes averaged in
//! linear light. A direction is interpolated bilinearly in the two sizes whose pixels are next to a
//! pixel of the frame, and between them. Near the poles, where the columns come together, that is
//! as sharp as the rows are.
//!
//! Below the horizon most panoramas show a ground of their own or nothing, and behind the end of a
//! scene either is wrong. So that half is made of haze unless it is requested
//! ([`LowerHemisphere`]): within 3 degrees the mirrored sky turns into the mean of the strip above
//! the horizon, at each heading its own.

use std::f32::consts::{FRAC_PI_2, PI};
use std::fmt;
use thiserror::Error;
use wm_render::frame::{srgb_decode, srgb_encode};
use wm_render::hooks::{GROUP, ShadeGroup};
use wm_scene::survey::{SkyPatch, airlight_of_sky};

/// Most pixels: 8192 x 4096, 360 MB with the smaller sizes.
pub const MAX_PIXELS: u64 = 1 << 25;
/// Steps of a display-referred 1.
const TONE_STEP_COUNT: f32 = 8192.0;
/// Rows of the smallest size.
const LEAST_ROWS: usize = 16;
/// Sine of the depth below the horizon at which the mirrored sky has become the strip: 3 degrees.
const FULL_STRIP_SINE: f32 = 0.05;
/// Largest difference of width and twice the height, as a share.
const MAX_ASPECT_ERROR: f64 = 0.01;

/// Why a picture is no panorama.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum PanoramaError {
    /// It is not twice as wide as high.
    #[error("{width}x{height} px is no panorama of all directions: it must be twice as wide as high")]
    Aspect {
        /// Width, px.
        width: u32,
        /// Height, px.
        height: u32,
    },
    /// It has too many pixels.
    #[error("a panorama of {width}x{height} px is too large: make it 8192x4096 px or smaller")]
    Large {
        /// Width, px.
        width: u32,
        /// Height, px.
        height: u32,
    },
}

/// The lower half of a panorama.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LowerHemisphere {
    /// Haze of the colours just above it.
    Haze,
    /// The lower half of the image.
    Image,
}

/// A picture of all directions.
#[derive(Clone, PartialEq)]
pub struct Panorama {
    /// The picture, then halved again and again.
    levels: Vec<Level>,
    airlight: Option<[f64; 3]>,
}

/// One size of it.
#[derive(Clone, PartialEq)]
struct Level {
    width: usize,
    height: usize,
    /// `[H, W]`, steps; the fourth makes a pixel one load.
    rgb: Vec<[u16; 4]>,
}

/// Says whether a picture of this size can be a panorama, before it is decoded.
///
/// # Errors
/// [`PanoramaError`].
pub fn check_size(width: u32, height: u32) -> Result<(), PanoramaError> {
    let (w, h) = (f64::from(width), 2.0 * f64::from(height));
    if width < 2 || height == 0 || (w - h).abs() > MAX_ASPECT_ERROR * h {
        return Err(PanoramaError::Aspect { width, height });
    }
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(PanoramaError::Large { width, height });
    }
    Ok(())
}

impl Panorama {
    /// A panorama of `width x height` px; `pixel` gives the display-referred colour of each place
    /// in `[H, W]`, in order. What is not a number is black.
    ///
    /// # Errors
    /// [`PanoramaError`].
    pub fn new(
        width: u32,
        height: u32,
        mut pixel: impl FnMut(usize) -> [f32; 3],
    ) -> Result<Self, PanoramaError> {
        check_size(width, height)?;
        let (width, height) = (width as usize, height as usize);
        let rgb = (0..width * height).map(|i| steps(pixel(i))).collect();
        let mut levels = vec![Level { width, height, rgb }];
        let linear: Vec<f32> =
            (0..=u16::MAX).map(|v| srgb_decode(f64::from(v) / f64::from(TONE_STEP_COUNT)) as f32).collect();
        while let Some(level) = levels.last().filter(|level| level.height >= 2 * LEAST_ROWS) {
            levels.push(level.halved(&linear));
        }
        let airlight = levels.iter().find(|level| level.height <= 128).and_then(Level::airlight);
        Ok(Self { levels, airlight })
    }

    /// The airlight under it ([`airlight_of_sky`]), linear RGB; `None` if it is black.
    #[must_use]
    pub fn airlight(&self) -> Option<[f64; 3]> {
        self.airlight
    }

    /// The smallest size.
    fn smallest(&self) -> &Level {
        self.levels.last().unwrap_or(&self.levels[0])
    }

    /// Width and height, px.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        (self.levels[0].width, self.levels[0].height)
    }

    /// The sizes to mix for frame pixels of an angle (radians), and the share of the second.
    fn levels_for(&self, pixel: f64) -> (&Level, &Level, f64) {
        let texel = std::f64::consts::PI / self.levels[0].height as f64;
        let last = self.levels.len() - 1;
        let depth = (pixel / texel).log2().clamp(0.0, last as f64);
        let first = depth as usize;
        (&self.levels[first], &self.levels[(first + 1).min(last)], depth - first as f64)
    }

    /// Writes the colours of `groups`, whose directions are along `axes`: level towards the middle
    /// column, level a quarter turn clockwise from it, and up.
    pub(crate) fn paint(
        &self,
        pixel: f64,
        axes: [[f32; 3]; 3],
        below: LowerHemisphere,
        groups: &mut [ShadeGroup],
    ) {
        let strip = self.smallest();
        let (sharp, soft, share) = self.levels_for(pixel);
        let share = share as f32;
        for group in groups {
            let [x, y, z] = group.direction;
            let along = |axis: [f32; 3]| -> [f32; GROUP] {
                std::array::from_fn(|i| x[i] * axis[0] + y[i] * axis[1] + z[i] * axis[2])
            };
            let [forward, right, up] = axes.map(along);
            let around: [f32; GROUP] = std::array::from_fn(|i| atan2(right[i], forward[i]));
            let above: [f32; GROUP] =
                std::array::from_fn(|i| atan2(up[i], (forward[i] * forward[i] + right[i] * right[i]).sqrt()));
            for i in 0..GROUP {
                let is_haze = below == LowerHemisphere::Haze && up[i] < 0.0;
                let elevation = if is_haze { -above[i] } else { above[i] };
                let (u, v) = (0.5 + around[i] / (2.0 * PI), 0.5 - elevation / PI);
                let mut rgb = sharp.at(u, v, below);
                if share > 0.0 {
                    let other = soft.at(u, v, below);
                    for k in 0..3 {
                        rgb[k] += (other[k] - rgb[k]) * share;
                    }
                }
                if is_haze {
                    let (other, share) = (strip.at(u, 0.5, below), smooth(-up[i] / FULL_STRIP_SINE));
                    for k in 0..3 {
                        rgb[k] += (other[k] - rgb[k]) * share;
                    }
                }
                for k in 0..3 {
                    group.rgb[k][i] = rgb[k];
                }
            }
        }
    }

    /// Looks up one direction given along the axes, in f64.
    pub(crate) fn reference(&self, pixel: f64, direction: [f64; 3], below: LowerHemisphere) -> [f64; 3] {
        let [forward, right, up] = direction;
        let is_haze = below == LowerHemisphere::Haze && up < 0.0;
        let height = if is_haze { -up } else { up };
        let u = 0.5 + right.atan2(forward) / std::f64::consts::TAU;
        let v = 0.5 - height.atan2(forward.hypot(right)) / std::f64::consts::PI;
        let (sharp, soft, share) = self.levels_for(pixel);
        let (a, b) = (sharp.reference(u, v, below), soft.reference(u, v, below));
        let color: [f64; 3] = std::array::from_fn(|k| a[k] + (b[k] - a[k]) * share);
        if !is_haze {
            return color;
        }
        let strip = self.smallest().reference(u, 0.5, below);
        let share = f64::from(smooth((-up / f64::from(FULL_STRIP_SINE)) as f32));
        std::array::from_fn(|k| color[k] + (strip[k] - color[k]) * share)
    }
}

/// A display-referred colour in steps; what is beyond is clipped, what is no number is 0.
fn steps(rgb: [f32; 3]) -> [u16; 4] {
    let [r, g, b] = rgb;
    [r, g, b, 0.0].map(|v| (v * TONE_STEP_COUNT).round() as u16)
}

/// A curve from 0 at 0 to 1 at 1 without a kink.
pub(crate) fn smooth(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

impl fmt::Debug for Panorama {
    /// Size and a checksum (FNV-1a): enough to tell another picture.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let values = self.levels[0].rgb.as_flattened();
        let sum = values
            .iter()
            .fold(0xcbf2_9ce4_8422_2325u64, |sum, v| (sum ^ u64::from(*v)).wrapping_mul(0x0100_0000_01b3));
        let (width, height) = self.size();
        write!(f, "{width}x{height} {sum:016x}")
    }
}

impl Level {
    /// Half the size, each side rounded down; `linear` is the light of each step.
    fn halved(&self, linear: &[f32]) -> Self {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let ratio = |long: usize, short: usize| long as f64 / short as f64;
        let (across, down) = (ratio(self.width, width), ratio(self.height, height));
        let mut rgb = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let mut sum = [0.0; 3];
                for (row, upright) in shares(down, y) {
                    for (column, along) in shares(across, x) {
                        let from = self.rgb[row * self.width + column];
                        for k in 0..3 {
                            sum[k] += upright * along * linear[usize::from(from[k])];
                        }
                    }
                }
                rgb.push(steps(sum.map(|v| srgb_encode(f64::from(v)) as f32)));
            }
        }
        Self { width, height, rgb }
    }

    /// The last row that is looked at: with haze below the horizon, the one above it.
    fn last_row(&self, below: LowerHemisphere) -> usize {
        match below {
            LowerHemisphere::Haze => (self.height / 2).max(1) - 1,
            LowerHemisphere::Image => self.height - 1,
        }
    }

    fn airlight(&self) -> Option<[f64; 3]> {
        let rows = 0..self.height / 2;
        let patches = rows.flat_map(|row| {
            let (sin, level) =
                (std::f64::consts::PI * (0.5 - (row as f64 + 0.5) / self.height as f64)).sin_cos();
            let pixels = &self.rgb[row * self.width..][..self.width];
            // A sun is no measure of the air's light.
            let light = |v: u16| srgb_decode((f64::from(v) / f64::from(TONE_STEP_COUNT)).min(1.0));
            pixels.iter().map(move |[r, g, b, _]| SkyPatch {
                sin,
                weight: level,
                rgb: [*r, *g, *b].map(light),
            })
        });
        airlight_of_sky(patches.collect(), 0.0).filter(|light| light.iter().any(|v| *v > 0.0))
    }

    #[inline(always)]
    fn at(&self, u: f32, v: f32, below: LowerHemisphere) -> [f32; 4] {
        let x = u * self.width as f32 - 0.5;
        let last = self.last_row(below);
        let y = (v * self.height as f32 - 0.5).clamp(0.0, last as f32);
        // From one pixel to the left, so that rounding towards 0 rounds down.
        let (left, top) = ((x + 1.0) as usize, y as usize);
        let (across, down) = (x + 1.0 - left as f32, y - top as f32);
        let first = if left == 0 { self.width - 1 } else { left.min(self.width) - 1 };
        let next = if first + 1 == self.width { 0 } else { first + 1 };
        let rows = [top, (top + 1).min(last)].map(|row| &self.rgb[row * self.width..][..self.width]);
        // Four channels at once, so that the compiler makes one vector of a pixel.
        let [upper, lower] = rows.map(|row| {
            let [a, b] = [row[first], row[next]].map(|pixel| pixel.map(f32::from));
            std::array::from_fn::<f32, 4, _>(|k| a[k] + (b[k] - a[k]) * across)
        });
        std::array::from_fn(|k| (upper[k] + (lower[k] - upper[k]) * down) * (1.0 / TONE_STEP_COUNT))
    }

    fn reference(&self, u: f64, v: f64, below: LowerHemisphere) -> [f64; 3] {
        let (width, height) = (self.width as i64, self.height as i64);
        let (x, y) = (u * width as f64 - 0.5, v * height as f64 - 0.5);
        let corner = |dx: i64, dy: i64, k: usize| {
            let column = (x.floor() as i64 + dx).rem_euclid(width);
            let row = (y.floor() as i64 + dy).clamp(0, self.last_row(below) as i64);
            f64::from(self.rgb[(row * width + column) as usize][k])
        };
        let (across, down) = (x - x.floor(), y - y.floor());
        std::array::from_fn(|k| {
            let upper = corner(0, 0, k) * (1.0 - across) + corner(1, 0, k) * across;
            let lower = corner(0, 1, k) * (1.0 - across) + corner(1, 1, k) * across;
            (upper * (1.0 - down) + lower * down) / f64::from(TONE_STEP_COUNT)
        })
    }
}

/// The samples of a longer side that make one of a side `ratio` times as short, with their weights.
fn shares(ratio: f64, place: usize) -> impl Iterator<Item = (usize, f32)> {
    let from = place as f64 * ratio;
    let to = from + ratio;
    // Sides that divide evenly end on a place, give or take a rounding.
    (from as usize..(to - 1e-6).ceil() as usize).map(move |i| {
        let share = to.min(i as f64 + 1.0) - from.max(i as f64);
        (i, (share / ratio) as f32)
    })
}

/// The angle of `(x, y)` from the x axis, radians, within 1.2e-5: a sixtieth of a pixel of the
/// largest panorama. Abramowitz and Stegun 4.4.49; without branches, so that the compiler makes
/// vectors of it.
#[inline(always)]
fn atan2(y: f32, x: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let t = ax.min(ay) / ax.max(ay).max(1e-30);
    let s = t * t;
    let series = 0.999_866 + s * (-0.330_299_5 + s * (0.180_141 + s * (-0.085_133 + s * 0.020_835_1)));
    let eighth = t * series;
    let quarter = if ay > ax { FRAC_PI_2 - eighth } else { eighth };
    let half = if x < 0.0 { PI - quarter } else { quarter };
    if y < 0.0 { -half } else { half }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_right() {
        for i in 0..=4000 {
            let angle = (f64::from(i) / 2000.0 - 1.0) * std::f64::consts::PI * 0.9999;
            let (y, x) = angle.sin_cos();
            let got = f64::from(atan2(y as f32, x as f32));
            assert!((got - angle).abs() < 1.2e-5, "{angle}: {got}");
        }
        assert_eq!(atan2(0.0, 0.0), 0.0);
    }

    #[test]
    fn smaller_sizes_keep_the_light() {
        // A checkerboard of black and white is half the light, not half the code; with odd sides
        // too.
        for (width, height) in [(128, 64), (131, 65)] {
            let panorama =
                Panorama::new(width, height, |i| [((i + i / width as usize) % 2) as f32; 3]).unwrap();
            let smallest = panorama.levels.last().unwrap();
            assert!((LEAST_ROWS..2 * LEAST_ROWS).contains(&smallest.height));
            let light: f64 = smallest.rgb.iter().map(|rgb| srgb_decode(f64::from(rgb[0]) / 8192.0)).sum();
            let mean = light / smallest.rgb.len() as f64;
            assert!((mean - 0.5).abs() < 0.01, "{width}: {mean}");
        }
    }

    #[test]
    fn what_is_no_panorama_is_refused() {
        let new = |width, height| Panorama::new(width, height, |_| [f32::NAN, -1.0, 1e30]);
        assert_eq!(new(64, 32).unwrap().levels[0].rgb[5], [0, 0, u16::MAX, 0]);
        assert_eq!(new(64, 64).unwrap_err(), PanoramaError::Aspect { width: 64, height: 64 });
        assert!(matches!(new(0, 0), Err(PanoramaError::Aspect { .. })));
        assert!(matches!(new(16384, 8192), Err(PanoramaError::Large { .. })));
        assert!(matches!(check_size(u32::MAX, u32::MAX / 2), Err(PanoramaError::Large { .. })));
    }
}
