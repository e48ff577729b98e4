//! Sessions on the built-in street.

use super::*;
use crate::TrainPlan;
use crate::poor_photos::PhotoDefect;
use std::ops::ControlFlow;
use wm_render::Device;
use wm_scene::Metadata;
use wm_scene::survey::Survey;
use wm_street::capture::{self, CaptureFlaws, CaptureKind, CaptureSettings, ExifFault};
use wm_street::dataset::{self, DatasetOptions, GroundTruth};
use wm_street::{Park, Street};

const PHOTOS: DatasetOptions = DatasetOptions::TINY;

/// Counts what it is told, and stops after some steps.
#[derive(Default)]
struct Counter {
    steps: u32,
    stop_after: Option<u32>,
    evaluations: usize,
    checkpoints: usize,
    images: usize,
    warnings: Vec<TrainWarning>,
    report: Option<TrainReport>,
}

impl TrainObserver for Counter {
    fn proceed(&mut self) -> ControlFlow<()> {
        match self.stop_after {
            Some(steps) if self.steps >= steps => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        }
    }

    fn on_warning(&mut self, warning: &TrainWarning) {
        self.warnings.push(warning.clone());
    }

    fn on_step(&mut self, progress: &StepProgress) {
        self.steps = progress.step;
    }

    fn on_evaluation(&mut self, scores: &HeldOutScores) {
        assert!(scores.mean().unwrap().psnr > 0.0);
        self.evaluations += 1;
    }

    fn on_checkpoint(&mut self, path: &std::path::Path, step: u32) {
        assert!(path.is_file() && step == self.steps);
        self.checkpoints += 1;
    }

    fn wants_image(&mut self, moment: ImageMoment, photo: &wm_scene::Camera) -> Option<wm_scene::Camera> {
        (moment == ImageMoment::Milestone).then_some(*photo)
    }

    fn on_image(&mut self, image: &TrainImage<'_>) -> Result<(), ObserverError> {
        assert_eq!(image.frame.rgb.len(), 3 * 72 * 48);
        self.images += 1;
        Ok(())
    }

    fn on_finish(&mut self, report: &TrainReport) {
        self.report = Some(report.clone());
    }
}

fn session(dataset: &std::path::Path) -> Session {
    let mut options = SessionOptions { device: Device::Cpu, ..SessionOptions::default() };
    options.cpu.threads = Some(1);
    options.priors = PriorSource::None;
    options.held_out.every = 3;
    Session::new(dataset).options(options).steps(20).max_splats(300)
}

#[test]
fn a_session_that_was_stopped_ends_in_the_same_scene() {
    let folder = tempfile::tempdir().unwrap();
    let set = folder.path().join("set");
    dataset::write(&Street::builtin(), &set, &PHOTOS, &mut |_| true).unwrap();
    let mut whole = Counter::default();
    let scene = session(&set).run(&mut whole).unwrap();
    assert_eq!((whole.steps, whole.evaluations, whole.checkpoints, whole.images), (20, 9, 0, 10));
    let report = whole.report.unwrap();
    assert_eq!((report.steps, report.held_out.photos.len()), (20, 2));
    assert!(matches!(whole.warnings[..], [TrainWarning::NoScale(_)]), "{:?}", whole.warnings);

    let run = folder.path().join("run");
    let mut stopped = Counter { stop_after: Some(7), ..Counter::default() };
    let error = session(&set).run_folder(&run).run(&mut stopped).unwrap_err();
    assert!(matches!(error, SessionError::Stopped { step: 7, steps: 20 }), "{error}");
    assert_eq!(stopped.checkpoints, 1);
    let error = session(&set).run_folder(&run).run(&mut ()).unwrap_err();
    assert!(matches!(error, SessionError::Unfinished(_)), "{error}");
    let again = session(&set).run_folder(&run).resume().run(&mut ()).unwrap();
    assert_eq!((&again.splats, &again.metadata), (&scene.splats, &scene.metadata));
    let error = session(&set).run_folder(&run).run(&mut ()).unwrap_err();
    assert!(matches!(error, SessionError::Finished(_)), "{error}");
    let mut other = session(&set).run_folder(&run);
    other.options.resume = Resume::Overwrite;
    let again = other.run(&mut ()).unwrap();
    assert_eq!((again.splats, again.metadata), (scene.splats, scene.metadata));
}

