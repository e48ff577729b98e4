//! `cameras.txt`, `images.txt` and `points3D.txt`: comments after `#`, a camera or a point per
//! line, an image two lines.

use super::records::{
    Cameras, Images, MAX_PARAMETERS, NumberedPoints, Places, add_camera, add_point, cut, observation,
    parameters, value, view,
};
use crate::{CaptureView, Observation};
use std::collections::HashMap;
use wm_base::{
    FormatError, Problem,
    error::{excerpt, number},
    source::Source,
};
use wm_scene::SparsePoints;

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
    let model = excerpt(next("model")?);
    let length = parameters(id, &model)?;
    let size = (number(next("width")?, "the width")?, number(next("height")?, "the height")?);
    let mut values = [0.0; MAX_PARAMETERS];
    for value in &mut values[..length] {
        *value = number(next("further parameter")?, "a camera parameter")?;
    }
    if words.next().is_some() {
        return Err(value(format!("camera {id} has more than {length} parameters")));
    }
    add_camera(cameras, id, &model, size, &values[..length])
}

/// The number of images, by their lines.
pub(super) fn count_images(source: &mut Source) -> Result<u64, FormatError> {
    let mut count = 0;
    while let Some(line) = source.line()? {
        if !is_ignored(line) {
            source.skip_line()?;
            count += 1;
        }
    }
    Ok(count)
}

/// An image: number, qw qx qy qz, tx ty tz, camera, name, where the name may have spaces; then a
/// line of 2D points, which may be empty.
pub(super) fn read_images(
    source: &mut Source,
    cameras: &Cameras,
    places: &Places,
) -> Result<Images, FormatError> {
    let (mut views, mut observations) = (Vec::new(), Vec::new());
    while let Some(line) = source.line()? {
        if is_ignored(line) {
            continue;
        }
        let parsed = parse_image(line, cameras);
        views.push(parsed.map_err(|problem| fault(source, problem))?);
        let mut seen = Vec::new();
        if let Some(places) = places {
            read_observations(source, places, &mut seen)?;
        } else if let Some(words) = source.skip_line()?
            && !words.is_multiple_of(3)
        {
            return Err(source.at_line(no_observations()));
        }
        observations.push(seen);
    }
    Ok((views, observations))
}

/// A line of 2D points: x y number, any number of times. It may be left out at the end of the file.
fn read_observations(
    source: &mut Source,
    places: &HashMap<u64, u32>,
    seen: &mut Vec<Observation>,
) -> Result<(), FormatError> {
    let mut xy = [0.0; 2];
    for count in 0u64.. {
        let Some(word) = source.word()? else {
            // Another image in its place is told by the number of words, since a point has three.
            return if count.is_multiple_of(3) {
                Ok(())
            } else {
                Err(words_fault(source, no_observations()))
            };
        };
        let lane = (count % 3) as usize;
        let parsed = if lane < 2 {
            number(word, "a coordinate").map(|v| xy[lane] = v)
        } else {
            number(word, "a point").map(|id: i64| seen.extend(observation(places, xy, id.cast_unsigned())))
        };
        if parsed.is_err() {
            return Err(word_fault(source, no_observations()));
        }
    }
    Ok(())
}

fn no_observations() -> Problem {
    value("the line after an image is not a list of 2D points (x y number), empty if there are none".into())
}

/// A point: number, x y z, r g b, error, then image and 2D point any number of times.
pub(super) fn read_points(source: &mut Source) -> Result<NumberedPoints, FormatError> {
    let (mut points, mut places) = (SparsePoints::default(), HashMap::new());
    source.skip_byte_order_mark()?;
    while source.fill(1)? {
        if source.bytes().first() == Some(&b'#') {
            source.skip_line()?;
            continue;
        }
        let mut first = [0.0; 4];
        let (mut id, mut color, mut count) = (0u64, [0u8; 3], 0u64);
        while let Some(word) = source.word()? {
            let parsed = match count {
                0 => number(word, "the number of a point").map(|v| id = v),
                1..=3 => number(word, "a position").map(|v| first[count as usize - 1] = v),
                4..=6 => number(word, "a colour").map(|v| color[count as usize - 4] = v),
                7 => number(word, "an error").map(|v| first[3] = v),
                _ => number::<u32>(word, "a track").map(|_| ()),
            };
            if let Err(problem) = parsed {
                return Err(word_fault(source, problem));
            }
            count += 1;
        }
        let [x, y, z, error] = first;
        let added = match count {
            0 => continue,
            8.. if count.is_multiple_of(2) => {
                add_point(&mut points, &mut places, id, [x, y, z], color, error, count / 2 - 4)
            }
            8.. => Err(value("half an entry of the track is missing".into())),
            _ => Err(value("the point is not complete".into())),
        };
        added.map_err(|problem| words_fault(source, problem))?;
    }
    Ok((points, places))
}

fn parse_image(line: &[u8], cameras: &Cameras) -> Result<CaptureView, Problem> {
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
    view(cameras, name, camera, pose)
}

fn is_ignored(line: &[u8]) -> bool {
    let line = line.trim_ascii();
    line.is_empty() || line.starts_with(b"#")
}

fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

/// Locates a problem in the line taken last; in a last line without its end it is a cut.
fn fault(source: &Source, problem: Problem) -> FormatError {
    source.at_line(if source.is_cut() { cut("the last line".into()) } else { problem })
}

/// Locates a problem in the line of the word taken last, as [`fault`] does.
fn word_fault(source: &Source, problem: Problem) -> FormatError {
    source.in_line(if source.is_cut() { cut("the last line".into()) } else { problem })
}

/// Locates a problem in a line of which all words were taken: without its end it is still the
/// present one.
fn words_fault(source: &Source, problem: Problem) -> FormatError {
    if source.is_cut() { word_fault(source, problem) } else { source.at_line(problem) }
}
