//! The flow of places that are known, by their own formulas.

use super::*;
use crate::testing::renderer;
use crate::{FrameRequest, Layers, NextFrame};
use wm_scene::camera::Distortion;
use wm_scene::splats::Splat;
use wm_scene::{Group, Scene, Splats};
use wm_weather::Weather;

pub(super) const SIZE: (u32, u32) = (96, 72);

pub(super) fn camera(eye: [f64; 3], target: [f64; 3]) -> Camera {
    Camera::looking(SIZE, 60.0, DVec3::from_array(eye), DVec3::from_array(target), DVec3::Z).unwrap()
}

/// The middle of pixel `i` of a picture of [`SIZE`].
pub(super) fn middle_of(i: usize) -> [f64; 2] {
    [i as u32 % SIZE.0, i as u32 / SIZE.0].map(|k| f64::from(k) + 0.5)
}

/// The plane `normal . x = height`.
#[derive(Clone, Copy)]
struct Plane {
    normal: DVec3,
    height: f64,
}

/// Returns the depth of a plane at every pixel, `factor` times as far.
fn plane_depth(camera: &Camera, lens: Option<LensModel>, plane: Plane, factor: f64) -> Vec<f32> {
    let Plane { normal, height } = plane;
    let view = FlowView { camera: *camera, lens, depth: &[] };
    let depth = |i: u32| {
        let at = [f64::from(i % camera.width) + 0.5, f64::from(i / camera.width) + 0.5];
        let Some(ray) = view.ray(at) else { return 0.0 };
        let way = camera.rotation().transpose() * ray;
        let along = (height - normal.dot(camera.center())) / normal.dot(way);
        if along > 0.0 { (factor * along) as f32 } else { 0.0 }
    };
    (0..camera.width * camera.height).map(depth).collect()
}

/// The way by which the picture of a plane moves, by the homography that a plane has between two
/// pinholes: no depth, no point.
fn homography(from: &Camera, to: &Camera, plane: Plane, point: [f64; 2]) -> [f64; 2] {
    let (Plane { normal, height }, [x, y]) = (plane, point);
    let intrinsics = |c: &Camera| {
        glam::DMat3::from_cols(
            DVec3::new(c.fx, 0.0, 0.0),
            DVec3::new(0.0, c.fy, 0.0),
            DVec3::new(c.cx, c.cy, 1.0),
        )
    };
    let distance = height - normal.dot(from.center());
    let way = from.rotation() * (from.center() - to.center());
    let own = from.rotation() * normal;
    // x' = K' R (I + t n^T / d) K^-1 x, with n and t in the axes of the first camera.
    let outer = glam::DMat3::from_cols(way * own.x, way * own.y, way * own.z) * (1.0 / distance);
    let turn = to.rotation() * from.rotation().transpose();
    let all = intrinsics(to) * turn * (glam::DMat3::IDENTITY + outer) * intrinsics(from).inverse();
    let p = all * DVec3::new(x, y, 1.0);
    [p.x / p.z - x, p.y / p.z - y]
}

/// The largest error of the flow of ground 1.5 below two eyes, whose depth is taken `factor` times,
/// and the largest flow, px.
fn ground_error(factor: f64) -> [f64; 2] {
    let (from, to) = (camera([0.0; 3], [10.0, 0.0, -2.0]), camera([0.3, 0.05, 0.02], [10.0, 0.2, -2.0]));
    let ground = Plane { normal: DVec3::Z, height: -1.5 };
    let [a, b] = [&from, &to].map(|camera| plane_depth(camera, None, ground, factor));
    let flow = scene_flow(&FlowView::new(None, &from, &a), &FlowView::new(None, &to, &b));
    let (mut worst, mut most) = (0.0f64, 0.0f64);
    for (i, vector) in flow.vectors.as_chunks::<2>().0.iter().enumerate() {
        let at = middle_of(i);
        // Next to the horizon the sky is one of the pixels that are interpolated.
        if a[i] == 0.0 || a[i] > 60.0 {
            continue;
        }
        let want = homography(&from, &to, ground, at);
        worst = worst.max((0..2).map(|k| (f64::from(vector[k]) - want[k]).abs()).fold(0.0, f64::max));
        most = most.max(want[0].hypot(want[1]));
        // Ground hides no ground.
        assert_ne!(flow.states[i], FlowState::Occluded as u8, "{at:?}");
        assert_ne!(flow.states[i], FlowState::Unknown as u8, "{at:?}");
    }
    [worst, most]
}

#[test]
fn the_flow_of_a_plane_is_its_homography_and_a_tenth_of_depth_is_seen() {
    let [worst, most] = ground_error(1.0);
    assert!(most > 5.0, "{most} px");
    assert!(worst < 1e-3, "{worst} px");
    let [wrong, _] = ground_error(1.1);
    assert!(wrong > 0.03 * most, "{wrong} px of {most}");
}

