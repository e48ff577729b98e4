//! `.splat` of antimatter15's viewer: 32 bytes a splat and nothing else.
//!
//! # Layout
//! Mean and scales (standard deviations, not their logarithm) as six floats, red, green, blue and
//! opacity as bytes, and the quaternion wxyz as four bytes b that mean (b - 128) / 128. There is no
//! header: the name says what it is, and the length must be a multiple of 32. Its writers put what
//! counts most first.

use super::axes::Axes;
use super::bytes::{floats, rows};
use super::format::{SceneFormat, Writer, has_ending};
use super::loss::FormatLosses;
use super::pack::{byte_of_dc, byte_of_logit, dc_of_byte, logit_of_byte, unit};
use crate::{Scene, Splats};
use std::io::Write;
use wm_base::{
    error::{FormatError, Problem},
    source::Source,
};

/// The entry of [`FORMATS`](super::FORMATS).
pub(super) const FORMAT: SceneFormat = SceneFormat {
    name: "splat",
    extensions: &["splat"],
    about: "antimatter15's .splat, 32 bytes a splat, one colour from everywhere",
    axes: Axes::Ply,
    loses: FormatLosses {
        sh_degree: 0,
        rounding: "rotations 1 degree, colours and opacities 1/510 of 0-1",
        ..FormatLosses::SPLATS_ALONE
    },
    sniff: |start| has_ending(start.path, "splat"),
    read: |source, _| read(source),
    write: Writer::Stream(|out, scene, _| write(out, scene)),
};

/// Bytes of a splat.
const ROW_BYTES: usize = 32;

fn read(source: &mut Source) -> Result<Scene, FormatError> {
    let mut splats = Splats::with_capacity(source.remaining().unwrap_or(0) as usize / ROW_BYTES, 0);
    while source.fill(ROW_BYTES)? {
        let whole = source.bytes().len() / ROW_BYTES * ROW_BYTES;
        for row in rows::<ROW_BYTES>(&source.bytes()[..whole]) {
            let [x, y, z, a, b, c] = floats(row);
            splats.means.push([x, y, z]);
            splats.log_scales.push([a, b, c].map(f32::ln));
            splats.sh.extend([24, 25, 26].map(|at| dc_of_byte(row[at])));
            splats.logit_opacities.push(logit_of_byte(row[27]));
            splats.quats.push([28, 29, 30, 31].map(|at| (f32::from(row[at]) - 128.0) / 128.0));
        }
        source.consume(whole);
    }
    let over = source.bytes().len();
    if over > 0 {
        let what = format!("its last splat: a .splat has 32 bytes a splat, {over} are left over");
        return Err(source.whole(Problem::Cut(what)));
    }
    splats.groups = vec![Default::default(); splats.len()];
    Ok(Scene { splats, ..Scene::default() })
}

fn write(out: &mut dyn Write, scene: &Scene) -> Result<(), Problem> {
    let splats = &scene.splats;
    for index in 0..splats.len() {
        let mut row = [0; ROW_BYTES];
        let numbers = splats.means[index].into_iter().chain(splats.log_scales[index].map(f32::exp));
        for (slot, number) in row.as_chunks_mut::<4>().0.iter_mut().zip(numbers) {
            *slot = number.to_le_bytes();
        }
        let sh = splats.sh_of(index);
        for k in 0..3 {
            row[24 + k] = byte_of_dc(sh[k]);
        }
        row[27] = byte_of_logit(splats.logit_opacities[index]);
        for (slot, v) in row[28..].iter_mut().zip(unit(splats.quats[index])) {
            *slot = (v * 128.0 + 128.5).clamp(0.0, 255.0) as u8;
        }
        out.write_all(&row)?;
    }
    Ok(())
}
