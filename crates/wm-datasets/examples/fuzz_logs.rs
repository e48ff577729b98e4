//! Damages small logs and reads them: `cargo run -p wm-datasets --features testing --example fuzz_logs -- COUNT SEED [FOLDER]`.
//!
//! Each round damages one file of one log: bits are flipped, bytes overwritten, numbers in texts replaced by extreme ones, the file cut or
//! grown. The log is opened, its sweeps are read and, in one round of eight, its capture is written. Nothing may panic, and each error is one
//! line. Prints how many rounds ended how.

use std::collections::BTreeMap;
use std::fs;
use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use wm_datasets::logs::mini::MINI_LOGS;
use wm_datasets::{DrivingLog, LogCaptureOptions, LogOptions};

/// Knuth's linear congruential generator.
struct Random(u64);

impl Random {
    fn below(&mut self, count: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % count.max(1)
    }
}

/// Texts that stand for a number.
const NUMBERS: [&str; 18] = [
    "0",
    "-1",
    "1e308",
    "-1e308",
    "1e-308",
    "NaN",
    "inf",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551615",
    "4294967295",
    "1e18",
    "99999999999999999999999",
    "0.0",
    "\"\"",
    "null",
    "[]",
    "1e40",
];

fn files(folder: &Path, all: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> =
        fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() { files(&path, all) } else { all.push(path) }
    }
}

fn damaged(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let mut out = bytes.to_vec();
    let is_text = out.iter().take(200).all(|byte| byte.is_ascii_graphic() || byte.is_ascii_whitespace());
    for _ in 0..=random.below(3) {
        let at = random.below(out.len());
        match random.below(if is_text { 8 } else { 6 }) {
            0 => out.truncate(at),
            1 if !out.is_empty() => out[at] ^= 1 << random.below(8),
            2 if !out.is_empty() => out[at] = [0, 0xff, 0x7f, 0x80][random.below(4)],
            // A number of 4 or 8 bytes.
            3 => {
                let value = [0, -1, i64::MAX, i64::MIN, 1 << 31, 1 << 40, 0x7ff0_0000_0000_0000]
                    [random.below(7)]
                .to_le_bytes();
                let length = [4, 8][random.below(2)].min(out.len() - at);
                out[at..at + length].copy_from_slice(&value[..length]);
            }
            4 => out.extend_from_within(at..),
            5 => drop(out.drain(at..(at + random.below(64)).min(out.len()))),
            _ => {
                let is_digit = |byte: &u8| byte.is_ascii_digit() || b".-e".contains(byte);
                let Some(start) = out[at.min(out.len())..].iter().position(is_digit).map(|way| at + way)
                else {
                    continue;
                };
                let end =
                    out[start..].iter().position(|byte| !is_digit(byte)).map_or(out.len(), |way| start + way);
                let number = NUMBERS[random.below(NUMBERS.len())];
                out.splice(start..end, number.bytes());
            }
        }
    }
    out
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let count: usize =
        arguments.next().unwrap_or_default().parse().map_err(|_| "usage: fuzz_logs COUNT SEED [FOLDER]")?;
    let seed: u64 =
        arguments.next().unwrap_or_default().parse().map_err(|_| "usage: fuzz_logs COUNT SEED [FOLDER]")?;
    let root = PathBuf::from(arguments.next().unwrap_or_else(|| "/dev/shm".into()))
        .join(format!("fuzz-logs-{seed}"));
    let mut logs = Vec::new();
    for (index, (name, write)) in MINI_LOGS.iter().enumerate() {
        let folder = root.join(index.to_string());
        let mini = write(&folder)?;
        let mut all = Vec::new();
        files(&folder, &mut all);
        let all: Vec<(PathBuf, Vec<u8>)> = all
            .into_iter()
            .map(|path| fs::read(&path).map(|bytes| (path, bytes)))
            .collect::<Result<_, _>>()?;
        logs.push((*name, mini.path, all));
    }
    let mut random = Random(seed ^ 0x9e37_79b9_7f4a_7c15);
    let mut ends = BTreeMap::<(&str, &str), usize>::new();
    let mut panics = 0;
    for round in 0..count {
        let log = random.below(logs.len());
        let (name, path, all) = &logs[log];
        // Photos are most of the files, and least of the readers.
        let mut file = random.below(all.len());
        if all[file].0.components().any(|part| part.as_os_str().to_string_lossy().contains("image")) {
            file = random.below(all.len());
        }
        let (file, bytes) = &all[file];
        fs::write(file, damaged(bytes, &mut random))?;
        let writes = random.below(8) == 0;
        let read = catch_unwind(AssertUnwindSafe(|| -> Result<&str, String> {
            let Some(log) = DrivingLog::open(path, &LogOptions::default()).map_err(|e| e.to_string())? else {
                return Ok("no log");
            };
            for sweep in &log.sweeps {
                sweep.points().map_err(|e| e.to_string())?;
            }
            if writes {
                let options = LogCaptureOptions { depth_pixels: 1200, ..LogCaptureOptions::default() };
                let folder = root.join("capture");
                log.write_capture(&folder, &options, &mut |_| ControlFlow::Continue(()))
                    .map_err(|e| e.to_string())?;
                return Ok("written");
            }
            Ok("read")
        }));
        let end = match read {
            Ok(Ok(end)) => end,
            Ok(Err(message)) if message.contains('\n') => {
                println!("round {round}: {name}: more than one line: {message:?}");
                panics += 1;
                "many lines"
            }
            Ok(Err(_)) => "error",
            Err(_) => {
                println!("round {round}: {name}: {} panics", file.display());
                fs::write(root.join(format!("panic-{round}")), fs::read(file)?)?;
                panics += 1;
                "panic"
            }
        };
        *ends.entry((*name, end)).or_default() += 1;
        fs::write(file, bytes)?;
    }
    for ((name, end), count) in &ends {
        println!("{name:16} {end:10} {count}");
    }
    println!("{count} rounds, {panics} panics");
    if panics == 0 {
        fs::remove_dir_all(&root)?;
    }
    Ok(())
}
