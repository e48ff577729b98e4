//! A survey in words, one line a value.

use super::{FactSource, Survey};
use std::fmt;

impl Survey {
    /// One line a value with its source, for people.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let [x, y, z] = self.up.value.to_array().map(|v| Short(v, 3));
        let scale = self.metres_per_unit;
        let [r, g, b] = self.airlight.value.map(|v| Short(v, 2));
        let light = match (self.airlight.source, self.sky_splats) {
            (FactSource::Estimated, 0) => "estimated from the brightest splats, as there is no sky".into(),
            (FactSource::Estimated, _) => "estimated from the sky near the horizon".into(),
            (source, _) => source.to_string(),
        };
        let sky = match self.sky_splats {
            0 => "sky: no splats of its own".into(),
            count => format!("sky: {count} splats"),
        };
        let from = self.scale_source.as_ref().map_or_else(String::new, |from| format!(": {from}"));
        vec![
            format!("up: {x}, {y}, {z} ({})", self.up.source),
            format!("ground: {} units along up ({})", Short(self.ground.value, 3), self.ground.source),
            format!("scale: 1 unit is {} m ({}{from})", Short(scale.value, 4), scale.source),
            format!("size: {} m", self.size()),
            format!("airlight: {r}, {g}, {b} linear ({light})"),
            sky,
        ]
    }

    /// A warning if nothing states the scale.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        (self.metres_per_unit.source == FactSource::Assumed).then(|| {
            format!(
                "scale is not known: 1 unit is taken as 1 m, which makes the scene {} m; give \
                 the metres per unit or a known distance (--metres-per-unit, --known-distance)",
                self.size()
            )
        })
    }

    /// Length, width and height in metres, such as "126 x 93 x 40".
    fn size(&self) -> String {
        let metres = self.extent.map(|v| v * self.metres_per_unit.value);
        // Two digits of the smallest say enough.
        let least = metres.into_iter().fold(f64::INFINITY, f64::min);
        let decimals = (1.0 - least.clamp(1e-6, 99.0).log10().floor()).max(0.0) as usize;
        let [length, width, height] = metres.map(|v| format!("{v:.decimals$}"));
        format!("{length} x {width} x {height}")
    }
}

/// A number and the largest number of its decimals; prints without trailing zeros and without -0.
struct Short(f64, usize);

impl fmt::Display for Short {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = format!("{:.*}", self.1, self.0);
        let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
        f.write_str(if text == "-0" { "0" } else { text })
    }
}
