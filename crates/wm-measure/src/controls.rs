//! Controllability: each control of the paper's sheet, turned up step by step, and what of it is
//! seen.
//!
//! Counts say nothing of a picture (fewer, larger flakes may cover more), so what is measured is
//! what is seen: the share of light that fog takes, the coverage of what falls, the ground that
//! snow whitens, how red dust is, how far streaks lean. Every step must move it the same way. A
//! lean is measured in the open beside the place, as by the streaks' instrument, to each side with
//! its standard error: a place may lie in the lee of what stands there.

use super::drops::{DropSample, MeasuredDrop};
use super::plot::{Axis, Plot, Series};
use super::{
    Bench, Instrument, MeasuredPicture, PARTICLES, ShotSubject, Tolerance, clear, expected, mean, median,
    streaks,
};
use wm_image::PictureSize;
use wm_image::sheet::{SheetLayout, SheetPanel, sheet};
use wm_place::Picture;
use wm_place::{Error, Layers, Result};
use wm_render::Frame;
use wm_render::frame::srgb_decode;
use wm_weather::Weather;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "controls",
    title: "Controllability",
    about: "The paper's controls, each turned up in five steps on the place itself: fog intensity, opacity, size and number of what falls, \
            snowfall, depth of the cover, colour of dust, direction and speed of the wind. What is measured is what is seen - \
            light lost, coverage, whitened ground, colour, lean of the streaks, from the left of the picture to its right, in the open beside \
            the place - and every step must move it the same way. A place in the lee of a tower may be dry all the same.",
    // A sheet is of no weather but its own.
    applies: |_, _| false,
    measure,
    sweep: &[""],
};

/// A row of the sheet.
struct Control {
    name: &'static str,
    /// Parameters of all pictures of the row.
    base: &'static str,
    /// The parameter and its values.
    key: &'static str,
    values: [&'static str; STEP_COUNT],
    /// The measured quantity.
    seen: MeasuredQuantity,
}

const STEP_COUNT: usize = 5;

/// A quantity measured in a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum MeasuredQuantity {
    /// Light that the air takes, share.
    Lost,
    /// Coverage of what falls, share of the picture.
    Coverage,
    /// Share of the picture that cover makes another colour.
    Whitened,
    /// Red less blue, of what cover makes another colour.
    Redness,
    /// Lean of the streaks from upright, degrees.
    Lean,
}

impl MeasuredQuantity {
    fn label(self) -> &'static str {
        match self {
            Self::Lost => "light lost, share",
            Self::Coverage => "coverage, share of the picture",
            Self::Whitened => "covered, share of the picture",
            Self::Redness => "red less blue of what is covered",
            Self::Lean => "lean of the streaks, degrees",
        }
    }
}

/// Streaks that show their way: many drops, in a short exposure.
const STREAKS: &str =
    "rain.rate=60, rain.exposure=0.006, rain.size=2, rain.opacity=4, wind.gusts=0, wind.speed=6";

/// The direction of the wind. It is turned from the right of the picture, so that streaks lean
/// alike in any view.
const WIND_DIRECTION: &str = "wind.direction";

