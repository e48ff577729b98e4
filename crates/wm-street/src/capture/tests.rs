//! Small captures against their truth.

use super::*;
use crate::air::Air;
use crate::tests::street;
use crate::{Park, PhotoPixel, sky};
use glam::DVec2;
use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::sync::OnceLock;
use tempfile::{TempDir, tempdir};
use wm_base::npy;
use wm_capture::{CaptureOptions, CaptureSite, gps, read};
use wm_image::header::{self, PhotoHeader, read_header};
use wm_scene::survey::Survey;
use wm_scene::{Metadata, Scene};

fn park() -> &'static Place {
    static PARK: OnceLock<Place> = OnceLock::new();
    PARK.get_or_init(Park::builtin)
}

fn small(kind: CaptureKind, count: u32) -> CaptureSettings {
    CaptureSettings { count, size: (48, 32), samples: 1, points: 120, ..CaptureSettings::new(kind) }
}

/// A capture and its folder.
fn capture_in_folder(place: &Place, settings: &CaptureSettings) -> (TempDir, Capture) {
    let folder = tempdir().unwrap();
    let capture = write(place, folder.path(), settings, &mut |_| true).unwrap().unwrap();
    (folder, capture)
}

/// The headers of the files of the photos.
fn headers(capture: &Capture) -> Vec<PhotoHeader> {
    (0..capture.views.len()).map(|view| read_header(&capture.photo(view).unwrap()).unwrap()).collect()
}

fn json(folder: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(folder.join(TRUTH)).unwrap()).unwrap()
}

fn vector(value: &serde_json::Value) -> DVec3 {
    DVec3::from_slice(&value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect::<Vec<_>>())
}

/// The similarity that `truth.json` states.
fn stated(truth: &serde_json::Value) -> Similarity {
    let model = &truth["model_from_world"];
    let rows = [0, 1, 2].map(|row| vector(&model["rotation_rows"][row]));
    Similarity {
        scale: model["scale"].as_f64().unwrap(),
        rotation: DMat3::from_cols(rows[0], rows[1], rows[2]).transpose(),
        translation: vector(&model["translation"]),
    }
}

/// Every pixel of every photo, put back into the place by the exported cameras and the stated axes,
/// is where the place has a surface of that label, or sky.
#[test]
fn exported_cameras_and_maps_agree_with_the_place() {
    for (place, kind) in [
        (park(), CaptureKind::Nadir),
        (park(), CaptureKind::Oblique),
        (park(), CaptureKind::Walk),
        (street(), CaptureKind::Walk),
    ] {
        let (folder, _) = capture_in_folder(place, &small(kind, 3));
        let capture = read(folder.path(), &CaptureOptions::default()).unwrap();
        capture.check_trainable().unwrap();
        let truth = json(folder.path());
        let model_from_world = stated(&truth);
        assert!((truth["metres_per_unit"].as_f64().unwrap() * model_from_world.scale - 1.0).abs() < 1e-9);
        assert!((vector(&truth["up"]) - model_from_world.rotation * DVec3::Z).length() < 1e-9);
        for (index, view) in capture.views.iter().enumerate() {
            let map = |kind: &str| {
                npy::read(&folder.path().join(format!("truth/{kind}/{index:05}.npy"))).unwrap().0
            };
            let (depth, label, sky) = (map("depth"), map("label"), map("sky"));
            let eye = vector(&truth["photos"][index]["eye_world"]);
            assert!((model_from_world.point(eye) - view.camera.center()).length() < 1e-6);
            for pixel in (0..depth.len()).step_by(7) {
                let (x, y) = (f64::from((pixel % 48) as u32) + 0.5, f64::from((pixel / 48) as u32) + 0.5);
                // The rays of the exported camera, turned back into the world.
                let direction = model_from_world.rotation.transpose() * view.camera.ray(x, y);
                let surface = place.first(eye, direction);
                assert_eq!(surface.is_none(), sky[pixel] == 1.0);
                assert_eq!(surface.map_or(0.0, |surface| number(surface.label)), label[pixel]);
                let Some(surface) = surface else { continue };
                let z = surface.t
                    * (model_from_world.rotation.transpose() * view.camera.forward()).dot(direction);
                assert!((z / f64::from(depth[pixel]) - 1.0).abs() < 1e-3, "{z} {}", depth[pixel]);
                if surface.label.is_ground() && surface.normal.z > 0.5 {
                    let point = eye + direction * surface.t;
                    let ground = place.ground_height(point.x, point.y).unwrap();
                    assert!((ground - point.z).abs() < 1e-6, "{ground} {point}");
                }
            }
        }
    }
}

