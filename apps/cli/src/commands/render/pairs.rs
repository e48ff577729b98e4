//! Data sets: every photo's view with and without a weather, and the maps that relate the two.

use super::args::RenderArgs;
use super::manifest::{self, CompletedFolder, StyledPicture};
use crate::choices::first_given;
use crate::names::stem_of;
use crate::output::make_folder;
use crate::progress::Reporter;
use crate::scene::{OpenScene, print_warnings};
use anyhow::{Result, bail};
use serde_json::{Map, Value as Json, json};
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use weather_magician::output::{PictureFormat, PictureStyle};
use weather_magician::view::spec;
use weather_magician::{
    Camera, FrameRequest, Layers, MovingCamera, Picture, PictureLayer, PictureSize, Weather, picture_tags,
};
use wm_scene::SceneView;
use wm_weather::{Fidelity, ParamValue};

/// The file that describes the pictures of the folder.
const MANIFEST: &str = "manifest.json";
/// The folders and the format of their files, in the order of writing.
const FOLDERS: [(&str, PictureFormat); 5] = [
    ("clean", PictureFormat::Png),
    ("weather", PictureFormat::Png),
    ("depth", PictureFormat::Npy),
    ("transmittance", PictureFormat::Npy),
    ("particles", PictureFormat::Png),
];

/// The camera of one photo.
struct PhotoView {
    /// The photo's name.
    photo: String,
    /// The name for output files, without folders outside of this one and, mostly, without
    /// extension.
    name: String,
    camera: Camera,
}

impl PhotoView {
    /// Returns the path of a file of a kind, below the folder.
    fn file(&self, kind: &str, format: PictureFormat) -> String {
        format!("{kind}/{}.{}", self.name, format.extension())
    }
}

/// The layers of a pair.
const LAYERS: Layers =
    Layers::COLOR.with(Layers::CLEAR).with(Layers::DEPTH).with(Layers::PARTICLES).with(Layers::TRANSMITTANCE);

/// Runs `render --pairs`.
pub(crate) fn run(args: &RenderArgs, weather: &Weather) -> Result<()> {
    let folder = check(args, weather)?;
    args.levels.refuse_for("--pairs")?;
    let mut loaded =
        OpenScene::with_sky(&args.scene, &args.run, args.camera.viewpoint.views.as_ref(), args.sky)?;
    let shots = shots(&mut loaded, args)?;
    args.output.set_drawing(&mut loaded.place);
    let manifest = about(&loaded, &shots, args, weather)?;
    manifest::keep(&folder, MANIFEST, &manifest, "pictures of another run")?;
    let weather = &match shots.first() {
        Some(shot) => loaded.place.weather_of_shot(weather, &shot.camera),
        None => weather.clone(),
    };
    loaded.prepare(weather)?;
    let OpenScene { mut renderer, mut place } = loaded;

    let is_there = |index: u32| {
        let shot = &shots[index as usize];
        FOLDERS.iter().all(|(kind, format)| folder.join(shot.file(kind, *format)).exists())
    };
    let (time, clear) = (args.output.time(), Weather::clear());
    let scene = args.scene.scene.display().to_string();
    let mut render = |index: u32, pair: &mut StyledPicture<[PictureStyle; 2]>| {
        let camera = shots[index as usize].camera;
        pair.style = [&clear, weather].map(|weather| PictureStyle {
            dither: args.output.dither,
            tags: picture_tags(&scene, place.site(), renderer.backend(), weather, time, &camera),
            ..PictureStyle::default()
        });
        let speed = args.camera.camera_speed.unwrap_or(0.0);
        let moving = MovingCamera { camera, velocity: (camera.forward() * speed).to_array() };
        let request = FrameRequest { layers: LAYERS, ..FrameRequest::new(weather, moving, time) };
        renderer.render_into(&mut place, &request, &mut pair.picture, &mut Reporter::default())?;
        Ok(())
    };
    let mut write = |index: u32, pair: &StyledPicture<[PictureStyle; 2]>| {
        write_pair(&folder, &shots[index as usize], &pair.style, &pair.picture)
    };
    let wanted: Vec<u32> = (0..shots.len() as u32).collect();
    let completed = manifest::complete(&folder, "photos", &wanted, is_there, &mut render, &mut write);
    print_warnings(&mut place);
    let CompletedFolder { written, kept, seconds } = completed?;
    println!(
        "{}: {written} photos written, {kept} kept, {}, {:.1} s ({})",
        folder.display(),
        weather.name,
        seconds,
        renderer.describe()
    );
    Ok(())
}

