//! The tables, from one list of numbers: Markdown for people, CSV and JSON for programs.

use super::layout::WeatherClass;
use super::published;
use super::uvq::UvqScore;
use crate::report::csv_line;
use serde_json::{Value, json};
use std::fmt::Write as _;
use weather_magician::train::metrics::{Cmmd, Collection};

/// The CMMD of a collection from photographs of real weather.
#[derive(Clone, Debug)]
pub(crate) struct CmmdDistance {
    pub(crate) method: String,
    pub(crate) weather: Option<WeatherClass>,
    /// `None` for all of a method's pictures of that weather.
    pub(crate) scene: Option<String>,
    cmmd: Cmmd,
    /// Number of pictures of the method.
    pub(crate) rendered: usize,
    /// Number of photographs.
    pub(crate) real: usize,
}

impl CmmdDistance {
    /// Computes the distance.
    pub(crate) fn new(
        method: String,
        weather: Option<WeatherClass>,
        scene: Option<String>,
        pictures: &Collection,
        photographs: &Collection,
    ) -> Self {
        let cmmd = pictures.cmmd(photographs);
        let [rendered, real] = [pictures, photographs].map(|collection| collection.embeddings().count());
        Self { method, weather, scene, cmmd, rendered, real }
    }
}

/// Everything that was measured or read.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tables {
    pub(crate) distances: Vec<CmmdDistance>,
    pub(crate) scores: Vec<UvqScore>,
    /// True if the paper's tables are made.
    pub(crate) paper: bool,
}

/// The text in place of a missing number.
const NONE: &str = "-";

impl Tables {
    /// Returns all tables as Markdown.
    pub(crate) fn markdown(&self) -> String {
        let mut parts = Vec::new();
        if self.paper && !self.distances.is_empty() {
            parts.push(self.cmmd_by_weather());
        }
        if !self.distances.is_empty() {
            parts.push(self.cmmd_by_collection());
        }
        if self.scores.iter().any(|score| score.v1_0.is_some()) {
            parts.push(self.uvq(
                |score| score.v1_0,
                true,
                "UVQ 1.0, `compression_content_distortion`, 1 to 5; higher is better. Figures of the paper (Table III) and \
                 scores that were given.",
            ));
        }
        if self.scores.iter().any(|score| score.v1_5.is_some()) {
            parts.push(self.uvq(
                |score| score.v1_5,
                false,
                "UVQ 1.5: another network on another scale, not to be compared with UVQ 1.0.",
            ));
        }
        parts.join("\n")
    }

    /// Returns Table II.
    fn cmmd_by_weather(&self) -> String {
        let mut out = "CMMD against photographs of real weather; lower is nearer. Figures of the paper (Table II: its own \
                       renders, scenes and photographs) and those measured here.\n\n"
            .to_owned();
        let mut head = vec!["Method".to_owned()];
        head.extend(WeatherClass::ALL.map(|weather| weather.title().to_owned()));
        head.push("Source".into());
        let mut rows: Vec<Vec<String>> = published::CMMD
            .iter()
            .map(|(method, values)| {
                let values = values.map(|value| value.map_or(NONE.into(), |value| format!("{value:.2}")));
                [vec![escaped(method)], values.to_vec(), vec!["paper".into()]].concat()
            })
            .collect();
        let mut methods: Vec<&str> = Vec::new();
        for distance in &self.distances {
            if !methods.contains(&distance.method.as_str()) {
                methods.push(&distance.method);
            }
        }
        for method in methods {
            let value = |weather: WeatherClass| {
                let is_it =
                    |d: &&CmmdDistance| d.method == method && d.weather == Some(weather) && d.scene.is_none();
                self.distances.iter().find(is_it).map_or(NONE.into(), |d| format!("{:.2}", d.cmmd.value))
            };
            rows.push(
                [vec![escaped(method)], WeatherClass::ALL.map(value).to_vec(), vec!["measured".into()]]
                    .concat(),
            );
        }
        table(&mut out, &head, &rows);
        out
    }

    /// Returns a table with one row per collection.
    fn cmmd_by_collection(&self) -> String {
        let mut out = "CMMD by collection. Bias is what the value has in it since the collections are small: two of these \
                       sizes that show the same are about that far apart.\n\n"
            .to_owned();
        let mut head = vec!["CMMD", "Bias", "Pictures", "Photographs"];
        if self.paper {
            head.splice(0..0, ["Method", "Weather", "Scene"]);
        } else {
            head.insert(0, "Pictures of");
        }
        let row = |distance: &CmmdDistance| {
            let mut cells = vec![escaped(&distance.method)];
            if self.paper {
                cells.push(distance.weather.map_or(NONE, WeatherClass::name).into());
                cells.push(distance.scene.as_deref().map_or("all".into(), escaped));
            }
            let Cmmd { value, bias } = distance.cmmd;
            let numbers = [format!("{value:.4}"), format!("{bias:.4}")];
            cells
                .into_iter()
                .chain(numbers)
                .chain([distance.rendered, distance.real].map(|n| n.to_string()))
                .collect()
        };
        let rows: Vec<Vec<String>> = self.distances.iter().map(row).collect();
        table(&mut out, &head.into_iter().map(str::to_owned).collect::<Vec<_>>(), &rows);
        out
    }

