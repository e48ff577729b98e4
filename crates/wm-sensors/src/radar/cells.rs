//! Cells of range, azimuth and velocity: what comes into each, and which of them are detected.
//!
//! A scatterer has its power in the cells around it, by a response of 1.44 cells at half power in
//! each direction (a Gaussian like the main lobe of a Hann window; side lobes are left out). A
//! cell's power is `|sqrt(S) + n|^2` with the power `S` of surfaces, which add up, and a complex
//! normal number `n` of noise and rain: alone they are distributed exponentially, as speckle is.
//!
//! A detection is a cell that no neighbour exceeds and that is above `N (P^(-1/N) - 1)` times the
//! mean of `N` cells around it (cell averaging), where `P` is the share of false alarms.

use super::model::RadarModel;
use std::f64::consts::{LN_2, TAU};
use wm_base::random::RandomStream;

/// Width of the response at half power, cells, and its reach.
const RESPONSE_WIDTH_CELLS: f64 = 1.44;
const RESPONSE_REACH_CELLS: f64 = 2.0;
/// Azimuth cells to each side whose rays add to one.
pub(super) const SIDE_CELLS: usize = 2;
/// Cells to each side in range and velocity that are averaged, and guard cells next to the middle
/// that are not.
const TRAINING_CELLS: [usize; 2] = [8, 16];
const GUARD_CELLS: [usize; 2] = [2, 3];
/// Least power of a candidate cell, as a share of the detection threshold in noise.
const MIN_THRESHOLD_SHARE: f64 = 0.25;

/// A piece of a surface that sends power back. Places are in cells, whole numbers in their middles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scatterer {
    /// Range, azimuth and velocity.
    pub(crate) at: [f64; 3],
    /// Radians.
    pub(crate) elevation: f64,
    /// Power over the noise.
    pub(crate) power: f64,
}

/// Rain in the cells of one azimuth, over the noise.
#[derive(Clone, Debug, Default)]
pub(super) struct RainClutter {
    /// Power of all velocities, for each cell of range; empty without rain.
    pub(crate) powers: Vec<f64>,
    /// The share in each cell of velocity.
    pub(crate) shares: Vec<f64>,
}

impl RainClutter {
    /// The power in a cell of range and velocity.
    pub(super) fn at(&self, range: usize, velocity: usize) -> f64 {
        self.powers.get(range).map_or(0.0, |power| power * self.shares[velocity])
    }
}

/// Share of the power of a scatterer in a cell that is `off` cells away.
fn response(off: f64) -> f64 {
    if off.abs() > RESPONSE_REACH_CELLS {
        0.0
    } else {
        (-4.0 * LN_2 * (off / RESPONSE_WIDTH_CELLS).powi(2)).exp()
    }
}

/// Share of a scatterer in a cell of `[range, azimuth, velocity]`.
fn share(scatterer: &Scatterer, cell: [usize; 3], velocities: usize) -> f64 {
    let off = |k: usize| cell[k] as f64 - scatterer.at[k];
    // Velocities go round.
    let count = velocities as f64;
    let around = (off(2) + 0.5 * count).rem_euclid(count) - 0.5 * count;
    response(off(0)) * response(off(1)) * response(around)
}

