//! The built-in encoder: OpenH264 into [`mp4`](super::mp4).
//!
//! Without a bitrate every frame is quantised alike, with [`QUALITY_QP`]: the file is as large as
//! the picture needs, flat air costs next to nothing, and the dither of the planes survives, so
//! that fog stays smooth. With a bitrate OpenH264's own rate control runs; its keyframes are
//! coarser than the frames before them (QP 22 at best), which shows faintly in fog every two
//! seconds.
//!
//! Switched off, since each would spoil fog: background detection (keeps old pixels where the
//! picture changes slowly), adaptive quantisation (coarser in flat air), denoising (removes the
//! dither). One thread, so that the same frames give the same bytes on any number of cores.

use std::path::Path;

use openh264::encoder::{
    BitRate, EncodedBitStream, Encoder, EncoderConfig, FrameRate as MaxFrameRate, FrameType,
    IntraFramePeriod, Level, QpRange, RateControlMode, UsageType, VuiConfig,
};
use openh264::formats::YUVSlices;
use openh264::{OpenH264API, Timestamp};

use super::mp4::{Mp4Writer, ParameterSets};
use super::settings::{KEYFRAME_INTERVAL_S, VideoReport, VideoSettings, VideoSink, one_line};
use super::yuv::Yuv420;
use crate::{MediaError, PictureSize};

/// Quantisation parameter without a bitrate. At 14 a coefficient's step is 3.25, and the dither's 4
/// (one step of brightness in 4x4 pixels) survives it; from 18 on it does not, and contours appear.
const QUALITY_QP: u8 = 14;
/// Quantisation parameters that rate control may choose; OpenH264 goes no lower than 12.
const RATE_QPS: (u8, u8) = (12, 44);
/// Bit rates that OpenH264 is asked for, within the highest level of H.264.
const BITRATE_LIMITS_BPS: (f64, f64) = (10_000.0, 240e6);
/// Frame rates that OpenH264's rate control knows.
const FRAME_RATE_LIMITS_HZ: (f64, f64) = (1.0, 60.0);
/// Tries to encode one frame before giving up.
const MAX_TRIES: u32 = 1000;
/// Increase of the QPs if a frame does not fit the encoder's buffer: half the bits.
const QP_INCREASE: u8 = 6;

/// Encodes frame by frame.
pub(crate) struct H264Sink {
    settings: VideoSettings,
    encoder: Encoder,
    /// Added to all QPs so far.
    coarser: u8,
    yuv: Yuv420,
    mp4: Mp4Writer,
    /// Known from the first frame on.
    sets: Option<ParameterSets>,
    /// The last frame's NAL units, each behind its length.
    sample: Vec<u8>,
}

impl H264Sink {
    /// Starts the video `path`.
    ///
    /// # Errors
    /// The size is beyond OpenH264; the file cannot be made.
    pub(super) fn create(path: &Path, settings: VideoSettings) -> Result<Self, MediaError> {
        let PictureSize { width, height } = settings.size;
        if width.max(height) > 3840 || width.min(height) > 2160 || width.min(height) < 16 {
            let limits = "16 to 3840x2160 or 2160x3840";
            return Err(MediaError::EncoderSize { path: path.to_path_buf(), limits, width, height });
        }
        let encoder = encoder(&settings, 0).map_err(|error| failed(path, 0, &error.to_string()))?;
        Ok(Self {
            coarser: 0,
            yuv: Yuv420::new(settings.size, settings.dither),
            mp4: Mp4Writer::create(path, settings.size, settings.frame_rate)?,
            settings,
            encoder,
            sets: None,
            sample: Vec::new(),
        })
    }
}

impl VideoSink for H264Sink {
    fn frame(&mut self, rgb: &[f32]) -> Result<(), MediaError> {
        self.yuv.convert(rgb);
        let (width, height) = (self.settings.size.width as usize, self.settings.size.height as usize);
        let planes = self.yuv.planes().into();
        let planes = YUVSlices::new(planes, (width, height), (width, width / 2, width / 2));
        let frame = self.mp4.count();
        let hz = self.settings.frame_rate.hz().clamp(FRAME_RATE_LIMITS_HZ.0, FRAME_RATE_LIMITS_HZ.1);
        let time = Timestamp::from_millis((frame as f64 / hz * 1000.0) as u64);
        // Rate control may skip a frame to save bits, but a video without the frame is not what was
        // asked for. Each skip makes room in its budget, so the same frame passes soon.
        for _ in 0..MAX_TRIES {
            let error = match self.encoder.encode_at(&planes, time) {
                Ok(stream) if stream.frame_type() == FrameType::Skip => continue,
                Ok(stream) => {
                    let keyframe = stream.frame_type() == FrameType::IDR;
                    take_units(&stream, &mut self.sets, &mut self.sample);
                    if self.sets.is_none() || self.sample.is_empty() {
                        return Err(failed(self.mp4.target(), frame, "it gave no data"));
                    }
                    return self.mp4.sample(&self.sample, keyframe);
                }
                Err(error) => error,
            };
            // Above about 8 bits a pixel, which is noise, a frame does not fit its buffer, and it
            // is of no use after that. A coarser one goes on with a keyframe.
            self.coarser += QP_INCREASE;
            if QUALITY_QP + self.coarser > RATE_QPS.1 {
                return Err(failed(self.mp4.target(), frame, &error.to_string()));
            }
            self.encoder = encoder(&self.settings, self.coarser)
                .map_err(|error| failed(self.mp4.target(), frame, &error.to_string()))?;
        }
        Err(failed(self.mp4.target(), frame, "it kept skipping the frame: use a higher bitrate"))
    }