    /// Returns Table III, one table per weather: a row per scene, a column per method; with the
    /// paper's scores if they are of the same version.
    fn uvq(&self, of: fn(&UvqScore) -> Option<f64>, is_of_paper: bool, title: &str) -> String {
        let mut out = format!("{title}\n");
        for weather in WeatherClass::ALL {
            let given: Vec<(&UvqScore, f64)> = self
                .scores
                .iter()
                .filter(|score| score.weather == weather)
                .filter_map(|score| Some((score, of(score)?)))
                .collect();
            if given.is_empty() {
                continue;
            }
            let paper: Vec<_> =
                published::uvq().filter(|(_, of, ..)| is_of_paper && *of == weather).collect();
            let mut methods: Vec<(&str, bool)> = Vec::new();
            let mut scenes: Vec<&str> = Vec::new();
            let all = paper.iter().map(|(scene, _, method, _)| (*method, *scene, true));
            let all = all
                .chain(given.iter().map(|(score, _)| (score.method.as_str(), score.scene.as_str(), false)));
            for (method, scene, is_paper) in all {
                if !methods.contains(&(method, is_paper)) {
                    methods.push((method, is_paper));
                }
                if !scenes.iter().any(|other| same_scene(other, scene)) {
                    scenes.push(scene);
                }
            }
            let mut head = vec![weather.title().to_owned()];
            head.extend(methods.iter().map(|(method, is_paper)| {
                format!("{}{}", escaped(method), if *is_paper { " (paper)" } else { "" })
            }));
            let rows = scenes.iter().map(|scene| {
                let cell = |(method, is_paper): &(&str, bool)| {
                    let value = if *is_paper {
                        paper.iter().find(|(s, _, m, _)| s == scene && m == method).map(|(.., value)| *value)
                    } else {
                        let is_it = |(score, _): &&(&UvqScore, f64)| {
                            score.method == *method && same_scene(&score.scene, scene)
                        };
                        given.iter().find(is_it).map(|(_, value)| *value)
                    };
                    value.map_or(NONE.into(), |value| format!("{value:.2}"))
                };
                [vec![escaped(scene)], methods.iter().map(cell).collect()].concat()
            });
            out.push('\n');
            table(&mut out, &head, &rows.collect::<Vec<_>>());
        }
        out
    }

    /// Returns a CSV file with one number per line.
    pub(crate) fn csv(&self) -> String {
        let mut out = "metric,source,method,weather,scene,value,bias,pictures,photographs\n".to_owned();
        let mut line = |cells: [&str; 5], value: f64, rest: Option<(f64, usize, usize)>| {
            let cells = csv_line(&cells);
            let rest = rest.map_or(",,".into(), |(bias, pictures, real)| format!("{bias},{pictures},{real}"));
            // Writing into a string does not fail.
            let _ = writeln!(out, "{cells},{value},{rest}");
        };
        for distance in &self.distances {
            let CmmdDistance { method, weather, scene, cmmd, rendered, real } = distance;
            let weather = weather.map_or("", WeatherClass::name);
            let rest = Some((cmmd.bias, *rendered, *real));
            line(["cmmd", "measured", method, weather, scene.as_deref().unwrap_or("")], cmmd.value, rest);
        }
        for score in &self.scores {
            for (metric, value) in [("uvq 1.0", score.v1_0), ("uvq 1.5", score.v1_5)] {
                let Some(value) = value else { continue };
                line([metric, "given", &score.method, score.weather.name(), &score.scene], value, None);
            }
        }
        if self.paper {
            for (method, weather, value) in published::cmmd() {
                line(["cmmd", "paper", method, weather.name(), ""], value, None);
            }
            for (scene, weather, method, value) in published::uvq() {
                line(["uvq 1.0", "paper", method, weather.name(), scene], value, None);
            }
        }
        out
    }

