//! Files of MCAP in memory, as far as bags need them: chunks without compression, indexes,
//! statistics and checksums.
//!
//! A file is eight bytes, records, and the same eight bytes. A record is its kind (u8), its length
//! (u64) and its content. Numbers are little-endian; a string is its length (u32) and its bytes; a
//! map the length of its bytes (u32) and pairs. Source: mcap.dev/spec.
//!
//! Written here, in 200 lines, since the format's own library, `mcap` 0.26, brings 14 new crates to
//! the program and 17 s of one core to check them. It is a dependency of the tests alone, which
//! read the files by it.

use std::collections::BTreeMap;

const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

/// Bytes of messages after which a chunk ends, as in the format's own library.
const CHUNK_BYTES: usize = 1 << 20;

/// The kind of a record.
#[derive(Clone, Copy)]
enum Kind {
    Header = 1,
    Footer = 2,
    Schema = 3,
    Channel = 4,
    Message = 5,
    Chunk = 6,
    MessageIndex = 7,
    ChunkIndex = 8,
    Statistics = 11,
    SummaryOffset = 14,
    DataEnd = 15,
}

/// First and last time, ns since 1970.
type TimeSpan = (u64, u64);

/// A file that is being written.
#[derive(Default)]
pub(super) struct McapFile {
    out: Vec<u8>,
    chunk: Chunk,
    /// Records of schemas and channels, which the end of the file repeats.
    schemas: Vec<u8>,
    channels: Vec<u8>,
    schema_count: u16,
    chunk_indexes: Vec<u8>,
    chunk_count: u32,
    /// Messages of each channel; channel n is at n - 1.
    message_counts: Vec<u64>,
    times: Option<TimeSpan>,
}

/// The chunk that is being written.
#[derive(Default)]
struct Chunk {
    records: Vec<u8>,
    times: Option<TimeSpan>,
    /// Time and place in the chunk of each message, by channel.
    indexes: BTreeMap<u16, Vec<(u64, u64)>>,
}

impl McapFile {
    /// Begins a file of a profile; `library` is who writes it.
    pub(super) fn new(profile: &str, library: &str) -> Self {
        let mut out = MAGIC.to_vec();
        record(&mut out, Kind::Header, &[&string(profile), &string(library)]);
        Self { out, ..Self::default() }
    }

    /// Adds the schema of a type of messages and returns its number, from 1.
    pub(super) fn add_schema(&mut self, name: &str, encoding: &str, text: &str) -> u16 {
        self.schema_count += 1;
        let id = self.schema_count;
        let content = [id.to_le_bytes().to_vec(), string(name), string(encoding), string(text)].concat();
        record(&mut self.schemas, Kind::Schema, &[&content]);
        record(&mut self.chunk.records, Kind::Schema, &[&content]);
        id
    }

    /// Adds a channel with one entry of metadata and returns its number, from 1.
    pub(super) fn add_channel(
        &mut self,
        schema: u16,
        topic: &str,
        encoding: &str,
        entry: (&str, &str),
    ) -> u16 {
        self.message_counts.push(0);
        let id = self.message_counts.len() as u16;
        let pair = [string(entry.0), string(entry.1)].concat();
        let content = [
            id.to_le_bytes().to_vec(),
            schema.to_le_bytes().to_vec(),
            string(topic),
            string(encoding),
            sized(&pair),
        ]
        .concat();
        record(&mut self.channels, Kind::Channel, &[&content]);
        record(&mut self.chunk.records, Kind::Channel, &[&content]);
        id
    }

    /// Writes a message of a channel; its time, ns since 1970, is both when it was sent and when it
    /// was logged.
    pub(super) fn message(&mut self, channel: u16, time: u64, data: &[u8]) {
        if self.chunk.records.len() > CHUNK_BYTES {
            self.end_chunk();
        }
        let count = &mut self.message_counts[usize::from(channel) - 1];
        let sequence = *count as u32;
        *count += 1;
        widen(&mut self.times, time);
        widen(&mut self.chunk.times, time);
        let place = self.chunk.records.len() as u64;
        self.chunk.indexes.entry(channel).or_default().push((time, place));
        let time = time.to_le_bytes();
        let parts: [&[u8]; 5] = [&channel.to_le_bytes(), &sequence.to_le_bytes(), &time, &time, data];
        record(&mut self.chunk.records, Kind::Message, &parts);
    }

