use super::cpu::{ClusterCull, ProjectedGroup, project_group};
use super::{ProjectCamera, Record, SQRT_HALF_LOG2E, TEST_SLACK};
#[cfg(feature = "gpu")]
use crate::config::RenderConfig;
use crate::cpu::model::CpuModel;
use crate::dispatch;
use crate::hooks::{GROUP, ShadeGroup};
use crate::reference;
use crate::simd::SimdPath;
use crate::sizes::CLUSTER;
use crate::testing::comparison::HardSplats;
use crate::testing::{Backend, camera, random_splats, uniform};
use glam::DVec3;
use wm_scene::{Camera, Rasterization, Splats};

crate::parity! {
    random_splats_project_alike => |backend| check(backend, &random_splats(2000, 0, 1), Rasterization::Classic);
    hard_splats_project_alike => |backend| {
        for hard in HardSplats::ALL {
            check(backend, &hard.splats(600, 2), Rasterization::Classic);
            check(backend, &hard.splats(600, 3), Rasterization::Antialiased);
        }
    };
}

/// A splat in view as a back end projects it; only the CPU has boxes and rays.
struct ProjectedSplat {
    record: Record,
    /// Columns and rows of patches.
    ends: Option<[[u32; 2]; 2]>,
    /// Direction and length.
    ray: Option<([f32; 3], f32)>,
}

/// Every splat, in the order of the model.
fn run(
    backend: Backend,
    splats: &Splats,
    camera: &Camera,
    mode: Rasterization,
) -> Vec<Option<ProjectedSplat>> {
    match backend {
        Backend::Cpu(path) => run_on_cpu(path, splats, camera, mode),
        #[cfg(feature = "gpu")]
        Backend::Gpu => run_on_gpu(splats, camera, mode),
    }
}

fn run_on_cpu(
    path: SimdPath,
    splats: &Splats,
    camera: &Camera,
    mode: Rasterization,
) -> Vec<Option<ProjectedSplat>> {
    let project_camera = ProjectCamera::new(camera);
    let mut all = Vec::new();
    for group in &CpuModel::new(splats).unwrap().groups {
        let (mut out, mut shade) = (ProjectedGroup::default(), ShadeGroup::default());
        dispatch!(path, s => project_group(s, group, &project_camera, mode, None, None, &mut out, &mut shade));
        let records = dispatch!(path, s => Record::transposed(s, &out, &shade, all.len() as u32));
        all.extend((0..GROUP).map(|lane| {
            let ends = [out.columns, out.rows].map(|ends| ends.map(|end| end[lane]));
            let ray = (shade.direction.map(|axis| axis[lane]), shade.distance[lane]);
            let seen = ProjectedSplat { record: records[lane], ends: Some(ends), ray: Some(ray) };
            (out.mask >> lane & 1 == 1).then_some(seen)
        }));
    }
    all
}

#[cfg(feature = "gpu")]
fn run_on_gpu(splats: &Splats, camera: &Camera, mode: Rasterization) -> Vec<Option<ProjectedSplat>> {
    let config = RenderConfig { rasterization: mode, ..RenderConfig::default() };
    let probe = crate::gpu::probe::Probe::of(splats, camera, &config);
    let mut all: Vec<Option<ProjectedSplat>> = splats.means.iter().map(|_| None).collect();
    assert!(probe.records.is_sorted_by_key(|record| record.index));
    for record in probe.records {
        all[record.index as usize] = Some(ProjectedSplat { record, ends: None, ray: None });
    }
    all
}