    /// Returns everything as JSON, as described in `docs/guide/evaluate.md`.
    pub(crate) fn json(&self) -> Value {
        let distance = |distance: &CmmdDistance| {
            json!({
                "method": distance.method, "weather": distance.weather.map(WeatherClass::name), "scene": distance.scene,
                "cmmd": distance.cmmd.value, "bias": distance.cmmd.bias,
                "pictures": distance.rendered, "photographs": distance.real,
            })
        };
        let score = |score: &UvqScore| {
            json!({
                "method": score.method, "weather": score.weather.name(), "scene": score.scene,
                "uvq_1_0": score.v1_0, "uvq_1_5": score.v1_5,
            })
        };
        let mut all = json!({ "cmmd": self.distances.iter().map(distance).collect::<Vec<_>>() });
        if self.paper {
            let cmmd = published::cmmd().map(
                |(method, weather, value)| json!({ "method": method, "weather": weather.name(), "cmmd": value }),
            );
            let uvq = published::uvq().map(|(scene, weather, method, value)| {
                json!({ "method": method, "weather": weather.name(), "scene": scene, "uvq_1_0": value })
            });
            all["uvq"] = self.scores.iter().map(score).collect();
            all["paper"] = json!({ "cmmd": cmmd.collect::<Vec<_>>(), "uvq": uvq.collect::<Vec<_>>() });
        }
        all
    }
}

/// Compares scene names of folders with those of the paper.
fn same_scene(a: &str, b: &str) -> bool {
    let plain = |name: &str| name.to_lowercase().replace(['-', '_'], " ");
    plain(a) == plain(b)
}

/// Pads columns to their longest cell, so that the source is readable too.
fn table(out: &mut String, head: &[String], rows: &[Vec<String>]) {
    let width = |column: usize| {
        let cells = rows.iter().map(|row| &row[column]).chain([&head[column]]);
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    let line = |cells: &[String]| -> String {
        let cells = cells.iter().zip(&widths).map(|(cell, width)| format!(" {cell:<width$} |"));
        format!("|{}\n", cells.collect::<String>())
    };
    out.push_str(&line(head));
    out.push_str(&format!(
        "|{}\n",
        widths.iter().map(|width| format!("{}|", "-".repeat(width + 2))).collect::<String>()
    ));
    rows.iter().for_each(|row| out.push_str(&line(row)));
}

/// Escapes a name for a table: folder names may contain any character.
fn escaped(name: &str) -> String {
    name.chars().map(|c| if c.is_control() { '?' } else { c }).collect::<String>().replace('|', "\\|")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made_up() -> Tables {
        let distance = |scene: Option<&str>, value| CmmdDistance {
            method: "ours|new, \"2\"".into(),
            weather: Some(WeatherClass::Rain),
            scene: scene.map(str::to_owned),
            cmmd: Cmmd { value, bias: 0.125 },
            rendered: 40,
            real: 3258,
        };
        let score = |scene: &str, v1_5| UvqScore {
            method: "ours".into(),
            weather: WeatherClass::Snow,
            scene: scene.into(),
            v1_0: Some(3.875),
            v1_5,
        };
        Tables {
            distances: vec![distance(None, 2.5), distance(Some("garden"), 2.75)],
            scores: vec![score("sjtu-main_gate", None), score("yard", Some(4.25))],
            paper: true,
        }
    }

    #[test]
    fn the_papers_figures_stand_beside() {
        let text = made_up().markdown();
        for line in [
            "| Weather-Magician | 1.40              | 2.79     | 3.30 | paper    |",
            "| ours\\|new, \"2\"   | -                 | 2.50     | -    | measured |",
            "| ours\\|new, \"2\" | rain    | garden | 2.7500 | 0.1250 | 40       | 3258        |",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}\n{text}");
        }
        // The scene of the paper by its folder's name, one that the paper has not, and versions
        // apart.
        let row = |start: &str| text.lines().find(|line| line.starts_with(start)).unwrap().to_owned();
        assert!(row("| SJTU main gate").ends_with(
            "| 3.63                     | 3.91                | 3.95                     | 3.88 |"
        ));
        assert!(row("| yard").ends_with(
            "| -                        | -                   | -                        | 3.88 |"
        ));
        let (first, second) = text.split_once("UVQ 1.5").unwrap();
        assert!(!first.contains("4.25") && second.contains("4.25") && !second.contains("paper"), "{text}");
    }

    #[test]
    fn programs_get_every_number() {
        let tables = made_up();
        let csv = tables.csv();
        assert!(
            csv.contains("\ncmmd,measured,\"ours|new, \"\"2\"\"\",rain,garden,2.75,0.125,40,3258\n"),
            "{csv}"
        );
        assert!(csv.contains("\nuvq 1.5,given,ours,snow,yard,4.25,,,\n"), "{csv}");
        assert_eq!(csv.lines().filter(|line| line.starts_with("uvq 1.0,paper,")).count(), 54);
        assert_eq!(csv.lines().filter(|line| line.starts_with("cmmd,paper,")).count(), 10);
        let json = tables.json();
        assert_eq!(json["cmmd"][1]["cmmd"], 2.75);
        assert_eq!(json["uvq"][1]["uvq_1_5"], 4.25);
        assert_eq!(json["paper"]["uvq"].as_array().unwrap().len(), 54);
    }
}
