//! The scores of a report: one list that the table, the JSON file and the page are made from.

use super::args::EvaluateArgs;
use crate::dataset::Dataset;
use crate::names::stem_of;
use serde_json::{Map, Value, json};
use std::path::Path;
use weather_magician::train::evaluation::{
    Evaluation, ExposureFit, PhotoScores, TruthFolder, TruthMaps, ViewScores,
};
use weather_magician::train::metrics::FloaterShare;

/// A column of scores, one number per photo.
pub(crate) struct ScoreColumn {
    /// The name in JSON.
    pub(crate) key: &'static str,
    /// The name in one line.
    pub(crate) name: &'static str,
    /// The name in tables, in two lines.
    pub(crate) head: [&'static str; 2],
    /// Unit and format.
    pub(crate) unit: ScoreUnit,
    /// The tables in which it is shown.
    pub(crate) place: Placement,
    /// Definition of the score.
    pub(crate) what: &'static str,
    of: fn(&ViewScores) -> Option<f64>,
}

/// Unit and format of a score.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ScoreUnit {
    /// No unit; four decimals.
    Plain,
    /// dB.
    Decibels,
    /// Degrees.
    Degrees,
    /// A fraction as percent.
    Percent,
}

/// The tables in which a score is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Placement {
    /// Also in the tables.
    Table,
    /// Only in the means and the JSON file.
    Means,
}

use Placement::{Means, Table};
use ScoreUnit::{Decibels, Degrees, Percent, Plain};

/// All numbers of a photo, in their order.
#[rustfmt::skip]
pub(crate) const COLUMNS: [ScoreColumn; 18] = [
    ScoreColumn { key: "psnr", name: "PSNR", head: ["PSNR", "dB"], unit: Decibels, place: Table, of: |s| Some(s.psnr),
        what: "peak signal-to-noise ratio of the render against the photo, dB; higher is better" },
    ScoreColumn { key: "ssim", name: "SSIM", head: ["", "SSIM"], unit: Plain, place: Table, of: |s| Some(s.ssim),
        what: "structural similarity, 1 for equal pictures" },
    ScoreColumn { key: "sharpness", name: "sharpness", head: ["sharp-", "ness"], unit: Plain, place: Table, of: |s| s.sharpness,
        what: "mean gradient of the render over that of the photo; below 1 the render is smoother" },
    ScoreColumn { key: "depth_abs_rel", name: "depth AbsRel", head: ["depth", "AbsRel"], unit: Plain, place: Table, of: |s| Some(s.expected_depth?.abs_rel),
        what: "mean of |depth - truth| / truth over true surfaces, expected depth; a pixel without depth counts as 1" },
    ScoreColumn { key: "depth_delta", name: "depth < 1.25", head: ["<1.25", "%"], unit: Percent, place: Table, of: |s| Some(s.expected_depth?.delta),
        what: "share of true surfaces whose expected depth is within a factor of 1.25" },
    ScoreColumn { key: "depth_median_rel", name: "depth, median error", head: ["", "median"], unit: Plain, place: Table, of: |s| Some(s.expected_depth?.median_rel),
        what: "median of |depth - truth| / truth, expected depth" },
    ScoreColumn { key: "depth_missing", name: "no depth", head: ["none", "%"], unit: Percent, place: Means, of: |s| Some(s.expected_depth?.missing),
        what: "share of true surfaces without expected depth" },
    ScoreColumn { key: "median_depth_abs_rel", name: "median depth AbsRel", head: ["median depth", "AbsRel"], unit: Plain, place: Table, of: |s| Some(s.median_depth?.abs_rel),
        what: "as above, of median depth: that of the splat at which the coverage passes one half" },
    ScoreColumn { key: "median_depth_delta", name: "median depth < 1.25", head: ["<1.25", "%"], unit: Percent, place: Table, of: |s| Some(s.median_depth?.delta),
        what: "share within a factor of 1.25, median depth" },
    ScoreColumn { key: "median_depth_median_rel", name: "median depth, median error", head: ["", "median"], unit: Plain, place: Table, of: |s| Some(s.median_depth?.median_rel),
        what: "median of |depth - truth| / truth, median depth" },
    ScoreColumn { key: "median_depth_missing", name: "no median depth", head: ["none", "%"], unit: Percent, place: Means, of: |s| Some(s.median_depth?.missing),
        what: "share of true surfaces without median depth" },
    ScoreColumn { key: "normal_mean", name: "normals, mean angle", head: ["normal", "mean deg"], unit: Degrees, place: Table, of: |s| Some(s.normal?.mean),
        what: "mean angle between rendered and true normal, degrees; a pixel without normal counts as 90" },
    ScoreColumn { key: "normal_median", name: "normals, median angle", head: ["", "median"], unit: Degrees, place: Table, of: |s| Some(s.normal?.median),
        what: "median angle between rendered and true normal, degrees" },
    ScoreColumn { key: "normal_missing", name: "no normal", head: ["none", "%"], unit: Percent, place: Means, of: |s| Some(s.normal?.missing),
        what: "share of true surfaces without normal" },
    ScoreColumn { key: "sky_covered", name: "sky covered", head: ["sky", "covered %"], unit: Percent, place: Table, of: |s| s.sky_covered,
        what: "share of the true sky that splats other than the sky's cover by more than a half" },
    ScoreColumn { key: "surface_lost", name: "surface lost", head: ["surface", "lost %"], unit: Percent, place: Table, of: |s| Some(s.surface_lost?.lost()),
        what: "share of true surfaces that are open or behind, without the sky's splats" },
    ScoreColumn { key: "surface_open", name: "surface open", head: ["open", "%"], unit: Percent, place: Means, of: |s| Some(s.surface_lost?.open),
        what: "share of true surfaces that are covered by less than a half" },
    ScoreColumn { key: "surface_behind", name: "surface behind", head: ["behind", "%"], unit: Percent, place: Means, of: |s| Some(s.surface_lost?.behind),
        what: "share of true surfaces whose median depth lies more than 5 % behind them" },
];

