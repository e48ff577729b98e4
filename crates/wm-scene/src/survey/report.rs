//! A survey in words, one line a value.

use super::facts::Survey;
use super::sourced::{Confidence, FactSource, Sourced};
use super::up::{USUAL_UP, UpEstimate, UpScore};
use crate::Remark;
use crate::origin::text_of;
use glam::DVec3;
use std::fmt;

impl Survey {
    /// A line per value, with its source, for people.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let up = listed(self.up.value.to_array(), 3);
        let scale = self.metres_per_unit;
        let airlight = listed(self.airlight.value, 2);
        let light = match (self.airlight.source, self.sky_splats) {
            (FactSource::Estimated, 0) => "estimated from the brightest splats, as there is no sky".into(),
            (FactSource::Estimated, _) => "estimated from the sky near the horizon".into(),
            (source, _) => source.to_string(),
        };
        let sky = match self.sky_splats {
            0 => "sky: no splats of its own".into(),
            count => format!("sky: {count} splats"),
        };
        let mut lines = vec![
            format!("up: {up} ({})", origin(&self.up, &self.up_source)),
            match self.ground.source {
                FactSource::Assumed => {
                    format!(
                        "ground: none found; the lowest is {} units along up",
                        Decimal(self.world_ground(), 3)
                    )
                }
                _ => format!(
                    "ground: {} units along up ({})",
                    Decimal(self.world_ground(), 3),
                    origin(&self.ground, &None)
                ),
            },
            format!(
                "scale: 1 unit is {} m ({})",
                Decimal(scale.value, 4),
                origin(&scale, &self.scale_source)
            ),
            format!("size: {} m", self.size()),
            format!("airlight: {airlight} linear ({light})"),
            sky,
        ];
        if self.origin != DVec3::ZERO {
            lines.insert(0, format!("origin: {} (positions are kept relative to it)", text_of(self.origin)));
        }
        lines.extend(self.sun.as_ref().map(|sun| format!("sun: {}", sun.line())));
        lines.extend(self.sun_elevation.map(|elevation| {
            format!(
                "sun: {:.1} degrees high (from the time and the place of the photos; they do not tell north)",
                elevation.to_degrees()
            )
        }));
        lines.extend(self.sun_fault.map(|fault| format!("sun: not known: {fault}")));
        let reasons = self.up_estimate.iter().flat_map(|estimate| [estimate.reasons(), estimate.slopes()]);
        let up = lines.iter().position(|line| line.starts_with("up: ")).unwrap_or(0);
        lines.splice(up + 1..up + 1, reasons.flatten().collect::<Vec<_>>());
        lines
    }

    /// A warning if up is a guess: rain falls along it, and snow lies on what faces it.
    #[must_use]
    pub fn up_warning(&self) -> Option<String> {
        (self.up.confidence == Confidence::Guess).then(|| {
            let point = |v: DVec3| v.to_array().map(|v| Decimal(v, 3).to_string()).join(",");
            // As most programs write it, unless that is the guess.
            let rival = self.up_estimate.as_ref().and_then(|estimate| match estimate.rival {
                _ if self.up.value.dot(USUAL_UP) < 0.9 => Some(USUAL_UP),
                rival => rival.map(|(rival, _)| rival),
            });
            let rival = rival.map(|rival| format!(", it may be {}", point(rival)));
            format!(
                "up ({}) is a guess{}: rain and snow may fall the wrong way; look at a picture, and give --up if \
                 it is wrong",
                point(self.up.value),
                rival.unwrap_or_default()
            )
        })
    }

    /// A warning if no ground was found: on what then lies what falls.
    #[must_use]
    pub fn ground_warning(&self) -> Option<String> {
        (self.ground.source == FactSource::Assumed).then(|| {
            "no ground was found: snow and dust lie on what faces up and nowhere else; give --ground if the scene has one"
                .into()
        })
    }

    /// The doubts about the facts, and a note where there is no ground: objects have none.
    #[must_use]
    pub fn remarks(&self) -> Vec<Remark> {
        let up = self.up_warning().map(|text| Remark::doubt("up-guessed", text));
        let ground = self.ground_warning().map(|text| Remark::note("no-ground", text));
        let scale = self.warning().map(|text| Remark::doubt("scale-unknown", text));
        [up, ground, scale].into_iter().flatten().collect()
    }

    /// A line that names the facts that weather stands on and that are likely, not sure: such a
    /// fact may be some degrees, or a sixth of a length, off.
    #[must_use]
    pub fn likely_facts(&self) -> Option<String> {
        let is_likely = |confidence: Confidence| confidence == Confidence::Likely;
        let facts = [
            (self.up.confidence, "up"),
            (self.ground.confidence, "the height of the ground"),
            (self.metres_per_unit.confidence, "the scale"),
        ];
        let names: Vec<&str> =
            facts.into_iter().filter(|(known, _)| is_likely(*known)).map(|(_, name)| name).collect();
        (!names.is_empty()).then(|| {
            format!("likely, but not sure: {}; `inspect` says why, `align` sets them", names.join(", "))
        })
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
        // Two digits of the smallest say enough; a scene may be flat.
        let least = metres.into_iter().filter(|v| *v > 0.0).fold(99.0, f64::min);
        let decimals = (1.0 - least.max(1e-6).log10().floor()).max(0.0) as usize;
        let [length, width, height] = metres.map(|v| format!("{v:.decimals$}"));
        format!("{length} x {width} x {height}")
    }
}

