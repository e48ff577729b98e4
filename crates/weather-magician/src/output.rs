//! Writes frames to files: the pictures, their formats and their names.

use crate::picture::Picture;
use crate::{Error, Result};
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use wm_media::color::Dither;
use wm_media::{MediaError, PictureSize, exr, flow, png};
use wm_render::frame::srgb_encode;
use wm_render::parts::PicturePart;
use wm_render::{Geometry, MedianDepth, Outputs, ParticlePass, WaterPass};
use wm_scene::npy;
use wm_scene::splats::LabelKind;

/// A picture that is written beside the colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureLayer {
    /// Expected depth, metres.
    Depth,
    /// Median depth, metres.
    MedianDepth,
    /// Normals, world axes.
    Normal,
    /// Coverage.
    Alpha,
    /// The share of the scene's light that the air lets through.
    Transmittance,
    /// Falling particles, and their coverage.
    Particles,
    /// The scene without air and without falling particles.
    Clean,
    /// The light that the air adds.
    Airlight,
    /// Water that is seen: the share of a pixel that its surface is, 0-1.
    Water,
    /// Reflections: the share of a pixel's light that the water mirrors, 0-1.
    Reflection,
    /// Depth of the water's surface, metres, 0 where there is none.
    WaterDepth,
    /// Optical flow of the scene to the next frame, px to the right and down.
    Flow,
    /// The fate of each pixel of the flow: the numbers of [`crate::flow::FlowState`].
    FlowMask,
    /// Optical flow of falling rain, snow and hail to the next frame, px to the right and down.
    ParticleFlow,
    /// The label of what each pixel shows, 0 for none.
    Label,
    /// The number of the thing that each pixel shows, 0 for none.
    Instance,
}

impl PictureLayer {
    const ALL: [(Self, &'static str); 16] = [
        (Self::Depth, "depth"),
        (Self::MedianDepth, "median-depth"),
        (Self::Normal, "normal"),
        (Self::Alpha, "alpha"),
        (Self::Transmittance, "transmittance"),
        (Self::Particles, "particles"),
        (Self::Clean, "clean"),
        (Self::Airlight, "airlight"),
        (Self::Water, "water"),
        (Self::Reflection, "reflection"),
        (Self::WaterDepth, "water-depth"),
        (Self::Flow, "flow"),
        (Self::FlowMask, "flow-mask"),
        (Self::ParticleFlow, "particle-flow"),
        (Self::Label, "label"),
        (Self::Instance, "instance"),
    ];

    /// Returns its name, as in `--also`.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(kind, _)| *kind == self).map_or("", |(_, name)| name)
    }

    /// Returns the names of its channels in an EXR file.
    #[must_use]
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Self::Depth | Self::MedianDepth | Self::WaterDepth => &["Z"],
            Self::Normal => &["X", "Y", "Z"],
            Self::Alpha | Self::Water | Self::Reflection => &["A"],
            Self::Flow | Self::ParticleFlow => &["U", "V"],
            Self::FlowMask => &["STATE"],
            Self::Label | Self::Instance => &["ID"],
            Self::Particles => &["R", "G", "B", "A"],
            Self::Transmittance | Self::Clean | Self::Airlight => &["R", "G", "B"],
        }
    }

    /// The part of a picture that needs renders of its own for this layer.
    fn part(self) -> Option<PicturePart> {
        match self {
            Self::Transmittance => Some(PicturePart::Transmittance),
            Self::Clean => Some(PicturePart::Clean),
            Self::Airlight => Some(PicturePart::Airlight),
            _ => None,
        }
    }
}

/// A file format of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureFormat {
    /// 8 bits for colour, 16 for depth, normals and alpha.
    Png,
    /// 32-bit floats; colour in linear light.
    Exr,
    /// 32-bit floats as an array.
    Npy,
    /// Middlebury's format of optical flow, for [`PictureLayer::Flow`] alone.
    Flo,
}

impl PictureFormat {
    const ALL: [(Self, &'static str); 3] = [(Self::Png, "png"), (Self::Exr, "exr"), (Self::Npy, "npy")];

    /// Returns the format of a file name's extension.
    pub fn of(path: &Path) -> Option<Self> {
        // Not `.flo`, which holds no colours.
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        Self::ALL.iter().find(|(_, name)| *name == extension).map(|(format, _)| *format)
    }

    /// Returns the file name extension.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Exr => "exr",
            Self::Npy => "npy",
            Self::Flo => "flo",
        }
    }
}

