//! The formulas of a weather.

/// Whose formulas are used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fidelity {
    /// Physical units, linear light, each splat at its own ray length.
    #[default]
    Physical,
    /// The paper's formulas as they are printed.
    Paper,
}

impl Fidelity {
    /// Every fidelity.
    pub const ALL: [Self; 2] = [Self::Physical, Self::Paper];

    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Physical => "physical",
            Self::Paper => "paper",
        }
    }
}
