//! Projection of sixteen splats at a time, and culling of 256.

use super::{
    DILATION, FLATTENING, LOG2_MIN_ALPHA, MAX_DET, MAX_LYING_SHARE, MIN_COMPENSATION, MIN_STANDING_SHARE,
    ProjectCamera, Record, SLOPE_DILATION, SQRT_HALF_LOG2E, TEST_SLACK, pack_slopes,
};
use crate::cpu::model::{Cluster, SplatGroup};
use crate::hooks::{GROUP, PATCH, ShadeGroup};
use crate::simd::{Lanes, log2};
use fearless_simd::{Select, SimdBase, SimdFloat, SimdMask};
use std::f32::consts::LN_2;
use wm_scene::Rasterization;

/// The projections of sixteen splats, one array a number; see [`super::Record`].
#[derive(Clone, Debug, Default)]
#[repr(C, align(64))]
pub struct ProjectedGroup {
    /// Centre, px.
    pub(crate) x: [f32; GROUP],
    /// Centre, px.
    pub(crate) y: [f32; GROUP],
    /// `u = ux dx`.
    pub(crate) ux: [f32; GROUP],
    /// `v = vx dx + vy dy`.
    pub(crate) vx: [f32; GROUP],
    /// See `vx`.
    pub(crate) vy: [f32; GROUP],
    /// log2 of the opacity at the centre.
    pub(crate) log2_opacity: [f32; GROUP],
    /// View z, scene units.
    pub(crate) depth: [f32; GROUP],
    /// The dy at which alpha is largest for dx = 1.
    pub(crate) slope_y: [f32; GROUP],
    /// The dx at which alpha is largest for dy = 1.
    pub(crate) slope_x: [f32; GROUP],
    /// First and last column of patches that the box of alpha >= 1/255 touches.
    pub(crate) columns: [[u32; GROUP]; 2],
    /// First and last row of them.
    pub(crate) rows: [[u32; GROUP]; 2],
    /// World axes, towards the camera.
    pub(crate) normal: [[f32; GROUP]; 3],
    /// Slopes of the reciprocal depth, packed by [`super::pack_slopes`]. Filled only if a surface
    /// splits the blend.
    pub(crate) slopes: [u32; GROUP],
    /// A bit for each splat that is in view.
    pub(crate) mask: u32,
}

/// The places and shapes of splats in the picture: one vector a number.
#[derive(Clone, Copy)]
pub(crate) struct GroupGeometry<S: Lanes> {
    /// Mean less camera centre, world axes.
    pub(crate) offset: [S::F; 3],
    /// View z.
    pub(crate) z: S::F,
    /// 1 / z.
    pub(crate) inverse_z: S::F,
    /// X / z and Y / z.
    pub(crate) tangents: [S::F; 2],
    /// X / z and Y / z, clamped to the limits of the Jacobian.
    pub(crate) held: [S::F; 2],
    /// Columns of R.
    pub(crate) columns: [[S::F; 3]; 3],
    /// Standard deviations.
    pub(crate) scales: [S::F; 3],
    /// Columns of J W R, not scaled, row by row.
    pub(crate) unscaled: [[S::F; 3]; 2],
    /// M = J W R diag(s), row by row.
    pub(crate) m: [[S::F; 3]; 2],
    /// xx, xy, yy of the dilated covariance, px^2.
    pub(crate) cov: [S::F; 3],
    /// Determinant of M M^T.
    pub(crate) sharp: S::F,
    /// Determinant of `cov`.
    pub(crate) det: S::F,
}

