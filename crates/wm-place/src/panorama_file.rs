//! Reads the panorama that a weather's sky names: PNG and JPEG hold display colours, EXR linear
//! light.
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use thiserror::Error;
use wm_base::color::srgb_encode;
use wm_image::maps::{MapFault, Stored, read_map};
use wm_image::photo::{DecodeFault, read_photo};
use wm_weather::Panorama;
use wm_weather::panorama::check_size;

/// A panorama that cannot be read.
#[derive(Debug, Error)]
#[error("{}: {problem}", path.display())]
pub struct PanoramaFileError {
    /// The file.
    pub path: PathBuf,
    /// The problem and its remedy.
    pub problem: String,
}

/// Reads a panorama from a PNG, JPEG or EXR file.
///
/// # Errors
/// [`PanoramaFileError`] if there is no such file, it is damaged, or it is too large.
pub fn read_panorama(path: &Path) -> Result<Arc<Panorama>, PanoramaFileError> {
    read(path).map(Arc::new).map_err(|problem| PanoramaFileError { path: path.into(), problem })
}

fn read(path: &Path) -> Result<Panorama, String> {
    let cannot = |error: std::io::Error| match error.kind() {
        std::io::ErrorKind::NotFound => "there is no such panorama; check sky.panorama".to_owned(),
        _ => format!("cannot read the panorama: {error}"),
    };
    let about = std::fs::metadata(path).map_err(cannot)?;
    if !about.is_file() {
        return Err("is not a file; sky.panorama must be the path of a PNG, JPEG or EXR".into());
    }
    let mut start = [0; 3];
    let read = File::open(path).and_then(|mut file| file.read_exact(&mut start));
    match read {
        Err(error) if error.kind() != std::io::ErrorKind::UnexpectedEof => return Err(cannot(error)),
        _ => {}
    }
    if start == [0xff, 0xd8, 0xff] { jpeg(path) } else { map(path) }
}

fn damaged(what: &str) -> String {
    format!("the panorama is damaged ({what}); copy it again")
}

fn jpeg(path: &Path) -> Result<Panorama, String> {
    let photo = read_photo(path, &|width, height| check_size(width, height).map_err(|e| e.to_string()));
    let photo = photo.map_err(|error| match error.fault {
        DecodeFault::Damaged(what) => damaged(&what),
        fault => fault.to_string(),
    })?;
    let byte = |value: u8| f32::from(value) / 255.0;
    let rgb = &photo.rgb;
    Panorama::new(photo.width, photo.height, |i| [rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]].map(byte))
        .map_err(|fault| fault.to_string())
}

