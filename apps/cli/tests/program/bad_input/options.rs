//! Options that are unknown, malformed or impossible.

use super::*;

#[test]
fn the_command_line_itself() {
    let place = place();
    let similar = "unrecognized subcommand 'rendr'; some similar subcommands exist: 'reconstruct', 'render'";
    for (words, says) in [
        ("render", "required arguments were not provided: <SCENE>"),
        ("rendr good.ply", similar),
        ("render good.ply --wether fog", "'--wether' found; a similar argument exists: '--weather'"),
        ("render good.ply other.ply", "unexpected argument 'other.ply' found"),
        ("render good.ply --weather", "a value is required for '--weather <NAME|FILE|REPORT>'"),
        ("inspect good.ply --set fog=on", "unexpected argument '--set' found"),
    ] {
        place.refused(words, &[says, "(--help lists the options)"]);
    }
    let bare = place.outcome([] as [&str; 0]);
    assert_eq!(bare.status.code(), Some(2));
}

#[test]
fn numbers_and_words() {
    let place = place();
    let camera = |text: &'static str| ["--camera", text];
    for ([option, value], says) in [
        (["--size", "0x0"], "--size"),
        (["--size", "100000x100000"], "each side 1 to 32768"),
        (["--size", "32768x32768"], "268435456 in all"),
        (camera("1e30,0,0:1e30,5,0"), "coordinates must be within 10^10 of zero"),
        (["--size", "-3x4"], "size \"-3x4\": give WxH in pixels"),
        (["--size", "big"], "size \"big\": give WxH in pixels"),
        (["--size", "1e3x1e3"], "give WxH in pixels"),
        (["--fov", "0"], "--fov 0: must be 0.1 to 170 degrees"),
        (["--fov", "180"], "--fov 180: must be 0.1 to 170 degrees"),
        (["--fov", "nan"], "--fov NaN: must be 0.1 to 170 degrees"),
        (["--fov", "-5"], "--fov -5: must be 0.1 to 170 degrees"),
        (["--fov", "wide"], "invalid value 'wide' for '--fov"),
        (["--lens", "fisheye:0"], "`0` is not an angle above 0 and up to 360 degrees"),
        (["--lens", "telephoto"], "`telephoto` is not a lens: use fisheye"),
        (["--lens", "none.toml"], "none.toml"),
        (["--near", "nan"], "--near NaN: must be finite and above 0"),
        (["--near", "0"], "--near 0: must be finite and above 0"),
        (["--near", "-1"], "--near -1: must be finite and above 0"),
        (camera(""), "give X,Y,Z:X,Y,Z, the name of a view, or a JSON file of keyframes"),
        (camera("1,2,3"), "this is the eye alone; add the point it looks at"),
        (camera("1,2,3:1,2,3"), "camera from 1,2,3 to 1,2,3 with up 0,0,1 has no direction or no up"),
        (camera("1,2,3:1,2,9"), "camera from 1,2,3 to 1,2,9 with up 0,0,1 has no direction or no up"),
        (camera("1e308,0,0:-1e308,0,0"), "camera from 1e308,0,0 to -1e308,0,0"),
        (camera("IMG_1"), "camera \"IMG_1\": the scene has no views of photos; give X,Y,Z:X,Y,Z"),
        (camera("missing.json"), "missing.json: no such file or folder; check the path"),
        (["--path", "orbitt"], "unknown path; did you mean orbit?"),
        (["--path", "missing.json"], "missing.json: no such file or folder; check the path"),
        (
            ["--path", "orbit"],
            "--path moves the camera, and a.png is one picture: give --out a name that ends in",
        ),
        (["--path", "dolly"], ".mp4 or a folder, or --time S for the picture at that time"),
        (["--distance", "-1"], "--distance -1: must be finite and above 0"),
        (["--distance", "5"], "--distance needs --path dolly"),
        (["--metres-per-unit", "0"], "--metres-per-unit is 0: it must be 1e-6 to 1e6"),
        (["--metres-per-unit", "-1"], "--metres-per-unit is -1: it must be 1e-6 to 1e6"),
        (["--metres-per-unit", "nan"], "--metres-per-unit is NaN: it must be 1e-6 to 1e6"),
        (["--known-distance", "5"], "`5` is no known distance: write two points and metres"),
        (["--known-distance", "0,0,0:1,0=2"], "is no known distance: write two points and metres"),
        (["--known-distance", "0,0,0:0,0,0=2"], "give no scale: they must be finite and apart"),
        (["--known-distance", "0,0,0:1,0,0=-2"], "of -2 m gives no scale: it must be finite and above 0"),
        (["--up", "0,0,0"], "up \"0,0,0\": it has no length"),
        (["--ground", "nan"], "--ground is NaN: it must be finite"),
        (["--threads", "0"], "invalid value '0' for '--threads <N>': 0 is not in 1..=1024"),
        (["--simd", if cfg!(target_arch = "x86_64") { "neon" } else { "avx2" }], "use --simd auto"),
        (["--simd", "mmx"], "`mmx` is no SIMD path: use one of auto"),
        (["--time", "nan"], "--time NaN: must be a number of seconds"),
        (["--seconds", "0"], "--seconds 0: must be above 0"),
        (["--seconds", "-1"], "--seconds -1: must be above 0"),
        (["--fps", "0"], "\"0\" is not a frame rate: use frames per second such as 30"),
        (["--fps", "-1"], "\"-1\" is not a frame rate: use frames per second such as 30"),
        (["--bitrate", "0"], "0 is not in 1..=4294967295"),
        (
            ["--also", "depht"],
            "`depht` is not a picture output: use depth, median-depth, normal, alpha, transmittance, particles",
        ),
        (["--frame-format", "gif"], "`gif`: use png, exr or npy"),
        (["--background", "#12"], "`#12` is not a background: use auto, sky, black or #rrggbb"),
        (["--frames", "5..5"], "`5..5` has no frames: the end must be after the first"),
        (["--frames", "9..3"], "`9..3` has no frames: the end must be after the first"),
        (["--frames", "-3..3"], "`-3..3` is not a range of frames: use 300..420, 300..=420 or 300.."),
        (["--frames", "7"], "`7` is not a range of frames: use 300..420, 300..=420 or 300.."),
        (["--frames", "0..3"], "--frames and --frame-step are for videos and folders of frames"),
        (["--frame-step", "2"], "--frames and --frame-step are for videos and folders of frames"),
        (["--frame-step", "0"], "invalid value '0' for '--frame-step <N>'"),
        (["--dither", "some"], "invalid value 'some' for '--dither <DITHER>'"),
    ] {
        place.render_refused("good.ply", &[option, value], &[says]);
    }
    let says = "the scene has no views of photos to go along; give orbit, dolly or a JSON";
    for more in [["--time", "0"], ["--out", "frames"]] {
        place.render_refused("good.ply", &[&["--path", "capture"][..], &more].concat(), &[says]);
    }
    place.rendered("good.ply", &["--path", "orbit", "--time", "1"]);
    fs::remove_file(place.path("a.png")).unwrap();
    let long = place.render_refused("good.ply", &["--camera", "1e308,0,0:-1e308,0,0"], &[]);
    assert!(long.len() < 300, "{long}");
    let says = "4294967295 frames are too many for one run: the maximum is 1000000";
    place.render_refused("good.ply", &["--seconds", "1e300", "--out", "frames"], &[says]);
    for (range, named) in [("0..4", "0..4"), ("0..=3", "0..4"), ("3..", "3..")] {
        let says =
            format!("--frames {named}: the sequence has 3 frames, 0..3; make it longer with --seconds");
        for out in ["frames", "a.mp4"] {
            let args = ["--seconds", "0.1", "--frames", range, "--out", out];
            place.render_refused("good.ply", &args, &[&says]);
        }
    }
}

