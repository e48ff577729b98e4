//! A page that shows what a set holds: pictures of some clips, counts, and how values are spread.

use super::plan::BatchPlan;
use crate::ClipInfo;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;
use wm_base::files::write_atomically;
use wm_image::jpeg::{SamplingFactor, encode};
use wm_place::{Error, Result};

/// The page.
pub const PAGE: &str = "summary.html";
/// Clips that are shown.
const MAX_SHOWN_CLIPS: u64 = 48;
/// Width of their pictures, px.
const THUMBNAIL_WIDTH_PX: u32 = 320;
/// Columns of a histogram.
const HISTOGRAM_COLUMNS: usize = 20;
/// Values of a variable that are kept for it.
const MAX_VALUES: usize = 1 << 16;

/// Returns true if the page shows a clip: some, evenly spread.
pub(crate) fn is_shown(clip: u64, clips: u64) -> bool {
    clips <= MAX_SHOWN_CLIPS || (clip * MAX_SHOWN_CLIPS) % clips < MAX_SHOWN_CLIPS
}

fn path_of(clip: u64) -> String {
    format!("summary/{clip:08}.jpg")
}

/// A small picture of a clip, and its file.
///
/// # Errors
/// [`Error::Unsupported`] if it cannot be encoded.
pub(crate) fn thumbnail(clip: u64, rgb: &[u8], width: u32, height: u32) -> Result<(String, Vec<u8>)> {
    let small = (THUMBNAIL_WIDTH_PX.min(width), (height * THUMBNAIL_WIDTH_PX.min(width) / width).max(1));
    let mut pixels = Vec::with_capacity((small.0 * small.1 * 3) as usize);
    for y in 0..small.1 {
        let rows = (y * height / small.1)..((y + 1) * height / small.1).max(y * height / small.1 + 1);
        for x in 0..small.0 {
            let columns = (x * width / small.0)..((x + 1) * width / small.0).max(x * width / small.0 + 1);
            for channel in 0..3 {
                let at = |x: u32, y: u32| u32::from(rgb[((y * width + x) * 3 + channel) as usize]);
                let sum: u32 = rows.clone().map(|y| columns.clone().map(|x| at(x, y)).sum::<u32>()).sum();
                pixels.push((sum / (rows.len() * columns.len()) as u32) as u8);
            }
        }
    }
    let bytes = encode(&pixels, small, 85, SamplingFactor::F_1_1)
        .map_err(|error| Error::Unsupported(error.to_string()))?;
    Ok((path_of(clip), bytes))
}

/// The counts and values that the page tells.
#[derive(Debug)]
pub(crate) struct SetSummary {
    title: String,
    clips: u64,
    shown: Vec<(u64, String)>,
    /// Clips by their condition, scene and split.
    counts: [BTreeMap<String, u64>; 3],
    variables: BTreeMap<String, Vec<f64>>,
}

impl SetSummary {
    /// Begins the summary of a plan with `clips` clips.
    pub(crate) fn new(plan: &BatchPlan, clips: u64) -> Self {
        Self {
            title: plan.name.clone(),
            clips,
            shown: Vec::new(),
            counts: Default::default(),
            variables: BTreeMap::new(),
        }
    }

    /// Counts a clip.
    pub(crate) fn add(&mut self, clip: &ClipInfo, variables: &BTreeMap<String, f64>) {
        let names = [clip.weather.condition.name(), &clip.place.name, &clip.split];
        for (counts, name) in self.counts.iter_mut().zip(names) {
            *counts.entry(name.into()).or_default() += 1;
        }
        for (name, value) in variables {
            let kept = self.variables.entry(name.clone()).or_default();
            if kept.len() < MAX_VALUES {
                kept.push(*value);
            }
        }
        if is_shown(clip.number, self.clips) {
            let weather = &clip.weather;
            let mut words = format!("{} · {}", clip.name, weather.condition.name());
            for (value, unit) in [
                (weather.mor, "m of visibility"),
                (weather.rain_rate, "mm/h of rain"),
                (weather.snow_rate, "mm/h of snow"),
            ] {
                if value > 0.0 && value.is_finite() {
                    let _ = write!(words, " · {value:.3} {unit}");
                }
            }
            self.shown.push((clip.number, words));
        }
    }

