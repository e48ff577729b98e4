//! Options of `evaluate`.

use super::realism::RealismArgs;
use super::truth::TruthArgs;
use crate::choices::{Choice, one_of};
use crate::dataset::{DatasetArgs, HeldOutArgs};
use crate::overwrite::OverwriteArgs;
use crate::scene::{RunArgs, SceneArgs};
use clap::Args;
use std::path::{Path, PathBuf};
use weather_magician::train::evaluation::{EvaluationAir, ExposureFit};

/// Options of `evaluate`.
#[derive(Args, Clone, Debug)]
// The scene is optional, as pictures are compared without one; its group is needed to detect it,
// and derive leaves it empty.
#[command(mut_arg("scene", |scene| {
    scene.required(false).required_unless_present_any(["pictures", "paper"]).group("SceneArgs")
}))]
pub(crate) struct EvaluateArgs {
    #[command(flatten)]
    scene: Option<SceneArgs>,
    /// The data set: a folder with a COLMAP model or a transforms.json, in the axes of the scene
    #[arg(short, long, value_name = "FOLDER", required_unless_present_any = ["pictures", "paper"])]
    dataset: Option<PathBuf>,
    #[command(flatten)]
    pub(super) photos: PhotoArgs,
    #[command(flatten)]
    pub(super) truth: TruthArgs,
    #[command(flatten)]
    pub(super) realism: RealismArgs,
    /// Write all numbers to this JSON file (docs/guide/evaluate.md describes them)
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub(super) json: Option<PathBuf>,
    /// Write an HTML report: numbers, and pictures of photo, render and error side by side, in one
    /// file
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub(super) report: Option<PathBuf>,
    /// Maximum number of photos in the report, evenly spaced
    #[arg(long, value_name = "N", default_value_t = 8, requires = "report", help_heading = "Output")]
    pub(super) report_photos: u32,
    #[command(flatten)]
    pub(super) overwrite: OverwriteArgs,
    #[command(flatten)]
    pub(super) run: RunArgs,
}

impl EvaluateArgs {
    /// Returns the scene that is compared.
    pub(super) fn scene(&self) -> &SceneArgs {
        self.scene.as_ref().expect("required but for pictures, which are compared without")
    }

    /// Returns the data set that it is compared with.
    pub(super) fn dataset(&self) -> &Path {
        self.dataset.as_deref().expect("required but for pictures, which are compared without")
    }
}

/// The photos and the comparison.
#[derive(Args, Clone, Debug)]
#[command(mut_arg("eval_every", |arg| {
    arg.help("Compare every N-th photo (in the order of names): those that `reconstruct` held out with the same number; \
              0 compares all photos, including those used for training")
}))]
#[command(mut_arg("eval_from", |arg| arg.help("The first photo that is compared, from 0")))]
pub(super) struct PhotoArgs {
    #[command(flatten)]
    pub(super) set: DatasetArgs,
    #[command(flatten)]
    pub(super) held_out: HeldOutArgs,
    /// Correction of the render before colours are compared: none, or affine (the change of colour,
    /// one for each photo, that brings the render nearest to it)
    #[arg(long, value_name = "FIT", default_value = "none", value_parser = one_of(EXPOSURE_FITS), help_heading = "Photos")]
    pub(super) exposure_fit: ExposureFit,
    /// Air between cameras and scene: photos (the haze in which the scene's own photos were taken,
    /// if any) or clear
    #[arg(long, value_name = "AIR", default_value = "photos", value_parser = one_of(AIRS), help_heading = "Photos")]
    pub(super) air: EvaluationAir,
}

/// Air between cameras and scene.
const AIRS: &[Choice<EvaluationAir>] = &[
    ("photos", "The haze of the scene's photos", EvaluationAir::Photos),
    ("clear", "Clear air", EvaluationAir::Clear),
];
/// Corrections of the render before colours are compared.
const EXPOSURE_FITS: &[Choice<ExposureFit>] = &[
    ("none", "No correction", ExposureFit::None),
    ("affine", "An affine change of colour per photo", ExposureFit::Affine),
];
