//! Wet ground: frames alone and in sequences, threads, what stays dry, and weathers that wet
//! nothing.

use crate::common::*;

const SIZE: (u32, u32) = (72, 48);

/// Rain that begins on dry ground and ends, a minute a second.
const SHOWER: &str = r#"
[light]
model = "overcast"
[wind]
speed = 4
[rain]
rate = { keys = [[0, 0], [1, 30], [2, 30], [3, 0]] }
[wetness]
rained_before = 0
lapse = 60
"#;

#[test]
fn a_wet_frame_alone_is_that_of_the_sequence_on_any_number_of_threads() {
    Shot::yard(SIZE).check_frames_alone(SHOWER);
}

#[test]
fn water_darkens_and_dry_weather_changes_no_byte() {
    let shown = pictures(
        yard().build(),
        &yard_look(SIZE).0,
        0.0,
        &[
            &[],
            &["wetness=on"],
            &["wetness.amount=0"],
            &["wetness.amount=0.3"],
            &["wetness.amount=1"],
            &["wetness.amount=0.3", "wetness.porosity=0"],
            &["wetness.amount=1", "fidelity=paper"],
        ],
    );
    let clear = &shown[0].frame.rgb;
    for same in [1, 2, 6] {
        let most = clear.iter().zip(&shown[same].frame.rgb).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(most == 0.0, "{same}: {most}");
    }
    let light = |k: usize| shown[k].frame.rgb.iter().map(|v| f64::from(*v)).sum::<f64>();
    assert!(light(0) > light(3), "{} {}", light(0), light(3));
    // What is damp mirrors a little, whether it is darkened or not, and the sky stays as it is over
    // a film.
    let brighter =
        [3, 5].map(|damp| clear.iter().zip(&shown[damp].frame.rgb).map(|(a, b)| b - a).fold(0.0, f32::max));
    assert!(brighter[0] < 0.15 && (0.01..0.15).contains(&brighter[1]), "{brighter:?}");
    assert!(light(3) < light(5), "{} {}", light(3), light(5));
    assert_eq!(clear[..3], shown[4].frame.rgb[..3]);
}

/// Wet ground without rain has a picture of particles too, with none in it.
#[test]
fn the_particles_of_dry_air_over_wet_ground_are_none() {
    let yard = Shot::yard(SIZE);
    for set in ["wetness.amount=1", "flood.level=0.2"] {
        yard.render("a.png", &format!("--set {set} --also particles.npy"));
        let (values, shape) = wm_base::npy::read(&yard.path("a.particles.npy")).unwrap();
        assert_eq!(shape, [SIZE.1 as usize, SIZE.0 as usize, 4]);
        assert!(values.iter().all(|value| *value == 0.0), "{set}");
        std::fs::remove_file(yard.path("a.particles.npy")).unwrap();
    }
}
