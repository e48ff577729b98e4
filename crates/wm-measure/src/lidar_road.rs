//! A road before a lidar, dry and wet: how far away it is seen, and how much a film of water takes.
//!
//! A level road of 20 % lies ahead. Dry it sends back `rho cos(theta) / r^2`; a film of water
//! mirrors a share `R` of the beam away on its way in and of the light on its way out, so that it
//! is `(1 - R)^2 / (n^2 (1 - 0.475 rho))` times as bright, by Fresnel at the beam's own angle. At 6
//! and 12 m, where every pulse comes back, the mean intensity of the wet road over that of the dry
//! one is that factor. The share of the pulses that come back, summed over the range, is how far
//! the road is seen; the lidar equation gives the same sum.
//!
//! Tolerances: 4 % of the factor (the beam's angle is that of the row, and a splat's place on the
//! road errs by centimetres) and 3 % of the range.

use super::lidar::{EYE_HEIGHT_M, OVERLAP_RANGES_M, RECEIVER_NOISE, model, normal, signal, sweep};
use super::plot::Series;
use super::{Bench, Instrument, Tolerance, changed, expected, mean};
use wm_place::Result;
use wm_place::lidar::{EchoClass, LidarSweep};
use wm_weather::Weather;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "lidar-road",
    title: "A wet road before a lidar",
    about: "A level road of 20 % ahead of a lidar, dry and under a film of water: the ratio of their intensities at 6 and 12 m against Fresnel's \
            equations at the beam's angle, and how far away each is seen against the lidar equation.",
    applies: |weather, _| expected::is_on(weather, "wetness"),
    measure,
    sweep: &["wetness.amount=1"],
};

/// Reflectance of the road, and the linear grey that has it: `0.05 + 0.8 grey`.
const ROAD_REFLECTANCE: f64 = 0.2;
/// The nearest and the farthest point of the road, half its width, and the spacing of splats, m.
const ROAD_ENDS_M: [f64; 2] = [4.0, 70.0];
const ROAD_HALF_WIDTH_M: f64 = 2.5;
const SPLAT_SPACING_M: f64 = 0.2;
/// Ranges between which pulses are counted, m, and rows between them.
const COUNTED_RANGE_M: [f64; 2] = [5.0, 65.0];
const ROWS: u32 = 600;
/// Pulses in a row, within so many degrees to each side.
const COLUMNS: u32 = 40;
const HALF_ANGLE_DEGREES: f64 = 1.5;
/// Ranges at which intensities are compared, m, within this share.
const COMPARED_RANGES_M: [f64; 2] = [6.0, 12.0];
const RANGE_TOLERANCE: f64 = 0.05;
/// Rows of a point of the plot.
const ROWS_PER_POINT: usize = 10;
/// The share of diffuse light in water that its surface throws back.
const INTERNAL_REFLECTANCE: f64 = 0.475;

/// The brightness of the road under a film over that of the dry one, for a beam whose cosine to the
/// vertical is `cosine`.
fn film_factor(cosine: f64) -> f64 {
    let through = 1.0 - expected::water_reflectance(cosine.acos());
    through * through
        / (expected::WATER_INDEX * expected::WATER_INDEX * (1.0 - INTERNAL_REFLECTANCE * ROAD_REFLECTANCE))
}

/// The range at which a beam of an elevation below the horizon, radians, meets the road, m.
fn range_at(elevation: f64) -> f64 {
    EYE_HEIGHT_M / (-elevation).sin()
}

/// The share of pulses of each row that came back from the road, with its range; the nearest first.
fn shares(seen: &LidarSweep) -> Vec<[f64; 2]> {
    let [near, far] = COUNTED_RANGE_M.map(|range| -(EYE_HEIGHT_M / range).asin());
    let mut counts = vec![0.0; ROWS as usize];
    for point in seen.points.iter().filter(|point| point.class == EchoClass::Surface) {
        // Row 0 is the highest.
        counts[(ROWS - 1) as usize - usize::from(point.ring)] += 1.0 / f64::from(COLUMNS);
    }
    let elevation = |row: usize| near + (far - near) * row as f64 / f64::from(ROWS - 1);
    counts.into_iter().enumerate().map(|(row, share)| [range_at(elevation(row)), share]).collect()
}

/// The first range and the shares summed over those beyond it.
fn seen_up_to(shares: &[[f64; 2]]) -> f64 {
    let step = |pair: &[[f64; 2]]| 0.5 * (pair[0][1] + pair[1][1]) * (pair[1][0] - pair[0][0]);
    shares[0][0] + shares.windows(2).map(step).sum::<f64>()
}

/// The mean intensity of the points of the road about a range, m.
fn intensity_at(seen: &LidarSweep, range: f64) -> f64 {
    let is_near = |elevation: f32| (range_at(f64::from(elevation)) / range - 1.0).abs() < RANGE_TOLERANCE;
    let points = seen.points.iter().filter(|point| point.class == EchoClass::Surface);
    mean(points.filter(|point| is_near(point.angles[1])).map(|point| f64::from(point.intensity)))
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let wet = changed(&bench.alone("wetness")?, "wetness.porosity=1, wetness.puddles=0, wetness.amount=1")?;
    let halves = [[ROAD_HALF_WIDTH_M, 0.0, 0.0], [0.0, 0.5 * (ROAD_ENDS_M[1] - ROAD_ENDS_M[0]), 0.0]];
    let middle = [0.0, 0.5 * (ROAD_ENDS_M[0] + ROAD_ENDS_M[1]), 0.0];
    let subject = bench.card(middle, halves, SPLAT_SPACING_M, (ROAD_REFLECTANCE - 0.05) / 0.8)?;
    let [near, far] = COUNTED_RANGE_M.map(|range| -(EYE_HEIGHT_M / range).asin().to_degrees());
    let lidar =
        model(OVERLAP_RANGES_M, COLUMNS, [HALF_ANGLE_DEGREES, -HALF_ANGLE_DEGREES], ROWS, [near, far])?;
    let mut series = Vec::new();
    let mut sweeps = Vec::new();
    for (name, weather, is_wet) in [("dry", &Weather::clear(), false), ("wet", &wet, true)] {
        let seen = sweep(bench, subject, &lidar, weather)?;
        let counted = shares(&seen);
        let law = |[range, _]: &[f64; 2]| {
            let cosine = EYE_HEIGHT_M / range;
            let factor = if is_wet { film_factor(cosine) } else { 1.0 };
            [*range, normal((signal(ROAD_REFLECTANCE * factor * cosine, 0.0, *range) - 1.0) / RECEIVER_NOISE)]
        };
        let expected: Vec<[f64; 2]> = counted.iter().map(law).collect();
        let values = [seen_up_to(&expected), seen_up_to(&counted)];
        bench.add(format!("range of a {name} road"), "m", values, Tolerance::Relative(0.03));
        let grouped = |rows: &[[f64; 2]]| [0, 1].map(|k| mean(rows.iter().map(|row| row[k])));
        series.push(Series::line(format!("{name}, by the lidar equation"), expected));
        series.push(Series::points(name, counted.chunks(ROWS_PER_POINT).map(grouped).collect()));
        sweeps.push(seen);
    }
    for range in COMPARED_RANGES_M {
        let [dry, wet] = [0, 1].map(|at| intensity_at(&sweeps[at], range));
        let values = [film_factor(EYE_HEIGHT_M / range), wet / dry];
        let quantity = format!("wet road over dry, {range} m away");
        bench.add(quantity, "", values, Tolerance::Relative(0.04));
    }
    bench.plot("A road before a lidar", "range, m", "share of pulses that come back", series);
    Ok(())
}