/// The powers of one cell of azimuth, `[ranges, velocities]`, of the scatterers near it.
pub(super) fn powers<'a>(
    model: &RadarModel,
    azimuth: usize,
    scatterers: impl Iterator<Item = &'a Scatterer>,
    clutter: &RainClutter,
    random: &RandomStream,
) -> Vec<f32> {
    let [ranges, _, velocities] = model.cells();
    let mut powers = vec![0.0f32; ranges * velocities];
    for one in scatterers {
        let across = one.power * response(azimuth as f64 - one.at[1]);
        if across <= 0.0 {
            continue;
        }
        let reach = RESPONSE_REACH_CELLS as i64;
        let [range, velocity] = [one.at[0].round(), one.at[2].round()];
        for row in (range as i64 - reach)..=(range as i64 + reach) {
            if !(0..ranges as i64).contains(&row) {
                continue;
            }
            let along = across * response(row as f64 - one.at[0]);
            for step in -reach..=reach {
                let column = (velocity as i64 + step).rem_euclid(velocities as i64) as usize;
                let share = response(velocity + step as f64 - one.at[2]);
                powers[row as usize * velocities + column] += (along * share) as f32;
            }
        }
    }
    let first = (azimuth * ranges * velocities) as u64;
    for (index, power) in powers.iter_mut().enumerate() {
        let mean = 1.0 + clutter.at(index / velocities, index % velocities);
        let number = 2 * (first + index as u64);
        let speckle = -mean * (1.0 - random.uniform(number)).max(f64::MIN_POSITIVE).ln();
        let signal = f64::from(*power);
        let mixed = if signal > 0.0 {
            2.0 * (signal * speckle).sqrt() * (TAU * random.uniform(number + 1)).cos()
        } else {
            0.0
        };
        *power = (signal + speckle + mixed).max(0.0) as f32;
    }
    powers
}

/// A cell that was detected.
#[derive(Clone, Copy, Debug)]
pub(super) struct DetectedCell {
    /// Range, azimuth and velocity.
    pub(crate) cell: [usize; 3],
    /// Interpolated position between cells.
    pub(crate) at: [f64; 3],
    /// Interpolated power over the noise.
    pub(crate) power: f64,
    /// Mean power of the cells around it.
    pub(crate) mean: f64,
}

/// The powers of all cells.
pub(super) struct PowerCube<'a> {
    model: &'a RadarModel,
    /// Power by azimuth, `[ranges, velocities]` each.
    rows: &'a [Vec<f32>],
    /// Cells in range, azimuth and velocity.
    count: [usize; 3],
}

impl<'a> PowerCube<'a> {
    pub(super) fn new(model: &'a RadarModel, rows: &'a [Vec<f32>]) -> Self {
        Self { model, rows, count: model.cells() }
    }

    fn power(&self, cell: [usize; 3]) -> f32 {
        let [range, azimuth, velocity] = cell;
        self.rows[azimuth][range * self.count[2] + velocity]
    }

    /// The detections of one azimuth, in the order of ranges and velocities.
    pub(super) fn detections(&self, azimuth: usize) -> Vec<DetectedCell> {
        let velocities = self.count[2];
        let least = (MIN_THRESHOLD_SHARE * self.model.threshold()) as f32;
        let first = (self.model.range[0] / self.model.range_cell).ceil() as usize * velocities;
        let mut found = Vec::new();
        for (index, power) in self.rows[azimuth].iter().enumerate().skip(first) {
            let cell = [index / velocities, azimuth, index % velocities];
            if *power < least || !self.is_peak(cell) {
                continue;
            }
            let (mean, count) = self.around(cell);
            let count = count as f64;
            let factor = count * (self.model.false_alarms.powf(-1.0 / count) - 1.0);
            if f64::from(*power) > factor * mean {
                let (at, power) = self.between(cell);
                found.push(DetectedCell { cell, at, power, mean });
            }
        }
        found
    }

    /// The neighbour of a cell that lies `by` cells on in direction `k`, if there is one.
    /// Velocities go round.
    fn neighbour(&self, cell: [usize; 3], k: usize, by: i64) -> Option<[usize; 3]> {
        let count = self.count[k] as i64;
        let place = cell[k] as i64 + by;
        let mut next = cell;
        next[k] = if k == 2 { place.rem_euclid(count) } else { place } as usize;
        (k == 2 || (0..count).contains(&place)).then_some(next)
    }

    /// Returns true if none of the 26 cells around it has more power, or as much and comes before
    /// it.
    fn is_peak(&self, cell: [usize; 3]) -> bool {
        let own = self.power(cell);
        let exceeds = |other: [usize; 3]| {
            let power = self.power(other);
            power > own || power == own && other < cell
        };
        !(0..27).any(|index| {
            let other = self
                .neighbour(cell, 0, index / 9 - 1)
                .and_then(|cell| self.neighbour(cell, 1, index / 3 % 3 - 1))
                .and_then(|cell| self.neighbour(cell, 2, index % 3 - 1));
            other.is_some_and(exceeds)
        })
    }

