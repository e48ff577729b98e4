//! Writes a [`Capture`] as a COLMAP model, binary or text.

use super::super::Capture;
use glam::{DQuat, DVec3};
use std::{fs, io::Write, path::Path};
use wm_base::{FormatError, Problem, files::write_atomically};
use wm_scene::camera::Distortion;

/// The encoding of the files of a model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColmapStorage {
    /// `.bin`.
    #[default]
    Binary,
    /// `.txt`.
    Text,
}

/// A point in the track of another.
type Track = Vec<(u32, u32)>;

/// Writes `cameras`, `images` and `points3D` to a folder, which is made if it is not there.
///
/// Images are numbered from 1 in the order of the views, points from 1 in theirs; an image has the
/// 2D points of its observations and no others. Coordinates are those of the world. Coordinates of
/// 2D points are rounded to f32, which is how they are kept.
///
/// # Errors
/// [`FormatError`] if a file cannot be written.
///
/// # Panics
/// If the lists of the capture are of unequal length or an observation is of no point.
pub fn write(capture: &Capture, folder: &Path, storage: ColmapStorage) -> Result<(), FormatError> {
    if capture.origin != DVec3::ZERO {
        let mut world = capture.clone();
        world.set_origin(DVec3::ZERO);
        return write(&world, folder, storage);
    }
    let (views, points) = (capture.views.len(), capture.points.len());
    assert_eq!(capture.observations.len(), views, "a list of observations a view");
    fs::create_dir_all(folder).map_err(|e| FormatError::whole(folder, Problem::Write(e.into())))?;
    let mut tracks: Vec<Track> = vec![Vec::new(); points];
    for (view, seen) in capture.observations.iter().enumerate() {
        for (index, observation) in seen.iter().enumerate() {
            tracks[observation.point as usize].push((view as u32 + 1, index as u32));
        }
    }
    let extension = match storage {
        ColmapStorage::Binary => "bin",
        ColmapStorage::Text => "txt",
    };
    let file = |name: &str| folder.join(format!("{name}.{extension}"));
    write_atomically(&file("cameras"), |out| cameras(out, capture, storage))?;
    write_atomically(&file("images"), |out| images(out, capture, storage))?;
    write_atomically(&file("points3D"), |out| points3d(out, capture, &tracks, storage))
}

fn cameras(out: &mut dyn Write, capture: &Capture, storage: ColmapStorage) -> Result<(), Problem> {
    let mut views: Vec<_> = capture.views.iter().collect();
    views.sort_by_key(|view| view.camera_id);
    views.dedup_by_key(|view| view.camera_id);
    match storage {
        ColmapStorage::Binary => out.write_all(&(views.len() as u64).to_le_bytes())?,
        ColmapStorage::Text => writeln!(out, "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]")?,
    }
    for view in views {
        let camera = &view.camera;
        let (fx, fy, cx, cy) = (camera.fx, camera.fy, camera.cx, camera.cy);
        let (model, name, parameters) = match view.distortion {
            Distortion::None => (1u32, "PINHOLE", vec![fx, fy, cx, cy]),
            Distortion::Radial { k1, k2 } if fx == fy => (3, "RADIAL", vec![fx, cx, cy, k1, k2]),
            lens => {
                let [k1, k2, p1, p2, k3] = lens.coefficients();
                let parameters = vec![fx, fy, cx, cy, k1, k2, p1, p2];
                match k3 {
                    0.0 => (4, "OPENCV", parameters),
                    // With k4, k5 and k6.
                    _ => (6, "FULL_OPENCV", [parameters, vec![k3, 0.0, 0.0, 0.0]].concat()),
                }
            }
        };
        match storage {
            ColmapStorage::Binary => {
                out.write_all(&view.camera_id.to_le_bytes())?;
                out.write_all(&model.to_le_bytes())?;
                out.write_all(&u64::from(camera.width).to_le_bytes())?;
                out.write_all(&u64::from(camera.height).to_le_bytes())?;
                parameters.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))?;
            }
            ColmapStorage::Text => {
                write!(out, "{} {name} {} {}", view.camera_id, camera.width, camera.height)?;
                parameters.iter().try_for_each(|v| write!(out, " {v}"))?;
                writeln!(out)?;
            }
        }
    }
    Ok(())
}

fn images(out: &mut dyn Write, capture: &Capture, storage: ColmapStorage) -> Result<(), Problem> {
    match storage {
        ColmapStorage::Binary => out.write_all(&(capture.views.len() as u64).to_le_bytes())?,
        ColmapStorage::Text => {
            writeln!(out, "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME")?;
            writeln!(out, "# POINTS2D[] as X, Y, POINT3D_ID")?;
        }
    }
    for (index, (view, seen)) in capture.views.iter().zip(&capture.observations).enumerate() {
        let quat = DQuat::from_mat3(&view.camera.rotation()).normalize();
        let [tx, ty, tz] = view.camera.viewmat.w_axis.truncate().to_array();
        let pose = [quat.w, quat.x, quat.y, quat.z, tx, ty, tz];
        let id = index as u32 + 1;
        match storage {
            ColmapStorage::Binary => {
                out.write_all(&id.to_le_bytes())?;
                pose.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))?;
                out.write_all(&view.camera_id.to_le_bytes())?;
                out.write_all(view.name.as_bytes())?;
                out.write_all(&[0])?;
                out.write_all(&(seen.len() as u64).to_le_bytes())?;
                for observation in seen {
                    observation.xy.iter().try_for_each(|v| out.write_all(&f64::from(*v).to_le_bytes()))?;
                    out.write_all(&(u64::from(observation.point) + 1).to_le_bytes())?;
                }
            }
            ColmapStorage::Text => {
                write!(out, "{id}")?;
                pose.iter().try_for_each(|v| write!(out, " {v}"))?;
                writeln!(out, " {} {}", view.camera_id, view.name)?;
                for (index, observation) in seen.iter().enumerate() {
                    let space = if index > 0 { " " } else { "" };
                    let [x, y] = observation.xy;
                    write!(out, "{space}{x} {y} {}", u64::from(observation.point) + 1)?;
                }
                writeln!(out)?;
            }
        }
    }
    Ok(())
}

fn points3d(
    out: &mut dyn Write,
    capture: &Capture,
    tracks: &[Track],
    storage: ColmapStorage,
) -> Result<(), Problem> {
    let points = &capture.points;
    match storage {
        ColmapStorage::Binary => out.write_all(&(points.len() as u64).to_le_bytes())?,
        ColmapStorage::Text => {
            writeln!(out, "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)")?;
        }
    }
    for (index, track) in tracks.iter().enumerate() {
        let id = index as u64 + 1;
        let (position, color) = (points.positions[index], points.colors[index]);
        // COLMAP's own sign for an error that is not known.
        let error = points.errors[index];
        let error = if error.is_nan() { -1.0 } else { f64::from(error) };
        match storage {
            ColmapStorage::Binary => {
                out.write_all(&id.to_le_bytes())?;
                position.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))?;
                out.write_all(&color)?;
                out.write_all(&error.to_le_bytes())?;
                out.write_all(&(track.len() as u64).to_le_bytes())?;
                for (image, place) in track {
                    out.write_all(&image.to_le_bytes())?;
                    out.write_all(&place.to_le_bytes())?;
                }
            }
            ColmapStorage::Text => {
                let ([x, y, z], [r, g, b]) = (position, color);
                write!(out, "{id} {x} {y} {z} {r} {g} {b} {error}")?;
                track.iter().try_for_each(|(image, place)| write!(out, " {image} {place}"))?;
                writeln!(out)?;
            }
        }
    }
    Ok(())
}
