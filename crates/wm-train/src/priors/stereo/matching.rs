//! Matching costs: how well a plane through the window of a pixel matches the other photos.

use crate::photo_warp::PhotoWarp;

/// Window offsets along one axis, px: 9x9 px, every second one.
const WINDOW_OFFSETS_PX: [f32; 5] = [-4.0, -2.0, 0.0, 2.0, 4.0];
/// Samples of a window.
const WINDOW_SAMPLE_COUNT: usize = WINDOW_OFFSETS_PX.len() * WINDOW_OFFSETS_PX.len();
/// Standard deviations of the weights in space, px, and in brightness (0-1): pixels of another
/// brightness are likely of another surface.
const SPACE_DEVIATION_PX: f32 = 4.0;
const BRIGHTNESS_DEVIATION: f32 = 0.1;
/// Standard deviation of brightness below which a window is flat: one step of 8 bits.
const MIN_CONTRAST: f32 = 1.0 / 255.0;
/// Cost where images cannot be compared; costs range from 0 (equal) to 2 (opposite).
pub(crate) const MAX_COST: f32 = 2.0;
/// Cost of a flat window: that of uncorrelated images.
const FLAT_COST: f32 = 1.0;

/// Brightness of a photo, `[H, W]`, 0-1.
#[derive(Clone, Debug)]
pub(crate) struct StereoImage {
    /// Width, px.
    pub(crate) width: usize,
    /// Height, px.
    pub(crate) height: usize,
    /// The values, row by row.
    pub(crate) values: Vec<f32>,
}

impl StereoImage {
    /// Returns the brightness of an sRGB image, `[H, W, 3]`.
    pub(crate) fn of(rgb: &[u8], width: usize) -> Self {
        let luma = |rgb: &[u8]| {
            let [r, g, b] = [rgb[0], rgb[1], rgb[2]].map(f32::from);
            (0.299 * r + 0.587 * g + 0.114 * b) / 255.0
        };
        let values: Vec<f32> = rgb.chunks_exact(3).map(luma).collect();
        Self { width, height: values.len() / width, values }
    }

    /// Returns true if an image point, px, has four pixels around it.
    #[inline(always)]
    fn holds(&self, x: f32, y: f32) -> bool {
        // This form of the comparison excludes NaN.
        x >= 0.5 && y >= 0.5 && x < self.width as f32 - 0.5 && y < self.height as f32 - 0.5
    }

    /// Interpolates bilinearly at an image point, px, inside the image.
    #[inline(always)]
    fn sample(&self, x: f32, y: f32) -> f32 {
        let (x, y) = (x - 0.5, y - 0.5);
        let (left, top) = (x as u32 as usize, y as u32 as usize);
        let (dx, dy) = (x - left as f32, y - top as f32);
        let at = top * self.width + left;
        let [a, b] = [self.values[at], self.values[at + 1]];
        let [c, d] = [self.values[at + self.width], self.values[at + self.width + 1]];
        let (upper, lower) = (a + dx * (b - a), c + dx * (d - c));
        upper + dy * (lower - upper)
    }
}

/// Largest rounding error of image points, px: some steps of f32 at 16,000 px.
const MAX_ROUNDING_PX: f32 = 0.01;

/// A photo to compare with, and how points of the first photo fall into it.
#[derive(Clone, Debug)]
pub(crate) struct StereoSource<'a> {
    /// The image.
    pub(crate) picture: &'a StereoImage,
    /// The warp from image points of the first photo to this one.
    pub(crate) warp: PhotoWarp,
}

/// A plane as inverse depth over the picture: `1 / z = plane . (x, y, 1)`, px.
pub(crate) type Plane = [f32; 3];

/// Returns the inverse depth of a plane at the image point (x, y).
#[inline(always)]
pub(crate) fn inverse_depth(plane: &Plane, x: f32, y: f32) -> f32 {
    plane[0] * x + plane[1] * y + plane[2]
}

/// The window around a pixel.
pub(crate) struct Window {
    x: f32,
    y: f32,
    /// Brightness minus its weighted mean.
    off: [f32; WINDOW_SAMPLE_COUNT],
    weights: [f32; WINDOW_SAMPLE_COUNT],
    /// Reciprocal of the standard deviation; 0 where the window is flat.
    contrast: f32,
}

