//! `cameras.bin`, `images.bin` and `points3D.bin`: little endian, no padding, a count first.

use super::records::{
    Cameras, Images, MAX_PARAMETERS, MODELS, NumberedPoints, Places, add_camera, add_point, cut, observation,
    parameters, value, view,
};
use std::collections::HashMap;
use wm_base::{FormatError, Problem, error::excerpt, source::Source};
use wm_scene::SparsePoints;

/// Longest image name, bytes: that of a path.
const MAX_NAME_BYTES: usize = 4096;

/// Bytes of a 2D point: x, y, number of its 3D point.
const POINT_SIZE: u128 = 24;

/// Bytes of an entry of a track: number of an image, index of a 2D point in it.
const TRACK_SIZE: u128 = 8;

/// A camera: u32 number, i32 model, u64 width, u64 height, f64 parameters.
pub(super) fn read_cameras(source: &mut Source) -> Result<Cameras, FormatError> {
    let count = read_count(source, "cameras")?;
    let mut cameras = Cameras::new();
    for index in 1..=count {
        let at = source.offset();
        let mut record = Record { source, what: "camera", index, count };
        let id = record.u32()?;
        let number = record.u32()?;
        let size = (record.u64()?, record.u64()?);
        let unknown = format!("number {}", number.cast_signed());
        let model = MODELS.get(number as usize).map_or(unknown.as_str(), |name| name);
        let length = parameters(id, model).map_err(|problem| record.source.at_byte(at, problem))?;
        let mut values = [0.0; MAX_PARAMETERS];
        for value in &mut values[..length] {
            *value = record.f64()?;
        }
        let added = add_camera(&mut cameras, id, model, size, &values[..length]);
        added.map_err(|problem| source.at_byte(at, problem))?;
    }
    Ok(cameras)
}

/// The number of images that the file states.
pub(super) fn count_images(source: &mut Source) -> Result<u64, FormatError> {
    read_count(source, "images")
}

/// An image: u32 number, f64 qw qx qy qz tx ty tz, u32 camera, name up to a 0 byte, u64 count of 2D
/// points, the points.
pub(super) fn read_images(
    source: &mut Source,
    cameras: &Cameras,
    places: &Places,
) -> Result<Images, FormatError> {
    let count = read_count(source, "images")?;
    let (mut views, mut observations) = (Vec::new(), Vec::new());
    for index in 1..=count {
        let at = source.offset();
        let mut record = Record { source, what: "image", index, count };
        record.u32()?;
        let mut pose = [0.0; 7];
        for value in &mut pose {
            *value = record.f64()?;
        }
        let camera = record.u32()?;
        let name = record.name()?;
        let points = record.u64()?;
        let mut seen = Vec::new();
        if let Some(places) = places {
            for _ in 0..points {
                let xy = [record.f64()?, record.f64()?];
                seen.extend(observation(places, xy, record.u64()?));
            }
        } else if record.source.skip(u128::from(points) * POINT_SIZE)? > 0 {
            return Err(record.cut());
        }
        views.push(view(cameras, &name, camera, pose).map_err(|problem| source.at_byte(at, problem))?);
        seen.shrink_to_fit();
        observations.push(seen);
    }
    Ok((views, observations))
}

/// A 3D point: u64 number, f64 x y z, u8 r g b, f64 error, u64 length of the track, the track.
pub(super) fn read_points(source: &mut Source) -> Result<NumberedPoints, FormatError> {
    let count = read_count(source, "points")?;
    let (mut points, mut places) = (SparsePoints::default(), HashMap::new());
    for index in 1..=count {
        let at = source.offset();
        let mut record = Record { source, what: "point", index, count };
        let id = record.u64()?;
        let position = [record.f64()?, record.f64()?, record.f64()?];
        let color = record.take::<3>()?;
        let error = record.f64()?;
        let length = record.u64()?;
        if record.source.skip(u128::from(length) * TRACK_SIZE)? > 0 {
            return Err(record.cut());
        }
        let added = add_point(&mut points, &mut places, id, position, color, error, length);
        added.map_err(|problem| source.at_byte(at, problem))?;
    }
    Ok((points, places))
}

fn read_count(source: &mut Source, what: &str) -> Result<u64, FormatError> {
    if !source.fill(1)? {
        return Err(source.whole(Problem::Empty));
    }
    let count = source.take()?.map(u64::from_le_bytes);
    count.ok_or_else(|| source.whole(cut(format!("the number of {what}"))))
}

/// A camera, image or point that is being read.
struct Record<'s, 'a> {
    source: &'s mut Source<'a>,
    what: &'static str,
    index: u64,
    count: u64,
}

impl Record<'_, '_> {
    fn cut(&self) -> FormatError {
        self.source.whole(cut(format!("{} {} of {}", self.what, self.index, self.count)))
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], FormatError> {
        let bytes = self.source.take()?;
        bytes.ok_or_else(|| self.cut())
    }

    fn u32(&mut self) -> Result<u32, FormatError> {
        self.take().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, FormatError> {
        self.take().map(u64::from_le_bytes)
    }

    fn f64(&mut self) -> Result<f64, FormatError> {
        self.take().map(f64::from_le_bytes)
    }

    fn name(&mut self) -> Result<String, FormatError> {
        let at = self.source.offset();
        let mut name = Vec::new();
        loop {
            match self.take()? {
                [0] => break,
                [byte] if name.len() < MAX_NAME_BYTES => name.push(byte),
                _ => {
                    return Err(self
                        .source
                        .at_byte(at, value(format!("a name is longer than {MAX_NAME_BYTES} bytes"))));
                }
            }
        }
        String::from_utf8(name).map_err(|error| {
            let name = excerpt(error.as_bytes());
            self.source.at_byte(at, value(format!("the image name \"{name}\" is not UTF-8")))
        })
    }
}
