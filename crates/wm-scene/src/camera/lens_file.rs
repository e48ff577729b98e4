//! Lenses in TOML files: a model by its COLMAP name, and its numbers.

use super::distortion::Distortion;
use super::lens::LensModel;
use super::pinhole::Camera;
use crate::formats::sidecar::parse_toml;
use serde::Deserialize;
use std::path::Path;
use wm_base::error::{FormatError, Location, Problem};
use wm_base::files;

/// Longest file that is read, bytes.
const MAX_BYTES: u64 = 1 << 16;

/// A lens file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LensFile {
    /// `OPENCV`, `OPENCV_FISHEYE` or `EQUIRECTANGULAR`.
    model: String,
    /// Width and height of the picture, px.
    size: [u32; 2],
    /// Focal lengths along x and y, px.
    focal: Option<[f64; 2]>,
    /// Principal point, px from the left and the top edge; the middle otherwise.
    center: Option<[f64; 2]>,
    /// Angle across a fisheye's picture beyond which it is dark, degrees; 360 otherwise.
    fov: Option<f64>,
    /// Coefficients in OpenCV's order; those that are left out are 0.
    #[serde(default)]
    distortion: Vec<f64>,
}

impl LensModel {
    /// Reads a lens, with the size, the focal lengths and the principal point of its picture, from
    /// a TOML file:
    ///
    /// ```toml
    /// model = "OPENCV_FISHEYE"          # or OPENCV, EQUIRECTANGULAR
    /// size = [1280, 960]                # px
    /// focal = [420.0, 420.5]            # px; not for EQUIRECTANGULAR
    /// center = [641.2, 478.9]           # px; the middle if left out
    /// distortion = [0.01, -0.002]       # OPENCV: k1, k2, p1, p2, k3; OPENCV_FISHEYE: k1, k2, k3, k4
    /// fov = 190.0                       # degrees, OPENCV_FISHEYE alone: dark beyond it; 360 if left out
    /// ```
    ///
    /// # Errors
    /// [`FormatError`] with line and column, if it is not TOML, has unknown keys, or its numbers
    /// make no lens.
    pub fn read(path: &Path) -> Result<(Self, Camera), FormatError> {
        let length = std::fs::metadata(path).map_err(|error| FormatError::reading(path, error))?.len();
        if length > MAX_BYTES {
            return Err(FormatError::value(path, "too long for a lens; give a TOML file"));
        }
        let text =
            files::read_text(path, files::SMALL_TEXT).map_err(|error| FormatError::reading(path, error))?;
        parse(&text).map_err(|(place, message)| {
            FormatError::at(path, place, Problem::Value(format!("{message}; correct the lens")))
        })
    }
}

fn parse(text: &str) -> Result<(LensModel, Camera), (Location, String)> {
    let file: LensFile = parse_toml(text)?;
    let of_key = |key: &str| {
        let at = text.lines().position(|line| line.trim_start().starts_with(key));
        at.map_or(Location::Whole, |line| Location::LineColumn(line as u64 + 1, 1))
    };
    let [width, height] = file.size;
    let (half_width, half_height) = (0.5 * f64::from(width), 0.5 * f64::from(height));
    let is_panorama = file.model == "EQUIRECTANGULAR";
    let focal = match (file.focal, is_panorama) {
        (Some(focal), false) => focal,
        (None, true) => [half_width.max(1.0); 2],
        (None, false) => return Err((Location::Whole, "focal is missing: two lengths in px".into())),
        (Some(_), true) => return Err((of_key("focal"), "a panorama has no focal length".into())),
    };
    let center = file.center.unwrap_or([half_width, half_height]);
    let camera = Camera::pinhole((width, height), focal, center);
    let most = match file.model.as_str() {
        "OPENCV" => 5,
        "OPENCV_FISHEYE" => 4,
        "EQUIRECTANGULAR" => 0,
        other => {
            let says = format!("model \"{other}\" is not known: OPENCV, OPENCV_FISHEYE or EQUIRECTANGULAR");
            return Err((of_key("model"), says));
        }
    };
    if file.distortion.len() > most {
        let says =
            format!("distortion has {} numbers, {} has {most} at most", file.distortion.len(), file.model);
        return Err((of_key("distortion"), says));
    }
    let widest = match file.fov {
        None => std::f64::consts::PI,
        Some(fov) if most == 4 && fov > 0.0 && fov <= 360.0 => 0.5 * fov.to_radians(),
        Some(fov) if most == 4 => {
            return Err((of_key("fov"), format!("fov is {fov}: must be above 0 and at most 360 degrees")));
        }
        Some(_) => return Err((of_key("fov"), format!("{} has no fov", file.model))),
    };
    let number = |k: usize| file.distortion.get(k).copied().unwrap_or(0.0);
    let lens = match most {
        5 => LensModel::Perspective(Distortion::of([0, 1, 2, 3, 4].map(number))),
        4 => LensModel::Fisheye { radial: [0, 1, 2, 3].map(number), widest },
        _ => LensModel::Equirectangular,
    };
    lens.check(&camera).map_err(|error| (Location::Whole, error.to_string()))?;
    Ok((lens, camera))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn lenses_are_read() {
        let text = "model = \"OPENCV_FISHEYE\"\nsize = [640, 480]\nfocal = [200.0, 201.0]\ndistortion = [0.01]\nfov = 180\n";
        let (lens, camera) = parse(text).unwrap();
        assert_eq!(
            lens,
            LensModel::Fisheye { radial: [0.01, 0.0, 0.0, 0.0], widest: std::f64::consts::FRAC_PI_2 }
        );
        assert_eq!((camera.fy, camera.cx, camera.cy), (201.0, 320.0, 240.0));
        let panorama = parse("model = \"EQUIRECTANGULAR\"\nsize = [640, 320]\n").unwrap();
        assert_eq!(panorama.0, LensModel::Equirectangular);
    }

    #[test]
    fn faults_have_their_place() {
        let start = "model = \"OPENCV\"\nsize = [640, 480]\n";
        for (text, says) in [
            (format!("{start}focal = [200.0, 200.0]\ndistortion = [1, 2, 3, 4, 5, 6]\n"), "has 5 at most"),
            (format!("{start}focal = [200.0, 200.0]\ndistortion = [-1.0]\n"), "folds within the picture"),
            (format!("{start}focal = [0.0, 200.0]\n"), "fx"),
            (start.into(), "focal is missing"),
            (format!("{start}focus = 3\n"), "focus"),
            (format!("{start}focal = [200.0, 200.0]\nfov = 90.0\n"), "has no fov"),
            ("model = \"FOV\"\nsize = [64, 48]\nfocal = [20.0, 20.0]\n".into(), "\"FOV\" is not known"),
            ("model = \"EQUIRECTANGULAR\"\nsize = [64, 0]\n".into(), "picture size"),
        ] {
            let (_, message) = parse(&text).unwrap_err();
            assert!(message.contains(says) && !message.contains('\n'), "{message}");
        }
        let long =
            parse(&format!("{start}focal = [9.0, 9.0]\ndistortion = [0, 0, 0, 0, 0, 0]\n")).unwrap_err();
        assert_eq!(long.0, Location::LineColumn(4, 1));
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "\\PC{0,80}", tail in prop::collection::vec(prop::num::f64::ANY, 0..7)) {
            let _ = parse(&text);
            let _ = parse(&format!("model = \"OPENCV\"\nsize = [40, 30]\nfocal = [9.0, 8.0]\ndistortion = {tail:?}\n"));
        }
    }
}
