//! Maps of what is true: where they lie, and what their numbers mean.

use crate::dataset::Dataset;
use anyhow::{Result, bail};
use clap::Args;
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use wm_scene::Camera;
use wm_scene::capture::Distortion;
use wm_scene::survey::{FactSource, Survey};
use wm_train::maps::{
    DepthForm, DepthKind, DepthScale, DepthUnit, Filter, Map, MapError, MapFault, NormalAxes, find_map,
    read_map,
};

/// Where maps of what is true lie.
#[derive(Args, Clone, Debug)]
pub struct TruthArgs {
    /// Folder of true depth, a file a photo with its name: .png, .tiff, .exr or .npy; of any size with the
    /// photo's aspect ratio [default: truth/depth in the data set, if it is there]
    #[arg(long, value_name = "FOLDER", help_heading = "Truth")]
    depth: Option<PathBuf>,
    /// Folder of true normals [default: truth/normal in the data set, if it is there]
    #[arg(long, value_name = "FOLDER", help_heading = "Truth")]
    normal: Option<PathBuf>,
    /// Folder of true skies: white in the sky, else black [default: truth/sky in the data set, if it is there]
    #[arg(long, value_name = "FOLDER", help_heading = "Truth")]
    sky: Option<PathBuf>,
    /// What one step of the depth maps is: m, cm, mm, units (of the scene), or a number of metres. Metres are made
    /// scene units by the scene's scale alone; where it has none, 1 m is 1 unit [default: what a PNG says of
    /// itself; m for floats]
    #[arg(long, value_name = "UNIT", help_heading = "Truth")]
    depth_unit: Option<DepthUnit>,
    /// What the depth maps hold: z (distance from the camera's plane), ray (from its centre) or disparity (1 / z)
    #[arg(long, value_name = "KIND", default_value = "z", help_heading = "Truth")]
    depth_kind: DepthForm,
    /// Axes of the normal maps: world (of the scene), camera (x right, y down, z forward) or opengl (x right, y up,
    /// z towards the viewer)
    #[arg(long, value_name = "AXES", default_value = "world", help_heading = "Truth")]
    normal_axes: NormalAxes,
}

/// A folder of maps that is used.
#[derive(Clone, Debug, Serialize)]
pub struct Folder {
    /// Where it is.
    pub folder: PathBuf,
    /// What its numbers are, in words.
    pub holds: String,
    /// Photos of those compared that have a map in it.
    pub photos: usize,
    /// Names of those that have none.
    pub missing: Vec<String>,
}

/// What is true of a photo, each where there is a map: arrays of the photo's size.
#[derive(Default)]
pub struct TrueMaps {
    /// `[H, W]`, view z, scene units; 0 where it is not known, infinite in the sky.
    pub depth: Option<Vec<f32>>,
    /// `[H, W, 3]`, world axes; 0 where it is not known.
    pub normal: Option<Vec<f32>>,
    /// `[H, W]`, above 0.5 in the sky.
    pub sky: Option<Vec<f32>>,
}

/// The maps of a data set.
pub struct Truth {
    /// True depth.
    pub depth: Option<Folder>,
    /// True normals.
    pub normal: Option<Folder>,
    /// True skies.
    pub sky: Option<Folder>,
    /// Metres a scene unit.
    pub metres_per_unit: f64,
    /// Where that is from.
    pub scale_source: FactSource,
    unit: Option<DepthUnit>,
    form: DepthForm,
    axes: NormalAxes,
}

impl Truth {
    /// Looks which photos have maps. Warns on the error stream of those that have none.
    pub fn open(args: &TruthArgs, data: &Dataset, survey: &Survey) -> Result<Self> {
        let scale = survey.metres_per_unit;
        let unit =
            args.depth_unit.map_or_else(|| "metres, or as the file says".to_owned(), |unit| unit.to_string());
        let form = match args.depth_kind {
            DepthForm::Z => format!("view z, a step is {unit}"),
            DepthForm::Ray => format!("distance along the ray, a step is {unit}"),
            DepthForm::Disparity => format!("1 / view z, a step is 1 / ({unit})"),
        };
        let axes = match args.normal_axes {
            NormalAxes::World => "in world axes",
            NormalAxes::Camera => "in the camera's axes",
            NormalAxes::OpenGl => "in the camera's axes, of OpenGL",
        };
        let truth = Self {
            depth: find("depth", args.depth.as_deref(), form, data)?,
            normal: find("normal", args.normal.as_deref(), axes.into(), data)?,
            sky: find("sky", args.sky.as_deref(), "above a half in the sky".into(), data)?,
            metres_per_unit: scale.value,
            scale_source: scale.source,
            unit: args.depth_unit,
            form: args.depth_kind,
            axes: args.normal_axes,
        };
        let bent =
            |place: &&usize| data.capture.views[data.photos.view(**place)].distortion != Distortion::None;
        if truth.any()
            && let Some(place) = data.places.iter().find(bent)
        {
            eprintln!(
                "warning: {}: its lens is undone before it is compared; the maps are taken to be of the picture without \
                 the lens",
                data.name(*place)
            );
        }
        Ok(truth)
    }

