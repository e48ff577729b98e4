//! Units in words.

/// The quantity that a unit measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Quantity {
    Speed,
    Length,
    Rate,
    Temperature,
    Percent,
}

/// A number in a unit as SI, mm/h, degrees Celsius or a share.
pub(super) type Scale = fn(f64) -> f64;

/// Names of units for messages.
pub(super) const NAMES: &[&str] =
    &["m/s", "km/h", "mph", "kt", "knots", "bft", "km", "mi", "ft", "cm", "mm/h", "in/h", "metres", "miles"];

/// The unit of a name in small letters.
pub(super) fn unit(name: &str) -> Option<(Quantity, Scale)> {
    Some(match name {
        "m/s" | "mps" | "metres per second" | "meters per second" => (Quantity::Speed, |v| v),
        "km/h" | "kmh" | "kph" | "kilometres per hour" | "kilometers per hour" | "km per hour" => {
            (Quantity::Speed, |v| v / 3.6)
        }
        "mph" | "mi/h" | "miles per hour" => (Quantity::Speed, |v| v * 0.447_04),
        "kt" | "kts" | "kn" | "knot" | "knots" => (Quantity::Speed, |v| v * 0.514_444),
        // The scale's own law: 0.836 B^1.5.
        "bft" | "beaufort" => (Quantity::Speed, |v| 0.836 * v.max(0.0).powf(1.5)),
        "m" | "metre" | "metres" | "meter" | "meters" => (Quantity::Length, |v| v),
        "km" | "kilometre" | "kilometres" | "kilometer" | "kilometers" => (Quantity::Length, |v| 1000.0 * v),
        "mi" | "mile" | "miles" => (Quantity::Length, |v| 1609.344 * v),
        "ft" | "foot" | "feet" => (Quantity::Length, |v| 0.3048 * v),
        "yd" | "yards" => (Quantity::Length, |v| 0.9144 * v),
        "cm" | "centimetres" | "centimeters" => (Quantity::Length, |v| 0.01 * v),
        "in" | "inch" | "inches" => (Quantity::Length, |v| 0.0254 * v),
        "mm/h" | "mm/hr" | "mm per hour" => (Quantity::Rate, |v| v),
        "in/h" | "in/hr" | "inches per hour" => (Quantity::Rate, |v| 25.4 * v),
        "c" | "\u{b0}c" | "\u{b0}" | "celsius" | "degrees" | "degree" | "deg" | "degrees c"
        | "degrees celsius" | "deg c" => (Quantity::Temperature, |v| v),
        "f" | "\u{b0}f" | "fahrenheit" | "degrees f" | "degrees fahrenheit" | "deg f" => {
            (Quantity::Temperature, |v| (v - 32.0) / 1.8)
        }
        "%" | "percent" => (Quantity::Percent, |v| v / 100.0),
        _ => return None,
    })
}
