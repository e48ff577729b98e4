//! Made-up weights and pictures, files of them, and what fixtures hold.

use crate::ops::numbers;
use crate::weights::{Weights, WeightsError};
use ::safetensors::SafeTensors;
use ::zip::write::SimpleFileOptions;
use ::zip::{CompressionMethod, ZipWriter};
use std::fs::{self, File};
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

/// A tensor: name, shape, numbers.
pub(crate) type Named = (String, Vec<usize>, Vec<f32>);

/// Number `index` of a stream, uniform in -1..1 with 24 bits: Draws of both. Easily written again
/// in another language, which a comparison with another implementation needs.
pub(crate) fn noise(stream: u64, index: u64) -> f64 {
    let z = (stream << 32).wrapping_add(index).wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 40) as f64 / f64::from(1 << 23) - 1.0
}

/// A folder with files in it.
pub(crate) struct Files(tempfile::TempDir);

impl Files {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub(crate) fn put(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        fs::write(&path, content).unwrap();
        path
    }

    pub(crate) fn path(&self) -> &Path {
        self.0.path()
    }
}

/// A safetensors file of f32.
pub(crate) fn safetensors(tensors: &[Named]) -> Vec<u8> {
    let (mut entries, mut numbers) = (Vec::new(), Vec::new());
    for (name, shape, values) in tensors {
        let from = numbers.len();
        numbers.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        entries.push(format!(
            r#""{name}":{{"dtype":"F32","shape":{shape:?},"data_offsets":[{from},{}]}}"#,
            numbers.len()
        ));
    }
    with_header(&format!("{{{}}}", entries.join(",")), &numbers)
}

/// A safetensors file with any header.
pub(crate) fn with_header(header: &str, numbers: &[u8]) -> Vec<u8> {
    [&(header.len() as u64).to_le_bytes(), header.as_bytes(), numbers].concat()
}

/// The bytes that `torch.save` writes of a dictionary of f32 tensors, in the order of its
/// instructions.
pub(crate) fn pth(tensors: &[Named]) -> Vec<u8> {
    let mut pickle = b"\x80\x02}q\x00(".to_vec();
    let mut entries = Vec::new();
    for (index, (name, shape, values)) in tensors.iter().enumerate() {
        text(&mut pickle, name);
        pickle.extend(b"ctorch._utils\n_rebuild_tensor_v2\n((");
        text(&mut pickle, "storage");
        pickle.extend(b"ctorch\nFloatStorage\n");
        text(&mut pickle, &index.to_string());
        text(&mut pickle, "cpu");
        number(&mut pickle, values.len());
        pickle.extend(b"tQK\x00");
        tuple(&mut pickle, shape);
        let stride = |side: usize| shape[side + 1..].iter().product();
        tuple(&mut pickle, &(0..shape.len()).map(stride).collect::<Vec<_>>());
        pickle.extend(b"\x89ccollections\nOrderedDict\n)RtR");
        entries
            .push((format!("x/data/{index}"), values.iter().flat_map(|value| value.to_le_bytes()).collect()));
    }
    pickle.extend(b"u.");
    let mut all = vec![("x/data.pkl".to_owned(), pickle), ("x/byteorder".to_owned(), b"little".to_vec())];
    all.extend(entries);
    zip(&all)
}

/// An uncompressed zip archive.
pub(crate) fn zip(entries: &[(String, Vec<u8>)]) -> Vec<u8> {
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    for (name, content) in entries {
        writer.start_file(name.as_str(), options).unwrap();
        writer.write_all(content).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

fn text(pickle: &mut Vec<u8>, text: &str) {
    pickle.push(b'X');
    pickle.extend((text.len() as u32).to_le_bytes());
    pickle.extend(text.as_bytes());
}

fn number(pickle: &mut Vec<u8>, number: usize) {
    pickle.push(b'J');
    pickle.extend((number as i32).to_le_bytes());
}

fn tuple(pickle: &mut Vec<u8>, sides: &[usize]) {
    pickle.push(b'(');
    for side in sides {
        number(pickle, *side);
    }
    pickle.push(b't');
}

/// An array of f32 and its shape.
pub(crate) fn npy(path: &Path) -> (Vec<usize>, Vec<f32>) {
    let bytes = fs::read(path).unwrap();
    let end = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = String::from_utf8_lossy(&bytes[10..end]).into_owned();
    assert!(header.contains("'<f4'") && header.contains("'fortran_order': False"), "{header}");
    let sides = header.split(['(', ')']).nth(1).unwrap().split(',');
    let shape = sides.filter_map(|side| side.trim().parse().ok()).collect();
    (shape, bytes[end..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect())
}

/// The levels of an RGB PNG, and its width.
pub(crate) fn picture(path: &Path) -> (Vec<u8>, usize) {
    let mut reader =
        png::Decoder::new(std::io::BufReader::new(File::open(path).unwrap())).read_info().unwrap();
    let mut levels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut levels).unwrap();
    assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgb, png::BitDepth::Eight));
    (levels, info.width as usize)
}

/// The tensors of a safetensors file, by name.
pub(crate) fn tensors(path: &Path) -> Vec<Named> {
    let bytes = fs::read(path).unwrap();
    let mut weights = Weights::open(&[path.into()], "").unwrap();
    let all = SafeTensors::deserialize(&bytes).unwrap().tensors();
    let mut of = |name: String, shape: &[usize]| {
        let values = numbers(&weights.tensor(&name, shape).unwrap());
        (name, shape.to_vec(), values)
    };
    let mut named: Vec<Named> = all.into_iter().map(|(name, view)| of(name, view.shape())).collect();
    named.sort_by(|a, b| a.0.cmp(&b.0));
    named
}

/// Returns the index of the tensor with a name.
pub(crate) fn index(tensors: &[Named], name: &str) -> usize {
    tensors.iter().position(|tensor| tensor.0 == name).unwrap()
}

/// Runs `work` on so many threads.
pub(crate) fn on_threads<T: Send>(count: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(count).build().unwrap().install(work)
}

/// The one line with which something is refused.
pub(crate) fn said<T>(result: Result<T, WeightsError>) -> String {
    let line = result.err().expect("refused").to_string();
    assert!(!line.contains('\n'), "{line}");
    line
}

/// The largest difference, and the range of what is expected.
pub(crate) fn gap(found: &[f32], expected: &[f32]) -> (f32, f32) {
    assert_eq!(found.len(), expected.len());
    let largest = found.iter().zip(expected).map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
    let range = |f: fn(f32, f32) -> f32| expected.iter().copied().reduce(f).unwrap();
    (largest, range(f32::max) - range(f32::min))
}
