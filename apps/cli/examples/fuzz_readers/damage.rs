//! Damage to bytes, as disks, networks, other programs and attackers do it.

use sirocco::{Format, deflate, inflate};
use std::io::Read;
use wm_base::random::uniform;

/// Random choices of one run.
pub struct Draws {
    run: u64,
    drawn: u64,
}

impl Draws {
    /// Starts the choices of a run.
    pub fn new(run: u64) -> Self {
        Self { run, drawn: 0 }
    }

    /// Returns a number below `count`; 0 if `count` is 0.
    pub fn below(&mut self, count: usize) -> usize {
        self.drawn += 1;
        ((uniform(self.run, self.drawn) * count as f64) as usize).min(count.saturating_sub(1))
    }

    /// Returns one of a list.
    pub fn pick<T: Copy>(&mut self, list: &[T]) -> T {
        list[self.below(list.len())]
    }
}

/// Texts that replace a number or a word.
const TEXTS: &[&str] = &[
    "0",
    "-0.0",
    "1",
    "-1",
    "2",
    "255",
    "256",
    "65535",
    "65536",
    "4294967295",
    "4294967296",
    "2147483647",
    "-2147483648",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551615",
    "99999999999999999999999",
    "1e18",
    "1e20",
    "1e38",
    "1e39",
    "1e40",
    "1e300",
    "1e308",
    "-1e308",
    "1e309",
    "1e-45",
    "1e-317",
    "1e-308",
    "NaN",
    "nan",
    "inf",
    "-inf",
    "Infinity",
    "null",
    "true",
    "\"\"",
    "[]",
    "{}",
    "[[]]",
    "",
    " ",
    "\u{feff}",
    "\u{0}",
    "é",
    "//",
    "..",
    "/",
    "\\",
    "%s",
    "\n",
    "\r\n",
    "\t",
];

/// Bit patterns that replace a number of 4 or 8 bytes.
const PATTERNS: &[u64] = &[
    0,
    1,
    u64::MAX,
    i64::MAX as u64,
    i64::MIN as u64,
    1 << 31,
    1 << 32,
    1 << 40,
    0x7f80_0000,
    0xff80_0000,
    0x7fc0_0000,
    0x60ad_78ec,
    0xe0ad_78ec,
    0x0000_0001,
    0x7ff0_0000_0000_0000,
    0xfff0_0000_0000_0000,
    0x7ff8_0000_0000_0000,
    0x4415_af1d_78b5_8c40,
    0x7e37_e43c_8800_759c,
    0x000f_ffff_ffff_ffff,
];

/// Returns a copy of `bytes` with something wrong. `donor` is another file of the seed, parts of
/// which may be put in.
///
/// Every other run damages the content of a gzip file instead of the file.
pub fn damage(bytes: &[u8], donor: &[u8], draw: &mut Draws) -> Vec<u8> {
    if bytes.starts_with(&[0x1f, 0x8b]) && draw.below(2) == 0 {
        let mut inside = Vec::new();
        if inflate::Reader::new(Format::Gzip, bytes).read_to_end(&mut inside).is_ok() {
            let changed = damage_plain(&inside, donor, draw);
            return sirocco::compress(Format::Gzip, deflate::Level::FASTEST, &changed);
        }
    }
    damage_plain(bytes, donor, draw)
}

fn damage_plain(bytes: &[u8], donor: &[u8], draw: &mut Draws) -> Vec<u8> {
    let mut damaged = bytes.to_vec();
    let is_text = bytes.len() < 1 << 20 && std::str::from_utf8(bytes).is_ok();
    // A binary file may begin with a text: the header of a PLY or of a .npy.
    let text_end = if is_text { bytes.len() } else { header_length(bytes) };
    // Most runs do little, so that what is read reaches the code behind the parser.
    for _ in 0..draw.pick(&[1, 1, 1, 2, 4]) {
        if text_end > 0 && draw.below(if is_text { 8 } else { 2 }) > 0 {
            damage_text(&mut damaged, text_end, draw);
        } else {
            damage_bytes(&mut damaged, donor, draw);
        }
    }
    damaged
}

