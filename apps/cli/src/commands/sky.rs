//! `sky`: makes a panorama of the sky from the photos of a data set, for `sky.panorama` of a
//! weather.
//!
//! The sky of each photo is classified as for training
//! ([`weather_magician::train::priors::sky`]). A direction gets the weighted mean of the photos that
//! show sky there; weights fall towards a photo's edge, so that seams are soft. Directions that no
//! photo shows get the mean colour of their elevation, plus the difference of seen neighbours from
//! theirs, interpolated from coarser and coarser means ("pull-push", Gortler et al. 1996). Photos
//! of different exposure are not matched.

use crate::overwrite::OverwriteArgs;
use anyhow::{Result, bail};
use clap::Args;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use std::path::PathBuf;
use weather_magician::train::dataset::orientation;
use weather_magician::train::photos::{PhotoOptions, PhotoSize, Photos};
use weather_magician::train::priors::SkyClass;
use weather_magician::train::priors::points::{inside, seen_points};
use weather_magician::train::priors::sky::{SkyInput, below_horizon, classify};
use weather_magician::view::spec;
use weather_magician::{Camera, PictureSize};
use wm_base::color::{luminance, srgb_decode};
use wm_base::files::check_writable;
use wm_base::statistics::median;
use wm_capture::{self as capture, CaptureOptions};
use wm_image::{color::Dither, png::write_rgb};
use wm_weather::dome::level_axes;

/// Longest side of the photos as they are read, px.
const MAX_PHOTO_SIDE_PX: u32 = 1200;
/// Share of a photo's side over which its weight fades out.
const FADE_SHARE: f64 = 0.15;
/// Angle over which the colour of a row is blended.
const ROW_BLEND_DEG: f32 = 4.0;
/// Least brightness of the sky as a multiple of the median of its pixels, as in the survey.
const MIN_SKY_BRIGHTNESS_RATIO: f64 = 0.65;

/// Options of `sky`.
#[derive(Args, Debug)]
pub(crate) struct SkyArgs {
    /// The photos: a folder with a COLMAP model or a transforms.json
    dataset: PathBuf,
    /// Output file: a .png
    #[arg(short, long, value_name = "PATH", default_value = "sky.png")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Width, px; the height is half of it
    #[arg(long, value_name = "PX", default_value_t = 2048, value_parser = clap::value_parser!(u32).range(64..=8192))]
    width: u32,
    /// Folder of the photos [default: from the model]
    #[arg(long, value_name = "FOLDER")]
    images: Option<PathBuf>,
    /// Up in the axes of the model, such as 0,-1,0 [default: from the photos]
    #[arg(long, value_name = "X,Y,Z", value_parser = spec::parse_direction, allow_hyphen_values = true)]
    up: Option<DVec3>,
}

/// Runs the command.
pub(crate) fn run(args: &SkyArgs) -> Result<()> {
    check_writable(&args.out)?;
    if !args.out.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")) {
        bail!("--out {}: a panorama is written as PNG; give a name that ends in .png", args.out.display());
    }
    args.overwrite.check(&args.out, &[], "give another name with --out")?;
    let options = CaptureOptions { images: args.images.clone(), ..CaptureOptions::default() };
    let capture = capture::read(&args.dataset, &options)?;
    let files: Vec<PathBuf> = (0..capture.views.len()).filter_map(|view| capture.photo(view)).collect();
    args.overwrite.check_report(&args.out, &files.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;
    let photo_options =
        PhotoOptions { size: PhotoSize::Longest(MAX_PHOTO_SIDE_PX), ..PhotoOptions::default() };
    let photos = Photos::open(&capture, &photo_options)?;
    let places: Vec<usize> = (0..photos.len()).collect();
    let Some(up) = orientation(&capture, &photos, args.up).0 else {
        bail!("{}: the photos do not tell which way is up; give --up", args.dataset.display());
    };

    let seen = seen_points(&capture, &photos, &places);
    let look = |place: usize| -> Result<SkyPhoto> {
        let photo = photos.get(place, 0)?;
        let at = |point: &u32| inside(&capture, &photo.camera, *point).map(|(x, y, _)| [x as f32, y as f32]);
        let points: Vec<[f32; 2]> = seen[place].iter().filter_map(at).collect();
        let input = SkyInput {
            rgb: &photo.rgb,
            width: photo.width as usize,
            far: None,
            has_depth: &[],
            below: &below_horizon(&photo.camera, photo.width as usize, photo.height as usize, Some(&up)),
            points: &points,
        };
        Ok(SkyPhoto { camera: photo.camera, is_sky: sky_of(&classify(&input)), rgb: photo.rgb.clone() })
    };
    let looks = places.into_par_iter().map(look).collect::<Result<Vec<SkyPhoto>>>()?;
    // Exactly twice as wide as high.
    let size = PictureSize::new(args.width / 2 * 2, args.width / 2);
    let (rgb, share) = panorama(&looks, up.up, size);
    if share == 0.0 {
        bail!("{}: no photo shows the sky; give sky.color, or another panorama", args.dataset.display());
    }
    let tags = [
        ("program".into(), concat!("weather-magician ", env!("CARGO_PKG_VERSION")).into()),
        ("sky_of".into(), args.dataset.display().to_string()),
    ];
    write_rgb(&args.out, &rgb, size, Dither::Ordered, &tags)?;
    println!(
        "{}: {}x{}, {:.0} % of the upper half is in {} photos, the rest is made up; up is {:.3} ({})\n\
         render with --set sky.panorama={0}",
        args.out.display(),
        size.width,
        size.height,
        100.0 * share,
        looks.len(),
        up.up,
        up.evidence
    );
    Ok(())
}

