//! The little of ZIP that SOG needs: entries stored or deflated, found by the directory at the end.
//!
//! No ZIP64, encryption or several disks. What is written is stored: WebP does not shrink further.

use crate::formats::bytes::{check_unpacked, unpack_exact};
use sirocco::inflate;
use std::io::Write;
use wm_base::error::Problem;

const LOCAL_SIGNATURE: u32 = 0x0403_4b50;
const CENTRAL_SIGNATURE: u32 = 0x0201_4b50;
const END_SIGNATURE: u32 = 0x0605_4b50;
/// Bytes of the end of the directory, and most of a comment behind it.
const END_SIZE: usize = 22;
const MAX_COMMENT: usize = 65_535;
/// Files that an archive may have.
const MAX_ENTRIES: usize = 4096;

/// An archive in memory.
pub(crate) struct Archive<'a> {
    bytes: &'a [u8],
    entries: Vec<Entry<'a>>,
}

struct Entry<'a> {
    name: &'a [u8],
    method: u16,
    crc: u32,
    packed: u32,
    unpacked: u32,
    /// The offset of its local header.
    at: u32,
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

impl<'a> Archive<'a> {
    /// Reads the directory.
    ///
    /// # Errors
    /// If there is none, as at the end of a cut file.
    pub(crate) fn new(bytes: &'a [u8]) -> Result<Self, Problem> {
        let entries = directory(bytes)
            .ok_or_else(|| Problem::Cut("the ZIP: its directory is not at the end".into()))?;
        Ok(Self { bytes, entries })
    }

    /// The content of the file called `name`, `None` if there is none.
    ///
    /// # Errors
    /// If it is packed in another way, cut or damaged.
    pub(crate) fn file(&self, name: &str) -> Result<Option<Vec<u8>>, Problem> {
        let Some(entry) = self.entries.iter().find(|entry| entry.name == name.as_bytes()) else {
            return Ok(None);
        };
        let damaged = |what: &str| Problem::Header(format!("{name} in the ZIP {what}"));
        let packed = self.packed(entry).ok_or_else(|| Problem::Cut(format!("{name} in the ZIP")))?;
        let content = match entry.method {
            0 => packed.to_vec(),
            8 => {
                check_unpacked(u64::from(entry.unpacked), packed.len() as u64, name)?;
                let mut content = vec![0; entry.unpacked as usize];
                unpack_exact(
                    &mut inflate::Reader::new(sirocco::Format::Deflate, packed),
                    &mut content,
                    name,
                )?;
                content
            }
            method => {
                return Err(damaged(&format!("is packed by method {method}; stored and deflated are read")));
            }
        };
        if crc32fast::hash(&content) != entry.crc {
            return Err(damaged("is damaged: its checksum does not fit"));
        }
        Ok(Some(content))
    }

    /// The packed bytes of an entry.
    fn packed(&self, entry: &Entry) -> Option<&'a [u8]> {
        let local = self.bytes.get(entry.at as usize..)?;
        if u32_at(local, 0)? != LOCAL_SIGNATURE {
            return None;
        }
        let names = usize::from(u16_at(local, 26)?) + usize::from(u16_at(local, 28)?);
        local.get(30 + names..)?.get(..entry.packed as usize)
    }
}

fn directory(bytes: &[u8]) -> Option<Vec<Entry<'_>>> {
    let last = bytes.len().checked_sub(END_SIZE)?;
    let first = last.saturating_sub(MAX_COMMENT);
    let end = (first..=last).rev().find(|at| u32_at(bytes, *at) == Some(END_SIGNATURE))?;
    let (count, mut at) = (usize::from(u16_at(bytes, end + 10)?), u32_at(bytes, end + 16)? as usize);
    let mut entries = Vec::new();
    for _ in 0..count.min(MAX_ENTRIES) {
        let header = bytes.get(at..)?;
        if u32_at(header, 0)? != CENTRAL_SIGNATURE {
            return None;
        }
        let name = usize::from(u16_at(header, 28)?);
        entries.push(Entry {
            name: header.get(46..46 + name)?,
            method: u16_at(header, 10)?,
            crc: u32_at(header, 16)?,
            packed: u32_at(header, 20)?,
            unpacked: u32_at(header, 24)?,
            at: u32_at(header, 42)?,
        });
        at += 46 + name + usize::from(u16_at(header, 30)?) + usize::from(u16_at(header, 32)?);
    }
    Some(entries)
}

/// Writes an archive, file after file. Their time is the first that ZIP knows, so that equal scenes
/// give equal bytes.
pub(crate) struct Writer<'a> {
    out: &'a mut dyn Write,
    central: Vec<u8>,
    /// Bytes written.
    at: u64,
    count: u16,
}

impl<'a> Writer<'a> {
    /// Begins an archive.
    pub(crate) fn new(out: &'a mut dyn Write) -> Self {
        Self { out, central: Vec::new(), at: 0, count: 0 }
    }

    /// Adds a file.
    ///
    /// # Errors
    /// If `out` fails or an archive cannot hold so much.
    pub(crate) fn add(&mut self, name: &str, bytes: &[u8]) -> Result<(), Problem> {
        /// 1980-01-01 00:00.
        const DOS_EPOCH: [u8; 4] = [0, 0, 0x21, 0];
        let size = bytes.len() as u64;
        if self.at + size > u64::from(u32::MAX) {
            return Err(Problem::Value("too many splats for one .sog: write a folder, OUT/meta.json".into()));
        }
        // Version 2.0, no flags, stored.
        let mut shared = vec![20, 0, 0, 0, 0, 0];
        shared.extend(DOS_EPOCH);
        shared.extend(
            [crc32fast::hash(bytes), size as u32, size as u32].into_iter().flat_map(u32::to_le_bytes),
        );
        shared.extend((name.len() as u16).to_le_bytes());
        shared.extend([0, 0]);
        self.out.write_all(&LOCAL_SIGNATURE.to_le_bytes())?;
        self.out.write_all(&shared)?;
        self.out.write_all(name.as_bytes())?;
        self.out.write_all(bytes)?;
        self.central.extend(CENTRAL_SIGNATURE.to_le_bytes());
        self.central.extend([20, 0]);
        self.central.extend(shared);
        // No comment, disk 0, no attributes.
        self.central.extend([0; 10]);
        self.central.extend((self.at as u32).to_le_bytes());
        self.central.extend(name.as_bytes());
        self.at += 30 + name.len() as u64 + size;
        self.count += 1;
        Ok(())
    }

    /// Ends the archive.
    ///
    /// # Errors
    /// If `out` fails.
    pub(crate) fn finish(self) -> Result<(), Problem> {
        self.out.write_all(&self.central)?;
        let count = self.count.to_le_bytes();
        let mut end = END_SIGNATURE.to_le_bytes().to_vec();
        end.extend([0, 0, 0, 0, count[0], count[1], count[0], count[1]]);
        end.extend((self.central.len() as u32).to_le_bytes());
        end.extend((self.at as u32).to_le_bytes());
        end.extend([0, 0]);
        Ok(self.out.write_all(&end)?)
    }
}
