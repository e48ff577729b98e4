//! Echoes of the air: fog, haze and smog.
//!
//! Each half of a pulse's length of the beam is a bin that sends back as a surface of the
//! reflectance `pi beta c tau / 2` would, with the backscatter `beta`. The light of many droplets
//! interferes: a bin's power varies as a Gamma variate of four degrees about its mean. Bins begin
//! at a random distance for each pulse, since the waveform has none.

use crate::echo::{Echo, EchoClass, MIN_ECHO_POWER};
use crate::model::LidarModel;
use wm_base::random::RandomStream;
use wm_weather::InfraredAir;

/// Degrees of freedom of the speckle.
const SPECKLE_DEGREES: u64 = 4;
/// Largest speckle gain that is considered when faint bins are skipped: one in 10^4 exceeds it.
const MAX_SPECKLE: f64 = 4.0;
/// Numbers a pulse: four a bin.
const NUMBERS_PER_PULSE: u64 = 1 << 16;

/// The path of a pulse through the air.
pub(crate) struct AirPath<'a> {
    /// World axes, scene units.
    pub(crate) origin: [f64; 3],
    /// Unit direction, world axes.
    pub(crate) direction: [f64; 3],
    pub(crate) metres_per_unit: f64,
    /// Ranges at which its rays end, m.
    pub(crate) ends: &'a [f64],
}

impl AirPath<'_> {
    /// The share of the rays that go beyond a range, m.
    pub(crate) fn share_beyond(&self, range: f64) -> f64 {
        self.ends.iter().filter(|end| **end > range).count() as f64 / self.ends.len() as f64
    }
}

/// Adds the echoes of the air along a pulse.
pub(crate) fn add_echoes(
    path: &AirPath<'_>,
    air: &InfraredAir,
    model: &LidarModel,
    random: &RandomStream,
    pulse: u64,
    echoes: &mut Vec<Echo>,
) {
    if air.is_dark() {
        return;
    }
    let bin = model.bin();
    let at = |range: f64| -> [f64; 3] {
        let units = range / path.metres_per_unit;
        std::array::from_fn(|k| path.origin[k] + units * path.direction[k])
    };
    let farthest = path.ends.iter().copied().fold(0.0, f64::max).min(model.range[1]);
    // The air thins steadily upwards, so that one end of the way is the densest.
    let densest = bin * air.reflectance_at(at(0.0)).max(air.reflectance_at(at(farthest)));
    let first = pulse * NUMBERS_PER_PULSE;
    let phase = random.uniform(first);
    for index in 0..(NUMBERS_PER_PULSE / SPECKLE_DEGREES - 1) {
        let range = bin * (index as f64 + phase);
        if range >= farthest {
            break;
        }
        let overlap = model.overlap_at(range);
        if overlap <= 0.0 {
            continue;
        }
        let kept = air.transmittance(path.origin, path.direction, range / path.metres_per_unit);
        let received = kept * kept / (range * range);
        if MAX_SPECKLE * densest * received < MIN_ECHO_POWER * model.least_power() {
            break;
        }
        let power = path.share_beyond(range) * bin * air.reflectance_at(at(range)) * overlap * received;
        if MAX_SPECKLE * power < MIN_ECHO_POWER * model.least_power() {
            continue;
        }
        let number = first + SPECKLE_DEGREES * (index + 1);
        let product: f64 = (0..SPECKLE_DEGREES).map(|k| 1.0 - random.uniform(number + k)).product();
        let speckle = -product.max(f64::MIN_POSITIVE).ln() / SPECKLE_DEGREES as f64;
        echoes.push(Echo { range, power: power * speckle, class: EchoClass::Air, label: 0 });
    }
}
