//! Memory that a picture takes, told before it is taken.

use anyhow::{Result, bail};

/// Memory of a picture and of what draws it in clear weather, bytes a pixel: measured with
/// 2048x2048 and 6144x6144 px. Snow takes some three times as much, heavy rain five times.
const BYTES_PER_PIXEL: u64 = 20;
/// Pictures below this are drawn without a word, bytes.
const MIN_MENTIONED_BYTES: u64 = 1 << 30;

/// Says the memory of a large picture, and refuses one of more than four fifths of what is free.
///
/// # Errors
/// The picture is too large.
pub(crate) fn check_picture(width: u32, height: u32) -> Result<()> {
    let needed = BYTES_PER_PIXEL * u64::from(width) * u64::from(height);
    if needed < MIN_MENTIONED_BYTES {
        return Ok(());
    }
    let gigabytes = |bytes: u64| bytes as f64 * 1e-9;
    if let Some(free) = available()
        && needed > free / 5 * 4
    {
        bail!(
            "--size {width}x{height}: takes at least {:.1} GB of memory, and {:.1} GB are free: give a smaller size",
            gigabytes(needed),
            gigabytes(free)
        );
    }
    eprintln!(
        "note: a picture of {width}x{height} px takes at least {:.1} GB of memory, and five times as much in heavy rain",
        gigabytes(needed)
    );
    Ok(())
}

/// Memory that the system can give, bytes; `None` where it does not say.
fn available() -> Option<u64> {
    bytes_of("/proc/meminfo", "MemAvailable:")
}

/// Returns the bytes that a file of the system says of a key, in KiB.
pub(crate) fn bytes_of(file: &str, key: &str) -> Option<u64> {
    let about = std::fs::read_to_string(file).ok()?;
    let line = about.lines().find_map(|line| line.strip_prefix(key))?;
    Some(line.trim().trim_end_matches(" kB").parse::<u64>().ok()? << 10)
}
