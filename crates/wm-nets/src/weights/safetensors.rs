//! Headers of safetensors: 8 bytes of length, JSON, then the numbers without gaps.

use super::entry::{Entry, MAX_HEADER_BYTES, WeightsFault};
use candle_core::DType;
use safetensors::tensor::{Dtype, Metadata};
use std::collections::HashMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};

/// The tensors of a file of `length` bytes.
pub(crate) fn entries(file: &mut File, length: u64) -> Result<HashMap<String, Entry>, WeightsFault> {
    let damaged = |what: &dyn std::fmt::Display| WeightsFault::Damaged(what.to_string());
    let mut claimed = [0; 8];
    file.seek(SeekFrom::Start(0))?;
    file.read_exact(&mut claimed)?;
    let header = u64::from_le_bytes(claimed);
    if header > length.saturating_sub(8) || header > MAX_HEADER_BYTES {
        return Err(damaged(&format_args!("a header of {header} bytes in a file of {length}")));
    }
    let mut json = Vec::new();
    file.take(header).read_to_end(&mut json)?;
    // Reading it also checks that each range is as long as its shape takes and follows the one
    // before.
    let metadata: Metadata = serde_json::from_slice(&json).map_err(|error| damaged(&error))?;
    let start = 8 + header;
    let whole = start.checked_add(metadata.data_len() as u64);
    if whole != Some(length) {
        return Err(damaged(&format_args!("{} bytes of numbers in a file of {length}", metadata.data_len())));
    }
    let entry = |info: &safetensors::tensor::TensorInfo| {
        let kind = match info.dtype {
            Dtype::F16 => Ok(DType::F16),
            Dtype::BF16 => Ok(DType::BF16),
            Dtype::F32 => Ok(DType::F32),
            Dtype::F64 => Ok(DType::F64),
            other => Err(format!("{other:?}")),
        };
        let (from, to) = info.data_offsets;
        let (offset, bytes) = (start + from as u64, (to - from) as u64);
        Entry { kind, shape: info.shape.clone(), offset, bytes }
    };
    Ok(metadata.tensors().into_iter().map(|(name, info)| (name, entry(info))).collect())
}
