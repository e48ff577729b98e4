//! Priors from maps that the user has.

use super::source::{PriorAnswer, PriorEstimator};
use crate::choices::{Choice, first_given, one_of};
use crate::dataset::Dataset;
use crate::interrupt;
use crate::progress;
use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use weather_magician::train::priors::files::{self, DepthFiles, FileMaps, MapsOf};
use weather_magician::train::priors::fit::{Freedom, fit};
use weather_magician::train::priors::points::{placed, seen_points};
use weather_magician::train::priors::relative::{Relative, pairs};
use weather_magician::wm_image::maps::{DepthForm, DepthUnit, MapFault, MapFolder, NormalAxes};
use wm_base::statistics::quantile;

/// The folders of maps, and the meaning of their numbers.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Maps")]
pub(crate) struct FileArgs {
    /// Folder of depth maps, one file per photo and named after it: .png, .tiff, .exr or .npy; of
    /// any size with the photo's aspect ratio
    #[arg(long, value_name = "FOLDER")]
    depth: Option<PathBuf>,
    /// Quantity in the depth maps: z (distance from the camera's plane), ray (from its centre) or
    /// disparity (1 / z)
    #[arg(long, value_name = "FORM", default_value = "z", requires = "depth", hide_default_value = true)]
    depth_form: DepthForm,
    /// Scale of the depth maps: metric (metres), scaled (an unknown factor for each map) or
    /// relative (an unknown factor and offset of each map's 1 / z, as from most networks). Factors
    /// and offsets are fitted to the points [default: relative for disparity, else metric]
    #[arg(long, value_name = "SCALE", requires = "depth")]
    depth_scale: Option<ScaleArg>,
    /// Unit of metric maps: m, cm, mm, units (of the scene), or a number of metres [default: the
    /// unit in a PNG's metadata; m for floats]
    #[arg(long, value_name = "UNIT", requires = "depth")]
    depth_unit: Option<DepthUnit>,
    /// Metres per scene unit, for metric maps [default: one scale for all photos, fitted to the
    /// points]
    #[arg(long, value_name = "METRES", allow_negative_numbers = true, requires = "depth")]
    metres_per_unit: Option<f64>,
    /// Folder of normal maps [default: normals are computed from the depth]
    #[arg(long, value_name = "FOLDER", requires = "normal_axes")]
    normal: Option<PathBuf>,
    /// Axes of the normal maps: world (of the scene), camera (x right, y down, z forward) or opengl
    /// (x right, y up, z towards the viewer)
    #[arg(long, value_name = "AXES", requires = "normal")]
    normal_axes: Option<NormalAxes>,
    /// Folder of masks of the sky: white is sky, black is not, grey is unknown [default: computed
    /// from depth and the photo's colours]
    #[arg(long, value_name = "FOLDER")]
    sky: Option<PathBuf>,
    /// Picture that the maps belong to if the lens distorts: photo (as it is stored) or pinhole
    /// (undistorted, as COLMAP's undistorter and this program make it)
    #[arg(long, value_name = "PICTURE", value_parser = one_of(MAPS_OF), default_value = "photo")]
    maps_of: MapsOf,
}

/// The known part of the scale of depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ScaleArg {
    /// The scale is known.
    Metric,
    /// A factor is unknown.
    Scaled,
    /// A factor and an offset are unknown.
    Relative,
}

/// Pictures that maps belong to.
const MAPS_OF: &[Choice<MapsOf>] =
    &[("photo", "The photo", MapsOf::Photo), ("pinhole", "The undistorted photo", MapsOf::Pinhole)];

impl FileArgs {
    /// Returns the name of the first option that was given.
    pub(crate) fn given(&self) -> Option<&'static str> {
        let all = [(&self.depth, "--depth"), (&self.normal, "--normal"), (&self.sky, "--sky")];
        first_given(all.map(|(folder, name)| (folder.is_some(), name)))
    }

    fn scale(&self) -> ScaleArg {
        let usual = match self.depth_form {
            DepthForm::Disparity => ScaleArg::Relative,
            DepthForm::Z | DepthForm::Ray => ScaleArg::Metric,
        };
        self.depth_scale.unwrap_or(usual)
    }

    fn check(&self) -> Result<()> {
        if let Some(metres) = self.metres_per_unit {
            if !(metres.is_finite() && metres > 0.0) {
                bail!("--metres-per-unit is {metres}: it must be finite and above 0");
            }
            if self.scale() != ScaleArg::Metric {
                bail!("--metres-per-unit is only for --depth-scale metric; leave one of them out");
            }
        }
        Ok(())
    }
}

/// Maps in folders.
pub(crate) struct PriorMaps {
    maps: FileMaps,
    name: String,
}

