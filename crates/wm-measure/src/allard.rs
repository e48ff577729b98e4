//! Allard's law: the light of lamps by night, over their distance through fog.
//!
//! A lamp of intensity `I` at the distance `d` makes the illuminance `E = I exp(-sigma d) / d^2` on
//! what faces it (Allard 1876). In a picture that is the sum over the lamp's pixels of their light
//! times the solid angle that each covers. The slope of `-ln(E d^2)` over `d` is the extinction,
//! whatever the lamp's intensity and the exposure.
//!
//! Each lamp is seen with a lens so long that its ball is 3 px in radius, so that little of the
//! light that fog scatters around it gets into the sum; what does is taken off by the mean of a
//! ring. Tolerance 3 %. Systematic: the light in the air falls with the distance from the lamp, so
//! that a ring takes off a third of what is before it. The rest is below 1 % of the lamp's at an
//! optical depth of 3.6, 0.3 % of the slope.

use super::boards::slope;
use super::expected;
use super::lit::{LightPicture, level_square};
use super::plot::{Axis, Series};
use super::{Bench, Instrument, MeasuredPicture, Tolerance, fov_of};
use wm_place::Result;
use wm_scene::Lamp;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "allard",
    title: "Lamps through fog",
    about: "Nine lamps shine by night at 20 to 400 m. The light of one is the sum over its pixels in a picture, what is around \
            them taken off; its logarithm with the square of the distance is a line over the distance, whose slope is the extinction.",
    applies: |weather, time| !expected::airs(weather, time).is_empty(),
    measure,
    sweep: &["fog.mor=100", "fog.mor=200", "fog.mor=500", "haze.mor=1500, haze.scale_height=inf"],
};

/// Height of the camera and of the lamps above the ground, m.
const EYE_HEIGHT_M: f64 = 1.6;
/// Number of lamps, and the headings of the outer ones, degrees.
const LAMP_COUNT: usize = 9;
const MAX_HEADING_DEGREES: f64 = 40.0;
/// Optical depths and distances, m, between which they stand.
const OPTICAL_DEPTHS: [f64; 2] = [0.3, 3.6];
const DISTANCES_M: [f64; 2] = [20.0, 400.0];
/// Their radius, m, and flux, lm.
const LAMP_RADIUS_M: f64 = 0.02;
const LAMP_FLUX_LM: f64 = 25.0;
/// Radius of a lamp in its picture, px; the side of the picture; of the disc that is summed, and of
/// the ring around it.
const LAMP_RADIUS_PX: f64 = 3.0;
const PICTURE_SIDE_PX: u32 = 40;
const DISC_RADIUS_PX: f64 = 9.0;
const RING_RADII_PX: [f64; 2] = [10.0, 15.0];
/// Changes that give the sky a glow of 100 lx and set the exposure to it: in the dark of a night
/// lamps would burn out.
const EXPOSURE: &str = "light.glow=100, light.exposure=-8.5";

/// Changes that make night with lamps.
pub(crate) const NIGHT: &str = "light.model=night, light.photos=diffuse, light.clouds=0, light.lamps=on, \
    light.headlamps=off, light.cloud_shadows=off";
/// Changes that take away all that falls, lies, or is painted behind lamps.
pub(crate) const NOTHING_FALLS: &str = "rain=off, snowfall=off, hail=off, snow_cover=off, dust_cover=off, \
    wind=off, sky=off, look=off, lightning=off";

