//! Lossless WebP (VP8L, RFC 9649) of pictures whose pixels are splats.
//!
//! Pixels beside each other are splats beside each other, rows mean nothing, and most of a byte is
//! noise. So of what the format has this uses what helps there: differences from the pixel to the
//! left or from green where they have less entropy, a Huffman code a channel, and runs. That is as
//! small as what libwebp makes of the pictures of SOG, in a tenth of its time; the `image-webp`
//! crate, whose encoder always subtracts green and the pixel above, makes a fifth more.
//!
//! Pictures are read with that crate.

use std::{cmp::Reverse, collections::BinaryHeap};

/// Most pixels of a side: one less than 14 bits say, since libwebp reads no more.
pub(crate) const MAX_SIDE: usize = 16_383;

type Pixel = [u8; 4];

/// A picture of whole rows of `width` RGBA pixels, as a file.
pub(crate) fn encode(pixels: &[Pixel], width: usize) -> Vec<u8> {
    let height = pixels.len() / width;
    assert!(width * height == pixels.len() && (1..=MAX_SIDE).contains(&width.max(height)));
    let prediction = Prediction::best(pixels);
    let residuals: Vec<Pixel> = (0..pixels.len()).map(|i| prediction.residual(pixels, width, i)).collect();

    let mut bits = Bits::default();
    bits.push(0x2f, 8);
    bits.push(width as u32 - 1, 14);
    bits.push(height as u32 - 1, 14);
    bits.push(u32::from(pixels.iter().any(|pixel| pixel[3] != 255)), 1);
    bits.push(0, 3); // version
    if prediction.from_green {
        bits.push(0b101, 3);
    }
    if prediction.from_left {
        // A predictor, in blocks of 512 x 512, of which each has predictor 1: a picture of one
        // colour, without colour cache.
        bits.push(0b111_001, 6);
        bits.push(0, 1);
        bits.only_symbol(1);
        (0..4).for_each(|_| bits.only_symbol(0));
    }
    // No more changes, no colour cache, one group of codes.
    bits.push(0, 3);

    // Codes of green and runs, red, blue, alpha; distances are all the pixel to the left.
    let mut counts = [vec![0; 256 + LENGTH_SYMBOLS], vec![0; 256], vec![0; 256], vec![0; 256]];
    for run in runs(&residuals) {
        for (counts, channel) in counts.iter_mut().zip(CHANNEL_ORDER) {
            counts[usize::from(run.pixel[channel])] += 1;
        }
        if run.again > 0 {
            counts[0][256 + Prefix::of(run.again).symbol] += 1;
        }
    }
    let [green, red, blue, alpha] = counts.map(|counts| bits.code(&counts));
    bits.only_symbol(LEFT_SYMBOL);
    for Run { pixel: [r, g, b, a], again } in runs(&residuals) {
        bits.symbols(green[usize::from(g)], red[usize::from(r)]);
        bits.symbols(blue[usize::from(b)], alpha[usize::from(a)]);
        if again > 0 {
            let Prefix { symbol, extra, rest } = Prefix::of(again);
            bits.symbols(green[256 + symbol], Symbol { bits: rest, length: extra });
        }
    }
    container(&bits.finish())
}

/// Channels in the order of their codes.
const CHANNEL_ORDER: [usize; 4] = [1, 0, 2, 3];
/// Symbols of lengths of runs.
const LENGTH_SYMBOLS: usize = 24;
/// Longest run of one symbol.
const MAX_RUN: usize = 4096;
/// The symbol of the distance of one pixel to the left.
const LEFT_SYMBOL: u8 = 1;

/// A file around the stream.
fn container(stream: &[u8]) -> Vec<u8> {
    let padded = stream.len().next_multiple_of(2);
    let mut file = b"RIFF".to_vec();
    file.extend((12 + padded as u32).to_le_bytes());
    file.extend(b"WEBPVP8L");
    file.extend((stream.len() as u32).to_le_bytes());
    file.extend(stream);
    file.resize(20 + padded, 0);
    file
}

