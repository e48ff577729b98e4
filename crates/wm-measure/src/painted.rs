//! Weather painted on frames, one by one, as programs do that know no geometry: what consistency is
//! compared with.
//!
//! Fog is as thick as a pixel is high in the picture, with banks of noise, and as bright as the
//! brightest of the frame; snow lies where the picture is bright and gets brighter upwards; flakes
//! are dots at random places. Noise and flakes are drawn anew for each frame, as a generator draws
//! them. It stands for no program in particular: it is what is left without depth, pose and time.

use wm_base::random::uniform;

/// A frame, linear light, `[H, W, 3]`.
pub(crate) struct PaintedFog {
    /// With fog.
    pub(crate) rgb: Vec<f32>,
    /// The share of light that its fog lets through, `[H, W]`.
    pub(crate) share: Vec<f32>,
}

/// Edge of the banks of noise, px.
const NOISE_CELL_PX: usize = 40;

/// Paints fog: the frame's own colours `rgb` in linear light.
pub(crate) fn fog(rgb: &[f32], width: usize, height: usize, seed: u64) -> PaintedFog {
    let mut brightness: Vec<f32> = rgb.to_vec();
    brightness.sort_by(f32::total_cmp);
    let light = brightness[brightness.len() * 95 / 100];
    let columns = width / NOISE_CELL_PX + 2;
    let node = |x: usize, y: usize| uniform(seed, (y * columns + x) as u64);
    let bank = |x: usize, y: usize| {
        let (column, row) = (x / NOISE_CELL_PX, y / NOISE_CELL_PX);
        let [a, b] = [x % NOISE_CELL_PX, y % NOISE_CELL_PX].map(|v| v as f64 / NOISE_CELL_PX as f64);
        let along = |row: usize| node(column, row) * (1.0 - a) + node(column + 1, row) * a;
        along(row) * (1.0 - b) + along(row + 1) * b
    };
    let mut painted =
        PaintedFog { rgb: Vec::with_capacity(rgb.len()), share: Vec::with_capacity(width * height) };
    for y in 0..height {
        for x in 0..width {
            // The farther up, the farther away, as far as a picture tells by itself.
            let far = 1.0 - (y as f64 / height as f64);
            let share = (1.0 - far * (0.6 + 0.5 * bank(x, y))).clamp(0.02, 1.0) as f32;
            painted.share.push(share);
            let at = 3 * (y * width + x);
            painted.rgb.extend(rgb[at..at + 3].iter().map(|v| v * share + light * (1.0 - share)));
        }
    }
    painted
}

/// Returns the mask of painted snow: bright pixels that are not in the top quarter.
pub(crate) fn snow(rgb: &[f32], width: usize, height: usize, seed: u64) -> Vec<bool> {
    let bright = |at: usize| rgb[3 * at..3 * at + 3].iter().sum::<f32>() / 3.0;
    let mut sorted: Vec<f32> = (0..width * height).map(bright).collect();
    sorted.sort_by(f32::total_cmp);
    let threshold = sorted[sorted.len() * 6 / 10];
    let covered = |at: usize| {
        let noise = 0.8 + 0.4 * uniform(seed, at as u64) as f32;
        bright(at) * noise > threshold && at / width > height / 4
    };
    (0..width * height).map(covered).collect()
}
