//! A photo from its file to the picture that training compares with.

use super::{
    cache::Weigh,
    error::{PhotoError, PhotoFault},
    resize::{reduce, resize},
    undistort::{Lens, undistort},
};
use std::path::{Path, PathBuf};
use wm_image::header::{Orientation, PhotoKind, read_header};
use wm_image::photo::{DecodeError, Decoded, decode_photo};
use wm_scene::Camera;
use wm_scene::camera::Distortion;

/// Least side of a photo, px: of less the shape cannot be told, and nothing is learnt.
pub(super) const MIN_SIDE_PX: u32 = 8;

/// A photo, decoded, resized and undistorted.
#[derive(Clone, Debug, PartialEq)]
pub struct Photo {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// `[H, W, 3]`, sRGB, display-referred.
    pub rgb: Vec<u8>,
    /// `[H, W]`, 255 where the photo counts and 0 where it does not; `None` where all of it does.
    pub mask: Option<Vec<u8>>,
    /// The pinhole camera that sees this.
    pub camera: Camera,
}

impl Weigh for Photo {
    fn bytes(&self) -> usize {
        self.rgb.len() + self.mask.as_ref().map_or(0, Vec::len)
    }
}

impl Photo {
    /// The colour of a pixel, 0-1, sRGB.
    ///
    /// # Panics
    /// If it is outside of the picture.
    #[must_use]
    pub fn pixel(&self, x: u32, y: u32) -> [f32; 3] {
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) of {}x{}", self.width, self.height);
        let at = 3 * (y as usize * self.width as usize + x as usize);
        [0, 1, 2].map(|lane| f32::from(self.rgb[at + lane]) / 255.0)
    }

    /// All colours, `[H, W, 3]`, 0-1, sRGB.
    #[must_use]
    pub fn rgb_f32(&self) -> Vec<f32> {
        self.rgb.iter().map(|v| f32::from(*v) / 255.0).collect()
    }

    /// Returns the colour (sRGB) at a place in shares of width and height.
    pub(crate) fn at_share(&self, x: f64, y: f64) -> [u8; 3] {
        let (column, row) = ((x * f64::from(self.width)) as usize, (y * f64::from(self.height)) as usize);
        let at = 3 * (row * self.width as usize + column);
        [0, 1, 2].map(|c| self.rgb[at + c])
    }

    /// Returns the mask, 0-1.
    pub(crate) fn mask_f32(&self) -> Option<Vec<f32>> {
        self.mask.as_ref().map(|mask| mask.iter().map(|v| f32::from(*v) / 255.0).collect())
    }

    /// The photo with sides divided by `2^level`.
    pub(super) fn reduced(&self, level: u8) -> Self {
        let size = (self.width, self.height);
        let camera = reduced_camera(&self.camera, level);
        Self {
            width: camera.width,
            height: camera.height,
            rgb: reduce::<3>(&self.rgb, size, level),
            mask: self.mask.as_ref().map(|mask| reduce::<1>(mask, size, level)),
            camera,
        }
    }
}

/// The camera of a picture with sides divided by `2^level`, what is left over cut off.
pub(super) fn reduced_camera(camera: &Camera, level: u8) -> Camera {
    let scale = 0.5f64.powi(level.into());
    Camera {
        width: camera.width >> level,
        height: camera.height >> level,
        fx: camera.fx * scale,
        fy: camera.fy * scale,
        cx: camera.cx * scale,
        cy: camera.cy * scale,
        ..*camera
    }
}

/// Returns how often the sides of pictures are halved: until the largest has at most `pixels`
/// pixels, or the smallest has a side shorter than `shortest`.
pub(crate) fn level_for(cameras: &[Camera], pixels: u32, shortest: u32) -> u8 {
    let is_enough = |level: &u8| {
        let fits = |c: &Camera| (c.width >> level).saturating_mul(c.height >> level) <= pixels;
        let is_short = |c: &Camera| c.width.min(c.height) >> level < shortest;
        cameras.iter().all(fits) || cameras.iter().any(is_short)
    };
    (0..8).find(is_enough).unwrap_or(0)
}

/// All that is known of a photo before it is decoded.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    /// Index of its view in the capture.
    pub(crate) view: usize,
    pub(crate) file: PathBuf,
    pub(crate) mask: Option<PathBuf>,
    pub(crate) kind: PhotoKind,
    /// The size in the file, px.
    pub(crate) stored: (u32, u32),
    /// The orientation in the file.
    pub(crate) orientation: Orientation,
    pub(crate) lens: Lens,
}

impl Entry {
    /// The photo as it was taken, upright, px.
    fn upright(&self) -> (u32, u32) {
        let (width, height) = self.stored;
        if self.orientation.swaps_sides() { (height, width) } else { (width, height) }
    }

    /// Bytes of the photo once it is decoded, at most: with a mask.
    pub(crate) fn bytes(&self) -> usize {
        4 * self.lens.ideal.width as usize * self.lens.ideal.height as usize
    }

    /// Decodes the photo and its mask.
    pub(crate) fn load(&self) -> Result<Photo, PhotoError> {
        let Decoded { rgb, alpha, .. } = self.decoded(&self.file, self.kind)?;
        let upright = self.upright();
        let rgb = self.finished::<3>(&rgb, upright);
        let alpha = alpha.map(|alpha| self.finished::<1>(&alpha, upright));
        let mask = self.mask.as_deref().map(|path| self.load_mask(path)).transpose()?;
        let mask = match (alpha, mask) {
            (Some(alpha), Some(mask)) => Some(alpha.into_iter().zip(mask).map(|(a, b)| a.min(b)).collect()),
            (alpha, mask) => alpha.or(mask),
        };
        let camera = self.lens.ideal;
        Ok(Photo { width: camera.width, height: camera.height, rgb, mask, camera })
    }

