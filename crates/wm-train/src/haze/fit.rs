//! The fit of the haze's law to tracks.
//!
//! A point of the clear colour `J` seen from the distance `d` in photo p has the light
//! `y = e_p (J exp(-beta d) + B (1 - exp(-beta d)) / beta)`: Koschmieder's law with the light `B`
//! that the air adds a unit of length and the gain `e_p` of the photo. It is linear in `J` and `B`,
//! and stays one law for `beta` of 0 and below, so that clear air is nothing special to the fit.
//! Gauss-Newton steps are taken on `beta`, `B` and the gains, with each point's colour
//! eliminated; residuals are in display-referred units, in which noise is about even, and weighted
//! by Cauchy's function.

use super::sightings::{PointTrack, Sighting};
use wm_base::statistics::quantile;

/// Parameters before the gains: extinction, and the light that the air adds in three channels.
const SHARED_PARAMETERS: usize = 4;
/// Brightest clear colour, linear: sunlit white beside a well-exposed sky.
const MAX_CLEAR_COLOR: f64 = 1.5;
/// Residual, in standard deviations, at which the weight is one half: windows that show several
/// distances have larger residuals.
const CAUCHY_SCALE: f64 = 1.0;
/// Prior standard deviation of the logarithms of gains.
const GAIN_DEVIATION: f64 = 0.3;
/// Least standard deviation of residuals, display-referred: that of 8-bit quantisation.
const MIN_RESIDUAL: f64 = 0.002;
/// Most Gauss-Newton steps.
const MAX_STEPS: usize = 40;

/// A fit; lengths are in a unit of its own.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct HazeFit {
    /// Extinction, 1 / unit of length.
    pub(crate) beta: f64,
    /// Light that the air adds per unit of length.
    pub(crate) added: [f64; 3],
    /// Light of endless haze, if it is known: then `added` is this times `beta`.
    pub(crate) airlight: Option<[f64; 3]>,
    /// Logarithms of the photos' gains.
    pub(crate) gains: Vec<f64>,
    /// Standard deviation of residuals, display-referred.
    pub(crate) sigma: f64,
    /// Cauchy's cost, a mean over sightings.
    pub(crate) cost: f64,
}

/// The parameters that a fit may change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FreeParameters {
    /// The gains; extinction and light stay.
    Gains,
    /// The light and the gains; the extinction stays.
    Light,
    /// All.
    All,
}

impl HazeFit {
    /// Returns clear air and equal gains.
    pub(crate) fn clear(photos: usize) -> Self {
        let (beta, added, airlight, gains) = (0.0, [0.0; 3], None, vec![0.0; photos]);
        Self { beta, added, airlight, gains, sigma: 0.05, cost: f64::INFINITY }
    }

    /// Fits to `tracks`, whose distances are divided by `unit`, starting from this fit.
    pub(crate) fn fitted(mut self, tracks: &[&PointTrack], unit: f64, free: FreeParameters) -> Self {
        let mut damping = 1e-3;
        let mut sums = NormalEquations::of(&self, tracks, unit);
        for _ in 0..MAX_STEPS {
            // Costs are compared under one scale, which is estimated anew for every step.
            self.sigma = sums.sigma;
            let before = NormalEquations::of(&self, tracks, unit);
            self.cost = before.cost;
            let mut next = None;
            while damping < 1e6 {
                let Some(step) = before.step(&self, free, damping) else { break };
                let moved = self.moved(&step);
                let found = NormalEquations::of(&moved, tracks, unit);
                if found.cost <= before.cost {
                    damping = (damping * 0.3).max(1e-6);
                    next = Some((moved, found));
                    break;
                }
                damping *= 8.0;
            }
            let Some((moved, found)) = next else { break };
            let is_done = before.cost - found.cost < 1e-6 * before.cost;
            self = Self { cost: found.cost, ..moved };
            sums = found;
            if is_done {
                break;
            }
        }
        self
    }

    /// Returns the standard deviation of residuals with equal gains.
    pub(crate) fn sigma_of_even(&self, tracks: &[&PointTrack], unit: f64) -> f64 {
        NormalEquations::of(&Self { gains: vec![0.0; self.gains.len()], ..self.clone() }, tracks, unit).sigma
    }

    /// Returns the fit after a step.
    fn moved(&self, step: &[f64]) -> Self {
        let mut next = self.clone();
        next.beta = (next.beta + step[0].clamp(-0.5, 0.5)).clamp(-2.0, 12.0);
        (0..3).for_each(|c| next.added[c] += step[1 + c]);
        if let Some(airlight) = next.airlight {
            next.added = airlight.map(|light| light * next.beta);
        }
        let gains = next.gains.iter_mut().zip(&step[SHARED_PARAMETERS..]);
        gains.for_each(|(gain, step)| *gain = (*gain + step.clamp(-0.3, 0.3)).clamp(-3.0, 3.0));
        next
    }
}

