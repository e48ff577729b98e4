//! Photos that are missing or damaged: told at the start, or left out where that is asked for.

use super::*;

/// Damaged versions of photo 2, each with the expected message.
fn spoilt(place: &Place) -> Vec<(&'static str, Option<Vec<u8>>, &'static str)> {
    let sound = place.read("set/images/00002.png");
    let mut corrupt = sound.clone();
    let middle = corrupt.len() / 2;
    corrupt[middle..middle + 40].fill(0x55);
    let other = Place::with(&DatasetOptions { size: (50, 48), count: 1, points: 0, ..PHOTOS });
    vec![
        ("missing", None, "the photo is missing"),
        ("empty", Some(Vec::new()), "the file is empty"),
        ("no photo", Some(b"<html>".repeat(50)), ""),
        ("cut off", Some(sound[..sound.len() / 2].to_vec()), "the photo is damaged ("),
        ("corrupt", Some(corrupt), "the photo is damaged ("),
        (
            "of another size",
            Some(other.read("set/images/00000.png")),
            "the photo is 50x48 px, its camera 72x48",
        ),
    ]
}

#[test]
fn they_are_refused_at_the_start_or_left_out() {
    let place = Place::new();
    for (what, content, says) in spoilt(&place) {
        match content {
            None => fs::remove_file(place.at("set/images/00002.png")).unwrap(),
            Some(content) => place.put("set/images/00002.png", content),
        }
        let file = "set/images/00002.png: ";
        place.refused("set", &["--overwrite"], &[file, says, "(--skip-bad goes on without it)"]);
        let output = place.trained(&["--skip-bad", "--steps", "4", "--eval-every", "3", "--overwrite"]);
        let warned = said(&output);
        assert!(
            warned.contains(&format!("warning: {file}")) && warned.contains("it is left out"),
            "{what}: {warned}"
        );
        // The others keep their parts.
        let printed = printed(&output);
        assert!(
            printed.contains("held-out 00000.png") && printed.contains("held-out 00003.png"),
            "{printed}"
        );
        place.refused(
            "set",
            &["--skip-bad", "--eval-every", "2", "--eval-from", "1", "--overwrite"],
            &["set: 2 of 6 photos are left"],
        );
    }
    for photo in 0..6 {
        place.put(&format!("set/images/{photo:05}.png"), "none");
    }
    place.refused("set", &["--overwrite"], &["(so are all 6 photos)"]);
    place.refused("set", &["--overwrite", "--skip-bad"], &["(so are all 6 photos)"]);
}

/// If there are more photos than the cache holds, damage is found during the training.
#[test]
fn damage_that_is_met_on_the_way() {
    let place = Place::with(&DatasetOptions { size: (330, 220), count: 5, ..PHOTOS });
    let sound = place.read("set/images/00002.png");
    place.put("set/images/00002.png", &sound[..sound.len() / 2]);
    // Without priors, for which all photos are looked at before.
    let usual = ["--cache", "1", "--steps", "12", "--densify", "fixed", "--priors", "none"];
    let with = |more: &[&'static str]| [&usual[..], more].concat();
    let says = [
        "set/images/00002.png: the photo is damaged (",
        " of 12 steps are done, the same command with --resume",
    ];
    fails(&mut place.command(reconstruct("set", &with(&[]))), &says);
    assert!(!place.at("scene.ply").exists());
    let checkpoint = wm_train::checkpoint::read(&place.at("scene.ply.run/checkpoint.wmtrain")).unwrap();
    // Each photo is seen once in five steps.
    assert!(checkpoint.0.step() < 5);

    let output = place.trained(&with(&["--resume", "--skip-bad"]));
    let warned = said(&output);
    assert_eq!(
        warned.matches("warning: set/images/00002.png: the photo is damaged (").count(),
        1,
        "{warned}"
    );
    let output = place.trained(&with(&["--skip-bad", "--out", "b.ply"]));
    assert!(place.read("b.ply") == place.read("scene.ply"), "{}", said(&output));
    // Held out, it is not measured.
    let output =
        place.trained(&with(&["--skip-bad", "--out", "c.ply", "--eval-every", "5", "--eval-from", "2"]));
    assert!(!printed(&output).contains("held-out"), "{}", printed(&output));
    fails(
        &mut place
            .command(reconstruct("set", &with(&["--out", "d.ply", "--eval-every", "5", "--eval-from", "2"]))),
        &says,
    );

    // What is believed is found out without it.
    let believing = ["--cache", "1", "--steps", "12", "--densify", "fixed", "--out", "p.ply"];
    fails(&mut place.command(reconstruct("set", &believing)), &says[..1]);
    let output = place.trained(&[&believing[..], &["--skip-bad"]].concat());
    assert!(said(&output).contains("geometry: depth of ") && said(&output).contains("from 4 photos"));

    // Copied again, it is used, and the training goes on where it was.
    place.put("set/images/00002.png", sound);
    place.trained(&with(&["--out", "e.ply"]));
    place.trained(&with(&["--resume", "--out", "d.ply", "--eval-every", "5", "--eval-from", "2"]));
}
