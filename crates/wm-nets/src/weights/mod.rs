//! Files of weights: tensors by name, out of one file or several.
//!
//! Headers are not trusted: their claims are compared with the file's length, and the shape of a
//! tensor with that of the network, before memory is allocated. Only the requested tensors of a
//! large file are read.
//!
//! Files of PyTorch are read here and not by candle, whose reader allocates what a file claims.

mod entry;
#[cfg(feature = "fetch")]
pub mod fetch;
mod licence;
mod pth;
mod safetensors;
#[cfg(test)]
mod tests;

pub use entry::WeightsFault;
pub use licence::Licence;

use crate::ops::numbers;
use candle_core::{DType, Device, Tensor};
use entry::{Entry, read};
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Weights that cannot be used.
#[derive(Debug, Error)]
#[error("{}: {fault}", names(files))]
pub struct WeightsError {
    /// The file, or all of them where any might have what is missing.
    pub files: Vec<PathBuf>,
    /// The fault.
    pub fault: WeightsFault,
}

fn names(files: &[PathBuf]) -> String {
    files.iter().map(|file| file.display().to_string()).collect::<Vec<_>>().join(", ")
}

/// One file that is open.
#[derive(Debug)]
struct WeightsFile {
    path: PathBuf,
    file: File,
    entries: HashMap<String, Entry>,
}

/// Tensors by name.
#[derive(Debug)]
pub(crate) struct Weights {
    files: Vec<WeightsFile>,
    advice: &'static str,
}

impl Weights {
    /// Opens files and reads their headers: safetensors, or what `torch.save` writes of a
    /// `state_dict()`. `advice` is said where a tensor is missing or of another shape: which files
    /// have them.
    ///
    /// # Errors
    /// [`WeightsError`] with the file that cannot be read, is of another format or damaged.
    pub(crate) fn open(files: &[PathBuf], advice: &'static str) -> Result<Self, WeightsError> {
        let open =
            |path: &PathBuf| open(path).map_err(|fault| WeightsError { files: vec![path.clone()], fault });
        Ok(Self { files: files.iter().map(open).collect::<Result<_, _>>()?, advice })
    }

    /// Returns the shape of a tensor in the first file that has it.
    pub(crate) fn shape(&self, name: &str) -> Option<&[usize]> {
        self.files.iter().find_map(|file| file.entries.get(name)).map(|entry| &entry.shape[..])
    }

    /// Returns the length of a side of a tensor, of 1 to `most`: an empty tensor may claim any.
    ///
    /// # Errors
    /// [`WeightsError`] if there is no such tensor, or the side has another length.
    pub(crate) fn length(&self, name: &str, axis: usize, most: usize) -> Result<usize, WeightsError> {
        let shape = self.shape(name).ok_or_else(|| self.refuse(format!("no tensor {name}")))?;
        let length = shape.get(axis).filter(|length| (1..=most).contains(*length)).copied();
        length.ok_or_else(|| self.refuse(format!("tensor {name} has shape {shape:?}")))
    }

    /// Returns the number of blocks up to the last that has the tensor `name` names. A block that is
    /// missing between others is reported when it is read.
    pub(crate) fn blocks(&self, name: impl Fn(usize) -> String) -> usize {
        /// More than any published network has.
        const MAX_BLOCKS: usize = 64;
        (0..MAX_BLOCKS).rev().find(|block| self.shape(&name(*block)).is_some()).map_or(0, |last| last + 1)
    }

    /// Returns an error about all files: the shapes of their tensors are of another network.
    pub(crate) fn refuse(&self, what: String) -> WeightsError {
        let files = self.files.iter().map(|file| file.path.clone()).collect();
        WeightsError { files, fault: WeightsFault::Network { what, advice: self.advice } }
    }

    /// Reads a tensor as f32, from the first file that has it. Half and double precision are
    /// converted.
    ///
    /// # Errors
    /// [`WeightsError`] if no file has it, or it has another shape, is no float, or holds NaN or
    /// infinity.
    pub(crate) fn tensor(&mut self, name: &str, shape: &[usize]) -> Result<Tensor, WeightsError> {
        let Some(weighed) = self.files.iter_mut().find(|file| file.entries.contains_key(name)) else {
            return Err(WeightsError {
                files: self.files.iter().map(|file| file.path.clone()).collect(),
                fault: WeightsFault::Missing { name: name.into(), shape: shape.into(), advice: self.advice },
            });
        };
        let (entry, file) = (&weighed.entries[name], &mut weighed.file);
        load(file, entry, name, shape, self.advice)
            .map_err(|fault| WeightsError { files: vec![weighed.path.clone()], fault })
    }
}

fn open(path: &Path) -> Result<WeightsFile, WeightsFault> {
    let mut file = File::open(path)?;
    if !file.metadata()?.is_file() {
        return Err(io::Error::other("it is no file").into());
    }
    let entries = entries(&mut file, path)?;
    Ok(WeightsFile { path: path.into(), file, entries })
}

/// Returns the tensors of a file, which is at its start.
fn entries(file: &mut File, path: &Path) -> Result<HashMap<String, Entry>, WeightsFault> {
    let length = file.metadata()?.len();
    let mut first = Vec::new();
    Read::by_ref(file).take(9).read_to_end(&mut first)?;
    match first[..] {
        [] => Err(WeightsFault::Empty),
        [b'P', b'K', 3, 4, ..] => pth::entries(file, length),
        // A pickle that is not in a zip archive.
        [0x80, 1..=5, ..] => Err(WeightsFault::Old(path.display().to_string())),
        [_, _, _, _, _, _, _, _, b'{'] => safetensors::entries(file, length),
        _ => Err(WeightsFault::Unknown),
    }
}

fn load(
    file: &mut File,
    entry: &Entry,
    name: &str,
    shape: &[usize],
    advice: &'static str,
) -> Result<Tensor, WeightsFault> {
    if entry.shape != shape {
        let found = entry.shape.clone();
        return Err(WeightsFault::Shape { name: name.into(), found, shape: shape.into(), advice });
    }
    let dtype = entry.kind.clone().map_err(|kind| WeightsFault::Kind { name: name.into(), kind })?;
    let bytes = read(file, entry.offset, entry.bytes)?;
    let tensor = Tensor::from_raw_buffer(&bytes, dtype, shape, &Device::Cpu)
        .and_then(|tensor| tensor.to_dtype(DType::F32))
        .expect("as many bytes as the shape takes");
    if !numbers(&tensor).iter().all(|value| value.is_finite()) {
        return Err(WeightsFault::NotFinite(name.into()));
    }
    Ok(tensor)
}
