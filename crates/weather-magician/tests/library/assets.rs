//! Prepared assets on disk: they change no byte of any picture, whatever happens to their files.

use std::fs;
use std::path::Path;
use weather_magician::{Camera, FrameRequest, Picture, PlaceOptions, Renderer, Scene, Weather};
use wm_scene::SceneView;
use wm_street::{Street, dataset};

/// A coarse street with the cameras of its photos, so that surfaces are found in what those see.
fn street() -> Scene {
    let street = Street::builtin();
    let mut scene = street.sampling(0.06).scene(&|_| true).expect("nobody stops it");
    let options = dataset::DatasetOptions { count: 5, size: (96, 64), ..Default::default() };
    let cameras = dataset::cameras(&street, &options).unwrap();
    let view = |(i, camera)| SceneView { name: format!("{i}.png"), camera };
    scene.views = cameras.into_iter().enumerate().map(view).collect();
    scene
}

/// Pictures in rain and in lying snow, by a renderer of their own.
fn pictures(scene: &Scene, assets: Option<&Path>, metres_per_unit: f64) -> [Picture; 2] {
    let mut renderer = Renderer::cpu().unwrap();
    let facts = weather_magician::Metadata { metres_per_unit: Some(metres_per_unit), ..Default::default() };
    let options = PlaceOptions { facts, assets: assets.map(Into::into), ..PlaceOptions::default() };
    let mut place = renderer.load_with(scene.clone(), &options).unwrap();
    let camera = Camera::look_at([0.0, 4.0, 1.7], [0.0, 30.0, 2.0]).size(72, 48);
    ["rain.rate=40", "snow_cover.depth=0.1"].map(|change| {
        let mut weather = Weather::clear();
        weather.set_text(change).unwrap();
        renderer.render(&mut place, &FrameRequest::new(&weather, camera, 0.5)).unwrap()
    })
}

