//! Data sets that lie: masks of other sizes, EXIF of other places, models with numbers that are
//! none, photos of 2 x 2 px.

use super::*;
use wm_street::Park;
use wm_street::capture::{CaptureFlaws, CaptureKind, CaptureSettings, ExifFault, write};

pub(super) fn png_of(path: &Path, size: (u32, u32), gray: u8) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let mut encoder = png::Encoder::new(fs::File::create(path).unwrap(), size.0, size.1);
    encoder.set_color(png::ColorType::Grayscale);
    let pixels = vec![gray; (size.0 * size.1) as usize];
    encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
}

#[test]
fn masks_of_other_sizes_are_named() {
    let place = place();
    for photo in 0..6 {
        png_of(&place.path(format!("set/masks/{photo:05}.png")), (72, 48), 255);
    }
    let mask = place.path("set/masks/00002.png");
    for (size, says) in [
        ((40, 20), "the mask is 40x20 px, the photo 72x48; make the mask as large as the photo"),
        ((2, 2), "the mask is 2x2 px, the photo 72x48"),
        ((48, 72), "the mask is 48x72 px, the photo 72x48"),
    ] {
        png_of(&mask, size, 255);
        place.untrained("set", &[], &["set/masks/00002.png: ", says, "(--skip-bad goes on without it)"]);
    }
    // Smaller as a whole will do.
    png_of(&mask, (36, 24), 255);
    place.trained(&["--steps", "2", "--priors", "none"]);
    fs::remove_file(place.path("scene.ply")).unwrap();
    fs::remove_dir_all(place.path("scene.ply.run")).unwrap();
    place.put("set/masks/00002.png", "no picture");
    place.untrained("set", &[], &["set/masks/00002.png: "]);
    let output = place.trained(&["--skip-bad", "--steps", "3", "--priors", "none"]);
    let warned = said(&output);
    assert!(
        warned.contains("warning: set/masks/00002.png: ") && warned.contains("it is left out"),
        "{warned}"
    );
}

/// Copies photo `name` with its EXIF from the same capture with a lie in all of its photos.
fn lie(place: &Workshop, settings: &CaptureSettings, lie: ExifFault, name: &str) {
    let flaws = CaptureFlaws { exif: vec![lie], ..CaptureFlaws::default() };
    let lying = CaptureSettings { flaws, ..settings.clone() };
    write(&Park::builtin(), &place.path("lying"), &lying, &mut |_| true).unwrap().unwrap();
    fs::copy(place.path("lying/images").join(name), place.path("air/images").join(name)).unwrap();
}

#[test]
fn one_photo_on_the_moon_and_one_in_australia_change_nothing() {
    let place = place_with(&DatasetOptions { count: 1, points: 0, ..PHOTOS });
    let settings = CaptureSettings {
        count: 12,
        size: (48, 32),
        samples: 1,
        points: 150,
        truth: GroundTruth::Omit,
        ..CaptureSettings::new(CaptureKind::Nadir)
    };
    let capture = write(&Park::builtin(), &place.path("air"), &settings, &mut |_| true).unwrap().unwrap();
    let names: Vec<String> = capture.views.iter().map(|view| view.name.clone()).collect();
    let train = |out: &str| {
        let more = ["--out", out, "--steps", "2", "--priors", "none"];
        let output = succeeds(&mut place.program(reconstruct("air", &more)));
        let scene = wm_scene::Scene::open(place.path(out)).unwrap();
        (scene.metadata, said(&output))
    };
    let (truth, warned) = train("true.ply");
    assert!(!warned.contains("EXIF"), "{warned}");
    lie(&place, &settings, ExifFault::Continent, &names[0]);
    lie(&place, &settings, ExifFault::Nonsense, &names[5]);
    let (found, warned) = train("lied.ply");
    let says = format!(
        "warning: {}, {}: the EXIF states a place where the photo cannot have been taken",
        names[0], names[5]
    );
    assert_eq!(warned.matches(&says).count(), 1, "{says}: {warned}");
    let off = truth.up.unwrap().angle_between(found.up.unwrap()).to_degrees();
    assert!(off < 2.0, "{off}");
    let ratio = found.metres_per_unit.unwrap() / truth.metres_per_unit.unwrap();
    assert!((ratio - 1.0).abs() < 0.05, "{ratio}");
}

/// Puts another word into a line of a text.
fn spoil(text: &str, line: &str, word: usize, number: &str) -> String {
    let mut words: Vec<&str> = line.split(' ').collect();
    words[word] = number;
    text.replace(line, &words.join(" "))
}

#[test]
fn models_with_numbers_that_are_none() {
    let place = place_with(&DatasetOptions { storage: ColmapStorage::Text, ..PHOTOS });
    let text = |name: &str| String::from_utf8(place.read(name)).unwrap();
    // A focal length of 0, as where EXIF has none; the position of a photo; that of a point.
    let cameras = text("set/sparse/0/cameras.txt");
    let line = cameras.lines().find(|line| line.contains("PINHOLE")).unwrap();
    for number in ["0", "-100", "nan", "inf"] {
        place.put("set/sparse/0/cameras.txt", spoil(&cameras, line, 4, number));
        place.untrained("set", &[], &["set/sparse/0/cameras.txt", "must be finite and above 0"]);
    }
    place.put("set/sparse/0/cameras.txt", &cameras);
    let images = text("set/sparse/0/images.txt");
    let line = images.lines().find(|line| line.ends_with(".png")).unwrap();
    for (word, number) in [(5, "nan"), (6, "inf"), (1, "nan")] {
        place.put("set/sparse/0/images.txt", spoil(&images, line, word, number));
        place.untrained("set", &[], &["set/sparse/0/images.txt"]);
    }
    place.put("set/sparse/0/images.txt", "");
    let says = "set/sparse/0/images.txt: no image is registered in the model";
    place.untrained("set", &[], &[says]);
    place.put("set/sparse/0/images.txt", &images);
    let points = text("set/sparse/0/points3D.txt");
    let line = points.lines().rfind(|line| !line.starts_with('#')).unwrap();
    place.put("set/sparse/0/points3D.txt", spoil(&points, line, 2, "nan"));
    let output = finish(&mut place.program(reconstruct("set", &["--steps", "2", "--priors", "none"])));
    let told = said(&output);
    assert!(!told.contains("panicked"), "{told}");
    assert!(output.status.success() || told.contains("set/sparse/0/points3D.txt"), "{told}");
}

#[test]
fn photos_of_two_by_two_pixels_are_named() {
    // One of them among photos of the model's size.
    let place = place();
    png_of(&place.path("set/images/00002.png"), (2, 2), 90);
    let says = "the photo is 2x2 px, too small to learn from; give photos of at least 8 px";
    place.untrained("set", &[], &[&format!("set/images/00002.png: {says}")]);
    // All of them, and a model of that size.
    let place = place_with(&DatasetOptions { size: (2, 2), points: 40, ..PHOTOS });
    let says = ["set/images/00000.png: the photo is 2x2 px, too small", "(so are all 6 photos)"];
    place.untrained("set", &[], &says);
}
