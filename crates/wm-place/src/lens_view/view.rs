//! A lens in a picture of one size, and pictures through it.

use crate::drawing::Drawing;
use crate::shot::{MovingCamera, PinholeShot};
use crate::{Picture, Result};
use glam::{DMat3, DMat4, DVec3, Vec4};
use rayon::prelude::*;
use std::f64::consts::TAU;
use wm_render::Stats;
use wm_scene::{Camera, LensModel};

/// A rectangle of a picture, px.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PictureRect {
    /// Left and top.
    pub(crate) at: [u32; 2],
    /// Width and height.
    pub(crate) size: [u32; 2],
}

/// Tangent of the angle from the axis up to which one pinhole picture shows all.
const SINGLE_SIDE_MAX_TANGENT: f64 = 1.5;
/// Share by which the coordinates of a direction along two axes differ where one side has gone over
/// into the other.
const SIDE_OVERLAP_SHARE: f64 = 0.07;
/// Pixels beyond the outermost sample of a side; with a half, so that a lens without distortion is
/// sampled at the middles of pixels.
const SIDE_MARGIN_PX: f64 = 3.5;

/// A lens in a picture of one size, with the pinhole pictures that it is sampled from. Made once
/// for all frames.
#[derive(Clone, Debug)]
pub struct LensView {
    lens: LensModel,
    camera: Camera,
    sides: Vec<Side>,
    /// First tap of each pixel, and the end of all.
    first: Vec<u32>,
    taps: Vec<Tap>,
}

/// One pinhole picture.
#[derive(Clone, Debug)]
struct Side {
    /// Rotation from the axes of the lens to those of the side.
    rotation: DMat3,
    /// The size and the intrinsics.
    camera: Camera,
    /// The intrinsics of the whole side, which the rendered part is cropped from.
    whole: Camera,
}

/// A sample of a side.
#[derive(Clone, Copy, Debug)]
struct Tap {
    side: u32,
    /// px.
    at: [f32; 2],
    weight: f32,
    /// Length of the ray at view z 1.
    long: f32,
}

/// A point of a side.
pub(crate) struct SidePoint {
    /// The side, by its place among [`LensView::cameras`].
    pub(crate) side: usize,
    /// px.
    pub(crate) at: [f64; 2],
    /// Width and height of the side, px.
    pub(crate) size: (u32, u32),
    /// Length of the ray at view z 1.
    pub(crate) long: f32,
}

