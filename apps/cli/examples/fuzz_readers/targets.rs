//! The readers that are fuzzed, one entry of [`TARGETS`] each, and the writers of their seeds.

use crate::outcome::{Outcome, SeedPath, done, put};
use crate::uses;
use base64::Engine;
use glam::DVec3;
use std::{error::Error, fs, hint::black_box, ops::ControlFlow, path::Path};
use weather_magician::batch::BatchPlan;
use weather_magician::panorama_file::read_panorama;
use weather_magician::rig::Rig;
use weather_magician::view::{ViewOptions, path::CameraPath};
use weather_magician::{Weather, reports};
use wm_base::npy;
use wm_capture::colmap::write::{ColmapStorage, write};
use wm_capture::logs::mini::MINI_LOGS;
use wm_capture::testing::taken_if;
use wm_capture::{self as capture, Capture, CaptureOptions, CaptureUp};
use wm_capture::{DrivingLog, LogCaptureOptions, LogOptions};
use wm_image::maps::read_map;
use wm_image::photo::read_photo;
use wm_image::{PictureSize, exr, jpeg, png};
use wm_scene::formats::{GltfSplats, ReadOptions, SpzVersion, WriteOptions, read_scene, write_scene_with};
use wm_scene::levels::{LevelFileJob, LevelWriteOptions, LevelWriter, NewLeaf};
use wm_scene::survey::{Survey, label_sky};
use wm_scene::synthetic::rippled;
use wm_scene::{Camera, Health, LensModel, Metadata, Scene, SceneView};

/// A reader that is fuzzed.
pub struct Target {
    /// The name of the target for `--only` and in messages.
    pub name: &'static str,
    /// Runs for one run of `--runs`.
    pub share: u64,
    /// Writers of seeds: each writes files into a folder and returns the path that is read.
    pub seeds: &'static [SeedWriter],
    /// Reads a path as the program does.
    pub read: fn(&Path) -> Outcome,
    /// Most that a run may take.
    pub budget: Budget,
}

/// Most that a run may take.
pub struct Budget {
    /// Processor time of a run, seconds.
    pub seconds: f64,
    /// Resident memory of the target's process, MiB.
    pub mebibytes: u64,
}

const READ_BUDGET: Budget = Budget { seconds: 2.0, mebibytes: 512 };
/// Overflow checks, which come with debug assertions here, make what is prepared for a weather
/// slower.
const USE_BUDGET: Budget =
    Budget { seconds: if cfg!(debug_assertions) { 15.0 } else { 5.0 }, mebibytes: 1024 };

/// Writes a seed into an empty folder, and returns the path that is read.
pub type SeedWriter = fn(&Path) -> SeedPath;

/// Runs of a scene format for each run of another reader.
const SCENE_SHARE: u64 = 10;

macro_rules! text_seed {
    ($name:literal) => {
        |folder| put(folder, $name, include_str!(concat!("seeds/", $name)))
    };
}

/// A capture of one file, and of the list of its photos.
macro_rules! capture_seed {
    ($main:literal $(, $list:literal)?) => {
        |folder| {
            fs::write(folder.join($main), include_str!(concat!("seeds/", $main)))?;
            $(fs::write(folder.join($list), include_str!(concat!("seeds/", $list)))?;)?
            fs::create_dir_all(folder.join("images"))?;
            for name in ["a.png", "b.png"] {
                fs::write(folder.join("images").join(name), small_png()?)?;
            }
            Ok(folder.to_path_buf())
        }
    };
}

const fn scene(name: &'static str, seeds: &'static [SeedWriter]) -> Target {
    Target { name, share: SCENE_SHARE, seeds, read: read_and_check, budget: READ_BUDGET }
}

const fn reader(
    name: &'static str,
    seeds: &'static [SeedWriter],
    read: fn(&Path) -> Result<(), String>,
) -> Target {
    Target { name, share: 1, seeds, read, budget: READ_BUDGET }
}

const fn user(name: &'static str, seeds: &'static [SeedWriter], read: fn(&Path) -> Outcome) -> Target {
    Target { name, share: 1, seeds, read, budget: USE_BUDGET }
}