/// Checks the options that do not depend on the scene; returns the folder.
fn check(args: &RenderArgs, weather: &Weather) -> Result<PathBuf> {
    let (camera, output) = (&args.camera, &args.output);
    let refused = first_given([
        (camera.viewpoint.camera.is_some(), "--camera"),
        (camera.path.is_some(), "--path"),
        (camera.save_path.is_some(), "--save-path"),
        (output.seconds.is_some(), "--seconds"),
        (output.asks_for_frames(), "--frames and --frame-step"),
        (!output.also.is_empty(), "--also"),
        (output.layers, "--layers"),
    ]);
    if let Some(option) = refused {
        bail!("--pairs makes the same pictures of every photo at one instant: leave out {option}");
    }
    camera.check()?;
    output.check_times()?;
    if weather.effects().next().is_none() {
        bail!("--pairs needs a weather: give --weather or --set");
    }
    if weather.fidelity == Fidelity::Paper {
        bail!("--pairs: {NO_AIR}");
    }
    let name = format!("{}-{}", stem_of(&args.scene.scene), weather.name);
    output.folder(name, "--pairs writes many files and needs one")
}

/// The reason why the paper's fidelity has no parts.
pub(crate) const NO_AIR: &str =
    "the paper's fog acts on finished pixels and has no transmittance; use --set fidelity=physical";

/// Returns the photos' cameras with unique names.
fn shots(loaded: &mut OpenScene, args: &RenderArgs) -> Result<Vec<PhotoView>> {
    let views = &loaded.place.scene().views;
    if views.is_empty() {
        bail!(
            "{}: the scene has no views of photos; name the folder of their COLMAP model with --views",
            args.scene.scene.display()
        );
    }
    let options = args.camera.viewpoint.options();
    let named = names(views)?.into_iter().zip(views);
    named
        .map(|(name, view)| {
            let camera = spec::of_view(view, loaded.place.survey(), &options)?;
            Ok(PhotoView { photo: view.name.clone(), name, camera })
        })
        .collect()
}

/// Returns the file names: those of the photos without extension, or with it if two photos differ
/// only there.
fn names(views: &[SceneView]) -> Result<Vec<String>> {
    let whole = |view: &SceneView| -> String {
        // Names come from foreign files and may point outside of the folder.
        let parts = Path::new(&view.name).components().filter_map(|part| match part {
            Component::Normal(part) => part.to_str(),
            _ => None,
        });
        parts.collect::<Vec<_>>().join("/")
    };
    let short = |view: &SceneView| -> String {
        let whole = whole(view);
        match whole.rsplit_once('.') {
            Some((stem, extension))
                if !stem.is_empty() && !stem.ends_with('/') && !extension.contains('/') =>
            {
                stem.to_owned()
            }
            _ => whole,
        }
    };
    let mut counts: BTreeMap<String, u32> = BTreeMap::new();
    views.iter().for_each(|view| *counts.entry(short(view)).or_default() += 1);
    let mut names: Vec<String> =
        views.iter().map(|view| if counts[&short(view)] > 1 { whole(view) } else { short(view) }).collect();
    // What is left of one name may be the whole of another.
    if names.iter().collect::<std::collections::BTreeSet<_>>().len() < names.len() {
        names = views.iter().map(whole).collect();
    }
    let mut seen = std::collections::BTreeSet::new();
    for (view, name) in views.iter().zip(&names) {
        if name.is_empty() || !seen.insert(name) {
            bail!("the photo \"{}\" has no name of its own: rename it in the scene's views", view.name);
        }
    }
    Ok(names)
}

fn write_pair(folder: &Path, shot: &PhotoView, styles: &[PictureStyle; 2], picture: &Picture) -> Result<()> {
    let [clear, style] = styles;
    let size = PictureSize::new(shot.camera.width, shot.camera.height);
    let paths = FOLDERS.map(|(kind, format)| folder.join(shot.file(kind, format)));
    for path in &paths {
        let parent = path.parent().unwrap_or(folder);
        make_folder(parent)?;
    }
    let [clean, weather, depth, transmittance, particles] = paths;
    wm_image::png::write_rgb(&clean, &picture.clear, size, clear.dither, &clear.tags)?;
    style.write(picture, &weather)?;
    style.write_layer(PictureLayer::Depth, PictureFormat::Npy, picture, &depth)?;
    style.write_layer(PictureLayer::Transmittance, PictureFormat::Npy, picture, &transmittance)?;
    style.write_layer(PictureLayer::Particles, PictureFormat::Png, picture, &particles)?;
    Ok(())
}

