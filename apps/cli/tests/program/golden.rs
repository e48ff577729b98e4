//! Pictures that must stay as they are, and bytes that must not depend on the machine's threads.
//!
//! `apps/cli/tests/golden/*.png` show a made-up yard in fog and under another sky, drawn on the
//! portable path without dither. To change them on purpose, run this test with `WM_UPDATE_GOLDEN=1`
//! and look at what changed.

use crate::common::*;
use glam::DVec3;
use std::path::Path;
use wm_render::simd::SimdChoice;
use wm_render::testing::Backend;

/// Name and weather.
const PICTURES: [(&str, &str); 4] = [
    ("fog", "--set fog.mor=40"),
    ("ground-fog", "--set fog.mor=12 --set fog.scale_height=2 --set fog.airlight=#d5dadd"),
    ("smog", "--set smog.mor=60 --set haze.mor=300"),
    (
        "overcast",
        "--set sky=overcast --set sky.scene_sky=replace --set haze.mor=300 --set haze.scale_height=20",
    ),
];
const SIZE: (u32, u32) = (96, 64);

/// The yard under a sky.
fn shot(size: (u32, u32)) -> Shot {
    let mut place = yard();
    place.sky(DVec3::ZERO, 300.0, 1200);
    Shot::of("yard", place.build(), &yard_metadata(1.0), yard_look(size).1)
}

/// Differences of all bytes of two pictures, steps.
fn differences(a: &Image<[u8; 3]>, b: &Image<[u8; 3]>) -> Vec<u8> {
    assert_eq!((a.width, a.height), (b.width, b.height));
    a.pixels.iter().flatten().zip(b.pixels.iter().flatten()).map(|(a, b)| a.abs_diff(*b)).collect()
}

/// On the portable path every operation is IEEE arithmetic in a fixed order, the same on any
/// machine; but the yard is made with the system's `sin`, `cos` and `ln`, whose last digits differ.
/// That moves colours by 1e-6, or by 1/255 of a colour where a splat falls to the other side of the
/// alpha cut: less than a step, which rounding makes one step at most.
#[test]
fn the_portable_path_draws_the_golden_pictures() {
    let shot = shot(SIZE);
    for (name, weather) in PICTURES {
        let drawn = shot.png(&format!("{weather} --dither off --simd portable"));
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/{name}.png"));
        if std::env::var_os("WM_UPDATE_GOLDEN").is_some_and(|v| v == "1") {
            write_golden(&golden, &drawn);
        }
        let wanted = read_png(&golden);
        let most = differences(&drawn, &wanted).into_iter().max().unwrap_or(0);
        println!("{name}: off by {most}/255 at most");
        assert!(most <= 1, "{name} is off by {most}/255; WM_UPDATE_GOLDEN=1 takes it for the new one");
        // Not by accident all of one colour.
        let shades: std::collections::BTreeSet<[u8; 3]> = wanted.pixels.iter().copied().collect();
        assert!(shades.len() > 500, "{name} has {} colours", shades.len());
    }
}

/// Writes a picture alone, without the words of the run that drew it, as small as PNG makes it.
fn write_golden(path: &Path, picture: &Image<[u8; 3]>) {
    std::fs::create_dir_all(path.parent().expect("a folder")).expect("the folder is made");
    let file = std::fs::File::create(path).expect("the file is made");
    let mut encoder = png::Encoder::new(file, picture.width as u32, picture.height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header().expect("the header is written");
    writer.write_image_data(picture.pixels.as_flattened()).expect("the picture is written");
}

/// The contract of blending: 1e-4 of a colour where no decision is near, 0.03 of a step, so that a
/// byte is off by one at most; where the transmittance is at its stop, the weight of one splat, up
/// to 1e-2 or 2.6 steps, three bytes; in the mean 1e-5, of which rounding makes 1e-5 steps of 255,
/// 0.003 of a step, and the bytes next to a cut as much again.
#[test]
fn every_simd_path_draws_the_same_picture() {
    let shot = shot(SIZE);
    for (name, weather) in PICTURES {
        let draw = |simd: SimdChoice| shot.png(&format!("{weather} --dither off --simd {}", simd.name()));
        let wanted = draw(SimdChoice::Portable);
        for simd in [SimdChoice::Avx512, SimdChoice::Avx2, SimdChoice::Neon] {
            // Those of other processors are not missing here.
            let possible = (simd == SimdChoice::Neon) == cfg!(target_arch = "aarch64");
            if !possible || Backend::of(simd).is_none() {
                continue;
            }
            let off = differences(&draw(simd), &wanted);
            let most = off.iter().copied().max().unwrap_or(0);
            let mean = off.iter().map(|v| f64::from(*v)).sum::<f64>() / off.len() as f64;
            println!("{name}, {}: off by {most}/255 at most, {mean:.5}/255 in the mean", simd.name());
            assert!(most <= 3 && mean < 0.006, "{name}, {}: {most}, {mean}", simd.name());
        }
    }
}

#[test]
fn threads_change_no_byte() {
    let shot = shot((200, 130));
    let draw = |threads: u32, out: &str, options: &str| {
        let options = format!("-w fog-closing-in --threads {threads} {options}");
        shot.render(out, &options);
        shot.read(out)
    };
    let all = |threads: u32| {
        let picture = draw(threads, "a.png", "--time 4 --also depth.exr,normal");
        let (depth, normal) = (shot.read("a.depth.exr"), shot.read("a.normal.png"));
        let mut files = vec![("PNG", picture), ("EXR depth", depth), ("PNG normals", normal)];
        files.push(("EXR", draw(threads, "a.exr", "--time 4")));
        if cfg!(feature = "h264") {
            files.push(("MP4", draw(threads, "a.mp4", "--seconds 0.4 --fps 10")));
        }
        files
    };
    let one = all(1);
    for threads in [2, 7] {
        for ((name, bytes), (_, wanted)) in all(threads).into_iter().zip(&one) {
            assert!(bytes == *wanted, "{name} differs between 1 and {threads} threads");
        }
    }
}
