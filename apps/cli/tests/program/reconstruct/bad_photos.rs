//! Photos that are missing or damaged: told at the start, or left out where that is asked for.

use super::*;

/// Damaged versions of photo 2, each with the expected message.
fn spoilt(place: &Workshop) -> Vec<(&'static str, Option<Vec<u8>>, &'static str)> {
    let sound = place.read("set/images/00002.png");
    let mut corrupt = sound.clone();
    let middle = corrupt.len() / 2;
    corrupt[middle..middle + 40].fill(0x55);
    let other = place_with(&DatasetOptions { size: (50, 48), count: 1, points: 0, ..PHOTOS });
    let other = other.read("set/images/00000.png");
    vec![
        ("missing", None, "the photo is missing"),
        ("empty", Some(Vec::new()), "the file is empty"),
        ("no photo", Some(b"<html>".repeat(50)), ""),
        ("cut off", Some(sound[..sound.len() / 2].to_vec()), "the photo is damaged ("),
        ("corrupt", Some(corrupt), "the photo is damaged ("),
        ("of another size", Some(other), "the photo is 50x48 px, its camera 72x48"),
    ]
}

#[test]
fn they_are_refused_at_the_start_or_left_out() {
    let place = place();
    for (what, content, says) in spoilt(&place) {
        match content {
            None => fs::remove_file(place.path("set/images/00002.png")).unwrap(),
            Some(content) => drop(place.put("set/images/00002.png", content)),
        }
        let file = "set/images/00002.png: ";
        place.untrained("set", &["--overwrite"], &[file, says, "(--skip-bad goes on without it)"]);
        let output = place.trained(&["--skip-bad", "--steps", "4", "--eval-every", "3", "--overwrite"]);
        let warned = said(&output);
        assert!(
            warned.contains(&format!("warning: {file}")) && warned.contains("it is left out"),
            "{what}: {warned}"
        );
        // The others keep their parts.
        let printed = printed(&output);
        for photo in ["held-out 00000.png", "held-out 00003.png"] {
            assert!(printed.contains(photo), "{printed}");
        }
        let more = ["--skip-bad", "--eval-every", "2", "--eval-from", "1", "--overwrite"];
        place.untrained("set", &more, &["set: 2 of 6 photos are left"]);
    }
    for photo in 0..6 {
        place.put(format!("set/images/{photo:05}.png"), "none");
    }
    place.untrained("set", &["--overwrite"], &["(so are all 6 photos)"]);
    place.untrained("set", &["--overwrite", "--skip-bad"], &["(so are all 6 photos)"]);
}

/// If there are more photos than the cache holds, damage is found during the training.
#[test]
fn damage_that_is_met_on_the_way() {
    let place = place_with(&DatasetOptions { size: (330, 220), count: 5, ..PHOTOS });
    let sound = place.read("set/images/00002.png");
    place.put("set/images/00002.png", &sound[..sound.len() / 2]);
    // Without priors, for which all photos are looked at before.
    let usual = ["--cache", "1", "--steps", "12", "--densify", "fixed", "--priors", "none"];
    let with = |more: &[&'static str]| [&usual[..], more].concat();
    let says = [
        "set/images/00002.png: the photo is damaged (",
        " of 12 steps are done, the same command with --resume",
    ];
    fails(&mut place.program(reconstruct("set", &with(&[]))), &says);
    assert!(!place.path("scene.ply").exists());
    let checkpoint = wm_train::checkpoint::read(&place.path("scene.ply.run/checkpoint.wmtrain")).unwrap();
    // Each photo is seen once in five steps.
    assert!(checkpoint.0.step() < 5);

    let output = place.trained(&with(&["--resume", "--skip-bad"]));
    let warned = said(&output);
    assert_eq!(warned.matches(&format!("warning: {}", says[0])).count(), 1, "{warned}");
    let output = place.trained(&with(&["--skip-bad", "--out", "b.ply"]));
    assert!(place.read("b.ply") == place.read("scene.ply"), "{}", said(&output));
    // Held out, it is not measured.
    let hold_out = |out| with(&["--out", out, "--eval-every", "5", "--eval-from", "2"]);
    let output = place.trained(&[&hold_out("c.ply")[..], &["--skip-bad"]].concat());
    assert!(!printed(&output).contains("held-out"), "{}", printed(&output));
    fails(&mut place.program(reconstruct("set", &hold_out("d.ply"))), &says);

    // What is believed is found out without it.
    let believing = ["--cache", "1", "--steps", "12", "--densify", "fixed", "--out", "p.ply"];
    fails(&mut place.program(reconstruct("set", &believing)), &says[..1]);
    let output = place.trained(&[&believing[..], &["--skip-bad"]].concat());
    assert!(said(&output).contains("geometry: depth of ") && said(&output).contains("from 4 photos"));

    // Copied again, it is used, and the training goes on where it was.
    place.put("set/images/00002.png", sound);
    place.trained(&with(&["--out", "e.ply"]));
    place.trained(&[&hold_out("d.ply")[..], &["--resume"]].concat());
}
