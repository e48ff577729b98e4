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

use crate::process::{finish, listing, printed, refuses, said};
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;
use wm_capture::colmap::write::ColmapStorage;
use wm_street::{
    Street,
    dataset::{self, CameraRoute, DatasetOptions, GroundTruth},
};
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
struct Place {
    folder: TempDir,
}

impl Place {
    fn new() -> Self {
        Self::with(&PHOTOS)
    }

    fn with(options: &DatasetOptions) -> Self {
        let place = Self { folder: tempfile::tempdir().unwrap() };
        dataset::write(&Street::builtin(), &place.at("set"), options, &mut |_| true).unwrap();
        place
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn read(&self, name: &str) -> Vec<u8> {
        let path = self.at(name);
        fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    }

    fn put(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.at(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }

    /// Writes a configuration for `--config`.
    fn configure(&self, name: &str, config: &TrainConfig) {
        self.put(name, serde_json::to_string(config).unwrap());
    }

    fn command<S: AsRef<OsStr>>(&self, args: impl IntoIterator<Item = S>) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_weather-magician"));
        command.args(args).current_dir(self.folder.path()).stdin(Stdio::null());
        command
    }

    /// `reconstruct set` with `more` and what is usual.
    fn trained(&self, more: &[&str]) -> Output {
        self.succeeds(&mut self.command(reconstruct("set", more)))
    }

    fn succeeds(&self, command: &mut Command) -> Output {
        let output = finish(command);
        assert!(output.status.success(), "{command:?}: {}", said(&output));
        output
    }

    /// Runs a command that must be refused with one line that holds each of `says`, and leave
    /// nothing.
    fn refused(&self, dataset: &str, more: &[&str], says: &[&str]) -> String {
        self.refused_by(&mut self.command(reconstruct(dataset, more)), says)
    }

    fn refused_by(&self, command: &mut Command, says: &[&str]) -> String {
        refuses(command, self.folder.path(), says, &REMARKS)
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
    let usual = USUAL.into_iter().filter(|(name, _)| !more.contains(name));
    let usual = usual.flat_map(|(name, value)| [name, value]);
    ["reconstruct", dataset, "--no-assets"].into_iter().chain(more.iter().copied()).chain(usual).collect()
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
