//! Sundial: the shadow of a rod on level ground, and how wide its edge is.
//!
//! A rod 2 m high stands on a board and faces the sun. Seen from above, the end of its shadow is
//! where the light is half of that beside it, and its axis is the line through the middles of what
//! is dark. Its length must be the height of the rod, which is measured in a picture from the side,
//! times the cotangent of the sun's elevation, and its axis must point away from the sun. Elevation
//! and azimuth are those that are given, or those of an hour and a day at a latitude by the
//! formulas of the Astronomical Almanac and spherical trigonometry; refraction is left out, since
//! it is below 0.1 degree above 8 degrees.
//!
//! The sun is 0.0093 rad wide, so the edge of a shadow is 0.0093 d wide at the distance `d` from
//! what casts it. The edge of a wall, as high as the sun is, is measured on the ground at 30 to 50
//! m: nearer ones are narrower than the maps of shadows and the splats of a scene resolve. A round
//! sun of even light goes from a tenth to nine tenths of its light in 0.687 of its width.
//!
//! Tolerance: 2 % of the length, 1 degree, 15 % of the width.

use super::lit::{GROUND_REFLECTANCE, LightPicture, OPEN_SKY, overcast_card, paint_card};
use super::plot::Series;
use super::{Bench, Instrument, LevelFrame, ShotSubject, Tolerance, expected, mean};
use std::f64::consts::{PI, TAU};
use wm_place::Result;
use wm_scene::{Camera, Splats};
use wm_weather::Weather;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "sundial",
    title: "Sundial",
    about: "A rod of 2 m on a board: how long its shadow is and where it points, seen from above, against the sun's elevation and azimuth, \
            given or by day, hour and latitude. And how wide the edge of a wall's shadow is at 30 to 50 m, against 0.0093 rad.",
    applies: |weather, time| sun(weather, time).is_some(),
    measure,
    sweep: &[
        "light.model=clear, light.sun_elevation=30, light.sun_azimuth=210",
        "light.model=clear, light.sun_elevation=55, light.sun_azimuth=100",
        "light.model=clear, light.latitude=52, light.day=80, light.hour=10",
        "light.model=clear, light.latitude=52, light.day=172, light.hour=15",
        "light.model=clear, light.latitude=-34, light.day=355, light.hour=8.5",
    ],
};

/// Sun that throws shadows of a useful length, degrees.
const SUN_ELEVATIONS_DEGREES: [f64; 2] = [15.0, 65.0];

/// Elevation and azimuth of a weather's sun, degrees, if numbers say it.
fn sun(weather: &Weather, time: f64) -> Option<[f64; 2]> {
    let number = |param: &str| expected::number(weather, time, "light", param);
    let is_clear = expected::says(weather, time, "light", "model", "clear");
    let has_beam = number("clouds").is_none_or(|clouds| clouds < 0.8);
    if !is_clear || !has_beam {
        return None;
    }
    let of_hour = match (number("latitude"), number("day"), number("hour")) {
        (Some(latitude), Some(day), Some(hour)) => Some(by_hour(latitude, day, hour)),
        (_, _, Some(_)) => None,
        _ => Some([45.0, 180.0]),
    };
    let elevation = number("sun_elevation").or(of_hour.map(|sun| sun[0]))?;
    let azimuth = number("sun_azimuth").or(of_hour.map(|sun| sun[1]))?;
    (SUN_ELEVATIONS_DEGREES[0]..=SUN_ELEVATIONS_DEGREES[1])
        .contains(&elevation)
        .then_some([elevation, azimuth])
}

/// Elevation and azimuth of the sun, degrees, at a latitude, in mean solar time of a day of
/// [`YEAR_START_DAYS`]: by the formulas of low precision of the Astronomical Almanac, within 0.01
/// degree.
fn by_hour(latitude: f64, day: f64, hour: f64) -> [f64; 2] {
    let days = YEAR_START_DAYS + day - 1.0 + hour / 24.0;
    let mean_longitude = 280.460 + 0.985_647_4 * days;
    let anomaly = (357.528 + 0.985_600_3 * days).to_radians();
    let longitude = (mean_longitude + 1.915 * anomaly.sin() + 0.020 * (2.0 * anomaly).sin()).to_radians();
    let obliquity = (23.439 - 4e-7 * days).to_radians();
    let declination = (obliquity.sin() * longitude.sin()).asin();
    let ascension = (obliquity.cos() * longitude.sin()).atan2(longitude.cos());
    // How far a sundial is ahead of a clock, and the hour angle.
    let ahead = (mean_longitude.to_radians() - ascension + PI).rem_euclid(TAU) - PI;
    let angle = TAU * (hour - 12.0) / 24.0 + ahead;
    let latitude = latitude.to_radians();
    let (east, north) = (
        -declination.cos() * angle.sin(),
        declination.sin() * latitude.cos() - declination.cos() * latitude.sin() * angle.cos(),
    );
    let up = declination.sin() * latitude.sin() + declination.cos() * latitude.cos() * angle.cos();
    [up.asin().to_degrees(), east.atan2(north).to_degrees().rem_euclid(360.0)]
}