#[test]
fn what_is_odd_but_works() {
    let place = place();
    for more in [
        &["--size", "1x1"][..],
        &["--fov", "0.1"],
        &["--fov", "170"],
        &["--camera", "500,500,500:1000,1000,1000"],
        &["--camera", "1e9,0,0:1e9,5,0"],
        &["--near", "1e-30"],
        &["--time", "-1e300"],
        &["--metres-per-unit", "1e-6", "--weather", "fog"],
        &["--metres-per-unit", "1e6", "--weather", "ground-fog"],
        &["--weather", "fog", "--set", "fog.mor=inf"],
    ] {
        place.rendered("good.ply", more);
        fs::remove_file(place.path("a.png")).unwrap();
    }
}

#[test]
fn outputs_that_cannot_be() {
    let place = place();
    place.put("file", "");
    fs::create_dir(place.path("folder.png")).unwrap();
    for (out, says) in [
        ("file/a.png", "file/a.png: cannot be written: "),
        ("file/frames", "cannot create the folder file/frames: "),
        ("file", "--out file: is not a folder; give a folder, or a name that ends in .png"),
        ("a.jpg", "--out a.jpg: a name that ends in .jpg cannot be written; use .png, .exr, .npy, .mp4"),
        ("good.ply", "--out good.ply: a name that ends in .ply cannot be written; use .png"),
    ] {
        place.render_refused("good.ply", &["--out", out], &[says]);
    }
    if cfg!(target_os = "linux") {
        place.render_refused("good.ply", &["--out", "/proc/a.png"], &["/proc/a.png: cannot be written: "]);
        place.render_refused("good.ply", &["--out", "/dev/full"], &["--out /dev/full: is not a folder"]);
    }
    for (option, name) in
        [("--out", "a.png"), ("--out", "a.exr"), ("--out", "a.mp4"), ("--save-path", "p.json")]
    {
        let path = format!("missing/{name}");
        let says = format!("{path}: cannot be written: the folder \"missing\" does not exist; create it");
        place.render_refused("good.ply", &[option, &path], &[&says]);
    }

    let mine = place.put("mine.png", "mine");
    let mut rights = fs::metadata(&mine).unwrap().permissions();
    rights.set_readonly(true);
    fs::set_permissions(&mine, rights).unwrap();
    let says = "mine.png: cannot be written: it is write-protected; choose another name";
    place.render_refused("good.ply", &["--out", "mine.png"], &[says]);

    place.put("frames/render.json", "{}");
    let says = "frames: holds frames of another render; empty it, or give another folder";
    place.render_refused("good.ply", &["--out", "frames", "--seconds", "0.1"], &[says]);
}

