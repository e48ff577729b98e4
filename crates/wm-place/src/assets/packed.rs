//! Prepared assets as they are sent: a gzip stream of the file, which is half as long or less.

use sirocco::{Format, deflate};
use std::borrow::Cow;
use std::io::Read;

/// The beginning of a packed asset.
const MAGIC: &[u8] = &[0x1f, 0x8b];
/// Greatest length of an asset over that of its packed form.
const MAX_GROWTH_RATIO: u64 = 200;
const COMPRESSION_LEVEL: u8 = 7;

/// Packs the bytes of an asset file. [`AssetCache`](super::AssetCache) reads both forms. The same
/// bytes are packed to the same bytes.
#[must_use]
pub fn pack_asset(bytes: &[u8]) -> Vec<u8> {
    sirocco::compress(Format::Gzip, deflate::Level::new(COMPRESSION_LEVEL), bytes)
}

/// The bytes of an asset file, packed or not; `None` if they are packed and damaged.
pub(crate) fn unpacked(bytes: &[u8]) -> Option<Cow<'_, [u8]>> {
    if !bytes.starts_with(MAGIC) {
        return Some(bytes.into());
    }
    let most = bytes.len() as u64 * MAX_GROWTH_RATIO;
    let mut whole = Vec::new();
    let mut reader = sirocco::inflate::Reader::new(Format::Gzip, bytes).take(most + 1);
    reader.read_to_end(&mut whole).ok()?;
    (whole.len() as u64 <= most).then(|| whole.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_assets_are_read() {
        let asset: Vec<u8> = (0..20_000u32).flat_map(|i| (i / 7).to_le_bytes()).collect();
        let packed = pack_asset(&asset);
        assert!(packed.len() < asset.len() / 2);
        assert_eq!(unpacked(&packed).as_deref(), Some(&asset[..]));
        assert_eq!(unpacked(&asset).as_deref(), Some(&asset[..]));
        for cut in [0, 3, packed.len() / 2, packed.len() - 1] {
            assert_ne!(unpacked(&packed[..cut]).as_deref(), Some(&asset[..]));
        }
        // A stream that grows without end takes no more memory than its length allows.
        assert_eq!(unpacked(&pack_asset(&[0; 5_000_000])), None);
    }
}
