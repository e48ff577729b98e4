//! Files of a view to save, and the commands that make the same.

use crate::catalog::Catalog;
use crate::state::{Follow, View, ViewOutput};
use wm_media::video::FrameRate;

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

    /// Returns the text of a kind: `weather`, `camera`, `command` or `scan`; `None` for another kind.
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

    /// Returns the command that renders the same; `video` is the frame rate and the length in seconds.
    pub fn command(&self, catalog: &Catalog, view: &View, video: Option<(FrameRate, f64)>) -> String {
        let mut words = vec!["weather-magician".to_owned(), "render".into()];
        words.extend(catalog.words.iter().chain(&catalog.fact_words).cloned());
        let state = &view.state;
        let [width, height] = state.size;
        let camera = if state.follow == Follow::Path { "path" } else { "camera" };
        let mut add = |option: &str, value: String| words.push(format!("--{option}={value}"));
        add("weather", self.weather.clone());
        add(camera, self.camera.clone());
        add("size", format!("{width}x{height}"));
        match video {
            Some((rate, seconds)) => {
                add("fps", rate.to_string());
                add("seconds", seconds.to_string());
                add("out", self.video.clone());
            }
            None => {
                add("time", state.time.to_string());
                if state.output != ViewOutput::Rgb {
                    add("also", state.output.name().into());
                }
                add("out", self.picture.clone());
            }
        }
        // The picture that was saved with the other files lies where they do.
        words.push("--overwrite".into());
        words.extend(catalog.run_words.iter().cloned());
        shell_line(&words)
    }

    /// Returns the command that makes the same points.
    pub fn scan(&self, catalog: &Catalog, view: &View) -> String {
        let mut words = vec!["weather-magician".to_owned(), "scan".into()];
        words.extend(catalog.words.iter().chain(&catalog.fact_words).cloned());
        let mut add = |option: &str, value: String| words.push(format!("--{option}={value}"));
        add("weather", self.weather.clone());
        if let Some(lidar) = &view.state.lidar {
            add("lidar", lidar.model.clone());
            add("sub-rays", lidar.sub_rays.to_string());
            add("returns", lidar.returns.clone());
            match lidar.at {
                Some(place) => add("at", place.text(catalog.survey.origin)),
                None if view.state.follow == Follow::Path => add("path", self.camera.clone()),
                None => add("at", self.camera.clone()),
            }
        }
        add("time", view.state.time.to_string());
        add("out", self.points.clone());
        words.push("--overwrite".into());
        words.extend(catalog.run_words.iter().cloned());
        shell_line(&words)
    }
}

/// Joins words to a line for a POSIX shell.
fn shell_line(words: &[String]) -> String {
    words.iter().map(|word| shell_word(word)).collect::<Vec<_>>().join(" ") + "\n"
}

/// Quotes a word for a POSIX shell.
fn shell_word(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./:=,+@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.into()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_quoted_for_a_shell() {
        assert_eq!(shell_word("--camera=a-b.camera.json"), "--camera=a-b.camera.json");
        assert_eq!(shell_word("my place.ply"), "'my place.ply'");
        assert_eq!(shell_word("it's; $(rm)"), r"'it'\''s; $(rm)'");
        assert_eq!(shell_word(""), "''");
    }
}