    /// The mean power of the cells around one, of the same azimuth, and their number.
    fn around(&self, cell: [usize; 3]) -> (f64, usize) {
        let [range, azimuth, velocity] = cell;
        let [ranges, _, velocities] = self.count;
        let nearest = (self.model.range[0] / self.model.range_cell).ceil() as usize;
        let side = TRAINING_CELLS[1].min((velocities - 1) / 2) as i64;
        let (mut sum, mut count) = (0.0, 0usize);
        for row in
            range.saturating_sub(TRAINING_CELLS[0]).max(nearest)..=(range + TRAINING_CELLS[0]).min(ranges - 1)
        {
            let is_near = row.abs_diff(range) <= GUARD_CELLS[0];
            let powers = &self.rows[azimuth][row * velocities..(row + 1) * velocities];
            for step in -side..=side {
                if is_near && step.unsigned_abs() as usize <= GUARD_CELLS[1] {
                    continue;
                }
                let column = (velocity as i64 + step).rem_euclid(velocities as i64) as usize;
                sum += f64::from(powers[column]);
                count += 1;
            }
        }
        (sum / count.max(1) as f64, count.max(1))
    }

    /// The place and the power of a peak between cells: by parabolas through the logarithms of
    /// three, which a Gaussian's are.
    fn between(&self, cell: [usize; 3]) -> ([f64; 3], f64) {
        let log = |cell: [usize; 3]| f64::from(self.power(cell)).max(1e-6).ln();
        let middle = log(cell);
        let mut at = cell.map(|place| place as f64);
        let mut power = middle;
        for (k, place) in at.iter_mut().enumerate() {
            let (Some(before), Some(after)) = (self.neighbour(cell, k, -1), self.neighbour(cell, k, 1))
            else {
                continue;
            };
            let [before, after] = [log(before), log(after)];
            let bend = before - 2.0 * middle + after;
            if bend < -1e-9 {
                let off = (0.5 * (before - after) / bend).clamp(-0.5, 0.5);
                *place += off;
                power -= 0.25 * (before - after) * off;
            }
        }
        (at, power.exp())
    }
}

/// The mean power of scatterers in a cell, and their mean elevation by power, radians.
pub(super) fn surfaces_in<'a>(
    model: &RadarModel,
    cell: [usize; 3],
    scatterers: impl Iterator<Item = &'a Scatterer>,
) -> (f64, f64) {
    let velocities = model.cells()[2];
    let (mut power, mut elevation) = (0.0, 0.0);
    for one in scatterers {
        let part = one.power * share(one, cell, velocities);
        power += part;
        elevation += part * one.elevation;
    }
    (power, if power > 0.0 { elevation / power } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_its_mean_and_its_false_alarms() {
        let text = super::super::RADAR_PRESETS[2].1.replace("1e-6", "1e-3");
        let model = RadarModel::parse(&text, "test").unwrap();
        let [ranges, azimuths, velocities] = model.cells();
        let random = RandomStream::new(1, 2u64, 3);
        let clutter = RainClutter::default();
        let rows: Vec<Vec<f32>> =
            (0..azimuths).map(|azimuth| powers(&model, azimuth, [].iter(), &clutter, &random)).collect();
        let count = (ranges * azimuths * velocities) as f64;
        let mean = rows.iter().flatten().map(|power| f64::from(*power)).sum::<f64>() / count;
        assert!((mean - 1.0).abs() < 0.005, "{mean}");
        let cube = PowerCube::new(&model, &rows);
        let found: usize = (0..azimuths).map(|azimuth| cube.detections(azimuth).len()).sum();
        // Neighbours of peaks that are above the threshold too, some 1 %, are not detections.
        let share = found as f64 / (count * 1e-3);
        assert!((0.88..1.08).contains(&share), "{share}");
    }
}
