//! CMMD: how far the look of one collection of pictures is from that of another (Jayasumana et al.
//! 2024, "Rethinking FID: towards a better evaluation metric for image generation").
//!
//! Pictures become embeddings of unit length by CLIP ViT-L/14 at 336 px. With the kernel
//! `k(x, y) = exp(-|x - y|^2 / (2 sigma^2))`, `sigma = 10`, the distance is the squared maximum
//! mean discrepancy `1000 (mean k(x, x') + mean k(y, y') - 2 mean k(x, y))` over all pairs, those
//! of a picture with itself too (the biased V-statistic, Gretton et al. 2012, eq. 5), as the
//! published program has it. 0 for equal collections; lower is nearer.
//!
//! That program adds up kernels, which are all within 2 % of 1, in f32. Here `1 - k` is added up in
//! f64, so that nothing is lost where they cancel.
//!
//! Pictures become an array of embeddings once, by the feature `nets` or another program. The
//! distance is a formula over two arrays, which every build has.

use rayon::prelude::*;
use std::path::Path;
use thiserror::Error;
use wm_base::{FormatError, npy};

/// Width of the kernel.
const KERNEL_SIGMA: f64 = 10.0;
/// Factor of the reported numbers, which would be tiny without it.
const REPORT_FACTOR: f64 = 1000.0;
/// Rows that a thread takes at a time, and rows that they are compared with while those are in the
/// cache.
const BLOCK_ROWS: usize = 32;
/// The largest deviation of an embedding's length from 1: half precision leaves 1e-3.
const LENGTH_TOLERANCE: f64 = 5e-3;

/// Embeddings of images, one per row.
#[derive(Clone, Debug, PartialEq)]
pub struct Embeddings {
    /// `[N, D]`
    values: Vec<f32>,
    /// D.
    width: usize,
}

/// A reason why numbers are no embeddings.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum EmbeddingFault {
    /// No rows of numbers.
    #[error("an array of shape {0:?}, not [pictures, numbers a picture]; save one row a picture")]
    Shape(Vec<usize>),
    /// There is nothing in it.
    #[error("there is no embedding in it; embed at least two pictures")]
    None,
    /// A number is none.
    #[error("row {0} holds NaN or infinite numbers; embed its picture again")]
    NotFinite(usize),
    /// CMMD is defined for unit vectors alone.
    #[error(
        "row {row} has length {length:.3}, and CMMD takes embeddings of length 1; divide each row by its length"
    )]
    Length {
        /// From 0.
        row: usize,
        /// Euclidean.
        length: f64,
    },
}

/// A file of embeddings that cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum EmbeddingError {
    /// It is no array, or cannot be read.
    #[error(transparent)]
    File(#[from] FormatError),
    /// It is an array of other numbers.
    #[error("{path}: {fault}")]
    Fault {
        /// The file.
        path: String,
        /// The fault.
        fault: EmbeddingFault,
    },
}

impl Embeddings {
    /// Embeddings `[N, width]`.
    ///
    /// # Errors
    /// [`EmbeddingFault`] if there are none, or a row is not finite or not of length 1 within 0.5
    /// %.
    ///
    /// # Panics
    /// If the values are no whole rows.
    pub fn new(values: Vec<f32>, width: usize) -> Result<Self, EmbeddingFault> {
        assert!(width > 0 && values.len().is_multiple_of(width), "whole rows of {width}");
        if values.is_empty() {
            return Err(EmbeddingFault::None);
        }
        for (row, embedding) in values.chunks_exact(width).enumerate() {
            if !embedding.iter().all(|value| value.is_finite()) {
                return Err(EmbeddingFault::NotFinite(row));
            }
            let length = embedding.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt();
            if (length - 1.0).abs() > LENGTH_TOLERANCE {
                return Err(EmbeddingFault::Length { row, length });
            }
        }
        Ok(Self { values, width })
    }

    /// Reads a NumPy array of f32, `[N, D]`.
    ///
    /// # Errors
    /// [`EmbeddingError`] if it is no such array, or as [`Self::new`].
    pub fn read(path: &Path) -> Result<Self, EmbeddingError> {
        let (values, shape) = npy::read(path)?;
        let embeddings = match shape[..] {
            [_, width] if width > 0 => Self::new(values, width),
            _ => Err(EmbeddingFault::Shape(shape)),
        };
        embeddings.map_err(|fault| EmbeddingError::Fault { path: path.display().to_string(), fault })
    }

    /// The number of images.
    #[must_use]
    pub fn count(&self) -> usize {
        self.values.len() / self.width
    }

    /// Numbers a picture.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows as threads take them, with the number of the block.
    fn blocks(&self) -> impl IndexedParallelIterator<Item = (usize, &[f32])> {
        self.values.par_chunks(BLOCK_ROWS * self.width).enumerate()
    }

    /// Adds those of other pictures.
    ///
    /// # Panics
    /// If they are of another width.
    pub fn extend(&mut self, other: &Self) {
        assert_eq!(self.width, other.width, "embeddings of one width");
        self.values.extend_from_slice(&other.values);
    }
}