/// Length of the text at the start of a file, bytes; 0 if it does not begin with one.
fn header_length(bytes: &[u8]) -> usize {
    let is_text = |byte: &u8| byte.is_ascii_graphic() || byte.is_ascii_whitespace();
    let skipped = if bytes.starts_with(b"\x93NUMPY") { 10 } else { 0 };
    let length = bytes.get(skipped..).unwrap_or_default().iter().take_while(|byte| is_text(byte)).count();
    if length > 40 { skipped + length } else { 0 }
}

/// Changes words and lines among the first `end` bytes.
fn damage_text(bytes: &mut Vec<u8>, end: usize, draw: &mut Draws) {
    let end = end.min(bytes.len());
    let at = draw.below(end);
    let kind = draw.below(10);
    if kind < 7 {
        // A whole number or word is replaced, so that what follows is still understood.
        let is_word = |byte: u8| byte.is_ascii_alphanumeric() || b".-+_".contains(&byte);
        let is_number = |byte: u8| byte.is_ascii_digit() || b".-+".contains(&byte);
        let wanted = |byte: u8| if kind < 5 { is_number(byte) } else { is_word(byte) };
        let Some(start) = bytes[at..end].iter().position(|byte| wanted(*byte)).map(|way| at + way) else {
            return;
        };
        let length = bytes[start..end].iter().position(|byte| !is_word(*byte)).unwrap_or(end - start);
        // Half of the time it is only scaled or negated.
        let text = match draw.below(8) {
            0 => format!("-{}", String::from_utf8_lossy(&bytes[start..start + length])),
            1 => format!("{}e{}", String::from_utf8_lossy(&bytes[start..start + length]), draw.below(60)),
            2 => String::from_utf8_lossy(&bytes[start..start + length]).to_uppercase(),
            _ => draw.pick(TEXTS).to_owned(),
        };
        bytes.splice(start..start + length, text.bytes());
        return;
    }
    let line_start = bytes[..at].iter().rposition(|byte| *byte == b'\n').map_or(0, |place| place + 1);
    let line_end = bytes[at..end].iter().position(|byte| *byte == b'\n').map_or(end, |way| at + way + 1);
    match kind {
        7 => drop(bytes.drain(line_start..line_end)),
        8 => {
            let line = bytes[line_start..line_end].to_vec();
            bytes.splice(line_end..line_end, line);
        }
        _ => {
            drop(
                bytes.splice(line_start..line_start, draw.pick(&["\n", " ", "\r", "#", "\u{feff}"]).bytes()),
            );
        }
    }
}

fn damage_bytes(bytes: &mut Vec<u8>, donor: &[u8], draw: &mut Draws) {
    let length = bytes.len();
    let at = draw.below(length);
    // Headers are where the harm is done.
    let at = if draw.below(2) == 0 { at % 64.min(length.max(1)) } else { at };
    match draw.below(10) {
        0 => bytes.truncate(at),
        1 => drop(bytes.drain(at..(at + draw.below(64)).min(length))),
        2 => {
            let from = draw.below(length);
            let part = bytes[from..(from + draw.below(64)).min(length)].to_vec();
            bytes.splice(at..at, part);
        }
        3 => {
            let from = draw.below(donor.len());
            let part = &donor[from..(from + draw.below(256)).min(donor.len())];
            let end = (at + part.len()).min(length);
            bytes.splice(at..end, part.iter().copied());
        }
        4 if length > 0 => bytes[at] ^= 1 << draw.below(8),
        5 if length > 0 => bytes[at] = draw.below(256) as u8,
        _ => {
            // A number of 1, 2, 4 or 8 bytes, of either order.
            let width = draw.pick(&[1, 2, 4, 4, 8]).min(length - at);
            let pattern = draw.pick(PATTERNS);
            let whole = if draw.below(4) == 0 { pattern.to_be_bytes() } else { pattern.to_le_bytes() };
            bytes[at..at + width].copy_from_slice(&whole[..width]);
        }
    }
}
