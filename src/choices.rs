//! Words on the command line for choices of the libraries.

use clap::ValueEnum;
use wm_media::color::Dither;
use wm_media::video::VideoEncoder;

/// How 8-bit pictures are quantised.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum DitherChoice {
    /// To the nearest: slow gradients show contours.
    Off,
    /// A fixed blue-noise offset a pixel and channel. No pixel is off by a whole step, the mean
    /// over any 16x16 is right within 0.05 of a step, and a value that is a byte already stays this byte everywhere.
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

/// The H.264 encoder of a video.
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