/// Embeddings of a collection of pictures, ready to be compared with others.
#[derive(Clone, Debug, PartialEq)]
pub struct Collection {
    embeddings: Embeddings,
    /// The mean of `1 - k` over its own pairs.
    spread: f64,
}

/// The distance between two collections.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cmmd {
    /// The distance as published.
    pub value: f64,
    /// The part that comes from the collections being small: what the pairs of an image with itself
    /// add, in the mean the distance of two collections of these sizes that show the same.
    pub bias: f64,
}

impl Collection {
    /// Takes N^2 D / 2 multiplications.
    #[must_use]
    pub fn new(embeddings: Embeddings) -> Self {
        Self { spread: own_gap(&embeddings), embeddings }
    }

    /// Returns the embeddings.
    #[must_use]
    pub fn embeddings(&self) -> &Embeddings {
        &self.embeddings
    }

    /// The distance from another collection.
    ///
    /// Takes N M D multiplications and no memory beyond a number a block of rows. Runs on the
    /// threads of the current rayon pool; their number does not change the result.
    ///
    /// # Panics
    /// If their widths differ.
    #[must_use]
    pub fn cmmd(&self, other: &Self) -> Cmmd {
        assert_eq!(self.embeddings.width, other.embeddings.width, "embeddings of one width");
        let between = mean_gap(&self.embeddings, &other.embeddings);
        // Without the pairs of a picture with itself a spread is N / (N - 1) times as large.
        let share = |of: &Self| of.spread / (of.embeddings.count() as f64 - 1.0).max(1.0);
        Cmmd {
            value: REPORT_FACTOR * (2.0 * between - self.spread - other.spread),
            bias: REPORT_FACTOR * (share(self) + share(other)),
        }
    }
}

/// The mean of `1 - k` over all pairs of two collections.
fn mean_gap(x: &Embeddings, y: &Embeddings) -> f64 {
    let sums = x.blocks().map(|(_, rows)| {
        y.values.chunks(BLOCK_ROWS * y.width).map(|others| gaps(rows, others, x.width)).sum()
    });
    total(sums) / (x.count() as f64 * y.count() as f64)
}

/// The mean of `1 - k` over all pairs of one collection. Blocks of rows meet each other once and
/// count twice.
fn own_gap(x: &Embeddings) -> f64 {
    let sums = x.blocks().map(|(index, rows)| {
        let later = x.values.chunks(BLOCK_ROWS * x.width).skip(index + 1);
        gaps(rows, rows, x.width) + 2.0 * later.map(|others| gaps(rows, others, x.width)).sum::<f64>()
    });
    total(sums) / (x.count() as f64).powi(2)
}

/// Adds up in order, however many threads there are.
fn total(sums: impl IndexedParallelIterator<Item = f64>) -> f64 {
    sums.collect::<Vec<f64>>().iter().sum()
}

/// The sum of `1 - k` over all pairs of some rows with others.
fn gaps(rows: &[f32], others: &[f32], width: usize) -> f64 {
    let gamma = 1.0 / (2.0 * KERNEL_SIGMA * KERNEL_SIGMA);
    let mut sum = 0.0;
    for row in rows.chunks_exact(width) {
        for other in others.chunks_exact(width) {
            sum -= (-gamma * squared_distance(row, other)).exp_m1();
        }
    }
    sum
}