/// The geometry of the splats of `group` from lane `first` on.
#[inline(always)]
pub(crate) fn geometry<S: Lanes>(
    simd: S,
    group: &SplatGroup,
    first: usize,
    camera: &ProjectCamera,
) -> GroupGeometry<S> {
    let [c0, c1, c2] = camera.center;
    let (dx, dy, dz) = (
        simd.load(&group.mean[0][first..]) - c0,
        simd.load(&group.mean[1][first..]) - c1,
        simd.load(&group.mean[2][first..]) - c2,
    );
    let w = &camera.rotation;
    let view_x = dx.mul_add(simd.set(w[0][0]), dy.mul_add(simd.set(w[0][1]), dz * w[0][2]));
    let view_y = dx.mul_add(simd.set(w[1][0]), dy.mul_add(simd.set(w[1][1]), dz * w[1][2]));
    let z = dx.mul_add(simd.set(w[2][0]), dy.mul_add(simd.set(w[2][1]), dz * w[2][2]));
    let inverse_z = simd.set(1.0) / z;
    let tangents = [view_x * inverse_z, view_y * inverse_z];
    let mut held = tangents;
    for k in 0..2 {
        held[k] = tangents[k].max(simd.set(camera.low[k])).min(simd.set(camera.high[k]));
    }

    // Rows of J W, times z.
    let (scale_x, scale_y) = (inverse_z * camera.focal[0], inverse_z * camera.focal[1]);
    let mut row_x = [simd.set(0.0); 3];
    let mut row_y = [simd.set(0.0); 3];
    for k in 0..3 {
        row_x[k] = scale_x * (simd.set(w[0][k]) - held[0] * w[2][k]);
        row_y[k] = scale_y * (simd.set(w[1][k]) - held[1] * w[2][k]);
    }

    // Columns of R, and M = J W R diag(s) column by column.
    let (qw, qx) = (simd.load(&group.quat[0][first..]), simd.load(&group.quat[1][first..]));
    let (qy, qz) = (simd.load(&group.quat[2][first..]), simd.load(&group.quat[3][first..]));
    let (x2, y2, z2) = (qx + qx, qy + qy, qz + qz);
    let (xx, yy, zz) = (qx * x2, qy * y2, qz * z2);
    let (xy, xz, yz) = (qx * y2, qx * z2, qy * z2);
    let (wx, wy, wz) = (qw * x2, qw * y2, qw * z2);
    let one = simd.set(1.0);
    let columns = [
        [one - (yy + zz), xy + wz, xz - wy],
        [xy - wz, one - (xx + zz), yz + wx],
        [xz + wy, yz - wx, one - (xx + yy)],
    ];
    let scales = [
        simd.load(&group.scale[0][first..]),
        simd.load(&group.scale[1][first..]),
        simd.load(&group.scale[2][first..]),
    ];
    let mut unscaled = [[simd.set(0.0); 3]; 2];
    let mut m = unscaled;
    for k in 0..3 {
        let c = &columns[k];
        unscaled[0][k] = c[0].mul_add(row_x[0], c[1].mul_add(row_x[1], c[2] * row_x[2]));
        unscaled[1][k] = c[0].mul_add(row_y[0], c[1].mul_add(row_y[1], c[2] * row_y[2]));
        m[0][k] = scales[k] * unscaled[0][k];
        m[1][k] = scales[k] * unscaled[1][k];
    }
    let [m_x, m_y] = m;
    let cov_xx = m_x[0].mul_add(m_x[0], m_x[1].mul_add(m_x[1], m_x[2] * m_x[2]));
    let cov_xy = m_x[0].mul_add(m_y[0], m_x[1].mul_add(m_y[1], m_x[2] * m_y[2]));
    let cov_yy = m_y[0].mul_add(m_y[0], m_y[1].mul_add(m_y[1], m_y[2] * m_y[2]));
    let d01 = m_x[0].mul_sub(m_y[1], m_x[1] * m_y[0]);
    let d02 = m_x[0].mul_sub(m_y[2], m_x[2] * m_y[0]);
    let d12 = m_x[1].mul_sub(m_y[2], m_x[2] * m_y[1]);
    let sharp = d01.mul_add(d01, d02.mul_add(d02, d12 * d12));
    let trace = cov_xx + cov_yy;
    let det = trace.mul_add(simd.set(DILATION), sharp + DILATION * DILATION);
    GroupGeometry {
        offset: [dx, dy, dz],
        z,
        inverse_z,
        tangents,
        held,
        columns,
        scales,
        unscaled,
        m,
        cov: [cov_xx + DILATION, cov_xy, cov_yy + DILATION],
        sharp,
        det,
    }
}