/// A picture to write beside the colour: `depth`, or `depth.npy` with its format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExtraPicture {
    /// The layer.
    pub kind: PictureLayer,
    /// The format; `None` for that of the colour.
    pub format: Option<PictureFormat>,
}

impl FromStr for PictureFormat {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::of(Path::new(&format!("x.{text}"))).ok_or_else(|| format!("`{text}`: use png, exr or npy"))
    }
}

impl FromStr for ExtraPicture {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, extension) = match text.split_once('.') {
            Some((name, extension)) => (name, Some(extension)),
            None => (text, None),
        };
        let kind = PictureLayer::ALL.iter().find(|(_, known)| *known == name).map(|(kind, _)| *kind);
        let kind = kind.ok_or_else(|| {
            let names = PictureLayer::ALL.map(|(_, name)| name);
            let [most @ .., last] = &names;
            format!("`{name}` is not a picture output: use {} or {last}", most.join(", "))
        })?;
        let format = match extension {
            None => None,
            Some("flo") if kind == PictureLayer::Flow || kind == PictureLayer::ParticleFlow => {
                Some(PictureFormat::Flo)
            }
            Some("flo") => return Err(format!("`{text}`: .flo holds optical flow alone: use flow.flo")),
            Some(extension) => Some(
                PictureFormat::of(Path::new(&format!("x.{extension}")))
                    .ok_or_else(|| format!("`{text}`: use .png, .exr or .npy"))?,
            ),
        };
        Ok(Self { kind, format })
    }
}

/// Layers of water.
const WATER: [PictureLayer; 3] = [PictureLayer::Water, PictureLayer::Reflection, PictureLayer::WaterDepth];

/// Returns the outputs that must be rendered for `also`.
pub fn outputs(also: &[ExtraPicture]) -> Outputs {
    let asks = |kind: PictureLayer| also.iter().any(|also| also.kind == kind);
    let geometry = match (asks(PictureLayer::Normal), asks(PictureLayer::Depth)) {
        (true, _) => Geometry::DepthNormal,
        (false, true) => Geometry::Depth,
        _ => Geometry::None,
    };
    Outputs {
        geometry,
        median_depth: if asks(PictureLayer::MedianDepth) { MedianDepth::On } else { MedianDepth::Off },
        particles: if asks(PictureLayer::Particles) { ParticlePass::On } else { ParticlePass::Off },
        water: if WATER.into_iter().any(asks) { WaterPass::On } else { WaterPass::Off },
    }
}

/// Returns the parts of `also` that need renders of their own.
pub fn parts(also: &[ExtraPicture]) -> Vec<PicturePart> {
    also.iter().filter_map(|also| also.kind.part()).collect()
}

/// Returns true if `also` asks for the flow to the next frame ([`crate::Renderer::render_flow`]).
#[must_use]
pub fn asks_for_flow(also: &[ExtraPicture]) -> bool {
    also.iter().any(|also| matches!(also.kind, PictureLayer::Flow | PictureLayer::FlowMask))
}

/// Returns true if `also` asks for the flow of what falls
/// ([`crate::Renderer::render_particle_flow`]).
#[must_use]
pub fn asks_for_particle_flow(also: &[ExtraPicture]) -> bool {
    also.iter().any(|also| also.kind == PictureLayer::ParticleFlow)
}

/// Returns the kinds of labels that `also` asks for ([`crate::Renderer::render_labels`]).
#[must_use]
pub fn asked_labels(also: &[ExtraPicture]) -> Vec<LabelKind> {
    let kind = |also: &ExtraPicture| match also.kind {
        PictureLayer::Label => Some(LabelKind::Label),
        PictureLayer::Instance => Some(LabelKind::Instance),
        _ => None,
    };
    also.iter().filter_map(kind).collect()
}

/// The place of layers that have no format of their own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LayerPlacement {
    /// Beside the colour, a file each.
    #[default]
    Beside,
    /// Into the colour's EXR, a layer each.
    Layers,
}

