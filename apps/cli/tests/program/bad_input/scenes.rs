//! Scene files that are none, are cut, or lie.

use super::*;
use std::time::{Duration, Instant};

/// Renders and inspects a spoilt scene; both must say the same.
fn both_refuse(place: &Workshop, scene: &str, says: &[&str]) {
    let named = [&[scene][..], says].concat();
    let error = place.render_refused(scene, &[], &named);
    assert_eq!(place.refuses(["inspect", scene], &named), error);
    assert_eq!(place.refuses(["inspect", "--json", scene], &named), error);
}

#[test]
fn what_is_no_scene() {
    let place = place();
    fs::create_dir(place.path("folder")).unwrap();
    place.put("empty.ply", "");
    place.put("text.ply", "hello world\n");
    place.put("text.txt", "hello world\n");
    place.put("picture.ply", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR");
    place.put("page.ply", "<!DOCTYPE html>\n");
    for (scene, says) in [
        ("missing.ply", "no such file or folder; check the path"),
        ("missing/a.ply", "no such file or folder; check the path"),
        ("good.ply/a.ply", "cannot be read"),
        (
            "folder",
            "a folder with no point_cloud/iteration_*/point_cloud.ply, meta.json or lod-meta.json in it; give",
        ),
        ("empty.ply", "the file is empty; copy or export it again"),
        ("text.ply", "not a PLY file, although its name says so: it begins with \"hello world\\n\"; convert"),
        ("text.txt", "of none of the formats that are read (PLY, "),
        ("picture.ply", "not a PLY file, although its name says so: it begins with \"\\x89PNG"),
        ("page.ply", "download the file itself"),
    ] {
        both_refuse(&place, scene, &[says]);
    }
}

#[test]
fn what_is_cut() {
    let place = place();
    let whole = Ply::sound().bytes();
    let body = whole.len() - 60 * 14 * 4;
    for end in [4, 20, 45, 70, 150, body - 12, body - 2] {
        place.put("cut.ply", &whole[..end]);
        place.render_refused("cut.ply", &[], &["cut.ply: cut off in the header", "copy or download"]);
    }
    for missing in [1, 4, 56, 57, 2000, 60 * 56] {
        place.put("cut.ply", &whole[..whole.len() - missing]);
        let says =
            format!("cut.ply: cut off: the header promises 60 splats, at least {missing} bytes are missing");
        place.render_refused("cut.ply", &[], &[&says]);
    }
    both_refuse(&place, "cut.ply", &["copy or download the file again"]);
}

#[test]
fn promises_take_neither_memory_nor_time() {
    let place = place();
    let nine = "9223372036854775808";
    for (count, says) in [
        ("1000000000000", "cut off: the header promises 1000000000000 splats, at least"),
        (nine, "cut off: the header promises 9223372036854775808 splats, at least"),
        ("18446744073709551615", "cut off: the header promises 18446744073709551615 splats, at least"),
        ("18446744073709551616", "line 3: \"18446744073709551616\" is not a number of elements"),
        ("-5", "line 3: \"-5\" is not a number of elements"),
        ("many", "line 3: \"many\" is not a number of elements"),
    ] {
        let ply = Ply { count: count.into(), ..Ply::sound() }.bytes();
        let text = String::from_utf8_lossy(&ply[..600]).replace("binary_little_endian", "ascii");
        place.put("binary.ply", &ply);
        place.put("ascii.ply", text.split_inclusive("end_header\n").next().unwrap());
        let started = Instant::now();
        both_refuse(&place, "binary.ply", &[says]);
        both_refuse(&place, "ascii.ply", &[says.trim_end_matches(", at least")]);
        // Six runs; one that believes the header takes minutes.
        assert!(started.elapsed() < Duration::from_secs(6), "{count}");
        if cfg!(target_os = "linux") {
            // 2 GiB of address space: what is promised needs more.
            let script = "ulimit -v 2097152; exec \"$@\"";
            let mut limited = Command::new("sh");
            limited.args(["-c", script, "sh", env!("CARGO_BIN_EXE_weather-magician")]);
            limited.args(render("binary.ply", &[])).current_dir(place.path("")).stdin(Stdio::null());
            place.refused_by(&mut limited, &["binary.ply", says]);
        }
    }
}

#[test]
fn properties_that_are_not_there() {
    let place = place();
    for name in ["x", "opacity", "scale_0", "rot_0", "f_dc_0"] {
        let index = PROPERTIES.iter().position(|p| *p == name).unwrap();
        let mut ply = Ply::sound();
        ply.properties.remove(index);
        ply.rows.iter_mut().for_each(|row| _ = row.remove(index));
        place.put("a.ply", ply.bytes());
        let says = format!("the vertex element has no property {name}; a 3DGS file has x y z f_dc_0..2");
        both_refuse(&place, "a.ply", &[&says]);
    }
    let mut ply = Ply::sound();
    ply.properties[0] = "list uchar float x".into();
    place.put("a.ply", ply.bytes());
    both_refuse(&place, "a.ply", &["the property x is a list, not one number per splat"]);
    ply.properties[0] = "quaternion x".into();
    place.put("a.ply", ply.bytes());
    both_refuse(&place, "a.ply", &["line 4: \"quaternion\" is not a number type of PLY"]);
    for rest in [1, 7, 27, 46] {
        let mut ply = Ply::sound();
        ply.properties.extend((0..rest).map(|i| format!("float f_rest_{i}")));
        ply.rows.iter_mut().for_each(|row| row.resize(14 + rest, 0.0));
        place.put("a.ply", ply.bytes());
        let says = format!("{rest} f_rest properties fit no SH degree: 0, 9, 24, 45 or 72 do");
        both_refuse(&place, "a.ply", &[&says]);
    }
    place.put("a.ply", Ply { count: "0".into(), rows: Vec::new(), ..Ply::sound() }.bytes());
    both_refuse(&place, "a.ply", &["there are no splats in it; nothing can be shown"]);
}

/// Refused with counts, counted by `inspect`, and left out by `--repair`: then the picture is that
/// of the other splats, on any number of threads.
#[test]
fn numbers_that_are_none() {
    let place = place();
    let picture = |scene: &str, more: &[&str]| {
        place.rendered(scene, &[&["--out", "picture.npy"], more].concat());
        let bytes = place.read("picture.npy");
        fs::remove_file(place.path("picture.npy")).unwrap();
        bytes
    };
    let mut others = Ply::sound();
    others.rows.remove(7);
    others.count = "59".into();
    place.put("others.ply", others.bytes());
    let expected = picture("others.ply", &[]);

    let (nan, inf) = (f32::NAN, f32::INFINITY);
    let in_every = PROPERTIES.map(|name| (name, nan));
    let some = [("x", inf), ("y", -inf), ("scale_1", inf), ("rot_0", inf), ("rot_3", -inf), ("f_dc_2", inf)];
    for (name, value) in in_every.into_iter().chain(some) {
        place.put("a.ply", Ply::with(name, value).bytes());
        let (field, key) = match name.split('_').next().unwrap() {
            "f" => ("colours", "sh"),
            "opacity" => ("opacities", "opacity"),
            "scale" => ("scales", "scale"),
            "rot" => ("rotations", "quat"),
            _ => ("positions", "mean"),
        };
        let says =
            format!("a.ply: 1 of 60 splats hold NaN, infinite or absurd numbers (1 in {field}); --repair");
        place.render_refused("a.ply", &[], &[&says]);
        assert_eq!(picture("a.ply", &["--repair"]), expected, "{name} {value}");
        let health = &place.inspected("a.ply")["health"];
        assert_eq!((&health["faulty"], &health["faults"][key]), (&1.into(), &1.into()));
    }
    assert_eq!(picture("a.ply", &["--repair", "--threads", "3"]), expected);
    let printed = place.run("inspect a.ply");
    let says = "1 colours that are NaN, infinite or absurdly bright: not rendered: `render --repair`";
    assert!(printed.contains(says), "{printed}");

    // These are numbers after activation: fully opaque, fully clear, and flat.
    for (name, value) in [("opacity", inf), ("opacity", -inf), ("scale_0", -inf)] {
        place.put("a.ply", Ply::with(name, value).bytes());
        assert_eq!(picture("a.ply", &[]), picture("a.ply", &["--threads", "2"]));
    }

    let mut ply = Ply::sound();
    ply.rows.iter_mut().for_each(|row| row[0] = nan);
    place.put("a.ply", ply.bytes());
    let says =
        "a.ply: 60 of 60 splats hold NaN, infinite or absurd numbers (60 in positions); nothing is left";
    place.render_refused("a.ply", &["--repair"], &[says]);
    let health = &place.inspected("a.ply")["health"];
    assert_eq!((&health["faulty"], &health["bounds"]), (&60.into(), &().into()));
}

#[test]
fn what_lies_beside_a_scene() {
    let place = place();
    place.put("good.ply.wm.toml", "ground = 1.0\nmeters_per_unit = 2.0\n");
    let says =
        ["good.ply.wm.toml, line 2, column 1: unknown field `meters_per_unit`", "correct or remove it"];
    both_refuse(&place, "good.ply", &says);
    place.put("good.ply.wm.toml", "metres_per_unit = -2.0\n");
    both_refuse(&place, "good.ply", &["good.ply.wm.toml, line 1, column 1: metres_per_unit is -2"]);
    place.put("good.ply.wm.toml", b"ground = \xff");
    both_refuse(&place, "good.ply", &["good.ply.wm.toml: cannot be read"]);
    fs::remove_file(place.path("good.ply.wm.toml")).unwrap();

    place.put("training/point_cloud/iteration_7/point_cloud.ply", Ply::sound().bytes());
    place.put("training/cameras.json", "[{\"id\": 0,\n \"img_name\": 3}]");
    both_refuse(&place, "training", &["training/cameras.json, line 2, column 14: invalid type: integer `3`"]);
    place.put("training/cameras.json", "[{\"id\"");
    both_refuse(&place, "training", &["training/cameras.json, line 1, column 6", "correct or remove"]);
    place.put("training/point_cloud/iteration_8/point_cloud.ply", "ply\n");
    place.put("training/cameras.json", "[]");
    both_refuse(&place, "training", &["iteration_8/point_cloud.ply: cut off in the header"]);
}

#[test]
fn views_that_are_none() {
    let place = place();
    fs::create_dir(place.path("empty")).unwrap();
    place.put("half/cameras.bin", [1, 0, 0]);
    place.put("cut/cameras.bin", [1, 0, 0]);
    place.put("cut/images.bin", [0; 8]);
    place.put("huge/cameras.bin", [0xff; 60]);
    place.put("huge/images.bin", [0; 8]);
    place.put("text/sparse/0/cameras.txt", "1 PINHOLE 100 100 50 50 50 50\n");
    place.put("text/sparse/0/images.txt", "# Images\n1 1 0 0 0 0 0 x 1 a.jpg\n\n");
    place.put("radial/cameras.txt", "1 OPENCV_FISHEYE 100 100 50 50 50 50 0 0 0 0\n");
    place.put("radial/images.txt", "");
    for (folder, says) in [
        ("missing", "missing: no such file or folder; check the path"),
        (
            "good.ply",
            "good.ply: a file of no capture that is known; give the folder of a COLMAP model, a transforms.json,",
        ),
        (
            "empty",
            "empty: no COLMAP model, transforms.json, reconstruction.json (OpenSfM) or bundle.out here",
        ),
        ("half", "half/cameras.bin: cut off in the number of cameras; copy the file"),
        ("cut", "cut/cameras.bin: cut off in the number of cameras; copy the file"),
        ("huge", "huge/cameras.bin, byte 8: camera 4294967295 has the model number -1"),
        ("text", "text/sparse/0/images.txt, line 2: \"x\" is not a number for a pose"),
        ("radial", "radial/cameras.txt, line 1: camera 1 has the model OPENCV_FISHEYE"),
    ] {
        place.render_refused("good.ply", &["--views", folder], &[says]);
    }
    place.put("one/cameras.txt", "1 PINHOLE 100 100 50 50 50 50\n");
    place.put("one/images.txt", "1 1 0 0 0 0 0 0 1 front/IMG_1.jpg\n\n");
    let says = "camera \"IMG_2\": the scene has no such view; did you mean \"IMG_1\"";
    place.render_refused("good.ply", &["--views", "one", "--camera", "IMG_2"], &[says]);
    place.render_refused("good.ply", &["--views", "one", "--camera", "2"], &["have the numbers 1 to 1"]);
    place.rendered("good.ply", &["--views", "one", "--camera", "IMG_1"]);
}

#[test]
fn real_files_that_are_no_scene() {
    let place = place();
    if let Some(points) = data("points/garden_points.ply") {
        let said = said(&place.rendered(points.to_str().unwrap(), &["--up", "0,0,1"]));
        assert!(said.contains("points and no splats: each is drawn as a ball"), "{said}");
    }
    if let Some(scene) = data("scenes/taebak.ply") {
        let bytes = fs::read(scene).unwrap();
        place.put("start.ply", &bytes[..1 << 20]);
        both_refuse(&place, "start.ply", &["cut off: the header promises 212464 splats, at least"]);
    }
}