    /// Writes the chunk and the indexes of its messages.
    fn end_chunk(&mut self) {
        let Chunk { records, times, indexes } = std::mem::take(&mut self.chunk);
        if records.is_empty() {
            return;
        }
        let ((first, last), size) = (times.unwrap_or_default(), records.len() as u64);
        let numbers = [first, last, size].map(u64::to_le_bytes).concat();
        let compression = string("");
        let start = self.out.len() as u64;
        let checksum = crc32fast::hash(&records).to_le_bytes();
        let parts: [&[u8]; 5] = [&numbers, &checksum, &compression, &size.to_le_bytes(), &records];
        record(&mut self.out, Kind::Chunk, &parts);
        let end = self.out.len() as u64;
        let mut places = Vec::new();
        for (channel, index) in indexes {
            places.extend(channel.to_le_bytes());
            places.extend((self.out.len() as u64).to_le_bytes());
            let pairs: Vec<u8> = index
                .iter()
                .flat_map(|(time, place)| [time.to_le_bytes(), place.to_le_bytes()].concat())
                .collect();
            record(&mut self.out, Kind::MessageIndex, &[&channel.to_le_bytes(), &sized(&pairs)]);
        }
        let content = [
            [first, last, start, end - start].map(u64::to_le_bytes).concat(),
            sized(&places),
            (self.out.len() as u64 - end).to_le_bytes().to_vec(),
            compression,
            [size, size].map(u64::to_le_bytes).concat(),
        ]
        .concat();
        record(&mut self.chunk_indexes, Kind::ChunkIndex, &[&content]);
        self.chunk_count += 1;
    }

    /// Writes what is left and returns the bytes of the file.
    pub(super) fn finish(mut self) -> Vec<u8> {
        self.end_chunk();
        let mut out = self.out;
        let checksum = crc32fast::hash(&out);
        record(&mut out, Kind::DataEnd, &[&checksum.to_le_bytes()]);
        let summary = out.len();
        let (first, last) = self.times.unwrap_or_default();
        let counts: Vec<u8> = (1u16..)
            .zip(&self.message_counts)
            .flat_map(|(channel, count)| [&channel.to_le_bytes()[..], &count.to_le_bytes()].concat())
            .collect();
        let statistics = [
            self.message_counts.iter().sum::<u64>().to_le_bytes().to_vec(),
            self.schema_count.to_le_bytes().to_vec(),
            // No attachments and no metadata.
            [self.message_counts.len() as u32, 0, 0, self.chunk_count].map(u32::to_le_bytes).concat(),
            [first, last].map(u64::to_le_bytes).concat(),
            sized(&counts),
        ]
        .concat();
        let mut statistics_record = Vec::new();
        record(&mut statistics_record, Kind::Statistics, &[&statistics]);
        let mut offsets = Vec::new();
        for (kind, records) in [
            (Kind::Schema, self.schemas),
            (Kind::Channel, self.channels),
            (Kind::Statistics, statistics_record),
            (Kind::ChunkIndex, self.chunk_indexes),
        ] {
            if !records.is_empty() {
                let place = [out.len() as u64, records.len() as u64].map(u64::to_le_bytes).concat();
                record(&mut offsets, Kind::SummaryOffset, &[&[kind as u8], &place]);
            }
            out.extend(records);
        }
        let offsets_start = out.len() as u64;
        out.extend(offsets);
        // The checksum of the summary covers the footer up to itself.
        let footer = out.len();
        let starts = [summary as u64, offsets_start].map(u64::to_le_bytes).concat();
        record(&mut out, Kind::Footer, &[&starts, &[0; 4]]);
        debug_assert_eq!(out.len() - footer, 29);
        let end = out.len() - 4;
        let checksum = crc32fast::hash(&out[summary..end]);
        out.truncate(end);
        out.extend(checksum.to_le_bytes());
        out.extend(MAGIC);
        out
    }
}

