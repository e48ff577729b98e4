//! What formats cannot hold: said before something is converted, and by `inspect`.

use crate::{Group, Metadata, Scene, sh};

/// What a format cannot hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loses {
    /// Highest SH degree that is kept.
    pub sh_degree: u8,
    /// What is part of the sky, of lying snow: [`Group`].
    pub groups: Kept,
    /// [`Metadata`].
    pub metadata: Kept,
    /// How numbers are rounded, with the largest error of each; empty if they are not.
    pub rounding: &'static str,
    /// Whether splats keep their order.
    pub order: Kept,
    /// Logarithms of scales that fit: smaller and larger ones become these.
    pub log_scales: [f32; 2],
}

/// Where a scale of any size fits.
pub const ANY_SCALE: [f32; 2] = [f32::NEG_INFINITY, f32::INFINITY];

/// Whether something comes back from a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kept {
    /// It does.
    Inside,
    /// From a file beside it.
    Beside,
    /// It does not.
    Not,
}

impl Loses {
    /// What every value comes back from.
    pub const NOTHING: Self = Self {
        sh_degree: 3,
        groups: Kept::Inside,
        metadata: Kept::Inside,
        rounding: "",
        order: Kept::Inside,
        log_scales: ANY_SCALE,
    };

    /// What no file of the format holds, a line each.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let mut lines = Vec::new();
        if self.sh_degree < sh::MAX_DEGREE {
            lines.push(format!("SH above degree {}", self.sh_degree));
        }
        if self.groups == Kept::Not {
            lines.push("what is sky or snow".into());
        }
        if self.metadata != Kept::Inside {
            lines.push("metadata (a .wm.toml beside it has it)".into());
        }
        if !self.rounding.is_empty() {
            lines.push(format!("what was rounded: {}", self.rounding));
        }
        lines
    }
}

/// What of `scene` is lost in a format, a line each.
#[must_use]
pub fn lost(loses: &Loses, scene: &Scene) -> Vec<String> {
    let mut lines = Vec::new();
    let splats = &scene.splats;
    if splats.sh_degree > loses.sh_degree {
        lines
            .push(format!("colour by direction: SH degree {} becomes {}", splats.sh_degree, loses.sh_degree));
    }
    let labelled = splats.groups.iter().filter(|group| **group != Group::Scene).count();
    if loses.groups == Kept::Not && labelled > 0 {
        lines.push(format!("the label of {labelled} splats of the sky or snow"));
    }
    if loses.metadata == Kept::Not && scene.metadata != Metadata::default() {
        lines.push("metadata".into());
    }
    let [least, most] = loses.log_scales;
    let outside = |scales: &&[f32; 3]| scales.iter().any(|v| *v < least || *v > most);
    let count = splats.log_scales.iter().filter(outside).count();
    if count > 0 {
        let (least, most) = (least.exp(), most.exp());
        lines.push(format!(
            "the size of {count} splats with an axis outside of {least:.1e} to {most:.0} units: another --scale may fit better"
        ));
    }
    if loses.order == Kept::Not {
        lines.push("the order of the splats".into());
    }
    if !loses.rounding.is_empty() {
        lines.push(format!("rounded: {}", loses.rounding));
    }
    lines
}
