//! The fit of the haze's law to tracks.
//!
//! A point of the clear colour `J` seen from the distance `d` in photo p has the light
//! `y = e_p (J exp(-beta d) + B (1 - exp(-beta d)) / beta)`: Koschmieder's law with the light `B`
//! that the air adds a unit of length and the gain `e_p` of the photo. It is linear in `J` and `B`,
//! and stays one law for `beta` of 0 and below, so that clear air is nothing special to the fit.
//! Gauss and Newton's steps are taken on `beta`, `B` and the gains, with each point's colour
//! eliminated; residuals are in display-referred units, in which noise is about even, and weighted
//! by Cauchy's function.

use super::sightings::{PointTrack, Sighting};

/// Numbers before the gains: extinction and the light that the air adds in three channels.
const HEAD: usize = 4;
/// Brightest clear colour, linear light: white in the sun beside a sky that is exposed well.
const BRIGHTEST: f64 = 1.5;
/// Residuals, in standard deviations, that count for half: windows that show several distances have
/// larger ones.
const CAUCHY: f64 = 1.0;
/// Standard deviation of logarithms of gains before anything is seen.
const GAINS: f64 = 0.3;
/// Least standard deviation of residuals, display-referred: that of bytes.
const LEAST: f64 = 0.002;
/// Most of Gauss and Newton's steps.
const STEPS: usize = 40;

/// A fit, with lengths in units of its own.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct HazeFit {
    /// Extinction a unit of length.
    pub(crate) beta: f64,
    /// Light that the air adds a unit of length.
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

/// The numbers that a fit may change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Free {
    /// The gains, for air of the extinction and the light that it has.
    Gains,
    /// The light and the gains, for air of the extinction that it has.
    Light,
    /// All.
    All,
}

impl HazeFit {
    /// Clear air and even gains.
    pub(crate) fn clear(photos: usize) -> Self {
        let (beta, added, airlight, gains) = (0.0, [0.0; 3], None, vec![0.0; photos]);
        Self { beta, added, airlight, gains, sigma: 0.05, cost: f64::INFINITY }
    }

