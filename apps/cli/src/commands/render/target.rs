//! The destination of the frames.

use super::args::RenderArgs;
use crate::names::stem_of;
use anyhow::{Result, bail};
use std::path::PathBuf;
use weather_magician::Weather;
use weather_magician::output::PictureFormat;
use wm_base::files::check_writable;

/// A destination of the frames.
pub(super) enum OutputTarget {
    Picture(PathBuf),
    Video(PathBuf),
    Folder(PathBuf),
}

impl OutputTarget {
    /// Returns the destination that is asked for, named after scene and weather if none is.
    pub(super) fn of(args: &RenderArgs, weather: &Weather) -> Result<Self> {
        let moves =
            args.camera.path.is_some() || args.output.seconds.is_some() || args.output.asks_for_frames();
        let name = || {
            let weather = if weather.name == "clear" { String::new() } else { format!("-{}", weather.name) };
            format!("{}{weather}", stem_of(&args.scene.scene))
        };
        let path = match &args.output.out {
            Some(path) => path.clone(),
            None => PathBuf::from(format!("{}.{}", name(), if moves { "mp4" } else { "png" })),
        };
        args.output.check_times()?;
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            _ if path.is_dir() || path.as_os_str().to_string_lossy().ends_with(['/', '\\']) => {
                Ok(Self::Folder(path))
            }
            Some("mp4") => Ok(Self::Video(path)),
            Some(_) if PictureFormat::of(&path).is_some() => Ok(Self::Picture(path)),
            None => Ok(Self::Folder(path)),
            Some(other) => bail!(
                "--out {}: a name that ends in .{other} cannot be written; use .png, .exr, .npy, .mp4 or a folder",
                path.display()
            ),
        }
    }

    /// Checks that the output can be written, as far as possible before rendering.
    pub(super) fn check(&self) -> Result<()> {
        match self {
            Self::Picture(path) | Self::Video(path) => check_writable(path)?,
            Self::Folder(path) if path.exists() && !path.is_dir() => bail!(
                "--out {}: is not a folder; give a folder, or a name that ends in .png, .exr, .npy or .mp4",
                path.display()
            ),
            Self::Folder(_) => {}
        }
        Ok(())
    }
}