impl LayerPlacement {
    /// Returns true if `also` is a layer of the colour's file, which is of the format `color`.
    pub fn is_layer(self, also: ExtraPicture, color: PictureFormat) -> bool {
        self == Self::Layers && color == PictureFormat::Exr && also.format.is_none()
    }
}

/// The files that a frame is written to, and their settings.
#[derive(Clone, Debug, Default)]
pub struct PictureStyle {
    /// Pictures beside the colour.
    pub also: Vec<ExtraPicture>,
    /// The place of those without a format of their own.
    pub place: LayerPlacement,
    /// The quantisation of 8-bit colour.
    pub dither: Dither,
    /// Metres a unit of the frame's depth.
    pub metres_per_unit: f64,
    /// Scale of 16-bit depth.
    pub depth_scale: png::DepthScale,
    /// Written into every file that has room.
    pub tags: Vec<(String, String)>,
}

impl PictureStyle {
    /// Writes the colour to `path` and the other pictures beside it; returns a line for each of
    /// them.
    ///
    /// # Errors
    /// [`Error`] if a file cannot be written, or its extension is not .png, .exr or .npy.
    pub fn write(&self, picture: &Picture, path: &Path) -> Result<Vec<String>> {
        let frame = &picture.frame;
        let size = PictureSize::new(frame.width, frame.height);
        let Some(format) = PictureFormat::of(path) else {
            let text = format!("{}: a picture is written as .png, .exr or .npy", path.display());
            return Err(Error::Unsupported(text));
        };
        match format {
            PictureFormat::Png => png::write_rgb(path, &frame.rgb, size, self.dither, &self.tags)?,
            PictureFormat::Exr => {
                let layers = self.also.iter().filter(|also| self.place.is_layer(**also, format));
                let channels: Vec<_> = layers.flat_map(|also| self.layer(also.kind, picture)).collect();
                self.exr(
                    path,
                    size,
                    exr::ExrPlanes { rgb: Some(&frame.rgb), channels: &channels, ..Default::default() },
                )?;
            }
            PictureFormat::Flo => {
                let text = format!("{}: .flo holds no colours", path.display());
                return Err(Error::Unsupported(text));
            }
            PictureFormat::Npy => {
                let shape = [frame.height as usize, frame.width as usize, 3];
                npy::write(path, &frame.rgb_linear(), &shape)?;
            }
        }
        let own = self.also.iter().filter(|also| !self.place.is_layer(**also, format));
        own.map(|also| self.write_also(*also, format, picture, size, path)).collect()
    }

    /// The channels of an EXR layer.
    fn layer(&self, kind: PictureLayer, picture: &Picture) -> Vec<(String, Vec<f32>)> {
        let values = self.values(kind, picture);
        let channels = kind.channels();
        let of = |k: usize| values.iter().skip(k).step_by(channels.len()).copied().collect();
        channels.iter().enumerate().map(|(k, name)| (format!("{}.{name}", kind.name()), of(k))).collect()
    }