    /// Returns the fit to `tracks`, whose distances are divided by `unit`, from this one on.
    pub(crate) fn fitted(mut self, tracks: &[&PointTrack], unit: f64, free: Free) -> Self {
        let mut damping = 1e-3;
        let mut sums = Sums::of(&self, tracks, unit);
        for _ in 0..STEPS {
            // Costs are compared under one scale; another is taken with every step.
            self.sigma = sums.sigma;
            let before = Sums::of(&self, tracks, unit);
            self.cost = before.cost;
            let mut next = None;
            while damping < 1e6 {
                let Some(step) = before.step(&self, free, damping) else { break };
                let moved = self.moved(&step);
                let found = Sums::of(&moved, tracks, unit);
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

    /// Returns the standard deviation of residuals that photos of even exposure would have.
    pub(crate) fn sigma_of_even(&self, tracks: &[&PointTrack], unit: f64) -> f64 {
        Sums::of(&Self { gains: vec![0.0; self.gains.len()], ..self.clone() }, tracks, unit).sigma
    }

    /// The fit after a step.
    fn moved(&self, step: &[f64]) -> Self {
        let mut next = self.clone();
        next.beta = (next.beta + step[0].clamp(-0.5, 0.5)).clamp(-2.0, 12.0);
        (0..3).for_each(|c| next.added[c] += step[1 + c]);
        if let Some(airlight) = next.airlight {
            next.added = airlight.map(|light| light * next.beta);
        }
        let gains = next.gains.iter_mut().zip(&step[HEAD..]);
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

/// Steepness of sRGB at a linear light: noise is about even in what is displayed.
fn slope(light: f64) -> f64 {
    1.055 / 2.4 * light.max(0.004).powf(1.0 / 2.4 - 1.0)
}

/// The normal equations of one step.
struct Sums {
    /// Row by row, `[HEAD + P, HEAD + P]`.
    normal: Vec<f64>,
    right: Vec<f64>,
    cost: f64,
    sigma: f64,
}

impl Sums {
    fn of(fit: &HazeFit, tracks: &[&PointTrack], unit: f64) -> Self {
        let count = HEAD + fit.gains.len();
        let mut sums =
            Self { normal: vec![0.0; count * count], right: vec![0.0; count], cost: 0.0, sigma: 0.0 };
        let (mut offs, mut sightings) = (Vec::new(), 0usize);
        let mut rows = Vec::new();
        for track in tracks {
            rows.clear();
            rows.extend(track.sightings.iter().map(|sighting| Row::of(fit, sighting, unit)));
            // Twice: with even weights, and with those that follow.
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
                    colors[c] = (by / squares).clamp(0.0, BRIGHTEST);
                }
                for row in &mut rows {
                    row.compare(fit, &colors);
                    let off =
                        row.off.iter().map(|off| off * off).sum::<f64>() / (3.0 * fit.sigma * fit.sigma);
                    row.weight = 1.0 / (1.0 + off / (CAUCHY * CAUCHY));
                    row.cost = (off / (CAUCHY * CAUCHY)).ln_1p();
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
        let middle = offs.len() / 2;
        let median =
            if offs.is_empty() { 0.0 } else { *offs.select_nth_unstable_by(middle, f64::total_cmp).1 };
        sums.sigma = (1.4826 * median).max(LEAST);
        let prior = fit.sigma * fit.sigma / (GAINS * GAINS);
        for (photo, gain) in fit.gains.iter().enumerate() {
            sums.normal[(HEAD + photo) * (count + 1)] += prior;
            sums.right[HEAD + photo] -= prior * gain;
        }
        // A scene may be brighter and all photos darker: the gains' mean is 1.
        let most = (HEAD..count).map(|i| sums.normal[i * (count + 1)]).fold(0.0, f64::max);
        let mean = fit.gains.iter().sum::<f64>();
        for i in HEAD..count {
            sums.right[i] -= most * mean;
            (HEAD..count).for_each(|j| sums.normal[i * count + j] += most);
        }
        sums
    }

    /// Adds one point, with its colour eliminated.
    fn add(&mut self, fit: &HazeFit, rows: &[Row], colors: &[f64; 3]) {
        let count = HEAD + fit.gains.len();
        let mut places: Vec<usize> = vec![0, 0];
        places.extend(rows.iter().map(|row| HEAD + row.photo));
        // By extinction, light, and the gain of each photo: products with the colour's derivative.
        let mut with_color = vec![0.0; places.len()];
        for c in 0..3 {
            places[1] = 1 + c;
            let is_held = colors[c] <= 0.0 || colors[c] >= BRIGHTEST;
            with_color.fill(0.0);
            let mut squares = 0.0;
            for (i, row) in rows.iter().enumerate() {
                let by = row.by(fit, colors, c);
                let w = row.weight;
                let at = [0, 1 + c, HEAD + row.photo];
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
            // The colour is that of least squares, so residuals have no part along its derivative.
            for (k, p) in with_color.iter().zip(&places) {
                for (l, q) in with_color.iter().zip(&places) {
                    self.normal[p * count + q] -= k * l / squares;
                }
            }
        }
    }

    /// Solves for the step; `None` if nothing is determined.
    fn step(&self, fit: &HazeFit, free: Free, damping: f64) -> Option<Vec<f64>> {
        let count = HEAD + fit.gains.len();
        let first = match free {
            Free::All => 0,
            Free::Light => 1,
            Free::Gains => HEAD,
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
struct Row {
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

impl Row {
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

    /// Finds the residuals for the colours of its point.
    fn compare(&mut self, fit: &HazeFit, colors: &[f64; 3]) {
        for c in 0..3 {
            let model = self.gain * fit.added[c] * self.path + self.kept * colors[c];
            self.off[c] = self.slope[c] * (self.light[c] - model);
        }
    }

    /// Derivatives of the displayed light in a channel by extinction, added light and gain.
    fn by(&self, fit: &HazeFit, colors: &[f64; 3], c: usize) -> [f64; 3] {
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
