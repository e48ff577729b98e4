//! Captures as people bring them home: flights, walks and drives through a built-in place, and the
//! truth beside them.
//!
//! The model is what structure from motion gives: cameras and points in arbitrary axes and an
//! arbitrary unit, points where there is texture, noise and some mismatches. Photos carry EXIF with
//! the time and a noisy position. What is wrong with them is chosen by [`CaptureFlaws`].
//!
//! ```text
//! made-up.txt                  what it is
//! images/00000.png ...         photos with EXIF
//! sparse/0/                    cameras, poses and points in the model's axes
//! truth.json                   the model's axes, unit and ground, the weather, and the facts of each photo
//! truth/depth/00000.npy ...    view z of the first surface at each pixel's centre, m; 0 in the sky
//! truth/normal/00000.npy ...   its normal, world axes (east, north, up), towards the camera; 0 in the sky
//! truth/sky/00000.npy ...      1 in the sky, else 0
//! truth/label/00000.npy ...    0 in the sky, else a number that truth.json explains
//! truth/movers/00000.npy ...   the share of the pixel that shows what passes by, 0-1 (drives)
//! truth/clean/00000.png ...    the photo without movers, weather and flaws
//! ```
//! Depth, normals and the rest are those of the photo's moment, movers included. Everything is a
//! function of the place, the settings and the seed, and the same for any number of threads.
//!
//! A pipeline that is tested on metres with z up is not tested, so captures get no axes for free:
//! the model is turned, scaled and moved at random. The truth lies beside the capture, never in it.

mod exif;
mod fall;
mod flaws;
mod points;
mod settings;
mod shots;
mod truth;

pub use flaws::{CaptureFlaws, ExifFault, ToneCurve};
pub use settings::{CaptureKind, CaptureSettings};
pub use truth::TRUTH;
use truth::TakenPhoto;

use crate::build::movers;
use crate::dataset::{GroundTruth, files};
use crate::light_map::Budget;
use crate::photo::RaySettings;
use crate::{Label, Place};
use fall::Fall;
use glam::{DMat3, DQuat, DVec3};
use shots::Shot;
use std::borrow::Cow;
use std::path::Path;
use wm_base::FormatError;
use wm_base::random::RandomStream;
use wm_capture::colmap::write as colmap;
use wm_capture::{Capture, CaptureView};
use wm_scene::camera::Distortion;
use wm_scene::similarity::Similarity;
use wm_scene::{Camera, Gps};

/// The text of the file that says what the folder holds.
const MARK_TEXT: &str = "Photos of a built-in place of Weather-Magician, ray-cast, as a real capture leaves them: the model's axes and\n\
    unit are arbitrary. truth.json says what they are; truth/, where it is, holds exact maps of each photo.\n";
/// Rays for the light of a pixel with a single ray, and of each ray of several: the noise that
/// remains is about that of a sensor.
const SINGLE_RAY_BUDGET: Budget = Budget { sun: 1, sky: 3 };
const SAMPLE_BUDGET: Budget = Budget { sun: 1, sky: 1 };

/// Purposes of random numbers.
const AXES_LANE: u64 = 41;
const GPS_LANE: u64 = 42;
const FALL_LANE: u64 = 43;

/// Writes a capture to a folder, which is created if needed, and returns it as it is read from
/// there.
///
/// `progress` receives the number of finished photos and returns false to stop; then the result is
/// `None`. Rows are cast on all threads.
///
/// # Errors
/// [`FormatError`] if a file cannot be written or the size makes no camera.
pub fn write(
    place: &Place,
    folder: &Path,
    settings: &CaptureSettings,
    progress: &mut dyn FnMut(usize) -> bool,
) -> Result<Option<Capture>, FormatError> {
    let fault = |what: String| FormatError::value(folder, what);
    settings.flaws.check().map_err(fault)?;
    let shots = shots::shots(place, settings).map_err(|e| fault(e.to_string()))?;
    let truth = (settings.truth == GroundTruth::Write).then(|| maps(settings));
    let images = crate::dataset::prepare(folder, MARK_TEXT, truth.into_iter().flatten())?;
    let model_from_world = axes(settings.seed);
    let (mut taken, mut masks) = (Vec::new(), Vec::new());
    for (index, shot) in shots.into_iter().enumerate() {
        let (photo, mask) = take(place, folder, settings, index, shot)?;
        taken.push(photo);
        masks.push(mask);
        if !progress(index + 1) {
            return Ok(None);
        }
    }
    let cameras: Vec<Camera> = taken.iter().map(|photo| photo.shot.camera).collect();
    let (mut points, observations) = points::points(place, &cameras, &masks, settings);
    for position in &mut points.positions {
        *position = model_from_world.point(DVec3::from_array(*position)).to_array();
    }
    let view = |photo: &TakenPhoto| {
        let camera = model_from_world.camera(&photo.shot.camera);
        CaptureView::new(&photo.name, camera, Distortion::None, 1)
    };
    let (source, views) = (folder.into(), taken.iter().map(view).collect());
    let capture = Capture { source, images, views, points, observations, ..Capture::default() };
    colmap::write(&capture, &folder.join("sparse/0"), settings.storage)?;
    truth::write(place, folder, settings, &model_from_world, &taken)?;
    Ok(Some(capture))
}

