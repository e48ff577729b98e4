//! Fidelity `paper`: the paper's fog, from a clear picture and its depth.
//!
//! `eq:style_intensity`: `alpha_style = min(1, 1 - exp(-I_style D_ref))`; `eq:fog style`:
//! `C = C_fog alpha_style + C_render (1 - alpha_style)`, in display-referred colour. `C_render` and the
//! depth come out of the program as files; the equations are applied here, anew.

mod common;

use common::*;

const D_MAX: f64 = 10.0;
const INTENSITY: f64 = 2.2;
const FOG: [f64; 3] = [0xc8 as f64 * STEP, 0xcd as f64 * STEP, 0xd2 as f64 * STEP];

/// `D_ref = min(1, D_abs / d_max)` where `D_abs` is the depth of the splats by their weights, and what they
/// do not cover is `d_max` away.
///
/// Tolerances: floats of f32 in both, 1e-5 of the encoded colour. Where coverage is below 1/255 the program
/// gives no depth, which takes `z / (255 d_max)` at most from `D_ref`, and `I exp(-I D_ref)` of that, 0.25,
/// from `alpha_style`: below 1/255 for depths to 3 `d_max`, and all of this scene is nearer. An 8-bit picture
/// without dither adds half a step: 1/255 holds where there is coverage.
#[test]
fn the_papers_equation_gives_the_picture() {
    let workshop = Workshop::new();
    // Half a metre a unit, so that metres and units cannot be confused.
    let scene = workshop.scene("yard", yard().build(), &yard_metadata(0.5));
    let (_, view) = yard_look((144, 96));
    let clear = read_exr(&workshop.render(&scene, &view, "clear.exr", "--also depth,alpha"));
    let depth = read_channel(&workshop.path("clear.depth.exr"), "Z");
    let alpha = read_channel(&workshop.path("clear.alpha.exr"), "A");
    let weather = format!(
        "--set fidelity=paper --set fog.paper_intensity={INTENSITY} --set fog.paper_d_max={D_MAX} \
         --set fog.paper_color=#c8cdd2"
    );
    let exr = read_exr(&workshop.render(&scene, &view, "fog.exr", &weather));
    let png = read_png(&workshop.render(&scene, &view, "fog.png", &format!("{weather} --dither off")));
    let physical = read_exr(&workshop.render(&scene, &view, "physical.exr", "--set fog.mor=20"));

    // Pixels that are covered, that are not, and that are as far as counts.
    let (mut covered, mut open, mut far) = (0, 0, 0);
    let (mut off_exr, mut off_png, mut other) = (0.0f64, 0.0f64, 0.0f64);
    for i in 0..clear.pixels.len() {
        let (a, z) = (alpha.pixels[i], depth.pixels[i]);
        let relative = ((a * z + (1.0 - a) * D_MAX) / D_MAX).min(1.0);
        let style = (1.0 - (-INTENSITY * relative).exp()).min(1.0);
        for (k, fog) in FOG.into_iter().enumerate() {
            let wanted = fog * style + encode(clear.pixels[i][k]) * (1.0 - style);
            let float = (encode(exr.pixels[i][k]) - wanted).abs();
            let byte = (f64::from(png.pixels[i][k]) * STEP - wanted).abs();
            (off_exr, off_png) = (off_exr.max(float), off_png.max(byte));
            other = other.max((encode(physical.pixels[i][k]) - wanted).abs());
        }
        covered += usize::from(a > 0.99 && z < 0.8 * D_MAX);
        open += usize::from(a < 0.01);
        far += usize::from(a > 0.99 && z > D_MAX);
    }
    println!(
        "{covered} near, {far} far, {open} open: EXR off by {:.4}/255, PNG by {:.3}/255; physical by {:.0}/255",
        off_exr / STEP,
        off_png / STEP,
        other / STEP
    );
    assert!(covered > 1000 && open > 1000 && far > 100, "{covered}, {open}, {far}");
    assert!(off_exr <= STEP && off_png <= STEP);
    // The test can fail: physical fog is another picture.
    assert!(other > 10.0 * STEP);
}
