//! Tensors in a file of weights, and the faults of such files.

use candle_core::DType;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use thiserror::Error;

/// Longest header that is read, bytes. Those of large language models have a tenth of it.
pub(super) const MAX_HEADER_BYTES: u64 = 1 << 24;

/// A fault of weights.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WeightsFault {
    /// The system cannot read it.
    #[error("cannot be read: {0}")]
    Unreadable(#[from] io::Error),
    /// It is empty.
    #[error("the file is empty; copy it again")]
    Empty,
    /// It has another format.
    #[error("neither a safetensors file nor one of PyTorch (.pth); give weights in one of these formats")]
    Unknown,
    /// PyTorch wrote it before version 1.6, or since then by wish.
    #[error(
        "in PyTorch's old format, which is not read; convert it with PyTorch: python -c \"import torch; \
         torch.save(torch.load('{0}'), '{0}.new.pth')\""
    )]
    Old(String),
    /// The file contradicts itself.
    #[error("damaged or cut off ({0}); copy it again")]
    Damaged(String),
    /// It is sound, but holds other things than tensors by name.
    #[error("{0}; save the network's state_dict() alone, or convert it to safetensors")]
    NoTensors(&'static str),
    /// A tensor is not there.
    #[error("no tensor {name} of shape {shape:?}; {advice}")]
    Missing {
        /// The name of the tensor.
        name: String,
        /// The shape that is needed.
        shape: Vec<usize>,
        /// The files that would have it.
        advice: &'static str,
    },
    /// A tensor has another shape.
    #[error("tensor {name} has shape {found:?}, not {shape:?}; {advice}")]
    Shape {
        /// The name of the tensor.
        name: String,
        /// The shape that it has.
        found: Vec<usize>,
        /// The shape that is needed.
        shape: Vec<usize>,
        /// The files that would have it.
        advice: &'static str,
    },
    /// A tensor's numbers are of a kind that no network here has.
    #[error("tensor {name} is stored as {kind}; convert it to contiguous 32 bit floats")]
    Kind {
        /// The name of the tensor.
        name: String,
        /// The number type in the file.
        kind: String,
    },
    /// Tensors whose shapes are of another network.
    #[error("{what}; {advice}")]
    Network {
        /// The contents that were found.
        what: String,
        /// The files that would do.
        advice: &'static str,
    },
    /// A tensor holds NaN or infinity.
    #[error("tensor {0} holds NaN or infinite numbers; copy or convert the file again")]
    NotFinite(String),
}

/// A tensor in a file.
#[derive(Debug)]
pub(super) struct Entry {
    /// The type of the numbers, or the name of a type that is not read.
    pub(super) kind: Result<DType, String>,
    pub(super) shape: Vec<usize>,
    /// The offset of the first byte in the file. The range is within the file.
    pub(super) offset: u64,
    /// The length, bytes: that of the shape.
    pub(super) bytes: u64,
}

impl Entry {
    /// The bytes that a shape takes; `None` of what overflows.
    pub(super) fn bytes_of(shape: &[usize], size: usize) -> Option<u64> {
        let count = shape.iter().try_fold(size, |product, side| product.checked_mul(*side))?;
        u64::try_from(count).ok()
    }
}

/// Reads a part of a file; the caller has compared `size` with the file's or with a limit.
pub(super) fn read(file: &mut File, start: u64, size: u64) -> Result<Vec<u8>, WeightsFault> {
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(start))?;
    file.take(size).read_to_end(&mut bytes)?;
    if bytes.len() as u64 != size {
        return Err(WeightsFault::Damaged("it ends early".into()));
    }
    Ok(bytes)
}
