//! Command-line values for choices of the libraries.

use clap::ValueEnum;
use wm_media::color::Dither;
use wm_media::video::VideoEncoder;

/// Quantisation of 8-bit pictures.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum DitherChoice {
    /// Rounds to the nearest value: smooth gradients show banding.
    Off,
    /// Adds a fixed blue-noise offset per pixel and channel. No pixel is off by a whole step, the mean
    /// over any 16x16 pixels is right within 0.05 of a step, and exact byte values stay the same.
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

/// The H.264 encoder of videos.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum EncoderChoice {
    /// OpenH264, built into this program: Constrained Baseline profile. The same frames give the same
    /// bytes.
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
