//! Tables of 256 values and palettes of vectors that are near many of theirs: least squares, the
//! same for the same values.

/// Entries of a row of the palette of SH.
pub(super) const ENTRIES_PER_ROW: usize = 64;

/// A table of 256 values and what it makes of others.
pub(super) struct Codebook {
    pub(crate) values: [f32; 256],
    low: f32,
    /// Bins a unit.
    scale: f32,
    /// Nearest value of each bin.
    nearest: Vec<u8>,
}

/// Bins over the range of the values.
const BIN_COUNT: usize = 1 << 16;
/// Bins that the first density is taken over.
const COARSE_BINS: usize = 16;
/// Rounds of improvement of a table, which hardly changes after.
const ROUND_COUNT: usize = 30;

impl Codebook {
    /// A table for `values` of which errors count by `weight`: spread by their density at first,
    /// then Lloyd's rounds over a histogram.
    pub(crate) fn of(values: impl Iterator<Item = f32> + Clone, weight: impl Fn(f64) -> f64) -> Self {
        let finite = || values.clone().filter(|v| v.is_finite());
        let (low, high) = finite().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        let (low, high) = if low <= high { (low, high) } else { (0.0, 0.0) };
        let scale = if high > low { (BIN_COUNT - 1) as f32 / (high - low) } else { 0.0 };
        let value = |bin: usize| {
            if scale > 0.0 { f64::from(low) + bin as f64 / f64::from(scale) } else { f64::from(low) }
        };
        let mut weights = vec![0f64; BIN_COUNT];
        for v in finite() {
            weights[((v - low) * scale + 0.5) as usize] += 1.0;
        }
        // Against the largest, whose own weight might be out of range.
        weights.iter_mut().enumerate().for_each(|(bin, sum)| *sum *= weight(value(bin) - f64::from(high)));
        // Sums over the bins before each, so that a cell's mean costs two look-ups.
        let (mut number, mut sum) = (vec![0f64; BIN_COUNT + 1], vec![0f64; BIN_COUNT + 1]);
        for bin in 0..BIN_COUNT {
            number[bin + 1] = number[bin] + weights[bin];
            sum[bin + 1] = sum[bin] + weights[bin] * value(bin);
        }
        // Where values are d times as dense, the best table is cbrt(d) times as dense.
        let density: Vec<f64> =
            weights.chunks(COARSE_BINS).map(|bins| bins.iter().sum::<f64>().cbrt()).collect();
        let step = density.iter().sum::<f64>() / 256.0;
        // The least value has an entry: scales that no other is near weigh next to nothing, but a
        // flat splat must not become thick.
        let mut centers = vec![value(0)];
        let mut before = 0.0;
        for (chunk, density) in density.iter().enumerate() {
            while centers.len() < 256
                && before + density >= (centers.len() as f64 + 0.5) * step
                && *density > 0.0
            {
                let share = ((centers.len() as f64 + 0.5) * step - before) / density;
                centers.push(value(((chunk as f64 + share) * COARSE_BINS as f64) as usize));
            }
            before += density;
        }
        centers.resize(256, value(BIN_COUNT - 1));
        for _ in 0..ROUND_COUNT {
            let mut from = 0;
            let old = centers.clone();
            for (i, center) in centers.iter_mut().enumerate() {
                let to = if i == 255 { BIN_COUNT } else { border(&old, i, low, scale) };
                if number[to] > number[from] {
                    *center = (sum[to] - sum[from]) / (number[to] - number[from]);
                }
                from = to.max(from);
            }
        }
        centers.sort_by(f64::total_cmp);
        let mut nearest = vec![0u8; BIN_COUNT];
        let mut from = 0;
        for i in 0..256 {
            let to = if i == 255 { BIN_COUNT } else { border(&centers, i, low, scale).max(from) };
            nearest[from..to].fill(i as u8);
            from = to;
        }
        Self { values: std::array::from_fn(|i| centers[i] as f32), low, scale, nearest }
    }

    /// Index of the value nearest to `v`; of NaN, some index.
    pub(crate) fn index(&self, v: f32) -> u8 {
        self.nearest[((v - self.low) * self.scale + 0.5).clamp(0.0, (BIN_COUNT - 1) as f32) as usize]
    }
}

