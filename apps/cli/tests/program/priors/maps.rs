//! Maps whose truth is known.

use super::*;
use wm_base::statistics::median;
use wm_capture::colmap::write;
use wm_scene::camera::Distortion;
use wm_train::photos::{PhotoOptions, Photos};
use wm_train::priors::SkyClass;

/// Median relative error of inverse depth, and the share of pixels whose sky is wrong.
fn errors(desk: &Workshop, photo: usize) -> (f64, f64) {
    let prior = prior_of(desk, photo);
    let truth = |kind: &str| npy::read(&shared().path(format!("set/truth/{kind}/{photo:05}.npy"))).unwrap().0;
    let (depth, sky) = (truth("depth"), truth("sky"));
    assert_eq!(prior.disparity.len(), depth.len());
    let known = prior.disparity.iter().zip(&depth).filter(|(d, z)| **d > 0.0 && **z > 0.0);
    let mut off: Vec<f64> = known.map(|(d, z)| f64::from((d * z - 1.0).abs())).collect();
    assert!(off.len() > depth.len() / 2, "{} of {} are known", off.len(), depth.len());
    let wrong = prior.sky.iter().zip(&sky).filter(|(class, sky)| match class {
        SkyClass::Sky => **sky == 0.0,
        SkyClass::Place => **sky == 1.0,
        SkyClass::Unknown => false,
    });
    (median(&mut off).unwrap(), wrong.count() as f64 / sky.len() as f64)
}

