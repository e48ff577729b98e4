//! `export-web`, by running the binary: the files of a site, what a page finds prepared, and what
//! is refused.
use crate::common::Workshop;
use glam::DVec3;
use serde_json::Value;
use std::fs;
use std::path::Path;
use weather_magician::{PlaceOptions, Renderer, Weather};
use wm_scene::formats::{ReadOptions, read_scene};
use wm_scene::splats::Splat;
use wm_scene::{Group, Metadata, Scene, Splats};

/// A folder with a scene `a.ply` in it, a floor and a wall of 1,200 splats, and a player that does
/// nothing; commands are `export-web a.ply` with the player and a small picture.
fn desk() -> Workshop {
    let mut splats = Splats::with_capacity(1200, 0);
    for i in 0..1200 {
        let (x, along) = ((i % 30) as f32 * 0.2 - 3.0, (i / 30 % 20) as f32 * 0.3);
        let mean = if i < 600 { [x, along - 3.0, 0.0] } else { [x, 3.0, along * 0.6] };
        splats.push(&Splat {
            mean,
            quat: [1.0, 0.0, 0.0, 0.0],
            log_scale: [-2.0, -2.0, if i < 600 { -4.0 } else { -2.0 }],
            logit_opacity: 3.0,
            rgb: [(i % 7) as f32 / 7.0, 0.5, 0.25],
            group: Group::Scene,
        });
    }
    let usual = "export-web a.ply --camera 0,-2.5,1.5:0,3,0.5 --size 48x32 --device cpu --player player";
    let desk = Workshop::with(usual, &["warning: "]);
    desk.scene("a", splats, &Metadata { ground: Some(0.0), ..Metadata::default() });
    desk.put_player();
    desk
}

fn site_file(site: &Path) -> Value {
    serde_json::from_slice(&fs::read(site.join("place/place.json")).unwrap()).unwrap()
}