/// The first bin that is nearer to center i + 1 than to i.
fn border(centers: &[f64], i: usize, low: f32, scale: f32) -> usize {
    let middle = 0.5 * (centers[i] + centers[i + 1]);
    (((middle - f64::from(low)) * f64::from(scale)).ceil().clamp(0.0, BIN_COUNT as f64)) as usize
}

/// A palette of vectors, and the entry of each vector.
pub(super) struct Palette {
    /// `[entries, size]` flat.
    pub(crate) entries: Vec<f32>,
    /// `[N]`.
    pub(crate) labels: Vec<u16>,
}

/// A set of vectors that shares an entry for now.
struct Cell {
    /// First and end of its vectors in the order.
    first: usize,
    end: usize,
    mean: Vec<f32>,
    /// Sum of squared distances from the mean.
    error: f64,
}

/// Rounds of each split.
const SPLIT_ROUNDS: usize = 3;

impl Palette {
    /// A palette of at most `most` entries (65,536 at most) for vectors of `size` values,
    /// `[N, size]` flat, whose squared errors count by `weights`, `[N]`, above 0; alike if there
    /// are none.
    ///
    /// The set with the largest error is split in two, again and again: across its mean along the
    /// value that varies most, then by a few rounds of two means. So each vector is looked at some
    /// log2(entries) times.
    pub(crate) fn of(vectors: &[f32], size: usize, most: usize, weights: &[f32]) -> Self {
        let count = vectors.len() / size;
        let vector = |i: u32| &vectors[i as usize * size..][..size];
        let weight = |i: u32| weights.get(i as usize).copied().unwrap_or(1.0);
        let mut order: Vec<u32> = (0..count as u32).collect();
        let mut cells = vec![Cell::of(&order, 0, count, size, &vector, &weight)];
        // The largest error first, then the earliest cell.
        let mut heap = std::collections::BinaryHeap::new();
        let key = |cell: &Cell| (cell.error.max(0.0)).to_bits();
        heap.push((key(&cells[0]), std::cmp::Reverse(0usize)));
        while cells.len() < most {
            let Some((error, std::cmp::Reverse(index))) = heap.pop() else { break };
            if error == 0 {
                break;
            }
            let Some(middle) = split(&mut order, &cells[index], size, &vector, &weight) else { continue };
            let (first, end) = (cells[index].first, cells[index].end);
            let (a, b) = (
                Cell::of(&order, first, middle, size, &vector, &weight),
                Cell::of(&order, middle, end, size, &vector, &weight),
            );
            heap.push((key(&a), std::cmp::Reverse(index)));
            heap.push((key(&b), std::cmp::Reverse(cells.len())));
            cells[index] = a;
            cells.push(b);
        }
        let mut labels = vec![0; count];
        for (label, cell) in cells.iter().enumerate() {
            for index in &order[cell.first..cell.end] {
                labels[*index as usize] = label as u16;
            }
        }
        Self { entries: cells.into_iter().flat_map(|cell| cell.mean).collect(), labels }
    }
}

impl Cell {
    fn of<'a>(
        order: &[u32],
        first: usize,
        end: usize,
        size: usize,
        vector: &impl Fn(u32) -> &'a [f32],
        weight: &impl Fn(u32) -> f32,
    ) -> Self {
        let (mut sums, mut total) = (vec![0f64; size], 0f64);
        for index in &order[first..end] {
            let weight = f64::from(weight(*index));
            total += weight;
            for (sum, v) in sums.iter_mut().zip(vector(*index)) {
                *sum += weight * f64::from(*v);
            }
        }
        let total = if total > 0.0 { total } else { 1.0 };
        let mean: Vec<f32> = sums.iter().map(|sum| (sum / total) as f32).collect();
        let far =
            |index: &u32| f64::from(weight(*index)) * f64::from(squared_distance(vector(*index), &mean));
        let error = order[first..end].iter().map(far).sum();
        Self { first, end, mean, error }
    }
}

