//! Contact sheets: pictures of one size in a grid, each with a label on a dark strip.
//!
//! Outside the strips a picture's values are kept as they are, so that what a sheet compares is
//! what was rendered.

use super::PictureSize;
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};

/// Colour of the gaps between pictures, sRGB-encoded: near black, for white and dark pages.
const GAP_COLOR: [f32; 3] = [0.07, 0.075, 0.08];
/// Colour of the strip behind a label.
const STRIP_COLOR: [f32; 3] = [0.05, 0.055, 0.06];
/// Opacity of the strip: white letters stay readable on white fog.
const STRIP_ALPHA: f32 = 0.62;
/// Colour of the letters.
const LETTER_COLOR: [f32; 3] = [0.97, 0.97, 0.96];
/// Letters' heights with the least height of a picture for them, the largest first.
const LETTER_HEIGHTS: [(u32, RasterHeight); 4] = [
    (800, RasterHeight::Size32),
    (500, RasterHeight::Size24),
    (300, RasterHeight::Size20),
    (0, RasterHeight::Size16),
];

/// A picture of a sheet.
#[derive(Clone, Copy, Debug)]
pub struct SheetPanel<'a> {
    /// `[H, W, 3]`, sRGB-encoded 0-1.
    pub rgb: &'a [f32],
    /// The label; characters outside ASCII become question marks.
    pub label: &'a str,
}

/// The layout of a sheet of pictures of one size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SheetLayout {
    panel: PictureSize,
    columns: u32,
    rows: u32,
    gap: u32,
}

impl SheetLayout {
    /// `count` pictures in `columns`, row by row. Panics if either is 0.
    #[must_use]
    pub fn new(panel: PictureSize, count: u32, columns: u32) -> Self {
        assert!(count > 0 && columns > 0, "{count} pictures in {columns} columns");
        Self { panel, columns, rows: count.div_ceil(columns), gap: (panel.width / 200).max(1) }
    }

    /// Size of the whole sheet.
    #[must_use]
    pub fn size(&self) -> PictureSize {
        let along = |count: u32, side: u32| count * side + (count - 1) * self.gap;
        PictureSize::new(along(self.columns, self.panel.width), along(self.rows, self.panel.height))
    }

    /// Left and top of a picture, px.
    fn corner(&self, index: u32) -> (u32, u32) {
        let (column, row) = (index % self.columns, index / self.columns);
        (column * (self.panel.width + self.gap), row * (self.panel.height + self.gap))
    }
}

