//! The reference of all effects and presets as text: for help and for `docs/reference/weather.md`.

use crate::effects::EFFECTS;
use crate::param::{Param, ParamKind, one_line};
use crate::presets::PRESETS;
use crate::weather::Weather;
use std::fmt::Write;

/// The page `docs/reference/weather.md`.
#[must_use]
pub fn markdown() -> String {
    let mut page = String::from(include_str!("reference_page.md"));
    page.push_str("\n## Presets\n\n| name | what it is |\n|---|---|\n");
    for (name, _) in PRESETS {
        let about = Weather::preset(name).map(|weather| weather.about).unwrap_or_default();
        _ = writeln!(page, "| `{name}` | {about} |");
    }
    page.push_str(LOOKS);
    for effect in EFFECTS {
        _ = writeln!(page, "\n## {}\n\n{}. Role: {}.\n", effect.name, effect.about, effect.role.name());
        page.push_str("| parameter | default | range | unit | meaning |\n|---|---|---|---|---|\n");
        for param in effect.params {
            let (range, unit) = (range(param), if param.unit.is_empty() { "-" } else { param.unit });
            let (name, default, meaning) = (param.name, &param.default, one_line(param.meaning));
            _ = writeln!(page, "| `{name}` | {default} | {range} | {unit} | {meaning} |");
        }
    }
    page
}

/// Writes the reference for a terminal, below the options of a command.
#[must_use]
pub fn help() -> String {
    let mut text = String::from("Weathers by name:\n");
    for (name, _) in PRESETS {
        let about = Weather::preset(name).map(|weather| weather.about).unwrap_or_default();
        _ = writeln!(text, "  {name:<16} {about}");
    }
    for effect in EFFECTS {
        _ = writeln!(text, "\nParameters of {} ({}):", effect.name, effect.about);
        for param in effect.params {
            let unit = if param.unit.is_empty() { String::new() } else { format!(" {}", param.unit) };
            let key = format!("{}.{}", effect.name, param.name);
            _ = writeln!(
                text,
                "  {key:<24} {}{unit}, {}: {}",
                param.default,
                range(param),
                one_line(param.meaning)
            );
        }
    }
    text
}

fn range(param: &Param) -> String {
    let (least, greatest) = param.range;
    match param.kind {
        ParamKind::Number => format!("{least} to {greatest}"),
        ParamKind::NumberOrAuto => format!("{least} to {greatest}, auto"),
        ParamKind::ColorOrAuto => "sRGB, auto".into(),
        ParamKind::Word(words) => words.join(", "),
        ParamKind::ImageOrAuto => "path, auto".into(),
    }
}

const LOOKS: &str = "
The colour filter that the paper lays over rain and snow, on top of any weather:

```
--set look.exposure=-0.5 --set look.saturation=0.7 --set look.temperature=-0.2 --set look.contrast=0.85
```
";

#[cfg(test)]
mod tests {
    use super::*;

    /// With `WM_UPDATE_DOCS=1` in the environment, writes the page.
    #[test]
    fn the_page_in_docs_is_this_one() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/reference/weather.md");
        if std::env::var("WM_UPDATE_DOCS").is_ok_and(|v| v == "1") {
            std::fs::write(path, markdown()).unwrap();
        }
        let page = std::fs::read_to_string(path).unwrap_or_default();
        assert!(
            page == markdown(),
            "docs/reference/weather.md is stale: run WM_UPDATE_DOCS=1 cargo test -p wm-weather"
        );
    }

    #[test]
    fn help_names_every_parameter() {
        let help = help();
        for effect in EFFECTS {
            for param in effect.params {
                assert!(help.contains(&format!("{}.{}", effect.name, param.name)));
            }
        }
    }
}