/// The prediction that is subtracted from pixels.
#[derive(Clone, Copy, Debug)]
struct Prediction {
    /// Green, from red and blue.
    from_green: bool,
    /// The pixel to the left; above in the first column.
    from_left: bool,
}

impl Prediction {
    /// Chooses the prediction with the least entropy, but for runs.
    fn best(pixels: &[Pixel]) -> Self {
        let all = [(false, false), (true, false), (false, true), (true, true)]
            .map(|(from_green, from_left)| Self { from_green, from_left });
        let cost = |prediction: &Self| -> f64 {
            let mut counts = [[0u32; 256]; 4];
            for pair in pixels.windows(2) {
                let residual = prediction.subtract(pair[1], pair[0]);
                (0..4).for_each(|k| counts[k][usize::from(residual[k])] += 1);
            }
            let bits = |count: &u32| f64::from(*count) * f64::from((*count).max(1)).log2();
            -counts.as_flattened().iter().map(bits).sum::<f64>()
        };
        // The first of equals, which unpacks fastest.
        all.into_iter()
            .map(|prediction| (cost(&prediction), prediction))
            .reduce(|a, b| if b.0 < a.0 { b } else { a })
            .map_or(all[0], |best| best.1)
    }

    fn subtract(self, pixel: Pixel, before: Pixel) -> Pixel {
        let plain = |[r, g, b, a]: Pixel| {
            if self.from_green { [r.wrapping_sub(g), g, b.wrapping_sub(g), a] } else { [r, g, b, a] }
        };
        let (pixel, before) = (plain(pixel), plain(before));
        if self.from_left { std::array::from_fn(|k| pixel[k].wrapping_sub(before[k])) } else { pixel }
    }

    fn residual(self, pixels: &[Pixel], width: usize, index: usize) -> Pixel {
        let before = match index {
            0 => [0, 0, 0, 255],
            _ if index.is_multiple_of(width) => pixels[index - width],
            _ => pixels[index - 1],
        };
        self.subtract(pixels[index], before)
    }
}

/// A pixel that comes `1 + again` times.
struct Run {
    pixel: Pixel,
    again: usize,
}

/// Pixels with those that repeat them.
fn runs(pixels: &[Pixel]) -> impl Iterator<Item = Run> {
    let mut left = pixels;
    std::iter::from_fn(move || {
        let (pixel, rest) = left.split_first()?;
        let again = rest.iter().take(MAX_RUN).take_while(|next| *next == pixel).count();
        left = &rest[again..];
        Some(Run { pixel: *pixel, again })
    })
}

/// A length as a symbol and the bits that it leaves open.
struct Prefix {
    symbol: usize,
    extra: u8,
    rest: u32,
}

impl Prefix {
    fn of(length: usize) -> Self {
        let value = length - 1;
        if value < 4 {
            return Self { symbol: value, extra: 0, rest: 0 };
        }
        let extra = value.ilog2() - 1;
        let rest = (value & ((1 << extra) - 1)) as u32;
        Self { symbol: 2 * extra as usize + (value >> extra), extra: extra as u8, rest }
    }
}

/// Bits of a symbol, the first lowest.
#[derive(Clone, Copy, Default)]
struct Symbol {
    bits: u32,
    length: u8,
}

/// Bits on their way into bytes.
#[derive(Default)]
struct Bits {
    bytes: Vec<u8>,
    /// The bits that are not written yet, the first lowest.
    pending: u64,
    /// The number of those bits, below 32.
    count: u8,
}

impl Bits {
    /// Appends the lowest `count` bits, 32 at most, above which `bits` has none.
    fn push(&mut self, bits: u32, count: u8) {
        self.pending |= u64::from(bits) << self.count;
        self.count += count;
        if self.count >= 32 {
            self.bytes.extend((self.pending as u32).to_le_bytes());
            self.pending >>= 32;
            self.count -= 32;
        }
    }