#[test]
fn a_wall_in_front_hides_what_is_behind_its_edge() {
    // A wall at 4 covers what is right of the axis, one at 10 the rest; the eye goes to the left by
    // 0.5, so that the near one moves to the right by more.
    let from = camera([0.0; 3], [10.0, 0.0, 0.0]);
    let to = camera([0.0, 0.5, 0.0], [10.0, 0.5, 0.0]);
    let walls = |camera: &Camera| -> Vec<f32> {
        let edge = camera.project(DVec3::new(4.0, 0.0, 0.0)).unwrap().0;
        (0..SIZE.0 * SIZE.1).map(|i| if f64::from(i % SIZE.0) + 0.5 > edge { 4.0 } else { 10.0 }).collect()
    };
    let (a, b) = (walls(&to), walls(&from));
    // From the left eye back to the middle one: the near wall moves to the left, over the far one.
    let flow = scene_flow(&FlowView::new(None, &to, &a), &FlowView::new(None, &from, &b));
    let edges = [&to, &from].map(|c| c.project(DVec3::new(4.0, 0.0, 0.0)).unwrap().0);
    let moved = [4.0, 10.0].map(|z| from.fx * 0.5 / z);
    assert!((edges[0] - edges[1] - moved[0]).abs() < 1e-9 && moved[0] - moved[1] > 4.0);
    let row = &flow.states[SIZE.0 as usize * 30..][..SIZE.0 as usize];
    for (x, state) in row.iter().enumerate() {
        let middle = x as f64 + 0.5;
        let is_far = middle < edges[0];
        let next = middle - if is_far { moved[1] } else { moved[0] };
        let vector = flow.vectors[2 * (SIZE.0 as usize * 30 + x)];
        assert!((f64::from(vector) + if is_far { moved[1] } else { moved[0] }).abs() < 1e-4);
        let want = match () {
            () if next < 0.0 => FlowState::Outside,
            () if is_far && next > edges[1] => FlowState::Occluded,
            () => FlowState::Visible,
        };
        // The edge lies within a pixel.
        if (next - edges[1]).abs() > 1.0 {
            assert_eq!(*state, want as u8, "{x}");
        }
    }
    assert!(row.contains(&(FlowState::Occluded as u8)) && row.contains(&(FlowState::Outside as u8)));
    // The other way, the far wall comes out, and nothing is hidden.
    let back = scene_flow(&FlowView::new(None, &from, &b), &FlowView::new(None, &to, &a));
    assert!(!back.states.contains(&(FlowState::Occluded as u8)));
}

#[test]
fn lenses_have_the_flow_of_their_own_projection() {
    let (fisheye, round) = LensModel::fisheye(SIZE, 200.0).unwrap();
    let near = camera([0.0; 3], [10.0, 0.0, -2.0]);
    let bent = LensModel::Perspective(Distortion::of([-0.1, 0.02, 0.001, 0.002, 0.001]));
    let ground = Plane { normal: DVec3::Z, height: -1.5 };
    for (lens, intrinsics) in [(fisheye, round), (bent, near), (LensModel::Equirectangular, round)] {
        let posed = |eye, target| Camera { viewmat: camera(eye, target).viewmat, ..intrinsics };
        let (from, to) = (posed([0.0; 3], [10.0, 0.0, -2.0]), posed([0.3, 0.05, 0.02], [10.0, 0.2, -2.0]));
        let [a, b] = [&from, &to].map(|camera| plane_depth(camera, Some(lens), ground, 1.0));
        let flow = scene_flow(
            &FlowView { camera: from, lens: Some(lens), depth: &a },
            &FlowView { camera: to, lens: Some(lens), depth: &b },
        );
        let mut seen = 0;
        for (i, vector) in flow.vectors.as_chunks::<2>().0.iter().enumerate() {
            let at = middle_of(i);
            if flow.states[i] == FlowState::Unknown as u8 || a[i] == 0.0 {
                continue;
            }
            // The rays of both ends meet on the ground.
            let mut end = [0, 1].map(|k| at[k] + f64::from(vector[k]));
            if lens == LensModel::Equirectangular {
                assert!(vector[0].abs() <= 0.5 * SIZE.0 as f32);
                end[0] = end[0].rem_euclid(f64::from(SIZE.0));
            }
            let hit = |camera: &Camera, at: [f64; 2]| {
                let way = camera.rotation().transpose() * lens.ray(camera, at)?;
                Some(camera.center() + way * ((ground.height - camera.center().z) / way.z))
            };
            let (Some(first), Some(second)) = (hit(&from, at), hit(&to, end)) else { continue };
            let distance = (first - from.center()).length();
            // A tenth of a pixel's angle, where it is seen at a low angle too.
            let slack = 3e-3 * distance * distance / 1.5;
            assert!((first - second).length() < slack, "{lens:?} at {at:?}: {first} and {second}");
            seen += 1;
        }
        assert!(seen > 1500, "{lens:?}: {seen}");
    }
}

