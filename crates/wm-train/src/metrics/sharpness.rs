//! Sharpness of a picture beside its photo.

/// Returns the mean length of the gradients of the picture `x` over that of the photo `y`, both
/// `[H, W, 3]` of `width` px: below 1 where the picture is smoother. Gradients are differences of
/// luma (Rec. 601) to the next pixel in the row and in the column. With a mask, `[H, W]`, over the
/// pixels that count together with both of these neighbours. `None` if the photo is even.
///
/// # Panics
/// If the sizes differ.
pub(crate) fn sharpness(x: &[f32], y: &[f32], mask: Option<&[f32]>, width: usize) -> Option<f64> {
    assert_eq!(x.len(), y.len(), "two pictures of one size");
    let [ours, theirs] = [x, y].map(|picture| mean_gradient(picture, mask, width));
    (theirs > 0.0).then(|| ours / theirs)
}

fn mean_gradient(rgb: &[f32], mask: Option<&[f32]>, width: usize) -> f64 {
    let luma: Vec<f64> = rgb
        .as_chunks::<3>()
        .0
        .iter()
        .map(|[r, g, b]| 0.299 * f64::from(*r) + 0.587 * f64::from(*g) + 0.114 * f64::from(*b))
        .collect();
    let (mut sum, mut count) = (0.0, 0.0);
    for at in 0..luma.len().saturating_sub(width) {
        if at % width + 1 == width {
            continue;
        }
        let factor = mask.map_or(1.0, |mask| f64::from(mask[at].min(mask[at + 1]).min(mask[at + width])));
        sum += factor * (luma[at + 1] - luma[at]).hypot(luma[at + width] - luma[at]);
        count += factor;
    }
    if count > 0.0 { sum / count } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ramp of `step` from column to column, 4x3 px, with an edge in the last column of the first
    /// row.
    fn ramp(step: f32) -> Vec<f32> {
        (0..12).flat_map(|at| [if at == 3 { 9.0 } else { step * (at % 4) as f32 }; 3]).collect()
    }

    #[test]
    fn half_the_gradients_are_half_as_sharp() {
        let mask: Vec<f32> = (0..12).map(|at| if at == 3 { 0.0 } else { 1.0 }).collect();
        let half = sharpness(&ramp(0.1), &ramp(0.2), Some(&mask), 4).unwrap();
        assert!((half - 0.5).abs() < 1e-6, "{half}");
        assert!(sharpness(&ramp(0.1), &ramp(0.2), None, 4).unwrap() > 0.9);
        assert_eq!(sharpness(&ramp(0.1), &[0.5; 36], None, 4), None);
    }
}