/// The Cholesky factor of `geometry`'s exponent: ux, vx, vy; see [`super::Record`].
#[inline(always)]
pub(crate) fn factor<S: Lanes>(simd: S, geometry: &GroupGeometry<S>) -> [S::F; 3] {
    let [cov_xx, cov_xy, _] = geometry.cov;
    let vy = (cov_xx / geometry.det).sqrt() * SQRT_HALF_LOG2E;
    let ux = simd.set(SQRT_HALF_LOG2E) / cov_xx.sqrt();
    [ux, -(vy * (cov_xy / cov_xx)), vy]
}

/// Slopes of a splat's reciprocal depth over the picture, along x and y, 1/(scene units px). Its
/// depth at a pixel is the view z at which it is densest along the ray, after it is flattened along
/// `normal` about its centre; that of a flat splat is the depth of its plane.
#[inline(always)]
fn reciprocal_slopes<S: Lanes>(
    simd: S,
    geometry: &GroupGeometry<S>,
    camera: &ProjectCamera,
    normal: [f32; 3],
) -> [S::F; 2] {
    let zero = simd.set(0.0);
    // Along the splat's own axes, of unit variance: columns, rows and view z of the picture, and
    // the height.
    let (mut deep, mut height) = ([zero; 3], [zero; 3]);
    for (row, to) in [(camera.rotation[2], &mut deep), (normal, &mut height)] {
        for k in 0..3 {
            let c = &geometry.columns[k];
            let along = c[0].mul_add(simd.set(row[0]), c[1].mul_add(simd.set(row[1]), c[2] * row[2]));
            to[k] = along * geometry.scales[k];
        }
    }
    let product = |a: &[S::F; 3], b: &[S::F; 3]| a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]));
    let high = product(&height, &height).max(simd.set(1e-30));
    let share = high / product(&geometry.scales, &geometry.scales).max(simd.set(1e-30));
    let lies = ((simd.set(MIN_STANDING_SHARE) - share) * (1.0 / (MIN_STANDING_SHARE - MAX_LYING_SHARE)))
        .max(zero)
        .min(simd.set(1.0));
    let flat = lies * -FLATTENING / high;
    let [mut m_x, mut m_y] = geometry.m;
    for row in [&mut m_x, &mut m_y, &mut deep] {
        let less = product(&height, row) * flat;
        for k in 0..3 {
            row[k] = height[k].mul_add(less, row[k]);
        }
    }
    let (with_x, with_y) = (product(&deep, &m_x), product(&deep, &m_y));
    let (xx, xy, yy) = (product(&m_x, &m_x), product(&m_x, &m_y), product(&m_y, &m_y));
    let mut sharp = zero;
    for (i, j) in [(0, 1), (0, 2), (1, 2)] {
        let minor = m_x[i].mul_sub(m_y[j], m_x[j] * m_y[i]);
        sharp = minor.mul_add(minor, sharp);
    }
    let det = (xx + yy).mul_add(simd.set(SLOPE_DILATION), sharp + SLOPE_DILATION * SLOPE_DILATION);
    let (xx, yy) = (xx + SLOPE_DILATION, yy + SLOPE_DILATION);
    let scale = -(geometry.inverse_z * geometry.inverse_z) / det;
    [with_x.mul_sub(yy, with_y * xy) * scale, with_y.mul_sub(xx, with_x * xy) * scale]
}

/// Unit direction and length of `offset`.
#[inline(always)]
pub(crate) fn ray<S: Lanes>(simd: S, offset: &[S::F; 3]) -> ([S::F; 3], S::F) {
    let [x, y, z] = *offset;
    let distance = x.mul_add(x, y.mul_add(y, z * z)).sqrt();
    let inverse = simd.set(1.0) / distance;
    ([x * inverse, y * inverse, z * inverse], distance)
}

