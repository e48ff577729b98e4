//! Writes frames to files: the pictures, their formats and their names.

use crate::layers::{LayerForm, Layers, PictureLayer};
use crate::picture::Picture;
use crate::{Error, Result};
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use wm_base::npy;
use wm_image::color::Dither;
use wm_image::{PictureSize, exr, flow, png};
use wm_render::frame::{ColorEncoding, srgb_decode, srgb_encode};

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
    /// Returns the format of a file name's extension.
    pub fn of(path: &Path) -> Option<Self> {
        // Not `.flo`, which holds no colours.
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        [Self::Png, Self::Exr, Self::Npy].into_iter().find(|format| format.extension() == extension)
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

/// A layer that is written beside the colour: `depth`, or `depth.npy` with its format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LayerFile {
    /// The layer.
    pub layer: PictureLayer,
    /// The format; `None` for that of the colour.
    pub format: Option<PictureFormat>,
}

impl FromStr for PictureFormat {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::of(Path::new(&format!("x.{text}"))).ok_or_else(|| format!("`{text}`: use png, exr or npy"))
    }
}

impl FromStr for LayerFile {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, extension) = text.split_once('.').map_or((text, None), |(name, end)| (name, Some(end)));
        // The colour is always written.
        let beside = PictureLayer::all().filter(|layer| *layer != PictureLayer::Color);
        let layer = PictureLayer::find(name, beside)?;
        let format = extension.map(|extension| match extension {
            "flo" if layer.form() == LayerForm::Flow => Ok(PictureFormat::Flo),
            "flo" => Err(format!("`{text}`: .flo holds optical flow alone: use flow.flo")),
            other => other.parse().map_err(|_| format!("`{text}`: use .png, .exr or .npy")),
        });
        Ok(Self { layer, format: format.transpose()? })
    }
}

/// Returns the layers that files show, with the colour.
#[must_use]
pub fn layers_of(also: &[LayerFile]) -> Layers {
    also.iter().fold(Layers::COLOR, |layers, file| layers | file.layer.into())
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
    pub fn is_layer(self, also: LayerFile, color: PictureFormat) -> bool {
        self == Self::Layers && color == PictureFormat::Exr && also.format.is_none()
    }
}

