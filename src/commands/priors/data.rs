//! The photos that priors are made of.

use anyhow::{Result, bail};
use clap::Args;
use std::path::{Path, PathBuf};
use wm_scene::capture::{self, Capture, CaptureOptions};
use wm_train::photos::{BadPhotos, PhotoOptions, PhotoSize, Photos};

/// Which photos, and how large.
#[derive(Args, Clone, Debug)]
pub struct PhotoArgs {
    /// Folder of the photos in the data set, such as images_4 [default: images, or another usual name]
    #[arg(long, value_name = "FOLDER", help_heading = "Photos")]
    images: Option<PathBuf>,
    /// Folder of masks in the data set: black is left out [default: masks, if it is there]
    #[arg(long, value_name = "FOLDER", help_heading = "Photos")]
    masks: Option<PathBuf>,
    /// Folder of the COLMAP model in the data set [default: sparse/0, or another usual place]
    #[arg(long, value_name = "FOLDER", help_heading = "Photos")]
    model_folder: Option<PathBuf>,
    /// Longest side that photos are used with, px
    #[arg(long, value_name = "PX", default_value_t = 1600, value_parser = clap::value_parser!(u32).range(16..=32768), help_heading = "Photos")]
    pub longest: u32,
    /// Leave out photos that are missing or damaged, and go on
    #[arg(long, help_heading = "Photos")]
    pub skip_bad: bool,
    /// Do not look at every N-th photo (in the order of names): those that `reconstruct` holds out with the same
    /// number; 0 looks at all
    #[arg(long, value_name = "N", default_value_t = 0, help_heading = "Photos")]
    eval_every: u32,
    /// The first photo that is not looked at, from 0
    #[arg(long, value_name = "K", default_value_t = 0, help_heading = "Photos")]
    eval_from: u32,
    /// Memory for decoded photos, MiB
    #[arg(long, value_name = "MIB", default_value_t = 512, value_parser = clap::value_parser!(u32).range(1..), help_heading = "Photos")]
    cache: u32,
}

/// A data set that is open.
pub struct Data {
    /// Cameras and points.
    pub capture: Capture,
    /// The photos.
    pub photos: Photos,
    /// Places in `photos` of those that priors are made of.
    pub places: Vec<usize>,
}

impl Data {
    /// Opens it. Warns on the error stream.
    pub fn open(dataset: &Path, args: &PhotoArgs) -> Result<Self> {
        let options = CaptureOptions {
            images: args.images.clone(),
            model: args.model_folder.clone(),
            masks: args.masks.clone(),
        };
        let capture = capture::read(dataset, &options)?;
        if capture.views.is_empty() {
            bail!("{}: there are no photos in it; choose another data set", dataset.display());
        }
        let options = PhotoOptions {
            size: PhotoSize::Longest(args.longest),
            cache_bytes: (args.cache as usize) << 20,
            bad: if args.skip_bad { BadPhotos::Skip } else { BadPhotos::Refuse },
            ..PhotoOptions::default()
        };
        let photos = Photos::open(&capture, &options)?;
        for skipped in photos.skipped() {
            eprintln!("warning: {skipped}; it is left out");
        }
        // By their places in the capture, as `reconstruct` counts them.
        let is_held = |place: &usize| {
            let view = photos.view(*place) as u32;
            args.eval_every > 0 && view % args.eval_every == args.eval_from % args.eval_every
        };
        let places: Vec<usize> = (0..photos.len()).filter(|place| !is_held(place)).collect();
        if places.is_empty() {
            bail!(
                "{}: --eval-every {} leaves no photo to look at; give a larger number",
                dataset.display(),
                args.eval_every
            );
        }
        Ok(Self { capture, photos, places })
    }

    /// The name of a photo.
    pub fn name(&self, place: usize) -> &str {
        &self.capture.views[self.photos.view(place)].name
    }
}
