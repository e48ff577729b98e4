//! Rain gauge and disdrometer: how much water falls, in drops of which sizes and speeds.
//!
//! Both look through slabs of air ([`super::drops`]). Water through a level plane is the sum over drops of volume times fall
//! speed, over the air that was looked at. Of flakes the volume is that of their water, by the density of Fabry and Szyrmer.
//!
//! Tolerance 5 %. Chance: a few large drops carry the water, so that `n` drops of a Marshall-Palmer spectrum tell it like 0.022
//! times as many equal ones; pictures are taken until that is 2,500, 2 %. Drops that touch in the picture are one: below 1 %.
//! The slab's thickness makes 5 % of a diameter uncertain at most, without a bias above 0.5 % of the sum. Speeds: Brandes'
//! formula, which the program goes by, is within 4 % of the measurements.

use super::drops::{Catch, Drop, Slab, catch, effect, main_kind};
use super::{Finding, Instrument, Probe, Reading, Rig, Tolerance, asked, mean, median};
use crate::report::plot::{Axis, Plot, Series};
use anyhow::Result;
use wm_weather::particles::Kind;

/// The instrument.
pub const INSTRUMENT: Instrument = Instrument {
    name: "gauge",
    title: "Rain gauge and disdrometer",
    about: "A probe camera looks through slabs of air of known volume, 10 m away, with a shutter of 10 us. What a drop hides is its \
            area and so its diameter and its water; where it is a moment later is its speed. Gauge: the sum of water times speed over the \
            volume of air; of snow with the water that a flake of its width holds. Disdrometer: by how much drops above 0.7 mm are wider than that in the mean, \
            against the spectrum of Marshall and Palmer; and in classes of a quarter of a millimetre speed over what Gunn and Kinzer measured, \
            of which the class that is farthest off counts.",
    applies: |weather, time| main_kind(weather, time).is_some(),
    read,
    sweep: SWEEP,
};

const SWEEP: &[&[&str]] = &[
    &["rain.rate=1"],
    &["rain.rate=2.5"],
    &["rain.rate=10"],
    &["rain.rate=25"],
    &["rain.rate=50"],
    &["rain.rate=10", "wind.speed=6"],
    &["snowfall.rate=0.5"],
    &["snowfall.rate=1"],
    &["snowfall.rate=2"],
    &["snowfall.rate=3"],
    &["snowfall.rate=5"],
];

/// Equal drops that tell the rate as well as all that are looked at.
const ENOUGH: f64 = 2500.0;
/// Share of the drops of a spectrum that are as many equal ones: `Gamma(4.67)^2 / (Gamma(8.34))` of the volume flux `D^3.67`.
const WEIGHT: f64 = 0.022;
/// Drops in front of a square metre of board, so that few touch.
const CROWD: f64 = 500.0;
/// How opaque flakes are drawn.
const THIN: f64 = 0.1;
/// Width from which flakes are told one by one, mm: fewer stand for all that are smaller in a picture.
const SINGLE: f64 = 2.5;
/// Most and fewest pictures.
const PICTURES: [f64; 2] = [18.0, 120.0];

/// Drops at a rate, mm/h, a m^3, by the published spectrum.
fn density(kind: Kind, rate: f64) -> f64 {
    let most = match kind {
        Kind::Rain => 8000.0,
        Kind::Snow => 2500.0 * rate.powf(-0.94),
    };
    most / asked::slope(kind, rate)
}

