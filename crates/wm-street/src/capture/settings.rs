//! The settings of a capture.

use super::flaws::CaptureFlaws;
use crate::Place;
use crate::air::Air;
use crate::dataset::GroundTruth;
use wm_capture::colmap::write::ColmapStorage;

/// The way in which a capture is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CaptureKind {
    /// A drone on parallel lines 50 m up that looks straight down, within some degrees; 75 %
    /// overlap.
    Nadir,
    /// A drone on a ring that looks inwards, 45 degrees down; every third photo 20, so that it sees
    /// the horizon.
    Oblique,
    /// Somebody who walks along a path with a phone: rolled, pitched and shaken.
    Walk,
    /// A camera in a car on a road with traffic and people.
    Drive,
}

impl CaptureKind {
    /// The name in files and options.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Nadir => "nadir",
            Self::Oblique => "oblique",
            Self::Walk => "walk",
            Self::Drive => "drive",
        }
    }

    /// The usual number of photos.
    #[must_use]
    pub fn usual_count(self) -> u32 {
        match self {
            Self::Nadir | Self::Oblique => 24,
            Self::Walk | Self::Drive => 30,
        }
    }

    /// Standard deviation of the positions in EXIF, m: of each photo along level axes, and of the
    /// altitude of all.
    pub(super) fn gps_noise(self) -> (f64, f64) {
        match self {
            Self::Nadir | Self::Oblique => (1.0, 2.0),
            Self::Walk | Self::Drive => (2.5, 5.0),
        }
    }
}

/// The settings of a capture.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptureSettings {
    /// The way in which it is made.
    pub kind: CaptureKind,
    /// The number of photos that are taken, 1 and above.
    pub count: u32,
    /// Their width and height, px.
    pub size: (u32, u32),
    /// A pixel is the mean of this squared rays.
    pub samples: u32,
    /// Most points.
    pub points: u32,
    /// The encoding of the COLMAP model.
    pub storage: ColmapStorage,
    /// The maps that are written beside `truth.json`.
    pub truth: GroundTruth,
    /// The seed of all noise, and of the model's axes.
    pub seed: u64,
    /// Flaws of the photos.
    pub flaws: CaptureFlaws,
}

impl CaptureSettings {
    /// The usual settings of a kind: photos of 600 x 400 px without flaws.
    #[must_use]
    pub fn new(kind: CaptureKind) -> Self {
        Self {
            kind,
            count: kind.usual_count(),
            size: (600, 400),
            samples: 2,
            points: 12_000,
            storage: ColmapStorage::Binary,
            truth: GroundTruth::Write,
            seed: 1,
            flaws: CaptureFlaws::default(),
        }
    }

    /// The haze of a capture of a place.
    pub(super) fn air(&self, place: &Place) -> Option<Air> {
        self.flaws.haze.map(|mor| Air { mor, airlight: place.horizon() })
    }
}
