//! The compressed PLY of PlayCanvas and SuperSplat as a format of its own.

use super::chunks::{MAX_LOG_SCALE, is_named, write};
use crate::formats::{Axes, FormatLosses, Retention, SceneFormat, Writer};

/// The entry of [`FORMATS`](crate::formats::FORMATS); the entry of the plain PLY reads it too,
/// where comments hide what it is.
pub(crate) const FORMAT: SceneFormat = SceneFormat {
    name: "compressed PLY",
    extensions: &["compressed.ply"],
    about: "PlayCanvas compressed PLY, 16 bytes a splat",
    axes: Axes::Ply,
    loses: FormatLosses {
        metadata: Retention::Inside,
        rounding: "positions 1/4094 and scales 1/2046 of the range of 256 neighbours, rotations 0.25 degrees, colours and opacities \
                   1/510, SH 1/64",
        order: Retention::Not,
        log_scales: [-MAX_LOG_SCALE, MAX_LOG_SCALE],
        ..FormatLosses::SPLATS_ALONE
    },
    sniff: |start| super::is_ply(start.bytes) && is_named(start.bytes),
    read: super::read,
    write: Writer::Stream(|out, scene, _| write(out, scene)),
};
