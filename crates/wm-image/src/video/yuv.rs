//! sRGB-encoded floats to 8-bit YCbCr 4:2:0, BT.709, limited range.
//!
//! With R, G, B within 0-1 (ITU-R BT.709-6, sections 3 and 4):
//!
//! ```text
//! Y  =  16 + 219 (0.2126 R + 0.7152 G + 0.0722 B)
//! Cb = 128 + 224 (B - Y') / 1.8556          Y' = 0.2126 R + 0.7152 G + 0.0722 B
//! Cr = 128 + 224 (R - Y') / 1.5748
//! ```
//!
//! Chroma is the mean of two rows and of (1, 2, 1)/4 over three columns, which puts it where H.264
//! expects it unless told otherwise: on the left column of its two, between its two rows. All is
//! computed in f32 and quantised once, dithered, since an encoder cannot undo contours that were
//! made before it. sRGB's curve differs a little from the one BT.709 names; players show BT.709
//! video on sRGB screens without converting, so it is passed through, as is usual.
//!
//! The dither has one offset for 4x4 pixels of a plane, aligned with the blocks that H.264
//! transforms. A pattern that changes from pixel to pixel is all high frequencies, and no encoder
//! keeps half a step there: what comes out are the contours again, now with square corners. A block
//! that is one step brighter is one coefficient, the first, of four steps: it costs least and is
//! lost last.

use crate::PictureSize;
use crate::color::{Dither, byte, unit};

const KR: f32 = 0.2126;
const KG: f32 = 0.7152;
const KB: f32 = 0.0722;
const CB_SCALE: f32 = 224.0 / 1.8556;
const CR_SCALE: f32 = 224.0 / 1.5748;

/// One frame's planes and the means to fill them, allocated once.
#[derive(Debug)]
pub(crate) struct Yuv420 {
    size: PictureSize,
    dither: Dither,
    /// Y `[H, W]`, then Cb and Cr, each `[H/2, W/2]`.
    bytes: Vec<u8>,
    /// Cb and Cr of one row or the sum of two, `[W + 1]`, one column of margin on the left.
    cb: Vec<f32>,
    cr: Vec<f32>,
    /// Dither of one row of Y, Cb and Cr.
    offsets: [Vec<f32>; 3],
}

/// Side of a block of one offset, pixels of its plane: that of H.264's transform.
const BLOCK_SIDE_PX: usize = 4;

impl Yuv420 {
    /// For frames of `size`, which has even sides.
    pub(crate) fn new(size: PictureSize, dither: Dither) -> Self {
        assert!(size.width.is_multiple_of(2) && size.height.is_multiple_of(2), "an odd side: {size:?}");
        let width = size.width as usize;
        let (cb, cr) = (vec![0.0; width + 1], vec![0.0; width + 1]);
        let offsets = [width, width / 2, width / 2].map(|width| vec![0.0; width]);
        Self { size, dither, bytes: vec![0; size.pixels() * 3 / 2], cb, cr, offsets }
    }

    /// Fills the planes from `rgb [H, W, 3]`, sRGB-encoded 0-1; what lies outside is clipped.
    pub(crate) fn convert(&mut self, rgb: &[f32]) {
        let Self { size, dither, bytes, cb, cr, offsets: [y_offsets, cb_offsets, cr_offsets] } = self;
        size.expect("rgb", rgb, 3);
        let width = size.width as usize;
        let (y_plane, chroma) = bytes.split_at_mut(size.pixels());
        let (cb_plane, cr_plane) = chroma.split_at_mut(size.pixels() / 4);
        let chroma_rows = cb_plane.chunks_exact_mut(width / 2).zip(cr_plane.chunks_exact_mut(width / 2));
        let row_pairs = rgb.chunks_exact(6 * width).zip(y_plane.chunks_exact_mut(2 * width));
        for (j, ((rgb, luma), (cb_row, cr_row))) in row_pairs.zip(chroma_rows).enumerate() {
            cb.fill(0.0);
            cr.fill(0.0);
            for (i, (rgb, luma)) in rgb.chunks_exact(3 * width).zip(luma.chunks_exact_mut(width)).enumerate()
            {
                set_offsets(y_offsets, *dither, 0, 2 * j + i);
                convert_row(rgb, luma, &mut cb[1..], &mut cr[1..], y_offsets);
            }
            set_offsets(cb_offsets, *dither, 1, j);
            halve_row(cb, cb_row, cb_offsets);
            set_offsets(cr_offsets, *dither, 2, j);
            halve_row(cr, cr_row, cr_offsets);
        }
    }

    /// All three planes, one after the other.
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Y `[H, W]`, Cb and Cr `[H/2, W/2]`.
    #[cfg(any(feature = "h264", test))]
    pub(super) fn planes(&self) -> [&[u8]; 3] {
        let pixels = self.size.pixels();
        let (y, chroma) = self.bytes.split_at(pixels);
        let (cb, cr) = chroma.split_at(pixels / 4);
        [y, cb, cr]
    }
}

/// Makes `offsets` those of row `y` of a plane, if they were those of the row before.
fn set_offsets(offsets: &mut [f32], dither: Dither, channel: usize, y: usize) {
    if y.is_multiple_of(BLOCK_SIDE_PX) {
        let pattern = dither.row(channel, y / BLOCK_SIDE_PX).iter().cycle();
        for (block, &offset) in offsets.chunks_mut(BLOCK_SIDE_PX).zip(pattern) {
            block.fill(offset);
        }
    }
}

