//! The pictures of a photo: photo, render and error; depth, normals and surfaces against the truth.

use crate::report::escaped;
use crate::report::picture::{self, MapCell};
use anyhow::Result;
use std::fmt::Write;
use weather_magician::train::evaluation::{EvaluatedPhoto, TrueMaps};
use weather_magician::train::metrics::{DEPTH_TOLERANCE_SHARE, MIN_SURFACE_COVERAGE, angle};
use wm_image::ramps::{self, ColorRamp};
use wm_render::Frame;

/// Largest difference of colours on the colour ramp.
const COLOR_RANGE: f64 = 0.2;
/// Largest relative error of depth on the colour ramp, in both directions.
const DEPTH_RANGE: f64 = 0.2;
/// Largest angle on the colour ramp, degrees.
const ANGLE_RANGE: f64 = 60.0;
/// Share of true depths below the range of colours, and of those above it.
const DEPTH_TAIL_SHARE: f64 = 0.02;

/// The ramps, with the names of their classes.
pub(crate) const RAMPS: [(&str, ColorRamp); 3] =
    [("depth", ramps::turbo), ("error", ramps::heat), ("signed", ramps::signed)];

/// The colours of kept and lost surfaces and sky, with their meaning.
const FATES: [([u8; 3], &str); 6] = [
    ([190, 196, 202], "surface kept"),
    ([224, 60, 49], "open"),
    ([240, 160, 30], "behind"),
    ([120, 180, 235], "sky open"),
    ([110, 60, 170], "sky covered"),
    (ramps::UNKNOWN_COLOR, "not known"),
];

/// The pictures of a photo, ready to be written.
pub(crate) struct PhotoPanels {
    /// The photo.
    pub(crate) name: String,
    size: (u32, u32),
    figures: Vec<PanelPicture>,
}

struct PanelPicture {
    what: String,
    picture: String,
    key: Key,
    width: Width,
}

/// The place of a figure on a narrow screen.
#[derive(Clone, Copy, PartialEq)]
enum Width {
    /// Half of the page's width.
    Half,
    /// The whole width.
    Whole,
}

/// The meaning of colours.
enum Key {
    /// No key: the pixels are colours.
    None,
    /// A bar of the ramp's class, with numbers at equal distances.
    Bar(&'static str, Vec<String>),
    /// A list of colours with their meanings.
    Fates,
}

impl PhotoPanels {
    /// Draws the pictures.
    pub(crate) fn new(shown: &EvaluatedPhoto<'_>, metres_per_unit: f64) -> Result<Self> {
        let EvaluatedPhoto { name, photo, image, frame, solid, truth: maps, .. } = *shown;
        let full = (frame.width, frame.height);
        let mut figures = Vec::new();
        let mut add = |what: &str, picture: String, key: Key, width: Width| {
            figures.push(PanelPicture { what: what.to_owned(), picture, key, width });
        };
        add("photo", picture::color(photo, full, picture::MAX_WIDTH_PX)?, Key::None, Width::Half);
        add("render", picture::color(image, full, picture::MAX_WIDTH_PX)?, Key::None, Width::Half);
        let size = picture::shown_size(full);
        let places = picture::nearest(full);
        let map = |of: &dyn Fn(usize) -> MapCell, ramp: ColorRamp| -> Result<String> {
            let cells: Vec<MapCell> = places.iter().map(|place| of(*place)).collect();
            picture::numbers(&cells, size, ramp)
        };
        let difference = |place: usize| {
            let channels = 3 * place..3 * place + 3;
            let sum: f32 = channels.map(|at| (image[at] - photo[at]).abs()).sum();
            MapCell::At(f64::from(sum) / 3.0 / COLOR_RANGE)
        };
        let key = Key::Bar("error", ticks(0.0, COLOR_RANGE, |v| format!("{v:.2}")));
        add(
            "difference of colours, mean of the channels, 0-1",
            map(&difference, ramps::heat)?,
            key,
            Width::Whole,
        );
        if let Some(truth) = &maps.depth {
            let range = Range::of(truth);
            let cell =
                |depth: f32, none: MapCell| if depth > 0.0 { MapCell::At(range.place(depth)) } else { none };
            let is_surface = |place: usize| truth[place] > 0.0 && truth[place].is_finite();
            let key = || Key::Bar("depth", range.ticks(metres_per_unit));
            let known = |place: usize| {
                if is_surface(place) { cell(truth[place], MapCell::Unknown) } else { MapCell::Unknown }
            };
            add("true depth, m", map(&known, ramps::turbo)?, key(), Width::Half);
            let found = |place: usize| cell(frame.median_depth[place], MapCell::Missing);
            add("median depth, m", map(&found, ramps::turbo)?, key(), Width::Half);
            let error = |place: usize| match (is_surface(place), frame.median_depth[place]) {
                (false, _) => MapCell::Unknown,
                (true, depth) if depth <= 0.0 => MapCell::Missing,
                (true, depth) => {
                    let error = f64::from((depth - truth[place]) / truth[place]);
                    MapCell::At(0.5 + 0.5 * error / DEPTH_RANGE)
                }
            };
            let percent =
                |v: f64| format!("{:+.0} %", 100.0 * v).replace("+0 %", "0").replace('-', "\u{2212}");
            let key = Key::Bar("signed", ticks(-DEPTH_RANGE, DEPTH_RANGE, percent));
            add("relative error of median depth", map(&error, ramps::signed)?, key, Width::Whole);
        }
        if let Some(truth) = &maps.normal {
            let of = |normals: &[f32], place: usize| [0, 1, 2].map(|k| normals[3 * place + k]);
            let colored = |normals: &[f32]| -> Result<String> {
                let shade = |normal: [f32; 3]| match normal {
                    [0.0, 0.0, 0.0] => [0.5; 3],
                    normal => normal.map(|v| 0.5 + 0.5 * v),
                };
                let rgb: Vec<f32> = places.iter().flat_map(|place| shade(of(normals, *place))).collect();
                picture::color(&rgb, size, picture::MAX_WIDTH_PX)
            };
            add(
                "true normals, x y z of the world as red green blue",
                colored(truth)?,
                Key::None,
                Width::Half,
            );
            add("rendered normals", colored(&frame.normal)?, Key::None, Width::Half);
            let error = |place: usize| {
                let (true_normal, normal) = (of(truth, place), of(&frame.normal, place));
                match angle(&normal, &true_normal) {
                    Some(angle) => MapCell::At(f64::from(angle) / ANGLE_RANGE),
                    None if true_normal == [0.0; 3] => MapCell::Unknown,
                    None => MapCell::Missing,
                }
            };
            let key = Key::Bar("error", ticks(0.0, ANGLE_RANGE, |v| format!("{v:.0}\u{b0}")));
            add("angle between normals", map(&error, ramps::heat)?, key, Width::Whole);
        }
        if maps.depth.is_some() || maps.sky.is_some() {
            let indices: Vec<u8> = places.iter().map(|place| fate(*place, solid, maps)).collect();
            let palette = FATES.map(|(color, _)| color);
            let drawn = picture::indexed(&indices, size, &palette)?;
            add("surfaces and sky, without the sky's splats", drawn, Key::Fates, Width::Whole);
        }
        Ok(Self { name: name.to_owned(), size, figures })
    }