/// The files that a frame is written to, and their settings.
#[derive(Clone, Debug, Default)]
pub struct PictureStyle {
    /// Pictures beside the colour.
    pub also: Vec<LayerFile>,
    /// The place of those without a format of their own.
    pub place: LayerPlacement,
    /// The quantisation of 8-bit colour.
    pub dither: Dither,
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
                let channels: Vec<_> = layers.flat_map(|also| Self::channels(also.layer, picture)).collect();
                let planes =
                    exr::ExrPlanes { rgb: Some(&frame.rgb), channels: &channels, ..Default::default() };
                exr::write_exr(path, planes, size, &self.tags)?;
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
        let write = |also: &LayerFile| {
            let path = Self::path_of(*also, format, path);
            let note = self.write_layer(also.layer, also.format.unwrap_or(format), picture, &path)?;
            Ok(format!("{}{note}", path.display()))
        };
        own.map(write).collect()
    }

    /// The channels of an EXR layer.
    fn channels(layer: PictureLayer, picture: &Picture) -> Vec<(String, Vec<f32>)> {
        let values = linear_values(layer, picture);
        let channels = layer.channels();
        let of = |k: usize| values.iter().skip(k).step_by(channels.len()).copied().collect();
        channels.iter().enumerate().map(|(k, name)| (format!("{}.{name}", layer.name()), of(k))).collect()
    }

    /// Returns the path of `also` beside the colour `path` of format `format`.
    pub fn path_of(also: LayerFile, format: PictureFormat, path: &Path) -> PathBuf {
        beside(path, also.layer.name(), also.format.unwrap_or(format).extension())
    }

    /// Writes one layer; returns what must be known of it.
    ///
    /// # Errors
    /// [`Error::Media`] if the file cannot be written.
    pub fn write_layer(
        &self,
        layer: PictureLayer,
        format: PictureFormat,
        picture: &Picture,
        path: &Path,
    ) -> Result<String> {
        let size = PictureSize::new(picture.frame.width, picture.frame.height);
        let values = picture.layer(layer);
        match format {
            PictureFormat::Npy => {
                let values = linear_values(layer, picture);
                let (height, width) = (size.height as usize, size.width as usize);
                match layer.channels().len() {
                    1 => npy::write(path, &values, &[height, width])?,
                    channels => npy::write(path, &values, &[height, width, channels])?,
                }
            }
            PictureFormat::Flo => flow::write_flo(path, &values, size)?,
            PictureFormat::Exr => {
                let planes = exr::ExrPlanes::default();
                let named;
                let planes = match layer.form() {
                    LayerForm::Color => exr::ExrPlanes { rgb: Some(&values), ..planes },
                    LayerForm::Depth => exr::ExrPlanes { depth: Some(&values), ..planes },
                    LayerForm::Normal => exr::ExrPlanes { normals: Some(&values), ..planes },
                    LayerForm::Share(_) => exr::ExrPlanes { alpha: Some(&values), ..planes },
                    _ => {
                        // Alone in a file channels need no name of a layer.
                        let own = Self::channels(layer, picture).into_iter();
                        named = own
                            .map(|(mut name, values)| (name.split_off(layer.name().len() + 1), values))
                            .collect::<Vec<_>>();
                        exr::ExrPlanes { channels: &named, ..planes }
                    }
                };
                exr::write_exr(path, planes, size, &self.tags)?;
            }
            PictureFormat::Png => return self.write_png(layer, picture, size, path),
        }
        Ok(String::new())
    }

    /// Writes a layer as a PNG; returns what must be known of it.
    fn write_png(
        &self,
        layer: PictureLayer,
        picture: &Picture,
        size: PictureSize,
        path: &Path,
    ) -> Result<String> {
        let (values, tags) = (picture.layer(layer), &self.tags);
        let names = |values: &[f32]| -> Vec<u16> { values.iter().map(|name| *name as u16).collect() };
        let mut note = String::new();
        match layer.form() {
            LayerForm::Color => png::write_rgb(path, &values, size, self.dither, tags)?,
            LayerForm::Light => {
                let shown = |light: &f32| srgb_encode(f64::from(light.max(0.0))) as f32;
                let shown: Vec<f32> = values.iter().map(shown).collect();
                png::write_rgb(path, &shown, size, self.dither, tags)?;
            }
            LayerForm::Depth => {
                let scale = png::write_depth(path, &values, size, self.depth_scale, tags)?;
                note = format!(", {scale} m a count, 0 for nothing");
            }
            LayerForm::Normal => {
                png::write_normals(path, &values, size, png::ChannelBits::Sixteen, tags)?;
            }
            LayerForm::Share(bits) => png::write_alpha(path, &values, size, bits, tags)?,
            LayerForm::ColorShares => png::write_shares(path, &values, size, tags)?,
            LayerForm::Particles => {
                let coverage: Vec<f32> = values.iter().skip(3).step_by(4).copied().collect();
                png::write_alpha(path, &coverage, size, png::ChannelBits::Eight, tags)?;
                note = ", coverage alone".into();
            }
            LayerForm::Flow => {
                note = ", 64 counts a px from 32768".into();
                let long = flow::write_kitti(path, &values, size, tags)?;
                if long > 0 {
                    note += &format!("; {long} vectors of 512 px or more are left out: use .flo");
                }
            }
            LayerForm::States => {
                png::write_numbers(path, &names(&values), size, png::ChannelBits::Eight, tags)?;
                note = ", 0 visible, 1 occluded, 2 outside, 3 unknown".into();
            }
            LayerForm::Ids => {
                png::write_numbers(path, &names(&values), size, png::ChannelBits::Sixteen, tags)?;
                note = ", 0 for none".into();
            }
        }
        Ok(note)
    }
}

impl Picture {
    /// Writes the colour as `.png` (8 bits, dithered), `.exr` or `.npy` (linear light). For depth,
    /// normals and the other outputs see [`PictureStyle`].
    ///
    /// # Errors
    /// [`crate::Error::Media`] if the file cannot be written; [`crate::Error::Unsupported`] for
    /// another extension.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        let style = PictureStyle { tags: self.tags.clone(), ..PictureStyle::default() };
        style.write(self, path.as_ref()).map(drop)
    }
}

/// The values of a layer as files of floats have them: colours in linear light.
fn linear_values(layer: PictureLayer, picture: &Picture) -> Cow<'_, [f32]> {
    let values = picture.layer(layer);
    if layer.form() != LayerForm::Color || picture.frame.encoding == ColorEncoding::Linear {
        return values;
    }
    values.iter().map(|value| srgb_decode(f64::from(*value)) as f32).collect()
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
        assert_eq!("depth".parse(), Ok(LayerFile { layer: PictureLayer::Depth, format: None }));
        assert_eq!(
            "normal.exr".parse(),
            Ok(LayerFile { layer: PictureLayer::Normal, format: Some(PictureFormat::Exr) })
        );
        let flo = LayerFile { layer: PictureLayer::Flow, format: Some(PictureFormat::Flo) };
        assert_eq!("flow.flo".parse(), Ok(flo));
        assert!("depth.flo".parse::<LayerFile>().is_err() && "flo".parse::<PictureFormat>().is_err());
        assert!("depht".parse::<LayerFile>().is_err() && "depth.jpg".parse::<LayerFile>().is_err());
    }
}
