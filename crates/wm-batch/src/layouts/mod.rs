//! Layouts of data sets, one module each, one line each in the list below.

use crate::{BlockInfo, ClipRecord, SensorReading, SetError, SetInfo};

macro_rules! layouts {
    ($($name:ident),* $(,)?) => {
        $(mod $name;)*

        /// Every layout, in the order in which they are listed.
        pub const LAYOUTS: &[Layout] = &[$($name::LAYOUT),*];
    };
}

mod kitti;
mod surface_classes;

layouts! {
    nuscenes,
    kitti_raw,
    kitti_odometry,
    kitti_object,
    semantic_kitti,
    wads,
    argoverse2,
    mcap,
    tartan_air,
    nerfstudio,
    colmap,
    acdc,
    foggy_cityscapes,
}

/// The records of all clips, in the order of their numbers.
pub type ClipStream<'a> = &'a mut dyn Iterator<Item = Result<ClipRecord, SetError>>;

/// A layout of a data set.
#[derive(Debug)]
pub struct Layout {
    /// The name in plans and of its folder.
    pub name: &'static str,
    /// A description in one line.
    pub about: &'static str,
    /// The layers of pictures that it needs beside the colour.
    pub needs: LayerNeeds,
    /// True if every sensor must have a reading in every frame.
    pub needs_every_sensor: bool,
    /// Checks that it can hold a set; [`SetError::Layout`] has what it cannot hold.
    pub check: fn(&SetInfo) -> Result<(), SetError>,
    /// Begins the files of a block. They depend on the block alone.
    pub block: for<'a> fn(BlockInfo<'a>) -> Box<dyn BlockWriter + 'a>,
    /// Writes the tables over all clips. A layout of pictures alone has none.
    pub tables: fn(&SetInfo, ClipStream<'_>, &mut dyn FileSink) -> Result<(), SetError>,
}

/// Layers of pictures beside the colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LayerNeeds {
    /// The picture without weather.
    pub clean: bool,
    /// Depth.
    pub depth: bool,
    /// Optical flow.
    pub flow: bool,
}

impl LayerNeeds {
    /// The colour alone.
    pub(crate) const NONE: Self = Self { clean: false, depth: false, flow: false };

    /// The layers that one or the other needs.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            clean: self.clean || other.clean,
            depth: self.depth || other.depth,
            flow: self.flow || other.flow,
        }
    }
}

/// The files of one block.
pub trait BlockWriter: Send {
    /// Takes the next reading, in the order of [`BlockInfo::readings`].
    ///
    /// # Errors
    /// [`SetError`] of `files`; [`SetError::Picture`].
    fn write(&mut self, reading: &SensorReading<'_>, files: &mut dyn FileSink) -> Result<(), SetError>;

    /// Writes what is left.
    ///
    /// # Errors
    /// [`SetError`] of `files`.
    fn finish(self: Box<Self>, _files: &mut dyn FileSink) -> Result<(), SetError> {
        Ok(())
    }
}

/// A writer of files that belong to one reading each.
impl<F: FnMut(&SensorReading<'_>, &mut dyn FileSink) -> Result<(), SetError> + Send> BlockWriter for F {
    fn write(&mut self, reading: &SensorReading<'_>, files: &mut dyn FileSink) -> Result<(), SetError> {
        self(reading, files)
    }
}

/// Takes the files of a layout.
pub trait FileSink {
    /// Writes a file; `path` is relative to the folder of the layout, with `/` between its parts.
    ///
    /// # Errors
    /// [`SetError::Write`].
    fn write(&mut self, path: &str, bytes: &[u8]) -> Result<(), SetError>;
}
