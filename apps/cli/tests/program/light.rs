//! The light of the weather: frames alone and in sequences, threads, and an exposure that does not
//! jump.

use crate::common::*;
use crate::process::{said, succeeds};
use glam::DVec3;
use weather_magician::{FrameRequest, Renderer, Weather};
use wm_base::color::luminance;
use wm_scene::{Lamp, LitWindow, Metadata};

const SIZE: (u32, u32) = (72, 48);

/// From sun through a storm into the night within four seconds, with all that light can do.
const STORM: &str = r#"
[light]
model = "clear"
sun_elevation = { keys = [[0, 12], [4, -10]] }
sun_azimuth = 120
clouds = 0.6
cloud_shadows = "on"
photos = "diffuse"
lamps = "on"
headlamps = "on"
[lightning]
rate = 100
distance = 800
exposure = 0.1
[wind]
speed = 6
[fog]
mor = 300
[rain]
rate = 20
[snow_cover]
depth = 0.05
"#;

/// The yard's facts, with two lamps and a lit window.
fn lit_yard() -> Metadata {
    let lamp = Lamp { aim: Some([0.0, 0.0, -1.0]), ..Lamp::new([-1.5, 1.0, 4.0]) };
    let all_round = Lamp { lumens: 1_500.0, kelvin: 2_200.0, ..Lamp::new([3.0, -3.0, 2.5]) };
    let corners = [DVec3::new(5.0, 7.9, 1.0), DVec3::new(6.5, 7.9, 2.4)];
    let window = LitWindow::between(corners, DVec3::Z, DVec3::new(0.0, -12.0, 2.0));
    let windows = window.into_iter().collect();
    Metadata { lamps: Some(vec![lamp, all_round]), windows: Some(windows), ..yard_metadata(1.0) }
}

#[test]
fn a_frame_of_a_storm_alone_is_that_of_the_sequence_on_any_number_of_threads() {
    Shot::yard_with(SIZE, &lit_yard()).check_frames_alone(STORM);
}

/// Lamps, windows and headlamps shine by night alone.
#[test]
fn lamps_and_windows_are_seen_by_night() {
    let yard = Shot::yard_with(SIZE, &lit_yard());
    let draw = |options: &str| -> Vec<f64> {
        let pixels = yard.png(&format!("{options} --set light.photos=diffuse --assets off")).pixels;
        pixels.iter().map(|rgb| rgb.iter().map(|v| f64::from(*v)).sum::<f64>() / 3.0).collect()
    };
    // Of the tenth that is brightest, over the median.
    let contrast = |pixels: &[f64]| {
        let mut sorted = pixels.to_vec();
        sorted.sort_by(f64::total_cmp);
        sorted[9 * sorted.len() / 10] / sorted[sorted.len() / 2]
    };
    let night = "--set light.model=night";
    let [off, lamps, both] = ["light.lamps=off", "light.lamps=on", "light.headlamps=on --set light.lamps=on"]
        .map(|set| draw(&format!("{night} --set {set}")));
    assert!(contrast(&lamps) > 1.5 * contrast(&off), "{} {}", contrast(&lamps), contrast(&off));
    let differ =
        |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f64>() / a.len() as f64;
    assert!(differ(&lamps, &both) > 3.0, "{}", differ(&lamps, &both));
    let day = "--set light.model=clear --set light.sun_elevation=30";
    let [off, on] = ["off", "auto"].map(|lamps| draw(&format!("{day} --set light.lamps={lamps}")));
    assert!(off == on);
}

#[test]
fn lamps_that_nobody_states_are_told() {
    let told = |facts: &Metadata, weather: &str| {
        let options = format!("--weather {weather} --assets off --set light.photos=diffuse");
        let output = succeeds(&mut Shot::yard_with(SIZE, facts).command("a.png", &options));
        said(&output).contains("the scene states no lamps")
    };
    assert!(told(&yard_metadata(1.0), "night"));
    assert!(!told(&lit_yard(), "night") && !told(&yard_metadata(1.0), "sunny"));
}

#[test]
fn exposure_does_not_jump_from_sun_to_night() {
    let mut renderer = Renderer::cpu().unwrap();
    let mut place = load_yard(&mut renderer, &lit_yard());
    let camera = yard_look((30, 20)).0;
    let mut weather = Weather::preset("sun-to-night").unwrap();
    for set in ["light.photos=diffuse", "lightning=off", "rain=off", "wind=off"] {
        weather.set_text(set).unwrap();
    }
    let mut mean = |time: f64| {
        let picture = renderer.render(&mut place, &FrameRequest::new(&weather, camera, time)).unwrap();
        let light = picture.frame.rgb_linear();
        let all = light.chunks_exact(3).map(|c| luminance([0, 1, 2].map(|k| f64::from(c[k]))));
        (all.sum::<f64>() / (light.len() / 3) as f64).log2()
    };
    for quarter in 0..=80 {
        let time = f64::from(quarter) / 4.0;
        let change = mean(time + 1.0 / 24.0) - mean(time);
        // At dusk the light halves about every 0.4 s.
        assert!(change.abs() < 0.12, "{change} EV in a frame at {time} s");
    }
}
