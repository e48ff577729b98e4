//! Pictures made smaller by exact area averages.
//!
//! Each new pixel is the mean of the old ones under it, those at its border by the share that is
//! covered. Averages are of display-referred values (sRGB as stored), not of light: that is what
//! the reduced photos of the usual data sets and everyone's comparisons are made with.

/// A picture of `N` channels, row by row, resized from `from` to `to` (width, height).
///
/// Only meant to make pictures smaller; a larger one repeats pixels.
///
/// # Panics
/// If the picture is not of the size `from`, or a side of either is 0.
pub(super) fn resize<const N: usize>(pixels: &[u8], from: (u32, u32), to: (u32, u32)) -> Vec<u8> {
    let (width, height) = (from.0 as usize, from.1 as usize);
    assert_eq!(pixels.len(), width * height * N, "a picture of the size that is said");
    if from == to {
        return pixels.to_vec();
    }
    let columns = Spans::of(from.0, to.0);
    let rows = Spans::of(from.1, to.1);
    let new_width = to.0 as usize * N;
    let mut out = Vec::with_capacity(new_width * to.1 as usize);
    // The row that is summed up, and one old row made narrower: f32 holds sums of this many bytes
    // to far less than half a step.
    let (mut sum, mut narrow) = (vec![0f32; new_width], vec![0f32; new_width]);
    let mut narrowed = None;
    for span in &rows.spans {
        sum.fill(0.0);
        for (offset, weight) in rows.weights(span).enumerate() {
            let row = span.first + offset;
            // A row that two new ones share is made narrower once.
            if narrowed != Some(row) {
                narrow_row::<N>(&pixels[row * width * N..(row + 1) * width * N], &columns, &mut narrow);
                narrowed = Some(row);
            }
            for (sum, value) in sum.iter_mut().zip(&narrow) {
                *sum += weight * value;
            }
        }
        out.extend(sum.iter().map(|v| (v + 0.5) as u8));
    }
    out
}

fn narrow_row<const N: usize>(row: &[u8], columns: &Spans, out: &mut [f32]) {
    let (pixels, _) = row.as_chunks::<N>();
    let (out, _) = out.as_chunks_mut::<N>();
    for (span, out) in columns.spans.iter().zip(out) {
        let mut sum = [0f32; N];
        let covered = &pixels[span.first..span.first + span.count];
        if let [first, middle @ .., last] = covered {
            // Whole pixels in integers: exact, and most of the work.
            let mut whole = [0u32; N];
            for pixel in middle {
                for (whole, value) in whole.iter_mut().zip(pixel) {
                    *whole += u32::from(*value);
                }
            }
            for lane in 0..N {
                sum[lane] = span.first_weight * f32::from(first[lane])
                    + columns.weight * whole[lane] as f32
                    + span.last_weight * f32::from(last[lane]);
            }
        } else if let [only] = covered {
            sum = only.map(f32::from);
        }
        *out = sum;
    }
}

/// The old pixels that lie under a new one.
#[derive(Debug)]
struct Span {
    first: usize,
    count: usize,
    /// Shares of the first and the last of them; 1 in sum if there is one alone.
    first_weight: f32,
    last_weight: f32,
}

#[derive(Debug)]
struct Spans {
    spans: Vec<Span>,
    /// Share of an old pixel that is wholly under a new one.
    weight: f32,
}

impl Spans {
    fn of(from: u32, to: u32) -> Self {
        assert!(from > 0 && to > 0, "a side of {from} or {to} px");
        let (from_wide, to_wide) = (u64::from(from), u64::from(to));
        let span = |index: u64| {
            // In units of 1 / to of an old pixel, all borders are whole numbers.
            let (low, high) = (index * from_wide, (index + 1) * from_wide);
            let (first, last) = (low / to_wide, (high - 1) / to_wide);
            let share = |covered: u64| covered as f32 / from_wide as f32;
            Span {
                first: first as usize,
                count: (last - first + 1) as usize,
                first_weight: share((first + 1) * to_wide - low),
                last_weight: share(high - last * to_wide),
            }
        };
        Self { spans: (0..to_wide).map(span).collect(), weight: to as f32 / from as f32 }
    }

    fn weights(&self, span: &Span) -> impl Iterator<Item = f32> {
        let (first, last, inner, count) = (span.first_weight, span.last_weight, self.weight, span.count);
        (0..count).map(move |offset| match offset {
            _ if count == 1 => 1.0,
            0 => first,
            _ if offset + 1 == count => last,
            _ => inner,
        })
    }
}