#[test]
fn every_form_and_scale_comes_to_the_truth() {
    let desk = desk();
    let shape = || PHOTO_SHAPE.to_vec();
    let truth = shared().path("set/truth");
    let camera = capture(&shared().path("set")).views[0].camera;
    maps(&desk, "ray", "depth", |_, depth| {
        let along = |(index, z): (usize, &f32)| {
            let (x, y) = ((index % 120) as f64 + 0.5, (index / 120) as f64 + 0.5);
            let (u, v) = ((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy);
            // Millimetres.
            1000.0 * z * (u * u + v * v + 1.0).sqrt() as f32
        };
        (depth.iter().enumerate().map(along).collect(), shape())
    });
    // Each photo with a scale and a shift of its own.
    maps(&desk, "relative", "depth", |photo, depth| {
        let scale = [0.2, 1.0, 7.0, 30.0][photo];
        let of = |z: f32| if z > 0.0 { scale / z } else { 0.0 } - 0.01 * scale;
        (depth.into_iter().map(of).collect(), shape())
    });
    // Of scale factors alone, four times as many pixels, and infinitely far in the sky.
    maps(&desk, "scaled", "depth", |photo, depth| {
        let of = |z: f32| if z > 0.0 { z * (photo + 1) as f32 } else { f32::INFINITY };
        let doubled = (0..160).flat_map(|y| (0..240).map(move |x| (y / 2) * 120 + x / 2));
        (doubled.map(|pixel| of(depth[pixel])).collect(), vec![160, 240])
    });
    let z = format!("--depth {0}/depth --sky {0}/sky", truth.display());
    for (options, sky) in [
        (format!("{z} --depth-form z"), 0.0),
        (format!("{z} --metres-per-unit 1 --threads 1"), 0.0),
        (format!("{z} --depth-unit units"), 0.0),
        (format!("--depth ray --depth-form ray --depth-unit mm --sky {}/sky", truth.display()), 0.0),
        // Where nothing but the photo tells the sky some of it is not found.
        ("--depth relative --depth-form disparity".into(), 0.05),
        ("--depth scaled --depth-scale scaled --map-pixels 9600".into(), 0.0),
    ] {
        let output = run(&desk, &options);
        for photo in 0..4 {
            let (depth, wrong) = errors(&desk, photo);
            // The points are exact, but a pixel is wide: they lie half a pixel off its centre.
            assert!(depth < 0.02 && wrong <= sky, "{options}, photo {photo}: {depth} {wrong}");
        }
        let text = printed(&output);
        assert_eq!(text.lines().count(), 6, "{text}");
        let fit = priors(&desk).index().photos["00002.png"].fit.unwrap();
        assert!(fit.follow > 0.8 && fit.points > 50, "{fit:?}");
    }
    let output = run(&desk, &z);
    assert!(said(&output).contains("depth: 1 scene unit is "), "{}", said(&output));
}

#[test]
fn sky_and_normals_may_be_alone_and_all_together() {
    let desk = desk();
    let truth = shared().path("set/truth").display().to_string();
    run(&desk, &format!("--sky {truth}/sky --preview"));
    let prior = prior_of(&desk, 1);
    assert!(prior.disparity.is_empty() && prior.normal.is_empty() && prior.sky.contains(&SkyClass::Sky));
    assert!(desk.path("out/preview/00001.png.png").is_file() && desk.path("out/preview.png").is_file());
    run(&desk, &format!("--normal {truth}/normal --normal-axes world"));
    let prior = prior_of(&desk, 1);
    assert!(prior.disparity.is_empty() && prior.sky.is_empty());
    let true_normal = npy::read(&shared().path("set/truth/normal/00001.npy")).unwrap().0;
    assert_eq!(prior.normal.as_flattened().len(), true_normal.len());
    assert!(prior.normal.as_flattened().iter().zip(&true_normal).all(|(a, b)| (a - b).abs() < 1e-5));
    let all = format!("--depth {truth}/depth --sky {truth}/sky --normal {truth}/normal");
    run(&desk, &format!("{all} --normal-axes world"));
    let prior = prior_of(&desk, 1);
    assert!(prior.disparity.len() == 9600 && prior.normal.len() == 9600 && prior.sky.len() == 9600);
    // In other axes they contradict the depth.
    let says = ["none of 4 photos", "off those of its depth"];
    desk.refused(&format!("{all} --normal-axes opengl --overwrite"), &says);
}

#[test]
fn photos_without_a_fit_are_left_out_and_named() {
    let desk = desk();
    maps(&desk, "depth", "depth", |photo, depth| match photo {
        0 => (vec![f32::NAN; depth.len()], PHOTO_SHAPE.to_vec()),
        1 => (vec![3.0; depth.len()], PHOTO_SHAPE.to_vec()),
        _ => (depth, PHOTO_SHAPE.to_vec()),
    });
    maps(&desk, "sky", "sky", |photo, sky| match photo {
        2 => (vec![1.0; sky.len()], PHOTO_SHAPE.to_vec()),
        _ => (sky, PHOTO_SHAPE.to_vec()),
    });
    fs::remove_file(desk.path("sky/00001.npy")).unwrap();
    let output = run(&desk, "--depth depth --depth-scale scaled --sky sky");
    let (text, said) = (printed(&output), said(&output));
    assert!(said.contains("left out: 00000.png: 0 points fall on known depth, 20 are needed\n"), "{said}");
    assert!(said.contains("left out: 00001.png: only "), "{said}");
    assert!(said.contains("left out: 00002.png: all of it is sky\n"), "{said}");
    assert!(said.contains("no map of 00001.png, 3 of 4 photos have one"), "{said}");
    assert!(text.contains("depth of ") && text.contains(" from 1 photos"), "{text}");
    assert_eq!(priors(&desk).index().left_out.len(), 3);
}

#[test]
fn what_ended_goes_on_and_any_number_of_threads_gives_the_same() {
    let desk = desk();
    maps(&desk, "depth", "depth", |_, depth| (depth, PHOTO_SHAPE.to_vec()));
    let options = "--depth depth --depth-unit units";
    run(&desk, &format!("{options} --threads 1"));
    let whole = listing(&desk.path("out"));
    fs::remove_dir_all(desk.path("out")).unwrap();
    // Two photos at a time: the third stops it.
    desk.put("depth/00002.npy", "nonsense");
    fails(&mut desk.command(&format!("{options} --threads 1")), &["00002.npy", "no map"], &REMARKS);
    assert!(Priors::open(&desk.path("out")).unwrap().is_none());
    maps(&desk, "depth", "depth", |_, depth| (depth, PHOTO_SHAPE.to_vec()));
    // What is done is not looked at again.
    desk.put("depth/00000.npy", "nonsense");
    let elsewhere = "--depth depth --depth-unit units --map-pixels 5000 --resume";
    fails(&mut desk.command(elsewhere), &["leave out --resume"], &REMARKS);
    run(&desk, &format!("{options} --threads 3 --resume"));
    assert_eq!(listing(&desk.path("out")), whole);
}

#[test]
fn maps_of_a_bent_photo_are_bent_back() {
    let desk = desk();
    desk.photos("set", &DatasetOptions { count: 3, ..PHOTOS });
    let mut made = capture(&desk.path("set"));
    let lens = Distortion::of([-0.2, 0.03, 0.0, 0.0, 0.0]);
    made.views.iter_mut().for_each(|view| view.distortion = lens);
    write::write(&made, &desk.path("set/sparse/0"), ColmapStorage::Binary).unwrap();
    // White left of a stored column.
    let white: Vec<f32> = (0..9600).map(|pixel| if pixel % 120 < 30 { 1.0 } else { 0.0 }).collect();
    for photo in 0..3 {
        fs::create_dir_all(desk.path("sky")).unwrap();
        npy::write(&desk.path(format!("sky/{photo:05}.npy")), &white, &PHOTO_SHAPE).unwrap();
    }
    let stored = made.views[0].camera;
    let camera = Photos::open(&made, &PhotoOptions::default()).unwrap().camera(0, 0);
    succeeds(&mut command_on_set(&desk, "-o out --sky sky"));
    let prior = priors(&desk).get("00000.png", &camera).unwrap().unwrap();
    let pinhole = camera.resized(prior.width, prior.height);
    let is_wrong = |(pixel, class): &(usize, &SkyClass)| {
        let (column, row) = (pixel % prior.width as usize, pixel / prior.width as usize);
        let x = (column as f64 + 0.5 - pinhole.cx) / pinhole.fx;
        let y = (row as f64 + 0.5 - pinhole.cy) / pinhole.fy;
        let seen = lens.distort(x, y).0 * stored.fx + stored.cx;
        match class {
            SkyClass::Sky => seen > 30.5,
            SkyClass::Place => seen < 29.5,
            SkyClass::Unknown => false,
        }
    };
    assert_eq!(prior.sky.iter().enumerate().filter(is_wrong).count(), 0);
    assert!(prior.sky.contains(&SkyClass::Sky) && prior.sky.contains(&SkyClass::Place));
    let mut command = command_on_set(&desk, "-o out --sky sky --maps-of pinhole --overwrite");
    fails(&mut command, &["sky/00000.npy: the map is 120x80 px", "--maps-of photo"], &REMARKS);
}
