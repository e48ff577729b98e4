//! Adaptive resolution of frames while the view is moving: the largest that keeps the frame rate.

/// Least frame rate while the view is moving, frames a second.
const MIN_RATE_HZ: f64 = 15.0;
/// Share of the time of a frame to aim at; the rest is a margin for variation.
const AIMED_SHARE: f64 = 0.75;
/// Least share of the full width and height.
const MIN_SCALE: f64 = 0.16;
/// Limits of the factor by which one frame changes the scale.
const SCALE_STEP_LIMITS: (f64, f64) = (0.6, 1.12);
/// Widths are multiples of this, px, so that the size does not change with every frame.
const WIDTH_STEP_PX: f64 = 16.0;

/// Scale of a client's frames while the view is moving.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// Share of the full width and height.
    scale: f64,
}

impl Default for Pace {
    fn default() -> Self {
        Self { scale: 0.5 }
    }
}

impl Pace {
    /// The size of the next frame for a `full` size, px.
    pub fn size(&self, full: [u32; 2]) -> (u32, u32) {
        if self.scale == 1.0 {
            return full.into();
        }
        let [width, height] = full.map(f64::from);
        let shown = ((width * self.scale / WIDTH_STEP_PX).round() * WIDTH_STEP_PX)
            .clamp(WIDTH_STEP_PX.min(width), width);
        (shown as u32, (height * shown / width).round().max(1.0) as u32)
    }

    /// Adapts the scale to a frame that took `seconds` to render while `sharing` clients take
    /// turns, and to the `on_its_way` seconds from sending the last one to its acknowledgement.
    ///
    /// Most of the time is proportional to the number of pixels, so that the scale changes with the
    /// square root of the time.
    pub fn learn(&mut self, seconds: f64, sharing: usize, on_its_way: f64) {
        let took = (seconds * sharing.max(1) as f64).max(on_its_way);
        let factor = (AIMED_SHARE / MIN_RATE_HZ / took.max(1e-4)).sqrt();
        // Close to the aim the scale stays.
        if !(0.9..1.1).contains(&factor) {
            self.scale =
                (self.scale * factor.clamp(SCALE_STEP_LIMITS.0, SCALE_STEP_LIMITS.1)).clamp(MIN_SCALE, 1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the final scale and time of a frame for a renderer that takes `splats` seconds plus
    /// `pixels` at full size.
    fn settled(splats: f64, pixels: f64, sharing: usize) -> (f64, f64) {
        let mut pace = Pace::default();
        let time = |pace: Pace| splats + pixels * pace.scale * pace.scale;
        for _ in 0..100 {
            pace.learn(time(pace), sharing, 0.0);
        }
        (pace.scale, time(pace) * sharing as f64)
    }

    #[test]
    fn the_frame_rate_is_kept() {
        for (splats, pixels) in [(0.0, 0.001), (0.01, 0.1), (0.03, 0.4), (0.005, 3.0)] {
            for sharing in [1, 2] {
                let (scale, time) = settled(splats, pixels, sharing);
                let is_least = scale <= MIN_SCALE;
                assert!(time < 1.0 / MIN_RATE_HZ || is_least, "{splats} {pixels} {sharing}: {scale} {time}");
                assert!(
                    time > 0.5 / MIN_RATE_HZ || scale == 1.0 || is_least,
                    "{splats} {pixels}: {scale} {time}"
                );
            }
        }
    }

    #[test]
    fn a_slow_line_makes_pictures_smaller() {
        let mut pace = Pace::default();
        for _ in 0..50 {
            pace.learn(0.001, 1, 0.4);
        }
        assert_eq!(pace.scale, MIN_SCALE);
    }

    #[test]
    fn sizes_keep_their_aspect_ratio() {
        for scale in [0.16, 0.3, 0.5, 0.77, 1.0] {
            let (width, height) = Pace { scale }.size([1200, 800]);
            assert!(width.is_multiple_of(16) && (f64::from(width) / f64::from(height) - 1.5).abs() < 0.01);
        }
        assert_eq!(Pace { scale: 1.0 }.size([1201, 801]), (1201, 801));
        assert_eq!(Pace { scale: 0.16 }.size([3, 2]), (3, 2));
    }
}