/// The shortest axis (the first of equal ones): selects it of three vectors.
#[inline(always)]
pub(crate) fn shortest<S: Lanes>(scales: &[S::F; 3], of: [S::F; 3]) -> S::F {
    let second = scales[1].simd_lt(scales[0]);
    let third = scales[2].simd_lt(scales[0].min(scales[1]));
    third.select(of[2], second.select(of[1], of[0]))
}

/// The factor 1 or -1 that turns `normal` towards the camera.
#[inline(always)]
pub(crate) fn facing<S: Lanes>(simd: S, normal: &[S::F; 3], offset: &[S::F; 3]) -> S::F {
    let along = normal[0].mul_add(offset[0], normal[1].mul_add(offset[1], normal[2] * offset[2]));
    along.simd_gt(simd.set(0.0)).select(simd.set(-1.0), simd.set(1.0))
}

/// Projects one group. `visibility` is a factor on the opacity of each splat, `split` the normal of
/// a surface that splits the blend; `shade` gets the rays.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "few callers; a struct would only repeat the names")]
pub fn project_group<S: Lanes>(
    simd: S,
    group: &SplatGroup,
    camera: &ProjectCamera,
    rasterization: Rasterization,
    visibility: Option<&[f32; GROUP]>,
    split: Option<[f32; 3]>,
    out: &mut ProjectedGroup,
    shade: &mut ShadeGroup,
) {
    out.mask = 0;
    for first in (0..GROUP).step_by(S::N) {
        let geometry = geometry(simd, group, first, camera);
        let GroupGeometry { offset: [dx, dy, dz], z, tangents, columns, scales, sharp, det, .. } = geometry;
        let [cov_xx, cov_xy, cov_yy] = geometry.cov;
        let x = tangents[0].mul_add(simd.set(camera.focal[0]), simd.set(camera.principal[0]));
        let y = tangents[1].mul_add(simd.set(camera.focal[1]), simd.set(camera.principal[1]));

        let mut log2_opacity = simd.load(&group.log2_opacity[first..]);
        if let Some(factors) = visibility {
            log2_opacity += log2(simd, [simd.load(&factors[first..]).max(simd.set(1e-30))])[0];
        }
        if rasterization == Rasterization::Antialiased {
            let kept = (sharp / det).max(simd.set(MIN_COMPENSATION * MIN_COMPENSATION));
            log2_opacity = log2(simd, [kept])[0].mul_add(simd.set(0.5), log2_opacity);
        }

        let [ux, vx, vy] = factor(simd, &geometry);
        let (slope_y, slope_x) = (cov_xy / cov_xx, cov_xy / cov_yy);
        let reach = (log2_opacity - (LOG2_MIN_ALPHA - TEST_SLACK)) * (2.0 * LN_2);
        let positive = reach.max(simd.set(0.0));
        let (extent_x, extent_y) = ((positive * cov_xx).sqrt(), (positive * cov_yy).sqrt());

        // Positively phrased, so that a NaN anywhere drops the splat.
        let mut seen = z.simd_gt(simd.set(camera.near)) & det.simd_lt(simd.set(MAX_DET));
        seen &= log2_opacity.simd_ge(simd.set(LOG2_MIN_ALPHA));
        seen &= (x + extent_x).simd_ge(simd.set(0.5)) & (y + extent_y).simd_ge(simd.set(0.5));
        seen &= (x - extent_x).simd_le(simd.set(camera.size[0] - 0.5));
        seen &= (y - extent_y).simd_le(simd.set(camera.size[1] - 0.5));
        let bits = seen.to_bitmask() as u32;
        out.mask |= bits << first;
        if bits == 0 {
            continue;
        }

        if let Some(normal) = split {
            let slopes = reciprocal_slopes(simd, &geometry, camera, normal);
            let mut numbers = [[0.0; GROUP]; 2];
            for k in 0..2 {
                slopes[k].store_slice(&mut numbers[k][first..first + S::N]);
            }
            for lane in first..first + S::N {
                out.slopes[lane] = pack_slopes(numbers[0][lane], numbers[1][lane]);
            }
        }
        let (direction, distance) = ray(simd, &geometry.offset);
        let mut normal = columns[0];
        for k in 0..3 {
            normal[k] = shortest::<S>(&scales, [columns[0][k], columns[1][k], columns[2][k]]);
        }
        let sign = facing(simd, &normal, &[dx, dy, dz]);

        let lanes = first..first + S::N;
        x.store_slice(&mut out.x[lanes.clone()]);
        y.store_slice(&mut out.y[lanes.clone()]);
        ux.store_slice(&mut out.ux[lanes.clone()]);
        vx.store_slice(&mut out.vx[lanes.clone()]);
        vy.store_slice(&mut out.vy[lanes.clone()]);
        log2_opacity.store_slice(&mut out.log2_opacity[lanes.clone()]);
        z.store_slice(&mut out.depth[lanes.clone()]);
        slope_y.store_slice(&mut out.slope_y[lanes.clone()]);
        slope_x.store_slice(&mut out.slope_x[lanes.clone()]);
        let patches = [camera.size[0], camera.size[1]].map(|size| (size / PATCH as f32).ceil() - 1.0);
        for (end, (x, y)) in
            [(x - extent_x, y - extent_y), (x + extent_x, y + extent_y)].into_iter().enumerate()
        {
            patch_of(simd, x, patches[0]).store_slice(&mut out.columns[end][lanes.clone()]);
            patch_of(simd, y, patches[1]).store_slice(&mut out.rows[end][lanes.clone()]);
        }
        distance.store_slice(&mut shade.distance[lanes.clone()]);
        for k in 0..3 {
            (normal[k] * sign).store_slice(&mut out.normal[k][lanes.clone()]);
            direction[k].store_slice(&mut shade.direction[k][lanes.clone()]);
        }
    }
}