/// A flight over the park, trained for a moment: its scene states north, place and time.
#[test]
fn the_scene_of_a_flight_knows_its_sun() {
    let folder = tempfile::tempdir().unwrap();
    let flight = |name: &str, exif: Vec<ExifFault>| {
        let set = folder.path().join(name);
        let flaws = CaptureFlaws { exif, ..CaptureFlaws::default() };
        let usual = CaptureSettings::new(CaptureKind::Nadir);
        let truth = GroundTruth::Omit;
        let settings =
            CaptureSettings { count: 16, size: (48, 32), samples: 1, points: 200, truth, flaws, ..usual };
        capture::write(&Park::builtin(), &set, &settings, &mut |_| true).unwrap();
        let truth = std::fs::read_to_string(set.join(capture::TRUTH)).unwrap();
        let sun = serde_json::from_str::<serde_json::Value>(&truth).unwrap()["sun"]["direction"].clone();
        let truth: [f64; 3] = serde_json::from_value(sun).unwrap();
        (session(&set).steps(1).run(&mut ()).unwrap(), glam::DVec3::from_array(truth))
    };
    let (scene, truth) = flight("honest", vec![]);
    let path = folder.path().join("park.ply");
    scene.save(&path).unwrap();
    let read = Scene::open(&path).unwrap();
    assert_eq!(read.metadata, scene.metadata);
    let sun = Survey::of(&read, &Metadata::default()).sun.unwrap();
    let off = sun.direction.angle_between(truth).to_degrees();
    assert!(off < 1.5, "{off} {sun:?}");
    let (scene, _) = flight("lies", vec![ExifFault::Nonsense, ExifFault::Time]);
    let Metadata { north, location, captured, .. } = scene.metadata;
    assert_eq!((north, location, captured), (None, None, None));
}

/// The folder of a training at every moment before its first checkpoint.
#[test]
fn a_session_that_was_killed_early_is_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let (set, run) = (folder.path().join("set"), folder.path().join("run"));
    dataset::write(&Street::builtin(), &set, &PHOTOS, &mut |_| true).unwrap();
    let scene = session(&set).steps(3).run(&mut ()).unwrap();
    let left: [&[(&str, &str)]; 5] = [
        &[],
        &[("config.json.12-0.part", "{")],
        &[("config.json", "{}")],
        &[("config.json", "{}"), ("checkpoint.wmtrain.12-0.part", "WMT")],
        &[("config.json", "{}"), ("metrics.jsonl", "{\"step\": 2}\n{\"st")],
    ];
    for files in left {
        std::fs::create_dir(&run).unwrap();
        files.iter().for_each(|(name, content)| std::fs::write(run.join(name), content).unwrap());
        let again = session(&set).steps(3).run_folder(&run).resume().run(&mut ()).unwrap();
        assert_eq!(again.splats, scene.splats, "{files:?}");
        assert!(!run.join("checkpoint.wmtrain.12-0.part").exists());
        std::fs::remove_dir_all(&run).unwrap();
    }
    // A line of metrics that ends within a letter.
    let session = || session(&set).steps(3).run_folder(&run);
    session().run(&mut ()).unwrap();
    let path = run.join("metrics.jsonl");
    let lines = std::fs::read(&path).unwrap();
    std::fs::write(&path, [&lines[..], b"{\"step\": 3, \"photo\": \"\xc3"].concat()).unwrap();
    assert_eq!(session().resume().run(&mut ()).unwrap().splats, scene.splats);
    assert_eq!(std::fs::read(&path).unwrap(), lines);
    std::fs::create_dir(folder.path().join("other")).unwrap();
    std::fs::write(folder.path().join("other/notes.txt"), "mine").unwrap();
    let error = session().run_folder(folder.path().join("other")).resume().run(&mut ()).unwrap_err();
    assert!(matches!(error, SessionError::NothingToResume(_)), "{error}");
}

