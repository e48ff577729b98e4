//! Lightning: its light is the same in all rates of frames, and as strong as the law says.
//!
//! A level card by night, filmed twice over the same seconds, at 24 and at 60 frames a second, each
//! exposed until the next. What flashes add to the card is told in lux by the glow of the sky on
//! it, which is known. The sum of that light over the frames, times the time of each, is the light
//! of the storm, whatever the rate.
//!
//! A stroke makes 5 lx s on level ground at 1 km, falling with the square of the distance, and
//! comes from about 2 km above the ground. The brightest of the sky shows the elevation `h` that it
//! comes from, so that it is `2 km / sin h` away. An exposure of 38 ms from the beginning of a
//! flash holds its first stroke, which is the strongest, and no other: strokes are 40 ms and more
//! apart, and fade within 4 ms.
//!
//! Tolerance: 1 % of the light of all frames, 3 % of a stroke. The exposure misses up to 0.5 % of
//! it, and a tenth of a degree of elevation is 0.5 %.

use super::allard::NIGHT;
use super::lit::{LIGHT_ALONE, LightPicture, level_square, overcast_card};
use super::plot::Series;
use super::{Bench, Instrument, ShotSubject, Tolerance, changed, expected, mean};
use wm_place::Result;
use wm_scene::Camera;
use wm_weather::Weather;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "flash",
    title: "Lightning",
    about: "A level card by night, filmed at 24 and at 60 frames a second: the light of all frames together must be the same. And \
            single strokes, told by short exposures, against 5 lx s at 1 km, by the distance that the elevation of the brightest of the sky tells.",
    applies: |weather, time| {
        expected::number(weather, time, "lightning", "rate").is_some_and(|rate| rate > 0.0)
    },
    measure,
    sweep: &[
        "lightning.rate=20, lightning.distance=1000",
        "lightning.rate=20, lightning.distance=2500, lightning.seed=3",
    ],
};

/// Rates of frames, 1/s.
const FRAME_RATES_HZ: [f64; 2] = [24.0, 60.0];
/// Flashes that a film holds in the mean, and the limits of its length, s.
const FLASHES_PER_FILM: f64 = 4.0;
const FILM_SECONDS: [f64; 2] = [4.0, 40.0];
/// Strokes that are held against the law, at most.
const MAX_STROKES: usize = 3;
/// Illuminance by the glow of the sky, lx, and the weather that has it, exposed so that flashes do
/// not burn out.
const GLOW_LX: f64 = 10.0;
const EXPOSURE: &str = "light.glow=10, light.exposure=-6.5";
/// Exposure that holds one stroke, s.
const STROKE_EXPOSURE_S: f64 = 0.038;
/// Frames that must be dark before a first stroke.
const DARK_FRAMES: usize = 6;
/// Light of a stroke on level ground at 1 km, lx s, and the height that it comes from, m.
const STROKE_LX_S: f64 = 5.0;
const STROKE_HEIGHT_M: f64 = 2_000.0;
/// Reflectance of the card, and its height, m.
const CARD_REFLECTANCE: f64 = 0.25;
const CARD_HEIGHT_M: f64 = 0.05;
/// Side of the pictures of the card and of the sky, px.
const CARD_SIDE_PX: u32 = 16;
const SKY_SIDE_PX: u32 = 64;

/// A film of the card.
struct Film<'a> {
    subject: ShotSubject,
    camera: Camera,
    /// Without lightning.
    dark: f64,
    weather: &'a Weather,
}

