//! An MP4 file of one H.264 track that every player and browser takes.
//!
//! - `avc1`: parameter sets out of band in `avcC`, samples of NAL units behind lengths of 4 bytes.
//! - `colr` (nclx): BT.709, limited range, as the stream itself says.
//! - A clock that the frame rate divides exactly, one duration for all samples, a table of
//!   keyframes.
//! - `moov` before `mdat`, so that playing starts before the file is there in full.
//!
//! The table comes first but is known last: samples go to a temporary file, of which 4 bytes a
//! sample stay in memory, and are copied behind the finished table. A file needs twice its size on
//! the disk for that moment.

use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::num::NonZeroU32;
use std::path::Path;

use shiguredo_mp4::bitstream::h264::{H264SampleEntryConfig, LengthSize, build_avc1_box};
use shiguredo_mp4::boxes::{
    Avc1Box, Brand, Co64Box, DinfBox, FtypBox, HdlrBox, MdatBox, MdhdBox, MdiaBox, MediaHeader, MinfBox,
    MoovBox, MvhdBox, SampleEntry, StblBox, StcoBox, StscBox, StscEntry, StsdBox, StssBox, StszBox, SttsBox,
    SttsEntry, TkhdBox, TrakBox, UnknownBox, VmhdBox,
};
use shiguredo_mp4::{
    BoxHeader, BoxSize, BoxType, Either, Encode, FixedPointNumber, LanguageCode, Mp4FileTime,
};
use wm_base::files::TempFile;

use super::FrameRate;
use super::settings::{KEYFRAME_INTERVAL_S, temporary};
use crate::{MediaError, PictureSize, Tags};

/// Collects samples and becomes the file.
#[derive(Debug)]
pub(crate) struct Mp4Writer {
    size: PictureSize,
    rate: FrameRate,
    /// Samples one after the other, beside the final file.
    samples: BufWriter<TempFile>,
    /// Bytes of each sample.
    sizes: Vec<u32>,
    /// Numbers of the keyframes, from 1.
    keyframes: Vec<NonZeroU32>,
    /// Bytes of all samples.
    length: u64,
}

/// NAL units that say how to decode the others, without start codes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct ParameterSets {
    /// Sequence parameter set.
    pub(crate) sps: Vec<u8>,
    /// Picture parameter set.
    pub(crate) pps: Vec<u8>,
}

impl Mp4Writer {
    /// Starts the file `target`.
    ///
    /// # Errors
    /// No temporary file can be made beside `target`.
    pub(super) fn create(target: &Path, size: PictureSize, rate: FrameRate) -> Result<Self, MediaError> {
        let samples = BufWriter::with_capacity(1 << 18, temporary(target)?);
        Ok(Self { size, rate, samples, sizes: Vec::new(), keyframes: Vec::new(), length: 0 })
    }

    /// The name of the final file.
    pub(super) fn target(&self) -> &Path {
        self.samples.get_ref().target()
    }

    /// Samples so far.
    pub(super) fn count(&self) -> u64 {
        self.sizes.len() as u64
    }

    /// Adds a sample: NAL units, each behind its length in 4 bytes, big-endian.
    ///
    /// # Errors
    /// It cannot be written.
    pub(super) fn sample(&mut self, bytes: &[u8], keyframe: bool) -> Result<(), MediaError> {
        self.samples.write_all(bytes).map_err(|source| MediaError::write(self.target(), source))?;
        self.sizes.push(u32::try_from(bytes.len()).expect("a frame below 4 GiB"));
        if keyframe {
            let number = u32::try_from(self.sizes.len()).ok().and_then(NonZeroU32::new);
            self.keyframes.push(number.expect("from 1 to 2^32"));
        }
        self.length += bytes.len() as u64;
        Ok(())
    }

    /// Puts the file together under its final name and returns its bytes.
    ///
    /// # Errors
    /// No sample was added; it cannot be written.
    pub(super) fn finish(self, sets: &ParameterSets, tags: &Tags) -> Result<u64, MediaError> {
        let target = self.target().to_path_buf();
        let failed = |source: io::Error| MediaError::write(&target, source);
        let refused = |error: shiguredo_mp4::Error| MediaError::Format {
            path: target.clone(),
            format: "MP4",
            reason: error.to_string(),
        };
        if self.sizes.is_empty() {
            return Err(MediaError::NoFrames(target));
        }
        let head = self.head(sets, tags).map_err(refused)?;
        let total = head.len() as u64 + self.length;

        let output = temporary(&target)?;
        (&output).write_all(&head).map_err(failed)?;
        let samples = self.samples.into_inner().map_err(|error| failed(error.into_error()))?;
        samples.file().seek(SeekFrom::Start(0)).map_err(failed)?;
        // File to file: the system copies without passing the bytes through this process.
        let copied = io::copy(&mut samples.file(), &mut output.file()).map_err(failed)?;
        assert_eq!(copied, total - head.len() as u64, "samples were lost");
        output.persist().map_err(|fault| MediaError::write(&target, fault))?;
        Ok(total)
    }

