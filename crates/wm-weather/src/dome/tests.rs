use super::*;
use crate::effects::effect::WeatherSample;
use crate::optics::{AirLayer, Atmosphere, Daylight, Site, sigma_of_mor};
use crate::weather::Weather;
use proptest::prelude::*;
use std::sync::Arc;
use wm_render::hooks::Medium;
use wm_render::simd::{SimdChoice, SimdPath};

impl Dome {
    /// The direction of a sine of elevation and a heading, radians.
    fn leaning(&self, sin: f64, heading: f64) -> [f64; 3] {
        let ([forward, right, up], level) = (level_axes(self.up), (1.0 - sin * sin).max(0.0).sqrt());
        let (across, along) = heading.sin_cos();
        std::array::from_fn(|k| level * (along * forward[k] + across * right[k]) + sin * up[k])
    }
}

/// Up of a scene that stands askew.
const UP: [f64; 3] = [0.0, -0.6, 0.8];

fn site(daylight: Daylight) -> Site {
    Site { up: UP, airlight: [0.2, 0.3, 0.1], daylight, ..Site::PLAIN }
}

/// A sky as the words of `--set` make it; `picture` is what every panorama shows.
fn dome(words: &[&str], picture: fn(usize) -> [f32; 3]) -> Dome {
    weather(words, picture).prepare(&site(Daylight::Known)).dome.unwrap()
}

fn weather(words: &[&str], picture: fn(usize) -> [f32; 3]) -> WeatherSample {
    let mut weather = crate::testing::weather(words);
    weather.load_images(|_| Panorama::new(256, 128, picture).map(Arc::new)).unwrap();
    weather.at(0.0)
}

/// A picture of smooth colours with a hard edge at the horizon.
fn waves(i: usize) -> [f32; 3] {
    let (x, y) = ((i % 256) as f32 / 256.0, (i / 256) as f32 / 128.0);
    let ground = if y > 0.5 { 0.3 } else { 0.0 };
    [0.5 + 0.4 * (12.0 * x).sin() - ground, 0.4 + 0.3 * (9.0 * y).cos(), x * 1.5]
}

const SKIES: [&[&str]; 9] = [
    &["sky.color=#a8c4e0"],
    &["sky.color=#a8c4e0", "sky.ground=#402010"],
    &["sky=clear"],
    &["sky=overcast", "sky.brightness=1.4"],
    &["sky=gradient", "sky.brightness=0.5"],
    &["sky=clear", "sky.zenith=#102040", "sky.horizon=#ff8040", "sky.ground=#201810"],
    &["sky.panorama=p", "sky.heading=70"],
    &["sky.panorama=p", "sky.below=picture"],
    &["sky.panorama=p", "sky.heading=-400", "sky.brightness=0.3", "sky.ground=#a0a0a0"],
];

/// A sky by elevation is tabled: the clear one bends most, near the horizon, by 8e-4 of its range a
/// step of the table, an eighth of which is lost between. A panorama is read at angles that are off
/// by 1.2e-5: 5e-4 of one of its pixels here, times the 0.5 of its edge.
#[test]
fn what_is_painted_is_what_the_referee_says() {
    for words in SKIES {
        let dome = dome(words, waves);
        for pixel in [1e-4, 0.03, 0.2] {
            let mut groups = [ShadeGroup::default(); 64];
            let directions: Vec<[f64; 3]> = (0..64 * GROUP)
                .map(|i| dome.leaning((i as f64 + 0.5) / 512.0 - 1.0, i as f64 * 2.4))
                .collect();
            for (i, direction) in directions.iter().enumerate() {
                (0..3).for_each(|k| groups[i / GROUP].direction[k][i % GROUP] = direction[k] as f32);
            }
            dome.paint(pixel, &mut groups);
            for (i, direction) in directions.iter().enumerate() {
                let want = dome.reference(pixel, *direction);
                for k in 0..3 {
                    let got = f64::from(groups[i / GROUP].rgb[k][i % GROUP]);
                    assert!((got - want[k]).abs() < 4e-4, "{words:?} {pixel} {i}: {got}, want {}", want[k]);
                }
            }
            if let Some(uniform) = dome.uniform() {
                assert!((0..3).all(|k| groups[5].rgb[k].iter().all(|v| (v - uniform[k]).abs() < 1e-6)));
            }
        }
    }
}

#[test]
fn the_overcast_sky_is_the_cies() {
    let dome = dome(&["sky=overcast", "sky.zenith=#808080"], waves);
    let zenith = srgb_decode(128.0 / 255.0);
    for sin in [0.0, 0.25, 0.5, 1.0] {
        let light = srgb_decode(dome.reference(1e-3, dome.leaning(sin, 1.0))[1]);
        assert!((light - zenith * (1.0 + 2.0 * sin) / 3.0).abs() < 1e-9);
    }
    // The table of CIE S 011, type 12: 1 at the horizon, 0.274 at the zenith, 0.473 at 30 degrees.
    let clear = dome_of_light(0.274, 1.0);
    let light = srgb_decode(clear.reference(1e-3, clear.leaning(0.5, 1.0))[1]);
    assert!((light - 0.4727).abs() < 1e-3, "{light}");
}

