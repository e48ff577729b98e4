//! Ground-truth maps of a data set: where they are, and what their numbers mean.

use crate::dataset::Dataset;
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use thiserror::Error;
use wm_capture::folder_of;
use wm_image::maps::{
    DepthForm, DepthUnit, Filter, Map, MapError, MapFault, MapFolder, NormalAxes, read_map,
};
use wm_scene::Camera;
use wm_scene::survey::{FactSource, Survey};

/// The folders of ground-truth maps and the meaning of their numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TruthOptions {
    /// Folder of depth maps, one per photo and named after it; `None` takes `truth/depth` in the
    /// data set if it exists.
    pub depth: Option<PathBuf>,
    /// Folder of normal maps; `None` takes `truth/normal` if it exists.
    pub normal: Option<PathBuf>,
    /// Folder of sky masks, white in the sky; `None` takes `truth/sky` if it exists.
    pub sky: Option<PathBuf>,
    /// The unit of depth maps; `None` takes what a PNG says of itself, and metres for floats.
    pub depth_unit: Option<DepthUnit>,
    /// The quantity that depth maps hold.
    pub depth_form: DepthForm,
    /// The axes of normal maps.
    pub normal_axes: NormalAxes,
}

/// A reason why ground-truth maps cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TruthError {
    /// A folder that was named does not exist.
    #[error("{kind} maps: {}: there is no such folder; name the folder of the maps", folder.display())]
    NoFolder {
        /// The kind of the maps: `depth`, `normal` or `sky`.
        kind: &'static str,
        /// The folder.
        folder: PathBuf,
    },
    /// No map in the folder is of a photo.
    #[error(
        "{}: no photo that is compared has a map in it; call them as the photos, such as {}, or name another folder \
         of {kind} maps",
        folder.display(),
        example.display()
    )]
    NoMap {
        /// The kind of the maps.
        kind: &'static str,
        /// The folder.
        folder: PathBuf,
        /// The name that a map could have.
        example: PathBuf,
    },
    /// A depth map of whole numbers does not say its unit.
    #[error("{}: holds whole numbers and does not say what one of them is; give the unit of the depth maps, such as mm", .0.display())]
    NoUnit(PathBuf),
    /// A map cannot be read or has another shape than its photo.
    #[error(transparent)]
    Map(#[from] MapError),
}

/// Something about ground-truth maps that the user should know.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum TruthWarning {
    /// Some photos have no map.
    #[error(
        "{}: no map of {first}{}; {found} of {photos} photos have one",
        folder.display(),
        if *missing > 1 { format!(" (and {} more)", missing - 1) } else { String::new() }
    )]
    Missing {
        /// The folder.
        folder: PathBuf,
        /// The first photo without a map.
        first: String,
        /// Photos without a map.
        missing: usize,
        /// Photos with one.
        found: usize,
        /// Photos that are compared.
        photos: usize,
    },
    /// Maps are taken to be of the photo without its lens distortion.
    #[error(
        "{0}: its lens is undone before it is compared; the maps are taken to be of the picture without the lens"
    )]
    Lens(String),
}

/// A folder of maps that is used.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct TruthFolder {
    /// The folder.
    pub folder: PathBuf,
    /// The meaning of its numbers, in words.
    pub holds: String,
    /// The number of compared photos with a map.
    pub photos: usize,
    /// The names of those without.
    pub missing: Vec<String>,
}

/// The ground truth of a photo, each part where there is a map of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrueMaps {
    /// View z, `[H, W]`, scene units; 0 where it is not known, infinite in the sky.
    pub depth: Option<Vec<f32>>,
    /// Normals in world axes, `[H, W, 3]`; 0 where they are not known.
    pub normal: Option<Vec<f32>>,
    /// Sky, `[H, W]`, above 0.5 in the sky.
    pub sky: Option<Vec<f32>>,
}

/// The ground-truth maps of a data set.
#[derive(Clone, Debug)]
pub struct TruthMaps {
    /// Depth.
    pub depth: Option<TruthFolder>,
    /// Normals.
    pub normal: Option<TruthFolder>,
    /// Sky.
    pub sky: Option<TruthFolder>,
    /// Metres per scene unit.
    pub metres_per_unit: f64,
    /// The origin of the scale.
    pub scale_source: FactSource,
    unit: Option<DepthUnit>,
    form: DepthForm,
    axes: NormalAxes,
    folders: [Option<MapFolder>; 3],
}

