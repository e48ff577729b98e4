//! Commands whose files fail, that are killed, and that get signals, at any moment: what has its
//! final name then is whole, and the command goes on to what it would have made.
//!
//! `WM_ALL_FAULTS=1` has every operation on files fail in turn; without it those of number 1, 4, 16
//! and so on do.
use crate::common::{Workshop, files, yard, yard_metadata};
use crate::process::{begin, finish, listing, said, signal, succeeds, wait};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::thread::sleep;
use std::time::{Duration, Instant, SystemTime};
use wm_street::dataset::{CameraRoute, DatasetOptions};

/// Files by their paths in the folder where a command runs.
type Files = BTreeMap<PathBuf, Vec<u8>>;

const LOOK: &str = "--camera=0.5,-12,1.8:0,4,2.2 --size 32x24 --device cpu --threads 1";

/// Folders and files of work that goes on; the rest of the output is what users find.
const WORK: [&str; 4] = [".work", ".unfinished-site", "trained.ply.run", "unfinished.json"];

const PLAN: &str = r#"
seed = 4
frames = 3
block = 2
layouts = ["frames", "kitti-odometry"]
[[scene]]
file = "yard.ply"
[[path]]
camera = "0,-12,1:0,4,1.2"
speed = 5
[rig]
file = "rig.toml"
[[weather]]
from = ["fog"]
"#;

const RIG: &str = r#"
[[sensor]]
name = "front"
kind = "camera"
position = [0.0, 0.0, 0.5]
rate = 10.0
size = [32, 24]
fov = 60.0
"#;

/// The signals that end a command, and the exit status of each.
const SIGNALS: [(&str, i32); 3] = [("-INT", 130), ("-TERM", 143), ("-HUP", 129)];

/// Time in which a program has begun to listen to signals.
const SIGNAL_SETUP_TIME: Duration = Duration::from_millis(100);

/// A command in a folder of its own, with what it makes when it is left alone.
struct Job {
    words: String,
    /// Words with which it goes on after it was ended.
    again: &'static str,
    workshop: Workshop,
    before: Files,
    made: Files,
    /// Files that differ from run to run: they have times in them.
    unsteady: BTreeSet<PathBuf>,
    /// Time that it takes.
    duration: Duration,
}

impl Job {
    /// Prepares the folder with `inputs`, and runs the command twice.
    fn new(words: &str, again: &'static str, inputs: impl Fn(&Workshop)) -> Self {
        let workshop = Workshop::new();
        inputs(&workshop);
        let words = words.replace("LOOK", LOOK);
        let before = files(&workshop.path(""));
        let mut job = Self {
            words,
            again,
            workshop,
            before,
            made: Files::new(),
            unsteady: BTreeSet::new(),
            duration: Duration::ZERO,
        };
        let [first, second] = [(), ()].map(|()| {
            job.restore();
            let start = Instant::now();
            succeeds(&mut job.command(""));
            job.duration = start.elapsed();
            files(&job.workshop.path(""))
        });
        assert!(first.keys().eq(second.keys()) && first != job.before, "{:?}", first.keys());
        job.unsteady = first.keys().filter(|path| first[*path] != second[*path]).cloned().collect();
        job.made = second;
        job
    }

    fn command(&self, more: &str) -> Command {
        self.workshop.command(&format!("{} {more}", self.words))
    }