/// A picture of `N` channels with sides divided by `2^level`, blocks of whole pixels averaged; what
/// is left over at the right and the bottom is cut off, so that pixels keep their borders.
pub(super) fn reduce<const N: usize>(pixels: &[u8], size: (u32, u32), level: u8) -> Vec<u8> {
    let (width, block) = (size.0 as usize, 1usize << level);
    let (new_width, new_height) = (width >> level, size.1 as usize >> level);
    let (pixels, _) = pixels.as_chunks::<N>();
    let half = 1u32 << (2 * u32::from(level)) >> 1;
    let mut out = Vec::with_capacity(new_width * new_height * N);
    let mut sums = vec![[0u32; N]; new_width];
    for rows in pixels.chunks_exact(width * block).take(new_height) {
        sums.fill([0; N]);
        for row in rows.chunks_exact(width) {
            for (sum, pixels) in sums.iter_mut().zip(row.chunks_exact(block)) {
                for pixel in pixels {
                    for (sum, value) in sum.iter_mut().zip(pixel) {
                        *sum += u32::from(*value);
                    }
                }
            }
        }
        out.extend(sums.iter().flatten().map(|sum| ((sum + half) >> (2 * u32::from(level))) as u8));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The definition, pixel by pixel, in f64.
    fn reference(pixels: &[u8], from: (u32, u32), to: (u32, u32)) -> Vec<f64> {
        let overlap = |index: u32, old: u32, from: u32, to: u32| {
            let scale = f64::from(from) / f64::from(to);
            let (low, high) = (f64::from(index) * scale, f64::from(index + 1) * scale);
            (high.min(f64::from(old + 1)) - low.max(f64::from(old))).max(0.0) / scale
        };
        let mut out = Vec::new();
        for y in 0..to.1 {
            for x in 0..to.0 {
                let mut sum = 0.0;
                for (index, value) in pixels.iter().enumerate() {
                    let (old_x, old_y) = (index as u32 % from.0, index as u32 / from.0);
                    let weight = overlap(x, old_x, from.0, to.0) * overlap(y, old_y, from.1, to.1);
                    sum += weight * f64::from(*value);
                }
                out.push(sum);
            }
        }
        out
    }

    proptest! {
        #[test]
        fn it_is_the_area_average(
            (width, height) in (1..23u32, 1..17u32),
            (new_width, new_height) in (1..23u32, 1..17u32),
            bytes in prop::collection::vec(any::<u8>(), 23 * 17),
        ) {
            let (from, to) = ((width, height), (new_width.min(width), new_height.min(height)));
            let pixels = &bytes[..(width * height) as usize];
            let found = resize::<1>(pixels, from, to);
            for (found, expected) in found.iter().zip(reference(pixels, from, to)) {
                // Half a step of rounding.
                prop_assert!((f64::from(*found) - expected).abs() <= 0.5 + 1e-3, "{found} {expected}");
            }
            let rgb: Vec<u8> = pixels.iter().flat_map(|v| [*v, 255 - v, 7]).collect();
            let colored = resize::<3>(&rgb, from, to);
            for (rgb, grey) in colored.chunks(3).zip(&found) {
                prop_assert!(rgb[0] == *grey && rgb[2] == 7);
            }
        }

        #[test]
        fn levels_are_blocks(width in 1..40u32, height in 1..30u32, level in 0..3u8, bytes in prop::collection::vec(any::<u8>(), 1200)) {
            let pixels = &bytes[..(width * height) as usize];
            let found = reduce::<1>(pixels, (width, height), level);
            let (new_width, new_height) = (width >> level, height >> level);
            prop_assert_eq!(found.len() as u32, new_width * new_height);
            let kept: Vec<u8> = (0..new_height << level)
                .flat_map(|y| (0..new_width << level).map(move |x| (x, y)))
                .map(|(x, y)| pixels[(y * width + x) as usize])
                .collect();
            if !found.is_empty() {
                let expected = resize::<1>(&kept, (new_width << level, new_height << level), (new_width, new_height));
                prop_assert!(found.iter().zip(&expected).all(|(a, b)| a.abs_diff(*b) <= 1));
            }
        }
    }

    #[test]
    fn whole_factors_are_exact() {
        assert_eq!(resize::<1>(&[0, 1, 2, 3, 4, 5, 6, 7], (4, 2), (2, 1)), [3, 5]);
        assert_eq!(resize::<1>(&[10, 20, 30], (3, 1), (2, 1)), [13, 27]);
    }
}