    /// Writes the page into the folder of the set.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(crate) fn write(&self, folder: &Path) -> Result<()> {
        let mut page = String::from(
            "<!doctype html><meta charset=\"utf-8\"><meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; \
             style-src 'unsafe-inline'; img-src data: file: http: https:\"><meta name=\"viewport\" content=\"width=device-width\">",
        );
        let _ = write!(
            page,
            "<title>{0}</title><style>body{{font:15px/1.5 system-ui,sans-serif;margin:2rem;max-width:84rem}}\
             figure{{display:inline-block;margin:0 .6rem .8rem 0;width:20rem;vertical-align:top}}img{{width:100%}}\
             figcaption{{font-size:.8rem;overflow-wrap:anywhere}}td,th{{text-align:left;padding:.1rem 1rem .1rem 0}}\
             @media(prefers-color-scheme:dark){{body{{background:#111;color:#ddd}}}}</style><h1>{0}</h1>",
            self.title
        );
        for (title, counts) in ["Weather", "Scene", "Split"].into_iter().zip(&self.counts) {
            let _ = write!(page, "<table><tr><th>{title}<th>Clips");
            for (name, count) in counts {
                let _ = write!(page, "<tr><td>{name}<td>{count}");
            }
            page.push_str("</table>");
        }
        for (name, values) in &self.variables {
            page.push_str(&histogram(name, values));
        }
        page.push_str("<h2>Clips</h2>");
        for (clip, words) in &self.shown {
            if folder.join(path_of(*clip)).exists() {
                let _ = write!(
                    page,
                    "<figure><img src=\"{}\" alt=\"\"><figcaption>{words}</figcaption></figure>",
                    path_of(*clip)
                );
            }
        }
        page.push('\n');
        Ok(write_atomically(&folder.join(PAGE), |out| Ok(out.write_all(page.as_bytes())?))?)
    }
}

/// A value with at most four decimals.
fn short(value: f64) -> String {
    let text = format!("{value:.4}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

/// A histogram of a variable, even in its logarithm where it spans more than a factor of 20.
fn histogram(name: &str, values: &[f64]) -> String {
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let clips = if values.len() == 1 { "1 clip".into() } else { format!("{} clips", values.len()) };
    if most <= least || values.is_empty() {
        return format!("<p><b>{name}</b> {} in {clips}</p>", short(least));
    }
    let is_log = least > 0.0 && most > 20.0 * least;
    let scaled = |value: f64| if is_log { value.ln() } else { value };
    let mut counts = [0u32; HISTOGRAM_COLUMNS];
    for value in values {
        let share = (scaled(*value) - scaled(least)) / (scaled(most) - scaled(least));
        counts[((share * HISTOGRAM_COLUMNS as f64) as usize).min(HISTOGRAM_COLUMNS - 1)] += 1;
    }
    let highest = f64::from(counts.iter().copied().max().unwrap_or(1).max(1));
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let mut text = format!(
        "<p><b>{name}</b> {} to {}, median {}, in {clips}{}<br><svg width=\"320\" height=\"48\" role=\"img\" \
         aria-label=\"histogram of {name}\">",
        short(least),
        short(most),
        short(sorted[sorted.len() / 2]),
        if is_log { ", logarithmic" } else { "" }
    );
    for (column, count) in counts.iter().enumerate() {
        let height = 46.0 * f64::from(*count) / highest;
        let _ = write!(
            text,
            "<rect x=\"{}\" y=\"{:.1}\" width=\"15\" height=\"{height:.1}\" fill=\"#4a7fb5\"/>",
            column * 16,
            48.0 - height
        );
    }
    text + "</svg></p>"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_have_at_most_four_decimals_and_one_clip_is_one() {
        assert_eq!(histogram("fog.mor", &[318.18638674104176]), "<p><b>fog.mor</b> 318.1864 in 1 clip</p>");
        assert_eq!(histogram("fog.mor", &[80.0, 80.0]), "<p><b>fog.mor</b> 80 in 2 clips</p>");
        let spread = histogram("temperature", &[-1.25, 0.1 + 0.2, 10.0]);
        assert!(spread.contains("</b> -1.25 to 10, median 0.3, in 3 clips<br>"), "{spread}");
    }
}
