//! Flashes of lightning.
//!
//! A flash is 2 to 5 strokes, 40 to 60 ms apart, at one place. A stroke sends out some 10^6 J of
//! light, which makes 5 lx s on level ground at 1 km and falls with the square of the distance; the
//! cloud around it spreads it over some milliseconds. When and where they strike is drawn from the
//! seed for each slot of time, so that any instant can be asked for alone. A frame gets the mean
//! over its exposure.

use glam::Vec3;
use wm_base::random::uniform;

/// Luminous exposure of level ground by one stroke at 1 km, lx s.
const STROKE_EXPOSURE_LX_S: f64 = 5.0;
/// Time over which a stroke's light falls to 1/e.
const STROKE_DECAY_S: f64 = 0.004;
/// Strokes of a flash, and the time between them, s.
const STROKE_COUNTS: [u64; 2] = [2, 5];
const STROKE_INTERVALS_S: [f64; 2] = [0.04, 0.06];
/// Height from which most of the light comes.
const FLASH_HEIGHT_M: f64 = 2_000.0;
/// Nearest to farthest flash for a mean distance, as factors on it.
const DISTANCE_FACTORS: [f64; 2] = [0.5, 1.5];
/// The share of the light that comes from about the flash; the rest is spread over the clouds.
const DIRECT_SHARE: f32 = 0.4;
/// Tint of a flash, luminance 1: some 9,000 K.
const FLASH_TINT: [f64; 3] = [0.9, 1.0, 1.29];
/// Length of the slots of time, of which each has one flash or none: as long as a flash at most.
const SLOT_LENGTH_S: f64 = 0.5;

/// The light of lightning at one instant, averaged over an exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flash {
    /// Illuminance of level ground in the open, lx.
    lux: f64,
    /// Towards it: azimuth in radians and sine of the elevation, along level axes.
    pub(crate) azimuth: f64,
    /// Sine of its elevation.
    pub(crate) sin: f64,
}

/// A storm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Storm {
    /// Flashes a minute, in the mean.
    pub(crate) rate: f64,
    /// Mean distance, m.
    pub(crate) distance: f64,
    /// The seed.
    pub(crate) seed: u64,
}

impl Storm {
    /// The flash that lights most of the exposure from `time` on, s, if there is any; `shutter` is
    /// the time of exposure, s.
    pub(crate) fn flash(&self, time: f64, shutter: f64) -> Option<Flash> {
        let mut strongest: Option<Flash> = None;
        let mut lux = 0.0;
        // One that began a slot before may still strike.
        let first = (time / SLOT_LENGTH_S).floor() as i64 - 1;
        let last = ((time + shutter) / SLOT_LENGTH_S).floor() as i64;
        for slot in first..=last {
            let draw =
                |k: u64| uniform(self.seed ^ 0x1167_3717, (slot as u64).wrapping_mul(64).wrapping_add(k));
            // At most one per slot: the chance of it is the rate.
            if draw(0) >= (self.rate / 60.0 * SLOT_LENGTH_S).min(1.0) {
                continue;
            }
            let mut strike = (slot as f64 + 0.5 * draw(1)) * SLOT_LENGTH_S;
            let share = DISTANCE_FACTORS[0] + (DISTANCE_FACTORS[1] - DISTANCE_FACTORS[0]) * draw(2);
            let distance = share * self.distance;
            let slant = distance.hypot(FLASH_HEIGHT_M);
            let strokes =
                STROKE_COUNTS[0] + (draw(3) * (STROKE_COUNTS[1] - STROKE_COUNTS[0] + 1) as f64) as u64;
            let mut exposure = 0.0;
            for stroke in 0..strokes {
                // The first is the strongest.
                let strength = if stroke == 0 { 1.0 } else { 0.4 + 0.5 * draw(8 + 2 * stroke) };
                exposure += strength * lit_during(strike, time, time + shutter);
                strike += STROKE_INTERVALS_S[0]
                    + (STROKE_INTERVALS_S[1] - STROKE_INTERVALS_S[0]) * draw(9 + 2 * stroke);
            }
            let own = STROKE_EXPOSURE_LX_S * 1e6 / (slant * slant) * exposure / shutter;
            if own <= 0.0 {
                continue;
            }
            lux += own;
            if strongest.is_none_or(|known| own > known.lux) {
                let azimuth = std::f64::consts::TAU * draw(4);
                strongest = Some(Flash { lux: own, azimuth, sin: FLASH_HEIGHT_M / slant });
            }
        }
        strongest.map(|flash| Flash { lux, ..flash })
    }
}