impl TruthMaps {
    /// Finds the maps of the photos of `data`; the second value is what the user should know.
    ///
    /// # Errors
    /// [`TruthError`] if a folder does not exist or holds no map of any photo.
    pub fn open(
        options: &TruthOptions,
        data: &Dataset,
        survey: &Survey,
    ) -> Result<(Self, Vec<TruthWarning>), TruthError> {
        let unit = options
            .depth_unit
            .map_or_else(|| "metres, or as the file says".to_owned(), |unit| unit.to_string());
        let form = match options.depth_form {
            DepthForm::Z => format!("view z, a step is {unit}"),
            DepthForm::Ray => format!("distance along the ray, a step is {unit}"),
            DepthForm::Disparity => format!("1 / view z, a step is 1 / ({unit})"),
        };
        let axes = match options.normal_axes {
            NormalAxes::World => "in world axes",
            NormalAxes::Camera => "in the camera's axes",
            NormalAxes::OpenGl => "in the camera's axes, of OpenGL",
        };
        let mut warnings = Vec::new();
        let mut find = |kind, folder: &Option<PathBuf>, holds: String| {
            Ok::<_, TruthError>(find(kind, folder.as_deref(), holds, data, &mut warnings)?.unzip())
        };
        let (depth, depth_folder) = find("depth", &options.depth, form)?;
        let (normal, normal_folder) = find("normal", &options.normal, axes.into())?;
        let (sky, sky_folder) = find("sky", &options.sky, "above a half in the sky".into())?;
        let truth = Self {
            depth,
            normal,
            sky,
            folders: [depth_folder, normal_folder, sky_folder],
            metres_per_unit: survey.metres_per_unit.value,
            scale_source: survey.metres_per_unit.source,
            unit: options.depth_unit,
            form: options.depth_form,
            axes: options.normal_axes,
        };
        if !truth.is_empty()
            && let Some(place) = data.places.iter().find(|place| data.photos.is_bent(**place))
        {
            warnings.push(TruthWarning::Lens(data.name(*place).to_owned()));
        }
        Ok((truth, warnings))
    }

    /// Returns true if there are no maps.
    pub(crate) fn is_empty(&self) -> bool {
        self.depth.is_none() && self.normal.is_none() && self.sky.is_none()
    }

    /// Reads the maps of a photo, at the size of `camera`. Pixels that `mask`, `[H, W]`, leaves out
    /// are not known in any map.
    ///
    /// # Errors
    /// [`TruthError`] if a map cannot be read, has another shape than the photo, or has no unit.
    pub(crate) fn read(
        &self,
        photo: &str,
        camera: &Camera,
        mask: Option<&[f32]>,
    ) -> Result<TrueMaps, TruthError> {
        let fitted = |folder: &Option<MapFolder>| -> Result<Option<(PathBuf, Map)>, MapError> {
            let Some(folder) = folder else { return Ok(None) };
            let Some(path) = folder.find(photo)? else { return Ok(None) };
            let map = read_map(&path)?;
            // The mean of two depths is the depth of nothing, so the nearest is taken.
            let map = map.fitted(camera.width, camera.height, Filter::Nearest);
            let map = map.map_err(|fault| MapError { path: path.clone(), fault })?;
            Ok(Some((path, map)))
        };
        let [depth, normal, sky] = &self.folders;
        let mut maps = TrueMaps::default();
        if let Some((_, map)) = fitted(sky)? {
            maps.sky = Some(map.to_mask());
        }
        if let Some((path, map)) = fitted(depth)? {
            let depth = self.form.to_view_z(self.units_per_step(&path, &map)?, &map, camera);
            maps.depth = Some(depth.map_err(|fault| MapError { path, fault })?);
        }
        if let Some((path, map)) = fitted(normal)? {
            let normal = self.axes.to_world(&map, camera);
            maps.normal = Some(normal.map_err(|fault: MapFault| MapError { path, fault })?);
        }
        maps.join(mask);
        Ok(maps)
    }

