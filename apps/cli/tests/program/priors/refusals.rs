//! Bad input: one line that says what, where, and what to do.

use super::*;

#[test]
fn options_that_do_not_go_together() {
    let desk = desk();
    for (options, says) in [
        ("--source files", &["--source files needs maps", "--depth, --normal or --sky"][..]),
        ("--source photos --sky x", &["--sky cannot be used with the source photos"]),
        ("--weights x --depth y", &["--weights cannot be used with the source files"]),
        ("--resume", &["--resume", "leave it out"]),
        ("--sky x", &["--sky x: there is no such folder"]),
        ("--depth . --metres-per-unit 0", &["--metres-per-unit is 0: it must be finite and above 0"]),
        ("--depth . --depth-form disparity --metres-per-unit 2", &["--depth-scale metric"]),
        ("--depth .", &["no photo has a map in it", "00000.npy"]),
        ("--eval-every 1", &["--eval-every 1", "larger"]),
    ] {
        desk.refused(options, says);
    }
    let output = finish(&mut desk.command("--normal x"));
    assert!(!output.status.success() && said(&output).contains("--normal-axes"), "{}", said(&output));
    let nowhere = finish(&mut desk.program(["priors", "nowhere"]));
    let told = said(&nowhere);
    assert!(!nowhere.status.success() && told.starts_with("error: nowhere: "), "{told}");
}

#[test]
fn maps_that_do_not_fit() {
    let desk = desk();
    maps(&desk, "tall", "depth", |_, depth| (depth, vec![120, 80]));
    let options = "--depth-unit units";
    let says = ["tall/00000.npy", "the map is 80x120 px, its photo 120x80"];
    desk.refused(&format!("--depth tall {options}"), &says);
    maps(&desk, "cut", "depth", |_, depth| (depth, PHOTO_SHAPE.to_vec()));
    let bytes = desk.read("cut/00000.npy");
    desk.put("cut/00000.npy", &bytes[..bytes.len() / 2]);
    desk.refused(&format!("--depth cut {options}"), &["cut/00000.npy", "cut off"]);
    // 16-bit counts that do not say what they are.
    let mut grey = Vec::new();
    let mut encoder = png::Encoder::new(&mut grey, 120, 80);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.write_header().unwrap().write_image_data(&[1; 2 * 9600]).unwrap();
    desk.put("counts/00000.png", &grey);
    desk.refused("--depth counts", &["counts/00000.png: holds whole numbers", "such as mm"]);
    maps(&desk, "inside", "normal", |_, normal| (normal.iter().map(|v| -v).collect(), vec![80, 120, 3]));
    desk.refused("--normal inside --normal-axes world", &["inside/00000.npy", "look away from the camera"]);
    maps(&desk, "white", "sky", |_, sky| (vec![1.0; sky.len()], PHOTO_SHAPE.to_vec()));
    desk.refused("--sky white", &["out: none of 4 photos has a prior; 00000.png: all of it is sky"]);
    // Depth where the form says disparity.
    let depth = shared().path("set/truth/depth");
    let says = "out: none of 4 photos has a prior; 00000.png: ";
    desk.refused(&format!("--depth {} --depth-form disparity", depth.display()), &[says]);
}

#[test]
fn too_few_points() {
    let desk = desk();
    desk.photos("set", &DatasetOptions { points: 15, count: 3, ..PHOTOS });
    let depth = "--depth set/truth/depth";
    for (options, says) in [
        ("--depth-scale relative", "points fall on known depth, 20 are needed"),
        ("", "no map follows the points of the model, so its scale is not found; give --metres-per-unit"),
    ] {
        let mut command = command_on_set(&desk, &format!("-o out {depth} {options}"));
        desk.refused_by(&mut command, &[says]);
    }
    // A scale that is known needs none.
    let mut command = command_on_set(&desk, &format!("-o out {depth} --metres-per-unit 1"));
    assert!(finish(&mut command).status.success());
}

#[test]
fn a_data_set_that_cannot_be_written_to() {
    let desk = desk();
    desk.photos("set", &DatasetOptions { count: 3, ..PHOTOS });
    // Whoever may write everywhere cannot make a folder of a file either.
    desk.put("set/priors", "a file");
    let sky = "--sky set/truth/sky";
    for options in ["", sky] {
        let mut command = command_on_set(&desk, options);
        desk.refused_by(&mut command, &["set/priors", "give another folder with -o"]);
    }
}