#[test]
fn nothing_is_infinitely_far_and_turns_with_the_camera() {
    let from = camera([0.0; 3], [10.0, 0.0, 0.0]);
    let to = camera([3.0, 1.0, 0.0], [13.0, 1.5, 0.0]);
    let none = vec![0.0; (SIZE.0 * SIZE.1) as usize];
    let flow = scene_flow(&FlowView::new(None, &from, &none), &FlowView::new(None, &to, &none));
    let middle = (SIZE.1 / 2 * SIZE.0 + SIZE.0 / 2) as usize;
    let way = from.ray(48.5, 36.5);
    let (x, y, _) = to.project(to.center() + way).unwrap();
    let vector = &flow.vectors[2 * middle..][..2];
    assert!(
        (f64::from(vector[0]) - (x - 48.5)).abs() < 1e-4 && (f64::from(vector[1]) - (y - 36.5)).abs() < 1e-4
    );
    assert_eq!(flow.states[middle], FlowState::Visible as u8);
}

/// A wall of small discs across the x axis.
pub(super) fn wall(x: f32, left: f32, right: f32, splats: &mut Splats) {
    let step = 0.05;
    for i in 0..=((left - right) / step) as usize {
        for j in -60..=60 {
            splats.push(&Splat {
                mean: [x, left - i as f32 * step, j as f32 * step],
                quat: [1.0, 0.0, 0.0, 0.0],
                log_scale: [1e-3f32.ln(), 0.04f32.ln(), 0.04f32.ln()],
                logit_opacity: 6.0,
                rgb: [0.5; 3],
                group: Group::Scene,
            });
        }
    }
}

/// Drawn walls: the flow by splats is that by the formula, and where the near wall comes before the
/// far one, it is hidden. A frame is the same whichever frames were drawn before.
#[test]
fn splats_have_the_flow_of_the_walls_that_they_are() {
    let mut splats = Splats::with_capacity(0, 0);
    wall(4.0, 0.0, -3.0, &mut splats);
    wall(8.0, 8.0, -8.0, &mut splats);
    let mut renderer = renderer();
    let mut place = renderer.load(Scene { splats, ..Scene::default() }).unwrap();
    let (from, to) = (camera([0.0, 0.5, 0.0], [10.0, 0.5, 0.0]), camera([0.0; 3], [10.0, 0.0, 0.0]));
    let weather = Weather::clear();
    let mut flow = |a: &Camera, b: &Camera| {
        let request = FrameRequest {
            layers: Layers::FLOW,
            next: Some(NextFrame { time: 0.0, camera: (*b).into() }),
            ..FrameRequest::new(&weather, a, 0.0)
        };
        renderer.render(&mut place, &request).unwrap().flow
    };
    let found = flow(&from, &to);
    let edges = [&from, &to].map(|c| c.project(DVec3::new(4.0, 0.0, 0.0)).unwrap().0);
    let row = SIZE.0 as usize * 36;
    let mut hidden = 0;
    for x in 0..SIZE.0 as usize {
        let middle = x as f64 + 0.5;
        if (middle - edges[0]).abs() < 1.5 {
            continue;
        }
        let is_far = middle < edges[0];
        let want = -from.fx * 0.5 / if is_far { 8.0 } else { 4.0 };
        let (u, v) = (f64::from(found.vectors[2 * (row + x)]), f64::from(found.vectors[2 * (row + x) + 1]));
        // Splats of the near wall reach a little beyond its edge.
        let slack = if (middle - edges[0]).abs() < 4.0 { 0.03 * want.abs() } else { 0.01 };
        assert!((u - want).abs() < slack && v.abs() < 0.01, "{x}: {u} {v}, not {want}");
        let next = middle + want;
        if (next - edges[1]).abs() > 1.5 && next > 0.0 {
            let is_hidden = is_far && next > edges[1];
            hidden += usize::from(is_hidden);
            let state = if is_hidden { FlowState::Occluded } else { FlowState::Visible };
            assert_eq!(found.states[row + x], state as u8, "{x}");
        }
    }
    assert!(hidden > 0);
    flow(&to, &from);
    let again = flow(&from, &to);
    assert_eq!(again.states, found.states);
    assert!(again.vectors.iter().zip(&found.vectors).all(|(a, b)| a.to_bits() == b.to_bits()));
}