#[test]
fn plans_and_folders_that_cannot_be_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let say = |session: Session| session.run(&mut ()).unwrap_err().to_string();
    let none = folder.path().join("none");
    assert!(say(session(folder.path()).resume().run_folder(none)).contains("there is no training"));
    let options = SessionOptions { camera_height: Some(f64::NAN), ..SessionOptions::default() };
    assert!(say(Session::new("none").options(options)).starts_with("the camera height is NaN"));
    let mut plan = TrainPlan { densify: "mcmd".into(), ..TrainPlan::default() };
    assert!(plan.config(40, 1000).unwrap_err().to_string().ends_with("choose one of fixed, adaptive, mcmc"));
    plan.densify = "fixed".into();
    for (name, value, says) in [
        ("dept", 1.0, "dept: no term of that name; there are l1, ssim and "),
        ("depth", f64::NAN, "depth is NaN; it must be finite"),
        ("depth", -1.0, "loss.geometry.depth is -1; it must be 0 to "),
        ("every", 1.5, "every=1.5: must be a whole number of steps"),
    ] {
        plan.loss = vec![(name.into(), value)];
        let said = plan.config(40, 1000).unwrap_err().to_string();
        assert!(said.starts_with(says), "{said}");
    }
    plan.loss = vec![("depth".into(), 0.25), ("every".into(), 3.0), ("l1".into(), 0.5)];
    let loss = plan.config(40, 1000).unwrap().loss;
    assert_eq!((loss.geometry.depth, loss.geometry.every, loss.l1), (0.25, 3, 0.5));
}

/// Keeps the warnings.
#[derive(Default)]
struct Warnings(Vec<TrainWarning>);

impl TrainObserver for Warnings {
    fn on_warning(&mut self, warning: &TrainWarning) {
        self.0.push(warning.clone());
    }
}

/// Changes the pixels of a photo in place.
fn spoil(path: &std::path::Path, change: impl Fn(&[u8], usize) -> Vec<u8>) {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    let changed = change(&pixels, 3 * info.width as usize);
    let bytes = crate::photos::encode_png(info.width, info.height, info.color_type, &changed);
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn blurred_and_white_photos_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let (set, run) = (folder.path().join("set"), folder.path().join("run"));
    let photos = DatasetOptions { count: 12, size: (180, 120), points: 900, ..PHOTOS };
    dataset::write(&Street::builtin(), &set, &photos, &mut |_| true).unwrap();
    let poor = |run: &std::path::Path| {
        let mut told = Warnings::default();
        let mut session = session(&set).steps(1).run_folder(run);
        session.options.held_out.every = 0;
        session.run(&mut told).unwrap();
        told.0.iter().find(|it| matches!(it, TrainWarning::PoorPhotos { .. })).cloned()
    };
    assert_eq!(poor(&run.join("sound")), None);
    spoil(&set.join("images/00002.png"), |pixels, _| vec![255; pixels.len()]);
    // Shaken sideways by 9 px.
    spoil(&set.join("images/00007.png"), |pixels, row| {
        let mean = |at: usize| {
            let (start, x) = (at / row * row, (at % row) as i32);
            let near = (-4..=4).map(|off| pixels[start + (x + 3 * off).rem_euclid(row as i32) as usize]);
            (near.map(u32::from).sum::<u32>() / 9) as u8
        };
        (0..pixels.len()).map(mean).collect()
    });
    let Some(TrainWarning::PoorPhotos { found, are_left_out }) = poor(&run.join("poor")) else {
        panic!("no poor photo is found")
    };
    assert!(are_left_out && run.join("poor/poor-photos.png").is_file());
    let names: Vec<&str> = found.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["00002.png", "00007.png"], "{found:?}");
    assert!(matches!(found[0].1, PhotoDefect::White { share, .. } if share == 1.0));
    assert!(matches!(found[1].1, PhotoDefect::Blurred(detail) if detail < 0.5), "{found:?}");
}
