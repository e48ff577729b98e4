//! Parameters as data: one table an effect, from which files, flags, help and documentation are
//! made.

use crate::image_file::ImageFile;
use std::fmt;

/// The value of a parameter at one instant.
#[derive(Clone, Debug, PartialEq)]
pub enum ParamValue {
    /// To be found from the scene or from other parameters.
    Auto,
    /// A number, in the parameter's unit.
    Number(f64),
    /// A colour, sRGB-encoded, 0-1.
    Color([f64; 3]),
    /// One of the words that the parameter takes.
    Word(&'static str),
    /// A picture.
    Image(ImageFile),
}

impl ParamValue {
    /// The number that it is, if it is one.
    #[must_use]
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Number(number) => Some(*number),
            _ => None,
        }
    }
}

/// A value that a program gives to a parameter ([`crate::Weather::set`]).
#[derive(Clone, Debug, PartialEq)]
pub enum ParamInput {
    /// A value.
    Value(ParamValue),
    /// A value or keyframes as they are written on the command line.
    Text(String),
}

impl From<f64> for ParamInput {
    fn from(number: f64) -> Self {
        Self::Value(ParamValue::Number(number))
    }
}

impl From<f32> for ParamInput {
    fn from(number: f32) -> Self {
        f64::from(number).into()
    }
}

impl From<i32> for ParamInput {
    fn from(number: i32) -> Self {
        f64::from(number).into()
    }
}

impl From<[f64; 3]> for ParamInput {
    fn from(color: [f64; 3]) -> Self {
        Self::Value(ParamValue::Color(color))
    }
}

impl From<&str> for ParamInput {
    fn from(text: &str) -> Self {
        Self::Text(text.into())
    }
}

impl From<String> for ParamInput {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

/// The type of value that a parameter takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParamKind {
    /// A number.
    Number,
    /// A number, or `auto`.
    NumberOrAuto,
    /// A colour, or `auto`.
    ColorOrAuto,
    /// One of these words.
    Word(&'static [&'static str]),
    /// The path of a picture, or `auto`.
    ImageOrAuto,
}

/// One parameter of an effect.
#[derive(Clone, Debug, PartialEq)]
pub struct Param {
    /// Name in files and flags.
    pub name: &'static str,
    /// The type of its value.
    pub kind: ParamKind,
    /// Default value.
    pub default: ParamValue,
    /// Least and greatest number.
    pub range: (f64, f64),
    /// Unit of the number; empty for none.
    pub unit: &'static str,
    /// Meaning in one or two sentences.
    pub meaning: &'static str,
}

impl Param {
    /// `value`, if this parameter takes it.
    ///
    /// # Errors
    /// The values it takes, to be put after the parameter's name.
    pub fn check(&self, value: ParamValue) -> Result<ParamValue, String> {
        match (self.kind, &value) {
            (ParamKind::Number | ParamKind::NumberOrAuto, ParamValue::Number(number)) => {
                let (least, greatest) = self.range;
                if *number >= least && *number <= greatest {
                    Ok(value)
                } else {
                    Err(format!("is {number}: must be {}", self.expected()))
                }
            }
            (ParamKind::NumberOrAuto | ParamKind::ColorOrAuto | ParamKind::ImageOrAuto, ParamValue::Auto)
            | (ParamKind::ImageOrAuto, ParamValue::Image(_)) => Ok(value),
            (ParamKind::Word(words), ParamValue::Word(word)) if words.contains(word) => Ok(value),
            (ParamKind::ColorOrAuto, ParamValue::Color(rgb))
                if rgb.iter().all(|c| (0.0..=1.0).contains(c)) =>
            {
                Ok(value)
            }
            _ => Err(format!("is {value}: must be {}", self.expected())),
        }
    }

    /// Returns the values that the parameter takes, in words.
    #[must_use]
    pub fn expected(&self) -> String {
        let (least, greatest) = self.range;
        let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
        let number = format!("a number from {least} to {greatest}{unit}");
        match self.kind {
            ParamKind::Number => number,
            ParamKind::NumberOrAuto => format!("{number}, or \"auto\""),
            ParamKind::ColorOrAuto => {
                "a colour as \"#rrggbb\" or three numbers 0-1 (sRGB), or \"auto\"".into()
            }
            ParamKind::Word(words) => format!("one of {}", words.join(", ")),
            ParamKind::ImageOrAuto => "the path of a picture, or \"auto\"".into(),
        }
    }