/// Every target.
pub const TARGETS: &[Target] = &[
    scene(
        "ply",
        &[
            |folder| write_scene(folder, "a.ply", 2, WriteOptions::default()),
            ascii_ply,
            text_seed!("surfels.ply"),
            text_seed!("cloud.ply"),
            text_seed!("filtered.ply"),
        ],
    ),
    scene("compressed-ply", &[|folder| write_scene(folder, "a.compressed.ply", 1, WriteOptions::default())]),
    scene(
        "spz",
        &[
            |folder| write_scene(folder, "a.spz", 2, WriteOptions::default()),
            |folder| {
                write_scene(folder, "a.spz", 1, WriteOptions { spz: SpzVersion::V4, ..Default::default() })
            },
        ],
    ),
    scene("sog", &[|folder| write_scene(folder, "a.sog", 1, WriteOptions::default())]),
    scene("sog-folder", &[|folder| write_scene(folder, "meta.json", 1, WriteOptions::default())]),
    scene("levels", &[levels]),
    scene(
        "gltf",
        &[
            |folder| write_scene(folder, "a.glb", 1, WriteOptions::default()),
            |folder| {
                write_scene(folder, "a.glb", 0, WriteOptions { gltf: GltfSplats::Spz, ..Default::default() })
            },
            gltf_with_data_uri,
        ],
    ),
    scene("splat", &[|folder| write_scene(folder, "a.splat", 0, WriteOptions::default())]),
    scene("ksplat", &[|folder| write_scene(folder, "a.ksplat", 1, WriteOptions::default())]),
    reader("training", &[training], read_and_check),
    reader("metadata", &[metadata], read_as_inspect_does),
    reader("survey", &[ascii_ply, text_seed!("surfels.ply"), levels], read_as_inspect_does),
    reader("colmap", &[colmap_model::<false>, colmap_model::<true>], read_capture),
    reader(
        "captures",
        &[
            capture_seed!("transforms.json"),
            capture_seed!("reconstruction.json"),
            capture_seed!("bundle.out", "list.txt"),
        ],
        read_capture,
    ),
    reader("logs", &[log::<0>, log::<1>, log::<2>, log::<3>, log::<4>, log::<5>], read_log),
    reader("photos", &[photo_png, photo_jpeg], |path| {
        read_photo(path, &|width, height| match u64::from(width) * u64::from(height) {
            0..=1_000_000 => Ok(()),
            _ => Err("too large".into()),
        })
        .map_err(|error| error.to_string())?;
        done(wm_image::header::read_header(path))
    }),
    reader("maps", &[map_png, map_exr, map_npy, map_tiff], |path| done(read_map(path).map(|map| map.grey()))),
    reader("arrays", &[map_npy], |path| done(npy::read(path))),
    reader("panoramas", &[map_exr], |path| done(read_panorama(path))),
    reader(
        "camera-paths",
        &[text_seed!("path.json"), text_seed!("nerfstudio_path.json"), text_seed!("settings.json")],
        |path| {
            let survey = Survey::of(&Scene::default(), &Metadata::default());
            let camera_path = CameraPath::read(path, &survey, &ViewOptions::default());
            done(camera_path.map(|path| path.text(DVec3::ZERO)))
        },
    ),
    reader(
        "reports",
        &[
            text_seed!("metar.txt"),
            text_seed!("old_metar.txt"),
            text_seed!("hourly.json"),
            text_seed!("hourly.csv"),
            text_seed!("carla.txt"),
            text_seed!("words.txt"),
        ],
        read_report,
    ),
    reader("weather", &[text_seed!("weather.toml")], |path| done(Weather::read(path))),
    reader("plan", &[plan], |path| done(BatchPlan::read(path))),
    reader("rig", &[text_seed!("rig.toml")], |path| done(Rig::read(path))),
    reader("lens", &[text_seed!("lens.toml")], |path| done(LensModel::read(path))),
    reader("lidar", &[text_seed!("lidar.toml")], |path| {
        done(wm_sensors::LidarModel::parse(&text_of(path)?, "lidar"))
    }),
    reader("radar", &[text_seed!("radar.toml")], |path| {
        done(wm_sensors::radar::RadarModel::parse(&text_of(path)?, "radar"))
    }),
    reader("train-config", &[train_config], |path| done(wm_train::TrainConfig::read(path))),
    user(
        "use-scene",
        &[ascii_ply, metadata, |folder| write_scene(folder, "a.splat", 0, WriteOptions::default())],
        uses::render_scene,
    ),
    user("use-weather", &[text_seed!("weather.toml")], uses::render_weather),
    user(
        "use-camera-path",
        &[text_seed!("path.json"), text_seed!("nerfstudio_path.json"), text_seed!("settings.json")],
        uses::render_path,
    ),
    user("use-lens", &[text_seed!("lens.toml")], uses::render_lens),
    user("use-lidar", &[text_seed!("lidar.toml")], uses::scan),
    user("use-links", &[uses::link_seed::<0>, uses::link_seed::<1>, uses::link_seed::<2>], uses::open_link),
    user(
        "use-states",
        &[text_seed!("state.json"), text_seed!("state_path.json"), text_seed!("state_lidar.json")],
        uses::open_state,
    ),
    user("use-evaluate", &[uses::evaluation_seed], uses::evaluate_scene),
    user("use-training", &[uses::training_seed], uses::resume_training),
    user("use-assets", &[uses::assets_seed], uses::render_assets),
    user("use-edges", &[uses::edges_seed], uses::render_edges),
];