    fn units_per_step(&self, path: &Path, map: &Map) -> Result<f64, TruthError> {
        let Some(unit) = DepthUnit::of(self.unit, map) else {
            return Err(TruthError::NoUnit(path.to_owned()));
        };
        Ok(match (unit, self.form) {
            (DepthUnit::SceneUnits, _) => 1.0,
            (DepthUnit::Metres(metres), DepthForm::Z | DepthForm::Ray) => metres / self.metres_per_unit,
            // A step of disparity is 1 / (so many metres).
            (DepthUnit::Metres(metres), DepthForm::Disparity) => self.metres_per_unit / metres,
        })
    }
}

impl TrueMaps {
    /// Makes depth, normals and sky agree on where the sky is, and clears what the mask leaves out.
    fn join(&mut self, mask: Option<&[f32]>) {
        if let Some(depth) = &mut self.depth {
            match &mut self.sky {
                Some(sky) => {
                    for (depth, sky) in depth.iter_mut().zip(sky) {
                        if *sky > 0.5 {
                            *depth = f32::INFINITY;
                        } else if *depth == f32::INFINITY {
                            // The sky's own map wins, and then the depth here is not known.
                            *depth = 0.0;
                        }
                    }
                }
                None if depth.contains(&f32::INFINITY) => {
                    self.sky = Some(depth.iter().map(|z| f32::from(u8::from(*z == f32::INFINITY))).collect());
                }
                None => {}
            }
        }
        if let (Some(normal), Some(sky)) = (&mut self.normal, &self.sky) {
            let normals = normal.chunks_exact_mut(3).zip(sky);
            normals.filter(|(_, sky)| **sky > 0.5).for_each(|(normal, _)| normal.fill(0.0));
        }
        let Some(mask) = mask else { return };
        for (index, _) in mask.iter().enumerate().filter(|(_, mask)| **mask < 0.5) {
            for map in [&mut self.depth, &mut self.sky].into_iter().flatten() {
                map[index] = 0.0;
            }
            if let Some(normal) = &mut self.normal {
                normal[3 * index..3 * index + 3].fill(0.0);
            }
        }
    }
}

/// Finds the maps of one kind; `None` if there is no folder of them.
fn find(
    kind: &'static str,
    given: Option<&Path>,
    holds: String,
    data: &Dataset,
    warnings: &mut Vec<TruthWarning>,
) -> Result<Option<(TruthFolder, MapFolder)>, TruthError> {
    let usual = folder_of(&data.capture.source).join("truth").join(kind);
    let folder = match given {
        Some(folder) if !folder.is_dir() => {
            return Err(TruthError::NoFolder { kind, folder: folder.to_owned() });
        }
        Some(folder) => folder.to_owned(),
        None if usual.is_dir() => usual,
        None => return Ok(None),
    };
    let maps = MapFolder::new(folder.clone());
    let mut missing = BTreeSet::new();
    for place in &data.places {
        let name = data.name(*place);
        if maps.find(name)?.is_none() {
            missing.insert(name.to_owned());
        }
    }
    let photos = data.places.len();
    let found = photos - missing.len();
    if let (0, Some(place)) = (found, data.places.first()) {
        let example = Path::new(data.name(*place)).with_extension("npy");
        return Err(TruthError::NoMap { kind, folder, example });
    }
    if let Some(first) = missing.first().cloned() {
        let (folder, missing) = (folder.clone(), missing.len());
        warnings.push(TruthWarning::Missing { folder, first, missing, found, photos });
    }
    let truth = TruthFolder { folder, holds, photos: found, missing: missing.into_iter().collect() };
    Ok(Some((truth, maps)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_agree_about_the_sky_and_the_mask() {
        let inf = f32::INFINITY;
        let depth = || Some(vec![1.0, 2.0, inf, 4.0]);
        let mut maps =
            TrueMaps { depth: depth(), sky: Some(vec![0.0, 1.0, 0.0, 0.0]), normal: Some(vec![1.0; 12]) };
        maps.join(Some(&[1.0, 1.0, 1.0, 0.0]));
        assert_eq!(maps.depth.unwrap(), [1.0, inf, 0.0, 0.0]);
        assert_eq!(maps.normal.unwrap(), [1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
        let mut alone = TrueMaps { depth: depth(), ..TrueMaps::default() };
        alone.join(None);
        assert_eq!(alone.sky.unwrap(), [0.0, 0.0, 1.0, 0.0]);
    }
}
