//! glTF 2.0 with `KHR_gaussian_splatting`: splats as a primitive of points, in activated form.
//!
//! # Layout
//! Accessors of a primitive of mode POINTS: `POSITION`, and with the prefix
//! `KHR_gaussian_splatting:` `ROTATION` (xyzw), `SCALE` (standard deviations), `OPACITY` (0-1) and
//! `SH_DEGREE_l_COEF_n`. Drafts of the extension had logarithms in `SCALE`: they are told by a
//! negative one. Nodes may turn, move and scale what they hold, alike in all directions.
//!
//! Colours are sRGB or linear light, as the extension states; those of linear light become sRGB.
//!
//! With `KHR_gaussian_splatting_compression_spz_2` (a draft, which had other names before) the
//! primitive has an SPZ instead, whose axes are turned as SPZ's library does for the axes LUF.
//! CesiumJS 1.140 does not turn them, and neither do files that are made for it: they state no
//! kernel.
//!
//! Read are `.glb` and `.gltf` with buffers inside or in files below its folder; a `.glb` is
//! written, as floats or with SPZ. It keeps the metadata in `asset.extras.wm` and groups in an
//! attribute `_GROUP`. The local origin of a scene is the translation of its node too, for other
//! programs; where the metadata state it, it is taken off again.

mod kind;
mod read;
mod words;
mod write;

use super::format::{SceneFormat, Writer, has_ending};
use super::loss::FormatLosses;

/// The entry of [`FORMATS`](super::FORMATS).
pub(super) const FORMAT: SceneFormat = SceneFormat {
    name: "glTF",
    extensions: &["glb"],
    about: "glTF 2.0 with KHR_gaussian_splatting (.glb, .gltf), as floats or SPZ",
    axes: words::AXES,
    loses: FormatLosses {
        labels: super::Retention::Not,
        rounding: "opacities and scales 1e-7 of their value",
        ..FormatLosses::NOTHING
    },
    sniff: |start| start.bytes.starts_with(words::MAGIC) || has_ending(start.path, "gltf"),
    read: |source, _| source.parsed(read::read),
    write: Writer::Stream(write::write),
};

/// The losses of a file whose splats are in an SPZ.
pub(super) const PACKED_LOSES: FormatLosses = FormatLosses {
    groups: super::Retention::Inside,
    metadata: super::Retention::Inside,
    ..super::spz::FORMAT.loses
};