fn check(backend: Backend, splats: &Splats, mode: Rasterization) {
    let camera = camera(640, 400);
    let model = CpuModel::new(splats).unwrap();
    let all = run(backend, splats, &camera, mode);
    let mut compared = 0;
    for i in 0..model.len {
        let seen = &all[i];
        let want = reference::project(splats, model.source[i] as usize, &camera, mode, 1.0);
        let Some(want) = want else {
            // Near plane and opacity cut: either is right within rounding.
            let is_on_edge = |ProjectedSplat { record, .. }: &ProjectedSplat| {
                let opacity = f64::from(record.log2_opacity).exp2() * 255.0;
                (opacity - 1.0).abs() < 1e-4 || (f64::from(record.depth) / camera.near - 1.0).abs() < 1e-4
            };
            assert!(seen.as_ref().is_none_or(is_on_edge), "splat {i} is drawn and should not be");
            continue;
        };
        let [xx, xy, yy] = want.cov2d;
        let slack = f64::from(TEST_SLACK) * std::f64::consts::LN_2;
        let reach = 2.0 * ((255.0 * want.opacity).ln() + slack).max(0.0);
        let (extent_x, extent_y) = ((reach * xx).sqrt(), (reach * yy).sqrt());
        // Distance by which the box misses the nearest pixel centre.
        let outside = (want.mean2d[0] - extent_x - 639.5)
            .max(0.5 - want.mean2d[0] - extent_x)
            .max(want.mean2d[1] - extent_y - 399.5)
            .max(0.5 - want.mean2d[1] - extent_y);
        let scale = 1e-5 * (1.0 + extent_x + extent_y + want.mean2d[0].abs() + want.mean2d[1].abs());
        if outside > 0.01 + 10.0 * scale {
            assert!(seen.is_none(), "splat {i} misses the picture by {outside} px");
        }
        if outside < -(0.01 + 10.0 * scale) && want.opacity > 1.0001 / 255.0 {
            assert!(seen.is_some(), "splat {i} is lost");
        }
        let Some(ProjectedSplat { record: out, ends: boxes, ray }) = seen else { continue };
        compared += 1;
        let near = |name: &str, got: f32, want: f64, tolerance: f64| {
            let got = f64::from(got);
            assert!((got - want).abs() <= tolerance, "splat {i} {name}: {got}, want {want}");
        };
        near("x", out.x, want.mean2d[0], scale);
        near("y", out.y, want.mean2d[1], scale);
        near("depth", out.depth, want.depth, 1e-6 * (6.0 + want.depth));
        let k = f64::from(SQRT_HALF_LOG2E);
        let given_x = yy - xy * xy / xx;
        // Seen along its long axis, a needle's extent in the picture is a difference of large
        // terms.
        let longest = splats.scales(model.source[i] as usize).into_iter().fold(0.0, f64::max);
        let noise = 1e-6 * camera.fx / want.depth * longest * want.distance / want.depth;
        let relative = 1e-5 + noise / xx.min(given_x).sqrt();
        near("ux", out.ux, k / xx.sqrt(), relative * k / xx.sqrt());
        near("vy", out.vy, k / given_x.sqrt(), relative * k / given_x.sqrt());
        let lean = k / given_x.sqrt() * (yy / xx).sqrt();
        near("vx", out.vx, -xy / xx * k / given_x.sqrt(), relative * lean);
        near("slope_y", out.slope_y, xy / xx, relative * (yy / xx).sqrt());
        near("slope_x", out.slope_x, xy / yy, relative * (xx / yy).sqrt());
        near("opacity", out.log2_opacity, want.opacity.log2(), relative * (2.0 - want.opacity.log2()));
        // The box in patches, within the rounding of its ends.
        let slack = relative * extent_x.max(extent_y) + 1e-3 + scale;
        let ends = |rows: [u32; 2], center: f64, extent: f64, last: f64| {
            for (row, end) in rows.into_iter().zip([center - extent, center + extent]) {
                let patch = |v: f64| (v / 16.0).floor().clamp(0.0, last);
                let row = f64::from(row);
                assert!(patch(end - slack) <= row && row <= patch(end + slack), "splat {i}: {row}, {end}");
            }
        };
        if let Some([columns, rows]) = boxes {
            ends(*columns, want.mean2d[0], extent_x, 39.0);
            ends(*rows, want.mean2d[1], extent_y, 24.0);
        }
        if let Some((direction, distance)) = ray {
            for axis in 0..3 {
                near("direction", direction[axis], want.direction[axis], 2e-6);
            }
            near("distance", *distance, want.distance, 1e-6 * (6.0 + want.distance));
        }
        // The normal's sign is free where the splat is seen edge on.
        let facing: f64 = (0..3).map(|a| want.normal[a] * want.direction[a]).sum();
        if facing.abs() > 1e-5 {
            for axis in 0..3 {
                near("normal", out.normal[axis], want.normal[axis], 3e-6);
            }
        }
    }
    assert!(compared > 0 || model.len == 0, "nothing was in view");
}

/// No cluster that holds a splat in view is culled, for cameras all about and inside the scene.
#[test]
fn culling_loses_no_splat() {
    for (kind, splats) in
        [random_splats(3000, 0, 7), HardSplats::Needle.splats(1500, 8), HardSplats::Huge.splats(600, 9)]
            .into_iter()
            .enumerate()
    {
        let model = CpuModel::new(&splats).unwrap();
        let (mut culled, mut kept) = (0, 0);
        for view in 0..60 {
            let u = |k: u64| uniform(70 + kind as u64, view * 8 + k) * 2.0 - 1.0;
            let eye = DVec3::new(u(0), u(1), u(2)) * 6.0;
            let fov = 20.0 + 40.0 * (u(6) + 1.0);
            let Ok(camera) = Camera::looking((300, 200), fov, eye, DVec3::new(u(3), u(4), u(5)), DVec3::Y)
            else {
                continue;
            };
            let camera = Camera { cx: 150.0 + 200.0 * u(7), ..camera };
            let project_camera = ProjectCamera::new(&camera);
            let cull = ClusterCull::new(&project_camera);
            let backend = Backend::of(crate::simd::SimdChoice::Auto).unwrap();
            let all = run(backend, &splats, &camera, Rasterization::Classic);
            for (i, cluster) in model.clusters.iter().enumerate() {
                let visible = all[i * CLUSTER..(i + 1) * CLUSTER].iter().any(Option::is_some);
                assert!(!(visible && cull.culls(cluster)), "cluster {i} of view {view}");
                culled += usize::from(cull.culls(cluster));
                kept += usize::from(visible);
            }
        }
        assert!(kept > 0 && (culled > 0 || kind != 0), "{kind}: culled {culled}, visible {kept}");
    }
}