    /// The values of a picture, `[H, W, C]`: metres, world axes, shares and linear light.
    fn values<'a>(&self, kind: PictureLayer, picture: &'a Picture) -> Cow<'a, [f32]> {
        let Picture { frame, parts, water, .. } = picture;
        // A picture without water has none of its layers.
        let share = |share: &'a [f32]| match share {
            [] => Cow::Owned(vec![0.0; frame.pixels()]),
            share => Cow::Borrowed(share),
        };
        let metres = |depth: &[f32]| -> Vec<f32> {
            depth.iter().map(|v| (f64::from(*v) * self.metres_per_unit) as f32).collect()
        };
        Cow::Borrowed(match kind {
            PictureLayer::Depth => return Cow::Owned(metres(&frame.depth)),
            PictureLayer::MedianDepth => return Cow::Owned(metres(&frame.median_depth)),
            PictureLayer::Normal => &frame.normal,
            PictureLayer::Alpha => &frame.alpha,
            PictureLayer::Particles => &frame.particles,
            PictureLayer::Transmittance => &parts.transmittance,
            PictureLayer::Clean => &parts.clean,
            PictureLayer::Airlight => &parts.airlight,
            PictureLayer::Water => return share(&water.cover),
            PictureLayer::Reflection => return share(&water.reflected),
            PictureLayer::WaterDepth => return Cow::Owned(metres(&share(&water.depth))),
            PictureLayer::Flow => &picture.flow.vectors,
            PictureLayer::ParticleFlow => &picture.particle_flow,
            PictureLayer::Label => return Cow::Owned(numbers(&picture.labels.label)),
            PictureLayer::Instance => return Cow::Owned(numbers(&picture.labels.instance)),
            PictureLayer::FlowMask => {
                return Cow::Owned(picture.flow.states.iter().map(|state| f32::from(*state)).collect());
            }
        })
    }

    /// Returns the path of `also` beside the colour `path` of format `format`.
    pub fn path_of(also: ExtraPicture, format: PictureFormat, path: &Path) -> PathBuf {
        beside(path, also.kind.name(), also.format.unwrap_or(format).extension())
    }

    fn write_also(
        &self,
        also: ExtraPicture,
        format: PictureFormat,
        picture: &Picture,
        size: PictureSize,
        path: &Path,
    ) -> Result<String> {
        let path = Self::path_of(also, format, path);
        let format = also.format.unwrap_or(format);
        let note = self.write_one(also.kind, format, picture, size, &path)?;
        Ok(format!("{}{note}", path.display()))
    }

    /// Writes one picture beside the colour; returns what must be known of it.
    pub fn write_one(
        &self,
        kind: PictureLayer,
        format: PictureFormat,
        picture: &Picture,
        size: PictureSize,
        path: &Path,
    ) -> Result<String> {
        let values = self.values(kind, picture);
        let tags = &self.tags;
        match (format, kind) {
            (PictureFormat::Npy, _) => {
                let (height, width) = (size.height as usize, size.width as usize);
                match kind.channels().len() {
                    1 => npy::write(path, &values, &[height, width])?,
                    channels => npy::write(path, &values, &[height, width, channels])?,
                }
            }
            (
                PictureFormat::Exr,
                PictureLayer::Depth | PictureLayer::MedianDepth | PictureLayer::WaterDepth,
            ) => {
                self.exr(path, size, exr::ExrPlanes { depth: Some(&values), ..Default::default() })?;
            }
            (PictureFormat::Flo, _) => flow::write_flo(path, &values, size)?,
            (PictureFormat::Exr, PictureLayer::Normal) => {
                self.exr(path, size, exr::ExrPlanes { normals: Some(&values), ..Default::default() })?;
            }
            (PictureFormat::Exr, PictureLayer::Alpha | PictureLayer::Water | PictureLayer::Reflection) => {
                self.exr(path, size, exr::ExrPlanes { alpha: Some(&values), ..Default::default() })?;
            }
            (PictureFormat::Exr, _) => {
                let mut channels = self.layer(kind, picture);
                // Alone in a file they need no name of a layer.
                channels.iter_mut().for_each(|(name, _)| *name = name.split_off(kind.name().len() + 1));
                self.exr(path, size, exr::ExrPlanes { channels: &channels, ..Default::default() })?;
            }
            (
                PictureFormat::Png,
                PictureLayer::Depth | PictureLayer::MedianDepth | PictureLayer::WaterDepth,
            ) => {
                let scale = png::write_depth(path, &values, size, self.depth_scale, tags)?;
                return Ok(format!(", {scale} m a count, 0 for nothing"));
            }
            (PictureFormat::Png, PictureLayer::Normal) => {
                png::write_normals(path, &values, size, png::ChannelBits::Sixteen, tags)?;
            }
            (PictureFormat::Png, PictureLayer::Alpha) => {
                png::write_alpha(path, &values, size, png::ChannelBits::Sixteen, tags)?;
            }
            (PictureFormat::Png, PictureLayer::Water | PictureLayer::Reflection) => {
                png::write_alpha(path, &values, size, png::ChannelBits::Eight, tags)?;
            }
            (PictureFormat::Png, PictureLayer::Transmittance) => {
                png::write_shares(path, &values, size, tags)?;
            }
            (PictureFormat::Png, PictureLayer::Particles) => {
                let coverage: Vec<f32> = values.iter().skip(3).step_by(4).copied().collect();
                png::write_alpha(path, &coverage, size, png::ChannelBits::Eight, tags)?;
                return Ok(", coverage alone".into());
            }
            (PictureFormat::Png, PictureLayer::Flow | PictureLayer::ParticleFlow) => {
                return Ok(match flow::write_kitti(path, &values, size, tags)? {
                    0 => ", 64 counts a px from 32768".into(),
                    long => format!(
                        ", 64 counts a px from 32768; {long} vectors of 512 px or more are left out: use .flo"
                    ),
                });
            }
            (PictureFormat::Png, PictureLayer::FlowMask) => {
                let states: Vec<u16> = picture.flow.states.iter().map(|state| u16::from(*state)).collect();
                png::write_numbers(path, &states, size, png::ChannelBits::Eight, tags)?;
                return Ok(", 0 visible, 1 occluded, 2 outside, 3 unknown".into());
            }
            (PictureFormat::Png, PictureLayer::Label | PictureLayer::Instance) => {
                let labels = &picture.labels;
                let names = if kind == PictureLayer::Label { &labels.label } else { &labels.instance };
                png::write_numbers(path, names, size, png::ChannelBits::Sixteen, tags)?;
                return Ok(", 0 for none".into());
            }
            (PictureFormat::Png, PictureLayer::Clean | PictureLayer::Airlight) => {
                let shown = |light: &f32| srgb_encode(f64::from(light.max(0.0))) as f32;
                let shown: Vec<f32> = values.iter().map(shown).collect();
                png::write_rgb(path, &shown, size, self.dither, tags)?;
            }
        }
        Ok(String::new())
    }

    fn exr(&self, path: &Path, size: PictureSize, planes: exr::ExrPlanes<'_>) -> Result<(), MediaError> {
        exr::write_exr(path, planes, size, &self.tags)
    }
}

