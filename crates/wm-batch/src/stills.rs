//! Scenes of layouts that hold one scene a folder: a clip, or all stills of one place in one
//! weather.

use crate::cameras::picture;
use crate::layouts::{BlockWriter, ClipStream, FileSink};
use crate::{BlockInfo, CameraInfo, ClipInfo, ClipRecord, ReadingInfo, SensorReading};
use crate::{SetError, SetInfo, picture_files};
use std::collections::BTreeMap;

/// Returns true if clips have one frame each.
fn is_still(set: &SetInfo, clip: &ClipInfo) -> bool {
    clip.seconds * set.frame_rate < 1.5
}

/// The folder of the scene that a clip belongs to.
pub(crate) fn folder(set: &SetInfo, clip: &ClipInfo) -> String {
    if is_still(set, clip) {
        format!("{}/{}-{}", clip.split, clip.place.name, clip.weather.name)
    } else {
        clip.folder()
    }
}

/// The path of a photo in its scene: by the number of the still, or of the reading.
pub(crate) fn photo(set: &SetInfo, clip: &ClipInfo, info: &ReadingInfo) -> String {
    let name = &set.sensors[info.sensor].name;
    if is_still(set, clip) && info.index == 0 {
        format!("{name}/{:08}.jpg", clip.number)
    } else if is_still(set, clip) {
        format!("{name}/{:08}-{:06}.jpg", clip.number, info.index)
    } else {
        format!("{name}/{:06}.jpg", info.index)
    }
}

/// Takes a scene: its folder and its clips.
type TakeScene<'a> = &'a mut dyn FnMut(&str, &[ClipRecord]) -> Result<(), SetError>;

/// Calls `take` for each scene with its folder and its clips, in the order of their numbers. Stills
/// are kept until the last.
pub(crate) fn for_each_scene(
    set: &SetInfo,
    clips: ClipStream<'_>,
    take: TakeScene<'_>,
) -> Result<(), SetError> {
    let mut stills: BTreeMap<String, Vec<ClipRecord>> = BTreeMap::new();
    for record in clips {
        let record = record?;
        let folder = folder(set, &record.clip);
        if is_still(set, &record.clip) {
            stills.entry(folder).or_default().push(record);
        } else {
            take(&folder, &[record])?;
        }
    }
    stills.iter().try_for_each(|(folder, records)| take(folder, records))
}

/// The pictures of clips with what took them, in order.
pub(crate) fn readings<'a>(
    set: &'a SetInfo,
    records: &'a [ClipRecord],
) -> impl Iterator<Item = (&'a ClipInfo, &'a ReadingInfo, &'a CameraInfo)> {
    let all = records.iter().flat_map(|record| record.readings.iter().map(move |info| (&record.clip, info)));
    all.filter_map(|(clip, info)| Some((clip, info, set.sensors[info.sensor].camera()?)))
}

/// Writes the pictures of all cameras of a block as JPEG, into `images/` of their scenes.
pub(crate) fn scene_photos(block: BlockInfo<'_>) -> Box<dyn BlockWriter + '_> {
    let BlockInfo { set, clip, .. } = block;
    Box::new(move |reading: &SensorReading<'_>, files: &mut dyn FileSink| {
        let Some((sensor, camera, picture)) = picture(set, reading) else { return Ok(()) };
        let jpeg = picture_files::jpeg(sensor, camera, picture.rgb)?;
        files.write(&format!("{}/images/{}", folder(set, clip), photo(set, clip, &reading.info)), &jpeg)
    })
}