impl LensView {
    /// The view of a lens with the size, the focal lengths and the principal point of `camera`; its
    /// pose is not used.
    ///
    /// # Errors
    /// [`crate::Error::Camera`] if the lens folds within the picture or a side would be too large.
    pub fn new(lens: LensModel, camera: &Camera) -> Result<Self> {
        lens.check(camera)?;
        let camera = Camera { viewmat: DMat4::IDENTITY, ..*camera };
        let (width, height) = (camera.width as usize, camera.height as usize);
        let rays: Vec<Option<DVec3>> = (0..width * height)
            .into_par_iter()
            .map(|i| lens.ray(&camera, [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5]))
            .collect();
        let is_narrow = rays.iter().flatten().all(|ray| ray.x.hypot(ray.y) < SINGLE_SIDE_MAX_TANGENT * ray.z);
        let focal = match lens {
            LensModel::Equirectangular => [f64::from(camera.width) / TAU; 2],
            _ => [camera.fx, camera.fy],
        };
        let rotations: &[DMat3] = if is_narrow { &cube()[..1] } else { &cube() };
        let weights = |ray: DVec3| -> [f64; 6] {
            let along: [f64; 6] =
                std::array::from_fn(|k| rotations.get(k).map_or(-1.0, |r| r.row(2).dot(ray)));
            let most = along.into_iter().fold(f64::MIN, f64::max);
            let share = along.map(|along| {
                let share = ((along / most - 1.0) / SIDE_OVERLAP_SHARE + 1.0).clamp(0.0, 1.0);
                share * share * (3.0 - 2.0 * share)
            });
            let sum: f64 = share.iter().sum();
            share.map(|share| share / sum)
        };
        // Where each side is looked at, tangents.
        let mut bounds = [[f64::MAX, f64::MAX, f64::MIN, f64::MIN]; 6];
        for ray in rays.iter().flatten() {
            for (k, _) in weights(*ray).into_iter().enumerate().filter(|(_, weight)| *weight > 0.0) {
                let [u, v, _] = (rotations[k] * *ray).to_array().map(|c| c / rotations[k].row(2).dot(*ray));
                let bound = &mut bounds[k];
                *bound = [bound[0].min(u), bound[1].min(v), bound[2].max(u), bound[3].max(v)];
            }
        }
        let mut sides = Vec::new();
        let mut index = [u32::MAX; 6];
        for (k, [left, top, right, bottom]) in bounds.into_iter().enumerate().filter(|(_, b)| b[0] <= b[2]) {
            let length =
                |low: f64, high: f64, focal: f64| ((high - low) * focal + 2.0 * SIDE_MARGIN_PX).ceil() as u32;
            let side = Camera {
                width: length(left, right, focal[0]),
                height: length(top, bottom, focal[1]),
                fx: focal[0],
                fy: focal[1],
                cx: SIDE_MARGIN_PX - left * focal[0],
                cy: SIDE_MARGIN_PX - top * focal[1],
                ..camera
            };
            side.check()?;
            index[k] = sides.len() as u32;
            sides.push(Side { rotation: rotations[k], camera: side, whole: side });
        }
        let (mut first, mut taps) = (vec![0], Vec::with_capacity(rays.len()));
        for ray in &rays {
            for (k, weight) in ray.map_or([0.0; 6], weights).into_iter().enumerate() {
                if let Some(ray) = ray.filter(|_| weight > 0.0) {
                    let side = &sides[index[k] as usize];
                    let [x, y, z] = (side.rotation * ray).to_array();
                    let at =
                        [x / z * side.camera.fx + side.camera.cx, y / z * side.camera.fy + side.camera.cy];
                    taps.push(Tap {
                        side: index[k],
                        at: at.map(|v| v as f32),
                        weight: weight as f32,
                        long: (1.0 / z) as f32,
                    });
                }
            }
            first.push(taps.len() as u32);
        }
        Ok(Self { lens, camera, sides, first, taps })
    }

    /// The lens.
    #[must_use]
    pub fn lens(&self) -> LensModel {
        self.lens
    }

    /// The size, the focal lengths and the principal point of the picture.
    #[must_use]
    pub fn intrinsics(&self) -> &Camera {
        &self.camera
    }

    /// Returns true if the picture is put together from several pinhole pictures.
    pub(crate) fn is_composed(&self) -> bool {
        self.sides.len() > 1
    }

    /// The view of a part of the picture, whose pixels are those of the whole.
    pub(crate) fn cut(&self, rect: &PictureRect) -> Self {
        let [left, top] = rect.at;
        let [width, height] = rect.size;
        let (mut first, mut taps) = (vec![0], Vec::new());
        for y in top..top + height {
            for x in left..left + width {
                taps.extend_from_slice(self.taps((y * self.camera.width + x) as usize));
                first.push(taps.len() as u32);
            }
        }
        // Each side is as large as its samples need, and as far from the edge as in the whole.
        let mut bounds = vec![[f32::MAX, f32::MAX, f32::MIN, f32::MIN]; self.sides.len()];
        for Tap { side, at: [x, y], .. } in &taps {
            let bound = &mut bounds[*side as usize];
            *bound = [bound[0].min(*x), bound[1].min(*y), bound[2].max(*x), bound[3].max(*y)];
        }
        let mut sides = Vec::new();
        let mut moved = vec![(0, [0.0; 2]); self.sides.len()];
        for (k, [left, top, right, bottom]) in bounds.into_iter().enumerate().filter(|(_, b)| b[0] <= b[2]) {
            let pad = SIDE_MARGIN_PX as f32;
            let begin = [left, top].map(|low| (low - pad).floor().max(0.0));
            let length = |high: f32, begin: f32, whole: u32| {
                ((high - begin + pad).ceil() as u32).min(whole - begin as u32)
            };
            let whole = self.sides[k].camera;
            let camera = Camera {
                width: length(right, begin[0], whole.width),
                height: length(bottom, begin[1], whole.height),
                cx: whole.cx - f64::from(begin[0]),
                cy: whole.cy - f64::from(begin[1]),
                ..whole
            };
            moved[k] = (sides.len() as u32, begin);
            sides.push(Side { camera, ..self.sides[k].clone() });
        }
        for tap in &mut taps {
            let (side, begin) = moved[tap.side as usize];
            tap.side = side;
            tap.at = [tap.at[0] - begin[0], tap.at[1] - begin[1]];
        }
        let camera = Camera {
            width,
            height,
            cx: self.camera.cx - f64::from(left),
            cy: self.camera.cy - f64::from(top),
            ..self.camera
        };
        Self { lens: self.lens, camera, sides, first, taps }
    }