    /// The mask: black is left out, white counts. Of coloured ones red says it.
    fn load_mask(&self, path: &Path) -> Result<Vec<u8>, PhotoError> {
        let header = read_header(path).map_err(|e| DecodeError::of_header(&e))?;
        let size = (header.width, header.height);
        // A mask is turned as the photo is if it lies as the stored photo does.
        let is_stored = size == self.stored || size != self.upright() && is_scaled(size, self.stored);
        let mut turned = self.clone();
        turned.stored = size;
        if !is_stored {
            turned.orientation = Orientation::Upright;
        }
        let upright = turned.upright();
        if !is_scaled(upright, self.upright()) {
            let (photo_width, photo_height) = self.upright();
            let fault = PhotoFault::Mask { width: size.0, height: size.1, photo_width, photo_height };
            return Err(PhotoError { path: path.into(), fault });
        }
        let Decoded { rgb, alpha, .. } = turned.decoded(path, header.kind)?;
        // Masks that are all one colour and transparent where nothing counts are masks by alpha.
        let mut mask: Vec<u8> = match alpha {
            Some(alpha) => alpha,
            None => rgb.chunks_exact(3).map(|pixel| pixel[0]).collect(),
        };
        // Many hold 0 and 1.
        if mask.iter().all(|v| *v <= 1) {
            mask.iter_mut().for_each(|v| *v *= u8::MAX);
        }
        Ok(self.finished::<1>(&mask, upright))
    }

    /// The picture of a file, upright.
    fn decoded(&self, path: &Path, kind: PhotoKind) -> Result<Decoded, PhotoError> {
        let decoded = decode_photo(path, kind)?;
        if (decoded.width, decoded.height) != self.stored {
            let fault = PhotoFault::Damaged("its size is not that of its header".into());
            return Err(PhotoError { path: path.into(), fault });
        }
        Ok(if self.orientation == Orientation::Upright {
            decoded
        } else {
            Decoded {
                rgb: turn::<3>(&decoded.rgb, self.stored, self.orientation),
                alpha: decoded.alpha.map(|alpha| turn::<1>(&alpha, self.stored, self.orientation)),
                ..decoded
            }
        })
    }

    fn finished<const N: usize>(&self, pixels: &[u8], size: (u32, u32)) -> Vec<u8> {
        let lens = &self.lens;
        let resized = resize::<N>(pixels, size, (lens.photo.width, lens.photo.height));
        if lens.distortion == Distortion::None { resized } else { undistort::<N>(&resized, lens) }
    }
}

/// Returns true if `size` is `camera` made smaller or larger as a whole, to whole pixels.
pub(super) fn is_scaled(size: (u32, u32), camera: (u32, u32)) -> bool {
    if size != camera && size.0.min(size.1) < MIN_SIDE_PX {
        return false;
    }
    // Each side may be off by one pixel: tools round, cut off or round up.
    let scales = |side: u32, full: u32| {
        let (side, full) = (f64::from(side), f64::from(full));
        ((side - 1.0) / full, (side + 1.0) / full)
    };
    let (across, down) = (scales(size.0, camera.0), scales(size.1, camera.1));
    across.0.max(down.0) <= across.1.min(down.1)
}

/// A stored picture made upright.
fn turn<const N: usize>(pixels: &[u8], stored: (u32, u32), orientation: Orientation) -> Vec<u8> {
    let (pixels, _) = pixels.as_chunks::<N>();
    let (width, height) = if orientation.swaps_sides() { (stored.1, stored.0) } else { stored };
    let mut out = Vec::with_capacity(pixels.len() * N);
    for y in 0..height {
        for x in 0..width {
            let (from_x, from_y) = orientation.stored_from_upright(x, y, stored.0, stored.1);
            out.extend(pixels[from_y as usize * stored.0 as usize + from_x as usize]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reduced_copies_are_known_as_such() {
        // Mip-NeRF 360: 5187 x 3361, divided by 4 and rounded.
        assert!(is_scaled((1297, 840), (5187, 3361)));
        assert!(is_scaled((1200, 887), (1200, 887)) && is_scaled((600, 443), (1200, 887)));
        assert!(is_scaled((4000, 3000), (1000, 750)));
        assert!(!is_scaled((887, 1200), (1200, 887)));
        assert!(!is_scaled((1200, 800), (1200, 887)));
        assert!(!is_scaled((640, 480), (640, 360)));
    }

    #[test]
    fn pictures_are_turned() {
        // 3 x 2: a quarter turn clockwise puts the left column on top, from the bottom up.
        let stored = [1, 2, 3, 4, 5, 6];
        assert_eq!(turn::<1>(&stored, (3, 2), Orientation::Turned90), [4, 1, 5, 2, 6, 3]);
        assert_eq!(turn::<1>(&stored, (3, 2), Orientation::Turned270), [3, 6, 2, 5, 1, 4]);
        assert_eq!(turn::<1>(&stored, (3, 2), Orientation::Turned180), [6, 5, 4, 3, 2, 1]);
        assert_eq!(turn::<2>(&stored, (3, 1), Orientation::Mirrored), [5, 6, 3, 4, 1, 2]);
    }
}
