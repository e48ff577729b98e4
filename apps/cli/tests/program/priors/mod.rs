//! `priors` by running it on a small data set of the built-in street: what it believes of maps
//! whose truth is known, what it leaves behind, and what it says to bad input.

mod maps;
mod network;
mod refusals;

use crate::common::Workshop;
use crate::process::{fails, finish, listing, printed, said, succeeds};
use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::{Arc, OnceLock};
use wm_base::npy;
use wm_capture::Capture;
use wm_capture::CaptureOptions;
use wm_capture::colmap::write::ColmapStorage;
use wm_street::dataset::{CameraRoute, DatasetOptions, GroundTruth};
use wm_train::priors::{Prior, Priors};

/// Lines that may be printed beside the one line of error.
const REMARKS: [&str; 3] = ["warning: ", "left out: ", "depth: 1 scene unit is "];

const PHOTOS: DatasetOptions = DatasetOptions {
    route: CameraRoute::Walk,
    count: 4,
    size: (120, 80),
    points: 800,
    truth: GroundTruth::Write,
    ..DatasetOptions::TINY
};

/// Photos of the street with their truth, in `set`; tests read it and write elsewhere.
fn shared() -> &'static Workshop {
    static MADE: OnceLock<Workshop> = OnceLock::new();
    MADE.get_or_init(|| {
        let made = Workshop::new();
        made.photos("set", &PHOTOS);
        made
    })
}

fn capture(dataset: &Path) -> Capture {
    wm_capture::read(dataset, &CaptureOptions::default()).unwrap()
}

/// A folder to write into, whose commands are `priors` of the shared data set into `out`.
fn desk() -> Workshop {
    let usual = format!("priors {} -o out", shared().path("set").display());
    Workshop::with(usual, &REMARKS).with_own_weights()
}

/// Writes maps that `of` makes of the truth of a kind, with the number of the photo.
fn maps(desk: &Workshop, folder: &str, kind: &str, of: impl Fn(usize, Vec<f32>) -> (Vec<f32>, Vec<usize>)) {
    fs::create_dir_all(desk.path(folder)).unwrap();
    for photo in 0..PHOTOS.count as usize {
        let name = format!("{photo:05}.npy");
        let (values, _) = npy::read(&shared().path(format!("set/truth/{kind}/{name}"))).unwrap();
        let (values, shape) = of(photo, values);
        npy::write(&desk.path(folder).join(name), &values, &shape).unwrap();
    }
}

/// `priors` of the data set `set` of a folder.
fn command_on_set(desk: &Workshop, options: &str) -> Command {
    desk.program(["priors", "set"].into_iter().chain(options.split_whitespace()))
}

/// Runs a command that must succeed, in place of what earlier ones wrote.
fn run(desk: &Workshop, options: &str) -> Output {
    succeeds(desk.command(options).arg("--overwrite"))
}

fn priors(desk: &Workshop) -> Priors {
    Priors::open(&desk.path("out")).unwrap().unwrap()
}

fn prior_of(desk: &Workshop, photo: usize) -> Arc<Prior> {
    let view = &capture(&shared().path("set")).views[photo];
    priors(desk).get(&view.name, &view.camera).unwrap().unwrap()
}

/// `[H, W]` of the photos.
const PHOTO_SHAPE: [usize; 2] = [80, 120];

#[test]
fn stereo_is_made_once_and_found_by_reconstruct() {
    let desk = desk();
    desk.photos("set", &DatasetOptions { route: CameraRoute::Orbit, count: 14, size: (96, 64), ..PHOTOS });
    let text = printed(&succeeds(&mut command_on_set(&desk, "")));
    assert!(text.starts_with("photo       known %     sky %\n00000.png"), "{text}");
    assert!(text.lines().last().unwrap().starts_with("set/priors: depth of "), "{text}");
    assert!(!text.contains("depth of 0 %"), "{text}");
    let priors = Priors::open(&desk.path("set/priors")).unwrap().unwrap();
    assert_eq!((priors.index().photos.len(), priors.index().source.as_str()), (14, "photos"));
    assert!(desk.path("set/priors/preview.png").is_file());
    let words = ["reconstruct", "set", "--steps", "2", "--max-splats", "300", "--no-assets"];
    let output = succeeds(&mut desk.program(words));
    assert!(!said(&output).contains("geometry: "), "{}", said(&output));
    assert!(!desk.path("set.run/priors").exists());
    let written = listing(&desk.path("set/priors"));
    let says = ["set/priors/priors.json: exists already", "--resume", "-o", "--overwrite"];
    fails(&mut command_on_set(&desk, ""), &says, &REMARKS);
    assert_eq!(listing(&desk.path("set/priors")), written);
}
