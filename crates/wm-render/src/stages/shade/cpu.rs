//! Spherical harmonics of sixteen splats at a time.

use crate::cpu::model::SplatGroup;
use crate::hooks::{AirGroup, GROUP, Medium, ShadeGroup};
use crate::plan::Shading;
use crate::simd::{self, Lanes, SimdPath, transpose};
use fearless_simd::{SimdBase, SimdFloat};
use wm_scene::sh::{C0, C1, C2, C3};

/// Fills `shade.rgb` for one group; `rest` holds its coefficients above 0, `[K - 1, 3]` rows.
#[inline(always)]
pub fn shade_group<S: Lanes>(simd: S, group: &SplatGroup, rest: &[[f32; GROUP]], shade: &mut ShadeGroup) {
    for first in (0..GROUP).step_by(S::N) {
        let mut rgb = [simd.set(0.5); 3];
        for channel in 0..3 {
            rgb[channel] = simd.load(&group.dc[channel][first..]).mul_add(simd.set(C0 as f32), rgb[channel]);
        }
        if !rest.is_empty() {
            let x = simd.load(&shade.direction[0][first..]);
            let y = simd.load(&shade.direction[1][first..]);
            let z = simd.load(&shade.direction[2][first..]);
            let degree1 = [y * (-C1 as f32), z * (C1 as f32), x * (-C1 as f32)];
            add(simd, &degree1, &rest[..9], first, &mut rgb);
            if rest.len() > 9 {
                let (xx, yy, zz) = (x * x, y * y, z * z);
                let degree2 = [
                    x * y * (C2[0] as f32),
                    y * z * (C2[1] as f32),
                    (zz + zz - xx - yy) * (C2[2] as f32),
                    x * z * (C2[3] as f32),
                    (xx - yy) * (C2[4] as f32),
                ];
                add(simd, &degree2, &rest[9..24], first, &mut rgb);
                if rest.len() > 24 {
                    let degree3 = [
                        y * (xx * 3.0 - yy) * (C3[0] as f32),
                        x * y * z * (C3[1] as f32),
                        y * (zz * 4.0 - xx - yy) * (C3[2] as f32),
                        z * (zz * 2.0 - (xx + yy) * 3.0) * (C3[3] as f32),
                        x * (zz * 4.0 - xx - yy) * (C3[4] as f32),
                        z * (xx - yy) * (C3[5] as f32),
                        x * (xx - yy * 3.0) * (C3[6] as f32),
                    ];
                    add(simd, &degree3, &rest[24..45], first, &mut rgb);
                }
            }
        }
        for channel in 0..3 {
            let value = rgb[channel].max(simd.set(0.0));
            value.store_slice(&mut shade.rgb[channel][first..first + S::N]);
        }
    }
}

/// Takes away the share `fade` of what depends on the direction in the colours of one group.
#[inline(always)]
pub(crate) fn fade_group<S: Lanes>(simd: S, group: &SplatGroup, fade: &[f32; GROUP], shade: &mut ShadeGroup) {
    for first in (0..GROUP).step_by(S::N) {
        let fade = simd.load(&fade[first..]);
        for channel in 0..3 {
            let even = simd.load(&group.dc[channel][first..]).mul_add(simd.set(C0 as f32), simd.set(0.5));
            let rgb = simd.load(&shade.rgb[channel][first..]);
            let value = (even.max(simd.set(0.0)) - rgb).mul_add(fade, rgb);
            value.store_slice(&mut shade.rgb[channel][first..first + S::N]);
        }
    }
}

/// Changes the light on one group: `gains` are factors on linear light, one array per channel.
#[inline(always)]
pub(crate) fn relight_group<S: Lanes>(simd: S, gains: [&[f32; GROUP]; 3], shade: &mut ShadeGroup) {
    for first in (0..GROUP).step_by(S::N) {
        let mut light = [simd.set(0.0); 3];
        for k in 0..3 {
            light[k] = simd.load(&shade.rgb[k][first..]);
        }
        light = simd::srgb_decode(simd, light);
        let limit = light[0].max(light[1]).max(light[2]).max(simd.set(1.0));
        for k in 0..3 {
            light[k] *= simd.load(&gains[k][first..]);
        }
        let brightest = light[0].max(light[1]).max(light[2]).max(limit);
        let scale = limit / brightest;
        for value in &mut light {
            *value *= scale;
        }
        let shown = simd::srgb_encode(simd, light);
        for k in 0..3 {
            shown[k].store_slice(&mut shade.rgb[k][first..first + S::N]);
        }
    }
}

/// Brings the first `count` values (3 K) of sixteen splats' coefficients in rows, as
/// [`shade_group`] takes them, coefficient 0 among them; rows beyond, up to a multiple of 16, hold
/// nothing of use. `sh` is `[N, stride]`.
#[inline(always)]
pub(crate) fn gather_rows<S: Lanes>(
    simd: S,
    sh: &[f32],
    stride: usize,
    count: usize,
    indices: &[u32; GROUP],
    rows: &mut [[f32; GROUP]; 48],
) {
    for (part, block) in rows.as_chunks_mut::<GROUP>().0.iter_mut().enumerate() {
        if part * GROUP >= count {
            break;
        }
        for (index, row) in indices.iter().zip(block.iter_mut()) {
            let values = &sh[*index as usize * stride + part * GROUP..];
            if let Some(whole) = values.first_chunk::<GROUP>() {
                *row = *whole;
            } else {
                row[..values.len()].copy_from_slice(values);
            }
        }
        transpose(simd, block);
    }
}

/// Changes the colours of `groups` to those seen from `origin` through the air, or to the shares of
/// light.
#[inline]
pub(crate) fn through_air(
    path: SimdPath,
    medium: Option<&dyn Medium>,
    shading: Shading,
    origin: [f32; 3],
    groups: &mut [ShadeGroup],
) {
    match (shading, medium) {
        (Shading::Color, None) => {}
        (Shading::Color, Some(medium)) => medium.shade(path, origin, groups),
        (Shading::Transmittance, None) => groups.iter_mut().for_each(|group| group.rgb = [[1.0; GROUP]; 3]),
        (Shading::Transmittance, Some(medium)) => {
            let mut air = [AirGroup::default(); GROUP];
            for groups in groups.chunks_mut(air.len()) {
                medium.evaluate(path, origin, groups, &mut air[..groups.len()]);
                for (group, air) in groups.iter_mut().zip(&air) {
                    group.rgb = air.transmittance;
                }
            }
        }
    }
}

#[inline(always)]
fn add<S: Lanes>(simd: S, basis: &[S::F], rows: &[[f32; GROUP]], first: usize, rgb: &mut [S::F; 3]) {
    for (k, weight) in basis.iter().enumerate() {
        for channel in 0..3 {
            let row = simd.load(&rows[3 * k + channel][first..]);
            rgb[channel] = row.mul_add(*weight, rgb[channel]);
        }
    }
}
