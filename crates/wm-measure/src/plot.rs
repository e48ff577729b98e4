//! Plots as SVG: points and lines over two axes with units, on white.
//!
//! By hand: it is one page of code, and what plotting crates add is more to build than the rest of
//! the report.

use std::fmt::Write;

/// Width and height, and the borders left, right, above and below the field, px.
const SIZE: [f64; 2] = [560.0, 340.0];
const LEFT_BORDER_PX: f64 = 66.0;
const RIGHT_BORDER_PX: f64 = 14.0;
const TOP_BORDER_PX: f64 = 34.0;
const BOTTOM_BORDER_PX: f64 = 50.0;
/// Colours of series that are told apart by all eyes (Okabe and Ito 2008, without yellow): after a
/// law channels have their own.
const COLORS: [&str; 6] = ["#0072b2", "#d55e00", "#009e73", "#56b4e9", "#cc79a7", "#e69f00"];
/// Ticks of an axis, about.
const TICK_COUNT: f64 = 6.0;

/// The spacing of numbers along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisScale {
    /// Linear.
    Linear,
    /// Logarithmic; values of 0 and below are left out.
    Log,
}

/// An axis of a plot.
#[derive(Clone, Debug)]
pub struct Axis {
    /// The quantity with its unit.
    pub label: String,
    /// The spacing.
    pub scale: AxisScale,
}

impl Axis {
    /// A linear axis; it begins at 0 unless all values are far from it.
    pub fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: AxisScale::Linear }
    }

    /// A logarithmic axis.
    pub fn log(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: AxisScale::Log }
    }
}

impl From<&str> for Axis {
    fn from(label: &str) -> Self {
        Self::linear(label)
    }
}

/// The marks of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SeriesStyle {
    /// A dot for each point.
    Points,
    /// A line.
    Line,
}

/// Points that belong together.
#[derive(Clone, Debug)]
pub struct Series {
    name: String,
    points: Vec<[f64; 2]>,
    style: SeriesStyle,
}

impl Series {
    /// A series drawn as dots.
    pub fn points(name: impl Into<String>, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.into(), points, style: SeriesStyle::Points }
    }

    /// A series drawn as a line.
    pub fn line(name: impl Into<String>, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.into(), points, style: SeriesStyle::Line }
    }
}

/// Points and lines over two axes.
#[derive(Clone, Debug)]
pub struct Plot {
    /// The title.
    pub title: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// The series, drawn in this order.
    pub series: Vec<Series>,
}

/// An axis with its ends and ticks.
struct Ruler {
    scale: AxisScale,
    /// The least and the greatest number of the scale: logarithms to base 10, or themselves.
    ends: [f64; 2],
    ticks: Vec<f64>,
}

impl Ruler {
    fn new(scale: AxisScale, values: impl Iterator<Item = f64>) -> Self {
        let known = values.filter(|v| v.is_finite() && (scale == AxisScale::Linear || *v > 0.0));
        let (low, high) = known.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        let (low, high) = if low <= high { (low, high) } else { (0.0, 1.0) };
        match scale {
            AxisScale::Linear => {
                // Zero belongs to it unless all is far from there.
                let low = if low > 0.0 && low < 0.6 * high { 0.0 } else { low };
                let span = if high > low { high - low } else { high.abs().max(1.0) };
                let rough = span / TICK_COUNT;
                let ten = 10f64.powf(rough.log10().floor());
                let step =
                    [1.0, 2.0, 2.5, 5.0, 10.0].map(|k| k * ten).into_iter().find(|step| *step >= rough);
                let step = step.unwrap_or(rough);
                let (first, last) = ((low / step).floor(), (high.max(low + 1e-9) / step).ceil());
                let ticks = (0..=(last - first) as i64).map(|k| (first + k as f64) * step).collect();
                Self { scale, ends: [first * step, last * step], ticks }
            }
            AxisScale::Log => {
                let (low, high) = if low > 0.0 { (low.log10(), high.log10()) } else { (0.0, 1.0) };
                let ends = [low - 0.04 * (high - low).max(0.3), high + 0.04 * (high - low).max(0.3)];
                let parts: &[f64] = if high - low < 2.5 { &[1.0, 2.0, 5.0] } else { &[1.0] };
                let decades = ends[0].floor() as i32..=ends[1].ceil() as i32;
                let ticks =
                    decades.flat_map(|decade| parts.iter().map(move |part| part * 10f64.powi(decade)));
                let is_in = |tick: &f64| (ends[0]..=ends[1]).contains(&tick.log10());
                Self { scale, ends, ticks: ticks.filter(is_in).collect() }
            }
        }
    }

