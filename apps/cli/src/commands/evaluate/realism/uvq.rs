//! Scores of UVQ (Wang et al. 2021, "Rich features for perceptual quality assessment of UGC
//! videos") from its own program: its networks are not run here. The paper's score is
//! `compression_content_distortion` of version 1.0; version 1.5 is another network on another
//! scale, and its scores go into tables of their own.
//!
//! To run them here, three networks with the padding of another framework would have to agree to
//! the digit with the published ones.

use super::layout::WeatherClass;
use anyhow::{Context, Result, anyhow, bail};
use serde::Deserialize;
use std::fs;
use std::path::Path;

/// Longest file that is read, bytes.
const MAX_FILE_BYTES: u64 = 1 << 24;
/// The columns of a CSV file; the last one may be left out.
const COLUMNS: [&str; 5] = ["method", "weather", "scene", "uvq_1_0", "uvq_1_5"];
const SCORE_RANGE: std::ops::RangeInclusive<f64> = 1.0..=5.0;

/// The scores of a video.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct UvqScore {
    pub(crate) method: String,
    pub(crate) weather: WeatherClass,
    pub(crate) scene: String,
    /// Score of UVQ 1.0, 1 to 5.
    pub(crate) v1_0: Option<f64>,
    /// Score of UVQ 1.5.
    pub(crate) v1_5: Option<f64>,
}

/// The columns that are read from the output of the UVQ program.
#[derive(Deserialize)]
struct Published {
    video_name: String,
    compression_content_distortion: Option<f64>,
    uvq1p5_score: Option<f64>,
}

/// One video, or a list of them.
#[derive(Deserialize)]
#[serde(untagged)]
enum OneOrMore {
    One(Published),
    More(Vec<Published>),
}

