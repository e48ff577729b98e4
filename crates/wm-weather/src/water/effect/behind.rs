//! The picture behind the water and before it, by groups of pixels.

use crate::linear_picture::convert;
use fearless_simd::{Select, SimdBase};
use wm_render::hooks::GROUP;
use wm_render::simd::{Lanes, SimdPath};
use wm_render::{FRONT_CHANNELS, dispatch};

/// Transmittance to the surface below which it is invisible.
const MIN_TRANSMITTANCE: f32 = 1.0 / 512.0;

/// Sixteen pixels without what is before the water.
pub(super) struct Behind {
    /// View z of the water, NaN where none is seen, and of where the ray ends without it.
    pub(super) z: [f32; GROUP],
    pub(super) bottom: [f32; GROUP],
    /// Share of light that gets past what is before the water.
    pub(super) open: [f32; GROUP],
    /// Share of what is behind that splats fill.
    pub(super) filled: [f32; GROUP],
    /// Display-referred colour of what is behind.
    pub(super) light: [[f32; GROUP]; 3],
}

impl Behind {
    pub(super) fn new() -> Self {
        let zero = [0.0; GROUP];
        Self { z: [f32::NAN; GROUP], bottom: zero, open: zero, filled: zero, light: [zero; 3] }
    }

    /// Finds it for as many pixels as there are lanes from `start` on.
    #[inline(always)]
    pub(super) fn find<S: Lanes>(
        &mut self,
        simd: S,
        start: usize,
        drawn: &[[f32; GROUP]; 3],
        before: &[[f32; GROUP]; FRONT_CHANNELS],
        alpha: &[f32; GROUP],
        z: &[f32; GROUP],
    ) {
        let own = start..start + S::N;
        let (zero, one) = (simd.set(0.0), simd.set(1.0));
        let (near, z) = (simd.load(&before[4][start..]), simd.load(&z[start..]));
        let open = one - near;
        open.store_slice(&mut self.open[own.clone()]);
        let is_seen = open.simd_ge(simd.set(MIN_TRANSMITTANCE));
        is_seen.select(z, simd.set(f32::NAN)).store_slice(&mut self.z[own.clone()]);
        let scale = one / open.max(simd.set(MIN_TRANSMITTANCE));
        for k in 0..3 {
            let light = (simd.load(&drawn[k][start..]) - simd.load(&before[k][start..])) * scale;
            light.max(zero).store_slice(&mut self.light[k][own.clone()]);
        }
        let behind = simd.load(&alpha[start..]) - near;
        (behind * scale).max(zero).min(one).store_slice(&mut self.filled[own.clone()]);
        // Thin splats say little of how deep the bottom is.
        let bottom = (behind / simd.load(&before[3][start..]).max(simd.set(1e-9))).max(z);
        let is_solid = behind.simd_gt(open * 1e-3);
        is_solid.select(bottom, z).store_slice(&mut self.bottom[own]);
    }
}

/// Notes that nothing is reflected in groups of pixels of a row.
#[inline(always)]
pub(super) fn clear(front: &mut [f32]) {
    for group in front.chunks_mut(FRONT_CHANNELS * GROUP) {
        let count = group.len() / FRONT_CHANNELS;
        group[..count].fill(0.0);
    }
}

/// The first of so many numbers, and `rest` where there are fewer.
#[inline(always)]
pub(super) fn padded<const N: usize>(values: &[f32], rest: f32) -> [f32; N] {
    if let Some(whole) = values.first_chunk::<N>() {
        return *whole;
    }
    let mut all = [rest; N];
    all[..values.len()].copy_from_slice(values);
    all
}

/// One array per number of up to sixteen pixels of `N` numbers; sixteen have `ALL` numbers.
#[inline(always)]
pub(super) fn columns<const N: usize, const ALL: usize>(pixels: &[f32]) -> [[f32; GROUP]; N] {
    let mut columns = [[0.0; GROUP]; N];
    if let Some(pixels) = pixels.first_chunk::<ALL>() {
        for i in 0..GROUP {
            for k in 0..N {
                columns[k][i] = pixels[N * i + k];
            }
        }
        return columns;
    }
    for (i, pixel) in pixels.as_chunks::<N>().0.iter().enumerate() {
        for k in 0..N {
            columns[k][i] = pixel[k];
        }
    }
    columns
}

/// Lays particles over a row: they are light and coverage, in linear light.
pub(super) fn lay_particles(path: SimdPath, line: &mut [f32], particles: &[f32]) {
    let (pixels, _) = line.as_chunks_mut::<3>();
    let (falls, _) = particles.as_chunks::<4>();
    for (pixels, falls) in pixels.chunks_mut(GROUP).zip(falls.chunks(GROUP)) {
        if falls.iter().all(|fall| fall[3] == 0.0) {
            continue;
        }
        let mut light = [[0.0f32; GROUP]; 3];
        for (i, pixel) in pixels.iter().enumerate() {
            (0..3).for_each(|k| light[k][i] = pixel[k].max(0.0));
        }
        dispatch!(path, s => convert::<_, false>(s, &mut light));
        for (i, fall) in falls.iter().enumerate() {
            (0..3).for_each(|k| light[k][i] = light[k][i] * (1.0 - fall[3]) + fall[k]);
        }
        dispatch!(path, s => convert::<_, true>(s, &mut light));
        for (i, (pixel, fall)) in pixels.iter_mut().zip(falls).enumerate() {
            if fall[3] > 0.0 {
                *pixel = [light[0][i], light[1][i], light[2][i]];
            }
        }
    }
}