impl Record {
    /// The sixteen records of a group, whose splats are numbered from `first`.
    #[inline(always)]
    pub(crate) fn transposed<S: Lanes>(
        simd: S,
        from: &ProjectedGroup,
        shade: &ShadeGroup,
        first: u32,
    ) -> [Self; GROUP] {
        let indices = std::array::from_fn(|lane| f32::from_bits(first + lane as u32));
        let columns = [
            &from.x,
            &from.y,
            &from.ux,
            &from.vx,
            &from.vy,
            &from.log2_opacity,
            &shade.rgb[0],
            &shade.rgb[1],
            &shade.rgb[2],
            &from.depth,
            &from.normal[0],
            &from.normal[1],
            &from.normal[2],
            &from.slope_y,
            &from.slope_x,
            &indices,
        ];
        let mut records = [Self::default(); GROUP];
        if S::N < GROUP {
            for (lane, record) in records.iter_mut().enumerate() {
                *record = Self::of(std::array::from_fn(|k| columns[k][lane]));
            }
            return records;
        }
        // Each round of perfect shuffles turns the eight bits of (row, lane) by one place: four
        // rounds swap rows and lanes.
        let mut rows = [simd.set(0.0); GROUP];
        for k in 0..GROUP {
            rows[k] = simd.load(columns[k]);
        }
        for _ in 0..4 {
            let mut next = rows;
            for k in 0..GROUP / 2 {
                (next[2 * k], next[2 * k + 1]) = rows[k].interleave(rows[k + GROUP / 2]);
            }
            rows = next;
        }
        for k in 0..GROUP {
            let mut row = [0.0; GROUP];
            rows[k].store_slice(&mut row);
            records[k] = Self::of(row);
        }
        records
    }