fn sky_of(classes: &[SkyClass]) -> Vec<bool> {
    classes.iter().map(|class| *class == SkyClass::Sky).collect()
}

/// A photo and its sky pixels.
struct SkyPhoto {
    camera: Camera,
    /// `[H, W]`.
    is_sky: Vec<bool>,
    /// `[H, W, 3]`.
    rgb: Vec<u8>,
}

impl SkyPhoto {
    /// Returns the colour in a direction and its weight; `None` if the photo shows no sky there.
    fn at(&self, direction: DVec3) -> Option<([f32; 3], f32)> {
        let (camera, view) = (&self.camera, self.camera.rotation() * direction);
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        let (x, y) = (camera.fx * view.x / view.z + camera.cx, camera.fy * view.y / view.z + camera.cy);
        if !(view.z > 0.0 && x >= 0.0 && y >= 0.0 && x < width && y < height) {
            return None;
        }
        let pixel = y as usize * camera.width as usize + x as usize;
        let edge = (x.min(width - x) / width).min(y.min(height - y) / height);
        let rgb = [0, 1, 2].map(|k| f32::from(self.rgb[3 * pixel + k]) / 255.0);
        self.is_sky[pixel].then_some((rgb, (edge / FADE_SHARE).clamp(0.01, 1.0) as f32))
    }
}

/// Returns the panorama `[H, W, 3]` about `up`, sRGB, and the fraction of the upper half that
/// photos show.
fn panorama(photos: &[SkyPhoto], up: DVec3, size: PictureSize) -> (Vec<f32>, f64) {
    let axes = level_axes(up.to_array()).map(DVec3::from_array);
    let (width, height) = (size.width as usize, size.height as usize);
    let mut sums: Vec<[f32; 4]> = (0..width * height)
        .into_par_iter()
        .map(|i| {
            let around = TAU * ((i % width) as f64 + 0.5) / width as f64 - PI;
            let (sin, level) = (PI * (0.5 - ((i / width) as f64 + 0.5) / height as f64)).sin_cos();
            let direction = level * (around.cos() * axes[0] + around.sin() * axes[1]) + sin * axes[2];
            let seen = photos.iter().filter(|_| sin > 0.0).filter_map(|photo| photo.at(direction));
            seen.fold([0.0; 4], |[r, g, b, w], (rgb, weight)| {
                [r + weight * rgb[0], g + weight * rgb[1], b + weight * rgb[2], w + weight]
            })
        })
        .collect();
    drop_dark(&mut sums);
    let is_seen = |sum: &[f32; 4]| sum[3] > 0.0;
    let share = sums[..width * height / 2].iter().filter(|sum| is_seen(sum)).count();
    let rings = rings(&sums, width);
    // Each seen pixel as its difference from its ring, with the weight it has against what is made
    // up.
    for (i, sum) in sums.iter_mut().enumerate().filter(|(_, sum)| is_seen(sum)) {
        let ring = rings[i / width];
        *sum = [0, 1, 2, 3].map(|k| if k == 3 { sum[3].min(1.0) } else { sum[k] / sum[3] - ring[k] });
    }
    let whole = filled(&sums, width);
    let rgb = whole.iter().enumerate().flat_map(|(i, pixel)| {
        let ring = rings[i / width];
        (0..3).map(move |k| (pixel[k] + ring[k]).clamp(0.0, 1.0))
    });
    (rgb.collect(), share as f64 / (width * height / 2) as f64)
}

/// Returns the colour of each row: a mean of all rows, weighted by distance, so that rows with few
/// or misclassified pixels make no stripes.
fn rings(sums: &[[f32; 4]], width: usize) -> Vec<[f32; 3]> {
    let add = |a: [f32; 4], b: [f32; 4]| [0, 1, 2, 3].map(|k| a[k] + b[k]);
    let rows: Vec<[f32; 4]> =
        sums.chunks_exact(width).map(|row| row.iter().copied().fold([0.0; 4], add)).collect();
    let spread = ROW_BLEND_DEG / 180.0 * rows.len() as f32;
    let ring = |row: usize| {
        let near = |(other, sum): (usize, &[f32; 4])| {
            let share = (1.0 + (row.abs_diff(other) as f32 / spread).powi(2)).powi(-2);
            sum.map(|v| share * v)
        };
        let [r, g, b, weight] = rows.iter().enumerate().map(near).fold([0.0; 4], add);
        [r, g, b].map(|v| v / weight.max(1e-9))
    };
    (0..rows.len()).into_par_iter().map(ring).collect()
}