#[test]
fn positions_in_exif_fit_the_cameras_through_the_stated_axes() {
    let (folder, capture) = capture_in_folder(park(), &small(CaptureKind::Nadir, 12));
    let truth = json(folder.path());
    let places: Vec<_> = headers(&capture).iter().map(|header| header.gps).collect();
    for (index, gps) in places.iter().enumerate() {
        let at = gps.unwrap().enu_from(&park().sights.home);
        let eye = vector(&truth["photos"][index]["eye_world"]);
        // Noise of 1 m along each axis, and 2 m of altitude that all share.
        assert!((at - eye).truncate().length() < 4.5 && (at - eye).z.abs() < 8.0, "{at} {eye}");
    }
    let centers: Vec<DVec3> = capture.views.iter().map(|view| view.camera.center()).collect();
    let scale = gps::fit(&centers, &places).unwrap();
    let ratio = scale.metres_per_unit / truth["metres_per_unit"].as_f64().unwrap();
    assert!((ratio - 1.0).abs() < 0.08, "{ratio}");
}

/// The survey of a small flight over the park with these lies of EXIF, by what its photos state
/// alone, and its truth.
fn surveyed(exif: Vec<ExifFault>) -> (Metadata, Survey, serde_json::Value) {
    let flaws = CaptureFlaws { exif, ..CaptureFlaws::default() };
    let settings = CaptureSettings { flaws, size: (12, 8), points: 1, ..small(CaptureKind::Nadir, 24) };
    let (folder, capture) = capture_in_folder(park(), &settings);
    let headers = headers(&capture);
    let places: Vec<_> = headers.iter().map(|header| header.gps).collect();
    let times: Vec<_> = headers.iter().map(|header| header.taken).collect();
    let centers: Vec<DVec3> = capture.views.iter().map(|view| view.camera.center()).collect();
    let mut metadata = Metadata::default();
    if let Some(fit) = gps::fit(&centers, &places) {
        metadata.up = Some(fit.up);
        CaptureSite::of(&centers, &places, &times, fit.up).note(&mut metadata);
    }
    let scene = Scene { metadata: metadata.clone(), ..Scene::default() };
    (metadata, Survey::of(&scene, &Metadata::default()), json(folder.path()))
}

#[test]
fn a_flight_over_the_park_knows_its_sun() {
    let (metadata, survey, truth) = surveyed(vec![]);
    let north = metadata.north.unwrap().angle_between(vector(&truth["north"])).to_degrees();
    assert!(north < 1.5, "{north}");
    let home = park().sights.home;
    let [latitude, longitude] = metadata.location.unwrap();
    assert!((latitude - home.latitude).abs() < 0.002 && (longitude - home.longitude).abs() < 0.003);
    let late = metadata.captured.unwrap() - sky::SUN_TIME_S as f64;
    assert!((0.0..120.0).contains(&late), "{late}");
    let sun = survey.sun.unwrap();
    let off = sun.direction.angle_between(vector(&truth["sun"]["direction"])).to_degrees();
    assert!(off < 1.5, "{off} {north}");
    let stated = |key: &str| truth["sun"][key].as_f64().unwrap();
    assert!((sun.elevation.to_degrees() - stated("elevation_degrees")).abs() < 0.7);
    assert!((sun.azimuth.unwrap().to_degrees() - stated("azimuth_degrees")).abs() < 0.7);
    assert!(sun.source.starts_with("from the time and the GPS of 24 photos"), "{}", sun.source);
}

#[test]
fn lies_of_exif_give_no_sun() {
    let (unset, survey, _) = surveyed(vec![ExifFault::Time]);
    assert!(unset.captured.is_none() && unset.north.is_some() && survey.sun.is_none());
    let (nowhere, survey, _) = surveyed(vec![ExifFault::Zero, ExifFault::Nonsense]);
    assert_eq!((nowhere.north, nowhere.location, survey.sun), (None, None, None));
    let (mixed, survey, _) = surveyed(vec![ExifFault::Continent, ExifFault::Nonsense]);
    assert_eq!((mixed.north, mixed.location, mixed.captured, survey.sun), (None, None, None, None));
    // All photos in Australia agree with each other, but the sun was down there.
    let (_, survey, _) = surveyed(vec![ExifFault::Continent]);
    assert!(survey.sun.is_none() && survey.sun_fault.is_some());
}

