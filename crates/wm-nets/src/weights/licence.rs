//! Under what published weights may be used.

use std::fmt;

/// A licence of published weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Licence {
    /// Any use.
    Apache2,
    /// Any use.
    Mit,
    /// No commercial use, and the authors are to be named.
    CcByNc4,
}

impl Licence {
    /// Returns the SPDX identifier.
    #[must_use]
    pub const fn spdx(self) -> &'static str {
        match self {
            Self::Apache2 => "Apache-2.0",
            Self::Mit => "MIT",
            Self::CcByNc4 => "CC-BY-NC-4.0",
        }
    }
}

impl fmt::Display for Licence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let says = match self {
            Self::Apache2 | Self::Mit => "any use",
            Self::CcByNc4 => "no commercial use; the authors are to be named",
        };
        write!(f, "{} ({says})", self.spdx())
    }
}
