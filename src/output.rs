//! Frames to files: which pictures, in which formats, under which names.

use crate::media::color::Dither;
use crate::media::{MediaError, Size, exr, png};
use crate::names::beside;
use anyhow::{Result, bail};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use wm_render::{Frame, Geometry, MedianDepth, Outputs};
use wm_scene::npy;

/// A picture beside the colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Expected depth, metres.
    Depth,
    /// Median depth, metres.
    MedianDepth,
    /// Normals, world axes.
    Normal,
    /// Coverage.
    Alpha,
}

/// A file format of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// 8 bits for colour, 16 for depth, normals and alpha.
    Png,
    /// 32-bit floats; colour in linear light.
    Exr,
    /// 32-bit floats as an array.
    Npy,
}

impl Format {
    const ALL: [(Self, &'static str); 3] = [(Self::Png, "png"), (Self::Exr, "exr"), (Self::Npy, "npy")];

    /// The format that a file name's extension names.
    pub fn of(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        Self::ALL.iter().find(|(_, name)| *name == extension).map(|(format, _)| *format)
    }

    /// Its extension.
    pub fn extension(self) -> &'static str {
        Self::ALL.iter().find(|(format, _)| *format == self).map_or("png", |(_, name)| name)
    }
}

/// A picture that is asked for beside the colour: `depth`, or `depth.npy` with its format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Also {
    /// Which.
    pub kind: Kind,
    /// In which format; `None` for that of the colour.
    pub format: Option<Format>,
}

impl FromStr for Format {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::of(Path::new(&format!("x.{text}"))).ok_or_else(|| format!("`{text}`: use png, exr or npy"))
    }
}

impl FromStr for Also {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, extension) = match text.split_once('.') {
            Some((name, extension)) => (name, Some(extension)),
            None => (text, None),
        };
        let kind = match name {
            "depth" => Kind::Depth,
            "median-depth" => Kind::MedianDepth,
            "normal" => Kind::Normal,
            "alpha" => Kind::Alpha,
            _ => return Err(format!("`{name}` is no picture: use depth, median-depth, normal or alpha")),
        };
        let format = match extension {
            None => None,
            Some(extension) => Some(
                Format::of(Path::new(&format!("x.{extension}")))
                    .ok_or_else(|| format!("`{text}`: use .png, .exr or .npy"))?,
            ),
        };
        Ok(Self { kind, format })
    }
}

/// What must be rendered for the pictures that are asked for.
pub fn outputs(also: &[Also]) -> Outputs {
    let asks = |kind: Kind| also.iter().any(|also| also.kind == kind);
    let geometry = match (asks(Kind::Normal), asks(Kind::Depth)) {
        (true, _) => Geometry::DepthNormal,
        (false, true) => Geometry::Depth,
        _ => Geometry::None,
    };
    Outputs {
        geometry,
        median_depth: if asks(Kind::MedianDepth) { MedianDepth::On } else { MedianDepth::Off },
        particles: if asks(Kind::Particles) { ParticlePass::On } else { ParticlePass::Off },
    }
}

/// How frames are written.
#[derive(Clone, Debug)]
pub struct Style {
    /// Pictures beside the colour.
    pub also: Vec<Also>,
    /// How 8-bit colour is quantised.
    pub dither: Dither,
    /// Metres a unit of the frame's depth.
    pub metres_per_unit: f64,
    /// Scale of 16-bit depth.
    pub depth_scale: png::DepthScale,
    /// Written into every file that has room.
    pub tags: Vec<(String, String)>,
}

impl Style {
    /// Writes the colour to `path` and the other pictures beside it; returns a line for each of them.
    pub fn write(&self, frame: &Frame, path: &Path) -> Result<Vec<String>> {
        let size = Size::new(frame.width, frame.height);
        let (height, width) = (frame.height as usize, frame.width as usize);
        let Some(format) = Format::of(path) else {
            bail!("{}: a picture is written as .png, .exr or .npy", path.display());
        };
        match format {
            Format::Png => png::write_rgb(path, &frame.rgb, size, self.dither, &self.tags)?,
            Format::Exr => {
                exr::write_exr(
                    path,
                    exr::Planes { rgb: Some(&frame.rgb), ..Default::default() },
                    size,
                    &self.tags,
                )?;
            }
            Format::Npy => npy::write(path, &frame.rgb_linear(), &[height, width, 3])?,
        }
        self.also.iter().map(|also| self.write_also(*also, format, frame, size, path)).collect()
    }