/// Writes the luma of a row and adds its chroma, without offset, to `cb` and `cr`.
fn convert_row(rgb: &[f32], luma: &mut [u8], cb: &mut [f32], cr: &mut [f32], offsets: &[f32]) {
    let pixels = rgb.chunks_exact(3).zip(luma).zip(cb.iter_mut().zip(cr)).zip(offsets);
    for (((rgb, luma), (cb, cr)), offset) in pixels {
        let (r, g, b) = (unit(rgb[0]), unit(rgb[1]), unit(rgb[2]));
        let y = KR * r + KG * g + KB * b;
        *cb += CB_SCALE * (b - y);
        *cr += CR_SCALE * (r - y);
        *luma = byte(16.0 + 219.0 * y + offset);
    }
}

/// Filters the sum of two rows, whose first place is free for the column left of the picture, to
/// half the width and quantises.
fn halve_row(sums: &mut [f32], out: &mut [u8], offsets: &[f32]) {
    sums[0] = sums[1];
    for ((out, triple), offset) in out.iter_mut().zip(sums.windows(3).step_by(2)).zip(offsets) {
        // 1/4 for the columns' weights, 1/2 for the rows.
        let value = 128.0 + 0.125 * (triple[0] + 2.0 * triple[1] + triple[2]);
        *out = byte(value + offset);
    }
}

/// The formulas of the standard's inverse, f64.
#[cfg(test)]
pub(super) fn rgb_of(y: f64, cb: f64, cr: f64) -> [f64; 3] {
    let (y, b, r) = ((y - 16.0) / 219.0, 1.8556 * (cb - 128.0) / 224.0, 1.5748 * (cr - 128.0) / 224.0);
    let green = y - (0.0722 * b + 0.2126 * r) / 0.7152;
    [y + r, green, y + b]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn convert(rgb: &[f32], size: PictureSize, dither: Dither) -> Yuv420 {
        let mut yuv = Yuv420::new(size, dither);
        yuv.convert(rgb);
        yuv
    }

    #[test]
    fn primaries_have_the_codes_of_the_standard() {
        // BT.709 colour bars, 8 bit limited range.
        let size = PictureSize::new(4, 2);
        for (rgb, codes) in [
            ([0.0, 0.0, 0.0], [16, 128, 128]),
            ([1.0, 1.0, 1.0], [235, 128, 128]),
            ([1.0, 0.0, 0.0], [63, 102, 240]),
            ([0.0, 1.0, 0.0], [173, 42, 26]),
            ([0.0, 0.0, 1.0], [32, 240, 118]),
            ([1.0, 1.0, 0.0], [219, 16, 138]),
            ([0.0, 1.0, 1.0], [188, 154, 16]),
            ([1.0, 0.0, 1.0], [78, 214, 230]),
        ] {
            let yuv = convert(&rgb.repeat(8), size, Dither::Off);
            for (plane, code) in yuv.planes().into_iter().zip(codes) {
                assert!(plane.iter().all(|&value| value == code), "{rgb:?}: {plane:?} not {code}");
            }
            assert_eq!(yuv.bytes().len(), 12);
        }
        let outside = convert(&[f32::NAN, -3.0, 7.0].repeat(8), size, Dither::Off);
        assert_eq!(outside.bytes(), convert(&[0.0, 0.0, 1.0].repeat(8), size, Dither::Off).bytes());
    }

    #[test]
    fn dithered_planes_have_the_exact_means() {
        // One period of the pattern in chroma.
        let size = PictureSize::new(512, 512);
        for rgb in [[0.31f32, 0.42, 0.57], [0.9, 0.2, 0.05], [0.501, 0.503, 0.502]] {
            let yuv = convert(&rgb.repeat(size.pixels()), size, Dither::Ordered);
            let mean = |plane: &[u8]| plane.iter().map(|&v| f64::from(v)).sum::<f64>() / plane.len() as f64;
            let [y, cb, cr] = yuv.planes().map(mean);
            for (value, expected) in rgb_of(y, cb, cr).into_iter().zip(rgb) {
                assert!((value - f64::from(expected)).abs() < 1e-4, "{value} {expected}");
            }
        }
    }

    #[test]
    fn chroma_is_sited_on_the_left() {
        // A ramp of blue along x and y: the filter is symmetric around its site, so that the value
        // is that of the site exactly, up to rounding.
        let size = PictureSize::new(64, 16);
        let blue = |x: f32, y: f32| (x + y) / 100.0;
        let rgb: Vec<f32> =
            (0..size.pixels()).flat_map(|i| [0.0, 0.0, blue((i % 64) as f32, (i / 64) as f32)]).collect();
        let yuv = convert(&rgb, size, Dither::Off);
        let [_, cb, _] = yuv.planes();
        for (at, &value) in cb.iter().enumerate() {
            let (x, y) = ((at % 32) as f32 * 2.0, (at / 32) as f32 * 2.0 + 0.5);
            let exact = 128.0 + 112.0 * blue(x, y);
            // The first column has no left neighbour.
            assert!(x == 0.0 || (f32::from(value) - exact).abs() <= 0.51, "{x} {y}: {value} {exact}");
        }
    }
}