#[test]
fn videos_that_cannot_be() {
    let place = place();
    let video = ["--out", "a.mp4", "--seconds", "0.1"];
    let refuse = |more: &[&str], says: &str| {
        place.render_refused("good.ply", &[&video, more].concat(), &["a.mp4: ", says]);
    };
    for (size, even) in [("33x32", "34x32"), ("32x17", "32x18"), ("1x1", "2x2")] {
        refuse(&["--size", size], &format!("a video of {size} pixels has an odd side: use {even}"));
    }
    if cfg!(feature = "h264") {
        refuse(&["--size", "8x8"], "the built-in encoder takes 16 to 3840x2160 or 2160x3840, not 8x8 pixels");
        refuse(&["--size", "3842x16"], "not 3842x16 pixels: use --encoder ffmpeg");
    } else {
        refuse(&[], "this program was built without its H.264 encoder: use --encoder ffmpeg");
    }
    let mut no_ffmpeg = place.program(render("good.ply", &[&video, &["--encoder", "ffmpeg"][..]].concat()));
    let error = place.refused_by(no_ffmpeg.env("PATH", ""), &["a.mp4: cannot start ffmpeg", "install it"]);
    assert_eq!(error.matches("os error").count(), 1, "{error}");
    let says = "--also is for pictures and folders of frames: give --out a folder";
    place.render_refused("good.ply", &[&video, &["--also", "depth"][..]].concat(), &[says]);
}

