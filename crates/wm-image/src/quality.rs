//! Compares pictures: the peak signal-to-noise ratio.

/// `-10 log10` of the mean squared difference, dB, for values 0-1 that are clamped to that range
/// first; infinite for equal pictures. With a mask, `[H, W]`, over the pixels that count.
///
/// # Panics
/// If the sizes differ.
#[must_use]
pub fn psnr(x: &[f32], y: &[f32], mask: Option<&[f32]>) -> f64 {
    assert_eq!(x.len(), y.len(), "two pictures of one size");
    let (mut sum, mut count) = (0.0, 0.0);
    for (i, (x, y)) in x.iter().zip(y).enumerate() {
        let factor = mask.map_or(1.0, |mask| f64::from(mask[i / 3]));
        sum += factor * f64::from(x.clamp(0.0, 1.0) - y.clamp(0.0, 1.0)).powi(2);
        count += factor;
    }
    -10.0 * (sum / count.max(1.0)).log10()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tenth_off_is_twenty_decibels() {
        assert!((psnr(&[0.5; 12], &[0.6; 12], None) - 20.0).abs() < 1e-5);
        assert_eq!(psnr(&[0.5; 3], &[0.5; 3], None), f64::INFINITY);
        assert!(
            (psnr(&[0.5, 0.5, 0.5, 0.0, 0.0, 0.0], &[0.6, 0.6, 0.6, 1.0, 1.0, 1.0], Some(&[1.0, 0.0]))
                - 20.0)
                .abs()
                < 1e-5
        );
    }
}
