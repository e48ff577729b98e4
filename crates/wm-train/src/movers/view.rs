//! Photos at the size of the search: the scene's depth, and colours at several scales with the
//! range of their neighbours.

use wm_scene::Camera;

/// Scales of a photo: two photos are compared at the scale of the more distant one.
pub(crate) const SCALE_COUNT: usize = 4;
/// Radius of the window in which matches of stereo are counted, px.
const NEAR_RADIUS_PX: usize = 4;
/// Radius of the wider window, px, which must be without matches for a mover to grow over a pixel.
const FAR_RADIUS_PX: usize = 6;
/// Largest difference of colours of one surface: matches of the background beside a leg do not
/// count for the leg.
const SAME_SURFACE_DIFFERENCE: f32 = 0.2;
/// Least share of known stereo depth around a pixel for its own depth to count: outliers are
/// isolated.
const MIN_KNOWN_SHARE: f32 = 0.04;

/// Half the width of the bands in which a gap must have known depth on both sides, px.
const HALF_BAND_PX: usize = 3;

/// One scale of a photo.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scale {
    /// Width, px.
    pub(crate) width: usize,
    /// Height, px.
    pub(crate) height: usize,
    /// Mean colour of each pixel.
    pub(crate) mean: Vec<[f32; 3]>,
    /// Least and largest colours in the 3x3 window of each pixel: the range within an error of one
    /// pixel.
    pub(crate) range: Vec<[[f32; 3]; 2]>,
}

/// A photo at the size of the search.
#[derive(Clone, Debug)]
pub(crate) struct MoverView {
    /// The camera at this size.
    pub(crate) camera: Camera,
    /// Inverse view z of the scene, 1 / scene unit; 0 in the sky, NaN outside of what is known.
    pub(crate) disparity: Vec<f32>,
    /// Share of the pixels near each one that stereo matched and that have its colour.
    pub(crate) matched: Vec<f32>,
    /// The share in the wider window.
    pub(crate) around: Vec<f32>,
    /// Share of all pixels that stereo matched.
    pub(crate) known: f32,
    /// From fine to coarse, each half as wide.
    pub(crate) scales: Vec<Scale>,
}

impl MoverView {
    /// Makes a view of colours `[H, W]` without the photo's exposure and of inverse depth from
    /// stereo, 0 in the sky and NaN where it is not known.
    ///
    /// # Panics
    /// If the arrays have not the size of the camera.
    pub(crate) fn new(camera: Camera, colors: &[[f32; 3]], stereo: &[f32]) -> Self {
        let (width, height) = (camera.width as usize, camera.height as usize);
        assert!(
            colors.len() == width * height && stereo.len() == colors.len(),
            "arrays of the camera's size"
        );
        let mut scales = vec![Scale::new(width, height, smoothed(&smoothed(colors, width), width))];
        while scales.len() < SCALE_COUNT {
            let next = scales[scales.len() - 1].halved();
            scales.push(next);
        }
        let matches: Vec<bool> = stereo.iter().map(|disparity| *disparity > 0.0).collect();
        let alike = |radius: usize| shares_alike(&matches, &scales[0].mean, width, radius);
        let (mut matched, mut around) = (alike(NEAR_RADIUS_PX), alike(FAR_RADIUS_PX));
        let dense = shares(&matches, width, NEAR_RADIUS_PX);
        let known = matches.iter().filter(|known| **known).count() as f32 / matches.len() as f32;
        let kept = |disparity: f32, matched: f32| {
            if disparity > 0.0 && matched < MIN_KNOWN_SHARE { f32::NAN } else { disparity }
        };
        let believed = stereo.iter().zip(&dense).map(|(disparity, matched)| kept(*disparity, *matched));
        let disparity = filled(&believed.collect::<Vec<f32>>(), width);
        // Clouds and the glow of the sky differ between photos, and nothing is behind them.
        for pixel in (0..stereo.len()).filter(|pixel| stereo[*pixel] == 0.0) {
            (matched[pixel], around[pixel]) = (1.0, 1.0);
        }
        Self { camera, disparity, matched, around, known, scales }
    }

    /// Returns width and height, px.
    pub(crate) fn size(&self) -> (usize, usize) {
        (self.scales[0].width, self.scales[0].height)
    }
}

