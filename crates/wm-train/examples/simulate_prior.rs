//! Relative disparity maps as a monocular network might give them, from the true depth of a made-up
//! data set.
//!
//! `cargo run --release -p wm-train --example simulate_prior -- DATASET OUT [--blur 0.006] [--wave 0.05] [--noise 0.005] [--seed 0]`
//!
//! Makes `OUT/NAME.npy` of each `DATASET/truth/depth/NAME.npy`: `scale (1 / z + shift)`, each photo
//! with its own scale (0.1 to 10, log-uniform) and shift (within half of the median of 1 / z,
//! either way). Before that the sky is 0, edges are blurred (Gaussian, `blur` of the width), and 1
//! / z is off by `wave` over stretches of a sixth of the picture and by `noise` from pixel to pixel
//! (standard deviations, as shares).
//! `priors --depth OUT --depth-form disparity --depth-scale relative` reads them.

use rayon::prelude::*;
use std::f64::consts::{LN_10, TAU};
use std::path::{Path, PathBuf};
use wm_base::npy;
use wm_base::random::uniform;

/// Parts of the picture's width over which the smooth error is alike.
const PARTS_PER_WIDTH: f64 = 6.0;

struct Options {
    blur: f64,
    wave: f64,
    noise: f64,
    seed: u64,
}

type Failure = Box<dyn std::error::Error + Send + Sync>;

fn main() {
    if let Err(error) = run() {
        eprintln!("{error}");
        std::process::exit(1);
    }
}

fn run() -> Result<(), Failure> {
    let mut folders = Vec::new();
    let mut options = Options { blur: 0.006, wave: 0.05, noise: 0.005, seed: 0 };
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let share = match argument.as_str() {
            "--blur" => &mut options.blur,
            "--wave" => &mut options.wave,
            "--noise" => &mut options.noise,
            "--seed" => {
                options.seed = arguments.next().ok_or("--seed: give a number")?.parse()?;
                continue;
            }
            _ => {
                folders.push(PathBuf::from(argument));
                continue;
            }
        };
        *share = arguments.next().ok_or_else(|| format!("{argument}: give a number"))?.parse()?;
        if !(0.0..=1.0).contains(share) {
            return Err(format!("{argument} {share}: it must be a share, 0 to 1").into());
        }
    }
    let [dataset, out] = &folders[..] else { return Err("which data set, and into which folder?".into()) };
    let truth = dataset.join("truth/depth");
    let mut files: Vec<PathBuf> = std::fs::read_dir(&truth)
        .map_err(|e| format!("{}: {e}; make a data set with `demo` first", truth.display()))?
        .map(|entry| entry.map(|entry| entry.path()))
        .collect::<Result<_, _>>()?;
    files.retain(|path| path.extension().is_some_and(|extension| extension == "npy"));
    files.sort();
    std::fs::create_dir_all(out)?;
    files.par_iter().enumerate().try_for_each(|(index, file)| simulate(file, out, index as u64, &options))?;
    println!("{}: {} maps", out.display(), files.len());
    Ok(())
}

fn simulate(file: &Path, out: &Path, index: u64, options: &Options) -> Result<(), Failure> {
    let (depth, shape) = npy::read(file)?;
    let [height, width] = shape[..] else {
        return Err(format!("{}: no depth, which is [H, W]", file.display()).into());
    };
    // What differs between photos, and after it the pixels' own.
    let lane = |lane: u64| options.seed << 32 ^ index << 3 ^ lane;
    let true_disparity: Vec<f64> =
        depth.iter().map(|z| if *z > 0.0 { 1.0 / f64::from(*z) } else { 0.0 }).collect();
    let mut known: Vec<f64> = true_disparity.iter().copied().filter(|v| *v > 0.0).collect();
    known.sort_by(f64::total_cmp);
    let median = known.get(known.len() / 2).copied().unwrap_or(0.0);
    let random = |k: u64| uniform(lane(0), k);
    let scale = (LN_10 * (2.0 * random(0) - 1.0)).exp();
    let shift = median * (random(1) - 0.5);
    let blurred = blur(&true_disparity, width, options.blur * width as f64);
    let wave = Wave { cell: width as f64 / PARTS_PER_WIDTH, seed: lane(1) };
    let values: Vec<f32> = blurred
        .iter()
        .enumerate()
        .map(|(pixel, disparity)| {
            let (x, y) = (pixel % width, pixel / width);
            let off = 1.0 + options.wave * wave.at(x as f64, y as f64);
            let grain = 1.0 + options.noise * normal(lane(2), pixel as u64);
            (scale * (disparity * off * grain + shift)) as f32
        })
        .collect();
    let name = file.file_name().unwrap_or_default();
    Ok(npy::write(&out.join(name), &values, &[height, width])?)
}

/// Number `index` of a normal distribution of mean 0 and variance 1.
fn normal(seed: u64, index: u64) -> f64 {
    let u = |k: u64| uniform(seed, 2 * index + k);
    (-2.0 * (1.0 - u(0)).ln()).sqrt() * (TAU * u(1)).cos()
}

/// A smooth random field of mean 0 and variance 1 at each place.
struct Wave {
    /// Over which it is alike, px.
    cell: f64,
    seed: u64,
}

impl Wave {
    fn at(&self, x: f64, y: f64) -> f64 {
        let (column, row) = (x / self.cell, y / self.cell);
        let (mut sum, mut squares) = (0.0, 0.0);
        // Gaussians about the nodes of a grid; beyond three nodes they are below 0.02.
        for node_y in row.floor() as i64 - 2..=row.floor() as i64 + 3 {
            for node_x in column.floor() as i64 - 2..=column.floor() as i64 + 3 {
                let (dx, dy) = (column - node_x as f64, row - node_y as f64);
                let weight = (-0.5 * (dx * dx + dy * dy)).exp();
                let index = ((node_y + 8) as u64) << 20 | (node_x + 8) as u64;
                sum += weight * normal(self.seed, index);
                squares += weight * weight;
            }
        }
        sum / squares.sqrt()
    }
}

/// Gaussian blur of standard deviation `sigma`, px; the border is continued.
fn blur(values: &[f64], width: usize, sigma: f64) -> Vec<f64> {
    if sigma <= 0.0 {
        return values.to_vec();
    }
    let height = values.len() / width;
    let radius = (3.0 * sigma).ceil() as isize;
    let weights: Vec<f64> = (-radius..=radius).map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp()).collect();
    let total: f64 = weights.iter().sum();
    let pass = |source: &[f64], along: usize, last: usize, step: usize| -> Vec<f64> {
        (0..source.len())
            .map(|pixel| {
                let place = pixel / step % along;
                let first = pixel - place * step;
                let at = |i: usize| {
                    let near = (place as isize + i as isize - radius).clamp(0, last as isize);
                    weights[i] * source[first + near as usize * step]
                };
                (0..weights.len()).map(at).sum::<f64>() / total
            })
            .collect()
    };
    let across = pass(values, width, width - 1, 1);
    pass(&across, height, height - 1, width)
}
