//! `truth.json`: what a pipeline must find out about a capture.

use super::settings::{CaptureKind, CaptureSettings};
use super::shots::Shot;
use crate::air::Air;
use crate::dataset::GroundTruth;
use crate::{Label, Place, exposed, sky};
use glam::DVec3;
use serde_json::{Value, json};
use std::path::Path;
use wm_base::FormatError;
use wm_base::calendar::date_and_time;
use wm_base::files::write_atomically;
use wm_scene::Gps;
use wm_scene::similarity::Similarity;

/// The file with the truth.
pub const TRUTH: &str = "truth.json";

/// A photo that was taken: its facts for `truth.json`.
pub(crate) struct TakenPhoto {
    pub(super) name: String,
    pub(super) shot: Shot,
    /// Exposure against the others, EV.
    pub(super) exposure: f64,
    /// Motion of the picture while it was exposed, px.
    pub(super) blur: glam::DVec2,
    pub(super) gps: Gps,
    /// Share of the pixels that show movers.
    pub(super) moving: f64,
}

/// Writes `truth.json`.
pub(super) fn write(
    place: &Place,
    folder: &Path,
    settings: &CaptureSettings,
    model_from_world: &Similarity,
    taken: &[TakenPhoto],
) -> Result<(), FormatError> {
    let text = serde_json::to_string_pretty(&truth(place, settings, model_from_world, taken));
    let text = text.map_err(|e| FormatError::value(folder, e.to_string()))?;
    write_atomically(&folder.join(TRUTH), |out| Ok(out.write_all(text.as_bytes())?))
}

fn truth(place: &Place, settings: &CaptureSettings, model: &Similarity, taken: &[TakenPhoto]) -> Value {
    let flaws = &settings.flaws;
    let up = model.rotation * DVec3::Z;
    let labels: serde_json::Map<String, Value> = std::iter::once(("sky".to_owned(), json!(0)))
        .chain(
            Label::ALL.iter().enumerate().map(|(index, label)| (label.name().to_owned(), json!(index + 1))),
        )
        .collect();
    let rows = [0, 1, 2].map(|row| model.rotation.row(row).to_array());
    let haze = settings.air(place).map(|air| {
        json!({
            "mor": air.mor,
            "airlight_linear": exposed(air.airlight.to_array()),
            "upper_end": Air::HAZE_TOP_M,
        })
    });
    json!({
        "place": place.name(),
        "seed": settings.seed,
        "capture": settings.kind.name(),
        "axes": "world: metres, x east, y north, z up; model: those of sparse/0",
        "model_from_world": {
            "scale": model.scale,
            "rotation_rows": rows,
            "translation": model.translation.to_array(),
        },
        "metres_per_unit": 1.0 / model.scale,
        "up": up.to_array(),
        // Height above the model's origin along up, model units.
        "ground": up.dot(model.translation),
        "north": (model.rotation * DVec3::Y).to_array(),
        "sun": {
            "direction": (model.rotation * sky::sun()).to_array(),
            "azimuth_degrees": sky::sun().x.atan2(sky::sun().y).to_degrees(),
            "elevation_degrees": sky::sun().z.asin().to_degrees(),
        },
        "world_origin": position(&place.sights.home),
        "weather": { "haze": haze, "rain_mm_h": flaws.rain, "snow_mm_h": flaws.snow },
        "tone_curve": flaws.tone.name(),
        "exif_lies": flaws.exif.iter().map(|lie| format!("{lie:?}").to_lowercase()).collect::<Vec<_>>(),
        "labels": labels,
        "maps": maps(settings),
        "photos": taken.iter().map(|photo| facts(place, photo)).collect::<Vec<_>>(),
    })
}

fn maps(settings: &CaptureSettings) -> Value {
    if settings.truth == GroundTruth::Omit {
        return Value::Null;
    }
    let movers = (settings.kind == CaptureKind::Drive).then_some("truth/movers");
    json!({
        "depth": "truth/depth",
        "normal": "truth/normal",
        "sky": "truth/sky",
        "label": "truth/label",
        "clean": "truth/clean",
        "movers": movers,
    })
}

fn facts(place: &Place, photo: &TakenPhoto) -> Value {
    let eye = photo.shot.camera.center();
    let [year, month, day, hour, minute, second] =
        date_and_time(sky::SUN_TIME_S + photo.shot.time.round() as i64);
    let forward = photo.shot.camera.forward();
    json!({
        "name": photo.name,
        "time_utc": format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z"),
        "eye_world": eye.to_array(),
        "height_above_ground": place.ground_height(eye.x, eye.y).map(|ground| eye.z - ground),
        "pitch_degrees": forward.z.asin().to_degrees(),
        "heading_degrees": forward.x.atan2(forward.y).to_degrees().rem_euclid(360.0),
        "position": position(&place.sights.home.moved(eye)),
        "position_measured": position(&photo.gps),
        "exposure_ev": photo.exposure,
        "blur_px": photo.blur.length(),
        "moving_share": photo.moving,
    })
}

fn position(gps: &Gps) -> Value {
    json!({ "latitude": gps.latitude, "longitude": gps.longitude, "altitude": gps.altitude })
}