    /// Where the picture `also` lies beside the colour `path` of format `format`.
    pub fn path_of(also: Also, format: Format, path: &Path) -> PathBuf {
        let name = match also.kind {
            Kind::Depth => "depth",
            Kind::MedianDepth => "median-depth",
            Kind::Normal => "normal",
            Kind::Alpha => "alpha",
        };
        beside(path, name, also.format.unwrap_or(format).extension())
    }

    fn write_also(
        &self,
        also: Also,
        format: Format,
        frame: &Frame,
        size: Size,
        path: &Path,
    ) -> Result<String> {
        let path = Self::path_of(also, format, path);
        let format = also.format.unwrap_or(format);
        let (height, width) = (frame.height as usize, frame.width as usize);
        let metres = |depth: &[f32]| -> Vec<f32> {
            depth.iter().map(|v| (f64::from(*v) * self.metres_per_unit) as f32).collect()
        };
        let mut note = String::new();
        match also.kind {
            Kind::Depth | Kind::MedianDepth => {
                let depth = if also.kind == Kind::Depth { &frame.depth } else { &frame.median_depth };
                let depth = metres(depth);
                match format {
                    Format::Png => {
                        let scale = png::write_depth(&path, &depth, size, self.depth_scale, &self.tags)?;
                        note = format!(", {scale} m a count, 0 for nothing");
                    }
                    Format::Exr => {
                        self.exr(&path, size, exr::Planes { depth: Some(&depth), ..Default::default() })?;
                    }
                    Format::Npy => npy::write(&path, &depth, &[height, width])?,
                }
            }
            Kind::Normal => match format {
                Format::Png => {
                    png::write_normals(&path, &frame.normal, size, png::Bits::Sixteen, &self.tags)?;
                }
                Format::Exr => {
                    self.exr(
                        &path,
                        size,
                        exr::Planes { normals: Some(&frame.normal), ..Default::default() },
                    )?;
                }
                Format::Npy => npy::write(&path, &frame.normal, &[height, width, 3])?,
            },
            Kind::Alpha => match format {
                Format::Png => png::write_alpha(&path, &frame.alpha, size, png::Bits::Sixteen, &self.tags)?,
                Format::Exr => {
                    self.exr(&path, size, exr::Planes { alpha: Some(&frame.alpha), ..Default::default() })?;
                }
                Format::Npy => npy::write(&path, &frame.alpha, &[height, width])?,
            },
        }
        Ok(format!("{}{note}", path.display()))
    }

    fn exr(&self, path: &Path, size: Size, planes: exr::Planes<'_>) -> Result<(), MediaError> {
        exr::write_exr(path, planes, size, &self.tags)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_asked_for_with_or_without_format() {
        assert_eq!("depth".parse(), Ok(Also { kind: Kind::Depth, format: None }));
        assert_eq!("normal.exr".parse(), Ok(Also { kind: Kind::Normal, format: Some(Format::Exr) }));
        assert!("depht".parse::<Also>().is_err() && "depth.jpg".parse::<Also>().is_err());
    }

    #[test]
    fn only_what_is_asked_for_is_rendered() {
        let ask = |text: &str| outputs(&text.split(',').map(|a| a.parse().unwrap()).collect::<Vec<_>>());
        assert_eq!(ask("alpha").geometry, Geometry::None);
        assert_eq!(ask("depth,alpha").geometry, Geometry::Depth);
        assert_eq!(ask("normal").geometry, Geometry::DepthNormal);
        assert_eq!(ask("median-depth").median_depth, MedianDepth::On);
    }
}
