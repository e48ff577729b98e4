//! Units of depth maps, in words.

use super::map::{Map, Stored};
use std::fmt;
use std::str::FromStr;

/// The unit of a depth map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DepthUnit {
    /// So many metres, above 0.
    Metres(f64),
    /// A scene unit.
    SceneUnits,
}

impl DepthUnit {
    /// The unit of a map: the one that is given, else what the file says, else metres for floats;
    /// `None` for counts that do not say.
    #[must_use]
    pub fn of(given: Option<Self>, map: &Map) -> Option<Self> {
        let said = given.or(map.metres_per_step.map(Self::Metres));
        said.or_else(|| matches!(map.stored, Stored::Floats).then_some(Self::Metres(1.0)))
    }
}

impl FromStr for DepthUnit {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "m" => Ok(Self::Metres(1.0)),
            "cm" => Ok(Self::Metres(0.01)),
            "mm" => Ok(Self::Metres(0.001)),
            "units" => Ok(Self::SceneUnits),
            _ => match text.parse() {
                Ok(metres) if f64::is_finite(metres) && metres > 0.0 => Ok(Self::Metres(metres)),
                _ => Err(format!("`{text}` is no unit of depth: m, cm, mm, units, or metres a step above 0")),
            },
        }
    }
}

impl fmt::Display for DepthUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Metres(metres) => write!(f, "{metres} m"),
            Self::SceneUnits => write!(f, "1 scene unit"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_words_or_metres() {
        assert_eq!("mm".parse(), Ok(DepthUnit::Metres(0.001)));
        assert_eq!("0.25".parse(), Ok(DepthUnit::Metres(0.25)));
        assert_eq!("units".parse(), Ok(DepthUnit::SceneUnits));
        for bad in ["", "0", "-1", "nan", "inf", "miles"] {
            assert!(bad.parse::<DepthUnit>().is_err(), "{bad}");
        }
        let mut map = Map::new(1, 1, 1, vec![3.0]);
        assert_eq!(DepthUnit::of(None, &map), Some(DepthUnit::Metres(1.0)));
        map.stored = Stored::Counts(65535.0);
        assert_eq!(DepthUnit::of(None, &map), None);
        map.metres_per_step = Some(0.01);
        assert_eq!(DepthUnit::of(None, &map), Some(DepthUnit::Metres(0.01)));
        assert_eq!(DepthUnit::of(Some(DepthUnit::SceneUnits), &map), Some(DepthUnit::SceneUnits));
    }
}
