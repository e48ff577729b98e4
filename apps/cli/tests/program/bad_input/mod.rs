//! Whatever is wrong with what the program is given: it says so in one line, with the name of the
//! file and the place in it, and writes nothing.

mod options;
mod scenes;
mod streams;
mod weathers;

use crate::common::{Workshop, with_usual};
use crate::process::{finish, said, succeeds, wait};
use std::ffi::OsStr;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use wm_scene::testing::data;

/// Default options of the tests: a small picture of the small scene.
const USUAL: [(&str, &str); 4] =
    [("--size", "48x32"), ("--threads", "1"), ("--camera", "0,-6,2:0,0,2"), ("--out", "a.png")];

/// The properties of a splat, in the order of [`Ply::rows`].
const PROPERTIES: [&str; 14] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0",
    "rot_1", "rot_2", "rot_3",
];

/// A PLY by its parts, to be spoilt.
#[derive(Clone)]
struct Ply {
    count: String,
    /// Type and name.
    properties: Vec<String>,
    rows: Vec<Vec<f32>>,
}

impl Ply {
    /// A wall of 60 splats at x -1.5 to 1.2, y 0 to 1.5, z about 2.
    fn sound() -> Self {
        let row = |i: usize| {
            let place = [(i % 10) as f32 * 0.3 - 1.5, (i / 10) as f32 * 0.3, 2.0 + 0.1 * (i % 7) as f32];
            let look = [0.5, 0.1, -0.3, 3.0, -1.5, -1.5, -2.0, 1.0, 0.0, 0.0, 0.0];
            [&place[..], &look].concat()
        };
        Self {
            count: "60".into(),
            properties: PROPERTIES.map(|name| format!("float {name}")).to_vec(),
            rows: (0..60).map(row).collect(),
        }
    }

    /// The sound one with another value of a property of the eighth splat.
    fn with(name: &str, value: f32) -> Self {
        let mut ply = Self::sound();
        ply.rows[7][PROPERTIES.iter().position(|known| *known == name).unwrap()] = value;
        ply
    }

    fn bytes(&self) -> Vec<u8> {
        let lines: String = self.properties.iter().map(|p| format!("property {p}\n")).collect();
        let count = &self.count;
        let header = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{lines}comment wm.up [0.0, 0.0, 1.0]\nend_header\n"
        );
        let values = self.rows.iter().flatten().flat_map(|v| v.to_le_bytes());
        header.into_bytes().into_iter().chain(values).collect()
    }
}

/// A folder with a sound scene `good.ply` in it, where the program runs.
fn place() -> Workshop {
    // What the scene lacks and which camera was chosen may be said before an error.
    let place = Workshop::with("", &["warning: ", "camera: "]);
    place.put("good.ply", Ply::sound().bytes());
    place
}

impl Workshop {
    /// Runs a command that must be refused with one line that holds each of `says`.
    fn refuses<S: AsRef<OsStr>>(&self, args: impl IntoIterator<Item = S>, says: &[&str]) -> String {
        self.refused_by(&mut self.program(args), says)
    }

    /// `render SCENE` with `more` before what is usual.
    fn render_refused(&self, scene: &str, more: &[&str], says: &[&str]) -> String {
        self.refuses(render(scene, more), says)
    }

    fn rendered(&self, scene: &str, more: &[&str]) -> Output {
        succeeds(&mut self.program(render(scene, more)))
    }

    fn outcome<S: AsRef<OsStr>>(&self, args: impl IntoIterator<Item = S>) -> Output {
        finish(&mut self.program(args))
    }
}

/// The options of `render`: `more`, and what is usual where it says nothing.
fn render<'a>(scene: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    // The tests that render often to one file replace it.
    with_usual(&["render", scene, "--overwrite"], more, &USUAL)
}