/// PNG and EXR.
fn map(path: &Path) -> Result<Panorama, String> {
    let map = read_map(path).map_err(|error| match error.fault {
        MapFault::Unknown => "is not a readable picture: use PNG, JPEG or EXR".into(),
        MapFault::Damaged(what) => damaged(&what),
        fault => fault.to_string(),
    })?;
    let channels = map.channels as usize;
    let shown = |value: f32| match map.stored {
        Stored::Counts(full) => value / full,
        Stored::Floats => srgb_encode(f64::from(value)) as f32,
    };
    // Grey is grey in all channels.
    let places = if channels < 3 { [0; 3] } else { [0, 1, 2] };
    Panorama::new(map.width, map.height, |i| places.map(|k| shown(map.values[channels * i + k])))
        .map_err(|fault| fault.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_image::PictureSize;
    use wm_image::color::Dither;
    use wm_image::exr::{ExrPlanes, write_exr};
    use wm_image::png::write_rgb;
    use wm_weather::Weather;

    /// Red ahead, green to the right, blue behind, white to the left; darker below the horizon.
    fn quarters() -> Vec<f32> {
        let colors = [[0.0, 0.0, 1.0], [1.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let at = |x: usize, y: usize| colors[(x + 8) / 16 % 4].map(|v: f32| if y < 16 { v } else { 0.5 * v });
        (0..32).flat_map(|y| (0..64).flat_map(move |x| at(x, y))).collect()
    }

    /// Returns the colour of the background in a direction.
    fn seen(path: &Path, direction: [f64; 3]) -> [f64; 3] {
        let mut weather = Weather::clear();
        weather.set_text(&format!("sky.panorama={}", path.display())).unwrap();
        weather.set_text("sky.below=picture").unwrap();
        weather.load_images(read_panorama).unwrap();
        let site = wm_weather::Site::PLAIN;
        let camera =
            wm_scene::Camera::looking((4, 4), 50.0, glam::DVec3::ZERO, glam::DVec3::Y, glam::DVec3::Z);
        let seen = wm_weather::Observer::at_rest(camera.as_ref().unwrap());
        let sky = weather.at(0.0).prepare(&site);
        sky.pass(&seen).hooks().background.unwrap().reference(1e-3, direction)
    }

    #[test]
    fn pictures_of_every_kind_show_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let rgb = quarters();
        let size = PictureSize::new(64, 32);
        let [png, exr, jpg] = ["p.png", "p.exr", "p.jpg"].map(|name| folder.path().join(name));
        write_rgb(&png, &rgb, size, Dither::Off, &[]).unwrap();
        write_exr(&exr, ExrPlanes { rgb: Some(&rgb), ..ExrPlanes::default() }, size, &[]).unwrap();
        let bytes: Vec<u8> = rgb.iter().map(|v| (v * 255.0).round() as u8).collect();
        jpeg_encoder::Encoder::new_file(&jpg, 100)
            .unwrap()
            .encode(&bytes, 64, 32, jpeg_encoder::ColorType::Rgb)
            .unwrap();
        let (level, low) = (0.99, 0.141);
        for (direction, want) in [
            ([level, 0.0, low], [1.0, 0.0, 0.0]),
            // Clockwise from above, with z up: from +x to -y.
            ([0.0, -level, low], [0.0, 1.0, 0.0]),
            ([-level, 0.0, low], [0.0, 0.0, 1.0]),
            ([0.0, level, low], [1.0, 1.0, 1.0]),
            ([level, 0.0, -low], [0.5, 0.0, 0.0]),
        ] {
            for (path, tolerance) in [(&png, 0.003), (&exr, 0.0003), (&jpg, 0.05)] {
                let got = seen(path, direction);
                let far = (0..3).map(|k| (got[k] - want[k]).abs()).fold(0.0, f64::max);
                assert!(far < tolerance, "{}: {direction:?} is {got:?}", path.display());
            }
        }
    }

    #[test]
    fn what_cannot_be_read_is_told_in_one_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let say = |name: &str| read_panorama(&path(name)).unwrap_err().to_string();
        assert!(say("gone.png").ends_with("gone.png: there is no such panorama; check sky.panorama"));
        assert!(say(".").contains("is not a file; sky.panorama must be the path of"));
        for (name, bytes) in [("empty.png", &b""[..]), ("text.png", b"not a picture")] {
            std::fs::write(path(name), bytes).unwrap();
            assert!(say(name).ends_with("is not a readable picture: use PNG, JPEG or EXR"), "{}", say(name));
        }
        let flat = vec![0.5; 3 * 40 * 32];
        write_rgb(&path("flat.png"), &flat, PictureSize::new(40, 32), Dither::Off, &[]).unwrap();
        assert!(say("flat.png").contains("40x32 px is no panorama"));
        // Half a file of each kind, and a header that claims more than the file holds.
        let size = PictureSize::new(64, 32);
        write_rgb(&path("half.png"), &quarters(), size, Dither::Off, &[]).unwrap();
        write_exr(&path("half.exr"), ExrPlanes { rgb: Some(&quarters()), ..ExrPlanes::default() }, size, &[])
            .unwrap();
        let bytes = vec![90; 64 * 32 * 3];
        let encoder = jpeg_encoder::Encoder::new_file(path("half.jpg"), 90).unwrap();
        encoder.encode(&bytes, 64, 32, jpeg_encoder::ColorType::Rgb).unwrap();
        for name in ["half.png", "half.exr", "half.jpg"] {
            let whole = std::fs::read(path(name)).unwrap();
            std::fs::write(path(name), &whole[..whole.len() / 2]).unwrap();
            let said = say(name);
            assert!(said.contains("the panorama is damaged") && !said.contains('\n'), "{said}");
        }
        let huge =
            [b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\x7f\xfe\0\0\x3f\xff\x08\x02\0\0\0".as_slice(), &[0; 40]]
                .concat();
        std::fs::write(path("huge.png"), huge).unwrap();
        assert!(!say("huge.png").contains('\n'));
    }
}