impl ScoreColumn {
    /// Returns the number of a photo; `None` if it is unknown or infinite.
    pub(crate) fn of(&self, scores: &ViewScores) -> Option<f64> {
        (self.of)(scores).filter(|value| value.is_finite())
    }

    /// Formats the number; a dash for none.
    pub(crate) fn text(&self, value: Option<f64>) -> String {
        match (value, self.unit) {
            (None, _) => "-".into(),
            (Some(value), Plain) => format!("{value:.4}"),
            (Some(value), Decibels | Degrees) => format!("{value:.2}"),
            (Some(value), Percent) => format!("{:.2}", 100.0 * value),
        }
    }

    /// Formats the number with its unit.
    pub(crate) fn full_text(&self, value: Option<f64>) -> String {
        // Not to be broken before the sign.
        let sign = match self.unit {
            _ if value.is_none() => "",
            Plain => "",
            Decibels => "\u{a0}dB",
            Degrees => "\u{b0}",
            Percent => "\u{a0}%",
        };
        self.text(value) + sign
    }
}

/// All scores of a scene.
pub(crate) struct EvaluationReport {
    pub(crate) scene: String,
    pub(crate) dataset: String,
    /// Description of the chosen photos.
    pub(crate) selection: String,
    /// The ground truth.
    pub(crate) truth: TruthMaps,
    /// The scores of each photo.
    pub(crate) views: Vec<PhotoScores>,
    /// Splats in front of true surfaces.
    pub(crate) floaters: Option<FloaterShare>,
    args: EvaluateArgs,
}

impl EvaluationReport {
    pub(crate) fn new(args: &EvaluateArgs, data: &Dataset, truth: TruthMaps, evaluation: Evaluation) -> Self {
        let Evaluation { photos: views, floaters } = evaluation;
        let (count, all) = (views.len(), data.capture.views.len());
        let selection = match args.photos.held_out.eval_every {
            0 => format!(
                "all {count} photos, including those that the scene was trained on (--eval-every selects the held-out ones)"
            ),
            every => format!(
                "{count} of {all} photos, every {every} from {}",
                args.photos.held_out.eval_from % every
            ),
        };
        let (scene, dataset) = (name_of(&args.scene().scene), name_of(args.dataset()));
        Self { scene, dataset, selection, truth, views, floaters, args: args.clone() }
    }

    /// Returns the mean of a column over the photos that have it.
    pub(crate) fn mean(&self, column: &ScoreColumn) -> Option<f64> {
        let values: Vec<f64> = self.views.iter().filter_map(|view| column.of(&view.scores)).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    }

