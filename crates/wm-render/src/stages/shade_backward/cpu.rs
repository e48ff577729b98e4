//! The derivative of spherical harmonics, sixteen splats at a time.

use crate::hooks::GROUP;
use crate::simd::Lanes;
use fearless_simd::{SimdBase, SimdFloat};
use wm_scene::sh::{C0, C1, C2, C3};

/// The results of [`shade_backward_group`] for sixteen splats.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct ShadeGradients {
    /// By the coefficients, `[K, 3]` rows.
    pub(crate) sh: [[f32; GROUP]; 48],
    /// By the direction.
    pub(crate) direction: [[f32; GROUP]; 3],
}

impl Default for ShadeGradients {
    fn default() -> Self {
        Self { sh: [[0.0; GROUP]; 48], direction: [[0.0; GROUP]; 3] }
    }
}

/// `sh` holds the coefficients in use, `[K, 3]` rows of sixteen splats seen in `directions`;
/// `by_rgb` the derivatives by their colours.
#[inline(always)]
pub(crate) fn shade_backward_group<S: Lanes>(
    simd: S,
    sh: &[[f32; GROUP]],
    directions: &[[f32; GROUP]; 3],
    by_rgb: &[[f32; GROUP]; 3],
    out: &mut ShadeGradients,
) {
    for first in (0..GROUP).step_by(S::N) {
        let (x, y, z) = (
            simd.load(&directions[0][first..]),
            simd.load(&directions[1][first..]),
            simd.load(&directions[2][first..]),
        );
        let by =
            [simd.load(&by_rgb[0][first..]), simd.load(&by_rgb[1][first..]), simd.load(&by_rgb[2][first..])];
        let mut work = Work::<S> { simd, sh, by, first, direction: [simd.set(0.0); 3], out: &mut out.sh };
        let zero = simd.set(0.0);
        work.add(0, simd.set(C0 as f32), [zero; 3]);
        if sh.len() > 3 {
            let c1 = simd.set(C1 as f32);
            work.add(1, -(y * c1), [zero, -c1, zero]);
            work.add(2, z * c1, [zero, zero, c1]);
            work.add(3, -(x * c1), [-c1, zero, zero]);
        }
        if sh.len() > 12 {
            let (xx, yy, zz) = (x * x, y * y, z * z);
            let c = C2.map(|c| c as f32);
            work.add(4, x * y * c[0], [y * c[0], x * c[0], zero]);
            work.add(5, y * z * c[1], [zero, z * c[1], y * c[1]]);
            work.add(6, (zz + zz - xx - yy) * c[2], [x * (-2.0 * c[2]), y * (-2.0 * c[2]), z * (4.0 * c[2])]);
            work.add(7, x * z * c[3], [z * c[3], zero, x * c[3]]);
            work.add(8, (xx - yy) * c[4], [x * (2.0 * c[4]), y * (-2.0 * c[4]), zero]);
            if sh.len() > 27 {
                let c = C3.map(|c| c as f32);
                let (xy, yz, xz) = (x * y, y * z, x * z);
                let apart = xx - yy;
                let four = zz * 4.0 - xx - yy;
                work.add(9, y * (xx * 3.0 - yy) * c[0], [xy * (6.0 * c[0]), apart * (3.0 * c[0]), zero]);
                work.add(10, xy * z * c[1], [yz * c[1], xz * c[1], xy * c[1]]);
                work.add(
                    11,
                    y * four * c[2],
                    [xy * (-2.0 * c[2]), (four - yy * 2.0) * c[2], yz * (8.0 * c[2])],
                );
                let wide = (xx + yy) * 3.0;
                let slopes = [xz * (-6.0 * c[3]), yz * (-6.0 * c[3]), (zz * 6.0 - wide) * c[3]];
                work.add(12, z * (zz * 2.0 - wide) * c[3], slopes);
                work.add(
                    13,
                    x * four * c[4],
                    [(four - xx * 2.0) * c[4], xy * (-2.0 * c[4]), xz * (8.0 * c[4])],
                );
                work.add(14, z * apart * c[5], [xz * (2.0 * c[5]), yz * (-2.0 * c[5]), apart * c[5]]);
                work.add(15, x * (xx - yy * 3.0) * c[6], [apart * (3.0 * c[6]), xy * (-6.0 * c[6]), zero]);
            }
        }
        for k in 0..3 {
            work.direction[k].store_slice(&mut out.direction[k][first..first + S::N]);
        }
    }
}

struct Work<'a, S: Lanes> {
    simd: S,
    sh: &'a [[f32; GROUP]],
    by: [S::F; 3],
    first: usize,
    direction: [S::F; 3],
    out: &'a mut [[f32; GROUP]; 48],
}

impl<S: Lanes> Work<'_, S> {
    /// Adds basis function `k` of value `basis` and the given slopes.
    #[inline(always)]
    fn add(&mut self, k: usize, basis: S::F, slopes: [S::F; 3]) {
        let lanes = self.first..self.first + S::N;
        let mut pull = self.simd.set(0.0);
        for c in 0..3 {
            let row = self.simd.load(&self.sh[3 * k + c][self.first..]);
            pull = row.mul_add(self.by[c], pull);
            (basis * self.by[c]).store_slice(&mut self.out[3 * k + c][lanes.clone()]);
        }
        for axis in 0..3 {
            self.direction[axis] = slopes[axis].mul_add(pull, self.direction[axis]);
        }
    }
}
