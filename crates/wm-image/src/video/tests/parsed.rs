//! MP4 files taken apart by other code than wrote them, as far as there is some.

use openh264::decoder::Decoder;
use openh264::formats::YUVSource;
use shiguredo_mp4::Decode;
use shiguredo_mp4::bitstream::h264::{LengthSize, length_prefixed_to_annexb};
use shiguredo_mp4::boxes::{Avc1Box, MoovBox, SampleEntry, StblBox};
use shiguredo_mp4::demux::{Input, Mp4FileDemuxer};

use super::*;

/// A file taken apart.
pub(super) struct Parsed {
    pub(super) bytes: Vec<u8>,
    /// Kinds and ranges of the boxes at the top.
    pub(super) boxes: Vec<(String, std::ops::Range<usize>)>,
    pub(super) moov: MoovBox,
}

impl Parsed {
    pub(super) fn open(path: &Path) -> Self {
        let bytes = fs::read(path).unwrap();
        let mut boxes = Vec::new();
        let mut at = 0;
        while at < bytes.len() {
            let length = u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
            let kind = String::from_utf8(bytes[at + 4..at + 8].to_vec()).unwrap();
            boxes.push((kind, at..at + length));
            at += length;
        }
        assert_eq!(at, bytes.len());
        let moov = boxes.iter().find(|(kind, _)| kind == "moov").unwrap().1.clone();
        let (moov, _) = MoovBox::decode(&bytes[moov]).unwrap();
        Self { bytes, boxes, moov }
    }

    pub(super) fn table(&self) -> &StblBox {
        &self.moov.trak_boxes[0].mdia_box.minf_box.stbl_box
    }

    pub(super) fn entry(&self) -> &Avc1Box {
        match &self.table().stsd_box.entries[..] {
            [SampleEntry::Avc1(entry)] => entry,
            other => panic!("{other:?}"),
        }
    }

    /// Samples as the demuxer finds them.
    pub(super) fn samples(&self) -> Vec<&[u8]> {
        let mut demuxer = Mp4FileDemuxer::new();
        demuxer.handle_input(Input { position: 0, data: &self.bytes });
        let mut samples = Vec::new();
        while let Some(sample) = demuxer.next_sample().unwrap() {
            samples.push(&self.bytes[sample.data_offset as usize..][..sample.data_size]);
        }
        samples
    }

    /// All frames' planes, decoded by OpenH264.
    pub(super) fn decode(&self) -> Vec<[Vec<u8>; 3]> {
        let config = &self.entry().avcc_box;
        let mut decoder = Decoder::new().unwrap();
        let start = [[0, 0, 0, 1].as_slice(), &config.sps_list[0], &[0, 0, 0, 1], &config.pps_list[0]];
        decoder.decode(&start.concat()).unwrap();
        let decode = |sample: &&[u8]| {
            let stream = length_prefixed_to_annexb(sample, LengthSize::FourBytes).unwrap();
            let picture = decoder.decode(&stream).unwrap().expect("a frame for each sample");
            let ((width, height), strides) = (picture.dimensions(), picture.strides());
            let plane = |bytes: &[u8], stride: usize, width: usize, height: usize| -> Vec<u8> {
                bytes.chunks(stride).take(height).flat_map(|row| row[..width].to_vec()).collect()
            };
            [
                plane(picture.y(), strides.0, width, height),
                plane(picture.u(), strides.1, width / 2, height / 2),
                plane(picture.v(), strides.2, width / 2, height / 2),
            ]
        };
        self.samples().iter().map(decode).collect()
    }
}

/// The colour description of the sequence parameter set: present flags, full range, the three
/// codes.
pub(super) fn vui_colour(sps: &[u8]) -> Vec<u32> {
    let mut bits = Vec::new();
    let mut zeros = 0;
    // Behind the header byte; an emulation prevention byte 3 follows two zeros.
    for &byte in &sps[1..] {
        if zeros >= 2 && byte == 3 {
            zeros = 0;
            continue;
        }
        zeros = if byte == 0 { zeros + 1 } else { 0 };
        bits.extend((0..8).rev().map(|bit| u32::from(byte >> bit & 1)));
    }
    let mut bits = bits.into_iter();
    let mut fixed = |count: usize| bits.by_ref().take(count).fold(0, |value, bit| 2 * value + bit);
    let golomb = |fixed: &mut dyn FnMut(usize) -> u32| {
        let mut length = 0;
        while fixed(1) == 0 {
            length += 1;
        }
        (1 << length) - 1 + fixed(length)
    };
    assert_eq!(fixed(8), 66, "Baseline has no extra fields here");
    fixed(16); // constraints, level
    golomb(&mut fixed); // id
    golomb(&mut fixed); // log2_max_frame_num
    match golomb(&mut fixed) {
        0 => _ = golomb(&mut fixed),
        2 => {}
        other => panic!("picture order count type {other}"),
    }
    golomb(&mut fixed); // reference frames
    fixed(1);
    golomb(&mut fixed); // width
    golomb(&mut fixed); // height
    assert_eq!(fixed(1), 1, "frames, not fields");
    fixed(1);
    if fixed(1) == 1 {
        // Cropping.
        for _ in 0..4 {
            golomb(&mut fixed);
        }
    }
    assert_eq!(fixed(1), 1, "VUI present");
    assert_eq!((fixed(1), fixed(1)), (0, 0), "aspect ratio, overscan");
    let present = fixed(1);
    fixed(3); // video format
    let (full_range, described) = (fixed(1), fixed(1));
    vec![present, full_range, described, fixed(8), fixed(8), fixed(8)]
}
