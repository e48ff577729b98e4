//! Views as fragments of addresses: a link is a weather, a camera and a time.
//!
//! `v=1&w=WEATHER&c=ex,ey,ez,qw,qx,qy,qz,fov&t=SECONDS`, then as far as they are not as usual
//! `o=OUTPUT`, `d=DIVIDER`, `p=PATH`, `f=path` and `l=LIDAR`. The weather is its file, the path and
//! the lidar are JSON; these three are deflated and in base64url. Numbers are the shortest decimals
//! that are read as the same value, so a link opens the same state, bit by bit. The size and the
//! quality are the screen's, and in no link.
//!
//! A link may come from anybody. Nothing in it is believed before [`View::new`] has checked it,
//! which [`open`] does.

use crate::catalog::Catalog;
use crate::state::{Follow, Pose, PoseKey, ViewOutput, ViewState, json_of};
use crate::text::{one_line, shown};
use crate::view::View;
use base64::Engine;
use base64::prelude::BASE64_URL_SAFE_NO_PAD;
use serde::de::DeserializeOwned;
use std::fmt::Write;

/// The version of links that this program writes and reads.
const LINK_VERSION: u32 = 1;
/// Longest fragment, bytes.
const MAX_FRAGMENT: usize = 64 << 10;
/// Most bytes that a fragment is inflated to, all of its parts together.
const MAX_INFLATED: usize = 256 << 10;

/// The keys of a fragment, in the order in which they are written.
const KEYS: [&str; 9] = ["v", "w", "c", "t", "o", "d", "p", "f", "l"];

/// Returns the fragment of a state, without `#`.
///
/// # Errors
/// The weather or the path is too long for a link, or the weather makes no file, in one line.
pub fn encode(state: &ViewState) -> Result<String, String> {
    let mut packer = Packer { room: MAX_INFLATED };
    let weather = toml::to_string(&state.weather).map_err(|error| fault("weather", &error))?;
    let mut text = format!("v={LINK_VERSION}&w={}", packer.packed(&weather)?);
    let Pose { eye: [x, y, z], rotation: [qw, qx, qy, qz], fov } = state.camera;
    let numbers = [x, y, z, qw, qx, qy, qz, fov].map(decimal).join(",");
    let _ = write!(text, "&c={numbers}&t={}", decimal(state.time));
    if state.output != ViewOutput::default() {
        let _ = write!(text, "&o={}", state.output.name());
    }
    if let Some(share) = state.divider {
        let _ = write!(text, "&d={}", decimal(share));
    }
    if !state.path.is_empty() {
        let path = serde_json::to_string(&state.path).map_err(|error| fault("path", &error))?;
        let _ = write!(text, "&p={}", packer.packed(&path)?);
    }
    if state.follow == Follow::Path {
        text += "&f=path";
    }
    if let Some(lidar) = &state.lidar {
        let lidar = serde_json::to_string(lidar).map_err(|error| fault("lidar", &error))?;
        let _ = write!(text, "&l={}", packer.packed(&lidar)?);
    }
    if text.len() > MAX_FRAGMENT {
        return Err(too_long());
    }
    Ok(text)
}

/// Returns the view of a fragment of a link to the scene of `catalog`; the size and the quality are
/// those of `base`.
///
/// # Errors
/// As [`decode`], or the first invalid value of its state, in one line.
pub fn open(fragment: &str, catalog: &Catalog, base: &ViewState) -> Result<View, String> {
    View::new(decode(fragment, base)?, catalog, None).map_err(|error| format!("link: {}", one_line(&error)))
}