    fn finish(self: Box<Self>) -> Result<VideoReport, MediaError> {
        let Self { settings, mp4, sets, .. } = *self;
        let (path, frames) = (mp4.target().to_path_buf(), mp4.count());
        let Some(sets) = sets else {
            return Err(MediaError::NoFrames(path));
        };
        let bytes = mp4.finish(&sets, &settings.tags)?;
        let seconds = settings.frame_rate.seconds(frames);
        Ok(VideoReport { path, encoder: settings.encoder, frames, seconds, bytes })
    }
}

fn failed(path: &Path, frame: u64, reason: &str) -> MediaError {
    MediaError::Encode {
        path: path.to_path_buf(),
        encoder: "the built-in encoder",
        frame,
        reason: one_line(reason),
    }
}

/// An encoder for the settings whose QPs are raised by `coarser`.
fn encoder(settings: &VideoSettings, coarser: u8) -> Result<Encoder, openh264::Error> {
    Encoder::with_api_config(OpenH264API::from_source(), config(settings, coarser))
}

fn config(settings: &VideoSettings, coarser: u8) -> EncoderConfig {
    let hz = settings.frame_rate.hz();
    let known_hz = hz.clamp(FRAME_RATE_LIMITS_HZ.0, FRAME_RATE_LIMITS_HZ.1);
    // Per second of the frame rate that rate control knows, so that a frame gets its share.
    let bitrate = |per_second: f64| {
        BitRate::from_bps(
            (per_second * known_hz / hz).clamp(BITRATE_LIMITS_BPS.0, BITRATE_LIMITS_BPS.1) as u32
        )
    };
    let config = EncoderConfig::new()
        .usage_type(UsageType::CameraVideoRealTime)
        .max_frame_rate(MaxFrameRate::from_hz(known_hz as f32))
        .intra_frame_period(IntraFramePeriod::from_num_frames(
            settings.frame_rate.frames_within(KEYFRAME_INTERVAL_S),
        ))
        // A keyframe on every large change would cost bits in every flash of light.
        .scene_change_detect(false)
        .adaptive_quantization(false)
        .background_detection(false)
        .num_threads(1)
        .vui(VuiConfig::bt709());
    let config = if hz > FRAME_RATE_LIMITS_HZ.1 {
        // It would promise decoders a slower video.
        config.level(Level::Level_5_2)
    } else {
        config
    };
    match settings.bitrate {
        // The mode that does not count bits, with one QP to choose from. The bitrate, one bit a
        // pixel, only sets the level that is promised to decoders.
        None => config
            .rate_control_mode(RateControlMode::Bufferbased)
            .qp(QpRange::new(QUALITY_QP + coarser, QUALITY_QP + coarser))
            .bitrate(bitrate(settings.size.pixels() as f64 * hz)),
        // Without skipping it prints a warning; see `frame` for what skipping comes to.
        Some(target) => config
            .rate_control_mode(RateControlMode::Bitrate)
            .skip_frames(true)
            .qp(QpRange::new(RATE_QPS.0 + coarser, RATE_QPS.1))
            .bitrate(bitrate(f64::from(target))),
    }
}

/// Puts parameter sets into `sets` and the other NAL units, behind lengths, into `sample`.
fn take_units(stream: &EncodedBitStream<'_>, sets: &mut Option<ParameterSets>, sample: &mut Vec<u8>) {
    sample.clear();
    let mut found = ParameterSets::default();
    for layer in (0..stream.num_layers()).filter_map(|at| stream.layer(at)) {
        for unit in (0..layer.nal_count()).filter_map(|at| layer.nal_unit(at)) {
            // Start codes have three bytes or four.
            let start = unit.iter().position(|&byte| byte == 1).map_or(0, |at| at + 1);
            let unit = &unit[start..];
            match unit.first().map(|header| header & 31) {
                Some(7) => found.sps = unit.to_vec(),
                Some(8) => found.pps = unit.to_vec(),
                Some(_) => {
                    sample.extend((unit.len() as u32).to_be_bytes());
                    sample.extend(unit);
                }
                None => {}
            }
        }
    }
    if found != ParameterSets::default() {
        // With the strategy of constant ids every keyframe repeats the same.
        assert!(sets.as_ref().is_none_or(|sets| *sets == found), "parameter sets changed");
        *sets = Some(found);
    }
}