impl Scale {
    fn new(width: usize, height: usize, mean: Vec<[f32; 3]>) -> Self {
        let beside = |at: usize, count: usize| at.saturating_sub(1)..(at + 2).min(count);
        let range = |pixel: usize| {
            let (x, y) = (pixel % width, pixel / width);
            let mut range = [mean[pixel]; 2];
            for v in beside(y, height) {
                for u in beside(x, width) {
                    for (c, value) in mean[v * width + u].into_iter().enumerate() {
                        range[0][c] = range[0][c].min(value);
                        range[1][c] = range[1][c].max(value);
                    }
                }
            }
            range
        };
        let range = (0..width * height).map(range).collect();
        Self { width, height, mean, range }
    }

    /// Returns the means of 2x2 blocks; an odd last row or column is cut off.
    fn halved(&self) -> Self {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let mean = |pixel: usize| {
            let (x, y) = (2 * (pixel % width), 2 * (pixel / width));
            let (right, below) = ((x + 1).min(self.width - 1), (y + 1).min(self.height - 1));
            let places = [(x, y), (right, y), (x, below), (right, below)];
            let colors = places.map(|(x, y)| self.mean[y * self.width + x]);
            [0, 1, 2].map(|c| 0.25 * colors.iter().map(|color| color[c]).sum::<f32>())
        };
        let mean = (0..width * height).map(mean).collect();
        Self::new(width, height, mean)
    }

    /// Returns the index of the pixel that contains a point of the finest scale.
    #[inline]
    pub(crate) fn pixel(&self, x: f32, y: f32, scale: usize) -> usize {
        let by = 1.0 / (1u32 << scale) as f32;
        let (x, y) = ((x * by) as usize, (y * by) as usize);
        y.min(self.height - 1) * self.width + x.min(self.width - 1)
    }
}

/// Smooths with a 3x3 binomial filter, so that sensor noise makes no difference.
fn smoothed(colors: &[[f32; 3]], width: usize) -> Vec<[f32; 3]> {
    let height = colors.len() / width;
    let mean = |before: [f32; 3], here: [f32; 3], after: [f32; 3]| {
        [0, 1, 2].map(|c| 0.25 * before[c] + 0.5 * here[c] + 0.25 * after[c])
    };
    let across = |pixel: usize| {
        let x = pixel % width;
        let (before, after) = (pixel - usize::from(x > 0), pixel + usize::from(x + 1 < width));
        mean(colors[before], colors[pixel], colors[after])
    };
    let rows: Vec<[f32; 3]> = (0..colors.len()).map(across).collect();
    let down = |pixel: usize| {
        let y = pixel / width;
        let (before, after) =
            (pixel - width * usize::from(y > 0), pixel + width * usize::from(y + 1 < height));
        mean(rows[before], rows[pixel], rows[after])
    };
    (0..colors.len()).map(down).collect()
}

/// Returns the share of pixels in the window of `radius` about each pixel that are set and have
/// its colour.
fn shares_alike(of: &[bool], colors: &[[f32; 3]], width: usize, radius: usize) -> Vec<f32> {
    let height = of.len() / width;
    let near = |at: usize, count: usize| at.saturating_sub(radius)..(at + radius + 1).min(count);
    let share = |pixel: usize| {
        let (columns, rows) = (near(pixel % width, width), near(pixel / width, height));
        let area = columns.len() * rows.len();
        let own = colors[pixel];
        let is_alike = |other: &usize| {
            of[*other] && (0..3).all(|c| (colors[*other][c] - own[c]).abs() <= SAME_SURFACE_DIFFERENCE)
        };
        let in_row = |y: usize| (y * width + columns.start..y * width + columns.end).filter(is_alike).count();
        rows.map(in_row).sum::<usize>() as f32 / area as f32
    };
    (0..of.len()).map(share).collect()
}

/// One scale of inverse depths during interpolation; the weight of each is 1 if known, else 0.
struct Layer {
    width: usize,
    height: usize,
    cells: Vec<(f32, f32)>,
}

/// Interpolates unknown values (NaN) from known ones around them, near ones first. The inverse
/// depth of a plane is linear over the image, so walls and roads stay nearly flat.
fn filled(known: &[f32], width: usize) -> Vec<f32> {
    let cell = |disparity: &f32| if disparity.is_nan() { (0.0, 0.0) } else { (*disparity, 1.0) };
    let cells: Vec<(f32, f32)> = known.iter().map(cell).collect();
    if cells.iter().all(|(_, weight)| *weight == 0.0) {
        return known.to_vec();
    }
    let mut layers = vec![Layer { width, height: known.len() / width, cells }];
    while let Some(last) = layers.last().filter(|last| last.cells.len() > 1) {
        let next = last.halved();
        layers.push(next);
    }
    for at in (0..layers.len() - 1).rev() {
        let (fine, coarse) = layers.split_at_mut(at + 1);
        fine[at].fill_from(&coarse[0]);
    }
    let is_between = enclosed(known, width);
    let value = |pixel: usize| if is_between[pixel] { layers[0].cells[pixel].0 } else { f32::NAN };
    (0..known.len()).map(value).collect()
}