    /// Returns the position of a number, 0-1 between the ends; `None` for one that the scale does
    /// not have.
    fn place(&self, value: f64) -> Option<f64> {
        let value = match self.scale {
            AxisScale::Linear => value,
            AxisScale::Log if value > 0.0 => value.log10(),
            AxisScale::Log => return None,
        };
        Some((value - self.ends[0]) / (self.ends[1] - self.ends[0])).filter(|place| place.is_finite())
    }
}

/// A number as short as it is told from its neighbours.
fn number(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-3..1e5).contains(&size) {
        return format!("{value:.0e}");
    }
    let text = format!("{value:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

impl Plot {
    /// Returns true if no series has a point.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.series.iter().all(|series| series.points.is_empty())
    }

    /// Returns the plot as an SVG document.
    #[must_use]
    pub fn svg(&self) -> String {
        let all =
            |k: usize| self.series.iter().flat_map(move |series| series.points.iter().map(move |p| p[k]));
        let (x, y) = (Ruler::new(self.x.scale, all(0)), Ruler::new(self.y.scale, all(1)));
        let [width, height] = SIZE;
        // A line of the legend for each series, beneath the axis.
        let legend = if self.series.len() > 1 { 18.0 * self.series.len() as f64 + 6.0 } else { 0.0 };
        let (right, bottom) = (width - RIGHT_BORDER_PX, height - BOTTOM_BORDER_PX);
        let across = |share: f64| LEFT_BORDER_PX + share * (right - LEFT_BORDER_PX);
        let up = |share: f64| bottom - share * (bottom - TOP_BORDER_PX);
        let whole = height + legend;
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {whole}\" role=\"img\" \
             font-family=\"system-ui, sans-serif\" font-size=\"12\" fill=\"#3a434c\">\n\
             <title>{title}</title>\n<rect width=\"{width}\" height=\"{whole}\" fill=\"#ffffff\"/>\n\
             <text x=\"{LEFT_BORDER_PX}\" y=\"20\" font-size=\"13.5\" font-weight=\"600\" fill=\"#1c2126\">{title}</text>\n",
            title = escaped(&self.title),
        );
        for tick in &x.ticks {
            let Some(place) = x.place(*tick).map(across) else { continue };
            let (text, below) = (number(*tick), bottom + 17.0);
            let _ = writeln!(
                out,
                "<path d=\"M{place:.1} {TOP_BORDER_PX}V{bottom}\" stroke=\"#e6e9ec\"/>\
                 <text x=\"{place:.1}\" y=\"{below}\" text-anchor=\"middle\">{text}</text>"
            );
        }
        for tick in &y.ticks {
            let Some(place) = y.place(*tick).map(up) else { continue };
            let (text, beside, middle) = (number(*tick), LEFT_BORDER_PX - 7.0, place + 4.0);
            let _ = writeln!(
                out,
                "<path d=\"M{LEFT_BORDER_PX} {place:.1}H{right}\" stroke=\"#e6e9ec\"/>\
                 <text x=\"{beside}\" y=\"{middle:.1}\" text-anchor=\"end\">{text}</text>"
            );
        }
        let _ = writeln!(
            out,
            "<path d=\"M{LEFT_BORDER_PX} {TOP_BORDER_PX}V{bottom}H{right}\" fill=\"none\" stroke=\"#8a949e\"/>\n\
             <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\n\
             <text transform=\"translate(15 {:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            0.5 * (LEFT_BORDER_PX + right),
            bottom + 38.0,
            escaped(&self.x.label),
            0.5 * (TOP_BORDER_PX + bottom),
            escaped(&self.y.label),
        );
        for (index, series) in self.series.iter().enumerate() {
            let color = COLORS[index % COLORS.len()];
            let places = series.points.iter().filter_map(|[a, b]| {
                let (a, b) = (x.place(*a)?, y.place(*b)?);
                let is_in = (-0.001..=1.001).contains(&a) && (-0.001..=1.001).contains(&b);
                is_in.then(|| (across(a), up(b)))
            });
            match series.style {
                SeriesStyle::Points => {
                    let (radius, opacity) = if series.points.len() > 100 { (1.6, 0.5) } else { (3.6, 0.9) };
                    let _ = write!(out, "<g fill=\"{color}\" fill-opacity=\"{opacity}\">");
                    places.for_each(|(x, y)| {
                        let _ = write!(out, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\"/>");
                    });
                    out.push_str("</g>\n");
                }
                SeriesStyle::Line => {
                    let path: Vec<String> = places.map(|(x, y)| format!("{x:.1} {y:.1}")).collect();
                    let path = path.join("L");
                    let _ = writeln!(
                        out,
                        "<path d=\"M{path}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.8\"/>"
                    );
                }
            }
            if legend > 0.0 {
                let line = height + 18.0 * index as f64 + 4.0;
                let mark = match series.style {
                    SeriesStyle::Points => format!(
                        "<circle cx=\"{}\" cy=\"{}\" r=\"3.6\" fill=\"{color}\"/>",
                        LEFT_BORDER_PX + 9.0,
                        line - 4.0
                    ),
                    SeriesStyle::Line => {
                        format!(
                            "<path d=\"M{LEFT_BORDER_PX} {y}h18\" stroke=\"{color}\" stroke-width=\"1.8\"/>",
                            y = line - 4.0
                        )
                    }
                };
                let _ = writeln!(
                    out,
                    "{mark}<text x=\"{}\" y=\"{line}\">{}</text>",
                    LEFT_BORDER_PX + 26.0,
                    escaped(&series.name)
                );
            }
        }
        out.push_str("</svg>\n");
        out
    }
}

