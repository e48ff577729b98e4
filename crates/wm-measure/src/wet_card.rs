//! Wet card: boards of known reflectance from above, dry and wet.
//!
//! Level boards of reflectances 0.1 to 0.5 lie on a yard of 0.2 under an overcast sky. The light of
//! a wet board over that of the dry one, times its reflectance, is its wet reflectance: with full
//! pores that of Angstrom (1925), by the path of light that is scattered in the forward direction;
//! under a film that of Lekner and Dorf (1988), summed here over the reflections between the board
//! and the underside of the water.
//!
//! Tolerance 3 %. Systematic: reflectances are kept in 8 bits, 0.4 % of the factor at most.

use super::lit::{level_square, overcast_card, paint_card};
use super::plot::Series;
use super::{Bench, Instrument, Tolerance, changed, expected};
use wm_place::Result;
use wm_scene::Splats;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "wet-card",
    title: "Wet card",
    about: "Level boards of reflectances 0.1 to 0.5 under an overcast sky, from above: the light of the wet boards over that of the dry \
            ones, with full pores against Angstrom's law, and under a film against the sum of the reflections between the board and the water.",
    applies: |weather, _| expected::is_on(weather, "wetness"),
    measure,
    sweep: &["wetness.amount=1"],
};

/// Reflectances of the boards, and of the yard.
const BOARD_REFLECTANCES: [f64; 5] = [0.1, 0.2, 0.3, 0.4, 0.5];
const YARD_ALBEDO: f64 = 0.2;
/// Half the side of the yard, and of a board, m; the distance of boards, their height, and the
/// distance of splats, m.
const YARD_HALF_SIDE_M: f64 = 7.0;
const BOARD_HALF_SIDE_M: f64 = 0.7;
const BOARD_SPACING_M: f64 = 2.0;
const BOARD_HEIGHT_M: f64 = 0.06;
const SPLAT_SPACING_M: f64 = 0.1;
/// Reflections between a board and the underside of the water that are summed.
const REFLECTION_COUNT: i32 = 60;

/// The reflectance of a board whose pores are full. Water scatters light more forwards, so that of
/// each event a share `n^2` as much is lost to absorption: `A = s / (s + a)` becomes
/// `s / (s + n^2 a)`.
fn with_full_pores(albedo: f64) -> f64 {
    let (scatters, absorbs) = (albedo, 1.0 - albedo);
    scatters / (scatters + expected::WATER_INDEX * expected::WATER_INDEX * absorbs)
}

/// The reflectance of a board under a film, by the light that leaves after each reflection.
fn under_film(albedo: f64) -> f64 {
    // Of diffuse daylight 6.6 % do not enter; of diffuse light in the water 47.5 % are thrown back.
    let (enters, returned) = (1.0 - 0.066, 0.475);
    (0..REFLECTION_COUNT)
        .map(|bounce| enters * albedo * (returned * albedo).powi(bounce) * (1.0 - returned))
        .sum()
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let level = bench.level;
    let mut splats = Splats::default();
    let mut card = |center: [f64; 3], half: f64, albedo: f64| {
        let halves = level_square(half);
        paint_card(&level, center, halves, SPLAT_SPACING_M, overcast_card(albedo, 0.0), &mut splats);
    };
    card([0.0; 3], YARD_HALF_SIDE_M, YARD_ALBEDO);
    let place = |index: usize| [BOARD_SPACING_M * (index as f64 - 2.0), 0.0, BOARD_HEIGHT_M];
    for (index, albedo) in BOARD_REFLECTANCES.into_iter().enumerate() {
        card(place(index), BOARD_HALF_SIDE_M, albedo);
    }
    let subject = bench.set_up_lit(splats)?;
    let soaked = bench.with_light("light=off, wetness.porosity=1, wetness.puddles=0")?;
    let wet = |amount: &str| changed(&soaked, amount);
    let dry = bench.with_light("light=off")?;
    let mut curves = Vec::new();
    type Law = fn(f64) -> f64;
    let states: [(&str, &str, Law); 2] = [
        ("with full pores", "wetness.amount=0.5", with_full_pores),
        ("under a film", "wetness.amount=1", under_film),
    ];
    for (name, amount, law) in states {
        let weather = wet(amount)?;
        let mut curve = Vec::new();
        for (index, albedo) in BOARD_REFLECTANCES.into_iter().enumerate() {
            let [x, y, _] = place(index);
            let camera = level.camera((33, 33), 8.0, [x, y, 3.0], place(index))?;
            let mut light = |weather| -> Result<f64> {
                let picture = bench.light(subject, &camera, weather)?;
                Ok(picture.patch(16.5, 16.5, 6))
            };
            let measured = albedo * light(&weather)? / light(&dry)?;
            curve.push([albedo, measured]);
            bench.add(
                format!("reflectance of a board of {albedo} {name}"),
                "",
                [law(albedo), measured],
                Tolerance::Relative(0.03),
            );
        }
        curves.push(Series::points(name, curve));
    }
    bench.plot("Wet reflectance", "reflectance of the dry board", "reflectance of the wet board", curves);
    let camera = level.camera((480, 320), 50.0, [0.0, -8.0, 5.0], [0.0, 0.0, 0.0])?;
    let shown = bench.light(subject, &camera, &wet("wetness.amount=1")?)?;
    bench.show("the boards under a film", &shown.picture);
    Ok(())
}