/// Looks at as much air as it takes.
fn look(rig: &mut dyn Rig, probe: &Probe<'_>, kind: Kind, rate: f64) -> Result<Catch> {
    let all = density(kind, rate);
    // Of rain those below 0.5 mm are no drops of the program's.
    let there = if kind == Kind::Rain { all * (-0.5 * asked::slope(kind, rate)).exp() } else { all };
    let thickness = (CROWD / there).clamp(0.1, 1.0);
    let wind = asked::number(probe.weather, probe.time, "wind", "speed").unwrap_or(0.0);
    let slab = match kind {
        Kind::Rain => Slab {
            size: 960,
            depth: 10.0,
            thickness,
            // Drops of 0.5 mm are just drawn whole: 0.3 px and some.
            scale: 750.0,
            margin: [12.0 + 2.0 * wind, 30.0],
            apart: 0.002,
            fastest: 12.0,
            pairs: 3,
        },
        Kind::Snow => Slab {
            size: 960,
            depth: 10.0,
            thickness: 0.6 * thickness,
            scale: 600.0,
            margin: [24.0 + 8.0 * wind, 40.0],
            apart: 0.01,
            fastest: 3.0,
            pairs: 3,
        },
    };
    let side = f64::from(slab.size) / slab.scale;
    let pictures = ENOUGH / (WEIGHT * all * 0.9 * side * side * slab.thickness);
    let pictures = pictures.clamp(PICTURES[0], PICTURES[1]).round() as usize;
    let set = |param: &str, value: &str| format!("{}.{param}={value}", effect(kind));
    // The arms of flakes hide each other, unless they hide little.
    let opacity = if kind == Kind::Snow { THIN } else { 1.0 };
    let changes = [set("exposure", "0.00001"), set("size", "1"), set("opacity", &opacity.to_string())];
    let changes = changes.each_ref().map(String::as_str);
    catch(rig, probe, kind, (&slab, pictures, &changes, opacity))
}

/// Fall speed by diameter, as published.
fn speed(kind: Kind, diameter: f64) -> f64 {
    match kind {
        Kind::Rain => asked::gunn_kinzer(diameter),
        Kind::Snow => asked::flake_speed(diameter),
    }
}

fn read(rig: &mut dyn Rig, probe: &Probe<'_>) -> Result<Finding> {
    let mut finding = Finding::default();
    for kind in [Kind::Rain, Kind::Snow] {
        let rate = asked::number(probe.weather, probe.time, effect(kind), "rate").unwrap_or(0.0);
        if rate <= 0.0 {
            continue;
        }
        let mut caught = look(rig, probe, kind, rate)?;
        let reading = |quantity: &str, unit, asked, measured| Reading {
            quantity: quantity.to_owned(),
            setting: probe.setting.to_owned(),
            unit,
            asked,
            measured,
            tolerance: Tolerance::Relative(0.05),
        };
        let name = if kind == Kind::Rain { "rain rate" } else { "snow rate" };
        finding.readings.push(reading(name, "mm/h", rate, flux(kind, &caught)));
        let speeds = classes(kind, &caught);
        let farthest =
            speeds.iter().map(|class| class[2]).max_by(|a, b| (a - 1.0).abs().total_cmp(&(b - 1.0).abs()));
        let law = if kind == Kind::Rain { "Gunn-Kinzer's" } else { "0.8 D^0.16" };
        let quantity = format!("fall speed over {law}, farthest of {} sizes", speeds.len());
        if kind == Kind::Rain {
            let above = caught.drops.iter().map(|drop| drop.diameter).filter(|d| *d > LEAST);
            // Of an exponential spectrum the same beyond any diameter.
            let wanted = 1.0 / asked::slope(kind, rate);
            let beyond = mean(above.map(|d| d - LEAST));
            finding.readings.push(reading("mean diameter beyond 0.7 mm", "mm", wanted, beyond));
            finding.plots.push(sizes(probe, rate, &caught));
        }
        finding.readings.push(reading(&quantity, "", 1.0, farthest.unwrap_or(f64::NAN)));
        finding.plots.push(speeds_plot(probe, kind, &speeds));
        if let Some(mut shown) = caught.shown.take() {
            let (count, volume) = (caught.drops.len(), caught.volume);
            shown.caption = format!(
                "{}: a part of one of the slabs; {count} caught in {volume:.0} m\u{b3} of air",
                probe.setting
            );
            finding.pictures.push(shown);
        }
    }
    Ok(finding)
}