/// Returns the manifest: what the pictures are, and everything that they depend on except the
/// scene's bytes.
fn about(loaded: &OpenScene, shots: &[PhotoView], args: &RenderArgs, weather: &Weather) -> Result<Json> {
    let OpenScene { renderer, place } = loaded;
    let instant = weather.at(args.output.time());
    let effects: Map<String, Json> = instant
        .effects()
        .map(|(effect, values)| {
            let values = effect.params.iter().zip(values);
            let entry = |param: &wm_weather::Param, value: &ParamValue| match param.unit {
                "" => json!({ "value": number(value) }),
                unit => json!({ "value": number(value), "unit": unit }),
            };
            let values: Map<String, Json> =
                values.map(|(param, value)| (param.name.to_owned(), entry(param, value))).collect();
            (effect.name.to_owned(), Json::Object(values))
        })
        .collect();
    let seeds: Map<String, Json> = effects
        .iter()
        .filter_map(|(name, values)| Some((name.clone(), values.get("seed")?.get("value")?.clone())))
        .collect();
    let photos: Vec<Json> = shots
        .iter()
        .map(|shot| {
            let Camera { width, height, fx, fy, cx, cy, viewmat, near } = shot.camera;
            let files: Map<String, Json> = FOLDERS
                .iter()
                .map(|(kind, format)| ((*kind).to_owned(), shot.file(kind, *format).into()))
                .collect();
            json!({
                "photo": shot.photo,
                "width": width, "height": height,
                "fx": fx, "fy": fy, "cx": cx, "cy": cy, "near": near,
                "camera_from_world": viewmat.transpose().to_cols_array_2d(),
                "center": shot.camera.center().to_array(),
                "files": files,
            })
        })
        .collect();
    Ok(json!({
        "program": concat!("weather-magician ", env!("CARGO_PKG_VERSION")),
        "scene": manifest::scene_facts(&args.scene.scene, place.site())?,
        "weather": {
            "name": weather.name,
            "about": weather.about,
            "fidelity": weather.fidelity.name(),
            "effects": effects,
        },
        "seeds": seeds,
        "time": args.output.time(),
        "camera_speed": args.camera.camera_speed.unwrap_or(0.0),
        "simd": renderer.backend().path().to_string(),
        "device": renderer.backend().arithmetic(),
        "drawing": manifest::drawing_facts(place, LAYERS),
        "dither": format!("{:?}", args.output.dither),
        "units": {
            "time": "s",
            "camera_speed": "m/s, ahead",
            "clean": "8 bits, sRGB: without any weather",
            "weather": "8 bits, sRGB",
            "depth": "[H, W] f32, metres along the view axis, 0 where nothing is",
            "transmittance": "[H, W, 3] f32, 0-1: share of the scene's linear light that the air lets through, R G B",
            "particles": "8 bits, 255 = whole: share of the pixel that falling drops and flakes hide",
            "camera_from_world": "rows of a 4x4 matrix, scene units, OpenCV axes: x right, y down, z forward",
            "intrinsics": "px, pinhole without distortion, the centre of the first pixel at 0.5, 0.5",
            "metres_per_unit": "m a scene unit",
            "airlight": "linear RGB",
        },
        "photos": photos,
    }))
}

/// A value for JSON, which has no infinite numbers.
fn number(value: &ParamValue) -> Json {
    match value {
        ParamValue::Number(number) if number.is_finite() => json!(number),
        other => Json::String(other.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn named(all: &[&str]) -> Result<Vec<String>> {
        let camera = Camera::looking((4, 3), 50.0, DVec3::ZERO, DVec3::X, DVec3::Z).unwrap();
        let views: Vec<SceneView> =
            all.iter().map(|name| SceneView { name: (*name).to_owned(), camera }).collect();
        names(&views)
    }

    #[test]
    fn files_are_named_after_photos_and_stay_in_the_folder() {
        let got = named(&["a.jpg", "b.c.png", "left/a.jpg", ".hidden", "../../d.jpg", "/e.jpg"]).unwrap();
        assert_eq!(got, ["a", "b.c", "left/a", ".hidden", "d", "e"]);
        assert_eq!(named(&["a.jpg", "a.png", "c"]).unwrap(), ["a.jpg", "a.png", "c"]);
        for bad in [&["a.jpg", "../a.jpg"][..], &[".."], &["a.b.c", "a.b", "a.c"]] {
            let fault = named(bad).is_err();
            assert_eq!(fault, bad.len() < 3, "{bad:?}");
        }
    }
}
