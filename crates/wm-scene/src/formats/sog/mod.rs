//! SOG of PlayCanvas: splats as pixels of lossless WebP pictures beside a `meta.json`; as files of
//! a folder or in one ZIP.
//!
//! # Layout
//! Pixel i of every picture is splat i, row by row.
//!
//! | picture | channels | version 2 | version 1 |
//! |---|---|---|---|
//! | `means` low, high | rgb | 16 bits of a range; the value v means sign(v) (exp\|v\| - 1) | the same |
//! | `scales` | rgb | index into 256 logarithms | of a range per axis |
//! | `quats` | rgba | alpha - 252 is the place (wxyz) of the largest, rgb the others over +-1/sqrt(2) | the same |
//! | `sh0` | rgba | index into 256 coefficients; alpha is the opacity | of a range per channel; alpha is the logit |
//! | `shN` labels | rg | 16-bit index into a palette | the same |
//! | `shN` centroids | rgb | the palette, 64 entries per row, a pixel per coefficient: index into 256 values | of one range |
//!
//! The levels of a `lod-meta.json` are runs of splats in several SOG folders below it; what is
//! chosen is one level everywhere, with the splats of its environment.
//!
//! Version 2 is written. What is left to a writer is in `write.rs`: order, tables and the palette
//! of SH (`palette.rs`), which axis is called which (`rotation.rs`), and how pictures are packed
//! (`webp.rs`).

mod palette;
pub(crate) mod read;
mod rotation;
mod webp;
pub(crate) mod write;
pub(crate) mod zip;

use super::axes::Axes;
use super::format::{SceneFormat, Writer, has_ending};
use super::loss::{FormatLosses, Retention};

#[cfg(test)]
pub(super) use {
    rotation::{NAMINGS, product},
    write::{Steps, order},
};

/// The losses of SOG.
pub(super) const LOSES: FormatLosses = FormatLosses {
    metadata: Retention::Inside,
    rounding: "positions 1/131070 of the scene's extent in logarithm (1 + their value), scales and colours to 256 values, rotations 1 \
               degree, opacities 1/510, SH to a palette of 65536",
    order: Retention::Not,
    coarse: write::coarse_steps,
    ..FormatLosses::SPLATS_ALONE
};

/// The bundle, one ZIP.
pub(super) mod bundle {
    use super::{Axes, LOSES, SceneFormat, Writer, read, write, zip};

    /// The entry of [`FORMATS`](crate::formats::FORMATS).
    pub(in crate::formats) const FORMAT: SceneFormat = SceneFormat {
        name: "SOG",
        extensions: &["sog"],
        about: "PlayCanvas SOG, versions 1 and 2, in one file",
        axes: Axes::Ply,
        loses: LOSES,
        sniff: |start| read::is_bundle(start.bytes),
        read: |source, _| source.parsed(|bytes, _| read::read(&zip::Archive::new(bytes)?)),
        write: Writer::Stream(|out, scene, _| {
            let mut archive = zip::Writer::new(out);
            write::files(scene, &mut |file| archive.add(file.name, &file.bytes))?;
            archive.finish()
        }),
    };
}

/// The folder, read and written by its `meta.json`.
pub(super) mod folder {
    use super::{Axes, LOSES, SceneFormat, Writer, has_ending, read, write};

    /// The entry of [`FORMATS`](crate::formats::FORMATS).
    pub(in crate::formats) const FORMAT: SceneFormat = SceneFormat {
        name: "SOG folder",
        extensions: &["meta.json"],
        about: "PlayCanvas SOG, versions 1 and 2, as a folder: its meta.json",
        axes: Axes::Ply,
        loses: LOSES,
        sniff: |start| has_ending(start.path, "meta.json"),
        read: |source, _| source.parsed(|meta, main| read::read_folder(main, meta)),
        write: Writer::Files(write::files),
    };
}