    /// The cameras of the pinhole pictures, for the pose and the near plane of `camera`.
    #[must_use]
    pub fn cameras(&self, camera: &Camera) -> Vec<Camera> {
        let turned = |side: &Side| Camera {
            viewmat: DMat4::from_mat3(side.rotation) * camera.viewmat,
            near: camera.near,
            ..side.camera
        };
        self.sides.iter().map(turned).collect()
    }

    /// Samples the pictures of [`Self::cameras`]: depths become distances from the eye, and what
    /// the lens does not show is 0.
    fn sample(&self, sides: &[Picture], picture: &mut Picture) {
        let size = (self.camera.width, self.camera.height);
        let Some(one) = sides.first() else { return };
        let frame = &mut picture.frame;
        (frame.width, frame.height, frame.encoding) = (size.0, size.1, one.frame.encoding);
        self.blend_colors(sides, &mut frame.rgb, &mut frame.alpha);
        self.blend::<4>(sides, |side| &side.frame.particles, &mut frame.particles);
        self.nearest::<1>(sides, |side| &side.frame.depth, true, &mut frame.depth);
        self.nearest::<1>(sides, |side| &side.frame.median_depth, true, &mut frame.median_depth);
        self.nearest::<3>(sides, |side| &side.frame.normal, false, &mut frame.normal);
        frame.front.clear();
        let parts = &mut picture.parts;
        self.blend::<3>(sides, |side| &side.parts.clean, &mut parts.clean);
        self.blend::<3>(sides, |side| &side.parts.transmittance, &mut parts.transmittance);
        self.blend::<3>(sides, |side| &side.parts.airlight, &mut parts.airlight);
        let water = &mut picture.water;
        self.blend::<1>(sides, |side| &side.water.cover, &mut water.cover);
        self.blend::<1>(sides, |side| &side.water.reflected, &mut water.reflected);
        self.nearest::<1>(sides, |side| &side.water.depth, true, &mut water.depth);
    }

    /// The taps of pixel `i`.
    fn taps(&self, i: usize) -> &[Tap] {
        &self.taps[self.first[i] as usize..self.first[i + 1] as usize]
    }

    /// The place in the pictures of [`Self::cameras`] that shows most of a pixel; `None` where the
    /// lens shows nothing.
    pub(crate) fn side_of(&self, pixel: usize) -> Option<SidePoint> {
        let tap = self.taps(pixel).iter().max_by(|a, b| a.weight.total_cmp(&b.weight))?;
        let Camera { width, height, .. } = self.sides[tap.side as usize].camera;
        let (side, at) = (tap.side as usize, tap.at.map(f64::from));
        Some(SidePoint { side, at, size: (width, height), long: tap.long })
    }