/// The source of a fact and the confidence in it: "from the scene's metadata: a tape; likely".
pub(super) fn origin<T>(fact: &Sourced<T>, text: &Option<String>) -> String {
    let text = text.as_ref().map_or_else(String::new, |text| format!(": {text}"));
    match fact.source {
        FactSource::Given | FactSource::Assumed => fact.source.to_string(),
        source => format!("{source}{text}; {}", fact.confidence),
    }
}

impl UpEstimate {
    /// Why up is what it is, in one line: how far it leads before the next best direction, in nats.
    #[must_use]
    fn reasons(&self) -> Option<String> {
        let (rival, other) = self.rival?;
        let named = |score: &UpScore| {
            [score.ground, score.alone, score.open, score.thin, score.sky, score.cameras, score.prior]
        };
        let names = ["ground", "no ceiling", "open above", "wide", "sky", "cameras", "axis"];
        let (own, its) = (named(&self.evidence), named(&other));
        let parts: Vec<String> = (0..names.len())
            .map(|k| (names[k], own[k] - its[k]))
            .filter(|(_, lead)| lead.abs() >= 0.1)
            .map(|(name, lead)| format!("{name} {lead:+.1}"))
            .collect();
        let rival = listed(rival.to_array(), 3);
        let lead = self.evidence.sum() - other.sum();
        let parts = parts.join(", ");
        Some(match lead {
            0.0.. => format!("    before {rival} by {lead:.1} nats: {parts}"),
            _ => format!(
                "    as most programs write it; the splats hardly tell, {rival} leads by {:.1} nats",
                -lead
            ),
        })
    }

    /// Says by how much the ground falls and the walls lean, in one line; `None` where neither was
    /// found.
    fn slopes(&self) -> Option<String> {
        let ground = self.ground_normal.map(|normal| {
            let fall = normal.reject_from_normalized(self.up) / normal.dot(self.up);
            let towards = listed(fall.normalize_or_zero().to_array(), 2);
            match 100.0 * fall.length() {
                ..0.2 => "the ground is level".to_owned(),
                percent => format!("the ground falls by {percent:.1} % towards {towards}"),
            }
        });
        let walls = self
            .walls
            .map(|walls| format!("walls lean by {:.1} degrees", walls.angle_between(self.up).to_degrees()));
        let parts: Vec<String> = [ground, walls].into_iter().flatten().collect();
        (!parts.is_empty()).then(|| format!("    {}", parts.join("; ")))
    }
}

/// Three numbers of some decimals, such as "0, 0.5, 1".
pub(super) fn listed(numbers: [f64; 3], decimals: usize) -> String {
    numbers.map(|v| Decimal(v, decimals).to_string()).join(", ")
}

/// A number and the largest number of its decimals; prints without trailing zeros and without -0.
pub(super) struct Decimal(pub(super) f64, pub(super) usize);

impl fmt::Display for Decimal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = format!("{:.*}", self.1, self.0);
        let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
        f.write_str(if text == "-0" { "0" } else { text })
    }
}