#[test]
fn times_of_exif_come_back() {
    let settings = CaptureSettings { points: 1, size: (6, 4), ..small(CaptureKind::Walk, 3) };
    let (folder, capture) = capture_in_folder(park(), &settings);
    let truth = json(folder.path());
    for (view, header) in headers(&capture).iter().enumerate() {
        let taken = header.taken.unwrap();
        let [year, month, day, hour, minute, second] = wm_base::calendar::date_and_time(taken as i64);
        let text = format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z");
        assert_eq!(truth["photos"][view]["time_utc"], text);
    }
    // Without GPS the camera's clock and its offset say the same.
    let bytes = |time, gps| exif::ExifFacts { maker: "a", model: "b", time, focal: 35.0, gps }.to_bytes();
    let read = |block: Vec<u8>| {
        let head = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0\x04\xb0\0\0\x03\x77\x08\x02\0\0\0CRC_";
        let length = (block.len() as u32).to_be_bytes();
        let whole = [&head[..], &length, b"eXIf", &block, b"CRC_\0\0\0\x09IDAT"].concat();
        header::parse(&mut std::io::Cursor::new(whole)).unwrap().taken
    };
    for time in [sky::SUN_TIME_S, 951_782_399, 951_782_400, 4_102_444_799] {
        assert_eq!(read(bytes(time, None)), Some(time as f64));
        assert_eq!(read(bytes(time, Some(park().sights.home))), Some(time as f64));
    }
    for time in [0, 315_964_800, 4_102_444_800] {
        assert_eq!(read(bytes(time, None)), None);
    }
}

#[test]
fn lies_of_exif_are_told() {
    let gps = |exif: Vec<ExifFault>| {
        let flaws = CaptureFlaws { exif, ..CaptureFlaws::default() };
        let settings = CaptureSettings { flaws, points: 1, size: (6, 4), ..small(CaptureKind::Nadir, 3) };
        let (_folder, capture) = capture_in_folder(park(), &settings);
        let headers = headers(&capture);
        [0, 1, 2].map(|view| headers[view].gps.and_then(Gps::checked))
    };
    assert_eq!(gps(vec![ExifFault::Zero, ExifFault::Nonsense]), [None; 3]);
    let [far, zero, _] = gps(vec![ExifFault::Continent, ExifFault::Zero, ExifFault::Focal]);
    assert!(far.is_some_and(|gps| gps.latitude < -30.0) && zero.is_none());
}

/// Contrast against the airlight decays by Beer and Lambert's law: to 5 % at the MOR.
#[test]
fn haze_takes_contrast_by_the_distance() {
    let camera = park().views()[1].camera((48, 32)).unwrap();
    let clear = RaySettings { samples: 1, budget: SINGLE_RAY_BUDGET, plain: SINGLE_RAY_BUDGET, air: None };
    for mor in [60.0, 300.0] {
        let air = Air { mor, airlight: park().horizon() };
        let hazy = RaySettings { air: Some(air), ..clear };
        let [before, after] = [clear, hazy].map(|casting| park().picture(&camera, &casting));
        for (x, y) in [(4u32, 30u32), (20, 20), (24, 16), (40, 25), (30, 12), (10, 2)] {
            let index = (y * 48 + x) as usize;
            let (before, after) = (&before[index], &after[index]);
            let direction = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let distance = before.depth / direction.dot(camera.forward());
            let contrast = |pixel: &PhotoPixel| DVec3::from_array(pixel.radiance) - air.airlight;
            if before.is_sky {
                assert!(contrast(after).length() <= contrast(before).length());
                continue;
            }
            let left = 0.05f64.powf(distance / mor);
            assert!((contrast(after) - contrast(before) * left).length() < 1e-9, "{distance}");
        }
    }
}

/// Every file of a folder by its path.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(&next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                found.insert(path.strip_prefix(folder).unwrap().to_path_buf(), fs::read(&path).unwrap());
            }
        }
    }
    found
}

