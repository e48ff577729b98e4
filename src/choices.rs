//! Command-line values for choices of the libraries.

use clap::ValueEnum;
use wm_media::color::Dither;
use wm_media::video::VideoEncoder;
use wm_scene::survey::OwnSky;

/// Returns the name of the first option that is given, of options with whether they are.
pub(crate) fn first_given<const N: usize>(options: [(bool, &'static str); N]) -> Option<&'static str> {
    options.into_iter().find(|(is_given, _)| *is_given).map(|(_, name)| name)
}

/// Quantisation of 8-bit pictures.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum DitherChoice {
    /// Rounds to the nearest value: smooth gradients show banding.
    Off,
    /// Adds a fixed blue-noise offset per pixel and channel. No pixel is off by a whole step, the
    /// mean over any 16x16 pixels is right within 0.05 of a step, and exact byte values stay the
    /// same.
    Ordered,
}

impl From<DitherChoice> for Dither {
    fn from(choice: DitherChoice) -> Self {
        match choice {
            DitherChoice::Off => Self::Off,
            DitherChoice::Ordered => Self::Ordered,
        }
    }
}

/// The treatment of a scene's own sky.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum SkyChoice {
    /// Keeps it.
    #[default]
    Keep,
    /// Leaves it out; the colour of fog comes from the weather.
    Drop,
    /// Decides anew which splats are sky: those that are far and above the horizon.
    Rebuild,
}

impl SkyChoice {
    /// Returns the word of the command line.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Keep => "keep",
            Self::Drop => "drop",
            Self::Rebuild => "rebuild",
        }
    }
}

impl From<SkyChoice> for OwnSky {
    fn from(choice: SkyChoice) -> Self {
        match choice {
            SkyChoice::Keep => Self::Keep,
            SkyChoice::Drop => Self::Drop,
            SkyChoice::Rebuild => Self::Rebuild,
        }
    }
}

/// The H.264 encoder of videos.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum EncoderChoice {
    /// OpenH264, built into this program: Constrained Baseline profile. The same frames give the
    /// same bytes.
    Builtin,
    /// The program `ffmpeg` with libx264, from PATH: High profile, files about a third the size.
    Ffmpeg,
}

impl From<EncoderChoice> for VideoEncoder {
    fn from(choice: EncoderChoice) -> Self {
        match choice {
            EncoderChoice::Builtin => Self::Builtin,
            EncoderChoice::Ffmpeg => Self::Ffmpeg,
        }
    }
}