fn text_of(path: &Path) -> Result<String, String> {
    fs::read_to_string(path).map_err(|error| error.to_string())
}

/// Reads a scene and looks for faults.
fn read_and_check(path: &Path) -> Result<(), String> {
    let scene = read_scene(path, &ReadOptions::default()).map_err(|error| error.to_string())?;
    black_box(Health::of(&scene.splats));
    done(scene.check_finite())
}

/// Reads a scene, looks for faults, and surveys what is left without them: some milliseconds.
fn read_as_inspect_does(path: &Path) -> Result<(), String> {
    let is_valid = read_and_check(path);
    let scene = read_scene(path, &ReadOptions::default()).map_err(|error| error.to_string())?;
    let (mut scene, _) = scene.repaired();
    label_sky(&mut scene.splats);
    black_box(Survey::of(&scene, &Metadata::default()).lines());
    is_valid
}

fn read_capture(path: &Path) -> Result<(), String> {
    let capture = capture::read(path, &CaptureOptions::default()).map_err(|error| error.to_string())?;
    let cameras: Vec<Camera> = capture.views.iter().map(|view| view.camera).collect();
    black_box(CaptureUp::of(&cameras, None));
    for view in &capture.views {
        black_box(view.undistorted());
        if let Some(point) = capture.points.positions.first() {
            black_box(view.project(DVec3::from_array(*point)));
        }
    }
    Ok(())
}

fn read_log(path: &Path) -> Result<(), String> {
    let log = DrivingLog::open(path, &LogOptions::default()).map_err(|error| error.to_string())?;
    let Some(log) = log else { return Err("no log".into()) };
    for sweep in &log.sweeps {
        sweep.points().map_err(|error| error.to_string())?;
    }
    let folder =
        tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).map_err(|e| e.to_string())?;
    let options = LogCaptureOptions { depth_pixels: 1200, ..LogCaptureOptions::default() };
    let written =
        log.write_capture(&folder.path().join("capture"), &options, &mut |_| ControlFlow::Continue(()));
    done(written)
}

/// Reads a report; a weather that was read must be equal to that of its own file.
fn read_report(path: &Path) -> Result<(), String> {
    let options = reports::ReportOptions { place: Some([47.0, 8.0]), ..Default::default() };
    let report = reports::WeatherReport::read_file(path, &options).map_err(|error| error.to_string())?;
    let again = Weather::parse(report.to_toml(), "again").map_err(|error| format!("own file: {error}"))?;
    assert_eq!(&again, report.weather(), "the weather's own file is another weather");
    Ok(())
}

fn write_scene(folder: &Path, name: &str, degree: u8, options: WriteOptions) -> SeedPath {
    let path = folder.join(name);
    let scene = Scene { splats: rippled(12, degree), ..Scene::default() }.up([0.0, 0.0, 1.0]);
    write_scene_with(&path, &scene, &options)?;
    Ok(path)
}