    /// All bytes before the first sample.
    fn head(&self, sets: &ParameterSets, tags: &Tags) -> shiguredo_mp4::Result<Vec<u8>> {
        let mut head = FtypBox {
            major_brand: Brand::ISOM,
            minor_version: 512,
            compatible_brands: vec![Brand::ISOM, Brand::ISO2, Brand::AVC1, Brand::MP41],
        }
        .encode_to_vec()?;
        let mut moov = self.movie(sets, tags)?;
        // The table's length does not depend on the offsets in it, only on their width; what
        // precedes the samples stays far below 1 GiB.
        let wide = self.length > u64::from(u32::MAX) - (1 << 30);
        self.set_offsets(&mut moov, 0, wide);
        let box_size = BoxSize::with_payload_size(MdatBox::TYPE, self.length);
        let mdat = BoxHeader { box_type: MdatBox::TYPE, box_size };
        let start = head.len() + moov.encode_to_vec()?.len() + mdat.external_size();
        self.set_offsets(&mut moov, start as u64, wide);
        head.extend(moov.encode_to_vec()?);
        head.extend(mdat.encode_to_vec()?);
        assert_eq!(head.len(), start);
        Ok(head)
    }

    /// Samples a chunk: what a player fetches at once, about two seconds.
    fn chunk(&self) -> usize {
        self.rate.frames_within(KEYFRAME_INTERVAL_S) as usize
    }

    /// Says where chunks begin if the first sample is at `start` of the file.
    fn set_offsets(&self, moov: &mut MoovBox, start: u64, wide: bool) {
        let mut at = start;
        let offsets = self.sizes.chunks(self.chunk()).map(|sizes| {
            let offset = at;
            at += sizes.iter().map(|&size| u64::from(size)).sum::<u64>();
            offset
        });
        moov.trak_boxes[0].mdia_box.minf_box.stbl_box.stco_or_co64_box = if wide {
            Either::B(Co64Box { chunk_offsets: offsets.collect() })
        } else {
            Either::A(StcoBox { chunk_offsets: offsets.map(|offset| offset as u32).collect() })
        };
    }

    /// The table, without offsets.
    fn movie(&self, sets: &ParameterSets, tags: &Tags) -> shiguredo_mp4::Result<MoovBox> {
        // "Unknown": the time of writing would make two files of the same frames differ.
        let time = Mp4FileTime::from_secs(0);
        let (second, frame) = self.rate.clock();
        let timescale = NonZeroU32::new(second).expect("above 0");
        let duration = self.count() * u64::from(frame);
        let side = |pixels: u32| FixedPointNumber::new(i16::try_from(pixels).unwrap_or(i16::MAX), 0);
        let tkhd_box = TkhdBox {
            flag_track_enabled: true,
            flag_track_in_movie: true,
            flag_track_in_preview: false,
            flag_track_size_is_aspect_ratio: false,
            creation_time: time,
            modification_time: time,
            track_id: 1,
            duration,
            layer: TkhdBox::DEFAULT_LAYER,
            alternate_group: TkhdBox::DEFAULT_ALTERNATE_GROUP,
            volume: TkhdBox::DEFAULT_VIDEO_VOLUME,
            matrix: TkhdBox::DEFAULT_MATRIX,
            width: side(self.size.width),
            height: side(self.size.height),
        };
        let mdia_box = MdiaBox {
            mdhd_box: MdhdBox {
                creation_time: time,
                modification_time: time,
                timescale,
                duration,
                language: LanguageCode::UNDEFINED,
            },
            hdlr_box: HdlrBox { handler_type: HdlrBox::HANDLER_TYPE_VIDE, name: b"VideoHandler\0".to_vec() },
            minf_box: MinfBox {
                media_header: Some(MediaHeader::Vmhd(VmhdBox::default())),
                dinf_box: DinfBox::LOCAL_FILE,
                stbl_box: self.sample_table(sets, frame)?,
                unknown_boxes: Vec::new(),
            },
            unknown_boxes: Vec::new(),
        };
        Ok(MoovBox {
            mvhd_box: MvhdBox {
                creation_time: time,
                modification_time: time,
                timescale,
                duration,
                rate: MvhdBox::DEFAULT_RATE,
                volume: MvhdBox::DEFAULT_VOLUME,
                matrix: MvhdBox::DEFAULT_MATRIX,
                next_track_id: 2,
            },
            trak_boxes: vec![TrakBox { tkhd_box, edts_box: None, mdia_box, unknown_boxes: Vec::new() }],
            mvex_box: None,
            unknown_boxes: comment(tags).into_iter().collect(),
        })
    }