fn dome_of_light(zenith: f64, horizon: f64) -> Dome {
    let look = SkyAppearance::Clear { zenith: [zenith; 3], horizon: [horizon; 3] };
    Dome::new(look, None, 1.0, UP, SkySplats::Kept)
}

/// Nowhere a step: half a thousandth of a sphere's height changes no channel by more than 1 %, and
/// the horizon of skies by elevation is the brighter side of nothing.
#[test]
fn there_is_no_edge_at_the_horizon() {
    for words in SKIES.iter().filter(|words| !words.contains(&"sky.below=picture")) {
        let dome = dome(words, waves);
        let at = |sin: f64| dome.reference(1e-3, dome.leaning(sin, 0.0));
        for i in 0..2000 {
            let sin = f64::from(i) / 1000.0 - 1.0;
            let (a, b) = (at(sin), at(sin + 0.0005));
            assert!((0..3).all(|k| (a[k] - b[k]).abs() < 0.01), "{words:?} at {sin}: {a:?}, {b:?}");
        }
    }
}

/// Endless fog is the airlight wherever one looks, with any sky behind it.
#[test]
fn fog_hides_every_sky() {
    let layer = AirLayer {
        sigma_t: [sigma_of_mor(60.0); 3],
        airlight: [0.7, 0.72, 0.75],
        scale_height: 500.0,
        base_height: 0.0,
    };
    let air = Atmosphere::new(vec![layer], site(Daylight::Known));
    let path = SimdPath::select(SimdChoice::Auto).unwrap();
    let want = layer.airlight.map(srgb_encode);
    for words in SKIES {
        let dome = dome(words, waves);
        let mut groups = [ShadeGroup { distance: [f32::INFINITY; GROUP], ..ShadeGroup::default() }; 8];
        for i in 0..8 * GROUP {
            let direction = dome.leaning(1.0 - 2.0 * (i as f64 + 0.5) / (8.0 * GROUP as f64), i as f64);
            (0..3).for_each(|k| groups[i / GROUP].direction[k][i % GROUP] = direction[k] as f32);
        }
        dome.paint(1e-3, &mut groups);
        air.shade(path, [0.0; 3], &mut groups);
        for group in &groups {
            for k in 0..3 {
                assert!(group.rgb[k].iter().all(|v| (f64::from(*v) - want[k]).abs() < 1e-3), "{words:?}");
            }
        }
    }
}

#[test]
fn headings_turn_clockwise_from_the_x_axis() {
    // A white meridian in the middle of a black picture.
    let line = |i: usize| if (127..129).contains(&(i % 256)) { [1.0; 3] } else { [0.0; 3] };
    for (up, ahead, right) in [
        ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]),
        ([0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]),
        ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]),
    ] {
        for (heading, toward) in [(0.0, ahead), (90.0, right), (180.0, ahead.map(|v: f64| -v))] {
            let panorama = Arc::new(Panorama::new(256, 128, line).unwrap());
            let dome = Dome::new(
                SkyAppearance::Panorama { panorama, heading, below: LowerHemisphere::Haze },
                None,
                1.0,
                up,
                SkySplats::Kept,
            );
            let bright = dome.reference(1e-3, toward)[0];
            assert!(bright > 0.99, "{up:?} {heading}: {bright}");
            assert!(dome.reference(1e-3, toward.map(|v| -v))[0] < 0.01);
        }
    }
}

#[test]
fn the_airlight_is_the_skys_where_nothing_better_is_known() {
    let airlight = |words: &[&str], daylight| {
        let over = weather(words, waves).prepare(&site(daylight));
        // What is seen where nothing is left of anything else.
        over.air.reference([0.0; 3], UP, 1e30, [0.0; 3]).map(srgb_decode)
    };
    let (known, fog) = (site(Daylight::Known).airlight, "fog.mor=50");
    let is_known = |light: [f64; 3]| (0..3).all(|k| (light[k] - known[k]).abs() < 1e-9);
    assert!(is_known(airlight(&[fog, "sky=overcast"], Daylight::Known)));
    assert!(is_known(airlight(&[fog], Daylight::Guessed)));
    // The CIE's overcast sky within 20 degrees: (1 + 0.342) / 3 of the zenith.
    let grey = airlight(&[fog, "sky=overcast", "sky.zenith=#ffffff"], Daylight::Guessed);
    assert!(grey.iter().all(|v| (v - 1.342 / 3.0).abs() < 1e-3), "{grey:?}");
    assert_eq!(
        grey,
        airlight(&[fog, "sky=overcast", "sky.zenith=#ffffff", "sky.scene_sky=replace"], Daylight::Known)
    );
    // Never bluer than fog in daylight, never at display white, never black.
    for words in SKIES {
        let [r, g, b] = airlight(&[&[fog], words].concat(), Daylight::Guessed);
        assert!(b <= 1.1 * r + 1e-9 && luminance([r, g, b]) < 0.901, "{words:?}: {r} {g} {b}");
    }
    assert!(is_known(airlight(&[fog, "sky.color=#000000"], Daylight::Guessed)));
    let red = airlight(&["fog.airlight=#ff0000", "sky=clear"], Daylight::Guessed);
    assert!(red[0] > 0.999 && red[1] < 1e-9, "{red:?}");
}

