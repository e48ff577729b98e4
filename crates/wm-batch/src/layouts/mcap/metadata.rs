//! `metadata.yaml` of a bag.

use super::topics::{TF_STATIC_TOPIC, TF_TOPIC, file_name, instants, topics};
use crate::{ClipRecord, ReadingInfo, SetInfo};
use std::collections::BTreeMap;
use std::fmt::Write;

/// A file of the bag.
struct FileCount {
    block: u32,
    /// First and last time, ns.
    times: [i64; 2],
    messages: usize,
}

/// Writes the metadata of a bag, version 5, from the plan alone. Times are those of readings.
pub(super) fn of(set: &SetInfo, record: &ClipRecord) -> String {
    let ClipRecord { clip, readings } = record;
    let topics = topics(set);
    let mut counts = vec![0; topics.len()];
    let mut blocks: BTreeMap<u32, Vec<ReadingInfo>> = BTreeMap::new();
    for info in readings {
        blocks.entry(info.block).or_default().push(*info);
    }
    let files: Vec<FileCount> = blocks
        .iter()
        .map(|(block, own)| {
            let before: usize = counts.iter().sum();
            counts[TF_STATIC_TOPIC] += 1;
            counts[TF_TOPIC] += instants(clip, own).count();
            for (topic, count) in topics.iter().zip(&mut counts) {
                *count += own.iter().filter(|info| topic.sensor == Some(info.sensor)).count();
            }
            FileCount {
                block: *block,
                times: [own[0].timestamp(clip), own[own.len() - 1].timestamp(clip)],
                messages: counts.iter().sum::<usize>() - before,
            }
        })
        .collect();
    // Blocks may overlap: a slow sensor's reading of a frame can be later than the next frame.
    let start = files.iter().map(|file| file.times[0]).min().unwrap_or(0);
    let end = files.iter().map(|file| file.times[1]).max().unwrap_or(0);
    let mut out = String::new();
    let mut line = |indent: usize, text: std::fmt::Arguments<'_>| {
        // Writing to a string does not fail.
        let _ = writeln!(out, "{:1$}{text}", "", 2 * indent);
    };
    line(0, format_args!("rosbag2_bagfile_information:"));
    line(1, format_args!("version: 5"));
    line(1, format_args!("storage_identifier: mcap"));
    line(1, format_args!("duration:"));
    line(2, format_args!("nanoseconds: {}", end - start));
    line(1, format_args!("starting_time:"));
    line(2, format_args!("nanoseconds_since_epoch: {start}"));
    line(1, format_args!("message_count: {}", counts.iter().sum::<usize>()));
    line(1, format_args!("topics_with_message_count:"));
    for (topic, count) in topics.iter().zip(&counts) {
        line(2, format_args!("- topic_metadata:"));
        line(4, format_args!("name: {}", topic.name));
        line(4, format_args!("type: {}", topic.kind.name));
        line(4, format_args!("serialization_format: cdr"));
        line(4, format_args!("offered_qos_profiles: \"{}\"", topic.quality().replace('\n', "\\n")));
        line(3, format_args!("message_count: {count}"));
    }
    line(1, format_args!("compression_format: \"\""));
    line(1, format_args!("compression_mode: \"\""));
    line(1, format_args!("relative_file_paths:"));
    for file in &files {
        line(2, format_args!("- {}", file_name(clip, file.block)));
    }
    line(1, format_args!("files:"));
    for file in &files {
        line(2, format_args!("- path: {}", file_name(clip, file.block)));
        line(3, format_args!("starting_time:"));
        line(4, format_args!("nanoseconds_since_epoch: {}", file.times[0]));
        line(3, format_args!("duration:"));
        line(4, format_args!("nanoseconds: {}", file.times[1] - file.times[0]));
        line(3, format_args!("message_count: {}", file.messages));
    }
    out
}
