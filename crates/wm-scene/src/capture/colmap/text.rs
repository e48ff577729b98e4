//! `cameras.txt` and `images.txt`: comments after `#`, a camera a line, an image two lines.

use super::{Cameras, add_camera, cut, parameters, value, view};
use crate::{
    FormatError, Problem, View,
    error::{excerpt, number},
    source::Source,
};

/// A camera: number, model, width, height, parameters.
pub(super) fn read_cameras(source: &mut Source) -> Result<Cameras, FormatError> {
    let mut cameras = Cameras::new();
    while let Some(line) = source.line()? {
        if is_ignored(line) {
            continue;
        }
        let parsed = parse_camera(line, &mut cameras);
        parsed.map_err(|problem| fault(source, problem))?;
    }
    Ok(cameras)
}

fn parse_camera(line: &[u8], cameras: &mut Cameras) -> Result<(), Problem> {
    let mut words = words(line);
    let mut next = |what| words.next().ok_or_else(|| value(format!("the camera has no {what}")));
    let id = number(next("number")?, "the number of a camera")?;
    let length = parameters(id, &excerpt(next("model")?))?;
    let size = (number(next("width")?, "the width")?, number(next("height")?, "the height")?);
    let mut values = [0.0; 4];
    for value in &mut values[..length] {
        *value = number(next("further parameter")?, "a camera parameter")?;
    }
    if words.next().is_some() {
        return Err(value(format!("camera {id} has more than {length} parameters")));
    }
    add_camera(cameras, id, size, &values[..length])
}

/// An image: number, qw qx qy qz, tx ty tz, camera, name, where the name may have spaces; then a line
/// of 2D points, which may be empty.
pub(super) fn read_images(source: &mut Source, cameras: &Cameras) -> Result<Vec<View>, FormatError> {
    let mut views = Vec::new();
    while let Some(line) = source.line()? {
        if is_ignored(line) {
            continue;
        }
        let parsed = parse_image(line, cameras);
        views.push(parsed.map_err(|problem| fault(source, problem))?);
        // The last line of points may be left out with its line end; another image in its place is
        // told by the number of words, since a point has three.
        if let Some(words) = source.skip_line()?
            && !words.is_multiple_of(3)
        {
            let what = "the line after an image is no list of 2D points (x y number), empty if there are none";
            return Err(source.at_line(value(what.into())));
        }
    }
    Ok(views)
}

fn parse_image(line: &[u8], cameras: &Cameras) -> Result<View, Problem> {
    let mut rest = line;
    let mut next = |what: &str| {
        rest = rest.trim_ascii_start();
        let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        let (word, after) = rest.split_at(end);
        rest = after;
        if word.is_empty() { Err(value(format!("the image has no {what}"))) } else { Ok(word) }
    };
    number::<u32>(next("number")?, "the number of an image")?;
    let mut pose = [0.0; 7];
    for value in &mut pose {
        *value = number(next("complete pose")?, "a pose")?;
    }
    let camera = number(next("camera")?, "the number of a camera")?;
    let name = rest.trim_ascii();
    if name.is_empty() {
        return Err(value("the image has no name".into()));
    }
    let name = std::str::from_utf8(name)
        .map_err(|_| value(format!("the image name \"{}\" is not UTF-8", excerpt(name))))?;
    view(cameras, name.into(), camera, pose)
}

fn is_ignored(line: &[u8]) -> bool {
    let line = line.trim_ascii();
    line.is_empty() || line.starts_with(b"#")
}

fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

/// A problem in the line taken last; in a last line without its end it is a cut.
fn fault(source: &Source, problem: Problem) -> FormatError {
    source.at_line(if source.is_cut() { cut("the last line".into()) } else { problem })
}