    /// Returns the folder to what it was before the command.
    fn restore(&self) {
        let folder = self.workshop.path("");
        for (path, _) in listing(&folder).into_iter().rev() {
            let own = path.strip_prefix(&folder).unwrap();
            let is_input = self.before.keys().any(|input| input.starts_with(own));
            if !is_input {
                if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) }.unwrap();
            }
        }
        for (path, content) in &self.before {
            if fs::read(folder.join(path)).ok().as_ref() != Some(content) {
                fs::write(folder.join(path), content).unwrap();
            }
        }
    }

    /// Each file under its final name is the one before or the one that the command makes.
    fn check_whole(&self, what: &str, may_leave_parts: bool) {
        for (path, content) in files(&self.workshop.path("")) {
            let is = |all: &Files| all.get(&path) == Some(&content);
            let is_part = path.iter().any(|name| is_part(&name.to_string_lossy()));
            assert!(may_leave_parts || !is_part, "{what}: leaves {}", path.display());
            let is_whole = is(&self.before) || is(&self.made) || self.unsteady.contains(&path);
            assert!(is_whole || is_part || is_work(&path), "{what}: {} is not whole", path.display());
        }
        if !may_leave_parts {
            let left = listing(&self.workshop.path("")).into_keys();
            let parts: Vec<PathBuf> = left.filter(|path| is_part(&path.to_string_lossy())).collect();
            assert!(parts.is_empty(), "{what}: leaves {parts:?}");
        }
    }

    /// The command goes on to what it makes when it is left alone.
    fn check_again(&self, what: &str) {
        let folder = self.workshop.path("");
        // Parts of dead processes are removed once they are a minute old.
        let old = SystemTime::now() - Duration::from_secs(600);
        for path in listing(&folder).into_keys().filter(|path| is_part(&path.to_string_lossy())) {
            fs::File::open(path).unwrap().set_modified(old).unwrap();
        }
        // What was ended before its folder was made has nothing to go on with.
        let has_begun = folder.join("trained.ply.run").exists() || !self.again.contains("--resume");
        let output = finish(&mut self.command(if has_begun { self.again } else { "--overwrite" }));
        assert!(output.status.success(), "{what}, and again: {}", said(&output));
        let final_files =
            |all: &Files| -> Vec<PathBuf> { all.keys().filter(|path| !is_work(path)).cloned().collect() };
        let again = files(&folder);
        assert_eq!(final_files(&again), final_files(&self.made), "{what}, and again");
        for path in final_files(&again).iter().filter(|path| !self.unsteady.contains(*path)) {
            assert!(again[path] == self.made[path], "{what}, and again: {} differs", path.display());
        }
    }

    /// Has operations on files fail, and end the process.
    fn with_failing_files(&self) {
        self.with_every(4);
    }

    /// [`Self::with_failing_files`] of a command that takes seconds.
    fn with_few_failing_files(&self) {
        self.with_every(64);
    }

    /// Has the first operation of each kind fail, then those of `step` times the number.
    fn with_every(&self, step: u32) {
        let is_all = is_all();
        let mut disturbed = 0;
        for operation in ["create", "write", "flush", "rename"] {
            for kill in ["", "kill-"] {
                let mut number = 1u32;
                loop {
                    self.restore();
                    let fault = format!("{kill}{operation}:{number}");
                    let what = format!("{:?} with {fault}", self.words);
                    let output = finish(self.command("").env("WM_FAIL_FILES", &fault));
                    if output.status.success() {
                        break;
                    }
                    disturbed += 1;
                    if kill.is_empty() {
                        check_error(&output, "the disk is full", &what);
                    } else {
                        assert!(output.status.signal().is_some(), "{what}: {}", said(&output));
                    }
                    self.check_whole(&what, !kill.is_empty());
                    if is_all || !kill.is_empty() {
                        self.check_again(&what);
                    }
                    number = if is_all { number + 1 } else { step * number };
                }
            }
        }
        eprintln!("{:?}: {disturbed} failures of files", self.words);
        assert!(disturbed >= 4, "{:?}: {disturbed} failures", self.words);
    }

    /// Sends each signal at different moments, and has files be limited.
    fn with_signals(&self) {
        let moments = if is_all() { 12 } else { 2 };
        let mut ended = 0;
        for (name, status) in SIGNALS {
            for moment in 0..moments {
                self.restore();
                let share = (f64::from(moment) + 0.6) / f64::from(moments);
                let what = format!("{:?} with {name} at {share:.2}", self.words);
                let child = begin(&mut self.command(""));
                sleep(self.duration.mul_f64(share));
                let is_sent = signal(&child, name);
                let output = wait(child, &what);
                // A command that had ended before is left alone, and one may end in the same
                // moment.
                let code = output.status.code();
                // Before it listens to signals it has made nothing.
                let is_early =
                    output.status.signal().is_some() && self.duration.mul_f64(share) < SIGNAL_SETUP_TIME;
                assert!(
                    code == Some(status) || code == Some(0) || is_early,
                    "{what}: {:?} {is_sent} {}",
                    output.status,
                    said(&output)
                );
                ended += u32::from(code == Some(status));
                self.check_whole(&what, false);
                self.check_again(&what);
            }
        }
        eprintln!("{:?}: {ended} times ended by signals", self.words);
        // One that ends within milliseconds may always be done before the signal comes.
        assert!(ended > 0 || self.duration < 4 * SIGNAL_SETUP_TIME, "{:?}: no signal ended it", self.words);
        self.restore();
        let what = format!("{:?} with small files", self.words);
        // 1 block of 512 or 1024 bytes.
        let script = format!("ulimit -f 1; exec {} {}", env!("CARGO_BIN_EXE_weather-magician"), self.words);
        let output = finish(Command::new("sh").args(["-c", &script]).current_dir(self.workshop.path("")));
        check_error(&output, "larger than a file may be here", &what);
        self.check_whole(&what, false);
        self.check_again(&what);
    }
}

/// True if every operation on files is to fail.
fn is_all() -> bool {
    std::env::var_os("WM_ALL_FAULTS").is_some()
}

/// One line of error, and exit status 1.
fn check_error(output: &Output, says: &str, what: &str) {
    let text = said(output);
    assert_eq!(output.status.code(), Some(1), "{what}: {text}");
    let errors: Vec<&str> = text.lines().filter(|line| line.starts_with("error: ")).collect();
    assert!(errors.len() == 1 && errors[0].contains(says) && !text.contains("panicked"), "{what}: {text}");
}