    /// Returns the columns that at least one photo has.
    pub(crate) fn columns(&self, place: Option<Placement>) -> impl Iterator<Item = &'static ScoreColumn> {
        let is_shown = move |column: &&ScoreColumn| place.is_none_or(|place| column.place == place);
        COLUMNS.iter().filter(is_shown).filter(|column| self.mean(column).is_some())
    }

    /// Returns the notes above the scores, one per line.
    pub(crate) fn notes(&self) -> Vec<String> {
        let mut notes = vec![format!("{} against {}: {}", self.scene, self.dataset, self.selection)];
        if self.args.photos.exposure_fit == ExposureFit::Affine {
            notes.push("The colours of each render are fitted to its photo.".into());
        }
        let TruthMaps { depth, normal, sky, metres_per_unit, scale_source, .. } = &self.truth;
        for (kind, folder) in [("depth", depth), ("normals", normal), ("sky", sky)] {
            if let Some(TruthFolder { folder, holds, photos, missing }) = folder {
                let of = if missing.is_empty() { String::new() } else { format!(", of {photos} photos") };
                notes.push(format!("True {kind}: {} ({holds}){of}", folder.display()));
            }
        }
        if depth.is_some() {
            notes.push(format!("Scale: {metres_per_unit} m a scene unit, {scale_source}; nothing is fitted"));
        }
        notes
    }

    /// Describes the floaters.
    pub(crate) fn floaters(&self) -> Option<String> {
        let found = self.floaters?;
        Some(format!(
            "{:.2} % of splats in view hang in front of the true surface ({} of {}), {:.2} % by opacity and area",
            100.0 * found.share(),
            found.floaters,
            found.splats,
            100.0 * found.weighted
        ))
    }

    /// Returns everything as JSON, as described in `docs/guide/evaluate.md`.
    pub(crate) fn json(&self) -> Value {
        let numbers = |of: &dyn Fn(&ScoreColumn) -> Option<f64>| -> Map<String, Value> {
            COLUMNS.iter().filter_map(|column| Some((column.key.to_owned(), json!(of(column)?)))).collect()
        };
        let view = |view: &PhotoScores| {
            let mut object = json!({ "name": view.name, "width": view.width, "height": view.height });
            if let Value::Object(object) = &mut object {
                object.extend(numbers(&|column| column.of(&view.scores)));
            }
            object
        };
        let floaters = self.floaters.map(|found| {
            json!({
                "splats": found.splats, "floaters": found.floaters, "share": found.share(), "weighted": found.weighted
            })
        });
        let TruthMaps { depth, normal, sky, metres_per_unit, scale_source, .. } = &self.truth;
        json!({
            "scene": self.args.scene().scene.display().to_string(),
            "dataset": self.args.dataset().display().to_string(),
            "selection": { "every": self.args.photos.held_out.eval_every, "from": self.args.photos.held_out.eval_from },
            "exposure_fit": self.args.photos.exposure_fit,
            "metres_per_unit": metres_per_unit,
            "scale_source": scale_source.to_string(),
            "truth": { "depth": depth, "normal": normal, "sky": sky },
            "mean": numbers(&|column| self.mean(column)),
            "floaters": floaters,
            "photos": self.views.iter().map(view).collect::<Vec<_>>(),
        })
    }
}

/// Returns the name of a scene or a data set in a report.
fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(|| stem_of(path), |name| name.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_is_in_the_documentation() {
        const DOCUMENTATION: &str = include_str!("../../../../../docs/guide/evaluate.md");
        for column in &COLUMNS {
            assert!(
                DOCUMENTATION.contains(&format!("`{}`", column.key)),
                "{} is not in docs/guide/evaluate.md",
                column.key
            );
        }
    }

    #[test]
    fn an_infinite_ratio_is_left_out() {
        let scores = ViewScores { psnr: f64::INFINITY, ..ViewScores::default() };
        assert_eq!((COLUMNS[0].of(&scores), COLUMNS[3].of(&scores)), (None, None));
        assert_eq!(COLUMNS[0].full_text(Some(20.0)), "20.00\u{a0}dB");
        assert_eq!(COLUMNS[4].text(Some(0.5)), "50.00");
    }
}