impl Picture {
    /// Returns the values of a layer that was rendered, `[H, W, C]` with the channels of
    /// [`PictureLayer::channels`]: metres, world axes, shares, linear light or px. Empty if it was
    /// not asked for.
    #[must_use]
    pub fn layer(&self, layer: PictureLayer) -> Cow<'_, [f32]> {
        PictureStyle { metres_per_unit: self.metres_per_unit, ..PictureStyle::default() }.values(layer, self)
    }
}

/// Labels as numbers of files that hold floats, which have them exactly.
fn numbers(labels: &[u16]) -> Vec<f32> {
    labels.iter().map(|label| f32::from(*label)).collect()
}

/// Returns `path` with `.kind.extension` for its extension: `a.png` and depth give `a.depth.png`.
#[must_use]
pub fn beside(path: &Path, kind: &str, extension: &str) -> PathBuf {
    path.with_extension(format!("{kind}.{extension}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_asked_for_with_or_without_format() {
        assert_eq!("depth".parse(), Ok(ExtraPicture { kind: PictureLayer::Depth, format: None }));
        assert_eq!(
            "normal.exr".parse(),
            Ok(ExtraPicture { kind: PictureLayer::Normal, format: Some(PictureFormat::Exr) })
        );
        let flo = ExtraPicture { kind: PictureLayer::Flow, format: Some(PictureFormat::Flo) };
        assert_eq!("flow.flo".parse(), Ok(flo));
        assert!("depth.flo".parse::<ExtraPicture>().is_err() && "flo".parse::<PictureFormat>().is_err());
        assert!("depht".parse::<ExtraPicture>().is_err() && "depth.jpg".parse::<ExtraPicture>().is_err());
    }

    #[test]
    fn only_what_is_asked_for_is_rendered() {
        let ask = |text: &str| outputs(&text.split(',').map(|a| a.parse().unwrap()).collect::<Vec<_>>());
        assert_eq!(ask("alpha").geometry, Geometry::None);
        assert_eq!(ask("depth,alpha").geometry, Geometry::Depth);
        assert_eq!(ask("normal").geometry, Geometry::DepthNormal);
        assert_eq!(ask("median-depth").median_depth, MedianDepth::On);
        assert_eq!(ask("transmittance,alpha").particles, ParticlePass::Off);
        assert_eq!(ask("particles").particles, ParticlePass::On);
        let also: Vec<ExtraPicture> =
            ["depth", "clean", "transmittance.npy"].map(|a| a.parse().unwrap()).into();
        assert_eq!(parts(&also), [PicturePart::Clean, PicturePart::Transmittance]);
    }
}