/// Returns the pixels with known depth to the left and right, and above and below: depth is
/// interpolated, not extrapolated.
fn enclosed(known: &[f32], width: usize) -> Vec<bool> {
    let height = known.len() / width;
    // The first and last known pixel of each row and column.
    let mut rows = vec![(usize::MAX, 0); height];
    let mut columns = vec![(usize::MAX, 0); width];
    for pixel in (0..known.len()).filter(|pixel| !known[*pixel].is_nan()) {
        let (x, y) = (pixel % width, pixel / width);
        rows[y] = (rows[y].0.min(x), rows[y].1.max(x));
        columns[x] = (columns[x].0.min(y), columns[x].1.max(y));
    }
    let widened = |ends: &[(usize, usize)]| -> Vec<(usize, usize)> {
        let band =
            |at: usize| &ends[at.saturating_sub(HALF_BAND_PX)..(at + HALF_BAND_PX + 1).min(ends.len())];
        let both = |a: (usize, usize), b: &(usize, usize)| (a.0.min(b.0), a.1.max(b.1));
        (0..ends.len()).map(|at| band(at).iter().fold((usize::MAX, 0), both)).collect()
    };
    let (rows, columns) = (widened(&rows), widened(&columns));
    let is_in = |at: usize, (first, last): (usize, usize)| first <= at && at <= last;
    (0..known.len())
        .map(|pixel| {
            let (x, y) = (pixel % width, pixel / width);
            is_in(x, rows[y]) && is_in(y, columns[x])
        })
        .collect()
}

impl Layer {
    fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let cell = |i: usize| {
            let (x, y) = (2 * (i % width), 2 * (i / width));
            let (mut sum, mut weights) = (0.0, 0.0);
            for v in y..(y + 2).min(self.height) {
                for u in x..(x + 2).min(self.width) {
                    let (disparity, weight) = self.cells[v * self.width + u];
                    sum += disparity * weight;
                    weights += weight;
                }
            }
            if weights > 0.0 { (sum / weights, weights.min(1.0)) } else { (0.0, 0.0) }
        };
        Self { width, height, cells: (0..width * height).map(cell).collect() }
    }

    fn fill_from(&mut self, coarse: &Self) {
        let width = self.width;
        for (i, cell) in self.cells.iter_mut().enumerate().filter(|(_, cell)| cell.1 < 1.0) {
            let place = |at: usize, count: usize| {
                let at = (at as f32 * 0.5 - 0.25).clamp(0.0, count as f32 - 1.0);
                (at as usize, (at as usize + 1).min(count - 1), at.fract())
            };
            let ((left, right, a), (top, bottom, b)) =
                (place(i % width, coarse.width), place(i / width, coarse.height));
            let of = |x: usize, y: usize| coarse.cells[y * coarse.width + x].0;
            let upper = of(left, top) * (1.0 - a) + of(right, top) * a;
            let lower = of(left, bottom) * (1.0 - a) + of(right, bottom) * a;
            let around = upper * (1.0 - b) + lower * b;
            *cell = (cell.0 * cell.1 + around * (1.0 - cell.1), 1.0);
        }
    }
}

/// Returns the share of set pixels in the window of `radius` about each pixel.
pub(crate) fn shares(of: &[bool], width: usize, radius: usize) -> Vec<f32> {
    let height = of.len() / width;
    let side = |at: usize, count: usize| (at + radius + 1).min(count) - at.saturating_sub(radius);
    let area = |pixel: usize| side(pixel % width, width) * side(pixel / width, height);
    counts(of, width, radius)
        .into_iter()
        .enumerate()
        .map(|(i, count)| count as f32 / area(i) as f32)
        .collect()
}

/// Returns the number of set pixels in the window of `radius` about each pixel; none are set
/// outside of the photo.
pub(crate) fn counts(of: &[bool], width: usize, radius: usize) -> Vec<usize> {
    let height = of.len() / width;
    let near = |at: usize, count: usize| at.saturating_sub(radius)..(at + radius + 1).min(count);
    let in_row = |pixel: usize| {
        let row = &of[pixel / width * width..][..width];
        row[near(pixel % width, width)].iter().filter(|set| **set).count()
    };
    let rows: Vec<usize> = (0..of.len()).map(in_row).collect();
    let in_all = |pixel: usize| near(pixel / width, height).map(|y| rows[y * width + pixel % width]).sum();
    (0..of.len()).map(in_all).collect()
}
