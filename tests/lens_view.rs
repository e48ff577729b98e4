//! Pictures through fisheyes, panoramas and distorted lenses.

mod common;

use common::*;
use weather_magician::{Camera, FrameOptions, LensModel, LensView, Picture, Renderer, Scene, Weather};
use wm_scene::capture::Distortion;

/// Rain in fog over wet ground.
const WEATHER: [&str; 4] = ["fog.mor=120", "rain.rate=30", "wetness.amount=1", "wetness.puddles=0.5"];

/// A pinhole picture of the yard and one through a lens, with depth.
fn both(camera: &Camera, lens: &LensView) -> [Picture; 2] {
    let mut renderer = Renderer::cpu().unwrap();
    let metadata = yard_metadata(1.0);
    let scene = Scene { splats: yard().build(), metadata, views: Vec::new() };
    let mut place = renderer.load(scene).unwrap();
    place.config.outputs.geometry = wm_render::Geometry::Depth;
    let mut weather = Weather::clear();
    WEATHER.iter().try_for_each(|change| weather.set_text(change)).unwrap();
    let mut pictures = [Picture::default(), Picture::default()];
    let options = FrameOptions::new(2.0, *camera);
    renderer.render_into(&mut place, &weather, &options, &mut pictures[0], &mut ()).unwrap();
    renderer.render_through(&mut place, &weather, (lens, &options), &mut pictures[1], &mut ()).unwrap();
    pictures
}

/// A lens without distortion is a pinhole: its one side is the same picture with a margin.
#[test]
fn a_lens_without_distortion_is_a_pinhole() {
    let (camera, _) = yard_look((120, 80));
    let lens = LensView::new(LensModel::Perspective(Distortion::None), &camera).unwrap();
    let [pinhole, picture] = both(&camera, &lens);
    let most =
        largest(pinhole.frame.rgb.iter().zip(&picture.frame.rgb).map(|(a, b)| f64::from((a - b).abs())));
    // The margin moves what is gathered and sampled for the whole picture, such as films of water at every fourth pixel.
    let sum: f64 =
        pinhole.frame.rgb.iter().zip(&picture.frame.rgb).map(|(a, b)| f64::from((a - b).abs())).sum();
    let mean = sum / pinhole.frame.rgb.len() as f64;
    assert!(mean < 5e-4, "{mean} {most}");
}

/// What a fisheye and a panorama show is where a pinhole shows it, with the same weather before it, and as far away.
#[test]
fn lenses_show_what_pinholes_show() {
    let (camera, _) = yard_look((240, 160));
    let (fisheye, round) = LensModel::fisheye((256, 256), 180.0).unwrap();
    let wide = Camera { width: 768, height: 384, ..round };
    for (lens, own) in [(fisheye, round), (LensModel::Equirectangular, wide)] {
        let view = LensView::new(lens, &own).unwrap();
        let [pinhole, picture] = both(&camera, &view);
        let (mut sum, mut count) = (0.0, 0);
        let (mut off, mut solid) = (0.0, 0);
        for y in 0..own.height {
            for x in 0..own.width {
                let Some(ray) = lens.ray(&own, [f64::from(x) + 0.5, f64::from(y) + 0.5]) else {
                    let at = picture.frame.index(x, y);
                    assert_eq!(picture.frame.rgb[3 * at..3 * at + 3], [0.0; 3]);
                    continue;
                };
                let at = [ray.x / ray.z * camera.fx + camera.cx, ray.y / ray.z * camera.fy + camera.cy];
                let inside = at[0] > 1.0 && at[1] > 1.0 && at[0] < 239.0 && at[1] < 159.0;
                if ray.z <= 0.0 || !inside {
                    continue;
                }
                let (from, to) = (picture.frame.index(x, y), pinhole.frame.index(at[0] as u32, at[1] as u32));
                for k in 0..3 {
                    sum += f64::from((picture.frame.rgb[3 * from + k] - pinhole.frame.rgb[3 * to + k]).abs());
                }
                count += 3;
                let (far, z) = (f64::from(picture.frame.depth[from]), f64::from(pinhole.frame.depth[to]));
                if far > 0.0 && z > 0.0 {
                    solid += 1;
                    off += f64::from(u8::from((far * ray.z / z - 1.0).abs() > 0.05));
                }
            }
        }
        let (mean, share) = (sum / f64::from(count), off / f64::from(solid));
        println!("{lens:?}: colour {mean:.4}, depth off at {share:.3} of {solid}");
        // Pixels of other sizes, taken by the nearest: edges differ.
        assert!(count > 5000 && mean < 0.015 && share < 0.08, "{lens:?}: {mean} {share}");
    }
}

#[test]
fn the_program_draws_through_lenses_and_refuses_what_it_cannot_draw() {
    let workshop = Workshop::new();
    let scene = workshop.scene("yard", yard().build(), &yard_metadata(1.0));
    let view = yard_look((96, 64)).1.without_fov();
    let options = "--weather heavy-rain --assets off --lens fisheye:200 --also depth.npy";
    let one = workshop.render(&scene, &view, "one.png", &format!("{options} --threads 1"));
    let two = workshop.render(&scene, &view, "two.png", &format!("{options} --threads 2"));
    assert!(read_png(&one) == read_png(&two));
    let toml = workshop.path("lens.toml");
    let says = |lens: &str, options: &str, words: &[&str]| {
        std::fs::write(&toml, lens).unwrap();
        let options = format!("--assets off --lens {} {options}", toml.display());
        let arguments = workshop.words(&scene, &view, "no.png", &options);
        let output = binary().args(arguments).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success(), "{said}");
        assert!(words.iter().all(|word| said.contains(word)), "{said}");
        assert!(!workshop.path("no.png").exists());
    };
    let lens = "model = \"OPENCV\"\nsize = [96, 64]\nfocal = [80.0, 80.0]\n";
    says(&format!("{lens}distortion = [-2.0]\n"), "", &["lens.toml", "folds within the picture"]);
    says(&format!("{lens}focus = 1\n"), "", &["lens.toml, line 4", "focus"]);
    says(lens, "--fov 50", &["--fov: cannot be used with --lens"]);
    says(lens, "--set lens.rate=20", &["drops on the lens are drawn without --lens alone"]);
    says(lens, "--set fidelity=paper --weather heavy-rain", &["fidelity paper"]);
}
