//! Files of a view to save, and the commands that make the same.

use crate::catalog::Catalog;
use crate::state::{Follow, ViewOutput};
use crate::view::View;
use std::ffi::{OsStr, OsString};
use wm_image::video::FrameRate;

/// A text to save.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SavedText {
    /// The name of the file.
    pub name: String,
    /// The content type.
    pub kind: &'static str,
    /// The content.
    pub text: String,
}

/// Names of the files of a view: letters, digits and `-_.` alone.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileNames {
    /// The weather file.
    pub weather: String,
    /// The file of the camera or its path.
    pub camera: String,
    /// The picture.
    pub picture: String,
    /// The video.
    pub video: String,
    /// The points of the lidar.
    pub points: String,
}

impl FileNames {
    /// Returns the names, which are made of those of the scene and the weather.
    pub fn of(catalog: &Catalog, view: &View) -> Self {
        let plain = |text: &str| -> String {
            let keep = |c: char| if c.is_ascii_alphanumeric() || "-_".contains(c) { c } else { '-' };
            text.chars().take(60).map(keep).collect()
        };
        let base = format!("{}-{}", plain(&catalog.stem), plain(&view.weather.name));
        Self {
            weather: format!("{base}.toml"),
            camera: format!("{base}.camera.json"),
            picture: format!("{base}.png"),
            video: format!("{base}.mp4"),
            points: format!("{base}-scan.ply"),
        }
    }

    /// Returns the text of a kind: `weather`, `camera`, `command` or `scan`; `None` for another
    /// kind.
    ///
    /// # Errors
    /// A scan of a view that has no lidar.
    pub fn text(&self, kind: &str, catalog: &Catalog, view: &View) -> Result<Option<SavedText>, String> {
        let of = |name: &str, kind, text| Ok(Some(SavedText { name: name.into(), kind, text }));
        match kind {
            "weather" => of(&self.weather, "application/toml", view.weather.to_toml()),
            "camera" => of(&self.camera, "application/json", view.camera_file.clone()),
            "command" => of("command.txt", "text/plain; charset=utf-8", self.command(catalog, view, None)),
            "scan" if view.lidar.is_none() => Err("scan: the state has no lidar".into()),
            "scan" => of("scan.txt", "text/plain; charset=utf-8", self.scan(catalog, view)),
            _ => Ok(None),
        }
    }

    /// Returns the command that renders the same; `video` is the frame rate and the length in
    /// seconds.
    pub fn command(&self, catalog: &Catalog, view: &View, video: Option<(FrameRate, f64)>) -> String {
        let state = &view.state;
        let [width, height] = state.size;
        let camera = if state.follow == Follow::Path { "path" } else { "camera" };
        let mut options = vec![
            ("weather", self.weather.clone()),
            (camera, self.camera.clone()),
            ("size", format!("{width}x{height}")),
        ];
        match video {
            Some((rate, seconds)) => options.extend([
                ("fps", rate.to_string()),
                ("seconds", seconds.to_string()),
                ("out", self.video.clone()),
            ]),
            None => {
                options.push(("time", state.time.to_string()));
                if state.output != ViewOutput::Rgb {
                    options.push(("also", state.output.name().into()));
                }
                options.push(("out", self.picture.clone()));
            }
        }
        command_line("render", catalog, options)
    }

    /// Returns the command that makes the same points.
    pub fn scan(&self, catalog: &Catalog, view: &View) -> String {
        let mut options = vec![("weather", self.weather.clone())];
        if let Some(lidar) = &view.state.lidar {
            options.extend([
                ("lidar", lidar.model.clone()),
                ("sub-rays", lidar.sub_rays.to_string()),
                ("returns", lidar.returns.clone()),
            ]);
            options.push(match lidar.at {
                Some(place) => ("at", place.text(catalog.survey.origin)),
                None if view.state.follow == Follow::Path => ("path", self.camera.clone()),
                None => ("at", self.camera.clone()),
            });
        }
        options.extend([("time", view.state.time.to_string()), ("out", self.points.clone())]);
        command_line("scan", catalog, options)
    }
}

/// Returns a command for the scene with options as a line for a shell.
fn command_line(command: &str, catalog: &Catalog, options: Vec<(&str, String)>) -> String {
    let mut words: Vec<OsString> = vec!["weather-magician".into(), command.into()];
    words.extend(catalog.words.iter().cloned());
    words.extend(catalog.fact_words.iter().map(OsString::from));
    words.extend(options.into_iter().map(|(option, value)| format!("--{option}={value}").into()));
    // What was saved with the other files lies where they do.
    words.push("--overwrite".into());
    words.extend(catalog.run_words.iter().map(OsString::from));
    words.iter().map(|word| shell_word(word)).collect::<Vec<_>>().join(" ") + "\n"
}

/// Quotes a word for a shell: any POSIX shell, and for names that are not UTF-8 or have control
/// characters, which no page can show, one that knows `$'...'` (POSIX 2024; bash, zsh, ksh).
fn shell_word(word: &OsStr) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./:=,+@%".contains(c);
    match word.to_str() {
        Some(text) if !text.is_empty() && text.chars().all(is_plain) => text.into(),
        Some(text) if !text.contains(char::is_control) => format!("'{}'", text.replace('\'', r"'\''")),
        _ => {
            let mut quoted = "$'".to_owned();
            // Three octal digits end by themselves, whatever follows; hexadecimal ones go on in
            // some shells.
            for byte in word.as_encoded_bytes() {
                if byte.is_ascii_alphanumeric() || b"-_./:=,+@% ".contains(byte) {
                    quoted.push(char::from(*byte));
                } else {
                    quoted += &format!("\\{byte:03o}");
                }
            }
            quoted + "'"
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_quoted_for_a_shell() {
        let word = |text: &str| shell_word(text.as_ref());
        assert_eq!(word("--camera=a-b.camera.json"), "--camera=a-b.camera.json");
        assert_eq!(word("my place.ply"), "'my place.ply'");
        assert_eq!(word("it's; $(rm)"), r"'it'\''s; $(rm)'");
        assert_eq!(word(""), "''");
        assert_eq!(word("a\nb\u{1b}c'.ply"), r"$'a\012b\033c\047.ply'");
    }

    #[test]
    #[cfg(unix)]
    fn names_that_are_not_utf_8_are_the_same_in_a_shell() {
        use std::os::unix::ffi::OsStrExt;
        let name = OsStr::from_bytes(b"Stra\xdfe 7\\'\"$x\xff1\n.ply");
        let line = format!("printf %s {}", shell_word(name));
        let output = std::process::Command::new("bash").args(["-c", &line]).output();
        // Not every system has bash.
        if let Ok(output) = output {
            assert_eq!(OsStr::from_bytes(&output.stdout), name, "{line}");
        }
    }
}