/// Reads scores, CSV or JSON by the file's extension.
pub(crate) fn read(path: &Path) -> Result<Vec<UvqScore>> {
    let about = fs::metadata(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    if about.len() > MAX_FILE_BYTES {
        bail!("{}: is too long for scores; give the CSV or JSON file of them", path.display());
    }
    let text = fs::read(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let text = String::from_utf8(text)
        .map_err(|_| anyhow!("{}: is no text; give the CSV or JSON file of the scores", path.display()))?;
    let is_json = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    let scores = if is_json { from_json(&text) } else { from_csv(&text) };
    let scores = scores.map_err(|error| anyhow!("{}{error:#}", path.display()))?;
    if scores.is_empty() {
        bail!("{}: there is no score in it", path.display());
    }
    Ok(scores)
}

fn weather(name: &str) -> Result<WeatherClass> {
    WeatherClass::of(name)
        .ok_or_else(|| anyhow!("`{name}` is not a weather of the tables; write fog, rain or snow"))
}

fn checked(score: f64, whose: &str) -> Result<f64> {
    if !SCORE_RANGE.contains(&score) {
        bail!("{whose} {score} is not from 1 to 5, where scores of UVQ are; check it");
    }
    Ok(score)
}

fn from_csv(text: &str) -> Result<Vec<UvqScore>> {
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let heads = lines.next().map_or("", |(_, line)| line.trim_start_matches('\u{feff}'));
    let heads: Vec<&str> = heads.split(',').map(str::trim).collect();
    if heads != COLUMNS && heads != COLUMNS[..4] {
        bail!(", line 1: the columns are not {}, the last one of which may be left out", COLUMNS.join(","));
    }
    lines
        .map(|(index, line)| {
            row(line, heads.len()).map_err(|error| anyhow!(", line {}: {error:#}", index + 1))
        })
        .collect()
}

fn row(line: &str, columns: usize) -> Result<UvqScore> {
    let cells: Vec<&str> = line.split(',').map(str::trim).collect();
    if cells.len() != columns {
        bail!("{} columns, not {columns}; names have no commas in them", cells.len());
    }
    let number = |index: usize| -> Result<Option<f64>> {
        let Some(cell) = cells.get(index).filter(|cell| !cell.is_empty()) else { return Ok(None) };
        let number = cell.parse().map_err(|_| anyhow!("`{cell}` in {} is no number", COLUMNS[index]))?;
        checked(number, COLUMNS[index]).map(Some)
    };
    if cells[0].is_empty() || cells[2].is_empty() {
        bail!("the method or the scene has no name; give it one");
    }
    let (v1_0, v1_5) = (number(3)?, number(4)?);
    if v1_0.or(v1_5).is_none() {
        bail!("there is no score; leave the line out, or write one");
    }
    Ok(UvqScore { method: cells[0].into(), weather: weather(cells[1])?, scene: cells[2].into(), v1_0, v1_5 })
}

fn from_json(text: &str) -> Result<Vec<UvqScore>> {
    // The untagged list would hide where it is wrong.
    let _: serde_json::Value = serde_json::from_str(text).map_err(|error| anyhow!(": {error}"))?;
    let all: OneOrMore = serde_json::from_str(text).map_err(|_| {
        anyhow!(
            ": is no list of results of UVQ's program, each with video_name and a score; give what it writes"
        )
    })?;
    let all = match all {
        OneOrMore::One(one) => vec![one],
        OneOrMore::More(more) => more,
    };
    all.into_iter().map(|video| of_video(&video).map_err(|error| anyhow!(": {error:#}"))).collect()
}

fn of_video(video: &Published) -> Result<UvqScore> {
    let name = &video.video_name;
    let parts: Vec<&str> = name.split(['/', '\\']).collect();
    let [.., method, weather_name, file] = parts[..] else {
        bail!(
            "video_name `{name}` does not say whose it is; call videos METHOD/WEATHER/SCENE.mp4, or give a CSV file in place \
             of this one"
        );
    };
    let scene = file.rsplit_once('.').map_or(file, |(stem, _)| stem);
    let score = |score: Option<f64>, whose: &str| score.map(|score| checked(score, whose)).transpose();
    let v1_0 = score(video.compression_content_distortion, "compression_content_distortion")?;
    let v1_5 = score(video.uvq1p5_score, "uvq1p5_score")?;
    if v1_0.or(v1_5).is_none() {
        bail!("`{name}` has neither compression_content_distortion (UVQ 1.0) nor uvq1p5_score (UVQ 1.5)");
    }
    let weather = weather(weather_name).with_context(|| format!("video_name `{name}`"))?;
    Ok(UvqScore { method: method.into(), weather, scene: scene.into(), v1_0, v1_5 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scores_of_either_format() {
        let csv = "\u{feff}method,weather,scene,uvq_1_0,uvq_1_5\nours,haze,Garden,4.1,3.9\n\nours,snow,Garden,,3.5\n";
        let scores = from_csv(csv).unwrap();
        assert_eq!(scores.len(), 2);
        let first = UvqScore {
            method: "ours".into(),
            weather: WeatherClass::Fog,
            scene: "Garden".into(),
            v1_0: Some(4.1),
            v1_5: Some(3.9),
        };
        assert_eq!(scores[0], first);
        assert_eq!((scores[1].v1_0, scores[1].v1_5), (None, Some(3.5)));
        let json = r#"{"video_name": "out/ours/fog/Garden.mp4", "compression_content_distortion": 4.1, "content": 3.0}"#;
        let one = from_json(json).unwrap();
        assert_eq!(one, [UvqScore { v1_5: None, ..first }]);
        assert_eq!(from_json(&format!("[{json}, {json}]")).unwrap().len(), 2);
    }

    #[test]
    fn what_is_no_score_is_told_by_line() {
        let line = |text: &str| format!("{:#}", from_csv(text).unwrap_err());
        let with = |row: &str| line(&format!("method,weather,scene,uvq_1_0\n{row}"));
        for (found, says) in [
            (line(""), ", line 1: the columns are not method,weather,scene,uvq_1_0,uvq_1_5"),
            (with("ours,fog,Garden"), ", line 2: 3 columns, not 4"),
            (with("ours,hail,Garden,4"), ", line 2: `hail` is not a weather"),
            (with("ours,fog,Garden,x"), ", line 2: `x` in uvq_1_0 is no number"),
            (with("ours,fog,Garden,NaN"), ", line 2: uvq_1_0 NaN is not from 1 to 5"),
            (with("ours,fog,Garden,5.1"), ", line 2: uvq_1_0 5.1 is not from 1 to 5"),
            (with("ours,fog,,4"), ", line 2: the method or the scene has no name"),
            (with("ours,fog,Garden,"), ", line 2: there is no score"),
        ] {
            assert!(found.starts_with(says), "{found}");
        }
        let line = |text: &str| format!("{:#}", from_json(text).unwrap_err());
        for (found, says) in [
            (line("{"), ": EOF"),
            (line("[1]"), ": is no list of results"),
            (
                line(r#"{"video_name": "a.mp4", "uvq1p5_score": 3}"#),
                ": video_name `a.mp4` does not say whose",
            ),
            (
                line(r#"{"video_name": "a/b/c.mp4", "uvq1p5_score": 3}"#),
                ": video_name `a/b/c.mp4`: `b` is not a weather",
            ),
            (line(r#"{"video_name": "a/fog/c.mp4"}"#), ": `a/fog/c.mp4` has neither"),
            (
                line(r#"{"video_name": "a/fog/c.mp4", "uvq1p5_score": 9}"#),
                ": uvq1p5_score 9 is not from 1 to 5",
            ),
        ] {
            assert!(found.starts_with(says), "{found}");
        }
    }
}