/// Widens a span of times by one.
fn widen(times: &mut Option<TimeSpan>, time: u64) {
    let (first, last) = times.unwrap_or((time, time));
    *times = Some((first.min(time), last.max(time)));
}

/// Appends a record with a content in parts.
fn record(out: &mut Vec<u8>, kind: Kind, parts: &[&[u8]]) {
    out.push(kind as u8);
    out.extend((parts.iter().map(|part| part.len() as u64).sum::<u64>()).to_le_bytes());
    parts.iter().for_each(|part| out.extend(*part));
}

/// Bytes behind their number.
fn sized(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes(), bytes].concat()
}

fn string(text: &str) -> Vec<u8> {
    sized(text.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::mcap::{MessageStream, Summary};

    #[test]
    fn the_library_finds_messages_chunks_and_statistics() {
        let mut file = McapFile::new("ros2", "a program");
        let schema = file.add_schema("a/msg/A", "ros2msg", "uint8[] data\n");
        let channels = ["/a", "/b"].map(|topic| file.add_channel(schema, topic, "cdr", ("key", "value")));
        for k in 0..5u64 {
            file.message(channels[k as usize % 2], 100 + k, &vec![k as u8; 400_000]);
        }
        let bytes = file.finish();
        let found: Vec<_> = MessageStream::new(&bytes).unwrap().map(Result::unwrap).collect();
        let facts: Vec<_> =
            found.iter().map(|m| (m.channel.topic.as_str(), m.sequence, m.log_time, m.data[0])).collect();
        assert_eq!(
            facts,
            [("/a", 0, 100, 0), ("/b", 0, 101, 1), ("/a", 1, 102, 2), ("/b", 1, 103, 3), ("/a", 2, 104, 4)]
        );
        assert_eq!(found[0].channel.metadata["key"], "value");
        let summary = Summary::read(&bytes).unwrap().unwrap();
        let statistics = summary.stats.as_ref().unwrap();
        assert_eq!((statistics.message_count, statistics.chunk_count, statistics.channel_count), (5, 2, 2));
        assert_eq!((statistics.message_start_time, statistics.message_end_time), (100, 104));
        assert_eq!(statistics.channel_message_counts, BTreeMap::from([(1, 3), (2, 2)]));
        for index in &summary.chunk_indexes {
            let found = summary.read_message_indexes(&bytes, index).unwrap();
            for (channel, entries) in found {
                for entry in entries {
                    let message = summary.seek_message(&bytes, index, &entry).unwrap();
                    assert_eq!((message.log_time, &message.channel), (entry.log_time, &channel));
                }
            }
        }
        assert!(has_good_checksums(&bytes));
        // A byte of a chunk, of the header, and of the summary.
        for place in [1000, 30, bytes.len() - 60] {
            let mut broken = bytes.clone();
            broken[place] ^= 1;
            assert!(!has_good_checksums(&broken), "byte {place}");
        }
    }

    /// Returns true if the library reads all records and finds the checksums of chunks, data and
    /// summary right.
    fn has_good_checksums(mut bytes: &[u8]) -> bool {
        use ::mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
        use std::io::Read;
        let options = LinearReaderOptions::default()
            .with_validate_chunk_crcs(true)
            .with_validate_data_section_crc(true)
            .with_validate_summary_section_crc(true);
        let mut reader = LinearReader::new_with_options(options);
        while let Some(event) = reader.next_event() {
            match event {
                Ok(LinearReadEvent::ReadRequest(count)) => {
                    let read = bytes.read(reader.insert(count)).unwrap();
                    reader.notify_read(read);
                }
                Ok(LinearReadEvent::Record { .. }) => {}
                Err(_) => return false,
            }
        }
        true
    }
}
