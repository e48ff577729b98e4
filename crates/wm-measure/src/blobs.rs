//! Drops, flakes and streaks in a picture of what falls.

/// A drop, flake or streak that touches neither another one nor the border of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ParticleBlob {
    /// Sum of its coverage, px^2.
    pub(crate) cover: f64,
    /// Centre, px.
    pub(crate) at: [f64; 2],
    /// Length of its motion, px.
    pub(crate) length: f64,
    /// Angle from upright, radians, to the right at the lower end.
    pub(crate) angle: f64,
}

/// Coverage below which a pixel shows nothing: drops end at 1/256, and less is what a board lets
/// through of those behind it. Of thin ones, which end where they are a tenth of their peak, as
/// much less as they are thin.
const MIN_COVERAGE: f32 = 1.0 / 300.0;

/// The rule that divides a picture into blobs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum BlobSplit {
    /// Pixels that touch: streaks.
    Touching,
    /// Pixels from which it goes up to one peak: of drops and flakes that stand still. Those that
    /// touch mostly have two.
    Peaks,
}

/// Returns the blobs of a picture of falling particles, `[H, W, 4]` as in a frame, drawn at an
/// opacity.
pub(crate) fn blobs(particles: &[f32], width: usize, opacity: f64, split: BlobSplit) -> Vec<ParticleBlob> {
    let coverage = particles.iter().skip(3).step_by(4).copied().collect();
    let picture = Picture { coverage, width, least: MIN_COVERAGE * opacity.min(1.0) as f32 };
    let parts = match split {
        BlobSplit::Touching => picture.touching(),
        BlobSplit::Peaks => picture.peaks(),
    };
    let is_whole = |pixels: &&Vec<usize>| !pixels.iter().any(|at| picture.is_border(*at));
    parts.iter().filter(is_whole).map(|pixels| blob(&picture.coverage, width, pixels)).collect()
}

/// Coverage, row by row.
struct Picture {
    coverage: Vec<f32>,
    width: usize,
    least: f32,
}

/// Marks a pixel that belongs to no blob yet.
const NO_BLOB: usize = usize::MAX;

impl Picture {
    fn shown(&self) -> impl Iterator<Item = usize> {
        (0..self.coverage.len()).filter(|at| self.coverage[*at] > self.least)
    }

    fn is_border(&self, at: usize) -> bool {
        let (x, width) = (at % self.width, self.width);
        x == 0 || x + 1 == width || at < width || at + width >= self.coverage.len()
    }

    /// A pixel and those about it; of one at the border none.
    fn neighbours(&self, at: usize) -> impl Iterator<Item = usize> {
        let (count, width) = (if self.is_border(at) { 0 } else { 9 }, self.width);
        (0..count).map(move |k| at + k % 3 + k / 3 * width - width - 1)
    }

    /// The pixels of all that touch each other.
    fn touching(&self) -> Vec<Vec<usize>> {
        let mut seen = vec![false; self.coverage.len()];
        let (mut parts, mut open) = (Vec::new(), Vec::new());
        for first in self.shown() {
            if std::mem::replace(&mut seen[first], true) {
                continue;
            }
            let mut part = Vec::new();
            open.push(first);
            while let Some(at) = open.pop() {
                part.push(at);
                for near in self.neighbours(at).filter(|near| self.coverage[*near] > self.least) {
                    if !std::mem::replace(&mut seen[near], true) {
                        open.push(near);
                    }
                }
            }
            parts.push(part);
        }
        parts
    }

    /// The pixels from which it goes up to each peak: from the highest down, each goes with its
    /// highest neighbour.
    fn peaks(&self) -> Vec<Vec<usize>> {
        let higher = |a: &usize, b: &usize| self.coverage[*a].total_cmp(&self.coverage[*b]).then(b.cmp(a));
        let mut shown: Vec<usize> = self.shown().collect();
        shown.sort_by(|a, b| higher(b, a));
        let mut owner = vec![NO_BLOB; self.coverage.len()];
        let mut parts: Vec<Vec<usize>> = Vec::new();
        for at in shown {
            let above = self.neighbours(at).filter(|near| owner[*near] != NO_BLOB).max_by(higher);
            owner[at] = above.map_or(parts.len(), |above| owner[above]);
            if owner[at] == parts.len() {
                parts.push(Vec::new());
            }
            parts[owner[at]].push(at);
        }
        parts
    }
}

fn blob(coverage: &[f32], width: usize, pixels: &[usize]) -> ParticleBlob {
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
    // What lies below 1/256 is not drawn: a Gaussian that ends at q = -2 ln(1/256 / peak) lacks
    // this of its variance.
    let peak = pixels.iter().map(|at| tau(*at)).fold(0.0, f64::max);
    let half = (256.0 * peak).ln().max(2.25);
    let kept = 1.0 - half / half.exp_m1();
    // A way of length l has the variance l^2 / 12; across there is none of it.
    let spread = ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt() / kept;
    let cover = pixels.iter().map(|at| f64::from(coverage[*at])).sum();
    ParticleBlob { cover, at, length: (12.0 * spread).sqrt(), angle: 0.5 * f64::atan2(2.0 * xy, yy - xx) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drops_that_touch_are_parted_by_their_peaks() {
        // A large and a small one, standard deviation 0.7 px; the third reaches the border.
        let drops = [[12.3, 10.6, 2.0], [15.5, 12.0, 0.5], [1.0, 20.0, 1.0]];
        let variance = 0.49;
        let particles: Vec<f32> = (0..32 * 32)
            .flat_map(|at| {
                let tau = drops.iter().map(|[x, y, area]| {
                    let (dx, dy) = ((at % 32) as f64 + 0.5 - x, (at / 32) as f64 + 0.5 - y);
                    area / (std::f64::consts::TAU * variance) * (-0.5 * (dx * dx + dy * dy) / variance).exp()
                });
                [0.0, 0.0, 0.0, 1.0 - (-tau.sum::<f64>()).exp() as f32]
            })
            .collect();
        let found = |split| blobs(&particles, 32, 1.0, split);
        // Coverage, 1 - e^-tau, is less than tau: by 14 % and 4 % at these peaks. What the large
        // one takes of the small one's edge changes the sum of volumes by little, to take both for
        // one by a quarter.
        let volume = |blobs: &[ParticleBlob]| blobs.iter().map(|blob| blob.cover.powf(1.5)).sum::<f64>();
        let wanted = 1.7147f64.powf(1.5) + 0.4804f64.powf(1.5);
        let (parted, touching) = (found(BlobSplit::Peaks), found(BlobSplit::Touching));
        assert_eq!([parted.len(), touching.len()], [2, 1]);
        let off = [&parted, &touching].map(|found| volume(found) / wanted - 1.0);
        assert!(off[0].abs() < 0.02 && off[1] > 0.2, "{off:?}");
    }
}