    /// Reads a value as it is written on the command line, and checks it.
    ///
    /// # Errors
    /// As [`Self::check`].
    pub fn parse(&self, text: &str) -> Result<ParamValue, String> {
        let wrong = || format!("is `{text}`: must be {}", self.expected());
        match self.kind {
            ParamKind::Word(words) => words
                .iter()
                .find(|word| **word == text.trim())
                .map(|word| ParamValue::Word(word))
                .ok_or_else(wrong),
            ParamKind::ImageOrAuto if text.trim().is_empty() => Err(wrong()),
            ParamKind::ImageOrAuto if text != "auto" => Ok(ParamValue::Image(ImageFile::at(text))),
            _ => self.check(text.parse().map_err(|()| wrong())?),
        }
    }
}

impl std::str::FromStr for ParamValue {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let text = text.trim();
        if text == "auto" {
            return Ok(Self::Auto);
        }
        if let Some(hex) = text.strip_prefix('#') {
            return color_of_hex(hex).ok_or(());
        }
        if let Ok(number) = text.parse::<f64>() {
            return if number.is_nan() { Err(()) } else { Ok(Self::Number(number)) };
        }
        let parts: Vec<f64> =
            text.split(',').map(|part| part.trim().parse()).collect::<Result<_, _>>().map_err(|_| ())?;
        Ok(Self::Color(parts.try_into().map_err(|_| ())?))
    }
}

fn color_of_hex(hex: &str) -> Option<ParamValue> {
    if hex.len() != 6 || !hex.bytes().all(|b| b.is_ascii_hexdigit()) {
        return None;
    }
    let byte = |k: usize| u8::from_str_radix(&hex[2 * k..2 * k + 2], 16).ok().map(|v| f64::from(v) / 255.0);
    Some(ParamValue::Color([byte(0)?, byte(1)?, byte(2)?]))
}

impl fmt::Display for ParamValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Number(number) => write!(f, "{number}"),
            Self::Color([r, g, b]) => write!(f, "{r},{g},{b}"),
            Self::Word(word) => f.write_str(word),
            Self::Image(picture) => write!(f, "{}", picture.path().display()),
        }
    }
}

/// Types that a field of a parameter struct may have.
pub(crate) trait ParamType: Sized {
    /// The kind of parameter.
    const KIND: ParamKind;

    /// The field's value; a checked [`ParamValue`] always has one.
    fn of(value: ParamValue) -> Self;
}

impl ParamType for f64 {
    const KIND: ParamKind = ParamKind::Number;

    fn of(value: ParamValue) -> Self {
        match value {
            ParamValue::Number(number) => number,
            _ => unreachable!("checked to be a number"),
        }
    }
}

impl ParamType for Option<f64> {
    const KIND: ParamKind = ParamKind::NumberOrAuto;

    fn of(value: ParamValue) -> Self {
        let ParamValue::Number(number) = value else { return None };
        Some(number)
    }
}

impl ParamType for Option<[f64; 3]> {
    const KIND: ParamKind = ParamKind::ColorOrAuto;

    fn of(value: ParamValue) -> Self {
        let ParamValue::Color(color) = value else { return None };
        Some(color)
    }
}

impl ParamType for Option<ImageFile> {
    const KIND: ParamKind = ParamKind::ImageOrAuto;

    fn of(value: ParamValue) -> Self {
        let ParamValue::Image(picture) = value else { return None };
        Some(picture)
    }
}

