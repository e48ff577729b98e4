//! The 3DGS PLY: what the reference implementation of 3D Gaussian splatting writes.
//!
//! # Layout
//! One element `vertex` with x y z, nx ny nz (not read), f_dc_0..2, f_rest_* (all of red, then
//! green, then blue: 0, 9, 24 or 45), opacity (logit), scale_0..2 (logarithm) and rot_0..3 (wxyz).
//! The stored values are those of [`Splats`](crate::Splats), so nothing is converted but the order
//! of `f_rest`.
//!
//! # What else is read
//! Binary of either byte order and ASCII; properties in any order and of any number type; the
//! dialects of `dialect.rs`. Further properties and elements, lists too, are stepped over, and a
//! remark names the properties. `group` (any number type) is the [`Group`](crate::Group) of a
//! splat; numbers that no group has are the scene. `label` and `instance` (any number type, whole
//! numbers up to 65535, below 0 for none) are the [`LabelKind`](crate::splats::LabelKind)s of a
//! splat. Comment lines `comment wm.<key> <value>` are [`Metadata`](crate::Metadata), the value in
//! TOML; keys that are not known are left alone, so that files of later versions can be read; of
//! equal keys the last counts.
//!
//! # Memory
//! One block beside the arrays, and 12 bytes a splat where positions are finer than f32 (double
//! precision, text). The number of splats in the header is checked against the length of the file
//! before anything is allocated; where there is no length (pipes, ASCII) arrays grow with what was
//! read.

mod binary;
mod chunks;
pub(super) mod compressed;
mod dialect;
mod header;
mod layout;
mod points;
mod rows;
#[cfg(test)]
mod tests;
mod text;
mod write;

use super::axes::Axes;
use super::format::{ReadOptions, SceneFormat, Writer};
use super::loss::FormatLosses;
use crate::{Scene, origin};
pub(crate) use header::PlyEncoding;
use header::{Endian, Header};
use layout::Layout;
pub use points::read_points;
use wm_base::{
    error::{FormatError, Problem},
    source::Source,
};
pub(crate) use write::write;

/// The entry of [`FORMATS`](super::FORMATS).
pub(super) const FORMAT: SceneFormat = SceneFormat {
    name: "PLY",
    extensions: &["ply"],
    about: "3D Gaussian splatting PLY, binary or ASCII, SH degree 0 to 3",
    axes: Axes::Ply,
    loses: FormatLosses::NOTHING,
    sniff: |start| is_ply(start.bytes) && !chunks::is_named(start.bytes),
    read,
    write: Writer::Stream(|out, scene, _| write(out, scene, PlyEncoding::default())),
};

/// Returns true if these first bytes are those of a PLY.
fn is_ply(start: &[u8]) -> bool {
    start.strip_prefix(b"ply").is_some_and(|rest| rest.first().is_none_or(u8::is_ascii_whitespace))
}

fn read(source: &mut Source, _: &ReadOptions) -> Result<Scene, FormatError> {
    let header = Header::parse(source)?;
    if chunks::is_compressed(&header) {
        return chunks::read(source, header);
    }
    let layout = Layout::of(&header).map_err(|problem| source.whole(problem))?;
    if header.elements[layout.element].count == 0 {
        return Err(source.whole(Problem::NoSplats));
    }
    let mut rows = match header.encoding {
        PlyEncoding::BinaryLittleEndian => binary::read(source, &header, &layout, Endian::Little),
        PlyEncoding::BinaryBigEndian => binary::read(source, &header, &layout, Endian::Big),
        PlyEncoding::Ascii => text::read(source, &header, &layout),
    }?;
    // Before sizes are made of distances.
    let moved_by = origin::subtract_fine(&mut rows.splats, &rows.residues, &header.metadata);
    let kept: Vec<usize> = layout.columns.iter().map(|column| column.property).collect();
    let (splats, remarks) = layout.dialect.finish(rows, &header.elements[layout.element], &kept);
    Ok(Scene { splats, metadata: header.metadata, remarks, moved_by, ..Scene::default() })
}