    /// Appends two symbols of 30 bits together at most.
    fn symbols(&mut self, first: Symbol, second: Symbol) {
        self.push(first.bits | second.bits << first.length, first.length + second.length);
    }

    fn finish(mut self) -> Vec<u8> {
        let end = self.pending.to_le_bytes();
        self.bytes.extend(&end[..usize::from(self.count.div_ceil(8))]);
        self.bytes
    }

    /// Appends a code of one symbol, which then takes no bits.
    fn only_symbol(&mut self, symbol: u8) {
        // Simple, one symbol, of 8 bits.
        self.push(0b101, 3);
        self.push(u32::from(symbol), 8);
    }

    /// Appends a code for symbols that come this often, and gives it.
    fn code(&mut self, counts: &[u64]) -> Vec<Symbol> {
        let mut met = (0..counts.len()).filter(|symbol| counts[*symbol] > 0);
        let (first, second) = (met.next().unwrap_or(0), met.next());
        // A run follows a pixel, so that the only symbol is no run.
        if second.is_none() && first < 256 {
            self.only_symbol(first as u8);
            return vec![Symbol::default(); counts.len()];
        }
        let lengths = code_lengths(counts, 15);
        let tokens = tokens(&lengths);
        let mut token_counts = [0; 19];
        tokens.iter().for_each(|token| token_counts[usize::from(token.symbol)] += 1);
        let token_lengths = code_lengths(&token_counts, 7);
        self.push(0, 1);
        self.push(19 - 4, 4);
        /// The order in which the format has the lengths of tokens.
        const TOKEN_ORDER: [usize; 19] = [17, 18, 0, 1, 2, 3, 4, 5, 16, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];
        // An only token has length 1 here, and then takes no bits.
        let said = |token: usize| token_lengths[token].max(u8::from(token_counts[token] > 0));
        TOKEN_ORDER.iter().for_each(|token| self.push(u32::from(said(*token)), 3));
        // Lengths of all symbols follow.
        self.push(0, 1);
        let code = canonical(&token_lengths);
        for Token { symbol, rest, extra } in tokens {
            self.symbols(code[usize::from(symbol)], Symbol { bits: rest, length: extra });
        }
        canonical(&lengths)
    }
}

/// A length of a symbol, or a run of zeros.
struct Token {
    symbol: u8,
    rest: u32,
    extra: u8,
}

fn tokens(lengths: &[u8]) -> Vec<Token> {
    let mut tokens = Vec::new();
    for same in lengths.chunk_by(|a, b| a == b && *a == 0) {
        // 138 zeros a token at most.
        for zeros in same.chunks(138) {
            let count = zeros.len() as u32;
            match count {
                _ if zeros[0] != 0 => tokens.push(Token { symbol: zeros[0], rest: 0, extra: 0 }),
                1 | 2 => tokens.extend(zeros.iter().map(|_| Token { symbol: 0, rest: 0, extra: 0 })),
                3..=10 => tokens.push(Token { symbol: 17, rest: count - 3, extra: 3 }),
                _ => tokens.push(Token { symbol: 18, rest: count - 11, extra: 7 }),
            }
        }
    }
    tokens
}

/// Lengths of a Huffman code, `limit` at most, for two symbols or more; 0 for those that do not
/// come.
fn code_lengths(counts: &[u64], limit: u8) -> Vec<u8> {
    let mut counts = counts.to_vec();
    loop {
        let leaves = counts.iter().enumerate().filter(|(_, count)| **count > 0);
        let mut roots: BinaryHeap<_> = leaves.map(|(node, count)| Reverse((*count, node))).collect();
        let mut parents = vec![None; counts.len()];
        while let (Some(Reverse(a)), Some(Reverse(b))) = (roots.pop(), roots.pop()) {
            let node = parents.len();
            parents.push(None);
            (parents[a.1], parents[b.1]) = (Some(node), Some(node));
            roots.push(Reverse((a.0 + b.0, node)));
        }
        // Parents come after their children.
        let mut depths = vec![0u8; parents.len()];
        for node in (0..parents.len()).rev() {
            depths[node] = parents[node].map_or(0, |parent: usize| depths[parent] + 1);
        }
        depths.truncate(counts.len());
        if depths.iter().all(|depth| *depth <= limit) {
            return depths;
        }
        // Flatter, until it fits: at the latest when all that come are alike.
        counts.iter_mut().for_each(|count| *count = count.div_ceil(2));
    }
}