    /// Samples an array of `N` numbers a pixel by cubic convolution; sides without it count as 0.
    fn blend<const N: usize>(
        &self,
        sides: &[Picture],
        array: impl Fn(&Picture) -> &Vec<f32> + Sync,
        out: &mut Vec<f32>,
    ) {
        self.each::<N>(sides, array, out, |i, of, out| {
            for tap in self.taps(i) {
                let side = &self.sides[tap.side as usize].camera;
                if let Some(pixels) = of[tap.side as usize] {
                    Stencil::of(tap, side).add::<N>(pixels, out);
                }
            }
        });
    }

    /// Samples colours and coverage, which every side has, at once.
    fn blend_colors(&self, sides: &[Picture], rgb: &mut Vec<f32>, alpha: &mut Vec<f32>) {
        let (pixels, width) = (self.first.len() - 1, self.camera.width as usize);
        rgb.resize(3 * pixels, 0.0);
        alpha.resize(pixels, 0.0);
        let rows = rgb.par_chunks_mut(3 * width).zip(alpha.par_chunks_mut(width));
        rows.enumerate().for_each(|(y, (colors, coverage))| {
            for (x, (color, alpha)) in colors.as_chunks_mut::<3>().0.iter_mut().zip(coverage).enumerate() {
                let (mut sum, mut covered) = (Vec4::ZERO, 0.0);
                for tap in self.taps(y * width + x) {
                    let frame = &sides[tap.side as usize].frame;
                    let stencil = Stencil::of(tap, &self.sides[tap.side as usize].camera);
                    sum += stencil.vector::<3>(&frame.rgb);
                    covered += stencil.number(&frame.alpha);
                }
                *color = sum.truncate().to_array();
                *alpha = covered;
            }
        });
    }

    /// Takes an array's pixel of the side that counts most; depths times the length of the ray.
    fn nearest<const N: usize>(
        &self,
        sides: &[Picture],
        array: impl Fn(&Picture) -> &Vec<f32> + Sync,
        is_depth: bool,
        out: &mut Vec<f32>,
    ) {
        self.each::<N>(sides, array, out, |i, of, out| {
            let Some(tap) = self.taps(i).iter().max_by(|a, b| a.weight.total_cmp(&b.weight)) else { return };
            let Some(pixels) = of[tap.side as usize] else { return };
            let side = &self.sides[tap.side as usize].camera;
            let [x, y] = tap.at.map(|v| v as usize);
            let at = y.min(side.height as usize - 1) * side.width as usize + x.min(side.width as usize - 1);
            let scale = if is_depth { tap.long } else { 1.0 };
            for (k, out) in out.iter_mut().enumerate() {
                *out = pixels[N * at + k] * scale;
            }
        });
    }

    /// Fills an array of `N` numbers a pixel, from 0; empties it if no side has it.
    fn each<const N: usize>(
        &self,
        sides: &[Picture],
        array: impl Fn(&Picture) -> &Vec<f32> + Sync,
        out: &mut Vec<f32>,
        fill: impl Fn(usize, &[Option<&[f32]>], &mut [f32; N]) + Sync,
    ) {
        let of: Vec<Option<&[f32]>> =
            sides.iter().map(|side| Some(&array(side)[..]).filter(|pixels| !pixels.is_empty())).collect();
        out.clear();
        if of.iter().any(Option::is_some) {
            let width = self.camera.width as usize;
            out.resize(N * (self.first.len() - 1), 0.0);
            out.par_chunks_mut(N * width).enumerate().for_each(|(y, row)| {
                for (x, pixel) in row.as_chunks_mut::<N>().0.iter_mut().enumerate() {
                    fill(y * width + x, &of, pixel);
                }
            });
        }
    }
}

/// The 16 pixels of a side that a tap samples, and their weights by the kernel of Keys (1981) with
/// a = -1/2. There are two pixels or more to all sides of the middle four ([`SIDE_MARGIN_PX`]), and
/// one more to the right.
struct Stencil {
    /// The number of the first pixel.
    first: usize,
    /// Pixels a row.
    width: usize,
    across: [f32; 4],
    down: [f32; 4],
    weight: f32,
}