    /// Whether there is any.
    pub fn any(&self) -> bool {
        self.depth.is_some() || self.normal.is_some() || self.sky.is_some()
    }

    /// Reads the maps of a photo. What `mask`, `[H, W]`, leaves out of the photo is known of no map.
    pub fn read(&self, photo: &str, camera: &Camera, mask: Option<&[f32]>) -> Result<TrueMaps> {
        let fitted = |folder: &Option<Folder>| -> Result<Option<(PathBuf, Map)>, MapError> {
            let Some(folder) = folder else { return Ok(None) };
            let Some(path) = find_map(&folder.folder, photo)? else { return Ok(None) };
            let map = read_map(&path)?;
            // Between two depths lies none, so no mean of them is taken.
            let map = map.fitted(camera.width, camera.height, Filter::Nearest);
            let map = map.map_err(|fault| MapError { path: path.clone(), fault })?;
            Ok(Some((path, map)))
        };
        let mut maps = TrueMaps::default();
        if let Some((_, map)) = fitted(&self.sky)? {
            maps.sky = Some(map.to_mask());
        }
        if let Some((path, map)) = fitted(&self.depth)? {
            let scale = DepthScale::UnitsPerStep(self.units_per_step(&path, &map)?);
            let depth = DepthKind { form: self.form, scale }.to_view_z(&map, camera);
            maps.depth = Some(depth.map_err(|fault| MapError { path, fault })?);
        }
        if let Some((path, map)) = fitted(&self.normal)? {
            let normal = self.axes.to_world(&map, camera);
            maps.normal = Some(normal.map_err(|fault: MapFault| MapError { path, fault })?);
        }
        maps.join(mask);
        Ok(maps)
    }

    fn units_per_step(&self, path: &Path, map: &Map) -> Result<f64> {
        let Some(unit) = DepthUnit::of(self.unit, map) else {
            bail!(
                "{}: holds whole numbers and does not say what one of them is; give --depth-unit, such as mm",
                path.display()
            );
        };
        Ok(match (unit, self.form) {
            (DepthUnit::SceneUnits, _) => 1.0,
            (DepthUnit::Metres(metres), DepthForm::Z | DepthForm::Ray) => metres / self.metres_per_unit,
            // A step of 1 / (so many metres).
            (DepthUnit::Metres(metres), DepthForm::Disparity) => self.metres_per_unit / metres,
        })
    }
}

impl TrueMaps {
    /// Brings together what the maps say of the sky, and takes out what the mask leaves out.
    fn join(&mut self, mask: Option<&[f32]>) {
        if let Some(depth) = &mut self.depth {
            match &mut self.sky {
                Some(sky) => {
                    for (depth, sky) in depth.iter_mut().zip(sky) {
                        if *sky > 0.5 {
                            *depth = f32::INFINITY;
                        } else if *depth == f32::INFINITY {
                            // The sky's own map knows better; what is there instead nobody says.
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

/// Looks for the maps of one kind; `None` if there is no folder of them.
fn find(kind: &str, given: Option<&Path>, holds: String, data: &Dataset) -> Result<Option<Folder>> {
    let usual = data.capture.source.join("truth").join(kind);
    let folder = match given {
        Some(folder) if !folder.is_dir() => {
            bail!("--{kind} {}: there is no such folder; name the folder of the maps", folder.display())
        }
        Some(folder) => folder.to_owned(),
        None if usual.is_dir() => usual,
        None => return Ok(None),
    };
    let mut missing = BTreeSet::new();
    for place in &data.places {
        let name = data.name(*place);
        if find_map(&folder, name)?.is_none() {
            missing.insert(name.to_owned());
        }
    }
    let photos = data.places.len() - missing.len();
    if photos == 0 {
        let example = Path::new(data.name(data.places[0])).with_extension("npy");
        bail!(
            "{}: no photo that is compared has a map in it; call them as the photos, such as {}, or name another folder \
             with --{kind}",
            folder.display(),
            example.display()
        );
    }
    if let Some(first) = missing.first() {
        let more =
            if missing.len() > 1 { format!(" (and {} more)", missing.len() - 1) } else { String::new() };
        eprintln!(
            "warning: {}: no map of {first}{more}; {photos} of {} photos have one",
            folder.display(),
            data.places.len()
        );
    }
    Ok(Some(Folder { folder, holds, photos, missing: missing.into_iter().collect() }))
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
