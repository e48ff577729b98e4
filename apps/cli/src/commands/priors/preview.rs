//! Preview pictures of priors.

use super::args::PriorsArgs;
use crate::dataset::Dataset;
use crate::output::write_sheet;
use anyhow::Result;
use glam::DVec3;
use std::fs;
use std::path::Path;
use weather_magician::train::photos::Photo;
use weather_magician::train::priors::{Prior, Priors, SkyClass};
use weather_magician::{Camera, PictureSize};
use wm_base::{FormatError, Problem};
use wm_image::{color::Dither, ramps};

/// Photos on the sheet.
const PHOTO_COUNT: usize = 6;
/// Number of pixels of a picture on the sheet, and of one beside the maps.
const SHEET_PICTURE_PIXELS: usize = 60_000;
const MAP_PICTURE_PIXELS: usize = 300_000;
/// Disparities above this quantile all get the nearest colour, so that outliers do not compress the
/// rest.
const NEAREST_QUANTILE: f64 = 0.98;
const SKY_TINT: [f32; 3] = [0.1, 0.5, 1.0];
const UNKNOWN_TINT: [f32; 3] = [1.0, 0.75, 0.1];

/// Writes `preview.png`, and a picture of each photo if requested.
pub(crate) fn write(args: &PriorsArgs, data: &Dataset) -> Result<()> {
    let folder = args.out();
    let Some(priors) = Priors::open(&folder)? else { return Ok(()) };
    let with: Vec<usize> = data
        .places
        .iter()
        .copied()
        .filter(|place| priors.index().photos.contains_key(data.name(*place)))
        .collect();
    let mut panels = Vec::new();
    let mut size = None;
    let count = PHOTO_COUNT.min(with.len());
    for index in 0..count {
        // From the first to the last.
        let place = with[index * (with.len() - 1) / (count - 1).max(1)];
        let Some((photo, prior)) = read_photo_and_prior(args, data, &priors, place)? else { continue };
        let size = *size.get_or_insert_with(|| fitting(&photo.camera, SHEET_PICTURE_PIXELS));
        panels.extend(views(data.name(place), &photo, &prior, size));
    }
    if let Some(size) = size {
        draw(&folder.join("preview.png"), &panels, size, 4)?;
    }
    if !args.preview {
        return Ok(());
    }
    for place in with {
        let Some((photo, prior)) = read_photo_and_prior(args, data, &priors, place)? else { continue };
        let size = fitting(&photo.camera, MAP_PICTURE_PIXELS);
        let path = folder.join("preview").join(format!("{}.png", data.name(place).replace(['/', '\\'], "_")));
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(|e| FormatError::whole(parent, Problem::Write(e.into())))?;
        }
        draw(&path, &views(data.name(place), &photo, &prior, size), size, 2)?;
    }
    Ok(())
}

/// Reads a photo and its prior; `None` for a damaged photo that may be skipped.
fn read_photo_and_prior(
    args: &PriorsArgs,
    data: &Dataset,
    priors: &Priors,
    place: usize,
) -> Result<Option<(std::sync::Arc<Photo>, std::sync::Arc<Prior>)>> {
    let photo = match data.photos.get(place, 0) {
        Ok(photo) => photo,
        Err(_) if args.photos.set.skip_bad => return Ok(None),
        Err(error) => return Err(error.into()),
    };
    Ok(priors.get(data.name(place), &photo.camera)?.map(|prior| (photo, prior)))
}

fn fitting(camera: &Camera, pixels: usize) -> PictureSize {
    let (width, height) =
        weather_magician::train::priors::files::size_within(camera.width, camera.height, pixels);
    PictureSize::new(width, height)
}

fn draw(path: &Path, panels: &[(Vec<f32>, String)], size: PictureSize, columns: u32) -> Result<()> {
    let tags = [("what".to_owned(), "photo, disparity, normals, sky".to_owned())];
    write_sheet(path, panels, size, columns, Dither::Off, &tags).map(drop)
}

/// Returns the photo, disparity, normals and sky, with labels.
fn views(name: &str, photo: &Photo, prior: &Prior, size: PictureSize) -> [(Vec<f32>, String); 4] {
    let camera = &photo.camera;
    let unknown = ramps::UNKNOWN_COLOR.map(|v| f32::from(v) / 255.0);
    let mut known: Vec<f32> = prior.disparity.iter().copied().filter(|v| *v > 0.0).collect();
    known.sort_by(f32::total_cmp);
    let near =
        known.get((known.len().saturating_sub(1) as f64 * NEAREST_QUANTILE) as usize).copied().unwrap_or(1.0);
    let disparity = |at: usize| match prior.disparity.get(at) {
        Some(v) if !v.is_nan() => ramps::turbo(1.0 - f64::from(v / near)).map(|v| f32::from(v) / 255.0),
        _ => unknown,
    };
    // As pictures of normals mostly are: x right, y up, z towards the viewer.
    let rotation = camera.rotation();
    let normal = |at: usize| match prior.normal.get(at) {
        Some(n) if *n != [0.0; 3] => {
            let n = rotation * DVec3::from_array(n.map(f64::from));
            [n.x, -n.y, -n.z].map(|v| (0.5 + 0.5 * v) as f32)
        }
        _ => unknown,
    };
    let tint = |rgb: [f32; 3], tint: [f32; 3]| [0, 1, 2].map(|i| 0.45 * rgb[i] + 0.55 * tint[i]);
    let sky = |at: usize, rgb: [f32; 3]| match prior.sky.get(at) {
        Some(SkyClass::Sky) => tint(rgb, SKY_TINT),
        Some(SkyClass::Unknown) => tint(rgb, UNKNOWN_TINT),
        Some(SkyClass::Place) => rgb,
        None => unknown,
    };
    let mut panels = [0; 4].map(|_| Vec::with_capacity(3 * size.pixels()));
    for pixel in 0..size.pixels() {
        let x = ((pixel % size.width as usize) as f64 + 0.5) / f64::from(size.width);
        let y = ((pixel / size.width as usize) as f64 + 0.5) / f64::from(size.height);
        let column = |width: u32| (x * f64::from(width)) as u32;
        let row = |height: u32| (y * f64::from(height)) as u32;
        let rgb = photo.pixel(column(photo.width), row(photo.height));
        let at = row(prior.height) as usize * prior.width as usize + column(prior.width) as usize;
        let shown = [rgb, disparity(at), normal(at), sky(at, rgb)];
        panels.iter_mut().zip(shown).for_each(|(panel, rgb)| panel.extend(rgb));
    }
    let labels = [name, "disparity: red near, blue far", "normals", "sky: blue; yellow not known"];
    let mut labels = labels.into_iter();
    panels.map(|panel| (panel, labels.next().unwrap_or_default().to_owned()))
}
