use super::*;
use crate::optics::Site;
use crate::testing;
use crate::weather::{Observer, Weather};
use glam::DVec3;
use wm_render::frame::{srgb_decode, srgb_encode};
use wm_render::testing::uniform;
use wm_scene::Camera;

impl ColorGrade {
    /// Applies it to a display-referred colour in f64: the reference for the SIMD code.
    pub(crate) fn reference(&self, rgb: [f64; 3]) -> [f64; 3] {
        let light: [f64; 3] = std::array::from_fn(|k| srgb_decode(rgb[k]) * self.gains[k]);
        let grey = luminance(light);
        light.map(|light| self.shown((grey + self.saturation * (light - grey)).max(0.0)))
    }

    /// Contrast, and back to the display.
    fn shown(&self, light: f64) -> f64 {
        srgb_encode(MID_GREY * (light / MID_GREY).powf(self.contrast))
    }
}

wm_render::cpu_parity! {
    look_agrees_with_f64 => |backend| {
        let path = backend.path();
        for (i, grade) in grades().iter().enumerate() {
            agree(path, grade, i as u64);
        }
    };
}

const SITE: Site = Site { airlight: [0.6, 0.7, 0.8], far: 300.0, ..testing::SITE };

fn grade(exposure: f64, saturation: f64, contrast: f64, temperature: f64) -> ColorGrade {
    ColorGrade::new(exposure, saturation, contrast, temperature)
}

fn grades() -> Vec<ColorGrade> {
    vec![
        grade(-0.5, 0.7, 0.85, -0.2),
        grade(1.0, 1.0, 1.0, 0.0),
        grade(0.0, 1.0, 1.0, 1.0),
        grade(0.0, 0.0, 1.0, 0.0),
        grade(0.0, 4.0, 1.0, 0.0),
        grade(0.0, 1.0, 0.5, 0.0),
        grade(3.0, 2.0, 4.0, -1.0),
        grade(-10.0, 1.5, 0.7, 0.5),
    ]
}

/// One patch of colours, changed.
fn changed(path: SimdPath, effects: &[&dyn PixelEffect], rgb: &mut [[f32; PATCH_PIXELS]; 3]) {
    let (alpha, depth) = ([1.0; PATCH_PIXELS], [5.0; PATCH_PIXELS]);
    for effect in effects {
        effect.apply(path, &mut PixelBatch { x: 0, y: 0, rgb: &mut *rgb, alpha: &alpha, depth_sum: &depth });
    }
}

/// Light errs by 2e-6 relative when decoded and multiplied, and saturation is a difference of two
/// such: 2e-6 (1 + s) of the brightest channel, which moves the result between those of light that
/// much darker and brighter. log2 of light above 1e-7 errs by 3e-6, times contrast (4 at most) and
/// ln 2, and the encoding takes it to the power of 1 / 2.4 with an error of 1e-6: 5e-6 of the
/// result, or 1e-5 where the encoding is linear.
fn agree(path: SimdPath, grade: &ColorGrade, seed: u64) {
    let mut rgb = [[0.0f32; PATCH_PIXELS]; 3];
    for i in 0..PATCH_PIXELS {
        let most = if i % 8 == 0 { 4.0 } else { 1.0 };
        for k in 0..3 {
            let value = most * uniform(seed, (3 * i + k) as u64);
            rgb[k][i] = if i % 16 == 1 || i % 16 == 2 && k == 0 { 0.0 } else { value as f32 };
        }
        if i % 16 == 3 {
            (rgb[1][i], rgb[2][i]) = (rgb[0][i], rgb[0][i]);
        }
    }
    let before = rgb;
    changed(path, &[grade], &mut rgb);
    for i in 0..PATCH_PIXELS {
        let color = [0, 1, 2].map(|k| f64::from(before[k][i]));
        let light: [f64; 3] = std::array::from_fn(|k| srgb_decode(color[k]) * grade.gains[k]);
        let error = 2e-6 * (1.0 + grade.saturation) * light.into_iter().fold(0.0, f64::max);
        let grey = luminance(light);
        let want = grade.reference(color);
        for k in 0..3 {
            let exact = (grey + grade.saturation * (light[k] - grey)).max(0.0);
            let (least, most) = (grade.shown((exact - error).max(0.0)), grade.shown(exact + error));
            let allowed = 1e-5 * want[k].max(1e-3);
            let got = f64::from(rgb[k][i]);
            assert!(
                got >= least - allowed && got <= most + allowed,
                "{grade:?} {color:?} {k}: {got}, want {}",
                want[k]
            );
        }
    }
}