#[rustfmt::skip]
const CONTROLS: [Control; 9] = [
    Control { name: "fog intensity", base: "", key: "fog.mor", values: ["1000", "400", "150", "60", "25"], seen: MeasuredQuantity::Lost },
    Control { name: "particle opacity", base: "rain.rate=25, rain.exposure=0.004, rain.size=2", key: "rain.opacity",
        values: ["0.5", "1", "2", "4", "8"], seen: MeasuredQuantity::Coverage },
    Control { name: "particle size", base: "rain.rate=25, rain.exposure=0.004, rain.opacity=4", key: "rain.size",
        values: ["0.5", "1", "1.5", "2", "3"], seen: MeasuredQuantity::Coverage },
    Control { name: "particle density", base: "rain.exposure=0.004, rain.size=2, rain.opacity=4", key: "rain.rate",
        values: ["2", "10", "25", "60", "120"], seen: MeasuredQuantity::Coverage },
    Control { name: "snowfall", base: "", key: "snowfall.rate", values: ["0.5", "1", "2", "4", "8"], seen: MeasuredQuantity::Coverage },
    Control { name: "cover depth", base: "", key: "snow_cover.depth", values: ["0.002", "0.006", "0.02", "0.08", "0.3"], seen: MeasuredQuantity::Whitened },
    Control { name: "dust colour", base: "dust_cover.depth=0.05, haze.mor=800, haze.airlight=#d8b888", key: "dust_cover.color",
        values: ["#b8b4ae", "#b8a890", "#b89c74", "#b89058", "#b8803c"], seen: MeasuredQuantity::Redness },
    Control { name: "wind direction", base: STREAKS, key: WIND_DIRECTION, values: ["180", "135", "90", "45", "0"], seen: MeasuredQuantity::Lean },
    Control { name: "wind speed", base: STREAKS, key: "wind.speed", values: ["0", "2", "4", "8", "14"], seen: MeasuredQuantity::Lean },
];

/// Width of a picture of the sheet, px.
const PICTURE_WIDTH_PX: u32 = 320;
/// Change of linear light that tells cover.
const COVER_LIGHT_CHANGE: f64 = 0.02;
/// Slabs of air in which a lean is measured.
const LEAN_SLABS: usize = 2;
/// Largest error of the lean against that of drops of their size in this wind, degrees: as for the
/// streaks.
const MAX_LEAN_ERROR_DEGREES: f64 = 1.5;
/// Standard errors by which a step must be seen.
const SIGNIFICANCE_SIGMA: f64 = 3.0;

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let [camera, _] = bench.rig.views()?;
    let heading = bench.level.heading(camera.rotation().row(0));
    let height =
        (f64::from(PICTURE_WIDTH_PX) * f64::from(camera.height) / f64::from(camera.width)).round().max(1.0);
    let camera = camera.resized(PICTURE_WIDTH_PX, height as u32);
    let bare = bench.draw(ShotSubject::Place, &camera, &clear(), PARTICLES)?;
    let mut rows: Vec<(Frame, String)> = Vec::new();
    for control in &CONTROLS {
        let (mut points, mut errors) = (Vec::new(), Vec::new());
        for (step, value) in control.values.iter().enumerate() {
            let mut weather = bench.with(control.base)?;
            let turn = if control.key == WIND_DIRECTION { turn_of(value)? } else { 0.0 };
            let direction = format!("{WIND_DIRECTION}={:.0}", (heading + turn).rem_euclid(360.0));
            let change = match control.key {
                WIND_DIRECTION => direction.clone(),
                key => format!("{key}={value}"),
            };
            if control.seen == MeasuredQuantity::Lean {
                weather.set_text(&direction)?;
            }
            weather.set_text(&change)?;
            let layers = match control.seen {
                MeasuredQuantity::Lost => PARTICLES.with(Layers::TRANSMITTANCE),
                _ => PARTICLES,
            };
            let picture = bench.draw(ShotSubject::Place, &camera, &weather, layers)?;
            let [value, error] = match measured(control.seen, &picture, &bare) {
                Some(value) => [value, 0.0],
                None => lean(bench, &weather, heading)?,
            };
            points.push([(step + 1) as f64, value]);
            errors.push(error);
            rows.push((picture.frame, change));
        }
        let rising = (1..STEP_COUNT).filter(|k| {
            let chance = SIGNIFICANCE_SIGMA * f64::hypot(errors[k - 1], errors[*k]);
            points[*k][1] - points[k - 1][1] > chance
        });
        let quantity = format!(
            "steps that raise the {}: {} to {}",
            control.seen.label().split(',').next().unwrap_or_default(),
            short(points[0][1]),
            short(points[STEP_COUNT - 1][1])
        );
        let values = [(STEP_COUNT - 1) as f64, rising.count() as f64];
        bench.add(quantity, "", values, Tolerance::Absolute(0.0)).setting = control.name.to_owned();
        bench.finding.plots.push(Plot {
            title: format!("{}: {} = {}", control.name, control.key, control.values.join(", ")),
            x: Axis::linear("step"),
            y: Axis::linear(control.seen.label()),
            series: vec![Series::points("seen", points.clone())],
        });
    }
    let panels: Vec<SheetPanel<'_>> =
        rows.iter().map(|(frame, label)| SheetPanel { rgb: &frame.rgb, label }).collect();
    let layout = SheetLayout::new(
        PictureSize::new(camera.width, camera.height),
        panels.len() as u32,
        STEP_COUNT as u32,
    );
    let size = layout.size();
    bench.finding.pictures.push(MeasuredPicture {
        caption: SHEET.to_owned(),
        rgb: sheet(&layout, &panels),
        size: (size.width, size.height),
    });
    Ok(())
}

