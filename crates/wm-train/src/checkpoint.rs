//! A training on disk: everything on which its next step depends.
//!
//! `WMTRAIN3`, the length of a JSON head (u64), the head, then arrays of little-endian f32 in a
//! fixed order and of the lengths that the head gives, then of u32, and a checksum (FNV-1a, 64 bit)
//! of all before it. A file is whole or not there: it is written beside, flushed to the disk and
//! renamed, so that a training that is killed at any moment continues from its last checkpoint.

use crate::config::TrainConfig;
use crate::densify::Population;
use crate::exposure::{Exposures, TRANSFORM_VALUES};
use crate::trainer::TrainState;
use serde::{Deserialize, Serialize};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;
use wm_base::FormatError;
use wm_base::files::write_durably;
use wm_render::training::Moments;
use wm_scene::{Group, Splats, sh};

const MAGIC: &[u8; 8] = b"WMTRAIN3";
/// Longest head, bytes.
const MAX_HEAD: u64 = 1 << 24;

/// A reason why a checkpoint cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CheckpointError {
    /// It cannot be read.
    #[error("{}: cannot read the checkpoint: {source}", path.display())]
    Read {
        /// The checkpoint.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
    /// It is not a checkpoint of this version.
    #[error("{}: no checkpoint of this version; start anew with another --out", .0.display())]
    Version(PathBuf),
    /// It is not whole.
    #[error("{}: the checkpoint is damaged ({reason}); start anew, or use a copy", path.display())]
    Damaged {
        /// The checkpoint.
        path: PathBuf,
        /// The damage.
        reason: String,
    },
    /// It cannot be written.
    #[error(transparent)]
    Write(#[from] FormatError),
}

/// The part of a checkpoint that is not the state: configuration, photos, counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CheckpointHead {
    /// The configuration.
    pub config: TrainConfig,
    /// The training photos, in their order.
    pub(crate) photos: Vec<TrainedPhoto>,
    /// The SIMD path, on which the bytes depend.
    pub(crate) simd: String,
    step: u32,
    splats: usize,
    groups: Vec<(u8, usize)>,
    exposures: usize,
}

/// A training photo.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct TrainedPhoto {
    /// The name of the photo.
    pub(crate) name: String,
    /// The width and height in use, px.
    pub(crate) size: (u32, u32),
}

impl CheckpointHead {
    /// Returns the head for the state of a training.
    pub(crate) fn new(
        config: &TrainConfig,
        photos: Vec<TrainedPhoto>,
        simd: String,
        state: &TrainState,
    ) -> Self {
        let mut groups: Vec<(u8, usize)> = Vec::new();
        for group in &state.population.splats.groups {
            match groups.last_mut() {
                Some((last, count)) if *last == *group as u8 => *count += 1,
                _ => groups.push((*group as u8, 1)),
            }
        }
        Self {
            config: config.clone(),
            photos,
            simd,
            step: state.step,
            splats: state.population.len(),
            groups,
            exposures: state.exposures.changes.len(),
        }
    }

    /// Returns the number of steps that are done.
    #[must_use]
    pub fn step(&self) -> u32 {
        self.step
    }
}

/// Writes a checkpoint.
///
/// # Errors
/// [`CheckpointError::Write`]; what was there before is there still.
pub fn write(path: &Path, head: &CheckpointHead, state: &TrainState) -> Result<(), CheckpointError> {
    let text = serde_json::to_vec(head).map_err(|error| damaged(path, &error.to_string()))?;
    write_durably(path, |out| {
        let mut out = Summed { inner: out, sum: FNV_START };
        out.write_all(MAGIC)?;
        out.write_all(&(text.len() as u64).to_le_bytes())?;
        out.write_all(&text)?;
        let mut bytes = Vec::new();
        for array in arrays!(state, as_flattened) {
            for values in array.chunks(1 << 16) {
                bytes.clear();
                bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
                out.write_all(&bytes)?;
            }
        }
        for steps in [&state.population.seen, &state.exposures.steps].into_iter().flatten() {
            out.write_all(&steps.to_le_bytes())?;
        }
        let sum = out.sum;
        out.write_all(&sum.to_le_bytes())?;
        Ok(())
    })?;
    Ok(())
}

/// Reads a checkpoint.
///
/// # Errors
/// [`CheckpointError`] if it cannot be read, is of another version or damaged.
pub fn read(path: &Path) -> Result<(CheckpointHead, TrainState), CheckpointError> {
    let bytes =
        std::fs::read(path).map_err(|source| CheckpointError::Read { path: path.to_owned(), source })?;
    parse(path, &bytes)
}

fn damaged(path: &Path, reason: &str) -> CheckpointError {
    CheckpointError::Damaged { path: path.to_owned(), reason: reason.to_owned() }
}