/// Declares what words a parameter takes: an enum with one variant each.
///
/// A variant reads `/// Meaning.`, then `Name = "word",`.
macro_rules! words {
    (
        $(#[doc = $about:literal])*
        enum $name:ident {$(
            $(#[doc = $meaning:literal])+
            $variant:ident = $word:literal,
        )*}
    ) => {
        $(#[doc = $about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(crate) enum $name {$(
            $(#[doc = $meaning])+
            $variant,
        )*}

        impl $crate::param::ParamType for $name {
            const KIND: $crate::param::ParamKind = $crate::param::ParamKind::Word(&[$($word),*]);

            fn of(value: $crate::param::ParamValue) -> Self {
                match value {
                    $($crate::param::ParamValue::Word($word) => Self::$variant,)*
                    _ => unreachable!("checked to be one of the words"),
                }
            }
        }
    };
}

/// Declares an effect's parameters: a struct with one field each, and the table `PARAMS` in the
/// same order.
///
/// A field reads `/// Meaning.`, then `name: type = default, least => greatest, "unit";`.
macro_rules! params {
    (
        $(#[doc = $about:literal])*
        struct $name:ident {$(
            $(#[doc = $meaning:literal])+
            $field:ident: $kind:ty = $default:expr, $least:expr => $greatest:expr, $unit:literal;
        )*}
    ) => {
        $(#[doc = $about])*
        #[derive(Clone, Debug, PartialEq)]
        pub(crate) struct $name {$(
            $(#[doc = $meaning])+
            pub(crate) $field: $kind,
        )*}

        impl $name {
            /// The table of parameters, in the order of the fields.
            pub(crate) const PARAMS: &'static [$crate::param::Param] = &[$(
                $crate::param::Param {
                    name: stringify!($field),
                    kind: <$kind as $crate::param::ParamType>::KIND,
                    default: $default,
                    range: ($least, $greatest),
                    unit: $unit,
                    meaning: concat!($($meaning),+),
                },
            )*];

            /// The parameters from values in the order of the table, each checked by its entry.
            pub(crate) fn of(values: &[$crate::param::ParamValue]) -> Self {
                let mut values = values.iter();
                Self {$(
                    $field: $crate::param::ParamType::of(values.next().expect("one value a parameter").clone()),
                )*}
            }
        }
    };
}

pub(crate) use {params, words};

/// `, did you mean ...`, if something is near enough.
pub(crate) fn meant<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> String {
    wm_base::nearest(name, known, 1)
        .first()
        .map_or_else(String::new, |near| format!(", did you mean `{near}`?"))
}

/// A text on one line.
pub(crate) fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENGTH: Param = Param {
        name: "mor",
        kind: ParamKind::NumberOrAuto,
        default: ParamValue::Auto,
        range: (1.0, f64::INFINITY),
        unit: "m",
        meaning: "",
    };
    const COLOR: Param = Param { kind: ParamKind::ColorOrAuto, name: "airlight", ..LENGTH };

    #[test]
    fn values_are_read_as_written() {
        assert_eq!(LENGTH.parse("120"), Ok(ParamValue::Number(120.0)));
        assert_eq!(LENGTH.parse("inf"), Ok(ParamValue::Number(f64::INFINITY)));
        assert_eq!(LENGTH.parse(" auto "), Ok(ParamValue::Auto));
        assert_eq!(COLOR.parse("#ff0080"), Ok(ParamValue::Color([1.0, 0.0, 128.0 / 255.0])));
        assert_eq!(COLOR.parse("0.1, 0.2,0.3"), Ok(ParamValue::Color([0.1, 0.2, 0.3])));
    }

    #[test]
    fn what_does_not_fit_is_said_with_what_does() {
        for (param, text, want) in [
            (LENGTH, "-5", "is -5: must be a number from 1 to inf m, or \"auto\""),
            (LENGTH, "nan", "is `nan`: must be a number from 1 to inf m, or \"auto\""),
            (LENGTH, "#ffffff", "is 1,1,1: must be a number from 1 to inf m, or \"auto\""),
            (
                COLOR,
                "#fffff",
                "is `#fffff`: must be a colour as \"#rrggbb\" or three numbers 0-1 (sRGB), or \"auto\"",
            ),
            (
                COLOR,
                "0,0,2",
                "is 0,0,2: must be a colour as \"#rrggbb\" or three numbers 0-1 (sRGB), or \"auto\"",
            ),
        ] {
            assert_eq!(param.parse(text).unwrap_err(), want);
        }
    }
}
