//! Sensors by name: the files of `presets/` and `radar/presets/`, built in.

macro_rules! presets {
    ($(#[$doc:meta])* $list:ident, $folder:literal: $($name:literal),+ $(,)?) => {
        $(#[$doc])*
        pub const $list: &[(&str, &str)] =
            &[$(($name, include_str!(concat!($folder, $name, ".toml")))),+];
    };
}

presets! {
    /// Names and texts of the lidars that are built in.
    PRESETS, "presets/":
    "vlp-16", "hdl-32e", "hdl-64e", "os1-64", "os1-128", "pandar64", "at128", "mid-40", "waymo-top", "solid-state-1550",
}

presets! {
    /// Names and texts of the radars that are built in.
    RADAR_PRESETS, "radar/presets/":
    "long-range-77", "mid-range-77", "short-range-24",
}

/// The first line of each preset's text says what it is.
#[must_use]
pub fn about(text: &str) -> &str {
    text.lines().next().unwrap_or_default().trim_start_matches(['#', ' '])
}
