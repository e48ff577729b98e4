//! Drops on the lens: frames alone and in sequences, and weathers whose glass is clear.

mod common;

use common::*;
use weather_magician::Picture;

const SIZE: (u32, u32) = (144, 96);

/// Rain that begins on dry ground and ends, on a dirty windscreen.
const SHOWER: &str = r#"
[rain]
rate = { keys = [[0, 0], [1, 60], [2, 60], [3, 0]] }
[wind]
speed = 4
[lens]
distance = 0.1
rained_before = 0
drying = 20
dirt = 0.1
veil = 1
"#;

#[test]
fn a_wet_lens_alone_is_that_of_the_sequence_on_any_number_of_threads() {
    let workshop = Workshop::new();
    let (_, view) = yard_look(SIZE);
    let scene = workshop.scene("yard", yard().build(), &yard_metadata(1.0));
    let weather = workshop.path("shower.toml");
    std::fs::write(&weather, SHOWER).unwrap();
    workshop.check_frames_alone(&scene, &view, &weather);
}

/// Mean and greatest change of colour between two pictures.
fn change(a: &Picture, b: &Picture) -> (f32, f32) {
    let changes = a.frame.rgb.iter().zip(&b.frame.rgb).map(|(a, b)| (a - b).abs());
    let (sum, most) = changes.fold((0.0, 0.0f32), |(sum, most), change| (sum + change, most.max(change)));
    (sum / a.frame.rgb.len() as f32, most)
}

#[test]
fn a_clear_glass_changes_no_byte_and_a_wet_one_the_colour_alone() {
    let shown = pictures(
        yard().build(),
        &yard_look(SIZE).0,
        5.0,
        &[
            &[],
            &["lens=on"],
            &["lens.rate=0", "rain.rate=20", "rain.opacity=0"],
            &["rain.rate=20", "rain.opacity=0"],
            &["lens.rate=20", "lens.distance=0.1"],
            &["lens.rate=20", "lens.distance=0.03", "lens.aperture=5"],
            &["lens.dirt=0.3"],
            &["lens.veil=1"],
        ],
    );
    assert_eq!(shown[0].frame, shown[1].frame);
    assert_eq!(shown[2].frame, shown[3].frame);
    for (k, least) in [(4, 0.005), (5, 0.005), (6, 0.01), (7, 0.002)] {
        let (mean, most) = change(&shown[0], &shown[k]);
        println!("{k}: {mean} {most}");
        assert!(mean > least && most > 0.02, "{k}: {mean} {most}");
        assert_eq!(
            (&shown[0].frame.depth, &shown[0].frame.alpha),
            (&shown[k].frame.depth, &shown[k].frame.alpha)
        );
    }
}