/// Removes pixels that are far darker than the rest: branches and walls that were classified as
/// sky.
fn drop_dark(sums: &mut [[f32; 4]]) {
    let light = |sum: &[f32; 4]| luminance([0, 1, 2].map(|k| srgb_decode(f64::from(sum[k] / sum[3]))));
    let mut seen: Vec<f64> = sums.iter().filter(|sum| sum[3] > 0.0).map(light).collect();
    let Some(middle) = median(&mut seen) else { return };
    for sum in sums.iter_mut().filter(|sum| sum[3] > 0.0) {
        if light(sum) < MIN_SKY_BRIGHTNESS_RATIO * middle {
            *sum = [0.0; 4];
        }
    }
}

/// Fills pixels of little weight (the fourth value, 0-1) from coarser and coarser means.
fn filled(fine: &[[f32; 4]], width: usize) -> Vec<[f32; 4]> {
    let height = fine.len() / width;
    if width < 4 || height < 2 {
        return fine.to_vec();
    }
    let (w, h) = (width / 2, height / 2);
    let four = |x: usize, y: usize| {
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(a, b)| fine[(2 * y + b) * width + 2 * x + a])
    };
    let coarse: Vec<[f32; 4]> = (0..w * h)
        .map(|i| {
            let four = four(i % w, i / w);
            let weight: f32 = four.iter().map(|pixel| pixel[3]).sum();
            let mean =
                |k: usize| four.iter().map(|pixel| pixel[3] * pixel[k]).sum::<f32>() / weight.max(1e-9);
            [mean(0), mean(1), mean(2), weight.min(1.0)]
        })
        .collect();
    let coarse = filled(&coarse, w);
    let around = |x: i64, y: i64, k: usize| {
        coarse[y.clamp(0, h as i64 - 1) as usize * w + x.rem_euclid(w as i64) as usize][k]
    };
    (0..fine.len())
        .map(|i| {
            // The nearer coarse pixel counts three quarters along each side.
            let (x, y) = ((i % width) as i64, (i / width) as i64);
            let (left, top) = ((x + 1) / 2 - 1, (y + 1) / 2 - 1);
            let (u, v) = (if x % 2 == 0 { 0.75 } else { 0.25 }, if y % 2 == 0 { 0.75 } else { 0.25 });
            let mixed = |k: usize| {
                let row = |y: i64| (1.0 - u) * around(left, y, k) + u * around(left + 1, y, k);
                (1.0 - v) * row(top) + v * row(top + 1)
            };
            let [r, g, b, weight] = fine[i];
            let mix = |own: f32, k: usize| weight * own + (1.0 - weight) * mixed(k);
            [mix(r, 0), mix(g, 1), mix(b, 2), 1.0]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns two photos with different skies; the lower half of each is ground.
    #[test]
    fn what_photos_show_is_where_it_was_and_the_rest_is_near_it() {
        let photo = |toward: DVec3, rgb: [u8; 3]| {
            let camera = Camera::looking(
                (80, 60),
                60.0,
                DVec3::new(3.0, 1.0, 2.0),
                DVec3::new(3.0, 1.0, 2.0) + toward,
                DVec3::Z,
            );
            SkyPhoto {
                camera: camera.unwrap(),
                is_sky: (0..80 * 60).map(|i| i < 80 * 30).collect(),
                rgb: rgb.repeat(80 * 60),
            }
        };
        let photos = [photo(DVec3::X, [200, 100, 100]), photo(DVec3::NEG_Y, [100, 100, 200])];
        let size = PictureSize::new(256, 128);
        let (rgb, share) = panorama(&photos, DVec3::Z, size);
        let at = |heading: i64, row: usize| {
            let column = (128 + heading * 256 / 360).rem_euclid(256) as usize;
            [0, 1, 2].map(|k| (255.0 * rgb[3 * (row * 256 + column) + k]).round() as u8)
        };
        // x is ahead, -y a quarter turn clockwise; 10 degrees up.
        assert_eq!((at(0, 57), at(90, 57)), ([200, 100, 100], [100, 100, 200]));
        assert!((0.1..0.4).contains(&share), "{share}");
        for (heading, row) in [(45, 57), (180, 57), (270, 20), (0, 0)] {
            let [r, g, b] = at(heading, row);
            let between = 98..=202;
            assert!(between.contains(&r) && between.contains(&b) && (98..=102).contains(&g), "{r} {g} {b}");
        }
        assert_eq!(panorama(&[], DVec3::Z, size).1, 0.0);
    }
}
