//! Fidelity `paper`: the paper's fog, from a clear picture and its depth; its rain and snow, from
//! its intermediate pictures.
//!
//! `eq:style_intensity`: `alpha_style = min(1, 1 - exp(-I_style D_ref))`; `eq:fog style`:
//! `C = C_fog alpha_style + C_render (1 - alpha_style)`, in display-referred colour. `C_render` and
//! the depth come out of the program as files; the equations are applied here, anew.

use crate::common::*;

const D_MAX: f64 = 10.0;
const FOG_INTENSITY: f64 = 2.2;
const FOG_COLOR: [f64; 3] = [0xc8 as f64 * BYTE_STEP, 0xcd as f64 * BYTE_STEP, 0xd2 as f64 * BYTE_STEP];

/// The yard at half a metre a unit, so that metres and units cannot be confused.
fn yard(size: (u32, u32)) -> Shot {
    Shot::yard_with(size, &yard_metadata(0.5))
}

/// `D_ref = min(1, D_abs / d_max)` where `D_abs` is the depth of the splats by their weights, and
/// what they do not cover is `d_max` away.
///
/// Tolerances: floats of f32 in both, 1e-5 of the encoded colour. Where coverage is below 1/255 the
/// program gives no depth, which takes `z / (255 d_max)` at most from `D_ref`, and
/// `I exp(-I D_ref)` of that, 0.25, from `alpha_style`: below 1/255 for depths to 3 `d_max`, and
/// all of this scene is nearer. An 8-bit picture without dither adds half a step: 1/255 holds where
/// there is coverage.
#[test]
fn the_papers_equation_gives_the_picture() {
    let yard = yard((144, 96));
    let clear = read_exr(&yard.render("clear.exr", "--also depth,alpha"));
    let depth = read_channel(&yard.path("clear.depth.exr"), "Z");
    let alpha = read_channel(&yard.path("clear.alpha.exr"), "A");
    let weather = format!(
        "--set fidelity=paper --set fog.paper_intensity={FOG_INTENSITY} --set fog.paper_d_max={D_MAX} \
         --set fog.paper_color=#c8cdd2"
    );
    let exr = yard.exr(&weather);
    let png = yard.png(&format!("{weather} --dither off"));
    let physical = yard.exr("--set fog.mor=20");

    // Pixels that are covered, that are not, and that are as far as counts.
    let (mut covered, mut open, mut far) = (0, 0, 0);
    let (mut off_exr, mut off_png, mut other) = (0.0f64, 0.0f64, 0.0f64);
    for i in 0..clear.pixels.len() {
        let (a, z) = (alpha.pixels[i], depth.pixels[i]);
        let relative = ((a * z + (1.0 - a) * D_MAX) / D_MAX).min(1.0);
        let style = (1.0 - (-FOG_INTENSITY * relative).exp()).min(1.0);
        for (k, fog) in FOG_COLOR.into_iter().enumerate() {
            let wanted = fog * style + encode(clear.pixels[i][k]) * (1.0 - style);
            let float = (encode(exr.pixels[i][k]) - wanted).abs();
            let byte = (f64::from(png.pixels[i][k]) * BYTE_STEP - wanted).abs();
            (off_exr, off_png) = (off_exr.max(float), off_png.max(byte));
            other = other.max((encode(physical.pixels[i][k]) - wanted).abs());
        }
        covered += usize::from(a > 0.99 && z < 0.8 * D_MAX);
        open += usize::from(a < 0.01);
        far += usize::from(a > 0.99 && z > D_MAX);
    }
    println!(
        "{covered} near, {far} far, {open} open: EXR off by {:.4}/255, PNG by {:.3}/255; physical by {:.0}/255",
        off_exr / BYTE_STEP,
        off_png / BYTE_STEP,
        other / BYTE_STEP
    );
    assert!(covered > 1000 && open > 1000 && far > 100, "{covered}, {open}, {far}");
    assert!(off_exr <= BYTE_STEP && off_png <= BYTE_STEP);
    // The test can fail: physical fog is another picture.
    assert!(other > 10.0 * BYTE_STEP);
}

/// Drops wide enough for a small picture, and nothing after the last sub-cloud.
const BARE: &str = "--set fidelity=paper --set rain.paper_width=0.03 --set rain.paper_fog=0 --set rain.paper_blur=0 \
                    --set rain.paper_exposure=0 --set rain.paper_saturation=1 --set rain.paper_contrast=1 \
                    --set rain.paper_temperature=0 --set rain.paper_l_sky=0.8 --dither off";

