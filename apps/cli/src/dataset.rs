//! Options of commands that open a data set: the photos, their size, and the held-out ones.

use crate::scene::print_remarks;
use anyhow::Result;
use clap::Args;
use std::path::{Path, PathBuf};
use weather_magician::train::Preset;
use weather_magician::train::photos::{BadPhotos, Check, PhotoSize, Photos};
pub(crate) use weather_magician::train::{Dataset, DatasetReadOptions, HeldOut};
use wm_capture::Capture;

/// The folders of the photos, and the size at which they are used.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Photos")]
pub(crate) struct DatasetArgs {
    /// Folder of the photos in the data set, such as images_4 [default: images, or another usual
    /// name]
    #[arg(long, value_name = "FOLDER")]
    pub(crate) images: Option<PathBuf>,
    /// Folder of masks in the data set; black pixels are ignored [default: masks, if it exists]
    #[arg(long, value_name = "FOLDER")]
    pub(crate) masks: Option<PathBuf>,
    /// Folder of the COLMAP model in the data set [default: the largest in sparse, or another usual
    /// place]
    #[arg(long, value_name = "FOLDER")]
    pub(crate) model: Option<PathBuf>,
    /// Folder of the original photos, whose EXIF gives position and time if the photos of the data
    /// set have none
    #[arg(long, value_name = "FOLDER")]
    originals: Option<PathBuf>,
    /// Longest side of photos, px; larger ones are reduced [default: 1600, or 500 with
    /// `reconstruct --preset draft`]
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(16..=32768))]
    pub(crate) longest: Option<u32>,
    /// Skip photos that are missing or damaged, and of driving logs sweeps, labels, masks, poses
    /// and times
    #[arg(long)]
    pub(crate) skip_bad: bool,
    /// Memory for decoded photos, MiB
    #[arg(long, value_name = "MIB", default_value_t = 512, value_parser = clap::value_parser!(u32).range(1..))]
    cache: u32,
}

impl DatasetArgs {
    /// Returns the longest side of photos for the default preset, px.
    #[must_use]
    pub(crate) fn longest_side(&self) -> u32 {
        self.longest.unwrap_or(Preset::default().longest_side())
    }

    /// Returns the options of the library.
    #[must_use]
    pub(crate) fn options(&self) -> DatasetReadOptions {
        DatasetReadOptions {
            images: self.images.clone(),
            masks: self.masks.clone(),
            model: self.model.clone(),
            originals: self.originals.clone(),
            size: PhotoSize::Longest(self.longest_side()),
            bad: if self.skip_bad { BadPhotos::Skip } else { BadPhotos::Refuse },
            cache_bytes: (self.cache as usize) << 20,
        }
    }

    /// Opens a data set. Prints the remarks of its reader, and a warning for each photo that is
    /// left out.
    ///
    /// # Errors
    /// The capture cannot be read or has no photos, or a photo is damaged and damaged ones are not
    /// skipped.
    pub(crate) fn open(&self, dataset: &Path) -> Result<(Capture, Photos)> {
        let options = self.options();
        let capture = options.capture(dataset)?;
        print_remarks(&capture.remarks);
        let photos = options.photos(dataset, &capture, Check::default())?;
        for skipped in photos.skipped() {
            eprintln!("warning: {skipped}; it is left out");
        }
        Ok((capture, photos))
    }
}

/// The photos that are held out. Commands give the options a help text of their own.
#[derive(Args, Clone, Copy, Debug)]
#[command(next_help_heading = "Photos")]
pub(crate) struct HeldOutArgs {
    /// Hold out every N-th photo (in the order of names); 0 for none
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) eval_every: u32,
    /// The first photo that is held out, from 0
    #[arg(long, value_name = "K", default_value_t = 0)]
    pub(crate) eval_from: u32,
}

impl HeldOutArgs {
    /// Returns the choice of photos.
    #[must_use]
    pub(crate) fn held_out(self) -> HeldOut {
        HeldOut { every: self.eval_every, from: self.eval_from }
    }
}