impl Window {
    /// Returns the window around the pixel in `column` and `row`; the border is replicated.
    pub(crate) fn new(picture: &StereoImage, column: usize, row: usize) -> Self {
        let (mut values, mut weights) = ([0.0; WINDOW_SAMPLE_COUNT], [0.0; WINDOW_SAMPLE_COUNT]);
        let middle = picture.values[row * picture.width + column];
        let inside =
            |at: usize, off: f32, most: usize| (at as f32 + off).clamp(0.0, (most - 1) as f32) as usize;
        let mut total = 0.0;
        for (i, dy) in WINDOW_OFFSETS_PX.into_iter().enumerate() {
            let y = inside(row, dy, picture.height);
            for (j, dx) in WINDOW_OFFSETS_PX.into_iter().enumerate() {
                let value = picture.values[y * picture.width + inside(column, dx, picture.width)];
                let off = (value - middle) / BRIGHTNESS_DEVIATION;
                let far = (dx * dx + dy * dy) / (SPACE_DEVIATION_PX * SPACE_DEVIATION_PX);
                let weight = (-0.5 * (off * off + far)).exp();
                (values[i * WINDOW_OFFSETS_PX.len() + j], weights[i * WINDOW_OFFSETS_PX.len() + j]) =
                    (value, weight);
                total += weight;
            }
        }
        weights.iter_mut().for_each(|weight| *weight /= total);
        let mean = values.iter().zip(&weights).map(|(v, w)| v * w).sum::<f32>();
        let variance = values.iter().zip(&weights).map(|(v, w)| w * (v - mean) * (v - mean)).sum::<f32>();
        let contrast = if variance > MIN_CONTRAST * MIN_CONTRAST { 1.0 / variance.sqrt() } else { 0.0 };
        let off = values.map(|v| v - mean);
        Self { x: column as f32 + 0.5, y: row as f32 + 0.5, off, weights, contrast }
    }

    /// Returns 1 minus the weighted normalised correlation with `source`, warped by `plane`.
    #[inline]
    pub(crate) fn cost(&self, source: &StereoSource<'_>, plane: &Plane) -> f32 {
        if self.contrast == 0.0 {
            return FLAT_COST;
        }
        // The plane's homography, and its derivative at the pixel: over a window it is nearly
        // affine.
        let h: [[f32; 3]; 3] =
            [0, 1, 2].map(|k| [0, 1, 2].map(|c| source.warp.base[k][c] + source.warp.lift[k] * plane[c]));
        let at: [f32; 3] = [0, 1, 2].map(|k| h[k][0] * self.x + h[k][1] * self.y + h[k][2]);
        if at[2] < 1e-6 {
            return MAX_COST;
        }
        let (x, y, by_z) = (at[0] / at[2], at[1] / at[2], 1.0 / at[2]);
        let across = [(h[0][0] - x * h[2][0]) * by_z, (h[1][0] - y * h[2][0]) * by_z];
        let down = [(h[0][1] - x * h[2][1]) * by_z, (h[1][1] - y * h[2][1]) * by_z];
        // The window is inside if its corners are, up to rounding, since samples are computed in
        // another order below.
        let reach = [0, 1].map(|k| {
            WINDOW_OFFSETS_PX[WINDOW_OFFSETS_PX.len() - 1] * (across[k].abs() + down[k].abs())
                + MAX_ROUNDING_PX
        });
        let picture = source.picture;
        if !(picture.holds(x - reach[0], y - reach[1]) && picture.holds(x + reach[0], y + reach[1])) {
            return MAX_COST;
        }
        let (mut sum, mut square, mut product) = (0.0, 0.0, 0.0);
        for (i, dy) in WINDOW_OFFSETS_PX.into_iter().enumerate() {
            let (x, y) = (x + down[0] * dy, y + down[1] * dy);
            for (j, dx) in WINDOW_OFFSETS_PX.into_iter().enumerate() {
                let value = picture.sample(x + across[0] * dx, y + across[1] * dx);
                let k = i * WINDOW_OFFSETS_PX.len() + j;
                let weighted = self.weights[k] * value;
                sum += weighted;
                square += weighted * value;
                product += weighted * self.off[k];
            }
        }
        let variance = square - sum * sum;
        if variance < MIN_CONTRAST * MIN_CONTRAST {
            return FLAT_COST;
        }
        (1.0 - product * self.contrast / variance.sqrt()).clamp(0.0, MAX_COST)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Windows whose corners fall on the border of what is compared, give or take roundings.
    #[test]
    fn windows_at_the_border_are_inside_or_worst() {
        let (width, height) = (93, 124);
        let values = (0..width * height).map(|i| (i * 7919 % 997) as f32 / 997.0).collect();
        let picture = StereoImage { width, height, values };
        let window = Window::new(&picture, 40, 60);
        let mut inside = 0;
        for step in 0..4000 {
            let slope = 0.1 + 1e-4 * step as f32;
            let other = 1.1 - 1.7e-4 * step as f32;
            let base = [[1.0, 0.0, 0.0], [slope, other, 0.0], [0.0, 0.0, 1.0]];
            let warp = PhotoWarp { base, lift: [0.0; 3] };
            let mut source = StereoSource { picture: &picture, warp };
            // The lower right corner is sampled at a height of the border exactly, in real numbers.
            let corner = slope * (window.x + 4.0) + other * window.y + 4.0 * other.abs();
            source.warp.base[1][2] = height as f32 - 0.5 - corner;
            for ulps in 0..6 {
                source.warp.base[1][2] = source.warp.base[1][2].next_down();
                let cost = window.cost(&source, &[0.0, 0.0, 1.0]);
                inside += u32::from(cost < MAX_COST);
                assert!((0.0..=MAX_COST).contains(&cost), "{slope} {ulps}");
            }
            source.warp.base[1][2] -= 0.02;
            assert!(window.cost(&source, &[0.0, 0.0, 1.0]) < MAX_COST);
        }
        assert!(inside < 24_000);
    }
}
