//! Trainings that are broken off and gone on with.

use super::process::{PATIENCE, begin, wait};
use super::*;
use std::process::Child;
use std::thread::sleep;
use std::time::{Duration, Instant};
use wm_train::checkpoint;

/// Starts a training of `config.json` and gives it back once its metrics have this many lines.
fn started(place: &Place, more: &[&str], lines: usize) -> Child {
    let more = [&["--config", "config.json", "--out", "b.ply"][..], more].concat();
    let mut child = begin(&mut place.command(reconstruct("set", &more)));
    let metrics = place.at("b.ply.run/metrics.jsonl");
    let begun = Instant::now();
    while fs::read_to_string(&metrics).map_or(0, |text| text.lines().count()) < lines {
        assert!(child.try_wait().unwrap().is_none(), "it ended before {lines} lines");
        assert!(begun.elapsed() < PATIENCE, "it does not get to {lines} lines");
        sleep(Duration::from_millis(1));
    }
    child
}

fn signal(child: &Child, name: &str) {
    assert!(Command::new("kill").args([name, &child.id().to_string()]).status().unwrap().success());
}

/// So many that a test that waits for its turn still meets the training under way; a line of metrics each
/// six of them.
const STEPS: u32 = 1200;

fn step_of(place: &Place) -> u32 {
    checkpoint::read(&place.at("b.ply.run/checkpoint.wmtrain")).unwrap().0.step()
}

#[test]
fn what_is_broken_off_ends_in_the_same_bytes() {
    let place = Place::new();
    for strategy in ["mcmc", "adaptive"] {
        let mut config = restless(strategy, STEPS);
        config.exposure = wm_train::config::ExposureMode::Photo;
        place.configure("config.json", &config);
        let hold_out = ["--eval-every", "4"];
        place.trained(&[&["--config", "config.json", "--out", "a.ply"], &hold_out[..]].concat());

        let _ = fs::remove_dir_all(place.at("b.ply.run"));
        let _ = fs::remove_file(place.at("b.ply"));
        let child = started(&place, &hold_out, 10);
        signal(&child, "-INT");
        let output = wait(child, "a training after Ctrl-C");
        let (first, said) = (step_of(&place), said(&output));
        assert_eq!(output.status.code(), Some(130), "{said}");
        let advice =
            format!("stopped: {first} of {STEPS} steps are done, the same command with --resume continues");
        assert!(said.ends_with(&format!("{advice}\n")) && said.lines().count() == 2, "{said}");
        assert!(said.starts_with("geometry: depth of "), "{said}");
        assert!((60..STEPS).contains(&first) && !place.at("b.ply").exists(), "{first}");

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

#[test]
fn a_training_is_gone_on_with_as_it_began() {
    let place = Place::new();
    place.refused(
        "set",
        &["--resume"],
        &["scene.ply.run: there is no training to go on with; leave out --resume"],
    );
    place.trained(&[]);
    let checkpoint = place.at("scene.ply.run/checkpoint.wmtrain");
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
        place.refused("set", &[&["--resume"], change].concat(), &other);
    }

    // One that is not done is neither forgotten nor gone on with by accident.
    let (mut head, state) = checkpoint::read(&checkpoint).unwrap();
    head.config.steps = 1000;
    checkpoint::write(&checkpoint, &head, &state).unwrap();
    place.refused(
        "set",
        &[],
        &["scene.ply.run: holds a training that is not done; continue it with --resume"],
    );

    for (content, says) in [
        (&b"WMTRAIN0"[..], "no checkpoint of this version; start anew with another --out"),
        (b"", "no checkpoint of this version"),
        (&whole[..whole.len() / 2], "the checkpoint is damaged (its checksum is wrong, or it is cut off)"),
    ] {
        fs::write(&checkpoint, content).unwrap();
        for more in [&["--resume"][..], &[]] {
            place.refused("set", more, &["scene.ply.run/checkpoint.wmtrain: ", says]);
        }
    }
}

/// A file may not grow beyond this, as on a disk that is full: the shell's limit, and its signal ignored.
#[test]
fn a_full_disk_leaves_the_last_checkpoint_whole() {
    let place = Place::new();
    // 250 splats of degree 3 take 720 bytes each: 180,000, and the limit is 51,200 or twice that, since
    // shells count in blocks of 512 or 1024 bytes.
    place.trained(&["--sh-degree", "3"]);
    let checkpoint = "scene.ply.run/checkpoint.wmtrain";
    let before = place.read(checkpoint);
    assert!(before.len() > 110_000, "{}", before.len());
    let words = reconstruct("set", &["--sh-degree", "3", "--checkpoint-every", "0.001", "--priors", "none"]);
    let mut command = Command::new("sh");
    command.args([
        "-c",
        "trap '' XFSZ; ulimit -f 100; exec \"$0\" \"$@\"",
        env!("CARGO_BIN_EXE_weather-magician"),
    ]);
    command.args(words).current_dir(place.at(".")).stdin(Stdio::null());
    let said = fails(&mut command, &["scene.ply.run/checkpoint.wmtrain: cannot be written: "]);
    assert!(said.starts_with("error: the training cannot be saved: "), "{said}");
    assert!(place.read(checkpoint) == before);
    assert!(
        listing(&place.at("scene.ply.run")).keys().all(|path| path.extension() != Some(OsStr::new("part")))
    );
}