/// Days from noon of 1 January 2000 to the beginning of 2026, the year of places that were captured
/// nobody knows when.
const YEAR_START_DAYS: f64 = 9_496.5;
/// Height and half the width of the rod, m, and distance of splats on it and on the board.
const ROD_HEIGHT_M: f64 = 2.0;
const ROD_HALF_WIDTH_M: f64 = 0.15;
const SPLAT_SPACING_M: f64 = 0.04;
/// Distances from a wall's edge, along the light, at which the edge of its shadow is measured, m,
/// and half its width.
const EDGE_DISTANCES_M: [f64; 3] = [30.0, 40.0, 50.0];
const WALL_HALF_WIDTH_M: f64 = 6.0;
/// Half the sides of the board on which it is measured, along and across the shadow, m.
const STRIP_HALF_SIDES_M: [f64; 2] = [1.0, 0.9];
/// Angular diameter of the sun.
const SUN_DIAMETER_RAD: f64 = 0.0093;
/// The share of a round source's width in which its light goes from a tenth to nine tenths.
const TENTH_WIDTH_SHARE: f64 = 0.687;
const EXPOSURE: &str = "light.exposure=-1";

/// A sun, its weather, and level coordinates along and across its shadows.
struct Dial {
    /// Elevation of the sun, radians.
    elevation: f64,
    weather: Weather,
    level: LevelFrame,
    /// Away from the sun, and a quarter turn to the left of it.
    away: [f64; 2],
    aside: [f64; 2],
}

impl Dial {
    fn at(&self, along: f64, across: f64, height: f64) -> [f64; 3] {
        [along * self.away[0] + across * self.aside[0], along * self.away[1] + across * self.aside[1], height]
    }

    /// Along and across of the point of the ground that a pixel shows.
    fn on_ground(&self, camera: &Camera, x: f64, y: f64) -> [f64; 2] {
        let up = self.level.axes[2];
        let (eye, ray) = (camera.center(), camera.ray(x, y));
        let ground = self.level.point([0.0; 3]);
        let point = eye + ray * ((ground - eye).dot(up) / ray.dot(up)) - ground;
        let [x, y] = [0, 1].map(|k: usize| self.level.metres(point.dot(self.level.axes[k])));
        [x * self.away[0] + y * self.away[1], x * self.aside[0] + y * self.aside[1]]
    }

    /// A card that stands across the shadow at the origin.
    fn stand(&self, half: f64, high: f64, grain: f64, splats: &mut Splats) {
        let across = [half * self.aside[0], half * self.aside[1], 0.0];
        let halves = [across, [0.0, 0.0, 0.5 * high]];
        paint_card(
            &self.level,
            [0.0, 0.0, 0.5 * high],
            halves,
            grain,
            overcast_card(GROUND_REFLECTANCE, 1.0),
            splats,
        );
    }

    /// A level card.
    fn lie(&self, along: f64, halves: [f64; 2], splats: &mut Splats) {
        let side = |axis: [f64; 2], half: f64| [axis[0] * half, axis[1] * half, 0.0];
        paint_card(
            &self.level,
            self.at(along, 0.0, 0.0),
            [side(self.away, halves[0]), side(self.aside, halves[1])],
            SPLAT_SPACING_M,
            overcast_card(GROUND_REFLECTANCE, 0.0),
            splats,
        );
    }
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let Some([elevation, azimuth]) = sun(bench.weather, bench.time) else { return Ok(()) };
    let weather = bench.with_light(&format!("{OPEN_SKY}, {EXPOSURE}"))?;
    let level = bench.level;
    // Azimuths turn clockwise seen from above, from the first axis; the second axis is to its right
    // or left.
    let turn = azimuth.to_radians();
    let sun = [turn.cos(), -level.hand() * turn.sin()];
    let away = sun.map(|v| -v);
    let elevation = elevation.to_radians();
    let dial = Dial { level, away, aside: [-away[1], away[0]], elevation, weather };
    rod(bench, &dial)?;
    edge(bench, &dial)
}