    /// Writes the figures.
    pub(crate) fn write(&self, out: &mut String) {
        out.push_str("<div class=\"figures\">\n");
        let (width, height) = self.size;
        for PanelPicture { what, picture, key, width: stand } in &self.figures {
            let class = if *stand == Width::Whole { " class=\"wide\"" } else { "" };
            let alt = escaped(&format!("{what} of {}", self.name));
            let _ = write!(
                out,
                "<figure{class}><img src=\"{picture}\" alt=\"{alt}\" width=\"{width}\" height=\"{height}\" loading=\"lazy\">"
            );
            let _ = write!(out, "<figcaption>{}", escaped(what));
            match key {
                Key::None => {}
                Key::Bar(class, ticks) => {
                    let _ = write!(out, "<span class=\"bar {class}\"></span><span class=\"ticks\">");
                    for tick in ticks {
                        let _ = write!(out, "<span>{tick}</span>");
                    }
                    out.push_str("</span>");
                }
                Key::Fates => {
                    out.push_str("<br>");
                    for ([r, g, b], what) in FATES {
                        let style = format!("background:rgb({r} {g} {b})");
                        let _ = write!(out, "<span class=\"key\"><i style=\"{style}\"></i>{what}</span> ");
                    }
                }
            }
            out.push_str("</figcaption></figure>\n");
        }
        out.push_str("</div>\n");
    }
}

/// Returns the index in [`FATES`] of a pixel.
fn fate(place: usize, solid: &Frame, maps: &TrueMaps) -> u8 {
    let (coverage, depth) = (solid.alpha[place], solid.median_depth[place]);
    if maps.sky.as_ref().is_some_and(|sky| sky[place] > 0.5) {
        return if coverage > MIN_SURFACE_COVERAGE { 4 } else { 3 };
    }
    match maps.depth.as_ref().map(|truth| truth[place]) {
        Some(truth) if truth > 0.0 && truth.is_finite() => {
            if coverage < MIN_SURFACE_COVERAGE || depth <= 0.0 {
                1
            } else {
                2 * u8::from(depth > truth * (1.0 + DEPTH_TOLERANCE_SHARE))
            }
        }
        _ => 5,
    }
}

/// Returns five numbers of a bar from one end to the other.
fn ticks(low: f64, high: f64, text: impl Fn(f64) -> String) -> Vec<String> {
    (0..5).map(|tick| text(low + (high - low) * f64::from(tick) / 4.0)).collect()
}

/// A range of depths, logarithmic.
struct Range {
    low: f64,
    high: f64,
}

impl Range {
    /// Returns the range from the nearest to the farthest surface, without a few outliers.
    fn of(truth: &[f32]) -> Self {
        let mut known: Vec<f32> = truth.iter().copied().filter(|z| *z > 0.0 && z.is_finite()).collect();
        known.sort_unstable_by(f32::total_cmp);
        let at = |share: f64| known.get(((known.len() as f64 - 1.0) * share).round() as usize).copied();
        let low = f64::from(at(DEPTH_TAIL_SHARE).unwrap_or(1.0));
        // A wall that is equally far everywhere has a colour, too.
        Self {
            low: low.ln(),
            high: f64::from(at(1.0 - DEPTH_TAIL_SHARE).unwrap_or(1.0)).max(1.01 * low).ln(),
        }
    }

    fn place(&self, depth: f32) -> f64 {
        (f64::from(depth).ln() - self.low) / (self.high - self.low)
    }

    fn ticks(&self, metres_per_unit: f64) -> Vec<String> {
        ticks(self.low, self.high, |v| {
            let metres = v.exp() * metres_per_unit;
            let digits = if metres < 0.1 {
                3
            } else if metres < 10.0 {
                1
            } else {
                0
            };
            format!("{metres:.digits$}")
        })
    }
}
