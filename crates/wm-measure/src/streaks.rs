//! Streaks: as long as the way in the exposure, and along it.
//!
//! Two pictures of a slab of air, a moment apart. Drops are drawn more opaque than they are, like
//! marked ones, so that a streak shows as far as it goes and does not end where it covers less than
//! 1/256. Its length is that of a line with its second moment; how fast the drop goes the two
//! pictures say. How far it reaches down is held against published speeds for the drop's diameter,
//! too, since both pictures and streaks could be wrong together.
//!
//! Tolerance: 5 % of the length and of the wind, 1.5 degrees of the angle. What lies below 1/256 is
//! added to a streak's second moment, 2 to 5 % of a length, right within a fifth of that; a slab of
//! a tenth of the depth makes single lengths 5 % uncertain and medians 0.1 %.

use super::blobs::BlobSplit;
use super::drops::{AirSlab, DropSample, MeasuredDrop, SlabView, main_kind};
use super::{Bench, Instrument, Tolerance, expected, median};
use wm_place::Result;
use wm_weather::Weather;
use wm_weather::particles::RAIN;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "streaks",
    title: "Streak geometry",
    about: "A slab of air, as for the gauge, at the exposure that is asked for, drops marked to show as far as they go. Two pictures a \
            moment apart say how fast each goes; its streak must be as long as that speed times the exposure, as high as a drop of its size falls in it by Gunn and \
            Kinzer, and lie along its way. How fast they go sideways is the wind.",
    applies: |weather, time| main_kind(weather, time) == Some(&RAIN),
    measure,
    sweep: &[
        "rain.rate=2.5, rain.exposure=0.002",
        "rain.rate=2.5, rain.exposure=0.004, wind.speed=2",
        "rain.rate=2.5, rain.exposure=0.008, wind.speed=5",
        "rain.rate=2.5, rain.exposure=0.0125, wind.speed=10",
        "rain.rate=2.5, rain.exposure=0.0166, wind.speed=15",
    ],
};

/// Streaks shorter than this many pixels say little of their length.
const MIN_STREAK_PX: f64 = 6.0;
/// Pictures, each with a second one.
const PICTURE_PAIRS: usize = 16;

/// Drops in front of a square metre of board.
const DROPS_PER_M2: f64 = 260.0;
/// Drops a m^3 at 1 mm/h, and how they grow with its power: of Marshall and Palmer those of 0.5 mm
/// and more.
const DROP_DENSITY_LAW: [f64; 2] = [250.0, 0.54];

/// Looks at streaks as long as they are, of marked drops.
pub(crate) fn look(weather: &Weather, time: f64) -> Result<SlabView> {
    let number = |effect: &str, param: &str| expected::number(weather, time, effect, param);
    let exposure = exposure(weather, time);
    let wind = number("wind", "speed").unwrap_or(0.0);
    let rate = number("rain", "rate").unwrap_or(0.0);
    let apart = exposure.clamp(0.001, 0.006);
    // The longest streaks are some 250 px.
    let scale = (250.0 / (9.0f64.hypot(wind) * exposure)).min(1000.0);
    let aside = scale * (1.3 * wind * apart + 0.5 * wind * exposure) + 24.0;
    let slab = AirSlab {
        size: 1200,
        depth: 10.0,
        thickness: (DROPS_PER_M2 / (DROP_DENSITY_LAW[0] * rate.powf(DROP_DENSITY_LAW[1]))).clamp(0.05, 0.6),
        scale,
        margin: [aside, 12.0 * scale * apart + 130.0],
        apart,
        fastest: 12.0,
        pairs: 1,
        split: BlobSplit::Touching,
    };
    // So opaque that a common drop has an optical depth of about 1 in its middle.
    let pixels = (5.5f64.hypot(wind) * exposure * scale).max(1.0);
    let wide = (0.14 * (1e-3 * scale).powi(2) + 0.3f64).sqrt();
    let long = (wide * wide + pixels * pixels / 12.0).sqrt();
    let opacity = std::f64::consts::TAU * wide * long / (1.8 * (1e-3 * scale).powi(2));
    SlabView::new(weather, time, &RAIN, slab, opacity.min(100.0))
}

fn exposure(weather: &Weather, time: f64) -> f64 {
    expected::number(weather, time, "rain", "exposure").unwrap_or(1.0 / 60.0)
}

/// Drops whose streaks are long enough to say something.
pub(crate) fn long(caught: &DropSample) -> impl Iterator<Item = &MeasuredDrop> {
    caught.drops.iter().filter(|drop| drop.blob.length > MIN_STREAK_PX)
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let (exposure, look) = (exposure(bench.weather, bench.time), look(bench.weather, bench.time)?);
    let (scale, wind) = (look.slab.scale, look.across);
    let mut caught = DropSample::default();
    look.take(bench, PICTURE_PAIRS, &mut caught)?;
    let (mut lengths, mut laws, mut angles, mut drifts) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for drop in long(&caught) {
        let Some([across, down]) = drop.velocity else { continue };
        let fall = drop.blob.length * drop.blob.angle.cos();
        laws.push(fall / (expected::gunn_kinzer(drop.diameter) * exposure * scale));
        lengths.push(drop.blob.length / (across.hypot(down) * exposure * scale));
        angles.push((drop.blob.angle - f64::atan2(across, down)).to_degrees());
        drifts.push(across);
    }
    let count = lengths.len();
    let five = Tolerance::Relative(0.05);
    bench.add(
        format!("length over speed times exposure, median of {count}"),
        "",
        [1.0, median(lengths)],
        five,
    );
    bench.add("its fall over Gunn-Kinzer's speed times exposure, median", "", [1.0, median(laws)], five);
    bench.add("angle off the drops' way, median", "deg", [0.0, median(angles)], Tolerance::Absolute(1.5));
    let tolerance = if wind > 0.0 { five } else { Tolerance::Absolute(0.05) };
    bench.add("drift with the wind, median", "m/s", [wind, median(drifts)], tolerance);
    if let Some(mut shown) = caught.shown {
        shown.caption = format!("a part of one of the slabs, drops marked, {:.1} ms", 1e3 * exposure);
        bench.show_picture(shown);
    }
    Ok(())
}