fn squared_distance(a: &[f32], b: &[f32]) -> f32 {
    // Eight sums at a time, which the compiler keeps in one register.
    let mut sums = [0f32; 8];
    let ((a, a_end), (b, b_end)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in a.iter().zip(b) {
        for k in 0..8 {
            sums[k] += (a[k] - b[k]) * (a[k] - b[k]);
        }
    }
    sums.iter().sum::<f32>() + a_end.iter().zip(b_end).map(|(a, b)| (a - b) * (a - b)).sum::<f32>()
}

/// Puts the vectors of a cell that belong together beside each other and gives where the second
/// part begins; `None` if they cannot be told apart.
fn split<'a>(
    order: &mut [u32],
    cell: &Cell,
    size: usize,
    vector: &impl Fn(u32) -> &'a [f32],
    weight: &impl Fn(u32) -> f32,
) -> Option<usize> {
    let part = &mut order[cell.first..cell.end];
    let mut spread = vec![0f64; size];
    for index in &*part {
        let weight = f64::from(weight(*index));
        for ((sum, v), mean) in spread.iter_mut().zip(vector(*index)).zip(&cell.mean) {
            *sum += weight * f64::from(v - mean).powi(2);
        }
    }
    let widest = (0..size).max_by(|a, b| spread[*a].total_cmp(&spread[*b]))?;
    let mut middle = partition(part, |index| vector(index)[widest] < cell.mean[widest]);
    for _ in 0..SPLIT_ROUNDS {
        if middle == 0 || middle == part.len() {
            return None;
        }
        let mean = |indices: &[u32]| {
            let (mut sums, mut total) = (vec![0f32; size], 0f32);
            for index in indices {
                let weight = weight(*index);
                total += weight;
                sums.iter_mut().zip(vector(*index)).for_each(|(sum, v)| *sum += weight * v);
            }
            sums.iter_mut().for_each(|sum| *sum /= total);
            sums
        };
        let (a, b) = (mean(&part[..middle]), mean(&part[middle..]));
        middle = partition(part, |index| {
            squared_distance(vector(index), &a) < squared_distance(vector(index), &b)
        });
    }
    (middle > 0 && middle < part.len()).then_some(cell.first + middle)
}

/// Moves what `is_first` holds for to the front; gives how many they are.
fn partition(indices: &mut [u32], is_first: impl Fn(u32) -> bool) -> usize {
    let mut count = 0;
    for at in 0..indices.len() {
        if is_first(indices[at]) {
            indices.swap(at, count);
            count += 1;
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_near_its_values() {
        // Of even values every one is within half a step; a far one is not lost.
        let values: Vec<f32> = (0..10_000).map(|i| i as f32 / 10_000.0).chain([50.0]).collect();
        let table = Codebook::of(values.iter().copied(), |_| 1.0);
        let worst =
            values.iter().map(|v| (table.values[usize::from(table.index(*v))] - v).abs()).fold(0.0, f32::max);
        assert!(worst < 0.01, "{worst}");
        let one = Codebook::of([3.0f32; 5].into_iter(), |_| 1.0);
        assert_eq!(one.values[usize::from(one.index(3.0))], 3.0);
        // What counts more is nearer, and what hardly counts does no harm: of 50 units a thousandth
        // is 0.2 off at most.
        let wide = Codebook::of((0..=50_000).map(|i| i as f32 * 2e-3 - 50.0), f64::exp);
        let off = |v: f32| (wide.values[usize::from(wide.index(v))] - v).abs();
        assert!(
            off(49.0) < 0.01 && off(30.0) > off(49.0) && off(-50.0) < 100.0,
            "{} {}",
            off(49.0),
            off(30.0)
        );
        let none = Codebook::of([f32::NAN].into_iter(), f64::exp);
        assert!(none.values[usize::from(none.index(f32::NAN))].is_finite());
    }

    #[test]
    fn a_palette_holds_few_vectors_exactly() {
        let vectors: Vec<f32> = (0..200).flat_map(|i| [(i % 7) as f32, (i % 5) as f32, 1.0]).collect();
        let palette = Palette::of(&vectors, 3, 64, &[]);
        assert_eq!(palette.entries.len(), 35 * 3);
        for (vector, label) in vectors.chunks(3).zip(&palette.labels) {
            assert_eq!(vector, &palette.entries[usize::from(*label) * 3..][..3]);
        }
        assert_eq!(Palette::of(&vectors, 3, 10, &[]).entries.len(), 30);
    }
}