    /// A record from its numbers in order.
    #[inline(always)]
    pub(crate) fn of(n: [f32; 16]) -> Self {
        Self {
            x: n[0],
            y: n[1],
            ux: n[2],
            vx: n[3],
            vy: n[4],
            log2_opacity: n[5],
            rgb: [n[6], n[7], n[8]],
            depth: n[9],
            normal: [n[10], n[11], n[12]],
            slope_y: n[13],
            slope_x: n[14],
            index: n[15].to_bits(),
        }
    }
}

/// The patch, 0 to `last`, in which the coordinate `v` (px) lies.
#[inline(always)]
fn patch_of<S: Lanes>(simd: S, v: S::F, last: f32) -> S::U {
    // A whole number below 2^23 is the mantissa of itself plus 2^23.
    const TWO_23: f32 = 8_388_608.0;
    let patch = (v * (1.0 / PATCH as f32)).floor().max(simd.set(0.0)).min(simd.set(last));
    (patch + TWO_23).to_bits() & S::U::splat(simd, 0x007f_ffff)
}

/// Frustum test of clusters.
///
/// A splat with mean at lateral offset `X` is drawn only if `X / z` is inside the picture's tangent
/// `tan` by its extent: `X - z tan <= 3.33 s sqrt(1 + tc^2) + z e / f`, with `s` its largest
/// standard deviation, 3.33 = sqrt(2 ln 255), `tc` the clamp of the Jacobian and
/// `e = sqrt(2 ln 255 0.3)` px from the dilation. The left side less `z e / f` is linear in the
/// mean, so its least value over the cluster's box is exact.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ClusterCull {
    /// Outward normals: a point `d` from the camera centre is outside if `n . d` exceeds the slack.
    planes: [[f32; 3]; 4],
    /// Slack a unit of standard deviation, one a plane.
    reach: [f32; 4],
    forward: [f32; 3],
    center: [f32; 3],
    near: f32,
}

impl ClusterCull {
    /// The test for one camera.
    pub(crate) fn new(camera: &ProjectCamera) -> Self {
        // sqrt(2 ln(255)), and with the dilation; a little more against rounding.
        let sigmas = (2.0 * (255.0f32).ln() + 0.01).sqrt();
        let dilated = sigmas * DILATION.sqrt() + 0.5;
        let mut planes = [[0.0; 3]; 4];
        let mut reach = [0.0; 4];
        for axis in 0..2 {
            let (focal, principal) = (camera.focal[axis], camera.principal[axis]);
            let tangents = [(camera.size[axis] - principal + dilated) / focal, (principal + dilated) / focal];
            let clamps = [camera.high[axis], -camera.low[axis]];
            for side in 0..2 {
                let sign = [1.0, -1.0][side];
                let plane = 2 * axis + side;
                for k in 0..3 {
                    planes[plane][k] =
                        sign * camera.rotation[axis][k] - tangents[side] * camera.rotation[2][k];
                }
                reach[plane] = sigmas * (1.0 + clamps[side] * clamps[side]).sqrt();
            }
        }
        Self { planes, reach, forward: camera.rotation[2], center: camera.center, near: camera.near }
    }

    /// Returns true if no splat of the cluster can be in view.
    #[inline]
    pub(crate) fn culls(&self, cluster: &Cluster) -> bool {
        let d: [f32; 3] = std::array::from_fn(|k| cluster.center[k] - self.center[k]);
        let support = |n: &[f32; 3]| -> (f32, f32) {
            let middle = n[0] * d[0] + n[1] * d[1] + n[2] * d[2];
            let half =
                n[0].abs() * cluster.half[0] + n[1].abs() * cluster.half[1] + n[2].abs() * cluster.half[2];
            (middle, half)
        };
        let (z, z_half) = support(&self.forward);
        // Rounding of sums of world coordinates, a few ulp of the largest.
        let rounding = 4e-6 * (d[0].abs() + d[1].abs() + d[2].abs());
        if z + z_half + rounding <= self.near {
            return true;
        }
        (0..4).any(|plane| {
            let (middle, half) = support(&self.planes[plane]);
            middle - half - rounding * 4.0 > self.reach[plane] * cluster.max_scale
        })
    }
}