/// Measures the shadow of the rod.
fn rod(bench: &mut Bench<'_>, dial: &Dial) -> Result<()> {
    let reach = ROD_HEIGHT_M / dial.elevation.tan();
    let mut splats = Splats::default();
    dial.lie(0.0, [reach + 1.2, 1.5], &mut splats);
    dial.stand(ROD_HALF_WIDTH_M, ROD_HEIGHT_M, SPLAT_SPACING_M, &mut splats);
    let subject = bench.set_up_lit(splats)?;
    // From the side, where it covers half of a pixel row.
    let side = dial.level.camera(
        (64, 256),
        20.0,
        dial.at(-6.0, 0.0, ROD_HEIGHT_M),
        dial.at(0.0, 0.0, ROD_HEIGHT_M),
    )?;
    let picture = bench.light(subject, &side, &dial.weather)?;
    let column: Vec<f64> = (0..picture.size.1)
        .map(|y| mean((29..35).map(|x| f64::from(picture.alpha[y * picture.size.0 + x]))))
        .collect();
    let height = crossing(&column, 0.5).map(|y| ROD_HEIGHT_M + (side.cy - y - 0.5) / side.fy * 6.0);
    let height = height.unwrap_or(f64::NAN);
    // From above.
    let high = (reach + 2.0).max(4.0);
    let above = dial.level.camera(
        (320, 320),
        60.0,
        dial.at(0.5 * reach, 0.0, high),
        dial.at(0.5 * reach, 0.0, 0.0),
    )?;
    let picture = bench.light(subject, &above, &dial.weather)?;
    let seen = shadow(dial, &above, &picture, reach);
    let length = seen.map_or(f64::NAN, |seen| seen.length);
    let turn = seen.map_or(f64::NAN, |seen| seen.turn.to_degrees());
    let law = height / dial.elevation.tan();
    let two = Tolerance::Relative(0.02);
    bench.add(format!("shadow of a rod of {height:.3} m"), "m", [law, length], two);
    bench.add("azimuth of the shadow, off the sun's", "deg", [0.0, turn], Tolerance::Absolute(1.0));
    bench.show(format!("the rod from above, its shadow {length:.2} m long"), &picture.picture);
    Ok(())
}

/// The shadow of the rod.
#[derive(Clone, Copy)]
struct RodShadow {
    /// m, from the foot of the rod.
    length: f64,
    /// Radians off the way that it is asked to point, to the left.
    turn: f64,
}

/// Width of the bins that light is averaged in, m.
const BIN_WIDTH_M: f64 = 0.02;

/// Sums of light and their counts, by where it is.
struct Bins(Vec<[f64; 2]>);

impl Bins {
    fn of(metres: f64) -> Self {
        Self(vec![[0.0; 2]; (metres / BIN_WIDTH_M) as usize])
    }

    fn add(&mut self, at: f64, light: f64) {
        let bin = at / BIN_WIDTH_M;
        if let Some(sum) = self.0.get_mut(bin as usize).filter(|_| bin >= 0.0) {
            *sum = [sum[0] + light, sum[1] + 1.0];
        }
    }

    /// The middles of the bins, from `start` on, with their mean light.
    fn profile(&self, start: f64) -> Vec<[f64; 2]> {
        let middles = (0..self.0.len()).map(|bin| (bin as f64 + 0.5) * BIN_WIDTH_M - start);
        let bins = middles.zip(&self.0).filter(|(_, sum)| sum[1] > 0.0);
        bins.map(|(middle, sum)| [middle, sum[0] / sum[1]]).collect()
    }
}

/// Finds the shadow in a picture from above.
fn shadow(dial: &Dial, camera: &Camera, picture: &LightPicture, reach: f64) -> Option<RodShadow> {
    // Sums along the shadow: of light in its middle, of light beside it; and of what is dark, by
    // where it is across.
    let mut lines = Bins::of(1.4 * reach);
    let mut moments = [0.0f64; 2];
    let mut pixels = Vec::new();
    let (mut beside, mut count) = (0.0, 0.0);
    for y in 0..picture.size.1 {
        for x in 0..picture.size.0 {
            let [along, across] = dial.on_ground(camera, x as f64 + 0.5, y as f64 + 0.5);
            let light = picture.light(x, y);
            pixels.push((along, across, light));
            if (0.3 * reach..1.1 * reach).contains(&along) && (0.8..1.2).contains(&across.abs()) {
                (beside, count) = (beside + light, count + 1.0);
            }
            if across.abs() < 0.08 {
                lines.add(along, light);
            }
        }
    }
    let lit = beside / count;
    for (along, across, light) in pixels {
        if (0.35 * reach..0.8 * reach).contains(&along) && across.abs() < 0.5 {
            // The core of the shadow: the rod takes some of the sky's light all around, too.
            let dark = (0.7 - light / lit).max(0.0);
            moments = [moments[0] + dark * across / along, moments[1] + dark];
        }
    }
    let line = lines.profile(0.0);
    let within = |from: f64, to: f64| {
        mean(line.iter().filter(|p| (from * reach..to * reach).contains(&p[0])).map(|p| p[1]))
    };
    let half = 0.5 * (within(0.5, 0.75) + within(1.2, 1.35));
    let before =
        line.windows(2).rfind(|pair| pair[0][0] > 0.5 * reach && pair[0][1] < half && pair[1][1] >= half)?;
    let share = (half - before[0][1]) / (before[1][1] - before[0][1]);
    let length = before[0][0] + share * (before[1][0] - before[0][0]);
    Some(RodShadow { length, turn: moments[0] / moments[1] })
}

