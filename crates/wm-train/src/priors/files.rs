//! Priors from maps in files.

use super::SkyClass;
use super::fit::Freedom;
use super::given::{Given, GivenDepth, SkyBy};
use crate::photos::Photos;
use std::path::{Path, PathBuf};
use wm_image::maps::{
    DepthForm, DepthUnit, Filter, Map, MapError, MapFault, MapFolder, NormalAxes, read_map,
};
use wm_scene::Camera;

/// The start of `source` in the index.
pub const SOURCE: &str = "files";
/// Shares of white from which, and up to which, a mask says sky and place.
const MIN_SKY_WHITE: f32 = 0.75;
const MAX_PLACE_WHITE: f32 = 0.25;

/// Over which picture maps are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MapsOf {
    /// The photo as it is stored, with what its lens does to it.
    #[default]
    Photo,
    /// The photo without its lens.
    Pinhole,
}

/// A folder of depth maps.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthFiles {
    /// The folder; maps are named after the photos.
    pub folder: MapFolder,
    /// The quantity that they hold.
    pub form: DepthForm,
    /// The unit, where the files do not say it; it only matters where the scale is known.
    pub unit: Option<DepthUnit>,
    /// The unknowns of the fit; for [`Freedom::Known`], metres per scene unit.
    pub freedom: Freedom,
}

/// Folders of maps, and how they are read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FileMaps {
    /// Depth.
    pub depth: Option<DepthFiles>,
    /// Normals and their axes.
    pub normal: Option<(MapFolder, NormalAxes)>,
    /// Masks, white in the sky.
    pub sky: Option<MapFolder>,
    /// Over which picture they are.
    pub of: MapsOf,
    /// Most pixels that are kept of a map.
    pub pixels: u32,
}

impl FileMaps {
    /// Reads the maps of photo `place` with this name; `None` if it has none.
    ///
    /// # Errors
    /// [`MapError`] if a map cannot be read, is of another shape than the photo, or holds what it
    /// should not.
    ///
    /// # Panics
    /// If there is no such photo.
    pub fn look(&self, photos: &Photos, place: usize, name: &str) -> Result<Option<Given>, MapError> {
        let read = |folder: Option<&MapFolder>| -> Result<Option<(PathBuf, Map)>, MapError> {
            let path = folder.map(|folder| folder.find(name)).transpose()?.flatten();
            path.map(|path| read_map(&path).map(|map| (path, map))).transpose()
        };
        let depth = read(self.depth.as_ref().map(|depth| &depth.folder))?;
        let normal = read(self.normal.as_ref().map(|(folder, _)| folder))?;
        let sky = read(self.sky.as_ref())?;
        let camera = photos.camera(place, 0);
        let is_bent = self.of == MapsOf::Photo && photos.is_bent(place);
        let Some((_, first)) = depth.as_ref().or(normal.as_ref()).or(sky.as_ref()) else { return Ok(None) };
        let size = size_of(first, &camera, self.pixels, is_bent);
        let fitted = |path: &Path, map: &Map, filter: Filter| {
            let found = if is_bent {
                photos.without_lens(place, map, size, filter)
            } else {
                map.check_shape(camera.width, camera.height).map(|()| map.resampled(size.0, size.1, filter))
            };
            found.map_err(|fault| MapError { path: path.to_owned(), fault })
        };
        let mut given = Given { width: size.0, height: size.1, ..Given::default() };
        if let (Some((path, map)), Some(files)) = (depth, &self.depth) {
            // Between two depths lies none, while disparity from networks is smooth.
            let filter = match files.form {
                DepthForm::Disparity => Filter::Area,
                DepthForm::Z | DepthForm::Ray => Filter::Nearest,
            };
            let map = fitted(&path, &map, filter)?;
            let depth = files.read(&map, &camera).map_err(|fault| MapError { path, fault })?;
            given.depth = Some(depth);
        }
        if let (Some((path, map)), Some((_, axes))) = (normal, &self.normal) {
            let map = fitted(&path, &map, Filter::Nearest)?;
            let normal = axes.to_world(&map, &camera).and_then(|normal| facing(normal, &map, &camera));
            given.normal = Some(normal.map_err(|fault| MapError { path, fault })?);
        }
        if let Some((path, map)) = sky {
            let map = fitted(&path, &map, Filter::Area)?;
            let class = |white: f32| match white {
                MIN_SKY_WHITE.. => SkyClass::Sky,
                ..=MAX_PLACE_WHITE => SkyClass::Place,
                _ => SkyClass::Unknown,
            };
            given.sky = Some(map.to_mask().into_iter().map(class).collect());
        }
        Ok(Some(given))
    }
}