#[test]
fn threads_change_no_byte_and_seeds_do() {
    let flaws = CaptureFlaws {
        blur: 2.0,
        exposure_jitter: 1.0,
        tone: ToneCurve::Hard,
        exif: vec![ExifFault::Nonsense],
        rain: Some(20.0),
        snow: Some(2.0),
        haze: Some(200.0),
        few: Some(3),
    };
    let settings = CaptureSettings { size: (30, 20), points: 40, flaws, ..small(CaptureKind::Drive, 7) };
    let bytes = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let settings = CaptureSettings { seed, ..settings.clone() };
        let (folder, _) = pool.install(|| capture_in_folder(street(), &settings));
        files(folder.path())
    };
    let one = bytes(1, 1);
    assert_eq!(one.keys().filter(|path| path.starts_with("images")).count(), 3);
    assert!(one == bytes(2, 1));
    assert!(one[Path::new(TRUTH)] != bytes(2, 2)[Path::new(TRUTH)]);
}

#[test]
fn movers_are_in_their_masks_and_nowhere_else() {
    let (folder, _) = capture_in_folder(street(), &small(CaptureKind::Drive, 6));
    let mut largest = 0.0f64;
    for index in 0..6 {
        let read =
            |kind: &str| npy::read(&folder.path().join(format!("truth/{kind}/{index:05}.npy"))).unwrap().0;
        let (movers, label) = (read("movers"), read("label"));
        // One ray a pixel: what its middle shows is all that it shows.
        assert!(
            movers
                .iter()
                .zip(&label)
                .all(|(share, label)| (*share > 0.0) == (*label == number(Label::Mover)))
        );
        largest = largest.max(f64::from(movers.iter().sum::<f32>()) / movers.len() as f64);
    }
    assert!((0.03..0.4).contains(&largest), "{largest}");
}

#[test]
fn flaws_that_cannot_be_are_one_line() {
    let said = |flaws: CaptureFlaws| flaws.check().unwrap_err();
    let usual = CaptureFlaws::default;
    assert_eq!(said(CaptureFlaws { blur: -1.0, ..usual() }), "blur -1 px: must be 0 to 50");
    assert_eq!(said(CaptureFlaws { haze: Some(1.0), ..usual() }), "haze 1 m: must be 10 to 100000");
    assert_eq!(said(CaptureFlaws { rain: Some(f64::NAN), ..usual() }), "rain NaN mm/h: must be 0.1 to 200");
    assert_eq!(said(CaptureFlaws { few: Some(2), ..usual() }), "few 2: must be 3 and above");
    assert_eq!(usual().check(), Ok(()));
}

#[test]
fn blur_keeps_light_and_reaches_as_far_as_it_says() {
    let (width, height) = (31, 21);
    let mut light = vec![DVec3::ZERO; width * height];
    light[10 * width + 15] = DVec3::ONE;
    let after = flaws::moved(&light, width, height, DVec2::new(8.0, 0.0));
    assert!((after.iter().map(|light| light.x).sum::<f64>() - 1.0).abs() < 1e-9);
    assert!(
        after[10 * width + 12].x > 0.05 && after[10 * width + 20].x == 0.0 && after[9 * width + 15].x == 0.0
    );
}

/// The time in EXIF is one at which the sun stands where the shadows say, to half a degree
/// (low-precision formulas of the Astronomical Almanac).
#[test]
fn the_sun_stands_there_at_that_time() {
    let days = sky::SUN_TIME_S as f64 / 86_400.0 + 2_440_587.5 - 2_451_545.0;
    for home in [street().sights.home, park().sights.home] {
        let anomaly = (357.528 + 0.985_600_3 * days).to_radians();
        let longitude =
            (280.460 + 0.985_647_4 * days + 1.915 * anomaly.sin() + 0.020 * (2.0 * anomaly).sin())
                .to_radians();
        let obliquity = 23.439f64.to_radians();
        let ascension = (obliquity.cos() * longitude.sin()).atan2(longitude.cos());
        let declination = (obliquity.sin() * longitude.sin()).asin();
        let sidereal = (18.697_374_558 + 24.065_709_824_419_08 * days).rem_euclid(24.0) * 15.0;
        let hour = (sidereal + home.longitude).to_radians() - ascension;
        let latitude = home.latitude.to_radians();
        let sun = DVec3::new(
            -hour.sin() * declination.cos(),
            declination.sin() * latitude.cos() - declination.cos() * hour.cos() * latitude.sin(),
            latitude.sin() * declination.sin() + latitude.cos() * declination.cos() * hour.cos(),
        );
        assert!(sun.angle_between(sky::sun()).to_degrees() < 0.5, "{sun}");
    }
}
