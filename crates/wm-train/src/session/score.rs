//! Scores of held-out photos, and sums over steps.

use crate::trainer::{StepReport, StepTimes};
use serde_json::{Value, json};
use std::fmt;

/// Measures how different two images look, such as LPIPS with a network.
pub trait PerceptualMetric {
    /// Returns the shortest side that images may have, px.
    fn smallest_side(&self) -> u32;

    /// Returns the distance of a rendered image from its photo, both `[H, W, 3]`, 0-1,
    /// display-referred. Pixels that `mask`, `[H, W]`, leaves out count as equal.
    fn distance(&self, image: &[f32], photo: &[f32], mask: Option<&[f32]>, width: usize) -> f64;
}

/// The scores of one held-out photo.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HeldOutScore {
    /// Peak signal-to-noise ratio, dB.
    pub psnr: f64,
    /// Structural similarity, 1 for equal images.
    pub ssim: f64,
    /// LPIPS, where the session has a [`PerceptualMetric`]; only at the end.
    pub lpips: Option<f64>,
}

impl fmt::Display for HeldOutScore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.2} dB, SSIM {:.4}", self.psnr, self.ssim)?;
        self.lpips.map_or(Ok(()), |lpips| write!(f, ", LPIPS {lpips:.4}"))
    }
}

/// The scores of all held-out photos after a number of steps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeldOutScores {
    /// Steps that are done.
    pub step: u32,
    /// The number of splats.
    pub splats: usize,
    /// The name and score of each photo, without damaged ones.
    pub photos: Vec<(String, HeldOutScore)>,
}

impl HeldOutScores {
    /// Returns the mean over the photos; `None` if there are none.
    #[must_use]
    pub fn mean(&self) -> Option<HeldOutScore> {
        let count = self.photos.len() as f64;
        let mean = |of: fn(&HeldOutScore) -> Option<f64>| {
            Some(self.photos.iter().map(|(_, score)| of(score)).sum::<Option<f64>>()? / count)
        };
        let (psnr, ssim) = (mean(|score| Some(score.psnr))?, mean(|score| Some(score.ssim))?);
        (count > 0.0).then(|| HeldOutScore { psnr, ssim, lpips: mean(|score| score.lpips) })
    }

    /// Returns the line of the metrics; `None` without photos.
    pub(super) fn json(&self) -> Option<Value> {
        let mean = self.mean()?;
        let mut held_out = json!({ "psnr": mean.psnr, "ssim": mean.ssim });
        if let Some(lpips) = mean.lpips {
            held_out["lpips"] = json!(lpips);
        }
        Some(json!({ "step": self.step, "held_out": held_out, "splats": self.splats }))
    }
}

/// The result of a training beside its scene.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainReport {
    /// Steps of this session, without those before it was resumed.
    pub steps: u32,
    /// Wall time of these steps, seconds.
    pub seconds: f64,
    /// The times of the parts of a step, summed over these steps.
    pub times: StepTimes,
    /// The back end, in words.
    pub backend: String,
    /// Scores of the held-out photos at the end.
    pub held_out: HeldOutScores,
}

/// Sums over steps: all, and since the last summary.
#[derive(Default)]
pub(super) struct StepSums {
    pub(crate) times: StepTimes,
    since: StepTimes,
    steps: u32,
    loss: f64,
    terms: Vec<(&'static str, f64)>,
}

impl StepSums {
    pub(crate) fn add(&mut self, report: &StepReport) {
        self.times.add(&report.times);
        self.since.add(&report.times);
        self.steps += 1;
        self.loss += report.loss;
        for (name, value) in &report.terms {
            match self.terms.iter_mut().find(|(known, _)| known == name) {
                Some((_, sum)) => *sum += value,
                None => self.terms.push((name, *value)),
            }
        }
    }

    /// Returns the means since the last call.
    pub(crate) fn summary(&mut self, step: u32, splats: usize, held_out_psnr: Option<f64>) -> StepSummary {
        let mean = |sum: f64| sum / f64::from(self.steps.max(1));
        let terms = self.terms.iter().map(|(name, sum)| (*name, mean(*sum))).collect();
        let (loss, step_seconds) = (mean(self.loss), mean(self.since.total()));
        (self.since, self.steps, self.loss) = (StepTimes::default(), 0, 0.0);
        self.terms.clear();
        StepSummary { step, loss, terms, step_seconds, splats, held_out_psnr }
    }
}

impl StepSummary {
    /// Returns the line of the metrics.
    pub(super) fn json(&self) -> Value {
        let terms: serde_json::Map<String, Value> =
            self.terms.iter().map(|(name, value)| ((*name).to_owned(), json!(value))).collect();
        json!({
            "step": self.step, "loss": self.loss, "terms": terms, "splats": self.splats,
            "step_ms": self.step_seconds * 1e3
        })
    }
}

/// Means over the steps since the last summary.
#[derive(Clone, Debug, PartialEq)]
pub struct StepSummary {
    /// Steps that are done.
    pub step: u32,
    /// Mean loss.
    pub loss: f64,
    /// Mean values of the loss terms before weighting, by name.
    pub terms: Vec<(&'static str, f64)>,
    /// Mean time of a step, seconds.
    pub step_seconds: f64,
    /// The number of splats.
    pub splats: usize,
    /// PSNR of the held-out photos at the last evaluation, dB.
    pub held_out_psnr: Option<f64>,
}
