//! Options of ground-truth maps.

use crate::dataset::Dataset;
use anyhow::{Result, anyhow};
use clap::Args;
use std::path::PathBuf;
use weather_magician::train::evaluation::{TruthError, TruthMaps, TruthOptions};
use weather_magician::wm_image::maps::{DepthForm, DepthUnit, NormalAxes};
use wm_scene::survey::Survey;

/// The folders of ground-truth maps, and the meaning of their numbers.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Truth")]
pub(crate) struct TruthArgs {
    /// Folder of true depth, one file per photo and named after it: .png, .tiff, .exr or .npy; of
    /// any size with the photo's aspect ratio [default: truth/depth in the data set, if it exists]
    #[arg(long, value_name = "FOLDER")]
    depth: Option<PathBuf>,
    /// Folder of true normals [default: truth/normal in the data set, if it exists]
    #[arg(long, value_name = "FOLDER")]
    normal: Option<PathBuf>,
    /// Folder of true skies: white in the sky, else black [default: truth/sky in the data set, if
    /// it exists]
    #[arg(long, value_name = "FOLDER")]
    sky: Option<PathBuf>,
    /// Unit of the depth maps: m, cm, mm, units (of the scene), or a number of metres. Metres
    /// become scene units by the scene's scale; if it has none, 1 m is 1 unit [default: the unit in
    /// a PNG's metadata; m for floats]
    #[arg(long, value_name = "UNIT")]
    depth_unit: Option<DepthUnit>,
    /// Quantity in the depth maps: z (distance from the camera's plane), ray (from its centre) or
    /// disparity (1 / z)
    #[arg(long, value_name = "KIND", default_value = "z")]
    depth_kind: DepthForm,
    /// Axes of the normal maps: world (of the scene), camera (x right, y down, z forward) or opengl
    /// (x right, y up, z towards the viewer)
    #[arg(long, value_name = "AXES", default_value = "world")]
    normal_axes: NormalAxes,
}

impl TruthArgs {
    /// Finds the maps of the photos. Warns on the error stream of photos without one.
    pub(crate) fn open(&self, data: &Dataset, survey: &Survey) -> Result<TruthMaps> {
        let options = TruthOptions {
            depth: self.depth.clone(),
            normal: self.normal.clone(),
            sky: self.sky.clone(),
            depth_unit: self.depth_unit,
            depth_form: self.depth_kind,
            normal_axes: self.normal_axes,
        };
        let (truth, warnings) = TruthMaps::open(&options, data, survey).map_err(explain)?;
        for warning in warnings {
            eprintln!("warning: {warning}");
        }
        Ok(truth)
    }
}

/// Returns the error as the command prints it, with the options that help.
pub(crate) fn explain(error: TruthError) -> anyhow::Error {
    match &error {
        TruthError::NoFolder { kind, folder } => {
            anyhow!("--{kind} {}: there is no such folder; name the folder of the maps", folder.display())
        }
        TruthError::NoMap { kind, folder, example } => anyhow!(
            "{}: no photo that is compared has a map in it; name them like the photos, such as {}, or name another folder \
             with --{kind}",
            folder.display(),
            example.display()
        ),
        TruthError::NoUnit(path) => anyhow!(
            "{}: holds whole numbers and does not say what one of them is; give --depth-unit, such as mm",
            path.display()
        ),
        _ => error.into(),
    }
}