/// With k = 1 the pictures between say all: `C = C_render + f_l C_noise` where the noise is kept,
/// and `C_render` where it is masked, `f_l = exp(clamp(0.8 - L, 0, 0.35)) - 1`.
///
/// Tolerance: the noise is known to half a step, of which `f_l` takes 0.42; the rest is the
/// rounding of floats.
#[test]
fn rain_is_the_papers_sum_of_its_stages() {
    let yard = yard((144, 96));
    let clear = yard.exr("");
    let rain = yard.exr(&format!("{BARE} --set rain.paper_k=1 --stages"));
    let [noise, overlay, filtered, last] = ["noise", "overlay", "filtered", "final"].map(|name| {
        read_png(&yard.path(format!("shot.{name}.png"))).map(|rgb| rgb.map(|v| f64::from(v) * BYTE_STEP))
    });
    let (mut kept, mut masked, mut dark, mut bright) = (0, 0, (0.0, 0), (0.0, 0));
    for i in 0..clear.pixels.len() {
        let before = clear.pixels[i].map(encode);
        let after = rain.pixels[i].map(encode);
        let light = before.iter().sum::<f64>() / 3.0;
        let factor = (0.8 - light).clamp(0.0, 0.35).exp() - 1.0;
        let is_kept = filtered.pixels[i][0] > 0.0;
        assert!(!is_kept || filtered.pixels[i] == noise.pixels[i]);
        for k in 0..3 {
            let wanted = before[k] + if is_kept { factor * noise.pixels[i][k] } else { 0.0 };
            assert!((after[k] - wanted).abs() < 0.25 * BYTE_STEP, "{} {wanted}", after[k]);
            assert!((last.pixels[i][k] - after[k].min(1.0)).abs() < 0.51 * BYTE_STEP);
            if noise.pixels[i][k] == 0.0 {
                // Less than half a step of noise, and its cover that is about as little.
                assert!((overlay.pixels[i][k] - before[k].min(1.0)).abs() < 1.5 * BYTE_STEP);
            }
        }
        kept += usize::from(is_kept);
        masked += usize::from(!is_kept && noise.pixels[i][0] > 0.3);
        if filtered.pixels[i][0] > 0.5 {
            let sum = if light < 0.4 { &mut dark } else { &mut bright };
            *sum = (sum.0 + after[1] - before[1], sum.1 + 1);
        }
    }
    println!("{kept} pixels of rain, {masked} masked; added {dark:?} where dark, {bright:?} where bright");
    assert!(kept > 500 && masked > 100, "{kept}, {masked}");
    // Streaks stand out before what is dark.
    assert!(dark.0 / f64::from(dark.1) > 1.5 * bright.0 / f64::from(bright.1), "{dark:?} {bright:?}");
}

/// The four pictures lie beside the one asked for, which is the same without them.
#[test]
fn stages_are_written_beside_the_picture() {
    let yard = yard((144, 96));
    let weather = "--set fidelity=paper --set snowfall.rate=2 --set rain.rate=5 --time 1.5";
    yard.render("plain.png", weather);
    yard.render("with.png", &format!("{weather} --stages"));
    let plain = yard.read("plain.png");
    assert_eq!(plain, yard.read("with.png"));
    let pictures =
        ["noise", "overlay", "filtered", "final"].map(|name| yard.path(format!("with.{name}.png")));
    for (i, path) in pictures.iter().enumerate() {
        let picture = read_png(path);
        assert_eq!((picture.width, picture.height), (144, 96));
        assert!(pictures[..i].iter().all(|other| read_png(other) != picture), "{}", path.display());
    }
    assert_eq!(std::fs::read(&pictures[3]).unwrap(), plain);
    for (options, out, says) in [
        ("--set rain.rate=5", "a.png", "--stages: shows the steps of the paper's rain and snow"),
        ("--set fidelity=paper --set fog.mor=50", "a.png", "add --set fidelity=paper and --set rain.rate=10"),
        ("--set fidelity=paper --set rain.rate=5 --seconds 1", "a.mp4", "--stages: is for a picture"),
    ] {
        yard.refused_by(&mut yard.command(out, &format!("{options} --stages")), &[says]);
    }
}

/// A frame alone, in its sequence, and by another number of threads.
#[test]
fn paper_rain_has_the_same_bytes_however_it_is_rendered() {
    let yard = yard((80, 48));
    let weather = "--set fidelity=paper --set rain.rate=0:2,1:20 --set rain.paper_width=0.03 \
                   --set rain.paper_speed=0:5,1:9 --set wind.speed=4 --seconds 0.2";
    yard.render("all", &format!("{weather} --threads 1"));
    yard.render("one", &format!("{weather} --threads 3 --frames 4..5"));
    assert_eq!(yard.read("all/00004.png"), yard.read("one/00004.png"));
    // And it rains differently a thirtieth of a second later.
    let [now, later] = ["all/00004.png", "all/00005.png"].map(|name| read_png(&yard.path(name)).pixels);
    assert_ne!(now, later);
}