/// Returns text with the characters `&<>"` replaced, so that it can stand anywhere in HTML and SVG.
#[must_use]
pub fn escaped(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut out, c| {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c => out.push(c),
        }
        out
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_no_markup() {
        assert_eq!(escaped("<b>\"a\" & b"), "&lt;b&gt;&quot;a&quot; &amp; b");
    }

    #[test]
    fn ticks_are_round_and_hold_what_there_is() {
        let ruler = Ruler::new(AxisScale::Linear, [3.0, 97.0].into_iter());
        assert_eq!((ruler.ends, ruler.ticks.len()), ([0.0, 100.0], 6));
        let ruler = Ruler::new(AxisScale::Log, [50.0, 1000.0, -1.0].into_iter());
        assert_eq!(ruler.ticks, [50.0, 100.0, 200.0, 500.0, 1000.0]);
        // One number, or none, is no division by 0.
        for values in [vec![5.0], vec![], vec![f64::NAN]] {
            for scale in [AxisScale::Linear, AxisScale::Log] {
                let ruler = Ruler::new(scale, values.iter().copied());
                assert!(ruler.ticks.len() < 20 && ruler.ends[0] < ruler.ends[1], "{values:?}");
            }
        }
        assert_eq!([0.0, 0.25, 1000.0, 2e6].map(number), ["0", "0.25", "1000", "2e6"]);
    }

    #[test]
    fn names_are_escaped_and_lines_stay_inside() {
        let plot = Plot {
            title: "a < b".into(),
            x: Axis::linear("x, m"),
            y: Axis::log("y"),
            series: vec![
                Series::line("law", vec![[0.0, 1.0], [1.0, 10.0], [2.0, 0.0]]),
                Series::points("seen", vec![[f64::NAN, 1.0], [1.0, 5.0]]),
            ],
        };
        let svg = plot.svg();
        assert!(svg.contains("a &lt; b") && !svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        assert_eq!(svg.matches("<circle").count(), 2);
    }
}