/// Opens the folders, and finds the scene's scale if it is needed. Prints warnings on the error
/// stream. Maps will have at most `map_pixels` pixels.
pub(crate) fn open(given: &FileArgs, map_pixels: u32, data: &Dataset) -> Result<PriorMaps> {
    given.check()?;
    let (form, scale) = (given.depth_form, given.scale());
    let mut parts = Vec::new();
    for (kind, folder) in [("depth", &given.depth), ("normal", &given.normal), ("sky", &given.sky)] {
        let Some(folder) = folder else { continue };
        count(kind, folder, data)?;
        let what = match kind {
            "depth" => format!(" ({form:?}, {scale:?})").to_lowercase(),
            "normal" => {
                given.normal_axes.map_or_else(String::new, |axes| format!(" ({axes:?})").to_lowercase())
            }
            _ => String::new(),
        };
        parts.push(format!("{kind} {}{what}", folder.display()));
    }
    let freedom = match (scale, given.metres_per_unit) {
        (ScaleArg::Relative, _) => Freedom::ScaleShift,
        (ScaleArg::Scaled, _) => Freedom::Scale,
        (ScaleArg::Metric, metres) => Freedom::Known(metres.unwrap_or(1.0)),
    };
    let depth = given.depth.as_ref().map(|folder| DepthFiles {
        folder: MapFolder::new(folder),
        form,
        unit: given.depth_unit,
        freedom,
    });
    let mut maps = FileMaps {
        depth,
        normal: given.normal.as_ref().map(MapFolder::new).zip(given.normal_axes),
        sky: given.sky.as_ref().map(MapFolder::new),
        of: given.maps_of,
        pixels: map_pixels,
    };
    let is_unknown = scale == ScaleArg::Metric
        && given.metres_per_unit.is_none()
        && given.depth_unit != Some(DepthUnit::SceneUnits);
    if is_unknown && maps.depth.is_some() {
        let metres = shared_scale(&maps, data)?;
        parts.push(format!("1 unit is {metres} m"));
        if let Some(depth) = &mut maps.depth {
            depth.freedom = Freedom::Known(metres);
        }
    } else if let (Some(metres), true) = (given.metres_per_unit, maps.depth.is_some()) {
        parts.push(format!("1 unit is {metres} m"));
    }
    if given.maps_of == MapsOf::Pinhole {
        parts.push("without the lens".into());
    }
    Ok(PriorMaps { maps, name: format!("{}: {}", files::SOURCE, parts.join(", ")) })
}

impl PriorEstimator for PriorMaps {
    fn name(&self) -> String {
        self.name.clone()
    }

    fn batch_size(&self) -> usize {
        2 * rayon::current_num_threads()
    }

    fn estimate(&self, data: &Dataset, place: usize) -> Result<PriorAnswer> {
        let given = self.maps.look(&data.photos, place, data.name(place));
        let given = given.map_err(|error| match (&error.fault, self.maps.of) {
            (MapFault::Aspect { .. }, MapsOf::Photo) if data.photos.is_bent(place) => {
                anyhow::anyhow!("{error}; --maps-of pinhole takes maps of the photo without its lens")
            }
            (MapFault::Aspect { .. }, MapsOf::Pinhole) if data.photos.is_bent(place) => {
                anyhow::anyhow!("{error}; --maps-of photo takes maps of the photo with its lens")
            }
            _ => error.into(),
        })?;
        Ok(given.map_or_else(|| PriorAnswer::Nothing("there is no map of it".into()), PriorAnswer::Given))
    }
}

/// Returns metres per scene unit: the median of the scales that fit each photo's metric depth to
/// the points.
fn shared_scale(maps: &FileMaps, data: &Dataset) -> Result<f64> {
    // Only the depth counts here; at scale 1 it is in 1 / m.
    let depth = maps.depth.clone().map(|depth| DepthFiles { freedom: Freedom::Known(1.0), ..depth });
    let maps = FileMaps { depth, normal: None, sky: None, ..maps.clone() };
    let seen = seen_points(&data.capture, &data.photos, &data.places);
    let bar = progress::bar(data.places.len() as u64, "scale");
    let mut scales: Vec<f64> = data
        .places
        .par_iter()
        .zip(&seen)
        .map(|(place, seen)| {
            bar.inc(1);
            interrupt::check("no photo is done yet")?;
            let Some(given) = maps.look(&data.photos, *place, data.name(*place))? else { return Ok(None) };
            let Some(depth) = given.depth else { return Ok(None) };
            let relative = Relative {
                width: given.width as usize,
                height: given.height as usize,
                values: depth.values,
                freedom: Freedom::Scale,
                sky: Vec::new(),
            };
            let points = placed(&data.capture, &data.photos.camera(*place, 0), seen);
            let view = data.photos.view(*place) as u64;
            Ok(fit(&pairs(&relative, &points), Freedom::Scale, view).ok().map(|fit| fit.scale))
        })
        .collect::<Result<Vec<Option<f64>>>>()?
        .into_iter()
        .flatten()
        .collect();
    bar.finish_and_clear();
    if scales.is_empty() {
        bail!(
            "--depth: no map follows the points of the model, so its scale is not found; give --metres-per-unit, and look \
             whether --depth-form is right"
        );
    }
    let [low, middle, high] = [0.25, 0.5, 0.75].map(|share| quantile(&mut scales, share));
    eprintln!(
        "depth: 1 scene unit is {:.4} m by the points of {} photos (the middle half {:.4} to {:.4}); \
         --metres-per-unit says otherwise",
        middle,
        scales.len(),
        low,
        high
    );
    Ok(middle)
}

/// Prints a warning for photos without a map; returns an error for a folder without any.
fn count(kind: &str, folder: &Path, data: &Dataset) -> Result<()> {
    if !folder.is_dir() {
        bail!("--{kind} {}: there is no such folder; name the folder of the maps", folder.display());
    }
    let maps = MapFolder::new(folder);
    let (mut missing, mut first) = (0, None);
    for place in &data.places {
        let name = data.name(*place);
        if maps.find(name)?.is_none() {
            missing += 1;
            first = first.or(Some(name));
        }
    }
    let all = data.places.len();
    if let Some(first) = first {
        let example = Path::new(first).with_extension("npy");
        if missing == all {
            bail!(
                "--{kind} {}: no photo has a map in it; name them like the photos, such as {}",
                folder.display(),
                example.display()
            );
        }
        eprintln!(
            "warning: {}: no map of {first}, {} of {all} photos have one",
            folder.display(),
            all - missing
        );
    }
    Ok(())
}
