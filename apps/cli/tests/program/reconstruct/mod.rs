//! `reconstruct` by running it on small made-up data sets: that it comes to the same scene however
//! it is run, what it leaves behind, and what it says to bad input.

mod bad_photos;
mod lies;
mod lpips;
mod output;
mod refusals;
#[cfg(unix)]
mod resume;
mod sameness;
mod videos;

use crate::common::{Workshop, with_usual};
use crate::process::{finish, listing, printed, said, succeeds};
use std::ffi::OsStr;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use wm_capture::colmap::write::ColmapStorage;
use wm_street::dataset::{CameraRoute, DatasetOptions, GroundTruth};
use wm_train::config::{AdaptiveConfig, Densify, McmcConfig};
use wm_train::{Preset, TrainConfig};

/// Messages that may precede an error: warnings about the data set, and the step from which a run
/// continues.
const REMARKS: [&str; 5] =
    ["warning: ", "capture: ", "set.run: continuing ", "scene.ply.run: continuing ", "video: "];

/// Default options of the tests: 40 steps of few splats.
const USUAL: [(&str, &str); 5] = [
    ("--out", "scene.ply"),
    ("--steps", "40"),
    ("--max-splats", "400"),
    ("--sh-degree", "1"),
    ("--threads", "1"),
];

/// Photos from around the street, as small as the loss can see.
const PHOTOS: DatasetOptions = DatasetOptions::TINY;

/// A folder with a sound data set `set` in it, where the program runs.
fn place() -> Workshop {
    place_with(&PHOTOS)
}

fn place_with(options: &DatasetOptions) -> Workshop {
    let place = Workshop::with("", &REMARKS);
    place.photos("set", options);
    place
}

impl Workshop {
    /// Writes a configuration for `--config`.
    fn configure(&self, name: &str, config: &TrainConfig) {
        self.put(name, serde_json::to_string(config).unwrap());
    }

    /// `reconstruct set` with `more` and what is usual.
    fn trained(&self, more: &[&str]) -> Output {
        succeeds(&mut self.program(reconstruct("set", more)))
    }

    /// Runs a training that must be refused with one line that holds each of `says`, and leave
    /// nothing.
    fn untrained(&self, dataset: &str, more: &[&str], says: &[&str]) -> String {
        self.refused_by(&mut self.program(reconstruct(dataset, more)), says)
    }

    /// The lines of a run's metrics: step, and whether held-out photos were measured.
    fn metrics(&self, folder: &str) -> Vec<(u64, bool)> {
        let text = String::from_utf8(self.read(&format!("{folder}/metrics.jsonl"))).unwrap();
        let line = |line: &str| {
            let value: serde_json::Value = serde_json::from_str(line).unwrap();
            (value["step"].as_u64().unwrap(), value.get("held_out").is_some())
        };
        text.lines().map(line).collect()
    }
}

/// Runs a command that must fail with one line of error that holds each of `says`.
fn fails(command: &mut Command, says: &[&str]) -> String {
    crate::process::fails(command, says, &REMARKS)
}

/// The options of `reconstruct`: `more`, and what is usual where it says nothing. Weather is
/// prepared in the test of the demo.
fn reconstruct<'a>(dataset: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    with_usual(&["reconstruct", dataset, "--no-assets"], more, &USUAL)
}

/// A training in which splats come and go early and often: presets begin after tens of steps.
fn restless(strategy: &str, steps: u32) -> TrainConfig {
    let mut config = TrainConfig::preset(Preset::Quick);
    config.set_steps(steps);
    config.sh_degree = 1;
    config.densify = match strategy {
        "mcmc" => Densify::Mcmc(McmcConfig {
            from: 5,
            until: steps,
            every: 5,
            // Many die and move at once.
            dead: 0.05,
            ..McmcConfig::for_steps(steps, 400)
        }),
        _ => Densify::Adaptive(AdaptiveConfig {
            from: 5,
            until: steps,
            every: 5,
            reset_every: 17,
            ..AdaptiveConfig::for_steps(steps, 400)
        }),
    };
    config
}