#[test]
fn a_sky_runs_between_keyframes() {
    let mut weather = Weather::parse(
        "[sky]\ncolor = { keys = [[0, \"#000000\"], [2, \"#ffffff\"]] }\nheading = { keys = [[0, 0], [2, 90]] }\n",
        "w",
    )
    .unwrap();
    let color = weather.at(1.0).prepare(&site(Daylight::Known)).dome.unwrap().reference(1e-3, UP);
    // Half of the light.
    assert!(color.iter().all(|v| (v - srgb_encode(0.5)).abs() < 1e-9));
    for (text, want) in [
        ("sky.model=0:clear,2:cloudy", "sky.model is `cloudy`: must be one of auto, clear,"),
        ("sky=cloudy", "sky is auto, clear, overcast, gradient, on or off; its parameters are model,"),
        ("sky.panorama=", "sky.panorama is ``: must be the path of a picture, or \"auto\""),
        ("sky.scene_sky=drop", "sky.scene_sky is `drop`: must be one of keep, replace"),
    ] {
        let error = weather.set_text(text).unwrap_err().to_string();
        assert!(error.starts_with(&format!("--set {text}: {want}")), "{error}");
    }
    for (text, want) in [
        (
            "sky = \"cloudy\"\n",
            "w:1:7: sky must be one of auto, clear, overcast, gradient, or a table: write [sky]",
        ),
        ("[sky]\nmodel = 3\n", "w:2:9: sky.model is 3: must be one of auto, clear, overcast, gradient"),
        ("[sky]\npanorama = [1, 2, 3]\n", "w:2:12: sky.panorama is 1,2,3: must be the path of a picture"),
        (
            "[sky]\npanorama = { keys = [[0, \"a.png\"], [1, \"b.png\"]] }\n",
            "w:2:12: sky.panorama at time 0 is a.png: keyframes run between finite values",
        ),
    ] {
        let error = Weather::parse(text, "w").unwrap_err().to_string();
        assert!(error.starts_with(want), "{error}");
    }
    // In a file the folder is the file's.
    let folder = std::env::temp_dir().join(format!("wm-sky-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("w.toml"), "sky = \"overcast\"\n").unwrap();
    assert_eq!(Weather::read(&folder.join("w.toml")).unwrap().effects().count(), 1);
    std::fs::write(folder.join("w.toml"), "[sky]\npanorama = \"a/b:c.png\"\n").unwrap();
    let mut read = Weather::read(&folder.join("w.toml")).unwrap();
    assert_eq!(read.images().next().unwrap().path(), folder.join("a/b:c.png"));
    std::fs::remove_dir_all(&folder).unwrap();
}

proptest! {
    /// Whatever the numbers: colours that are numbers.
    #[test]
    fn colours_are_numbers(
        zenith in prop::array::uniform3(0.0..1.0f64),
        horizon in prop::array::uniform3(0.0..1.0f64),
        brightness in 0.0..100.0f64,
        sin in -1.0..=1.0f64,
    ) {
        for look in [SkyAppearance::Clear { zenith, horizon }, SkyAppearance::Overcast { zenith, horizon }, SkyAppearance::Plain(zenith)] {
            let dome = Dome::new(look, None, brightness, UP, SkySplats::Kept);
            let color = dome.reference(1e-3, dome.leaning(sin, 0.3));
            prop_assert!(color.iter().all(|v| v.is_finite() && *v >= 0.0));
            prop_assert!(dome.airlight().is_none_or(|light| light.iter().all(|v| (0.0..=1.1).contains(v))));
        }
    }
}

/// A sky burns out without a step and without another hue than white or its own.
#[test]
fn bright_skies_go_over_into_white() {
    let tint = [1.0, 0.6, 0.2];
    let mut before = 0.0;
    for step in 1..400 {
        let factor = f64::from(step) * 0.05;
        let shown = burned_out(tint.map(|v| v * factor));
        assert!(shown.iter().all(|v| (0.0..=1.0).contains(v)), "{shown:?}");
        assert!(shown[0] >= shown[1] && shown[1] >= shown[2] && shown[0] > before - 1e-12, "{shown:?}");
        before = shown[0];
    }
    assert!(burned_out(tint.map(|v| v * 100.0)).iter().all(|v| *v > 0.95));
    assert_eq!(burned_out([0.5, 0.6, 0.7]), [0.5, 0.6, 0.7]);
}