/// Sum over the pixels of a lamp in the middle of a picture, with what is around them taken off, by
/// channel.
fn lamp_sum(picture: &LightPicture) -> [f64; 3] {
    let middle = 0.5 * f64::from(PICTURE_SIDE_PX);
    let (mut inside, mut count) = ([0.0; 3], 0.0);
    let (mut around, mut ring) = ([0.0; 3], 0.0);
    for y in 0..picture.size.1 {
        for x in 0..picture.size.0 {
            let away = (x as f64 + 0.5 - middle).hypot(y as f64 + 0.5 - middle);
            let light = picture.rgb(x, y);
            if away < DISC_RADIUS_PX {
                (0..3).for_each(|k| inside[k] += light[k]);
                count += 1.0;
            } else if (RING_RADII_PX[0]..RING_RADII_PX[1]).contains(&away) {
                (0..3).for_each(|k| around[k] += light[k]);
                ring += 1.0;
            }
        }
    }
    std::array::from_fn(|k| inside[k] - around[k] / ring * count)
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let level = bench.level;
    let weather = bench.with(&format!("{NOTHING_FALLS}, {NIGHT}, {EXPOSURE}"))?;
    let asked = expected::extinction(&weather, bench.time, EYE_HEIGHT_M);
    let limits =
        [0, 1].map(|end: usize| (OPTICAL_DEPTHS[end] / asked[1]).clamp(DISTANCES_M[0], DISTANCES_M[1]));
    let lamp = |index: usize| {
        let share = index as f64 / (LAMP_COUNT - 1) as f64;
        let metres = limits[0] + (limits[1] - limits[0]) * share;
        // Near and far ones are mixed, so that none is beside one whose light it would be in.
        let turn = (5 * index % LAMP_COUNT) as f64 / (LAMP_COUNT - 1) as f64;
        let (sin, cos) = (MAX_HEADING_DEGREES * (2.0 * turn - 1.0)).to_radians().sin_cos();
        (metres, [metres * sin, metres * cos, EYE_HEIGHT_M])
    };
    let all: Vec<(f64, [f64; 3])> = (0..LAMP_COUNT).map(lamp).collect();
    let lamps = all.iter().map(|(_, at)| Lamp {
        lumens: LAMP_FLUX_LM,
        radius: LAMP_RADIUS_M,
        kelvin: 4_000.0,
        ..Lamp::new(level.point(*at).to_array())
    });
    // Behind the camera, since a place has ground somewhere.
    let subject = bench.card_by_lamps([0.0, -30.0, 0.0], level_square(2.0), 0.25, 0.25, lamps.collect())?;
    let (mut points, mut strip) = ([const { Vec::new() }; 3], Vec::new());
    for (metres, at) in &all {
        let fov = fov_of(0.5 * f64::from(PICTURE_SIDE_PX) / LAMP_RADIUS_PX * LAMP_RADIUS_M / metres);
        let camera = level.camera((PICTURE_SIDE_PX, PICTURE_SIDE_PX), fov, [0.0, 0.0, EYE_HEIGHT_M], *at)?;
        let picture = bench.light(subject, &camera, &weather)?;
        let pixel = 1.0 / (camera.fx * camera.fy);
        let sum = lamp_sum(&picture);
        if picture.brightest() < 1.0 {
            for k in 0..3 {
                let e = sum[k] * pixel;
                if e > 0.0 {
                    points[k].push([*metres, -(e * metres * metres).ln()]);
                }
            }
        }
        strip.push(picture.picture.frame.rgb);
    }
    for (k, name) in ["red", "green", "blue"].into_iter().enumerate() {
        bench.add(
            format!("extinction by lamps, {name}"),
            "1/km",
            [1e3 * asked[k], if points[k].len() < LAMP_COUNT { f64::NAN } else { 1e3 * slope(&points[k]) }],
            Tolerance::Relative(0.03),
        );
    }
    let first = points[1].first().copied().unwrap_or_default();
    let shown = |[metres, log]: [f64; 2]| [metres, (first[1] - log).exp()];
    let law = (0..=60).map(|k| limits[0] + (limits[1] - limits[0]) * f64::from(k) / 60.0);
    bench.plot(
        "Light of lamps",
        "distance, m",
        Axis::log("E d\u{b2}, share of the nearest"),
        vec![
            Series::line(
                "exp(-sigma d)",
                law.map(|metres| [metres, (-asked[1] * (metres - first[0])).exp()]).collect(),
            ),
            Series::points("green", points[1].iter().copied().map(shown).collect()),
        ],
    );
    bench.show_picture(MeasuredPicture {
        caption: format!(
            "the lamps at {:.0} to {:.0} m, each through a lens by its distance",
            limits[0], limits[1]
        ),
        rgb: side_by_side(&strip),
        size: (PICTURE_SIDE_PX * LAMP_COUNT as u32, PICTURE_SIDE_PX),
    });
    Ok(())
}

/// Square pictures in a row.
fn side_by_side(pictures: &[Vec<f32>]) -> Vec<f32> {
    let row = 3 * PICTURE_SIDE_PX as usize;
    (0..PICTURE_SIDE_PX as usize)
        .flat_map(|y| pictures.iter().flat_map(move |rgb| rgb[y * row..(y + 1) * row].iter().copied()))
        .collect()
}