impl Stencil {
    #[inline]
    fn of(tap: &Tap, side: &Camera) -> Self {
        let width = side.width as usize;
        let [x, y] = tap.at.map(|v| v - 0.5);
        // Both are above 0.
        let [left, top] = [x as u32, y as u32];
        Self {
            first: (top as usize - 1) * width + left as usize - 1,
            width,
            across: kernel(x - left as f32),
            down: kernel(y - top as f32),
            weight: tap.weight,
        }
    }

    /// Adds the sample of an array, within what the four pixels about it hold: beside lamps it
    /// would ring. `N` is 1, 3 or 4.
    #[inline]
    fn add<const N: usize>(&self, pixels: &[f32], out: &mut [f32; N]) {
        if N == 1 {
            out[0] += self.number(pixels);
        } else {
            let sample = self.vector::<N>(pixels).to_array();
            for (out, sample) in out.iter_mut().zip(sample) {
                *out += sample;
            }
        }
    }

    /// The weighted sample of one number per pixel.
    #[inline]
    fn number(&self, pixels: &[f32]) -> f32 {
        let row = |row: usize| Vec4::from_slice(&pixels[self.first + row * self.width..][..4]);
        let rows = [row(0), row(1), row(2), row(3)];
        let [a, b, c, d] = self.down;
        let columns = rows[0] * a + rows[1] * b + rows[2] * c + rows[3] * d;
        let [low, high] = [rows[1].min(rows[2]), rows[1].max(rows[2])];
        let sum = columns.dot(Vec4::from_array(self.across));
        self.weight * sum.max(low.y.min(low.z)).min(high.y.max(high.z))
    }

    /// The weighted sample of `N` numbers a pixel, 3 or 4.
    #[inline]
    fn vector<const N: usize>(&self, pixels: &[f32]) -> Vec4 {
        let mut sum = Vec4::ZERO;
        let (mut low, mut high) = (Vec4::MAX, Vec4::MIN);
        let [a, b, c, d] = self.across;
        for (row, down) in self.down.iter().enumerate() {
            // The last pixel of three numbers is loaded with one of the next.
            let line = &pixels[N * (self.first + row * self.width)..][..3 * N + 4];
            let pixel = |k: usize| Vec4::from_slice(&line[N * k..]);
            let own = [pixel(0), pixel(1), pixel(2), pixel(3)];
            sum += (own[0] * a + own[1] * b + own[2] * c + own[3] * d) * *down;
            if row == 1 || row == 2 {
                low = low.min(own[1]).min(own[2]);
                high = high.max(own[1]).max(own[2]);
            }
        }
        sum.max(low).min(high) * self.weight
    }
}

/// Weights of four pixels in a row for a point between the middle two.
#[inline]
fn kernel(t: f32) -> [f32; 4] {
    let (square, cube) = (t * t, t * t * t);
    [
        -0.5 * cube + square - 0.5 * t,
        1.5 * cube - 2.5 * square + 1.0,
        -1.5 * cube + 2.0 * square + 0.5 * t,
        0.5 * cube - 0.5 * square,
    ]
}

/// The axes of the sides of a cube from those of the lens: ahead, right, left, down, up, behind.
/// Rows are right, down, forward.
fn cube() -> [DMat3; 6] {
    let rows = |right: DVec3, down: DVec3, forward: DVec3| DMat3::from_cols(right, down, forward).transpose();
    let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z];
    [rows(x, y, z), rows(-z, y, x), rows(z, y, -x), rows(x, -z, y), rows(x, z, -y), rows(-x, y, -z)]
}

