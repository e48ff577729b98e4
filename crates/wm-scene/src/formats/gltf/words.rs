//! Numbers, names and axes of the format.

use crate::formats::axes::Axes;

pub(super) const AXES: Axes = Axes::YUpZForward;
pub(super) const MAGIC: &[u8] = b"glTF";

/// Types of chunks.
pub(super) const JSON: u32 = 0x4e4f_534a;
pub(super) const BIN: u32 = 0x004e_4942;
pub(super) const SPLATTING: &str = "KHR_gaussian_splatting";
pub(super) const SPZ: &str = "KHR_gaussian_splatting_compression_spz_2";
/// Component type `FLOAT`.
pub(super) const FLOAT: u32 = 5126;
/// Component type `UNSIGNED_BYTE`.
pub(super) const UNSIGNED_BYTE: u32 = 5121;

/// The name of an attribute of the extension.
pub(super) fn attribute(name: &str) -> String {
    format!("{SPLATTING}:{name}")
}

/// The name of the attribute of an SH coefficient.
pub(super) fn sh_attribute(coefficient: usize) -> String {
    let degree = (0..4).rfind(|d| d * d <= coefficient).unwrap_or(0);
    attribute(&format!("SH_DEGREE_{degree}_COEF_{}", coefficient - degree * degree))
}