/// Returns `(1 - exp(-beta d)) / beta` and its derivative by `beta`.
fn path(beta: f64, d: f64, t: f64) -> (f64, f64) {
    if (beta * d).abs() < 1e-3 {
        let x = beta * d;
        return (d * (1.0 - 0.5 * x + x * x / 6.0), d * d * (-0.5 + x / 3.0));
    }
    let u = (1.0 - t) / beta;
    (u, (d * t - u) / beta)
}

/// Returns the slope of the sRGB curve at a linear value: noise is about even in displayed values.
fn slope(light: f64) -> f64 {
    1.055 / 2.4 * light.max(0.004).powf(1.0 / 2.4 - 1.0)
}

/// The normal equations of one step.
struct NormalEquations {
    /// Row by row, `[SHARED_PARAMETERS + P, SHARED_PARAMETERS + P]`.
    normal: Vec<f64>,
    right: Vec<f64>,
    cost: f64,
    sigma: f64,
}

impl NormalEquations {
    fn of(fit: &HazeFit, tracks: &[&PointTrack], unit: f64) -> Self {
        let count = SHARED_PARAMETERS + fit.gains.len();
        let mut sums =
            Self { normal: vec![0.0; count * count], right: vec![0.0; count], cost: 0.0, sigma: 0.0 };
        let (mut offs, mut sightings) = (Vec::new(), 0usize);
        let mut rows = Vec::new();
        for track in tracks {
            rows.clear();
            rows.extend(track.sightings.iter().map(|sighting| SightingRow::of(fit, sighting, unit)));
            // Twice: with equal weights, then with the robust weights that follow from the
            // residuals.
            let mut colors = [0.0; 3];
            for _ in 0..2 {
                for c in 0..3 {
                    let (mut by, mut squares) = (0.0, 1e-12);
                    for row in &rows {
                        let a = row.slope[c] * row.kept;
                        by += row.weight
                            * a
                            * row.slope[c]
                            * (row.light[c] - row.gain * fit.added[c] * row.path);
                        squares += row.weight * a * a;
                    }
                    colors[c] = (by / squares).clamp(0.0, MAX_CLEAR_COLOR);
                }
                for row in &mut rows {
                    row.compare(fit, &colors);
                    let off =
                        row.off.iter().map(|off| off * off).sum::<f64>() / (3.0 * fit.sigma * fit.sigma);
                    row.weight = 1.0 / (1.0 + off / (CAUCHY_SCALE * CAUCHY_SCALE));
                    row.cost = (off / (CAUCHY_SCALE * CAUCHY_SCALE)).ln_1p();
                }
            }
            let freedom = (rows.len() as f64 / (rows.len() as f64 - 1.0)).sqrt();
            sightings += rows.len();
            for row in &rows {
                sums.cost += row.cost;
                offs.extend(row.off.map(|off| off.abs() * freedom));
            }
            sums.add(fit, &rows, &colors);
        }
        sums.cost /= sightings.max(1) as f64;
        sums.sigma = (1.4826 * quantile(&mut offs, 0.5)).max(MIN_RESIDUAL);
        let prior = fit.sigma * fit.sigma / (GAIN_DEVIATION * GAIN_DEVIATION);
        for (photo, gain) in fit.gains.iter().enumerate() {
            sums.normal[(SHARED_PARAMETERS + photo) * (count + 1)] += prior;
            sums.right[SHARED_PARAMETERS + photo] -= prior * gain;
        }
        // Scene brightness and gains are ambiguous: the mean of the gains is held at 1.
        let most = (SHARED_PARAMETERS..count).map(|i| sums.normal[i * (count + 1)]).fold(0.0, f64::max);
        let mean = fit.gains.iter().sum::<f64>();
        for i in SHARED_PARAMETERS..count {
            sums.right[i] -= most * mean;
            (SHARED_PARAMETERS..count).for_each(|j| sums.normal[i * count + j] += most);
        }
        sums
    }

