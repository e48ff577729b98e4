//! Classifies the pixels of a photo: sky, not sky, or unknown.
//!
//! From a photo alone, the sky is the region that is connected with the top border through smooth
//! pixels of sky colours (blue, or pale and bright) and has no depth and no point of the
//! reconstruction. Depth from windows reaches over the edges of near objects, so the sky grows by
//! as much into pixels of its colours. Holes that could be clouds are filled. Other pixels of such
//! colours are unknown: white walls, gaps in crowns. Where every pixel has an inverse depth, as
//! from networks, the sky is below 2 % of its range instead.

use super::SkyClass;
use crate::pieces::{beside, pieces};
use glam::DVec3;
use std::collections::VecDeque;
use wm_capture::CaptureUp;
use wm_scene::Camera;

/// Largest step of brightness from one pixel of the sky to the next, 0-1.
const MAX_SKY_STEP: f32 = 0.035;
/// Fraction of the range of inverse depth below which a pixel is sky.
const FAR_SHARE: f32 = 0.02;
/// Half the width of the unknown border between sky and place, px.
const HALF_BORDER_PX: usize = 1;
/// Smallest share of a photo that is taken for a sky.
const MIN_SKY_SHARE: f64 = 0.003;
/// Distance by which stereo depth reaches over edges, px: half the window, and the spread of
/// planes.
const DEPTH_REACH_PX: usize = 6;
/// Radius around a point of the reconstruction without sky, px.
const POINT_RADIUS_PX: usize = 2;

/// The input of the classification.
#[derive(Clone, Copy, Debug)]
pub struct SkyInput<'a> {
    /// `[H, W, 3]`, sRGB.
    pub rgb: &'a [u8],
    /// Width, px.
    pub width: usize,
    /// Relative inverse depth of every pixel, `[H, W]`, the farther the less; `None` where there is
    /// none.
    pub far: Option<&'a [f32]>,
    /// Pixels with a depth, `[H, W]`: no sky. Empty where none is known.
    pub has_depth: &'a [bool],
    /// Pixels that look below the horizon, `[H, W]`: no sky, whatever their colour. Empty where up
    /// is not known.
    pub below: &'a [bool],
    /// The image points of points of the reconstruction, px.
    pub points: &'a [[f32; 2]],
}

/// Returns the class of each pixel, `[H, W]`.
#[must_use]
pub fn classify(input: &SkyInput<'_>) -> Vec<SkyClass> {
    let width = input.width;
    let pixels = input.rgb.len() / 3;
    let height = pixels / width.max(1);
    let luma: Vec<f32> = input.rgb.chunks_exact(3).map(luma_of).collect();
    let mut barrier = vec![false; pixels];
    let mut is_point = vec![false; pixels];
    barrier.iter_mut().zip(input.has_depth).for_each(|(barrier, has)| *barrier |= *has);
    for [x, y] in input.points {
        let (x, y) = (*x as usize, *y as usize);
        if x < width && y < height {
            is_point[y * width + x] = true;
        }
        for row in y.saturating_sub(POINT_RADIUS_PX)..(y + POINT_RADIUS_PX + 1).min(height) {
            for column in x.saturating_sub(POINT_RADIUS_PX)..(x + POINT_RADIUS_PX + 1).min(width) {
                barrier[row * width + column] = true;
            }
        }
    }
    let looks: Vec<bool> = match input.far {
        Some(far) => {
            let (least, most) = range(far);
            let below = least + FAR_SHARE * (most - least);
            far.iter().map(|far| *far <= below).collect()
        }
        None => input.rgb.chunks_exact(3).map(is_skyish).collect(),
    };
    let looks: Vec<bool> = match input.below.is_empty() {
        true => looks,
        false => looks.iter().zip(input.below).map(|(looks, below)| *looks && !below).collect(),
    };
    let both = |looks: &[bool], barrier: &[bool]| -> Vec<bool> {
        looks.iter().zip(barrier).map(|(looks, barrier)| *looks && !barrier).collect()
    };
    let could_be = both(&looks, &barrier);
    let smooth = |a: usize, b: usize| (luma[a] - luma[b]).abs() < MAX_SKY_STEP;
    let top = (0..width.min(pixels)).filter(|i| could_be[*i]).collect();
    let mut reached = vec![false; pixels];
    flood(width, &could_be, smooth, top, usize::MAX, &mut reached);
    if input.far.is_none() {
        let edge = (0..pixels).filter(|i| reached[*i]).collect();
        flood(width, &both(&looks, &is_point), smooth, edge, DEPTH_REACH_PX, &mut reached);
    }
    fill_holes(width, &could_be, &mut reached);
    let count = reached.iter().filter(|v| **v).count();
    let is_sky = count as f64 >= MIN_SKY_SHARE * pixels as f64;
    let mut classes: Vec<SkyClass> = (0..pixels)
        .map(|i| match (is_sky && reached[i], could_be[i]) {
            (true, _) => SkyClass::Sky,
            (false, true) => SkyClass::Unknown,
            (false, false) => SkyClass::Place,
        })
        .collect();
    blur_border(width, &mut classes);
    classes
}