fn camera() -> Camera {
    Camera::looking((16, 16), 50.0, DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap()
}

#[test]
fn the_defaults_are_no_effect() {
    let mut weather = testing::weather(["look=on"]);
    let pixels = |weather: &Weather| {
        let weather = weather.at(0.0).prepare(&SITE);
        weather.pass(&Observer::at_rest(&camera())).hooks().pixels.len()
    };
    assert_eq!((weather.effects().count(), pixels(&weather)), (1, 0));
    for text in ["exposure=0.1", "saturation=0.9", "contrast=1.1", "temperature=-0.1"] {
        let mut weather = weather.clone();
        weather.set_text(&format!("look.{text}")).unwrap();
        assert_eq!(pixels(&weather), 1, "{text}");
    }
    weather.set_text("look.exposure=0:0,2:-1").unwrap();
    let light = |time: f64| {
        let weather = weather.at(time).prepare(&SITE);
        let mut rgb = [[0.5f32; PATCH_PIXELS]; 3];
        let camera = camera();
        let pass = weather.pass(&Observer::at_rest(&camera));
        changed(SimdPath::available()[0], &pass.hooks().pixels, &mut rgb);
        rgb[0][0]
    };
    assert_eq!(light(0.0), 0.5);
    assert!((f64::from(light(2.0)) - srgb_encode(srgb_decode(0.5) / 2.0)).abs() < 1e-5);
}

/// Measures a picture as a viewer would, by formulas of its own.
#[test]
fn each_parameter_does_what_it_says() {
    let color = [0.7, 0.4, 0.2];
    let light = color.map(srgb_decode);
    let graded = |exposure, saturation, contrast, temperature| {
        grade(exposure, saturation, contrast, temperature).reference(color).map(srgb_decode)
    };
    let near = |got: [f64; 3], want: [f64; 3]| {
        assert!((0..3).all(|k| (got[k] - want[k]).abs() < 1e-6), "{got:?}, want {want:?}");
    };
    near(graded(-1.0, 1.0, 1.0, 0.0), light.map(|v| v / 2.0));
    near(graded(0.0, 0.0, 1.0, 0.0), [luminance(light); 3]);
    let half = graded(0.0, 0.5, 1.0, 0.0);
    near(half, light.map(|v| (v + luminance(light)) / 2.0));
    near(graded(0.0, 1.0, 2.0, 0.0), light.map(|v| v * v / 0.18));
    // Mid grey and black stay under any contrast.
    let grey = srgb_encode(0.18);
    let kept = grade(0.0, 1.0, 0.5, 0.0).reference([grey, 0.0, grey]);
    near(kept, [grey, 0.0, grey]);
    // Warmer: twice the red against blue, and a grey wall as bright as before.
    let warm = grade(0.0, 1.0, 1.0, 1.0).reference([0.5; 3]).map(srgb_decode);
    assert!((warm[0] / warm[2] - 2.0).abs() < 1e-5 && warm[0] > srgb_decode(0.5), "{warm:?}");
    assert!((luminance(warm) - srgb_decode(0.5)).abs() < 1e-6);
    let cool = balance(-1.0);
    assert!((cool[2] / cool[0] - 2.0).abs() < 1e-12 && cool[2] > 1.0);
}

#[test]
fn it_acts_after_fog_over_pixels() {
    let sets = ["look.exposure=-1", "fog.paper_intensity=1", "fog.paper_color=#ffffff", "fidelity=paper"];
    let weather = testing::weather(sets);
    let mut rgb = [[0.0f32; PATCH_PIXELS]; 3];
    let (weather, camera) = (weather.at(0.0).prepare(&SITE), camera());
    let pass = weather.pass(&Observer::at_rest(&camera));
    let hooks = pass.hooks();
    assert_eq!(hooks.pixels.len(), 2);
    changed(SimdPath::available()[0], &hooks.pixels, &mut rgb);
    // Black at 5 m of 300 m under white fog, and half the light of that.
    let foggy = 1.0 - (-5.0f64 / 300.0).exp();
    let want = srgb_encode(srgb_decode(foggy) / 2.0);
    assert!((f64::from(rgb[0][0]) - want).abs() < 1e-5, "{}, want {want}", rgb[0][0]);
}

/// Light far above white under the strongest of looks: 6e4 encoded is 2^38 of light, 2^200 after
/// it.
#[test]
fn bright_light_stays_finite() {
    for path in SimdPath::available() {
        let mut rgb = [[6e4f32; PATCH_PIXELS]; 3];
        changed(path, &[&grade(10.0, 4.0, 4.0, 0.0)], &mut rgb);
        assert!(rgb.iter().flatten().all(|v| v.is_finite() && *v > 1.0), "{path}");
    }
}