/// The caption of the sheet in a report.
pub(crate) const SHEET: &str = "The sheet: a control per row, turned up from left to right. Where wind shows no rain, the view lies in the lee of what \
                         stands there";

/// Returns the angle of a wind direction's step, degrees.
fn turn_of(value: &str) -> Result<f64> {
    value
        .parse()
        .map_err(|_| Error::Unsupported(format!("{WIND_DIRECTION}: {value} is not a number of degrees")))
}

fn short(value: f64) -> String {
    if value.abs() < 1.0 { format!("{value:.4}") } else { format!("{value:.1}") }
}

/// The value of `seen` in a picture, compared with the same view in clear air; `None` for a lean,
/// which is measured in the open.
fn measured(seen: MeasuredQuantity, picture: &Picture, bare: &Picture) -> Option<f64> {
    let pixels = picture.frame.pixels();
    let light = |picture: &Picture, at: usize| -> [f64; 3] {
        std::array::from_fn(|k| srgb_decode(f64::from(picture.frame.rgb[3 * at + k])))
    };
    let change = |at: usize| mean((0..3).map(|k| (light(picture, at)[k] - light(bare, at)[k]).abs()));
    match seen {
        MeasuredQuantity::Lost => Some(1.0 - mean(picture.parts.transmittance.iter().map(|v| f64::from(*v)))),
        MeasuredQuantity::Coverage => {
            Some(mean(picture.frame.particles.iter().skip(3).step_by(4).map(|v| f64::from(*v))))
        }
        MeasuredQuantity::Whitened => {
            Some(mean((0..pixels).map(|at| f64::from(u8::from(change(at) > COVER_LIGHT_CHANGE)))))
        }
        MeasuredQuantity::Redness => {
            let covered =
                (0..pixels).filter(|at| change(*at) > COVER_LIGHT_CHANGE).map(|at| light(picture, at));
            Some(mean(covered.map(|[r, _, b]| r - b)))
        }
        MeasuredQuantity::Lean => None,
    }
}

/// The lean of streaks in the open, degrees, and its standard error; NaN if it differs from that by
/// the law.
///
/// In the air as it is at the place, but for what shelters it: in the lee of a tower no rain is to
/// be seen, and says nothing of its lean.
fn lean(bench: &mut Bench<'_>, weather: &Weather, heading: f64) -> Result<[f64; 2]> {
    let look = streaks::look(weather, bench.time)?.turned(heading);
    let mut caught = DropSample::default();
    look.take(bench, LEAN_SLABS, &mut caught)?;
    let degrees = |drop: &MeasuredDrop| drop.blob.angle.to_degrees();
    let law =
        |drop: &MeasuredDrop| f64::atan2(look.across, expected::gunn_kinzer(drop.diameter)).to_degrees();
    let off = median(streaks::long(&caught).map(|drop| degrees(drop) - law(drop)).collect());
    let leans: Vec<f64> = streaks::long(&caught).map(degrees).collect();
    let middle = median(leans.clone());
    // Of a median of n that are spread as a normal distribution is.
    let spread = 1.483 * median(leans.iter().map(|lean| (lean - middle).abs()).collect());
    let error = 1.253 * spread / (leans.len() as f64).sqrt();
    Ok(if off.abs() < MAX_LEAN_ERROR_DEGREES { [middle, error] } else { [f64::NAN; 2] })
}
