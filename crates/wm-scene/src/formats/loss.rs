//! The losses of formats, told before a conversion and by `inspect`.

use crate::{Group, Metadata, Scene, Splats, origin, sh};

/// The parts of a scene that a format keeps or loses.
#[derive(Clone, Copy, Debug)]
pub struct FormatLosses {
    /// Highest SH degree that is kept.
    pub(crate) sh_degree: u8,
    /// The group of each splat, such as sky and lying snow: [`Group`].
    pub(crate) groups: Retention,
    /// The label and the instance of each splat.
    pub labels: Retention,
    /// [`Metadata`].
    pub(crate) metadata: Retention,
    /// The rounding of numbers in words, with the largest error of each; empty if there is none.
    pub(crate) rounding: &'static str,
    /// The order of the splats.
    pub(crate) order: Retention,
    /// Logarithms of scales that fit: smaller and larger ones become these.
    pub(crate) log_scales: [f32; 2],
    /// Returns a line on positions of a scene that are in steps wider than its splats in a file of
    /// the format.
    pub(crate) coarse: fn(&Splats) -> Option<String>,
}

/// The positions of a format that has them as f32.
#[must_use]
pub(crate) fn coarse_floats(splats: &Splats) -> Option<String> {
    let step =
        |mean: [f32; 3]| mean.map(|v| origin::float_step(f64::from(v))).into_iter().fold(0.0, f64::max);
    origin::coarse_line(splats, step, "keep a local origin (--origin)")
}

/// The range of a format that holds scales of any size.
pub(crate) const ANY_SCALE: [f32; 2] = [f32::NEG_INFINITY, f32::INFINITY];

/// The place where a format keeps something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Retention {
    /// In the file itself.
    Inside,
    /// In a file beside it.
    Beside,
    /// Nowhere: it is lost.
    Not,
}

impl FormatLosses {
    /// A format that loses nothing.
    pub(crate) const NOTHING: Self = Self {
        sh_degree: 3,
        groups: Retention::Inside,
        labels: Retention::Inside,
        metadata: Retention::Inside,
        rounding: "",
        order: Retention::Inside,
        log_scales: ANY_SCALE,
        coarse: coarse_floats,
    };

    /// A packed format that holds splats and nothing about them.
    pub(crate) const SPLATS_ALONE: Self =
        Self { groups: Retention::Not, labels: Retention::Not, metadata: Retention::Beside, ..Self::NOTHING };

    /// The losses of every file of the format, a line each.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let mut lines = Vec::new();
        if self.sh_degree < sh::MAX_DEGREE {
            lines.push(format!("SH above degree {}", self.sh_degree));
        }
        if self.groups == Retention::Not {
            lines.push("which splats are sky or snow".into());
        }
        if self.labels == Retention::Not {
            lines.push("labels and instances of splats".into());
        }
        if self.metadata != Retention::Inside {
            lines.push("metadata (a .wm.toml beside it has it)".into());
        }
        if !self.rounding.is_empty() {
            lines.push(format!("what was rounded: {}", self.rounding));
        }
        lines
    }
}

/// The losses of `scene` in a format, a line each.
#[must_use]
pub fn lost(loses: &FormatLosses, scene: &Scene) -> Vec<String> {
    let mut lines = Vec::new();
    let splats = &scene.splats;
    if splats.sh_degree > loses.sh_degree {
        lines
            .push(format!("colour by direction: SH degree {} becomes {}", splats.sh_degree, loses.sh_degree));
    }
    let labelled = splats.groups.iter().filter(|group| **group != Group::Scene).count();
    if loses.groups == Retention::Not && labelled > 0 {
        lines.push(format!("the label of {labelled} splats of the sky or snow"));
    }
    if loses.labels == Retention::Not && !(splats.labels.is_empty() && splats.instances.is_empty()) {
        lines.push("labels and instances of the splats".into());
    }
    if loses.metadata == Retention::Not && scene.metadata != Metadata::default() {
        lines.push("metadata".into());
    }
    let [least, most] = loses.log_scales;
    let outside = |scales: &&[f32; 3]| scales.iter().any(|v| *v < least || *v > most);
    let count = splats.log_scales.iter().filter(outside).count();
    if count > 0 {
        let (least, most) = (least.exp(), most.exp());
        lines.push(format!(
            "the size of {count} splats with an axis outside of {least:.1e} to {most:.0} units: another scale may fit better (--scale)"
        ));
    }
    lines.extend((loses.coarse)(splats));
    if loses.order == Retention::Not {
        lines.push("the order of the splats".into());
    }
    if !loses.rounding.is_empty() {
        lines.push(format!("rounded: {}", loses.rounding));
    }
    lines
}
