//! Files of readings.

use super::KittiRig;
use crate::cameras::picture;
use crate::picture_files;
use crate::{BlockInfo, BlockWriter, DatasetPoint, FileSink, ReadingData, SensorReading, SetError};

/// A file of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in super::super) enum KittiFile {
    /// The picture of the camera with this number.
    Picture(usize),
    /// The points.
    Points,
    /// The classes of the points.
    Labels,
}

/// The class of a point.
type PointClass<'a> = Box<dyn Fn(&DatasetPoint) -> u16 + Send + 'a>;

/// Writes the key readings of a block to the paths that a layout gives them.
pub(in super::super) struct KittiFiles<'a, P> {
    block: BlockInfo<'a>,
    rig: KittiRig<'a>,
    /// The path of a file of a frame of the clip; `None` if the layout has none.
    path: P,
    /// The classes of points, if the layout has them.
    pub(in super::super) class: Option<PointClass<'a>>,
}

impl<'a, P: Fn(KittiFile, u32) -> Option<String>> KittiFiles<'a, P> {
    pub(in super::super) fn new(block: BlockInfo<'a>, path: P) -> Self {
        Self { rig: KittiRig::new(block.set), block, path, class: None }
    }
}

impl<P: Fn(KittiFile, u32) -> Option<String> + Send> BlockWriter for KittiFiles<'_, P> {
    fn write(&mut self, reading: &SensorReading<'_>, files: &mut dyn FileSink) -> Result<(), SetError> {
        let info = &reading.info;
        if !info.is_key {
            return Ok(());
        }
        if let Some((sensor, camera, picture)) = picture(self.block.set, reading) {
            let slot = self.rig.slot(info.sensor);
            if let Some(path) = slot.and_then(|slot| (self.path)(KittiFile::Picture(slot), info.frame)) {
                files.write(&path, &picture_files::png(sensor, camera, picture.rgb)?)?;
            }
        }
        if let ReadingData::Points(points) = reading.data
            && self.rig.lidar == Some(info.sensor)
        {
            if let Some(path) = (self.path)(KittiFile::Points, info.frame) {
                files.write(&path, &velodyne(points))?;
            }
            if let Some(class) = &self.class
                && let Some(path) = (self.path)(KittiFile::Labels, info.frame)
            {
                // The upper half would be the number of an instance.
                let labels: Vec<u8> =
                    points.iter().flat_map(|point| u32::from(class(point)).to_le_bytes()).collect();
                files.write(&path, &labels)?;
            }
        }
        Ok(())
    }
}

/// `[N, 4]`, f32: x, y, z, m, and reflectance, 0-1.
fn velodyne(points: &[DatasetPoint]) -> Vec<u8> {
    let numbers = points.iter().flat_map(|point| {
        let [x, y, z] = point.position;
        [x, y, z, point.intensity / 255.0]
    });
    numbers.flat_map(f32::to_le_bytes).collect()
}