/// Water through a level plane, mm/h.
fn flux(kind: Kind, Catch { drops, volume, .. }: &Catch) -> f64 {
    let (mut tracked, mut water, mut flux) = (0.0, 0.0, 0.0);
    for drop in drops {
        let own = asked::water(kind, drop.diameter);
        water += own;
        if let Some([_, down]) = drop.velocity {
            tracked += own;
            flux += own * down;
        }
    }
    // Those of which there is no second picture fall like the others. mm^3 a m^2 and second are 3.6e-3 mm/h.
    3.6e-3 * flux / volume * water / tracked
}

/// Drops that sizes are told from, mm, and the width of a class of speeds.
const LEAST: f64 = 0.7;
const CLASS: f64 = 0.25;
/// Drops that make a class.
const MEMBERS: usize = 40;
/// Farther than this from the median of its class a speed is that of two drops taken for one, as a share.
const STRAY: f64 = 0.4;

/// Classes of diameter that have enough members: mean diameter, mm, mean speed, m/s, and that over the mean by the law.
fn classes(kind: Kind, caught: &Catch) -> Vec<[f64; 3]> {
    let mut classes: Vec<Vec<[f64; 2]>> = vec![Vec::new(); 48];
    for Drop { diameter, velocity, .. } in &caught.drops {
        let class = ((diameter - if kind == Kind::Snow { SINGLE } else { 0.5 }) / CLASS).floor();
        if let (Some([_, down]), 0.0..48.0) = (velocity, class) {
            classes[class as usize].push([*diameter, *down]);
        }
    }
    for class in &mut classes {
        let middle = median(class.iter().map(|p| p[1]).collect());
        class.retain(|p| (p[1] / middle - 1.0).abs() < STRAY);
    }
    let full = classes.iter().filter(|class| class.len() >= MEMBERS);
    let means = full.map(|class| {
        let of = |value: &dyn Fn(&[f64; 2]) -> f64| mean(class.iter().map(value));
        [of(&|p| p[0]), of(&|p| p[1]), of(&|p| p[1]) / of(&|p| speed(kind, p[0]))]
    });
    means.collect()
}

fn law(f: impl Fn(f64) -> f64) -> Vec<[f64; 2]> {
    (5..=60).map(|k| f64::from(k) * 0.1).map(|d| [d, f(d)]).collect()
}

fn speeds_plot(probe: &Probe<'_>, kind: Kind, classes: &[[f64; 3]]) -> Plot {
    let name = if kind == Kind::Rain { "Gunn and Kinzer 1949" } else { "aggregates, 0.8 D^0.16" };
    Plot {
        title: format!("Fall speed, {}", probe.setting),
        x: Axis::linear("diameter, mm"),
        y: Axis::linear("fall speed, m/s"),
        series: vec![
            Series::line(name, law(|d| speed(kind, d))),
            Series::points(
                "measured, means of classes",
                classes.iter().map(|class| [class[0], class[1]]).collect(),
            ),
        ],
    }
}

fn sizes(probe: &Probe<'_>, rate: f64, caught: &Catch) -> Plot {
    let slope = asked::slope(Kind::Rain, rate);
    let mut counts = [0usize; 24];
    for drop in &caught.drops {
        counts[(((drop.diameter - 0.5) / CLASS).floor().max(0.0) as usize).min(23)] += 1;
    }
    let full = counts.iter().enumerate().filter(|(_, count)| **count > 3);
    let numbers = full.map(|(k, n)| [0.5 + CLASS * (k as f64 + 0.5), *n as f64 / caught.volume / CLASS]);
    let spectrum = law(|d| 8000.0 * (-slope * d).exp()).into_iter().filter(|p| p[1] > 0.05);
    Plot {
        title: format!("Sizes, {}", probe.setting),
        x: Axis::linear("diameter, mm"),
        y: Axis::log("drops a m\u{b3} and mm"),
        series: vec![
            Series::line("Marshall and Palmer 1948", spectrum.collect()),
            Series::points("measured", numbers.collect()),
        ],
    }
}
