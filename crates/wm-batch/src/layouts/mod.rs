//! Layouts of data sets, one module each, one line each in the list below.

use crate::{BlockInfo, ClipRecord, SensorReading, SetError, SetInfo};

macro_rules! layouts {
    ($($name:ident),* $(,)?) => {
        $(mod $name;)*

        /// Every layout, in the order in which they are listed.
        pub const LAYOUTS: &[&dyn Layout] = &[$(&$name::LAYOUT),*];
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
pub trait Layout: Sync {
    /// The name in plans and of its folder.
    fn name(&self) -> &'static str;

    /// A description in one line.
    fn about(&self) -> &'static str;

    /// The layers of pictures that it needs beside the colour.
    fn needs(&self) -> LayerNeeds {
        LayerNeeds::default()
    }

    /// Returns true if every sensor must have a reading in every frame.
    fn needs_every_sensor(&self) -> bool {
        true
    }

    /// Checks that it can hold a set.
    ///
    /// # Errors
    /// [`SetError::Layout`] with what it cannot hold.
    fn check(&self, set: &SetInfo) -> Result<(), SetError>;

    /// Begins the files of a block. They depend on the block alone.
    fn block<'a>(&'a self, block: BlockInfo<'a>) -> Box<dyn BlockWriter + 'a>;

    /// Writes the tables over all clips. A layout of pictures alone has none.
    ///
    /// # Errors
    /// Those of `clips` and `files`.
    fn tables(
        &self,
        _set: &SetInfo,
        _clips: ClipStream<'_>,
        _files: &mut dyn FileSink,
    ) -> Result<(), SetError> {
        Ok(())
    }
}

impl std::fmt::Debug for dyn Layout + '_ {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
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
    /// Those of `files`; [`SetError::Picture`].
    fn write(&mut self, reading: &SensorReading<'_>, files: &mut dyn FileSink) -> Result<(), SetError>;

    /// Writes what is left.
    ///
    /// # Errors
    /// Those of `files`.
    fn finish(self: Box<Self>, _files: &mut dyn FileSink) -> Result<(), SetError> {
        Ok(())
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

/// The layout of a name.
///
/// # Errors
/// [`SetError::UnknownLayout`] with the nearest name.
pub fn find_layout(name: &str) -> Result<&'static dyn Layout, SetError> {
    let names: Vec<&str> = LAYOUTS.iter().map(|layout| layout.name()).collect();
    LAYOUTS.iter().copied().find(|layout| layout.name() == name).ok_or_else(|| {
        let near = wm_base::nearest(name, names.iter().copied(), 1);
        SetError::UnknownLayout {
            name: name.into(),
            near: near.first().map_or_else(String::new, |near| format!(", did you mean `{near}`?")),
            all: names.join(", "),
        }
    })
}
