//! Lidars by name: the files of `presets/`, built in.

use crate::error::LidarError;
use crate::toml_file::advice;

macro_rules! presets {
    ($($name:literal),+ $(,)?) => {
        /// Names and texts of the presets.
        pub const PRESETS: &[(&str, &str)] =
            &[$(($name, include_str!(concat!("presets/", $name, ".toml")))),+];
    };
}

presets! {
    "vlp-16", "hdl-32e", "hdl-64e", "os1-64", "os1-128", "pandar64", "at128", "mid-40", "waymo-top", "solid-state-1550",
}

/// The first line of each preset's text says what it is.
#[must_use]
pub fn about(text: &str) -> &str {
    text.lines().next().unwrap_or_default().trim_start_matches(['#', ' '])
}

/// The error of a name that no preset has; `otherwise` is what else may be given.
pub(crate) fn unknown(name: &str, otherwise: &str) -> LidarError {
    LidarError::Unknown { name: name.into(), advice: advice(name, PRESETS, otherwise) }
}
