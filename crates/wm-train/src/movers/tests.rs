use super::*;
use glam::DVec3;
use wm_base::random::uniform;

const SIZE: (u32, u32) = (96, 72);

/// A wall of soft spots 4 units away, `gain` brighter than it is.
fn wall(x: f64, z: f64, gain: f32) -> [f32; 3] {
    let value = |channel: f64| (0.5 + 0.2 * (2.0 * x + channel).sin() * (3.0 * z).cos()) as f32 * gain;
    [value(0.0), value(1.0), value(2.0)]
}

/// Eight photos of a wall; stereo knows every fourth row of it but for `red`, a disc before it that
/// moves against the cameras.
fn views(red: bool, gain: impl Fn(usize) -> f32) -> Vec<MoverView> {
    let view = |index: usize| {
        let eye = DVec3::new(0.3 * index as f64 - 1.0, 0.0, 0.0);
        let camera = Camera::looking(SIZE, 50.0, eye, eye + DVec3::Y, DVec3::Z).unwrap();
        let middle = (20.0 + 8.0 * index as f64, 30.0);
        let (mut colors, mut stereo) = (Vec::new(), Vec::new());
        for pixel in 0..SIZE.0 * SIZE.1 {
            let (x, y) = (f64::from(pixel % SIZE.0) + 0.5, f64::from(pixel / SIZE.0) + 0.5);
            let ray = camera.ray(x, y);
            let at = eye + ray * (4.0 / ray.y);
            let is_red = red && (x - middle.0).hypot(y - middle.1) < 14.0;
            let noise = 0.04 * (uniform(index as u64, u64::from(pixel)) as f32 - 0.5);
            colors.push(if is_red {
                [0.9, 0.1, 0.1]
            } else {
                wall(at.x, at.z, gain(index)).map(|v| v + noise)
            });
            stereo.push(if is_red || !(pixel / SIZE.0).is_multiple_of(4) { f32::NAN } else { 0.25 });
        }
        // Nor does it know a plain part of the wall, where nothing moves.
        for pixel in 0..stereo.len() {
            if pixel / SIZE.0 as usize > 50 {
                stereo[pixel] = f32::NAN;
            }
        }
        MoverView::new(camera, &colors, &stereo)
    };
    (0..8).map(view).collect()
}

#[test]
fn what_moves_is_found_with_any_number_of_threads() {
    let views = views(true, |_| 1.0);
    let with = |threads| wm_render::cpu::pool(threads).unwrap().install(|| find(&views));
    let (outcome, masks) = with(1);
    let MoverOutcome::Found { photos: 8, share } = outcome else { panic!("{outcome:?}") };
    let disc = std::f64::consts::PI * 196.0 / f64::from(SIZE.0 * SIZE.1);
    assert!((0.5 * disc..1.3 * disc).contains(&share), "{share} of {disc}");
    for (index, mask) in masks.iter().enumerate() {
        let middle = (20 + 8 * index) + 30 * SIZE.0 as usize;
        assert!(mask.moves[middle], "photo {index}");
        let off = mask.pixels(SIZE.0, SIZE.1).into_iter().filter(|pixel| {
            let (x, y) = ((pixel % 96) as f64 + 0.5, (pixel / 96) as f64 + 0.5);
            (x - 20.0 - 8.0 * index as f64).hypot(y - 30.0) > 18.0
        });
        assert!(off.count() < 20, "photo {index}");
    }
    assert_eq!(with(3), (outcome, masks));
}

#[test]
fn texture_and_exposure_do_not_move() {
    assert_eq!(find(&views(false, |_| 1.0)), (MoverOutcome::None, Vec::new()));
    // What is left of exposures that were measured.
    let (outcome, _) = find(&views(false, |index| [0.96, 1.04][index % 2]));
    assert_eq!(outcome, MoverOutcome::None);
    assert!(matches!(find(&views(true, |_| 1.0)[..4]).0, MoverOutcome::TooFewJudged(_)));
}

#[test]
fn a_mask_fits_other_sizes() {
    let mask = MoverMask { width: 2, height: 1, moves: vec![false, true] };
    assert_eq!(mask.pixels(4, 2), [2, 3, 6, 7]);
    assert_eq!(mask.pixels(2, 1), [1]);
    assert_eq!(MoverMask { width: 2, height: 1, moves: Vec::new() }.pixels(4, 2).len(), 0);
    assert!(!mask.is_empty());
}