fn parse(path: &Path, bytes: &[u8]) -> Result<(CheckpointHead, TrainState), CheckpointError> {
    let cut = || damaged(path, "it is cut off");
    let version = || CheckpointError::Version(path.to_owned());
    if bytes.get(..MAGIC.len()) != Some(MAGIC) {
        return Err(version());
    }
    let (body, sum) = bytes.split_last_chunk::<8>().ok_or_else(cut)?;
    let mut rest = body.get(MAGIC.len()..).ok_or_else(cut)?;
    let mut length = [0; 8];
    rest.read_exact(&mut length).map_err(|_| cut())?;
    let length = u64::from_le_bytes(length);
    if length > MAX_HEAD || length > rest.len() as u64 {
        return Err(cut());
    }
    let (text, mut rest) = rest.split_at(length as usize);
    if hash(FNV_START, body) != u64::from_le_bytes(*sum) {
        return Err(damaged(path, "its checksum is wrong, or it is cut off"));
    }
    // If the checksum is right, an unreadable head is of another version.
    let head: CheckpointHead = serde_json::from_slice(text).map_err(|_| version())?;
    let degree = head.config.sh_degree;
    if degree > sh::MAX_DEGREE {
        return Err(version());
    }
    // Bytes per splat: parameters with two moments each, three sums of screen-space gradients, and
    // the last step in view.
    let per_splat = 4 * (3 * (11 + 3 * sh::coefficients(degree)) + 4);
    let expected =
        head.splats.checked_mul(per_splat).zip(head.exposures.checked_mul(4 * (3 * TRANSFORM_VALUES + 1)));
    if expected.and_then(|(a, b)| a.checked_add(b)) != Some(rest.len()) {
        return Err(damaged(path, "its size is not what its head says"));
    }
    let mut groups = Vec::with_capacity(head.splats);
    for (number, count) in &head.groups {
        let group = Group::from_number(*number).ok_or_else(version)?;
        if *count > head.splats - groups.len() {
            return Err(damaged(path, "groups are more than splats"));
        }
        groups.resize(groups.len() + count, group);
    }
    if groups.len() != head.splats {
        return Err(damaged(path, "groups are fewer than splats"));
    }
    let splats = Splats { groups, ..Splats::zeroed(head.splats, degree) };
    let population = Population::unsorted(splats);
    let mut state = TrainState { step: head.step, population, exposures: Exposures::new(head.exposures) };
    for array in arrays!(state, as_flattened_mut, mut) {
        let (own, after) = rest.split_at(4 * array.len());
        for (value, bytes) in array.iter_mut().zip(own.as_chunks::<4>().0) {
            *value = f32::from_le_bytes(*bytes);
        }
        rest = after;
    }
    let steps = [&mut state.population.seen, &mut state.exposures.steps].into_iter().flatten();
    for (steps, bytes) in steps.zip(rest.as_chunks::<4>().0) {
        *steps = u32::from_le_bytes(*bytes);
    }
    Ok((head, state))
}

/// Every array of a state, in the order of the file: `arrays!(state, as_flattened)` to read,
/// `arrays!(state, as_flattened_mut, mut)` to fill.
macro_rules! arrays {
    ($state:expr, $flat:ident $(, $mutable:tt)?) => {{
        let Population { splats, moments, pulls, .. } = & $($mutable)? $state.population;
        let Moments { means, quats, log_scales, logit_opacities, sh } = moments;
        [
            splats.means.$flat(),
            splats.quats.$flat(),
            splats.log_scales.$flat(),
            & $($mutable)? splats.logit_opacities[..],
            & $($mutable)? splats.sh[..],
            & $($mutable)? means.first[..],
            & $($mutable)? means.second[..],
            & $($mutable)? quats.first[..],
            & $($mutable)? quats.second[..],
            & $($mutable)? log_scales.first[..],
            & $($mutable)? log_scales.second[..],
            & $($mutable)? logit_opacities.first[..],
            & $($mutable)? logit_opacities.second[..],
            & $($mutable)? sh.first[..],
            & $($mutable)? sh.second[..],
            & $($mutable)? pulls.sums[..],
            & $($mutable)? pulls.counts[..],
            & $($mutable)? pulls.radii[..],
            $state.exposures.changes.$flat(),
            $state.exposures.moments.$flat().$flat(),
        ]
    }};
}
use arrays;

pub(crate) const FNV_START: u64 = 0xcbf2_9ce4_8422_2325;

/// FNV-1a.
pub(crate) fn hash(sum: u64, bytes: &[u8]) -> u64 {
    bytes.iter().fold(sum, |sum, byte| (sum ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3))
}

/// Writes and updates the checksum.
pub(crate) struct Summed<'a> {
    pub(crate) inner: &'a mut dyn Write,
    pub(crate) sum: u64,
}

impl Write for Summed<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.inner.write(bytes)?;
        self.sum = hash(self.sum, &bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Preset;
    use wm_render::testing::random_splats;

    fn state() -> (CheckpointHead, TrainState) {
        let mut population = Population::new(random_splats(40, 3, 1));
        population.splats.groups[3] = Group::Sky;
        population.moments.sh.first[7] = 0.25;
        population.pulls.radii[9] = 12.0;
        population.seen[39] = 1230;
        let mut exposures = Exposures::new(3);
        exposures.changes[1][4] = 0.5;
        exposures.steps[2] = 77;
        let state = TrainState { step: 1234, population, exposures };
        let config = TrainConfig::preset(Preset::Quick);
        let photos = vec![TrainedPhoto { name: "a.jpg".into(), size: (60, 40) }];
        (CheckpointHead::new(&config, photos, "portable".into(), &state), state)
    }

    #[test]
    fn a_training_comes_back_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.wmtrain");
        let (head, state) = state();
        write(&path, &head, &state).unwrap();
        assert_eq!(read(&path).unwrap(), (head, state));
    }

    #[test]
    fn what_is_not_whole_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.wmtrain");
        let (head, state) = state();
        write(&path, &head, &state).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        for length in (0..bytes.len()).step_by(97).chain(bytes.len() - 9..bytes.len()) {
            assert!(parse(&path, &bytes[..length]).is_err(), "{length} bytes are no checkpoint");
        }
        for at in (8..bytes.len()).step_by(131) {
            let mut changed = bytes.clone();
            changed[at] ^= 4;
            assert!(
                matches!(parse(&path, &changed), Err(CheckpointError::Damaged { .. })),
                "byte {at} may not change"
            );
        }
        std::fs::write(&path, b"WMTRAIN0 something").unwrap();
        let message = read(&path).unwrap_err().to_string();
        assert!(
            message.ends_with("no checkpoint of this version; start anew with another --out"),
            "{message}"
        );
    }
}