impl DepthFiles {
    /// Inverse depth: of a known scale 1 / m or 1 / scene unit, else of any unit.
    fn read(&self, map: &Map, camera: &Camera) -> Result<GivenDepth, MapFault> {
        let unit = DepthUnit::of(self.unit, map);
        let (freedom, step) = match (self.freedom, unit) {
            (Freedom::Known(_), None) => return Err(MapFault::NoUnit),
            (Freedom::Known(_), Some(DepthUnit::SceneUnits)) => (Freedom::Known(1.0), 1.0),
            (freedom @ Freedom::Known(_), Some(DepthUnit::Metres(metres))) => (freedom, metres),
            (freedom, _) => (freedom, 1.0),
        };
        if self.form == DepthForm::Disparity && freedom == Freedom::ScaleShift {
            // Where 0 lies nobody knows: it is not the sky.
            let mut values = map.grey()?;
            values.iter_mut().filter(|v| v.is_infinite()).for_each(|v| *v = f32::NAN);
            return Ok(GivenDepth { values, freedom, sky_by: SkyBy::Least });
        }
        let step = if self.form == DepthForm::Disparity { 1.0 / step } else { step };
        let mut values = self.form.to_view_z(step, map, camera)?;
        // Unknown is 0 there.
        values.iter_mut().for_each(|z| *z = if *z > 0.0 { 1.0 / *z } else { f32::NAN });
        Ok(GivenDepth { values, freedom, sky_by: SkyBy::Zero })
    }
}

/// The size in which maps of a photo are kept: that of the first, if it is not too large and its
/// pixels are those of the picture, else one of the picture's shape.
fn size_of(map: &Map, camera: &Camera, most: u32, is_bent: bool) -> (u32, u32) {
    let pixels = map.pixels().min(most as usize);
    if pixels == map.pixels() && !is_bent {
        return (map.width, map.height);
    }
    size_within(camera.width, camera.height, pixels)
}

/// Returns a size of the same aspect ratio with at most `most` pixels, or a few more where sides
/// are rounded; at least 1 px a side.
#[must_use]
pub fn size_within(width: u32, height: u32, most: usize) -> (u32, u32) {
    let scale = (most as f64 / (f64::from(width) * f64::from(height))).sqrt().min(1.0);
    let side = |side: u32| ((f64::from(side) * scale).round() as u32).max(1);
    (side(width), side(height))
}

/// Normals as triples, if most of them can be seen.
fn facing(normal: Vec<f32>, map: &Map, camera: &Camera) -> Result<Vec<[f32; 3]>, MapFault> {
    let camera = camera.resized(map.width, map.height);
    let normal = normal.as_chunks::<3>().0.to_vec();
    let (mut known, mut away) = (0, 0);
    for (index, n) in normal.iter().enumerate().filter(|(_, n)| **n != [0.0; 3]) {
        let (x, y) = (index % map.width as usize, index / map.width as usize);
        let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
        known += 1;
        away += usize::from(ray.dot(glam::DVec3::from_array(n.map(f64::from))) > 0.0);
    }
    if 2 * away > known {
        return Err(MapFault::Away { share: 100.0 * away as f64 / known as f64 });
    }
    Ok(normal)
}