fn squared_distance(x: &[f32], y: &[f32]) -> f64 {
    const LANES: usize = 8;
    let (x_lanes, x_rest) = x.as_chunks::<LANES>();
    let (y_lanes, y_rest) = y.as_chunks::<LANES>();
    let square = |x: f32, y: f32| (f64::from(x) - f64::from(y)).powi(2);
    let mut sums = [0.0; LANES];
    for (x, y) in x_lanes.iter().zip(y_lanes) {
        for lane in 0..LANES {
            sums[lane] += square(x[lane], y[lane]);
        }
    }
    sums.iter().sum::<f64>() + x_rest.iter().zip(y_rest).map(|(x, y)| square(*x, *y)).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_base::random::uniform;

    /// Rows of noise about `center` in all numbers, of length 1.
    fn made_up(count: usize, width: usize, seed: u64, center: f64) -> Embeddings {
        let mut values = Vec::new();
        for picture in 0..count {
            let number = |index: usize| center + uniform(seed, (picture * width + index) as u64) - 0.5;
            let row: Vec<f64> = (0..width).map(number).collect();
            let length = row.iter().map(|v| v * v).sum::<f64>().sqrt();
            values.extend(row.iter().map(|v| (v / length) as f32));
        }
        Embeddings::new(values, width).unwrap()
    }

    fn cmmd(x: &Embeddings, y: &Embeddings) -> f64 {
        Collection::new(x.clone()).cmmd(&Collection::new(y.clone())).value
    }

    /// The formula of the published program, in f64, a pair at a time.
    fn by_the_formula(x: &Embeddings, y: &Embeddings) -> f64 {
        let dot = |a: &[f32], b: &[f32]| -> f64 {
            a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
        };
        let mean = |x: &Embeddings, y: &Embeddings| {
            let mut sum = 0.0;
            for i in 0..x.count() {
                for j in 0..y.count() {
                    let (a, b) = (&x.values[i * x.width..][..x.width], &y.values[j * y.width..][..y.width]);
                    sum += (-(dot(a, a) + dot(b, b) - 2.0 * dot(a, b)) / 200.0).exp();
                }
            }
            sum / (x.count() * y.count()) as f64
        };
        1000.0 * (mean(x, x) + mean(y, y) - 2.0 * mean(x, y))
    }

    #[test]
    fn the_formula_is_the_published_one() {
        for (counts, width) in [((1, 1), 3), ((2, 5), 8), ((70, 33), 19), ((40, 65), 768)] {
            let (x, y) = (made_up(counts.0, width, 1, 0.1), made_up(counts.1, width, 2, 0.3));
            let (found, expected) = (cmmd(&x, &y), by_the_formula(&x, &y));
            // Of sums near 1000 in f64.
            assert!((found - expected).abs() < 1e-9, "{counts:?}: {found} for {expected}");
            assert!(found > 0.1, "{counts:?}: {found}");
        }
    }

    /// `fixtures/make_cmmd.py` ran the published `distance.py`, in f32 as it is and in f64.
    #[test]
    fn the_published_program_gives_the_same() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/cmmd");
        let read = |name: &str| Embeddings::read(&folder.join(name)).unwrap();
        let (x, y) = (read("x.npy"), read("y.npy"));
        assert_eq!(((x.count(), x.width()), (y.count(), y.width())), ((37, 48), (29, 48)));
        let (published, _) = npy::read(&folder.join("cmmd.npy")).unwrap();
        let [in_f32, in_f64] = published[..] else { panic!("two numbers: {published:?}") };
        let found = cmmd(&x, &y);
        println!("{found:.7}, published {in_f32:.7} in f32 and {in_f64:.7} in f64");
        // What f32 leaves of the number itself.
        assert!((found / f64::from(in_f64) - 1.0).abs() < 1e-7, "{found} for {in_f64}");
        // Kernels just below 1 and the mean of them are rounded to 2^-24 each, and there are four
        // means of them.
        assert!(
            (found - f64::from(in_f32)).abs() < 1000.0 * 4.0 * 2.0 * 0.5f64.powi(24),
            "{found} for {in_f32}"
        );
    }

    #[test]
    fn equal_collections_are_at_zero_and_order_does_not_matter() {
        let (x, y) = (made_up(50, 16, 3, 0.2), made_up(41, 16, 4, -0.1));
        assert!(cmmd(&x, &x).abs() < 1e-12);
        assert!((cmmd(&x, &y) - cmmd(&y, &x)).abs() < 1e-9);
        let mut both = x.clone();
        both.extend(&x);
        // A collection twice is the same collection.
        assert!(cmmd(&both, &x).abs() < 1e-9);
        assert!((cmmd(&both, &y) - cmmd(&x, &y)).abs() < 1e-9);
    }

    /// Two halves of one collection differ by no more than by chance.
    #[test]
    fn the_bias_is_what_small_collections_add() {
        let half = |seed| Collection::new(made_up(40, 12, seed, 0.2));
        let (mut sum, mut bias) = (0.0, 0.0);
        for seed in 0..40 {
            let found = half(2 * seed + 100).cmmd(&half(2 * seed + 101));
            (sum, bias) = (sum + found.value, bias + found.bias);
        }
        assert!((sum / bias - 1.0).abs() < 0.1, "{sum} {bias}");
    }

    #[test]
    fn threads_do_not_change_the_result() {
        let (x, y) = (made_up(130, 24, 5, 0.1), made_up(77, 24, 6, 0.0));
        let on = |threads| wm_render::cpu::pool(threads).unwrap().install(|| cmmd(&x, &y));
        assert_eq!([on(2), on(5)], [on(1); 2]);
    }

    #[test]
    fn what_is_no_embedding_is_told() {
        let of = |values: &[f32], width| Embeddings::new(values.to_vec(), width).unwrap_err();
        assert_eq!(of(&[], 3), EmbeddingFault::None);
        assert_eq!(of(&[1.0, 0.0, f32::NAN, 0.0], 2), EmbeddingFault::NotFinite(1));
        let long = of(&[1.0, 0.0, 0.6, 0.6], 2).to_string();
        assert!(long.starts_with("row 1 has length 0.849, and CMMD takes"), "{long}");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        npy::write(&path, &[1.0; 6], &[6]).unwrap();
        let line = Embeddings::read(&path).unwrap_err().to_string();
        assert!(line.contains("a.npy: an array of shape [6], not [pictures, numbers a picture]"), "{line}");
        npy::write(&path, &[], &[0, 4]).unwrap();
        assert!(Embeddings::read(&path).unwrap_err().to_string().contains("there is no embedding in it"));
        let kept = made_up(3, 5, 7, 0.2);
        npy::write(&path, &kept.values, &[3, 5]).unwrap();
        assert_eq!(Embeddings::read(&path).unwrap(), kept);
    }
}