/// The share of the light of a stroke at `strike` that falls between two instants, s.
fn lit_during(strike: f64, from: f64, to: f64) -> f64 {
    let left = |time: f64| if time <= strike { 1.0 } else { (-(time - strike) / STROKE_DECAY_S).exp() };
    left(from) - left(to)
}

/// A flash over one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FlashLight {
    /// Towards it, world axes, length 1.
    pub(crate) direction: Vec3,
    /// Irradiance of level ground in the open, linear RGB, in the unit of the scene's light.
    pub(crate) level: Vec3,
    /// World axes, length 1.
    pub(crate) up: Vec3,
}

impl FlashLight {
    /// Builds the light of a flash; a lux is `display`, and the axes are two level ones and up.
    pub(crate) fn new(flash: &Flash, display: f64, axes: &[[f64; 3]; 3]) -> Self {
        let level = (1.0 - flash.sin * flash.sin).sqrt();
        let (sin, cos) = flash.azimuth.sin_cos();
        let direction = crate::level::from_level(axes, [level * cos, level * sin, flash.sin]);
        Self {
            direction: Vec3::from_array(direction.map(|v| v as f32)),
            level: Vec3::from_array(FLASH_TINT.map(|v| (v * flash.lux * display) as f32)),
            up: Vec3::from_array(axes[2].map(|v| v as f32)),
        }
    }

    /// Irradiance of a surface that sees a share `open` of its sky. A normal of zero is that of
    /// leaves.
    #[inline]
    pub(crate) fn irradiance(&self, normal: Vec3, open: f32) -> Vec3 {
        let (facing, upright) = match normal == Vec3::ZERO {
            true => (0.5, 0.0),
            false => (normal.dot(self.direction).max(0.0), normal.dot(self.up)),
        };
        let beam = facing / self.direction.dot(self.up).max(0.2);
        let spread = 0.5 * (1.0 + upright);
        self.level * (open * (DIRECT_SHARE * beam + (1.0 - DIRECT_SHARE) * spread))
    }

    /// The radiance that it adds to the sky in a direction (world axes, length 1), times pi, linear
    /// RGB.
    pub(crate) fn sky(&self, direction: [f64; 3]) -> [f64; 3] {
        let direction = Vec3::from_array(direction.map(|v| v as f32));
        if direction.dot(self.up) < -0.3 {
            return [0.0; 3];
        }
        // A lobe about it, whose cosine-weighted sum over the sky is about 1, and an even glow.
        let lobe = 3.5 * direction.dot(self.direction).max(0.0).powi(6);
        (self.level * (DIRECT_SHARE * lobe + (1.0 - DIRECT_SHARE))).to_array().map(f64::from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STORM: Storm = Storm { rate: 12.0, distance: 2_000.0, seed: 4 };

    /// The light of all frames is the same at any rate of frames, as long as each is exposed until
    /// the next.
    #[test]
    fn the_light_of_a_minute_is_the_same_in_all_frames() {
        let sum = |rate: f64| {
            let frames = (60.0 * rate) as u32;
            let at = |frame: u32| {
                STORM.flash(f64::from(frame) / rate, 1.0 / rate).map_or(0.0, |flash| flash.lux / rate)
            };
            (0..frames).map(at).sum::<f64>()
        };
        let (film, fast) = (sum(24.0), sum(60.0));
        assert!((film / fast - 1.0).abs() < 0.01 && film > 1.0, "{film} {fast}");
    }

    #[test]
    fn flashes_come_at_their_rate_and_go_dark_between() {
        let storm = Storm { rate: 20.0, ..STORM };
        let mut flashes = 0;
        let mut was_dark = 0;
        for step in 0..60_000 {
            let is_lit = storm.flash(f64::from(step) * 0.01, 0.01).is_some_and(|flash| flash.lux > 1.0);
            if is_lit && was_dark > 15 {
                flashes += 1;
            }
            was_dark = if is_lit { 0 } else { was_dark + 1 };
        }
        // 200 in 10 minutes, some of them in two neighbouring slots.
        assert!((150..230).contains(&flashes), "{flashes}");
    }
}