/// A glTF whose buffer is in its text.
fn gltf_with_data_uri(folder: &Path) -> SeedPath {
    let packed = write_scene(folder, "a.glb", 1, WriteOptions::default())?;
    let glb = fs::read(&packed)?;
    fs::remove_file(packed)?;
    // 12 bytes of header, then two chunks: length, type and content.
    let length = u32::from_le_bytes(glb[12..16].try_into()?) as usize;
    let mut json: serde_json::Value = serde_json::from_slice(&glb[20..20 + length])?;
    let buffer = base64::engine::general_purpose::STANDARD.encode(&glb[20 + length + 8..]);
    json["buffers"][0]["uri"] = format!("data:application/octet-stream;base64,{buffer}").into();
    put(folder, "a.gltf", json.to_string())
}

/// A scene of four splats as a text.
fn ascii_ply(folder: &Path) -> SeedPath {
    let splats = rippled(4, 0);
    let mut text =
        format!("ply\nformat ascii 1.0\ncomment wm.ground -0.5\nelement vertex {}\n", splats.len());
    for name in
        "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split(' ')
    {
        text += &format!("property float {name}\n");
    }
    text += "end_header\n";
    for index in 0..splats.len() {
        let [x, y, z] = splats.means[index];
        let [a, b, c] = splats.log_scales[index];
        let [p, q, r, s] = splats.quats[index];
        let opacity = splats.logit_opacities[index];
        text += &format!("{x} {y} {z} 0.5 0.25 -0.5 {opacity} {a} {b} {c} {p} {q} {r} {s}\n");
    }
    put(folder, "text.ply", text)
}

fn levels(folder: &Path) -> SeedPath {
    let main = folder.join("lod-meta.json");
    let mut writer = LevelWriter::create(&main, LevelWriteOptions::default())?;
    let leaf = NewLeaf { levels: vec![rippled(12, 1), rippled(6, 1)], errors: vec![0.0, 0.1] };
    let mut jobs = writer.add(leaf)?;
    let mut end = writer.finish(Some(rippled(4, 0)), &Metadata::default())?;
    jobs.append(&mut end.jobs);
    jobs.into_iter().try_for_each(LevelFileJob::write)?;
    end.write_index()?;
    Ok(main)
}

/// The folder of a 3DGS training, with cameras.
fn training(folder: &Path) -> SeedPath {
    let splats = folder.join("point_cloud/iteration_7");
    fs::create_dir_all(&splats)?;
    write_scene(&splats, "point_cloud.ply", 0, WriteOptions::default())?;
    let camera = Camera::posed((60, 40), 50.0, DVec3::new(0.0, -5.0, 1.0), glam::DMat3::IDENTITY);
    let views = [SceneView { name: "a.jpg".into(), camera }, SceneView { name: "b.jpg".into(), camera }];
    wm_scene::formats::folder::write_cameras(&folder.join("cameras.json"), &views)?;
    Ok(folder.to_path_buf())
}

/// A scene with a file of metadata beside it.
fn metadata(folder: &Path) -> SeedPath {
    let path = write_scene(folder, "a.ply", 0, WriteOptions::default())?;
    fs::write(folder.join("a.ply.wm.toml"), include_str!("seeds/metadata.wm.toml"))?;
    Ok(path)
}

fn colmap_model<const IS_TEXT: bool>(folder: &Path) -> SeedPath {
    let camera = |x: f64| Camera::posed((60, 40), 50.0, DVec3::new(x, 0.0, 0.0), glam::DMat3::IDENTITY);
    let points: Vec<DVec3> =
        (0..8).map(|i| DVec3::new(f64::from(i % 3) - 1.0, f64::from(i % 2), 5.0 + f64::from(i))).collect();
    let cameras: Vec<Camera> = (0..3).map(|i| camera(f64::from(i) * 0.3)).collect();
    let capture: Capture = taken_if(&cameras, &points, glam::DQuat::IDENTITY, 1.0, |_, _| true);
    let model = folder.join("sparse/0");
    fs::create_dir_all(&model)?;
    fs::create_dir_all(folder.join("images"))?;
    let storage = if IS_TEXT { ColmapStorage::Text } else { ColmapStorage::Binary };
    write(&capture, &model, storage)?;
    for index in 0..3 {
        fs::write(folder.join(format!("images/{index:03}.jpg")), small_jpeg()?)?;
    }
    Ok(folder.to_path_buf())
}

fn log<const KIND: usize>(folder: &Path) -> SeedPath {
    Ok(MINI_LOGS[KIND].1(folder)?.path)
}

fn gradient() -> Vec<u8> {
    (0..16 * 12 * 3).map(|i| (i * 7 % 256) as u8).collect()
}

