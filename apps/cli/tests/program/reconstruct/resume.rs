//! Trainings that are broken off and gone on with.

use super::*;
use crate::process::{MAX_RUN_TIME, begin, signal, wait};
use std::process::Child;
use std::thread::sleep;
use std::time::{Duration, Instant};
use wm_train::checkpoint;

/// Starts a training of `config.json` and gives it back once its metrics have this many lines.
fn started(place: &Workshop, more: &[&str], lines: usize) -> Child {
    let more = [&["--config", "config.json", "--out", "b.ply"][..], more].concat();
    let mut child = begin(&mut place.program(reconstruct("set", &more)));
    let metrics = place.path("b.ply.run/metrics.jsonl");
    let begun = Instant::now();
    while fs::read_to_string(&metrics).map_or(0, |text| text.lines().count()) < lines {
        assert!(child.try_wait().unwrap().is_none(), "it ended before {lines} lines");
        assert!(begun.elapsed() < MAX_RUN_TIME, "it does not get to {lines} lines");
        sleep(Duration::from_millis(1));
    }
    child
}

/// So many that a test that waits for its turn still meets the training under way; a line of
/// metrics each six of them.
const STEPS: u32 = 1200;

fn step_of(place: &Workshop) -> u32 {
    checkpoint::read(&place.path("b.ply.run/checkpoint.wmtrain")).unwrap().0.step()
}

#[test]
fn what_is_broken_off_ends_in_the_same_bytes() {
    let place = place();
    for strategy in ["mcmc", "adaptive"] {
        let mut config = restless(strategy, STEPS);
        config.exposure = wm_train::config::ExposureMode::Photo;
        place.configure("config.json", &config);
        let hold_out = ["--eval-every", "4"];
        let more = ["--config", "config.json", "--out", "a.ply", "--overwrite"];
        place.trained(&[&more, &hold_out[..]].concat());

        let _ = fs::remove_dir_all(place.path("b.ply.run"));
        let _ = fs::remove_file(place.path("b.ply"));
        let child = started(&place, &hold_out, 10);
        assert!(signal(&child, "-INT"));
        let output = wait(child, "a training after Ctrl-C");
        let (first, said) = (step_of(&place), said(&output));
        assert_eq!(output.status.code(), Some(130), "{said}");
        let advice =
            format!("stopped: {first} of {STEPS} steps are done, the same command with --resume continues");
        assert!(said.ends_with(&format!("{advice}\n")) && said.lines().count() == 2, "{said}");
        assert!(said.starts_with("geometry: depth of "), "{said}");
        assert!((60..STEPS).contains(&first) && !place.path("b.ply").exists(), "{first}");

        let hurried = [&["--resume", "--checkpoint-every", "0.001"], &hold_out[..]].concat();
        let mut child = started(&place, &hurried, (first / 6) as usize + 15);
        child.kill().unwrap();
        wait(child, "a training that was killed");
        let second = step_of(&place);
        assert!(second > first && second < STEPS, "{first} {second}");

        // On more threads than before, and once more when it is done.
        for _ in 0..2 {
            let more = ["--config", "config.json", "--out", "b.ply", "--resume", "--threads", "2"];
            place.trained(&[&more, &hold_out[..]].concat());
            assert!(place.read("b.ply") == place.read("a.ply"), "{strategy}: broken at {first} and {second}");
            assert_eq!(place.metrics("b.ply.run"), place.metrics("a.ply.run"));
        }
    }
}

/// A training is killed again and again, or stopped with two interrupts in a row, ever later from
/// its start: it always goes on, and ends in the scene of one that was left alone.
#[test]
fn a_training_survives_being_killed_at_any_moment() {
    let place = place();
    let mut config = restless("mcmc", 300);
    config.exposure = wm_train::config::ExposureMode::Photo;
    place.configure("config.json", &config);
    place.trained(&["--config", "config.json", "--out", "a.ply"]);
    // The first kill finds no folder, and `--resume` wants one.
    fs::create_dir(place.path("b.ply.run")).unwrap();
    let more = ["--config", "config.json", "--out", "b.ply", "--resume", "--checkpoint-every", "0.001"];
    for delay in [0, 5, 10, 20, 30, 50, 80, 120, 180, 250, 350, 500] {
        for way in ["-KILL", "-INT"] {
            let mut child = begin(&mut place.program(reconstruct("set", &more)));
            sleep(Duration::from_millis(delay));
            if child.try_wait().unwrap().is_none() {
                assert!(signal(&child, way));
                if way == "-INT" {
                    sleep(Duration::from_millis(delay % 7));
                    // It may have ended by then.
                    let _ = signal(&child, way);
                }
            }
            let output = wait(child, "a training that is killed");
            assert!(!said(&output).contains("error"), "{delay} ms, {way}: {}", said(&output));
        }
    }
    place.trained(&more);
    assert!(place.read("b.ply") == place.read("a.ply"));
}