/// The folders of the maps that a capture has.
fn maps(settings: &CaptureSettings) -> impl Iterator<Item = &'static str> {
    let movers = (settings.kind == CaptureKind::Drive).then_some("movers");
    ["depth", "normal", "sky", "label", "clean"].into_iter().chain(movers)
}

/// The model's axes: any rotation, a unit of 0.2 to 20 m, an origin somewhere.
fn axes(seed: u64) -> Similarity {
    let random = RandomStream::new(seed, AXES_LANE, 0);
    let ([x, y, z], [w, ..]) = (random.normal3(0), random.normal3(1));
    let shift = DVec3::from_array(random.normal3(2)) * 10.0;
    let scale = (0.05f64).powf(random.uniform(40)) * 5.0;
    let turn = DQuat::from_xyzw(x, y, z, w).normalize();
    Similarity { scale, rotation: DMat3::from_quat(turn), translation: shift }
}

/// Takes photo `index` and writes it with its maps; gives its facts and, for each pixel, whether a
/// mover hides the place there.
fn take(
    place: &Place,
    folder: &Path,
    settings: &CaptureSettings,
    index: usize,
    shot: Shot,
) -> Result<(TakenPhoto, Vec<bool>), FormatError> {
    let camera = shot.camera;
    let scene = match settings.kind {
        CaptureKind::Drive => {
            let ground = |at: glam::DVec2| place.above(at, 0.0);
            let at = camera.center().truncate();
            Cow::Owned(place.with_movers(|b| movers::traffic(b, at, shot.time, &ground, settings.seed)))
        }
        _ => Cow::Borrowed(place),
    };
    let air = settings.air(place);
    let samples = settings.samples.max(1);
    let casting = RaySettings { samples, budget: SAMPLE_BUDGET, plain: SINGLE_RAY_BUDGET, air };
    let pixels = scene.picture(&camera, &casting);
    let mut light: Vec<DVec3> = pixels.iter().map(|pixel| DVec3::from_array(pixel.radiance)).collect();
    for (fall, rate) in [(Fall::Rain, settings.flaws.rain), (Fall::Snow, settings.flaws.snow)] {
        if let Some(rate) = rate {
            let random = RandomStream::new(settings.seed, FALL_LANE + fall as u64, index as u32);
            let depth: Vec<f64> = pixels.iter().map(|pixel| pixel.depth).collect();
            fall.draw(&mut light, &camera, &depth, rate, place.horizon(), random);
        }
    }
    let size = (camera.width as usize, camera.height as usize);
    let blur = shot.shake + settings.flaws.motion(settings.seed, index);
    let light = flaws::moved(&light, size.0, size.1, blur);
    let exposure = settings.flaws.exposure(settings.seed, index);
    let rgb = flaws::developed(&light, exposure, settings.flaws.tone);

    let stem = format!("{index:05}");
    let name = format!("{stem}.png");
    let gps = position(place, settings, index, &camera);
    let facts = exif::facts(place, settings, index, &shot, gps);
    let photo = folder.join("images").join(&name);
    files::write_png(&photo, settings.size, &rgb, Some(&facts.to_bytes()))?;
    if settings.truth == GroundTruth::Write {
        let folder = folder.join("truth");
        files::write_maps(&folder, &stem, &camera, &pixels)?;
        let numbers = pixels.iter().map(|pixel| pixel.label.map_or(0.0, number));
        files::write_map(&folder, "label", &stem, &camera, numbers)?;
        if settings.kind == CaptureKind::Drive {
            let shares = pixels.iter().map(|pixel| pixel.moving as f32);
            files::write_map(&folder, "movers", &stem, &camera, shares)?;
        }
        let is_clean = settings.kind != CaptureKind::Drive && casting.air.is_none();
        let clean = if is_clean {
            pixels.clone()
        } else {
            place.picture(&camera, &RaySettings { air: None, ..casting })
        };
        let light: Vec<DVec3> = clean.iter().map(|pixel| DVec3::from_array(pixel.radiance)).collect();
        let rgb = flaws::developed(&light, 0.0, ToneCurve::Standard);
        files::write_png(&folder.join("clean").join(&name), settings.size, &rgb, None)?;
    }
    let moving = pixels.iter().map(|pixel| pixel.moving).sum::<f64>() / pixels.len() as f64;
    let mask = pixels.iter().map(|pixel| pixel.moving > 0.0).collect();
    Ok((TakenPhoto { name, shot, exposure, blur, gps, moving }, mask))
}

/// The number of a label in files.
fn number(label: Label) -> f32 {
    Label::ALL.iter().position(|other| *other == label).map_or(0.0, |place| place as f32 + 1.0)
}

/// The position that a receiver measures.
fn position(place: &Place, settings: &CaptureSettings, index: usize, camera: &Camera) -> Gps {
    let (level, high) = settings.kind.gps_noise();
    let random = RandomStream::new(settings.seed, GPS_LANE, 0);
    let [x, y, z] = random.normal3(index as u64 + 1);
    let [offset, ..] = random.normal3(0);
    let noise = DVec3::new(x * level, y * level, offset * high + 0.15 * z * high);
    place.sights.home.moved(camera.center() + noise)
}

#[cfg(test)]
mod tests;