fn files(folder: &Path) -> Vec<std::path::PathBuf> {
    let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

#[test]
fn pictures_do_not_depend_on_what_is_on_disk() {
    let scene = street();
    let folder = tempfile::tempdir().unwrap();
    let assets = folder.path().join("street.assets");
    let same = |what: &str, pictures: &[Picture; 2], bare: &[Picture; 2]| {
        for (picture, bare) in pictures.iter().zip(bare) {
            assert!(picture.frame == bare.frame, "{what}");
        }
    };
    let bare = pictures(&scene, None, 1.0);
    assert!(bare[0].frame.rgb != bare[1].frame.rgb);
    same("made and kept", &pictures(&scene, Some(&assets), 1.0), &bare);
    let kept = files(&assets);
    let kinds = ["cover", "shelter", "surfaces"];
    let has =
        |kind: &&str| kept.iter().any(|path| path.file_name().unwrap().to_str().unwrap().starts_with(kind));
    assert!(kept.len() == 3 && kinds.iter().all(has), "{kept:?}");
    same("read", &pictures(&scene, Some(&assets), 1.0), &bare);

    // Another scale is another place: nothing of this one is taken for it.
    let doubled = pictures(&scene, None, 2.0);
    assert!(doubled[1].frame.rgb != bare[1].frame.rgb);
    same("another scale", &pictures(&scene, Some(&assets), 2.0), &doubled);
    same("after another scale", &pictures(&scene, Some(&assets), 1.0), &bare);

    // Of the three one is damaged, one is cut off, and one is whole.
    for turn in 0..3 {
        let spoilt = [&kept[turn], &kept[(turn + 1) % 3]];
        let [damaged, cut] = spoilt.map(|path| fs::read(path).unwrap());
        let mut bytes = damaged.clone();
        bytes[damaged.len() / 2] ^= 0x55;
        fs::write(spoilt[0], bytes).unwrap();
        fs::write(spoilt[1], &cut[..cut.len() / 2]).unwrap();
        same("damaged and cut off", &pictures(&scene, Some(&assets), 1.0), &bare);
        for (path, whole) in spoilt.iter().zip([damaged, cut]) {
            assert!(fs::read(path).unwrap().len() == whole.len(), "{} is made again", path.display());
        }
    }
    // Each kind in the place of the others, and none at all.
    let [first, second] = [&kept[0], &kept[1]].map(|path| fs::read(path).unwrap());
    fs::write(&kept[0], second).unwrap();
    fs::write(&kept[1], first).unwrap();
    same("swapped", &pictures(&scene, Some(&assets), 1.0), &bare);
    fs::remove_dir_all(&assets).unwrap();
    same("deleted", &pictures(&scene, Some(&assets), 1.0), &bare);
    // A folder that cannot be made: a file has its name.
    let taken = folder.path().join("taken");
    fs::write(&taken, "no folder").unwrap();
    same("no folder", &pictures(&scene, Some(&taken), 1.0), &bare);
}

/// Assets that another renderer made are found under the digest that it had, and not without it.
#[test]
fn assets_are_found_by_a_digest_that_is_given() {
    let folder = tempfile::tempdir().unwrap();
    let rain = Weather::preset("moderate-rain").unwrap();
    let mut renderer = Renderer::cpu().unwrap();
    let facts =
        |metres: f64| weather_magician::Metadata { metres_per_unit: Some(metres), ..Default::default() };
    let options = PlaceOptions { assets: Some(folder.path().into()), ..PlaceOptions::default() };
    let mut made = renderer.load_with(street(), &options).unwrap();
    renderer.prepare(&mut made, &rain, &mut ()).unwrap();
    let digest = made.asset_digest();
    assert!(digest.is_some_and(|digest| digest.to_string().parse() == Ok(digest)));
    // A place with another digest of its own, as arithmetic of other last digits gives.
    let other = PlaceOptions { facts: facts(1.0 + 1e-9), ..options };
    let mut lacking = |asset_digest| {
        let options = PlaceOptions { asset_digest, ..other.clone() };
        let mut place = renderer.load_with(street(), &options).unwrap();
        let mut missing = place.missing_assets(&rain, 0.0);
        assert!(!missing.is_empty());
        let names = place.asset_files(&rain, 0.0);
        assert!(names.iter().all(|name| folder.path().join(name).exists() == asset_digest.is_some()));
        renderer.asset_source(&mut place, &mut missing).unwrap();
        !missing.is_empty()
    };
    assert!(!lacking(digest));
    assert!(lacking(None));
}

#[test]
fn a_weather_that_was_prepared_needs_no_splats() {
    let mut renderer = Renderer::cpu().unwrap();
    let camera = Camera::look_at([0.0, 4.0, 1.7], [0.0, 30.0, 2.0]).size(48, 32);
    let weather = Weather::preset("rain-to-snow").unwrap();
    let mut place = renderer.load(street()).unwrap();
    let whole = renderer.render(&mut place, &FrameRequest::new(&weather, camera, 20.0)).unwrap();
    // The second time, assets of the first instants lie on the disk; the wind turns what falls
    // later.
    let folder = tempfile::tempdir().unwrap();
    let options = PlaceOptions { assets: Some(folder.path().into()), ..PlaceOptions::default() };
    let mut last = None;
    for round in 0..2 {
        let mut released = renderer.load_with(street(), &options).unwrap();
        renderer.prepare(&mut released, &weather, &mut ()).unwrap();
        released.release_splats();
        let times: &[f64] = if round == 0 { &[20.0] } else { &[9.0, 12.0, 16.0, 28.0] };
        for time in times {
            let alone = renderer.render(&mut released, &FrameRequest::new(&weather, camera, *time)).unwrap();
            assert!(*time != 20.0 || whole.frame == alone.frame);
        }
        last = Some(released);
    }
    let mut released = last.unwrap();
    // Snow lies on surfaces, and there are no splats left to find them in.
    let snowy = weather.set("snow_cover.depth", 0.1).unwrap();
    let error = renderer
        .render(&mut released, &FrameRequest::new(&snowy, camera, 20.0))
        .expect_err("no splats are left");
    assert!(error.to_string().contains("released"), "{error}");
}

/// Shadows of a sun that moves are cast without splats, and are those of each instant alone.
#[test]
fn a_moving_sun_needs_no_splats() {
    let mut renderer = Renderer::cpu().unwrap();
    let camera = Camera::look_at([0.0, 4.0, 1.7], [0.0, 30.0, 2.0]).size(48, 32);
    let mut weather = Weather::clear();
    for change in ["light.model=clear", "light.photos=diffuse", "light.sun_elevation=0:10,20:60"] {
        weather.set_text(change).unwrap();
    }
    let mut released = renderer.load(street()).unwrap();
    renderer.prepare(&mut released, &weather, &mut ()).unwrap();
    released.release_splats();
    let mut frames = [0.0, 8.0, 20.0].map(|time| {
        let mut place = renderer.load(street()).unwrap();
        let whole = renderer.render(&mut place, &FrameRequest::new(&weather, camera, time)).unwrap();
        let alone = renderer.render(&mut released, &FrameRequest::new(&weather, camera, time)).unwrap();
        assert!(whole.frame == alone.frame, "{time}");
        alone.frame
    });
    frames.rotate_left(1);
    assert!(frames[0] != frames[1] && frames[1] != frames[2]);
}

#[test]
fn places_belong_to_their_renderer() {
    let [mut first, mut second] = [Renderer::cpu().unwrap(), Renderer::cpu().unwrap()];
    let mut place = first.load(street()).unwrap();
    let camera = Camera::look_at([0.0, 4.0, 1.7], [0.0, 30.0, 2.0]).size(24, 16);
    let error = second.render(&mut place, &FrameRequest::new(&Weather::clear(), camera, 0.0)).unwrap_err();
    assert!(matches!(error, weather_magician::Error::OtherRenderer));
}