/// Draws the sheet, `[H, W, 3]` of [`SheetLayout::size`], sRGB-encoded. Panics if a picture is not
/// of the layout's size, or there are more than it has places for.
#[must_use]
pub fn sheet(layout: &SheetLayout, panels: &[SheetPanel<'_>]) -> Vec<f32> {
    assert!(panels.len() <= (layout.columns * layout.rows) as usize, "{} pictures", panels.len());
    let size = layout.size();
    let mut rgb: Vec<f32> = GAP_COLOR.iter().copied().cycle().take(size.pixels() * 3).collect();
    for (index, panel) in (0..).zip(panels) {
        layout.panel.expect("a picture of a sheet", panel.rgb, 3);
        let (left, top) = layout.corner(index);
        for (y, row) in panel.rgb.chunks_exact(layout.panel.width as usize * 3).enumerate() {
            let start = ((top as usize + y) * size.width as usize + left as usize) * 3;
            rgb[start..start + row.len()].copy_from_slice(row);
        }
        label(&mut rgb, size, left, top, layout.panel, panel.label);
    }
    rgb
}

/// Draws a label into the lower left corner of the picture at `left` and `top`, px; letters that do
/// not fit are left out.
fn label(rgb: &mut [f32], sheet: PictureSize, left: u32, top: u32, panel: PictureSize, text: &str) {
    let letters = LETTER_HEIGHTS.iter().find(|(least, _)| panel.height >= *least);
    let height = letters.map_or(RasterHeight::Size16, |(_, height)| *height);
    let (high, wide) = (height.val() as u32, get_raster_width(FontWeight::Regular, height) as u32);
    let (beside, above) = (high / 2, high / 8);
    let room = panel.width.saturating_sub(2 * beside) / wide;
    if text.is_empty() || room == 0 || panel.height < high + 2 * above {
        return;
    }
    let text: Vec<char> = text.chars().take(room as usize).collect();
    let strip = (text.len() as u32 * wide + 2 * beside, high + 2 * above);
    let strip_top = top + panel.height - strip.1;
    let mut blend = |x: u32, y: u32, color: [f32; 3], alpha: f32| {
        let at = (y as usize * sheet.width as usize + x as usize) * 3;
        for (value, ink) in rgb[at..at + 3].iter_mut().zip(color) {
            *value += (ink - *value) * alpha;
        }
    };
    for y in strip_top..strip_top + strip.1 {
        for x in left..left + strip.0 {
            blend(x, y, STRIP_COLOR, STRIP_ALPHA);
        }
    }
    for (index, letter) in (0..).zip(text) {
        let raster = [letter, '?'].into_iter().find_map(|c| get_raster(c, FontWeight::Regular, height));
        let Some(raster) = raster else { continue };
        for (y, row) in (strip_top + above..).zip(raster.rows()) {
            for (x, cover) in (left + beside + index * wide..).zip(row) {
                blend(x, y, LETTER_COLOR, f32::from(*cover) / 255.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four grey pictures with these labels.
    fn draw(panel: PictureSize, labels: [&str; 4]) -> (SheetLayout, Vec<f32>) {
        let greys = [0.2f32, 0.4, 0.6, 0.8].map(|grey| vec![grey; panel.pixels() * 3]);
        let layout = SheetLayout::new(panel, 4, 2);
        let panels = [0, 1, 2, 3].map(|k| SheetPanel { rgb: &greys[k], label: labels[k] });
        (layout, sheet(&layout, &panels))
    }

    fn pixel(layout: &SheetLayout, rgb: &[f32], x: u32, y: u32) -> [f32; 3] {
        let at = (y * layout.size().width + x) as usize * 3;
        [rgb[at], rgb[at + 1], rgb[at + 2]]
    }

    #[test]
    fn pictures_lie_in_a_grid_with_thin_gaps() {
        let layout = SheetLayout::new(PictureSize::new(600, 400), 4, 2);
        assert_eq!(layout.size(), PictureSize::new(1203, 803));
        assert_eq!([0, 1, 2, 3].map(|k| layout.corner(k)), [(0, 0), (603, 0), (0, 403), (603, 403)]);
        assert_eq!(SheetLayout::new(PictureSize::new(600, 400), 3, 2).size(), PictureSize::new(1203, 803));
        assert_eq!(SheetLayout::new(PictureSize::new(6, 4), 1, 1).size(), PictureSize::new(6, 4));
    }

    #[test]
    fn colours_are_kept_outside_the_strips() {
        let (layout, rgb) = draw(PictureSize::new(200, 120), ["clear"; 4]);
        assert_eq!(rgb.len(), layout.size().pixels() * 3);
        for (index, grey) in (0..).zip([0.2, 0.4, 0.6, 0.8]) {
            let (left, top) = layout.corner(index);
            for (x, y) in [(0, 0), (199, 0), (100, 60), (199, 119), (0, 99)] {
                assert_eq!(pixel(&layout, &rgb, left + x, top + y), [grey; 3], "{index} {x} {y}");
            }
        }
        assert_eq!(pixel(&layout, &rgb, 200, 10), GAP_COLOR);
    }

    #[test]
    fn labels_are_light_letters_on_a_dark_strip() {
        let (layout, rgb) = draw(PictureSize::new(300, 120), ["fog, MOR 150 m", "", "haze", "smog"]);
        for (index, grey) in [(0, 0.2f32), (2, 0.6), (3, 0.8)] {
            let (left, top) = layout.corner(index);
            let strip: Vec<f32> = (101..120)
                .flat_map(|y| (8..40).map(move |x| (x, y)))
                .map(|(x, y)| pixel(&layout, &rgb, left + x, top + y)[0])
                .collect();
            let brightest = strip.iter().copied().fold(0.0, f32::max);
            let darkest = strip.iter().copied().fold(1.0, f32::min);
            assert!(brightest > 0.9, "{index}: {brightest}");
            assert!(
                (darkest - (grey + (STRIP_COLOR[0] - grey) * STRIP_ALPHA)).abs() < 1e-6,
                "{index}: {darkest}"
            );
        }
    }

    #[test]
    fn labels_stay_within_their_picture() {
        let long = "a label that is far too long for so small a picture, whatever its letters";
        let (layout, rgb) = draw(PictureSize::new(90, 40), [long, "é 霧", "", "x"]);
        let right = layout.corner(1).0;
        assert!((0..40).all(|y| pixel(&layout, &rgb, right - 1, y) == GAP_COLOR));
        assert!((0..20).all(|y| pixel(&layout, &rgb, right + 60, y) == [0.4; 3]));
        // Too small for any letter.
        let (_, rgb) = draw(PictureSize::new(12, 10), [long; 4]);
        assert_eq!(rgb[..36], [0.2; 36]);
    }
}
