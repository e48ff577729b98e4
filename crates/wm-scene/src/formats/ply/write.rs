//! Writing: the property order of the reference 3DGS writer, so that other programs read it.

use super::header::PlyEncoding;
use crate::splats::LabelKind;
use crate::{Group, Metadata, Scene};
use std::{fmt::Write as _, io::Write};
use wm_base::error::Problem;

/// Bytes gathered before they are written.
const BLOCK_BYTES: usize = 1 << 20;

/// Writes splats and metadata; views have no room in a PLY.
///
/// The order is x y z nx ny nz f_dc f_rest opacity scale rot, all `float`, then `uchar group` if
/// some splat is not [`Group::Scene`], and `ushort label` and `ushort instance` if splats have
/// them. nx ny nz is the shortest axis. Reading gives every stored value back bit by bit (in ASCII,
/// except for the payload of NaNs).
///
/// # Errors
/// If the arrays do not fit each other, there is no splat, the metadata has a fault, or `out`
/// fails.
pub(crate) fn write(out: &mut dyn Write, scene: &Scene, encoding: PlyEncoding) -> Result<(), Problem> {
    let splats = &scene.splats;
    splats.check()?;
    if splats.is_empty() {
        return Err(Problem::NoSplats);
    }
    let grouped = splats.groups.iter().any(|group| *group != Group::Scene);
    out.write_all(header(scene, encoding, grouped)?.as_bytes())?;

    let rest = splats.sh_stride() / 3 - 1;
    let mut row: Vec<f32> = Vec::new();
    let mut bytes = Vec::with_capacity(BLOCK_BYTES);
    for index in 0..splats.len() {
        let sh = splats.sh_of(index);
        row.clear();
        row.extend(splats.means[index]);
        row.extend(splats.normal(index).map(|v| v as f32));
        row.extend(&sh[..3]);
        for channel in 0..3 {
            row.extend((1..=rest).map(|coefficient| sh[coefficient * 3 + channel]));
        }
        row.push(splats.logit_opacities[index]);
        row.extend(splats.log_scales[index]);
        row.extend(splats.quats[index]);
        let group = grouped.then_some(splats.groups[index] as u8);
        let names = LabelKind::ALL.map(|kind| splats.names(kind).get(index).copied());
        let names = names.into_iter().flatten();
        match encoding {
            PlyEncoding::BinaryLittleEndian => {
                row.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
                bytes.extend(group);
                bytes.extend(names.flat_map(u16::to_le_bytes));
            }
            PlyEncoding::BinaryBigEndian => {
                row.iter().for_each(|v| bytes.extend(v.to_be_bytes()));
                bytes.extend(group);
                bytes.extend(names.flat_map(u16::to_be_bytes));
            }
            PlyEncoding::Ascii => {
                // `{:?}` gives the fewest digits that read back to the same value.
                for (column, value) in row.iter().enumerate() {
                    write!(bytes, "{}{value:?}", if column == 0 { "" } else { " " })?;
                }
                if let Some(group) = group {
                    write!(bytes, " {group}")?;
                }
                for name in names {
                    write!(bytes, " {name}")?;
                }
                bytes.push(b'\n');
            }
        }
        if bytes.len() + 2048 > BLOCK_BYTES {
            out.write_all(&bytes)?;
            bytes.clear();
        }
    }
    Ok(out.write_all(&bytes)?)
}

/// Comment lines of a header that hold metadata.
pub(super) fn metadata_lines(metadata: &Metadata) -> Result<String, Problem> {
    let entries = metadata.entries().map_err(|fault| Problem::Value(format!("not written: {fault}")))?;
    Ok(entries.iter().map(|(key, value)| format!("comment wm.{key} {value}\n")).collect())
}

fn header(scene: &Scene, encoding: PlyEncoding, grouped: bool) -> Result<String, Problem> {
    let mut text = format!("ply\nformat {} 1.0\n", encoding.keyword());
    text.push_str(&metadata_lines(&scene.metadata)?);
    // Writing to a string cannot fail.
    let _ = writeln!(text, "element vertex {}", scene.splats.len());
    let mut float = |name: &str| {
        let _ = writeln!(text, "property float {name}");
    };
    ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"].into_iter().for_each(&mut float);
    (0..scene.splats.sh_stride() - 3).for_each(|i| float(&format!("f_rest_{i}")));
    ["opacity", "scale_0", "scale_1", "scale_2"].into_iter().for_each(&mut float);
    ["rot_0", "rot_1", "rot_2", "rot_3"].into_iter().for_each(&mut float);
    if grouped {
        text.push_str("property uchar group\n");
    }
    for kind in LabelKind::ALL.into_iter().filter(|kind| !scene.splats.names(*kind).is_empty()) {
        let _ = writeln!(text, "property ushort {}", kind.name());
    }
    text.push_str("end_header\n");
    Ok(text)
}