#[test]
fn a_site_is_whole_and_its_weather_is_prepared() {
    let desk = desk();
    let told =
        desk.run("--weather moderate-rain --set rain.rate=8 --prepare snow-covered --time 2.5 --out site/");
    let first = told.lines().next().unwrap();
    assert!(first.starts_with("site/: ") && first.ends_with(", 1200 splats, moderate-rain"), "{told}");
    let site = desk.path("site");
    for name in ["index.html", "main.js", "style.css", "icon.svg", "player.js", "player_bg.wasm"] {
        assert!(site.join(name).is_file(), "{name}");
    }
    let index = fs::read_to_string(site.join("index.html")).unwrap();
    assert_eq!(index.matches("http-equiv=\"Content-Security-Policy\"").count(), 1);
    let is_jpeg = |path: &Path| fs::read(path).unwrap().starts_with(&[0xff, 0xd8, 0xff]);
    assert!(is_jpeg(&site.join("poster.jpg")));
    assert_eq!(site.join("video.mp4").is_file(), cfg!(feature = "h264"));

    let file = site_file(&site);
    assert_eq!(
        (&file["version"], &file["scene"], &file["name"]),
        (&1.into(), &"scene.sog".into(), &"a".into())
    );
    assert_eq!((&file["splats"], &file["memory"]), (&1200.into(), &Value::Null));
    assert_eq!(file["start"]["weather"]["rain"]["rate"], 8.0);
    assert_eq!((&file["start"]["time"], &file["start"]["size"][0]), (&2.5.into(), &48.into()));
    let thumbnails: Vec<&str> =
        file["thumbnails"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    assert!(thumbnails.contains(&"fog") && thumbnails.contains(&"snow-covered"), "{thumbnails:?}");
    assert!(thumbnails.iter().all(|name| is_jpeg(&site.join(format!("place/thumbnails/{name}.jpg")))));
    let files = file["files"].as_array().unwrap();
    for prepared in files {
        let bytes = fs::read(site.join("place").join(prepared["name"].as_str().unwrap())).unwrap();
        // They are packed.
        assert!(bytes.len() as u64 == prepared["bytes"] && bytes.starts_with(&[0x1f, 0x8b]), "{prepared}");
    }
    assert_eq!(files.len(), fs::read_dir(site.join("place/assets")).unwrap().count());

    // A page opens it as follows, and has nothing to make.
    let metadata: Metadata = serde_json::from_value(file["metadata"].clone()).unwrap();
    assert!(metadata.up.is_some_and(|up| up.dot(DVec3::Z) > 0.99) && metadata.ground == Some(0.0));
    let scene = read_scene(&site.join("place/scene.sog"), &ReadOptions::default()).unwrap();
    let scene = Scene { metadata, ..scene };
    let options = PlaceOptions { assets: Some(site.join("place/assets")), ..PlaceOptions::default() };
    let mut renderer = Renderer::cpu().unwrap();
    let mut place = renderer.load_with(scene, &options).unwrap();
    assert_eq!(place.asset_digest().map(|digest| digest.to_string()).as_deref(), file["digest"].as_str());
    let weather = wm_viewer::state::weather_of_json(&file["start"]["weather"]).unwrap();
    for weather in [weather, Weather::preset("snow-covered").unwrap()] {
        let names = place.asset_files(&weather, 2.5);
        assert!(names.len() > 1 && names.iter().all(|name| site.join("place/assets").join(name).exists()));
        let mut missing = place.missing_assets(&weather, 2.5);
        assert!(!missing.is_empty());
        let source = renderer.asset_source(&mut place, &mut missing).unwrap();
        // What lies is laid out for each instant.
        assert!(missing.is_empty() || missing.is_quick(), "{missing:?}");
        let made = missing.make(source, &mut ()).unwrap();
        renderer.insert_assets(&mut place, made).unwrap();
    }
}

#[test]
fn little_is_prepared_where_little_is_asked_for() {
    let desk = desk();
    let told = desk.run("--weather clear --prepare none --no-thumbnails --no-video --out site");
    let file = site_file(&desk.path("site"));
    assert_eq!(file["files"].as_array().unwrap().len(), 0, "{told}");
    assert!(told.contains("left to the browser: ") && told.contains("moderate-rain"));
    assert!(told.contains(", fog,") && !told.contains("clear,"), "{told}");
    // Other things stay in the folder, and what the new site lacks goes.
    desk.put("site/CNAME", "example.org");
    desk.put("site/place/old.wmasset", "");
    desk.run("--weather haze --prepare none --no-thumbnails --no-video --overwrite --out site");
    assert_eq!(site_file(&desk.path("site"))["start"]["weather"]["name"], "haze");
    assert!(desk.path("site/CNAME").exists() && !desk.path("site/place/old.wmasset").exists());
    // A budget of nothing leaves what the first weather needs.
    desk.run("--weather overcast --asset-megabytes 0 --no-thumbnails --no-video --overwrite --out site");
    let files = site_file(&desk.path("site"))["files"].clone();
    assert_eq!(files.as_array().unwrap().len(), 1, "{files}");
    assert!(files[0]["name"].as_str().unwrap().starts_with("assets/light-"), "{files}");
}

#[test]
fn what_cannot_be_written_is_told_in_a_line() {
    let desk = desk();
    desk.put("full/notes.txt", "mine");
    desk.put("broken/player.js", "");
    desk.put("broken/player_bg.wasm", "no module");
    desk.refused("--out full", &["full: holds other things than a site; name a new or an empty folder"]);
    desk.refused("--out a.ply", &["a.ply: is a file; name a folder"]);
    desk.refused("--out player/player.js", &["player.js: is a file; name a folder"]);
    desk.refused("--out no/such/site", &["no/such/site: ", "does not exist; create it first"]);
    desk.refused("--out site.html", &["site.html: a site is a folder; give --single-file"]);
    desk.refused("--single-file --out site", &["site: --single-file writes a .html file"]);
    desk.refused("--weather foggy", &["no weather `foggy`"]);
    desk.refused("--prepare fog,foggy", &["no weather `foggy`"]);
    desk.refused("--time inf", &["--time inf: give seconds"]);
    desk.refused("--assets here", &["--assets: a site has a folder of its own"]);
    desk.refused("--memory 3", &["is not a size of memory"]);
    let other = |words: &str, says: &[&str]| {
        desk.refused_by(&mut desk.program(words.split(' ')), says);
    };
    other("export-web a.ply --player broken", &["player_bg.wasm: is no WebAssembly module"]);
    other("export-web a.ply --player full", &["player.js: "]);
    other("export-web none.ply --player player", &["none.ply: "]);
    if !cfg!(feature = "web") {
        other("export-web a.ply", &["was built without the player", "give --player"]);
    }
    // A damaged scene leaves nothing behind.
    let whole = desk.read("a.ply");
    desk.put("cut.ply", &whole[..whole.len() / 2]);
    other("export-web cut.ply --player player --out site", &["cut.ply: "]);
}