#[test]
fn camera_files() {
    let place = place();
    let key = r#"{"time": 0, "eye": [0, -6, 2], "target": [0, 0, 2]}"#;
    for (text, says) in [
        ("".to_owned(), "p.json: the file is empty"),
        ("{\"keyframes\": [\n {]}".into(), "p.json, line 2, column 3: key must be a string"),
        (format!("{{\"keyframes\": [\n {key}"), "p.json, line 2, column "),
        ("{\"keyframes\": []}".into(), "p.json: there are no keyframes"),
        ("[]".into(), "p.json, line 1, column "),
        (
            "{\"keyframes\": [\n {\"time\": NaN, \"eye\": [0,0,0]}]}".into(),
            "p.json, line 2, column 11: expected value",
        ),
        (
            format!("{{\"keyframes\": [\n{key},\n{}]}}", key.replace("-6", "-1e999")),
            "p.json, line 3, column 29: number out of range",
        ),
        (
            format!("{{\"keyframes\": [{key}, {key}]}}"),
            "p.json: keyframe 2: its time, 0, is not after that of the one before, 0",
        ),
        (
            format!("{{\"fov\": 200, \"keyframes\": [{key}]}}"),
            "p.json: keyframe 1: fov is 200: it must be 0.1 to 170 degrees",
        ),
        (
            format!("{{\"keyframes\": [{}]}}", key.replace("-6", "-1e11")),
            "p.json: keyframe 1: camera position is 99999999999.99997: coordinates must be within 10^10 of zero",
        ),
        (
            format!("{{\"keyframes\": [{}]}}", key.replace("eye", "eyes")),
            "p.json, line 1, column 33: unknown key \"eyes\"; did you mean \"eye\"?",
        ),
    ] {
        place.put("p.json", text);
        place.render_refused("good.ply", &["--camera", "p.json"], &[says]);
        place.render_refused("good.ply", &["--path", "p.json", "--out", "frames"], &[says]);
    }
    // 60 m in a millisecond: rain would be streaks of kilometres.
    let far = key.replace("\"time\": 0, \"eye\": [0, -6", "\"time\": 1e-3, \"eye\": [0, -66");
    place.put("p.json", format!("{{\"keyframes\": [{key}, {far}]}}"));
    let along = ["--path", "p.json", "--time", "0", "--weather", "heavy-rain"];
    place.render_refused("good.ply", &along, &["the camera moves at", "up to 1000 m/s"]);
    // One keyframe is a camera that stands still.
    place.put("p.json", format!("{{\"keyframes\": [{key}]}}"));
    place.rendered("good.ply", &["--camera", "p.json"]);
    place.rendered("good.ply", &["--path", "p.json", "--out", "frames", "--seconds", "0.1"]);
    assert_eq!(fs::read_dir(place.path("frames")).unwrap().count(), 4);
}

/// A picture replaces another where that is asked for, but nothing that is read.
#[test]
fn pictures_spare_what_is_read() {
    let place = place();
    place.rendered("good.ply", &["--save-path", "p.json", "--size", "64x32"]);
    place.rendered("good.ply", &["--set", "sky.panorama=a.png", "--out", "b.png"]);
    place.rendered("good.ply", &["--out", "b.png"]);
    let lost = "is an input of this command and would be lost; choose another name";
    for (more, file) in [
        (&["--set", "sky.panorama=a.png"][..], "a.png"),
        (&["--set", "sky.panorama=a.png", "--out", "./a.png"], "./a.png"),
        (&["--camera", "p.json", "--save-path", "p.json"], "p.json"),
        (&["--path", "p.json", "--save-path", "p.json", "--out", "f"], "p.json"),
        (&["--save-path", "good.ply"], "good.ply"),
    ] {
        place.render_refused("good.ply", more, &[&format!("{file}: {lost}")]);
    }
    // Unasked nothing is replaced, whatever a command writes.
    for (words, file) in [
        ("render good.ply --out b.png", "b.png"),
        ("render good.ply --out c.png --save-path p.json", "p.json"),
        ("render good.ply --out c.png --also depth", "c.depth.png"),
        ("scan good.ply --out c.ply --picture above", "c-above.png"),
        ("inspect good.ply --light --light-picture b.png", "b.png"),
    ] {
        if !place.path(file).exists() {
            place.put(file, "mine");
        }
        let says = format!("{file}: exists already; choose another name, or replace it with --overwrite");
        place.refused(words, &[&says]);
    }
    place.put("x.depth.png", place.read("a.png"));
    let more = ["--set", "sky.panorama=x.depth.png", "--also", "depth", "--out", "x.png"];
    place.render_refused("good.ply", &more, &[&format!("x.depth.png: {lost}")]);
}