    /// Adds one point, whose colour is eliminated (Schur complement).
    fn add(&mut self, fit: &HazeFit, rows: &[SightingRow], colors: &[f64; 3]) {
        let count = SHARED_PARAMETERS + fit.gains.len();
        let mut places: Vec<usize> = vec![0, 0];
        places.extend(rows.iter().map(|row| SHARED_PARAMETERS + row.photo));
        // Products of the derivatives by extinction, light and gains with that by the colour.
        let mut with_color = vec![0.0; places.len()];
        for c in 0..3 {
            places[1] = 1 + c;
            let is_held = colors[c] <= 0.0 || colors[c] >= MAX_CLEAR_COLOR;
            with_color.fill(0.0);
            let mut squares = 0.0;
            for (i, row) in rows.iter().enumerate() {
                let by = row.derivatives(fit, colors, c);
                let w = row.weight;
                let at = [0, 1 + c, SHARED_PARAMETERS + row.photo];
                for k in 0..3 {
                    self.right[at[k]] += w * by[k] * row.off[c];
                    for l in 0..3 {
                        self.normal[at[k] * count + at[l]] += w * by[k] * by[l];
                    }
                }
                let a = row.slope[c] * row.kept;
                squares += w * a * a;
                with_color[0] += w * a * by[0];
                with_color[1] += w * a * by[1];
                with_color[2 + i] += w * a * by[2];
            }
            if is_held || squares <= 0.0 {
                continue;
            }
            // The colour is the least-squares one: residuals are orthogonal to its derivative.
            for (k, p) in with_color.iter().zip(&places) {
                for (l, q) in with_color.iter().zip(&places) {
                    self.normal[p * count + q] -= k * l / squares;
                }
            }
        }
    }

    /// Solves for the step by Cholesky factorisation; `None` if the matrix is not positive
    /// definite.
    fn step(&self, fit: &HazeFit, free: FreeParameters, damping: f64) -> Option<Vec<f64>> {
        let count = SHARED_PARAMETERS + fit.gains.len();
        let first = match free {
            FreeParameters::All => 0,
            FreeParameters::Light => 1,
            FreeParameters::Gains => SHARED_PARAMETERS,
        };
        let size = count - first;
        let mut lower = vec![0.0; size * size];
        for i in 0..size {
            for j in 0..=i {
                let mut value = self.normal[(first + i) * count + first + j];
                if i == j {
                    value += damping * value.max(1e-12) + 1e-12;
                }
                for k in 0..j {
                    value -= lower[i * size + k] * lower[j * size + k];
                }
                if i == j {
                    if value <= 0.0 {
                        return None;
                    }
                    lower[i * size + i] = value.sqrt();
                } else {
                    lower[i * size + j] = value / lower[j * size + j];
                }
            }
        }
        let mut step = vec![0.0; count];
        for i in 0..size {
            let before: f64 = (0..i).map(|k| lower[i * size + k] * step[first + k]).sum();
            step[first + i] = (self.right[first + i] - before) / lower[i * size + i];
        }
        for i in (0..size).rev() {
            let after: f64 = (i + 1..size).map(|k| lower[k * size + i] * step[first + k]).sum();
            step[first + i] = (step[first + i] - after) / lower[i * size + i];
        }
        Some(step)
    }
}

/// A sighting under a fit.
struct SightingRow {
    photo: usize,
    light: [f64; 3],
    slope: [f64; 3],
    distance: f64,
    gain: f64,
    /// Gain times transmittance.
    kept: f64,
    path: f64,
    path_by_beta: f64,
    off: [f64; 3],
    weight: f64,
    cost: f64,
}

impl SightingRow {
    fn of(fit: &HazeFit, sighting: &Sighting, unit: f64) -> Self {
        let (photo, distance) = (sighting.photo as usize, f64::from(sighting.distance) / unit);
        let (gain, t) = (fit.gains[photo].exp(), (-fit.beta * distance).exp());
        let (path, path_by_beta) = path(fit.beta, distance, t);
        let light = sighting.light.map(f64::from);
        let slope = light.map(slope);
        Self {
            photo,
            light,
            slope,
            distance,
            gain,
            kept: gain * t,
            path,
            path_by_beta,
            off: [0.0; 3],
            weight: 1.0,
            cost: 0.0,
        }
    }

    /// Computes the residuals for the colours of the point.
    fn compare(&mut self, fit: &HazeFit, colors: &[f64; 3]) {
        for c in 0..3 {
            let model = self.gain * fit.added[c] * self.path + self.kept * colors[c];
            self.off[c] = self.slope[c] * (self.light[c] - model);
        }
    }

    /// Returns the derivatives of the displayed light in a channel by extinction, added light and
    /// gain.
    fn derivatives(&self, fit: &HazeFit, colors: &[f64; 3], c: usize) -> [f64; 3] {
        let added = self.gain * fit.added[c];
        let by_beta = added * self.path_by_beta - self.kept * self.distance * colors[c];
        let by_added = self.gain * self.path;
        let (by_beta, by_added) = match fit.airlight {
            None => (by_beta, by_added),
            Some(airlight) => (by_beta + airlight[c] * by_added, 0.0),
        };
        [by_beta, by_added, added * self.path + self.kept * colors[c]].map(|by| self.slope[c] * by)
    }
}
