//! A weather as the text of its file.

use crate::easing::Easing;
use crate::param::ParamValue;
use crate::track::{Keyframe, Track};
use crate::weather::{Fidelity, Weather};
use std::fmt::Write;

impl Weather {
    /// The text of a file that is read as this weather, but for the pictures, whose paths are
    /// written as they are. Values that are their defaults are left out.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let mut text = format!("name = {}\n", quoted(&self.name));
        if !self.about.is_empty() {
            line(&mut text, "about", &quoted(&self.about));
        }
        if self.fidelity != Fidelity::default() {
            line(&mut text, "fidelity", &quoted(self.fidelity.name()));
        }
        for (effect, tracks) in self.effects() {
            let _ = write!(text, "\n[{}]\n", effect.name);
            for (param, track) in effect.params.iter().zip(tracks) {
                if *track != Track::constant(param.default.clone()) {
                    line(&mut text, param.name, &track_text(track));
                }
            }
        }
        text
    }
}

fn line(text: &mut String, key: &str, value: &str) {
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{key} = {value}");
}

fn track_text(track: &Track) -> String {
    // A single key holds at all times, whatever its time and easing.
    if let [only] = track.keys() {
        return value(&only.value);
    }
    let is_word = |value: &ParamValue| matches!(value, ParamValue::Word(_));
    let key = |key: &Keyframe| {
        // Words hold without being told.
        let is_plain = key.easing == Easing::default() || is_word(&key.value);
        let easing = if is_plain { String::new() } else { format!(", {}", quoted(key.easing.name())) };
        format!("[{:?}, {}{easing}]", key.time, value(&key.value))
    };
    format!("{{ keys = [{}] }}", track.keys().iter().map(key).collect::<Vec<_>>().join(", "))
}

fn value(value: &ParamValue) -> String {
    match value {
        // With all its digits, and a point where it is whole.
        ParamValue::Number(number) => format!("{number:?}"),
        ParamValue::Color([r, g, b]) => match hex([*r, *g, *b]) {
            Some(hex) => quoted(&hex),
            None => format!("[{r:?}, {g:?}, {b:?}]"),
        },
        ParamValue::Auto | ParamValue::Word(_) | ParamValue::Image(_) => quoted(&value.to_string()),
    }
}

/// `#rrggbb`, where that is exactly the colour.
fn hex(rgb: [f64; 3]) -> Option<String> {
    let bytes = rgb.map(|v| (v * 255.0).round() as u8);
    let is_exact = bytes.map(|byte| f64::from(byte) / 255.0) == rgb;
    is_exact.then(|| format!("#{:02x}{:02x}{:02x}", bytes[0], bytes[1], bytes[2]))
}

/// A text as a basic string of TOML.
fn quoted(text: &str) -> String {
    let mut out = String::from("\"");
    for c in text.chars() {
        match c {
            '"' => out.push_str("\\\""),
            '\\' => out.push_str("\\\\"),
            c if c.is_control() => {
                let _ = write!(out, "\\u{:04X}", u32::from(c));
            }
            c => out.push(c),
        }
    }
    out.push('"');
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::presets::PRESETS;

    fn parsed_again(weather: &Weather) -> Weather {
        let text = weather.to_toml();
        Weather::parse(&text, "again").unwrap_or_else(|error| panic!("{error}:\n{text}"))
    }

    #[test]
    fn what_is_written_is_read() {
        for (name, _) in PRESETS {
            let weather = Weather::preset(name).unwrap();
            assert_eq!(parsed_again(&weather), weather, "{}", weather.to_toml());
        }
        let mut weather = crate::testing::weather([
            "fidelity=paper",
            "fog.mor=0:2000:smooth,5:60.1234567890123,7:1e-0:ease-in",
            "fog.scale_height=inf",
            "fog.airlight=#d5dadd",
            "fog.tint=0.1,0.2,0.30000000000000004",
            "sky.model=0:clear,5:overcast",
            "sky.panorama=sky of \"mine\".exr",
            "haze.visual_range=auto",
            "rain=on",
        ]);
        weather.name = "a \"b\" \\ \u{1}ä".into();
        assert_eq!(parsed_again(&weather), weather, "{}", weather.to_toml());
    }

    #[test]
    fn it_is_as_short_as_written_by_hand() {
        let mut weather = Weather::default();
        weather.name = "mine".into();
        weather.set_text("fog.mor=120").unwrap();
        weather.set_text("sky=overcast").unwrap();
        assert_eq!(
            weather.to_toml(),
            "name = \"mine\"\n\n[sky]\nmodel = \"overcast\"\n\n[fog]\nmor = 120.0\n"
        );
    }
}