/// Returns the state of a fragment; the size and the quality are those of `base`. The state is not
/// checked: [`View::new`] does that.
///
/// # Errors
/// The fragment is too long, of another version, or not one that [`encode`] could have written, in
/// one line.
pub fn decode(fragment: &str, base: &ViewState) -> Result<ViewState, String> {
    let fragment = fragment.strip_prefix('#').unwrap_or(fragment);
    if fragment.len() > MAX_FRAGMENT {
        return Err(format!("link: {} bytes are too many: the maximum is {MAX_FRAGMENT}", fragment.len()));
    }
    let mut values: [Option<&str>; KEYS.len()] = [None; KEYS.len()];
    let mut stranger = None;
    for pair in fragment.split('&') {
        let (key, value) = pair.split_once('=').unwrap_or((pair, ""));
        match KEYS.iter().position(|known| *known == key) {
            Some(index) if values[index].replace(value).is_some() => {
                return Err(format!("link: the key `{key}` is there twice"));
            }
            Some(_) => {}
            None => stranger = stranger.or(Some(key)),
        }
    }
    // First, as another version may have other keys.
    let [version, weather, camera, time, output, divider, path, follow, lidar] = values;
    match version.ok_or("link: it has no version: copy the whole link")?.parse::<u32>() {
        Ok(LINK_VERSION) => {}
        Ok(other) if other > LINK_VERSION => {
            return Err(format!(
                "link: its version is {other}, and this page is older: it reads version {LINK_VERSION}"
            ));
        }
        _ => return Err(format!("link: the version must be {LINK_VERSION}")),
    }
    if let Some(key) = stranger {
        return Err(format!("link: unknown key `{}`; the keys are {}", shown(key), KEYS.join(", ")));
    }
    let required = |key: &str, value: Option<&'_ str>| {
        value
            .map(str::to_owned)
            .ok_or_else(|| format!("link: the key `{key}` is missing: copy the whole link"))
    };
    let mut unpacker = Unpacker { room: MAX_INFLATED };
    let weather = unpacker.unpacked("w", &required("w", weather)?)?;
    let weather: toml::Table = toml::from_str(&weather).map_err(|error| fault("w", &error.message()))?;
    let [x, y, z, qw, qx, qy, qz, fov] = numbers("c", &required("c", camera)?)?;
    let [time] = numbers("t", &required("t", time)?)?;
    Ok(ViewState {
        camera: Pose { eye: [x, y, z], rotation: [qw, qx, qy, qz], fov },
        path: path.map(|path| unpacker.json::<Vec<PoseKey>>("p", path)).transpose()?.unwrap_or_default(),
        follow: follow.map_or(Ok(Follow::default()), |name| match name {
            "path" => Ok(Follow::Path),
            other => Err(format!("link: f is `{}`: must be path", shown(other))),
        })?,
        weather: json_of(toml::Value::Table(weather)),
        time,
        output: output.map_or(Ok(ViewOutput::default()), |name| {
            let known = ViewOutput::ALL.iter().find(|(_, known)| *known == name).map(|(output, _)| *output);
            known.ok_or_else(|| format!("link: o is `{}`: must be rgb, depth, normal or alpha", shown(name)))
        })?,
        size: base.size,
        quality: base.quality,
        divider: divider.map(|share| numbers("d", share).map(|[share]| share)).transpose()?,
        lidar: lidar.map(|lidar| unpacker.json("l", lidar)).transpose()?,
    })
}

/// The shortest decimal that is read as the same value.
fn decimal(number: f64) -> String {
    let text = format!("{number:?}");
    text.strip_suffix(".0").map_or(text.clone(), str::to_owned)
}

fn numbers<const N: usize>(key: &str, text: &str) -> Result<[f64; N], String> {
    let parsed = |part: &str| part.parse::<f64>().ok().filter(|number| number.is_finite());
    let all: Option<Vec<f64>> = text.split(',').take(N + 1).map(parsed).collect();
    all.and_then(|all| all.try_into().ok()).ok_or_else(|| match N {
        1 => format!("link: {key} is `{}`: must be a number", shown(text)),
        _ => format!("link: {key} is `{}`: must be {N} numbers between commas", shown(text)),
    })
}

/// Packs the parts of a fragment.
struct Packer {
    /// Bytes that the parts may still have together.
    room: usize,
}

impl Packer {
    fn packed(&mut self, text: &str) -> Result<String, String> {
        self.room = self.room.checked_sub(text.len()).ok_or_else(too_long)?;
        let level = sirocco::deflate::Level::BEST;
        Ok(BASE64_URL_SAFE_NO_PAD.encode(sirocco::compress(sirocco::Format::Deflate, level, text.as_bytes())))
    }
}

/// Unpacks the parts of a fragment.
struct Unpacker {
    /// Bytes that the parts may still have together.
    room: usize,
}

impl Unpacker {
    fn unpacked(&mut self, key: &str, text: &str) -> Result<String, String> {
        let packed = BASE64_URL_SAFE_NO_PAD.decode(text).map_err(|error| fault(key, &error))?;
        let bytes = sirocco::decompress(sirocco::Format::Deflate, &packed, self.room);
        let bytes = bytes.map_err(|error| fault(key, &error))?;
        self.room -= bytes.len();
        String::from_utf8(bytes).map_err(|_| fault(key, &"it is not UTF-8"))
    }

    fn json<T: DeserializeOwned>(&mut self, key: &str, text: &str) -> Result<T, String> {
        serde_json::from_str(&self.unpacked(key, text)?).map_err(|error| fault(key, &error))
    }
}

fn fault(part: &str, why: &dyn std::fmt::Display) -> String {
    format!("link: {part}: {}", one_line(&why.to_string()))
}

fn too_long() -> String {
    format!(
        "link: the weather and the path are too long for a link of {MAX_FRAGMENT} bytes; save them as files"
    )
}

#[cfg(test)]
mod tests;
