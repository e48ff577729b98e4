//! Drops, flakes and streaks in a picture of what falls.

/// One that touches neither another nor the border.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blob {
    /// Sum of its coverage, px^2.
    pub cover: f64,
    /// Centre, px.
    pub at: [f64; 2],
    /// Length of its motion, px.
    pub length: f64,
    /// Angle from upright, radians, to the right at the lower end.
    pub angle: f64,
}

/// Coverage below which a pixel shows nothing: drops end at 1/256, and less is what a board lets through of those behind it.
const LEAST: f32 = 1.0 / 300.0;

/// The blobs of a picture of what falls, `[H, W, 4]` as in a frame.
pub fn blobs(particles: &[f32], width: usize) -> Vec<Blob> {
    let coverage: Vec<f32> = particles.iter().skip(3).step_by(4).copied().collect();
    let mut seen = vec![false; coverage.len()];
    let (mut found, mut open, mut pixels) = (Vec::new(), Vec::new(), Vec::new());
    for first in 0..coverage.len() {
        if seen[first] || coverage[first] <= LEAST {
            continue;
        }
        open.push(first);
        pixels.clear();
        let mut is_whole = true;
        seen[first] = true;
        while let Some(at) = open.pop() {
            pixels.push(at);
            let (x, y) = (at % width, at / width);
            if x == 0 || y == 0 || x + 1 == width || at + width >= coverage.len() {
                is_whole = false;
                continue;
            }
            for near in (0..9).map(|k| at + k % 3 + k / 3 * width - width - 1) {
                if !seen[near] && coverage[near] > LEAST {
                    seen[near] = true;
                    open.push(near);
                }
            }
        }
        if is_whole {
            found.push(blob(&coverage, width, &pixels));
        }
    }
    found
}

fn blob(coverage: &[f32], width: usize, pixels: &[usize]) -> Blob {
    // Optical depths add up: they are the Gaussian's.
    let tau = |at: usize| -(1.0 - f64::from(coverage[at]).min(1.0 - 1e-7)).ln();
    let place = |at: usize| [(at % width) as f64 + 0.5, (at / width) as f64 + 0.5];
    let (mut all, mut sums) = (0.0, [0.0; 2]);
    for at in pixels {
        let (tau, [x, y]) = (tau(*at), place(*at));
        all += tau;
        sums = [sums[0] + tau * x, sums[1] + tau * y];
    }
    let at = sums.map(|sum| sum / all);
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for pixel in pixels {
        let (tau, place) = (tau(*pixel) / all, place(*pixel));
        let [dx, dy] = [0, 1].map(|k| place[k] - at[k]);
        (xx, yy, xy) = (xx + tau * dx * dx, yy + tau * dy * dy, xy + tau * dx * dy);
    }
    // What lies below 1/256 is not drawn: a Gaussian that ends at q = -2 ln(1/256 / peak) lacks this of its variance.
    let peak = pixels.iter().map(|at| tau(*at)).fold(0.0, f64::max);
    let half = (256.0 * peak).ln().max(2.25);
    let kept = 1.0 - half / half.exp_m1();
    // A way of length l has the variance l^2 / 12; across there is none of it.
    let spread = ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt() / kept;
    let cover = pixels.iter().map(|at| f64::from(coverage[*at])).sum();
    Blob { cover, at, length: (12.0 * spread).sqrt(), angle: 0.5 * f64::atan2(2.0 * xy, yy - xx) }
}