fn small_png() -> Result<Vec<u8>, Box<dyn Error + Send + Sync>> {
    Ok(png::encode_rgb8(&gradient(), PictureSize::new(16, 12))?)
}

/// A JPEG with an EXIF block: orientation, time and a place.
fn small_jpeg() -> Result<Vec<u8>, Box<dyn Error + Send + Sync>> {
    let jpeg = jpeg::encode(&gradient(), (16, 12), 90, jpeg::SamplingFactor::R_4_2_0)?;
    let exif = exif_block();
    let mut bytes = vec![0xff, 0xd8, 0xff, 0xe1];
    bytes.extend((exif.len() as u16 + 8).to_be_bytes());
    bytes.extend(b"Exif\0\0");
    bytes.extend(exif);
    bytes.extend(&jpeg[2..]);
    Ok(bytes)
}

/// A TIFF header, one directory with the orientation, and one each for the photo and its place.
fn exif_block() -> Vec<u8> {
    fn entry(out: &mut Vec<u8>, tag: u16, kind: u16, count: u32, value: u32) {
        out.extend(tag.to_le_bytes());
        out.extend(kind.to_le_bytes());
        out.extend(count.to_le_bytes());
        out.extend(value.to_le_bytes());
    }
    let mut out = b"II\x2a\0\x08\0\0\0\x03\0".to_vec();
    entry(&mut out, 0x0112, 3, 1, 6);
    entry(&mut out, 0x8769, 4, 1, 50);
    entry(&mut out, 0x8825, 4, 1, 68);
    out.extend([0; 4]);
    // At 50: the time of the photo. At 68: latitude and longitude.
    out.extend([1, 0]);
    entry(&mut out, 0x9003, 2, 20, 122);
    out.extend([0; 4]);
    out.extend([4, 0]);
    entry(&mut out, 1, 2, 2, u32::from(b'N'));
    entry(&mut out, 2, 5, 3, 142);
    entry(&mut out, 3, 2, 2, u32::from(b'E'));
    entry(&mut out, 4, 5, 3, 142);
    out.extend([0; 4]);
    out.extend(b"2024:05:30 08:56:09\0");
    out.extend([47u32, 1, 22, 1, 30, 1].map(u32::to_le_bytes).as_flattened());
    out
}

fn photo_png(folder: &Path) -> SeedPath {
    put(folder, "a.png", small_png()?)
}

fn photo_jpeg(folder: &Path) -> SeedPath {
    put(folder, "a.jpg", small_jpeg()?)
}

fn ramp() -> Vec<f32> {
    (0..16 * 8).map(|i| 0.5 + i as f32).collect()
}

fn map_png(folder: &Path) -> SeedPath {
    let path = folder.join("a.png");
    png::write_depth(&path, &ramp(), PictureSize::new(16, 8), png::DepthScale::reaching(200.0), &[])?;
    Ok(path)
}

fn map_exr(folder: &Path) -> SeedPath {
    let path = folder.join("a.exr");
    let (depth, rgb) = (ramp(), ramp().repeat(3));
    let planes =
        exr::ExrPlanes { depth: Some(&depth), rgb: Some(&rgb), alpha: None, normals: None, channels: &[] };
    exr::write_exr(&path, planes, PictureSize::new(16, 8), &[])?;
    Ok(path)
}

fn map_npy(folder: &Path) -> SeedPath {
    let path = folder.join("a.npy");
    npy::write(&path, &ramp(), &[8, 16])?;
    Ok(path)
}

fn map_tiff(folder: &Path) -> SeedPath {
    let path = folder.join("a.tif");
    let mut file = fs::File::create(&path)?;
    tiff::encoder::TiffEncoder::new(&mut file)?.write_image::<tiff::encoder::colortype::Gray32Float>(
        16,
        8,
        &ramp(),
    )?;
    Ok(path)
}

/// A plan, and the scene that it names.
fn plan(folder: &Path) -> SeedPath {
    write_scene(folder, "street.ply", 0, WriteOptions::default())?;
    put(folder, "plan.toml", include_str!("seeds/plan.toml"))
}

fn train_config(folder: &Path) -> SeedPath {
    let config = wm_train::TrainConfig::preset(wm_train::Preset::Draft);
    put(folder, "config.json", serde_json::to_string_pretty(&config)?)
}
