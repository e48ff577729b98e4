//! Pictures freed of the exposure of their photo: the affine change of colour that brings them
//! nearest to it.

use glam::{DMat4, DVec4};

/// Pulls towards no change, as a share of the pixels: a picture of one colour has many best
/// changes.
const RIDGE_WEIGHT: f64 = 1e-6;

/// `rgb`, `[H, W, 3]`, changed by the matrix and offset, one for all pixels, that bring it nearest
/// to `photo` in least squares; with a mask, `[H, W]`, over the pixels that count. Not clamped.
///
/// # Panics
/// If the sizes differ.
pub(crate) fn fit_exposure(rgb: &[f32], photo: &[f32], mask: Option<&[f32]>) -> Vec<f32> {
    assert_eq!(rgb.len(), photo.len(), "two pictures of one size");
    let color = |p: &[f32]| DVec4::new(p[0].into(), p[1].into(), p[2].into(), 1.0);
    let (mut normal, mut right, mut total) = (DMat4::ZERO, [DVec4::ZERO; 3], 0.0);
    for (index, (from, to)) in rgb.chunks_exact(3).zip(photo.chunks_exact(3)).enumerate() {
        let weight = mask.map_or(1.0, |mask| f64::from(mask[index]));
        let from = color(from);
        let outer = DMat4::from_cols(from * from.x, from * from.y, from * from.z, from * from.w);
        normal += outer * weight;
        for (right, to) in right.iter_mut().zip(to) {
            *right += from * f64::from(*to) * weight;
        }
        total += weight;
    }
    let pull = RIDGE_WEIGHT * total.max(1.0);
    normal += DMat4::IDENTITY * pull;
    for (right, axis) in right.iter_mut().zip([DVec4::X, DVec4::Y, DVec4::Z]) {
        *right += axis * pull;
    }
    let inverse = normal.inverse();
    let rows = right.map(|right| inverse * right);
    rgb.chunks_exact(3).flat_map(|from| rows.map(|row| row.dot(color(from)) as f32)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_exposure_is_found() {
        let photo: Vec<f32> = (0..300).map(|i| ((i * 37) % 101) as f32 / 101.0).collect();
        let darker: Vec<f32> =
            photo.chunks_exact(3).flat_map(|p| [0.5 * p[0], 0.7 * p[1] + 0.1, p[2] - 0.1]).collect();
        let fitted = fit_exposure(&darker, &photo, None);
        assert!(fitted.iter().zip(&photo).all(|(a, b)| (a - b).abs() < 1e-3));
    }

    #[test]
    fn one_colour_has_a_change_too() {
        let mask: Vec<f32> = [1.0, 0.0].repeat(5);
        let fitted = fit_exposure(&[0.25; 30], &[0.5, 0.5, 0.5, 9.0, 9.0, 9.0].repeat(5), Some(&mask));
        assert!(fitted.iter().all(|v| (v - 0.5).abs() < 1e-3), "{fitted:?}");
        let unseen = fit_exposure(&[0.25; 3], &[0.5; 3], Some(&[0.0]));
        assert!(unseen.iter().all(|v| (v - 0.25).abs() < 1e-6), "{unseen:?}");
    }
}