fn is_part(name: &str) -> bool {
    name.ends_with(".part") || name.ends_with(".parts")
}

fn is_work(path: &Path) -> bool {
    path.iter().any(|name| WORK.iter().any(|work| name == *work))
}

/// The yard, and a scene that is replaced.
fn scenes(workshop: &Workshop) {
    workshop.scene("yard", yard().build(), &yard_metadata(1.0));
    workshop.put("old.ply", "old");
}

fn photos(workshop: &Workshop) {
    workshop.photos("photos", &DatasetOptions::TINY);
}

/// Photos at eye level, with sky in them.
fn photos_of_a_walk(workshop: &Workshop) {
    workshop.photos("photos", &DatasetOptions { route: CameraRoute::Walk, ..DatasetOptions::TINY });
}

fn scenes_and_photos(workshop: &Workshop) {
    scenes(workshop);
    photos(workshop);
}

/// A test for each command.
macro_rules! jobs {
    ($($name:ident: $words:literal, $again:literal, $inputs:expr, [$($way:ident),+];)*) => {
        $(
            #[test]
            fn $name() {
                let job = Job::new($words, $again, $inputs);
                $(job.$way();)+
            }
        )*
    };
}

jobs! {
    convert: "convert yard.ply old.ply --overwrite", "", scenes, [with_failing_files, with_signals];
    convert_to_a_folder: "convert yard.ply sog/meta.json", "--overwrite", scenes, [with_failing_files, with_signals];
    picture: "render yard.ply LOOK --weather snow-covered --also depth --out a.png", "--overwrite", scenes,
        [with_failing_files, with_signals];
    frames: "render yard.ply LOOK --weather snow --seconds 2 --fps 8 --out frames", "--overwrite", scenes,
        [with_failing_files, with_signals];
    bake: "bake yard.ply --weather snow-covered --out baked.ply", "--overwrite", scenes,
        [with_failing_files, with_signals];
    align: "align yard.ply --up=0,0.1,1 --metres-per-unit 2 --out up.ply", "--overwrite", scenes,
        [with_failing_files];
    scan: "scan yard.ply --at=0,-8,1.5:0,4,1.5 --weather heavy-rain --sub-rays 1 --lidar vlp-16 --sweeps 4 --out points.ply",
        "--overwrite", scenes, [with_failing_files, with_signals];
    batch: "batch plan.toml --out data --device cpu", "",
        |workshop: &Workshop| {
            scenes(workshop);
            workshop.put("plan.toml", PLAN);
            workshop.put("rig.toml", RIG);
        },
        [with_failing_files, with_signals];
    reconstruct: "reconstruct photos --no-assets --out trained.ply --steps 60 --max-splats 400 --sh-degree 1 --threads 1 \
                  --checkpoint-every 0.001",
        "--resume --overwrite", photos, [with_failing_files, with_signals];
    evaluate: "evaluate yard.ply --dataset photos --json told.json --report told.html --assets off", "--overwrite",
        scenes_and_photos, [with_failing_files, with_signals];
    priors: "priors photos --out maps --preview", "--overwrite", photos_of_a_walk, [with_failing_files, with_signals];
    sky: "sky photos --width 64 --out sky.png", "--overwrite", photos_of_a_walk, [with_failing_files, with_signals];
    label: "label yard.ply --views photos --masks masks --out labelled.ply --threads 1", "--overwrite",
        |workshop: &Workshop| {
            scenes_and_photos(workshop);
            let (width, height) = DatasetOptions::TINY.size;
            let labels: Vec<f32> = (0..width * height).map(|at| (at % width / 24) as f32).collect();
            for photo in 0..DatasetOptions::TINY.count {
                let path = workshop.put(format!("masks/{photo:05}.npy"), "");
                wm_base::npy::write(&path, &labels, &[height as usize, width as usize]).unwrap();
            }
        },
        [with_failing_files, with_signals];
}

/// Commands that take seconds a run: they are tested where all operations are.
#[test]
fn slow_commands() {
    if !is_all() {
        eprintln!("demo and bench are tested with WM_ALL_FAULTS=1 only: they take minutes");
        return;
    }
    let demo = Job::new("demo --photos made --count 3 --size 96x64 --threads 1", "", |_| ());
    let bench = Job::new("bench yard.ply LOOK --frames 1 --paper --report told", "--overwrite", scenes);
    for job in [demo, bench] {
        job.with_failing_files();
        job.with_signals();
    }
}

#[cfg(feature = "h264")]
jobs! {
    video: "render yard.ply LOOK --weather snow --seconds 2 --fps 8 --out a.mp4", "--overwrite", scenes,
        [with_failing_files, with_signals];
}

#[cfg(feature = "viewer")]
jobs! {
    page: "export-web yard.ply LOOK --prepare none --player player --out site", "--overwrite",
        |workshop: &Workshop| {
            scenes(workshop);
            workshop.put_player();
        },
        [with_few_failing_files];
}