#[test]
fn a_training_is_gone_on_with_as_it_began() {
    let place = place();
    let says = "scene.ply.run: there is no training to go on with; leave out --resume";
    place.untrained("set", &["--resume"], &[says]);
    fs::create_dir(place.path("scene.ply.run")).unwrap();
    let lock = wm_base::files::lock_folder(&place.path("scene.ply.run")).unwrap();
    place.untrained("set", &[], &["scene.ply.run: another training runs in this folder"]);
    drop(lock);
    place.trained(&[]);
    // Neither a scene nor a run is replaced by accident.
    let remedies =
        "continue its training with --resume, give another name with --out, or replace it with --overwrite";
    place.untrained("set", &[], &[&format!("scene.ply: exists already; {remedies}")]);
    fs::rename(place.path("scene.ply"), place.path("first.ply")).unwrap();
    place.untrained("set", &[], &["scene.ply.run: holds a finished training; replace it with --overwrite"]);
    place.put("other.ply", "mine");
    let other = ["--out", "other.ply", "--run-folder", "scene.ply.run"];
    let remedies = "give another name with --out, or replace it with --overwrite";
    let says = format!("other.ply: exists already; {remedies}");
    place.untrained("set", &[&other[..], &["--resume"]].concat(), &[&says]);
    place.trained(&[&other[..], &["--resume", "--overwrite"]].concat());
    assert!(place.read("other.ply") == place.read("first.ply"));
    place.trained(&["--overwrite"]);
    assert!(place.read("scene.ply") == place.read("first.ply"));
    fs::remove_file(place.path("scene.ply")).unwrap();
    let checkpoint = place.path("scene.ply.run/checkpoint.wmtrain");
    let whole = fs::read(&checkpoint).unwrap();
    let other = ["scene.ply.run: holds a training of other photos, options or SIMD path"];
    let changes: [&[&str]; 5] = [
        &["--steps", "50"],
        &["--seed", "1"],
        &["--eval-every", "3"],
        &["--longest", "40"],
        &["--exposure", "shared"],
    ];
    for change in changes {
        place.untrained("set", &[&["--resume"], change].concat(), &other);
    }

    // One that is not done is neither forgotten nor gone on with by accident.
    let (mut head, state) = checkpoint::read(&checkpoint).unwrap();
    head.config.steps = 1000;
    checkpoint::write(&checkpoint, &head, &state).unwrap();
    let says = "scene.ply.run: holds a training that is not done; continue it with --resume";
    place.untrained("set", &[], &[says]);

    for (content, says) in [
        (&b"WMTRAIN0"[..], "no checkpoint of this version; start anew with another --out"),
        (b"", "no checkpoint of this version"),
        (&whole[..whole.len() / 2], "the checkpoint is damaged (its checksum is wrong, or it is cut off)"),
    ] {
        fs::write(&checkpoint, content).unwrap();
        for more in [&["--resume"][..], &[]] {
            place.untrained("set", more, &["scene.ply.run/checkpoint.wmtrain: ", says]);
        }
    }
}

/// A file may not grow beyond this, as on a disk that is full: the shell's limit, and its signal
/// ignored.
#[test]
fn a_full_disk_leaves_the_last_checkpoint_whole() {
    let place = place();
    // 250 splats of degree 3 take 720 bytes each: 180,000, and the limit is 51,200 or twice that,
    // since shells count in blocks of 512 or 1024 bytes.
    place.trained(&["--sh-degree", "3"]);
    let checkpoint = "scene.ply.run/checkpoint.wmtrain";
    let before = place.read(checkpoint);
    assert!(before.len() > 110_000, "{}", before.len());
    let more = ["--sh-degree", "3", "--checkpoint-every", "0.001", "--priors", "none", "--overwrite"];
    let words = reconstruct("set", &more);
    let mut command = Command::new("sh");
    command.args([
        "-c",
        "trap '' XFSZ; ulimit -f 100; exec \"$0\" \"$@\"",
        env!("CARGO_BIN_EXE_weather-magician"),
    ]);
    command.args(words).current_dir(place.path(".")).stdin(Stdio::null());
    let said = fails(&mut command, &["scene.ply.run/checkpoint.wmtrain: cannot be written: "]);
    assert!(said.starts_with("error: the training cannot be saved: "), "{said}");
    assert!(place.read(checkpoint) == before);
    assert!(
        listing(&place.path("scene.ply.run")).keys().all(|path| path.extension() != Some(OsStr::new("part")))
    );
}