impl Drawing<'_> {
    /// Draws a picture of one instant: of a pinhole, or through a lens, whose size and intrinsics
    /// count then. Depths through a lens are distances from the eye.
    ///
    /// # Errors
    /// Errors of the place and the renderer.
    pub(crate) async fn through(
        &mut self,
        lens: Option<&LensView>,
        shot: &PinholeShot<'_>,
        picture: &mut Picture,
    ) -> Result<Stats> {
        let Some(lens) = lens else { return self.pinhole(shot, picture).await };
        let cameras = lens.cameras(&shot.camera.camera);
        let mut sides = std::mem::take(&mut self.renderer.sides);
        sides.resize_with(cameras.len(), Picture::default);
        let mut stats = Stats::default();
        for ((camera, of), side) in cameras.into_iter().zip(&lens.sides).zip(&mut sides) {
            let Camera { viewmat, near, .. } = camera;
            let whole = Some(Camera { viewmat, near, ..of.whole });
            let own = PinholeShot { camera: MovingCamera { camera, ..shot.camera }, whole, ..*shot };
            stats += self.pinhole(&own, side).await?;
        }
        let started = web_time::Instant::now();
        self.renderer.backend().pool().install(|| lens.sample(&sides, picture));
        stats.wall += started.elapsed().as_secs_f64();
        picture.metres_per_unit = sides.first().map_or(0.0, |side| side.metres_per_unit);
        self.renderer.sides = sides;
        Ok(stats)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_render::Frame;

    /// Sides on which each pixel holds its direction.
    fn directions(view: &LensView) -> Vec<Picture> {
        let cameras = view.cameras(&view.camera);
        let direction = |camera: &Camera, i: usize| {
            let (x, y) = (i % camera.width as usize, i / camera.width as usize);
            let [u, v] = [(x as f64 + 0.5 - camera.cx) / camera.fx, (y as f64 + 0.5 - camera.cy) / camera.fy];
            camera.rotation().transpose() * DVec3::new(u, v, 1.0).normalize()
        };
        let picture = |camera: &Camera| {
            let pixels = camera.width as usize * camera.height as usize;
            let ways = || (0..pixels).map(|i| direction(camera, i));
            let frame = Frame {
                width: camera.width,
                height: camera.height,
                rgb: ways().flat_map(|way| way.to_array().map(|v| 0.5 + 0.5 * v as f32)).collect(),
                alpha: vec![1.0; pixels],
                depth: ways().map(|way| (camera.rotation() * way).z as f32 * 7.0).collect(),
                ..Frame::default()
            };
            Picture { frame, ..Picture::default() }
        };
        cameras.iter().map(picture).collect()
    }

    /// Every pixel shows its own direction, whichever sides it is sampled from, and a sphere about
    /// the eye has one distance.
    #[test]
    fn pixels_show_their_directions() {
        let (fisheye, round) = LensModel::fisheye((96, 80), 290.0).unwrap();
        let wide = Camera { width: 128, height: 64, ..round };
        let near = Camera { fx: 90.0, fy: 90.0, ..round };
        let bent =
            LensModel::Perspective(wm_scene::camera::Distortion::of([-0.1, 0.02, 0.001, 0.002, 0.001]));
        for (lens, camera, count) in
            [(fisheye, round, 6), (LensModel::Equirectangular, wide, 6), (bent, near, 1)]
        {
            let view = LensView::new(lens, &camera).unwrap();
            assert_eq!(view.cameras(&camera).len(), count, "{lens:?}");
            let mut picture = Picture::default();
            view.sample(&directions(&view), &mut picture);
            let frame = &picture.frame;
            assert_eq!((frame.width, frame.height), (camera.width, camera.height));
            for (i, pixel) in frame.rgb.as_chunks::<3>().0.iter().enumerate() {
                let at = [(i % camera.width as usize) as f64 + 0.5, (i / camera.width as usize) as f64 + 0.5];
                let Some(ray) = lens.ray(&camera, at) else {
                    assert_eq!((*pixel, frame.depth[i]), ([0.0; 3], 0.0));
                    continue;
                };
                let found = DVec3::from_array(pixel.map(|v| f64::from(2.0 * v - 1.0)));
                assert!((found - ray).length() < 2e-3, "{lens:?} at {at:?}: {found} for {ray}");
                assert!((frame.alpha[i] - 1.0).abs() < 1e-5);
                // The nearest pixel's view z, times the length of this ray.
                assert!((frame.depth[i] - 7.0).abs() < 0.25, "{lens:?} at {at:?}: {}", frame.depth[i]);
            }
        }
    }
}