impl Film<'_> {
    /// Mean light of the card's picture, linear.
    fn light(&self, bench: &mut Bench<'_>, weather: &Weather, time: f64) -> Result<f64> {
        let picture = bench.light_at(time, self.subject, &self.camera, weather)?;
        let middle = 0.5 * f64::from(CARD_SIDE_PX);
        Ok(picture.patch(middle, middle, 4))
    }

    /// Illuminance by lightning of an exposure from `time` on, lx, in the mean over it.
    fn lux(&self, bench: &mut Bench<'_>, time: f64, exposure: f64) -> Result<f64> {
        let weather = changed(self.weather, &format!("lightning.exposure={exposure}"))?;
        Ok(GLOW_LX * (self.light(bench, &weather, time)? / self.dark - 1.0))
    }
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let level = bench.level;
    let rate = bench.number("lightning", "rate").unwrap_or(0.0);
    let alone = LIGHT_ALONE.replace("lightning=off, ", "");
    let weather = bench.with(&format!("{alone}, {NIGHT}, {EXPOSURE}"))?;
    let calm = changed(&weather, "lightning=off")?;
    let light = overcast_card(CARD_REFLECTANCE, 0.0);
    let subject = bench.card([0.0, 0.0, CARD_HEIGHT_M], level_square(2.0), 0.2, light)?;
    let camera =
        level.camera((CARD_SIDE_PX, CARD_SIDE_PX), 10.0, [0.0, 0.0, 4.0], [0.0, 0.0, CARD_HEIGHT_M])?;
    let mut film = Film { subject, camera, dark: 1.0, weather: &weather };
    film.dark = film.light(bench, &calm, bench.time)?;

    let seconds = (60.0 * FLASHES_PER_FILM / rate).clamp(FILM_SECONDS[0], FILM_SECONDS[1]).round();
    let mut films: [Vec<f64>; 2] = Default::default();
    for (frames, rate) in films.iter_mut().zip(FRAME_RATES_HZ) {
        for frame in 0..(seconds * rate) as u32 {
            let time = bench.time + f64::from(frame) / rate;
            frames.push(film.lux(bench, time, 1.0 / rate)?);
        }
    }
    let sums = [0, 1].map(|k: usize| films[k].iter().sum::<f64>() / FRAME_RATES_HZ[k]);
    bench.add(
        format!("light of {seconds:.0} s at 24 frames a second, by that at 60"),
        "lx s",
        [sums[1], if sums[1] > 0.01 { sums[0] } else { f64::NAN }],
        Tolerance::Relative(0.01),
    );
    let fast = &films[1];
    let is_lit = |frame: usize| fast[frame] > 0.02;
    let begins = (DARK_FRAMES..fast.len()).filter(|at| is_lit(*at) && !(at - DARK_FRAMES..*at).any(is_lit));
    for (number, frame) in begins.take(MAX_STROKES).enumerate() {
        let time = bench.time + frame as f64 / FRAME_RATES_HZ[1];
        let measured = STROKE_EXPOSURE_S * film.lux(bench, time, STROKE_EXPOSURE_S)?;
        let lit = changed(&weather, &format!("lightning.exposure={STROKE_EXPOSURE_S}"))?;
        let (sin, picture) = brightest(bench, subject, [&lit, &calm], time)?;
        bench.add(
            format!("stroke {} at {:.1} km", number + 1, 1e-3 * STROKE_HEIGHT_M / sin),
            "lx s",
            [STROKE_LX_S * (1_000.0 * sin / STROKE_HEIGHT_M).powi(2), measured],
            Tolerance::Relative(0.03),
        );
        if number == 0 {
            bench.show("the sky of a stroke about its brightest", &picture.picture);
        }
    }
    let curve = |k: usize| {
        films[k]
            .iter()
            .enumerate()
            .map(|(frame, lux)| [(frame as f64 + 0.5) / FRAME_RATES_HZ[k], *lux])
            .collect()
    };
    bench.plot(
        "Light of lightning",
        "time, s",
        "illuminance, mean of a frame, lx",
        vec![Series::line("24 frames a second", curve(0)), Series::line("60 frames a second", curve(1))],
    );
    Ok(())
}

/// Sine of the elevation of the brightest of the sky in lightning, against a calm sky, and the last
/// picture in which it was looked for.
fn brightest(
    bench: &mut Bench<'_>,
    subject: ShotSubject,
    weathers: [&Weather; 2],
    time: f64,
) -> Result<(f64, LightPicture)> {
    // High above the card; the card is below what is looked at.
    let (level, eye) = (bench.level, [0.0, 0.0, 30.0]);
    let mut towards = |fov: f64, direction: [f64; 3]| -> Result<_> {
        let target = std::array::from_fn(|k| eye[k] + direction[k]);
        let camera = level.camera((SKY_SIDE_PX, SKY_SIDE_PX), fov, eye, target)?;
        let [picture, dark] = weathers.map(|weather| bench.light_at(time, subject, &camera, weather));
        let (mut picture, dark) = (picture?, dark?);
        // Without the light that the sky has anyway.
        picture.rgb.iter_mut().zip(&dark.rgb).for_each(|(light, dark)| *light -= dark);
        Ok((camera, picture))
    };
    let mut best = (0.0, [0.0; 3]);
    for turn in 0..6 {
        let (sin, cos) = (f64::from(turn) * std::f64::consts::PI / 3.0).sin_cos();
        let (camera, picture) = towards(80.0, [sin, cos, 0.8])?;
        for at in 0..(SKY_SIDE_PX * SKY_SIDE_PX) as usize {
            let (x, y) = (at % SKY_SIDE_PX as usize, at / SKY_SIDE_PX as usize);
            if picture.light(x, y) > best.0 {
                let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
                best = (picture.light(x, y), level.axes.map(|axis| axis.dot(ray)));
            }
        }
    }
    let mut direction = best.1;
    let mut last = None;
    for fov in [30.0, 24.0, 24.0] {
        let (camera, picture) = towards(fov, direction)?;
        let [x, y] = peak(&picture);
        let ray = camera.ray(x, y).normalize();
        direction = level.axes.map(|axis| axis.dot(ray));
        last = Some(picture);
    }
    Ok((direction[2], last.expect("there are several")))
}

/// The top of a parabola through a picture, px: what is alike to all sides of it does not move it.
fn peak(picture: &LightPicture) -> [f64; 2] {
    let side = picture.size.0;
    let middle = 0.5 * side as f64;
    [0, 1].map(|axis| {
        // Means across, over half of the picture, so that only the one direction is left.
        let line: Vec<f64> = (0..side)
            .map(|at| {
                let across = side / 4..3 * side / 4;
                mean(across.map(|other| match axis {
                    0 => picture.light(at, other),
                    _ => picture.light(other, at),
                }))
            })
            .collect();
        // Least squares of a parabola over places that are alike to both sides.
        let (mut odd, mut even, mut squares, mut fourths, mut twos, mut sum) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        for (at, value) in line.iter().enumerate() {
            let x = at as f64 + 0.5 - middle;
            odd += x * value;
            even += x * x * value;
            squares += x * x;
            fourths += x.powi(4);
            twos += 1.0;
            sum += value;
        }
        let slope = odd / squares;
        let curve = (even - sum * squares / twos) / (fourths - squares * squares / twos);
        let off = -slope / (2.0 * curve);
        if off.is_finite() { middle + off.clamp(-middle, middle) } else { middle }
    })
}