    fn sample_table(&self, sets: &ParameterSets, frame: u32) -> shiguredo_mp4::Result<StblBox> {
        let count = self.sizes.len();
        let chunk = self.chunk();
        // All chunks are full but perhaps the last.
        let mut chunks = vec![(1, chunk.min(count))];
        if count > chunk && !count.is_multiple_of(chunk) {
            chunks.push((count / chunk + 1, count % chunk));
        }
        let number =
            |value: usize| u32::try_from(value).ok().and_then(NonZeroU32::new).expect("from 1 to 2^32");
        let entry = |(first, samples)| StscEntry {
            first_chunk: number(first),
            sample_per_chunk: samples as u32,
            sample_description_index: NonZeroU32::MIN,
        };
        Ok(StblBox {
            stsd_box: StsdBox { entries: vec![SampleEntry::Avc1(sample_entry(sets)?)] },
            stts_box: SttsBox {
                entries: vec![SttsEntry { sample_count: count as u32, sample_delta: frame }],
            },
            ctts_box: None,
            cslg_box: None,
            stsc_box: StscBox { entries: chunks.into_iter().map(entry).collect() },
            stsz_box: StszBox::Variable { entry_sizes: self.sizes.clone() },
            stco_or_co64_box: Either::A(StcoBox { chunk_offsets: Vec::new() }),
            stss_box: Some(StssBox { sample_numbers: self.keyframes.clone() }),
            sdtp_box: None,
            unknown_boxes: Vec::new(),
        })
    }
}

/// The description of the samples for decoders: `avcC` from the parameter sets, then colour and
/// square pixels.
fn sample_entry(sets: &ParameterSets) -> shiguredo_mp4::Result<Avc1Box> {
    let config = H264SampleEntryConfig { length_size: LengthSize::FourBytes };
    let mut entry =
        build_avc1_box(std::slice::from_ref(&sets.sps), std::slice::from_ref(&sets.pps), &config)?;
    // Primaries, transfer and matrix 1 = BT.709, then a byte whose top bit says "full range".
    let colr = b"nclx\x00\x01\x00\x01\x00\x01\x00";
    let pasp = b"\x00\x00\x00\x01\x00\x00\x00\x01";
    entry.unknown_boxes = vec![unknown(*b"colr", colr.to_vec()), unknown(*b"pasp", pasp.to_vec())];
    Ok(entry)
}

/// `tags` as the comment that players show, `key = value` a line.
fn comment(tags: &Tags) -> Option<UnknownBox> {
    if tags.is_empty() {
        return None;
    }
    let text = super::settings::comment(tags);
    // Type 1 = UTF-8, no locale. The handler is the one that iTunes introduced.
    let data = nest(*b"data", &[b"\x00\x00\x00\x01\x00\x00\x00\x00", text.as_bytes()]);
    let items = nest(*b"ilst", &[&nest(*b"\xa9cmt", &[&data])]);
    let handler = nest(*b"hdlr", &[&[0; 8], b"mdirappl", &[0; 9]]);
    Some(unknown(*b"udta", nest(*b"meta", &[&[0; 4], &handler, &items])))
}

/// A box of the parts one after the other.
fn nest(kind: [u8; 4], parts: &[&[u8]]) -> Vec<u8> {
    let length = 8 + parts.iter().map(|part| part.len()).sum::<usize>();
    let length = u32::try_from(length).expect("a short box");
    [&length.to_be_bytes()[..], &kind].iter().chain(parts).copied().flatten().copied().collect()
}

/// A box whose inside the library does not know.
fn unknown(kind: [u8; 4], payload: Vec<u8>) -> UnknownBox {
    let size = u32::try_from(8 + payload.len()).expect("a short box");
    UnknownBox { box_type: BoxType::Normal(kind), box_size: BoxSize::U32(size), payload }
}