/// Returns the pixels, `[H, W]`, that look too far below the horizon for sky; empty if `up` is not
/// known. The image of `width` by `height` px may have another size than the camera.
#[must_use]
pub fn below_horizon(camera: &Camera, width: usize, height: usize, up: Option<&CaptureUp>) -> Vec<bool> {
    let Some(up) = up else { return Vec::new() };
    let lowest = up.lowest_sky();
    let (across, along) = (f64::from(camera.width) / width as f64, f64::from(camera.height) / height as f64);
    let level = camera.rotation() * up.up;
    (0..width * height)
        .map(|i| {
            let [x, y] = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
            let ray =
                DVec3::new((x * across - camera.cx) / camera.fx, (y * along - camera.cy) / camera.fy, 1.0);
            ray.dot(level) < lowest * ray.length()
        })
        .collect()
}

fn luma_of(rgb: &[u8]) -> f32 {
    (0.299 * f32::from(rgb[0]) + 0.587 * f32::from(rgb[1]) + 0.114 * f32::from(rgb[2])) / 255.0
}

/// Returns true for colours of daytime skies: blue, or pale and bright.
fn is_skyish(rgb: &[u8]) -> bool {
    let [r, g, b] = [rgb[0], rgb[1], rgb[2]].map(|v| f32::from(v) / 255.0);
    let luma = luma_of(rgb);
    let is_blue = b > r + 0.02 && b > g - 0.02 && luma > 0.25;
    let is_pale = luma > 0.55 && r.max(g).max(b) - r.min(g).min(b) < 0.18 && b > r - 0.06;
    is_blue || is_pale
}

/// Returns the least and the largest finite value.
fn range(values: &[f32]) -> (f32, f32) {
    let finite = values.iter().copied().filter(|v| v.is_finite());
    finite.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
}

/// Flood-fills `reached` from the pixels `from` over at most `most` `smooth` steps within
/// `could_be`.
fn flood(
    width: usize,
    could_be: &[bool],
    smooth: impl Fn(usize, usize) -> bool,
    from: Vec<usize>,
    most: usize,
    reached: &mut [bool],
) {
    from.iter().for_each(|i| reached[*i] = true);
    let mut waiting: VecDeque<(usize, usize)> = from.into_iter().map(|i| (i, 0)).collect();
    while let Some((pixel, steps)) = waiting.pop_front().filter(|(_, steps)| *steps < most) {
        for next in beside(pixel, width, could_be.len()) {
            if !reached[next] && could_be[next] && smooth(pixel, next) {
                reached[next] = true;
                waiting.push_back((next, steps + 1));
            }
        }
    }
}

/// Fills unreached pieces that `could_be` sky and are enclosed by the sky and the upper border.
fn fill_holes(width: usize, could_be: &[bool], reached: &mut [bool]) {
    let height = reached.len() / width;
    let at_side = |pixel: usize| {
        let column = pixel % width;
        column == 0 || column + 1 == width || pixel / width + 1 == height
    };
    for piece in pieces(reached.iter().map(|reached| !reached).collect(), width, |_, _| true) {
        if piece.iter().all(|pixel| could_be[*pixel] && !at_side(*pixel)) {
            piece.iter().for_each(|pixel| reached[*pixel] = true);
        }
    }
}