/// The canonical code of these lengths.
fn canonical(lengths: &[u8]) -> Vec<Symbol> {
    let mut code = vec![Symbol::default(); lengths.len()];
    let mut next = 0u32;
    for length in 1..=15 {
        for symbol in (0..lengths.len()).filter(|symbol| lengths[*symbol] == length) {
            code[symbol] = Symbol { bits: next.reverse_bits() >> (32 - u32::from(length)), length };
            next += 1;
        }
        next <<= 1;
    }
    code
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn decode(file: &[u8]) -> (usize, Vec<Pixel>) {
        let mut decoder = image_webp::WebPDecoder::new(std::io::Cursor::new(file)).unwrap();
        let mut bytes = vec![0; decoder.output_buffer_size().unwrap()];
        decoder.read_image(&mut bytes).unwrap();
        let pixels = if decoder.has_alpha() {
            bytes.as_chunks().0.to_vec()
        } else {
            bytes.as_chunks().0.iter().map(|[r, g, b]| [*r, *g, *b, 255]).collect()
        };
        (decoder.dimensions().0 as usize, pixels)
    }

    proptest! {
        /// Noise over few or many values, with runs or without: every branch of codes and changes.
        #[test]
        fn pixels_come_back(
            width in 1usize..40, rows in 1usize..40, masks in prop::array::uniform4(any::<u8>()),
            seed in any::<u64>(), repeat in 1u64..60, ramp in any::<bool>(),
        ) {
            let mut state = seed;
            let mut pixels = Vec::new();
            while pixels.len() < width * rows {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let noise = ((state >> 32) as u32).to_le_bytes();
                let at = if ramp { pixels.len() as u8 } else { 0 };
                let pixel = std::array::from_fn(|k| (noise[k] & masks[k]).wrapping_add(at));
                pixels.extend(std::iter::repeat_n(pixel, (1 + (state >> 20) % repeat) as usize));
            }
            pixels.truncate(width * rows);
            prop_assert_eq!(decode(&encode(&pixels, width)), (width, pixels));
        }
    }

    #[test]
    fn long_runs_and_rare_symbols_come_back() {
        // Each value twice as often as the one before: a code that would be 20 bits long; and runs
        // of every length of prefix.
        let powers =
            (0..18u8).flat_map(|value| std::iter::repeat_n([value, 7, 255 - value, 255], 1 << value));
        let runs = (0..20_000usize).map(|i| [0, (i / 5000) as u8, 0, 252]);
        let mut pixels: Vec<Pixel> = powers.chain(runs).collect();
        // Neighbours differ, so that the first are no runs.
        pixels.iter_mut().take(1 << 17).enumerate().for_each(|(i, pixel)| pixel[1] = (i % 2) as u8);
        pixels.resize(pixels.len().next_multiple_of(512), [1, 2, 3, 4]);
        assert_eq!(decode(&encode(&pixels, 512)), (512, pixels));
    }

    #[test]
    fn codes_are_complete_and_short_enough() {
        let fibonacci = std::iter::successors(Some((1u64, 1u64)), |(a, b)| Some((*b, a + b)));
        let counts: Vec<u64> = fibonacci.take(40).map(|(a, _)| a).chain([0, 0]).collect();
        for limit in [7, 15] {
            let lengths = code_lengths(&counts, limit);
            assert!(lengths[..40].iter().all(|l| (1..=limit).contains(l)) && lengths[40..] == [0, 0]);
            let kraft: f64 = lengths[..40].iter().map(|l| 0.5f64.powi(i32::from(*l))).sum();
            assert_eq!(kraft, 1.0);
        }
    }
}
