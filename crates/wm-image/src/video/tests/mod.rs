//! Videos from frames to file and back.

#[cfg(feature = "h264")]
mod built_in;
mod by_ffmpeg;
#[cfg(feature = "h264")]
mod parsed;

use std::fs;

use super::settings::one_line;
use super::*;

/// Hash of a lattice point, 0-1.
fn lattice(x: f32, y: f32) -> f32 {
    let mut hash = (x as i32 as u32).wrapping_mul(0x9e37_79b1) ^ (y as i32 as u32).wrapping_mul(0x85eb_ca77);
    hash = (hash ^ (hash >> 15)).wrapping_mul(0x2c1b_3c6d);
    ((hash ^ (hash >> 13)) & 0xffff) as f32 / 65535.0
}

/// Smooth noise of wavelength about 2, 0-1.
fn noise(x: f32, y: f32) -> f32 {
    let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
    let (cell_x, cell_y) = (x.floor(), y.floor());
    let (u, v) = (smooth(x - cell_x), smooth(y - cell_y));
    let row = |y: f32| lattice(cell_x, y) * (1.0 - u) + lattice(cell_x + 1.0, y) * u;
    row(cell_y) * (1.0 - v) + row(cell_y + 1.0) * v
}

/// A plain with detail under fog that thins out towards the viewer, below a slowly changing glow:
/// what an encoder must get right here. `[H, W, 3]`; `time` in seconds.
fn foggy(size: PictureSize, time: f32) -> Vec<f32> {
    let scale = 1.0 / size.height as f32;
    let pixel = |i: usize| {
        let (u, v) = ((i as u32 % size.width) as f32 * scale, (i as u32 / size.width) as f32 * scale);
        let air = glow(u, v, time);
        if v < 0.45 {
            return air;
        }
        let distance = 0.08 / (v - 0.445);
        let shift = u + 0.05 * time;
        let detail =
            0.6 * noise(shift * distance * 20.0, distance * 30.0) + 0.4 * noise(shift * 90.0, v * 90.0);
        let transmittance = (-distance * (0.6 + 0.4 * noise(1.5 * u + 0.2 * time, 3.0 * v))).exp();
        let ground = [0.16 + 0.35 * detail, 0.2 + 0.35 * detail, 0.08 + 0.25 * detail];
        [0, 1, 2].map(|c| ground[c] * transmittance + air[c] * (1.0 - transmittance))
    };
    (0..size.pixels()).flat_map(pixel).collect()
}

/// The sky of [`foggy`]: smooth, and slower than a step of 8 bits in ten pixels.
fn glow(u: f32, v: f32, time: f32) -> [f32; 3] {
    let center = 0.6 + 0.15 * time;
    let light = (0.06 - 0.01 * time) * (-4.0 * ((u - center).powi(2) + (v - 0.2).powi(2))).exp() - 0.08 * v;
    [0.72 + 1.3 * light, 0.74 + light, 0.77 + 0.6 * light]
}

fn settings(size: PictureSize, rate: &str) -> VideoSettings {
    VideoSettings::new(size, rate.parse().unwrap())
}

/// Writes frames and returns the report.
fn write(path: &Path, settings: VideoSettings, frames: &[Vec<f32>]) -> VideoReport {
    let mut sink = create_video(path, settings).unwrap();
    for frame in frames {
        sink.frame(frame).unwrap();
    }
    sink.finish().unwrap()
}

fn is_empty(directory: &Path) -> bool {
    fs::read_dir(directory).unwrap().next().is_none()
}

#[test]
fn odd_sides_are_refused_with_the_next_even_ones() {
    let directory = tempfile::tempdir().unwrap();
    for encoder in [VideoEncoder::Builtin, VideoEncoder::Ffmpeg] {
        let settings = VideoSettings { encoder, ..settings(PictureSize::new(101, 64), "30") };
        let error = create_video(&directory.path().join("a.mp4"), settings).err().unwrap().to_string();
        assert!(error.contains("101x64") && error.contains("102x64") && !error.contains('\n'), "{error}");
    }
    assert!(is_empty(directory.path()));
}

#[test]
fn long_messages_become_one_line() {
    assert_eq!(one_line("  a \n\n b\n"), "a; b");
    assert!(one_line(&"é\n".repeat(1000)).chars().count() < 410);
    assert!(!one_line("").is_empty());
}

#[cfg(not(feature = "h264"))]
#[test]
fn without_the_feature_it_says_what_to_do() {
    let error = create_video(Path::new("a.mp4"), settings(PictureSize::new(64, 64), "30")).err().unwrap();
    assert!(error.to_string().contains("--encoder ffmpeg") && !error.to_string().contains('\n'), "{error}");
}