/// Makes the border between sky and place unknown.
fn blur_border(width: usize, classes: &mut [SkyClass]) {
    let before = classes.to_vec();
    let height = before.len() / width.max(1);
    for (pixel, class) in classes.iter_mut().enumerate() {
        let (column, row) = (pixel % width, pixel / width);
        let rows = row.saturating_sub(HALF_BORDER_PX)..(row + HALF_BORDER_PX + 1).min(height);
        let other = |row: usize| {
            let columns = column.saturating_sub(HALF_BORDER_PX)..(column + HALF_BORDER_PX + 1).min(width);
            before[row * width + columns.start..row * width + columns.end]
                .iter()
                .any(|near| near != &before[pixel])
        };
        if rows.into_iter().any(other) {
            *class = SkyClass::Unknown;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_capture::up::UpEvidence;

    /// A blue sky with a hard-edged cloud over a red wall with a white, sky-coloured window.
    fn photo() -> Vec<u8> {
        let at = |x: usize, y: usize| match (x, y) {
            (8..14, 4..8) => [235, 235, 240],
            (_, 0..16) => [90, 140 + y as u8, 220],
            (20..26, 20..26) => [230, 230, 235],
            _ => [150, 60, 50],
        };
        (0..32).flat_map(|y| (0..40).flat_map(move |x| at(x, y))).collect()
    }

    fn input<'a>(rgb: &'a [u8], points: &'a [[f32; 2]]) -> SkyInput<'a> {
        SkyInput { rgb, width: 40, far: None, has_depth: &[], below: &[], points }
    }

    #[test]
    fn clouds_are_sky_and_windows_cannot_be_told() {
        let rgb = photo();
        let classes = classify(&input(&rgb, &[]));
        let at = |x: usize, y: usize| classes[y * 40 + x];
        assert_eq!([at(0, 0), at(39, 10), at(10, 6)], [SkyClass::Sky; 3]);
        assert_eq!([at(5, 20), at(30, 31), at(0, 18)], [SkyClass::Place; 3]);
        assert_eq!([at(5, 15), at(5, 16), at(22, 22)], [SkyClass::Unknown; 3]);
        // A point on the cloud: a white wall then, which is no sky.
        let walled = classify(&input(&rgb, &[[10.5, 6.5]]));
        assert_eq!(walled[6 * 40 + 10], SkyClass::Place);
        assert_ne!(walled[5 * 40 + 8], SkyClass::Sky);
        // Depth that reaches over the wall's edge into the sky, and depth of something as blue as
        // it that does not stand at an edge.
        let has_depth: Vec<bool> = (0..40 * 32).map(|i| (11..30).contains(&(i / 40))).collect();
        let fattened = classify(&SkyInput { has_depth: &has_depth, ..input(&rgb, &[]) });
        assert!(fattened[..19 * 40] == classes[..19 * 40]);
        let has_depth: Vec<bool> = (0..40 * 32).map(|i| i % 40 > 20 && i / 40 > 1).collect();
        let blue = classify(&SkyInput { has_depth: &has_depth, ..input(&rgb, &[]) });
        assert_eq!([blue[8 * 40 + 22], blue[12 * 40 + 35]], [SkyClass::Sky, SkyClass::Place]);
    }

    #[test]
    fn below_the_horizon_there_is_no_sky() {
        // A drone's photo of snow, straight down: all of it has a sky's colours.
        let snow = [230u8, 235, 240].repeat(40 * 32);
        let up = CaptureUp { up: DVec3::Z, error: 1.0, evidence: UpEvidence::Given };
        let looking = |target: DVec3, roll: DVec3| {
            let camera = Camera::looking((80, 64), 60.0, DVec3::ZERO, target, roll).unwrap();
            let below = below_horizon(&camera, 40, 32, Some(&up));
            classify(&SkyInput { below: &below, ..input(&snow, &[]) })
        };
        assert!(looking(DVec3::NEG_Z, DVec3::Y).iter().all(|class| *class == SkyClass::Place));
        let ahead = looking(DVec3::Y, DVec3::Z);
        assert_eq!([ahead[5], ahead[31 * 40 + 5]], [SkyClass::Sky, SkyClass::Place]);
        let below = below_horizon(
            &Camera::looking((8, 6), 60.0, DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap(),
            8,
            6,
            None,
        );
        assert!(below.is_empty());
    }

    #[test]
    fn without_a_sky_there_is_none() {
        let wall = vec![120u8; 40 * 32 * 3];
        assert!(classify(&input(&wall, &[])).iter().all(|class| *class == SkyClass::Place));
        // Inverse depth that is far at the top only.
        let far: Vec<f32> = (0..40 * 32).map(|i| if i < 400 { 0.0 } else { 1.0 }).collect();
        let found = classify(&SkyInput { far: Some(&far), ..input(&wall, &[]) });
        assert_eq!((found[0], found[1279]), (SkyClass::Sky, SkyClass::Place));
        let all_far = vec![0.0; 40 * 32];
        let all = classify(&SkyInput { far: Some(&all_far), ..input(&wall, &[]) });
        assert!(all.iter().all(|class| *class == SkyClass::Sky));
    }
}