/// The place at which a series of values first rises through one, in steps, with the middle of the
/// first at 0.
fn crossing(values: &[f64], level: f64) -> Option<f64> {
    let at = values.windows(2).position(|pair| pair[0] < level && pair[1] >= level)?;
    Some(at as f64 + (level - values[at]) / (values[at + 1] - values[at]))
}

/// Measures the edge of the shadow of a wall.
fn edge(bench: &mut Bench<'_>, dial: &Dial) -> Result<()> {
    let (sin, cos) = dial.elevation.sin_cos();
    let mut splats = Splats::default();
    let high = EDGE_DISTANCES_M[2] * sin + 4.0;
    // To the right of the way of the shadow, with its edge upon it.
    let across = [WALL_HALF_WIDTH_M * dial.aside[0], WALL_HALF_WIDTH_M * dial.aside[1], 0.0];
    let middle = dial.at(0.0, -WALL_HALF_WIDTH_M, 0.5 * high);
    paint_card(
        &dial.level,
        middle,
        [across, [0.0, 0.0, 0.5 * high]],
        0.1,
        overcast_card(GROUND_REFLECTANCE, 1.0),
        &mut splats,
    );
    for metres in EDGE_DISTANCES_M {
        dial.lie(metres * cos, STRIP_HALF_SIDES_M, &mut splats);
    }
    let subject = bench.set_up_lit(splats)?;
    let mut series = Vec::new();
    for metres in EDGE_DISTANCES_M {
        let (width, profile) = edge_at(bench, dial, subject, metres, metres * cos)?;
        bench.add(
            format!("width of a shadow's edge at {metres} m"),
            "m",
            [SUN_DIAMETER_RAD * metres, width],
            Tolerance::Relative(0.15),
        );
        series.push(Series::line(format!("{metres} m"), profile));
    }
    bench.plot("Edge of a wall's shadow", "place across the edge, m", "light, of the lit side", series);
    Ok(())
}

/// Width of the edge at a distance, m, on the ground `along` the shadow, with the light across it.
fn edge_at(
    bench: &mut Bench<'_>,
    dial: &Dial,
    subject: ShotSubject,
    metres: f64,
    along: f64,
) -> Result<(f64, Vec<[f64; 2]>)> {
    // Upright would be in the wall; a little from beyond, so that up is up.
    let (eye, at) = (dial.at(along + 0.5, 0.0, 3.0), dial.at(along, 0.0, 0.0));
    let camera = dial.level.camera((240, 240), 28.0, eye, at)?;
    let picture = bench.light(subject, &camera, &dial.weather)?;
    let reach = 1.2 * SUN_DIAMETER_RAD * metres;
    let mut lines = Bins::of(2.0 * reach);
    for y in 0..picture.size.1 {
        for x in 0..picture.size.0 {
            let [own, across] = dial.on_ground(&camera, x as f64 + 0.5, y as f64 + 0.5);
            if (own - along).abs() < 0.6 {
                lines.add(across + reach, picture.light(x, y));
            }
        }
    }
    let profile = lines.profile(reach);
    let side = profile.len() / 10;
    let ends = [&profile[..side], &profile[profile.len() - side..]].map(|end| mean(end.iter().map(|p| p[1])));
    let shares: Vec<f64> = profile.iter().map(|p| (p[1] - ends[0]) / (ends[1] - ends[0])).collect();
    let places = [0.1, 0.9].map(|share| crossing(&shares, share));
    let width = match places {
        [Some(low), Some(high)] => (high - low) * BIN_WIDTH_M / TENTH_WIDTH_SHARE,
        _ => f64::NAN,
    };
    Ok((width, profile.iter().map(|p| [p[0], p[1] / ends[1]]).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Published for 52 degrees north: 61.4 degrees at noon of 21 June, 38 at that of the equinox.
    #[test]
    fn the_sun_stands_where_almanacs_have_it() {
        let noon = by_hour(52.0, 172.0, 12.0);
        assert!((noon[0] - 61.4).abs() < 0.2 && (noon[1] - 180.0).abs() < 2.0, "{noon:?}");
        let equinox = by_hour(52.0, 80.0, 12.0);
        assert!((equinox[0] - 38.0).abs() < 0.5, "{equinox:?}");
        let south = by_hour(-34.0, 355.0, 8.5);
        assert!((30.0..60.0).contains(&south[0]) && south[1] < 120.0, "{south:?}");
    }
}
