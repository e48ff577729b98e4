//! Light of surfaces that is found once, and how many rays are spent on that of a point.

use glam::DVec3;

/// The number of rays of a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Budget {
    pub(crate) sun: u32,
    pub(crate) sky: u32,
}

/// Irradiance of every larger surface, cell by cell.
#[derive(Clone, Debug, Default)]
pub(super) struct LightMap {
    /// First cell and cells along `a` and `b`, for each primitive; 0 by 0 for foliage and
    /// what is small.
    pub(super) grids: Vec<(u32, u16, u16)>,
    pub(super) cells: Vec<[f32; 3]>,
}

impl LightMap {
    pub(super) fn at(&self, which: usize, a: f64, b: f64) -> Option<DVec3> {
        let &(first, nu, nv) = self.grids.get(which)?;
        if nu == 0 {
            return None;
        }
        let cell = |value: f64, n: u16| ((value * f64::from(n)) as usize).min(usize::from(n) - 1);
        let index = first as usize + cell(b, nv) * usize::from(nu) + cell(a, nu);
        Some(DVec3::from_array(self.cells[index].map(f64::from)))
    }
}
