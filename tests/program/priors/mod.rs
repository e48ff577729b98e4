//! `priors` by running it on a small data set of the built-in street: what it believes of maps
//! whose truth is known, what it leaves behind, and what it says to bad input.

mod maps;
mod network;
mod refusals;

use crate::process::{fails, finish, listing, printed, refuses, said};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::{Arc, OnceLock};
use tempfile::TempDir;
use wm_base::npy;
use wm_capture::colmap::write::ColmapStorage;
use wm_capture::{Capture, CaptureOptions};
use wm_street::{
    Street,
    dataset::{self, CameraRoute, DatasetOptions, GroundTruth},
};
use wm_train::priors::{Prior, Priors};

/// Lines that may be printed beside the one line of error.
const REMARKS: [&str; 3] = ["warning: ", "left out: ", "depth: 1 scene unit is "];

const PHOTOS: DatasetOptions = DatasetOptions {
    route: CameraRoute::Walk,
    count: 4,
    size: (120, 80),
    samples: 1,
    points: 800,
    storage: ColmapStorage::Binary,
    truth: GroundTruth::Write,
};

/// Photos of the street with their truth; tests read it and write elsewhere.
fn shared() -> &'static Path {
    static MADE: OnceLock<TempDir> = OnceLock::new();
    let made = MADE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        dataset::write(&Street::builtin(), &folder.path().join("set"), &PHOTOS, &mut |_| true).unwrap();
        folder
    });
    made.path()
}

fn capture(dataset: &Path) -> Capture {
    wm_capture::read(dataset, &CaptureOptions::default()).unwrap()
}

/// A folder to write into, where the program runs.
struct Desk(TempDir);

impl Desk {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn put(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.at(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }

    /// Writes maps that `of` makes of the truth of a kind, with the number of the photo.
    fn maps(&self, folder: &str, kind: &str, of: impl Fn(usize, Vec<f32>) -> (Vec<f32>, Vec<usize>)) {
        for photo in 0..PHOTOS.count as usize {
            let name = format!("{photo:05}.npy");
            let (values, _) = npy::read(&shared().join("set/truth").join(kind).join(&name)).unwrap();
            let (values, shape) = of(photo, values);
            fs::create_dir_all(self.at(folder)).unwrap();
            npy::write(&self.at(folder).join(name), &values, &shape).unwrap();
        }
    }

    /// `priors` of the shared data set into `out` of this folder.
    fn command(&self, options: &str) -> Command {
        self.command_on(&shared().join("set"), &format!("-o out {options}"))
    }

    fn command_on(&self, dataset: &Path, options: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_weather-magician"));
        command.arg("priors").arg(dataset).args(options.split_whitespace());
        // Weights of others are none of the tests'.
        command.env("XDG_CACHE_HOME", self.at("cache"));
        command.current_dir(self.0.path()).stdin(Stdio::null());
        command
    }

    /// Runs a command that must succeed, in place of what earlier ones wrote.
    fn run(&self, options: &str) -> Output {
        let output = finish(self.command(options).arg("--overwrite"));
        assert!(output.status.success(), "{options}: {}", said(&output));
        output
    }

    /// Runs a command that must be refused with one line that holds each of `says`, and leave
    /// nothing.
    fn refused(&self, options: &str, says: &[&str]) -> String {
        refuses(&mut self.command(options), self.0.path(), says, &REMARKS)
    }

    fn priors(&self) -> Priors {
        Priors::open(&self.at("out")).unwrap().unwrap()
    }

    fn prior(&self, photo: usize) -> Arc<Prior> {
        let capture = capture(&shared().join("set"));
        let view = &capture.views[photo];
        self.priors().get(&view.name, &view.camera).unwrap().unwrap()
    }
}

/// `[H, W]` of the photos.
const SHAPE: [usize; 2] = [80, 120];

#[test]
fn stereo_is_made_once_and_found_by_reconstruct() {
    let desk = Desk::new();
    let options = DatasetOptions { route: CameraRoute::Orbit, count: 14, size: (96, 64), ..PHOTOS };
    dataset::write(&Street::builtin(), &desk.at("set"), &options, &mut |_| true).unwrap();
    let output = finish(&mut desk.command_on(Path::new("set"), ""));
    assert!(output.status.success(), "{}", said(&output));
    let text = printed(&output);
    assert!(text.starts_with("photo       known %     sky %\n00000.png"), "{text}");
    assert!(text.lines().last().unwrap().starts_with("set/priors: depth of "), "{text}");
    assert!(!text.contains("depth of 0 %"), "{text}");
    let priors = Priors::open(&desk.at("set/priors")).unwrap().unwrap();
    assert_eq!((priors.index().photos.len(), priors.index().source.as_str()), (14, "photos"));
    assert!(desk.at("set/priors/preview.png").is_file());
    let mut command = Command::new(env!("CARGO_BIN_EXE_weather-magician"));
    command
        .args(["reconstruct", "set", "--steps", "2", "--max-splats", "300", "--no-assets"])
        .current_dir(desk.0.path());
    let output = finish(&mut command);
    assert!(output.status.success() && !said(&output).contains("geometry: "), "{}", said(&output));
    assert!(!desk.at("set.run/priors").exists());
    let written = listing(&desk.at("set/priors"));
    let says = ["set/priors/priors.json: exists already", "--resume", "-o", "--overwrite"];
    fails(&mut desk.command_on(Path::new("set"), ""), &says, &REMARKS);
    assert_eq!(listing(&desk.at("set/priors")), written);
}
