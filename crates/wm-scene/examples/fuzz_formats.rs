//! Damages small files of every scene format, again and again, and reads them: each gives a scene or one line of error, without a panic
//! and in bounded memory.
//!
//! `cargo run --release -p wm-scene --example fuzz_formats -- [RUNS] [FORMAT]`, 10,000 runs a format unless said
//! otherwise. A run changes one to eight bytes, cuts the file or moves a part of it; run n of a format is the same every time. Of a
//! gzip every other run damages what is in it; the pictures of a SOG are damaged in a folder too, where no checksum guards them.

use sirocco::{Format, deflate, inflate};
use std::{
    fs,
    io::Read,
    panic::catch_unwind,
    path::{Path, PathBuf},
    time::Instant,
};
use wm_scene::{
    Scene,
    formats::{FORMATS, GltfSplats, SpzVersion, WriteOptions, read_scene, read_scene_from, write_scene_with},
    random::uniform,
    synthetic::rippled,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let runs: u64 = arguments.first().map_or(Ok(10_000), |text| text.parse())?;
    let only = arguments.get(1);
    // Panics are counted, and told by their run.
    std::panic::set_hook(Box::new(|_| ()));
    let folder = tempfile::tempdir()?;
    let mut panics = 0;
    let four = WriteOptions { spz: SpzVersion::V4, ..Default::default() };
    let packed = WriteOptions { gltf: GltfSplats::Spz, ..Default::default() };
    let files = FORMATS.iter().filter_map(|f| Some((f.extensions.first()?, WriteOptions::default())));
    let files: Vec<_> = files.chain([(&"spz", four), (&"glb", packed)]).collect();
    for (ending, options) in files {
        if only.is_some_and(|only| only != ending) {
            continue;
        }
        let name = if ending.contains(".json") { (*ending).to_owned() } else { format!("a.{ending}") };
        let path = folder.path().join(&name);
        write_scene_with(&path, &Scene { splats: rippled(12, 1), ..Scene::default() }, &options)?;
        let start = Instant::now();
        let (found, read) =
            if ending.contains(".json") { fuzz_folder(&path, runs)? } else { fuzz_file(&path, runs)? };
        panics += found;
        println!(
            "{name} {options:?}: {runs} runs in {:.0?}, {read} still read, {found} panics",
            start.elapsed()
        );
    }
    println!("most memory: {}", most_memory());
    if panics > 0 { Err(format!("{panics} panics").into()) } else { Ok(()) }
}

/// Damages a file in memory; gives panics and files that were still read.
fn fuzz_file(path: &Path, runs: u64) -> Result<(u64, u64), Box<dyn std::error::Error>> {
    let bytes = fs::read(path)?;
    let (mut panics, mut read) = (0, 0);
    for run in 0..runs {
        let damaged = if bytes.starts_with(&[0x1f, 0x8b]) && run % 2 == 0 {
            repacked(&bytes, |inside| damage(inside, run))?
        } else {
            damage(&bytes, run)
        };
        match catch_unwind(|| read_scene_from(path, &damaged[..], Some(damaged.len() as u64)).is_ok()) {
            Ok(was_read) => read += u64::from(was_read),
            Err(_) => {
                println!("  run {run} panics");
                panics += 1;
            }
        }
    }
    Ok((panics, read))
}

/// A gzip with other content.
fn repacked(gzip: &[u8], change: impl FnOnce(&[u8]) -> Vec<u8>) -> std::io::Result<Vec<u8>> {
    let mut inside = Vec::new();
    inflate::Reader::new(Format::Gzip, gzip).read_to_end(&mut inside)?;
    Ok(sirocco::compress(Format::Gzip, deflate::Level::FASTEST, &change(&inside)))
}

/// Damages one file of a folder a run.
fn fuzz_folder(main: &Path, runs: u64) -> Result<(u64, u64), Box<dyn std::error::Error>> {
    let folder = main.parent().ok_or("no folder")?;
    let json = |path: &PathBuf| path.extension().is_some_and(|e| e == "webp" || e == "json");
    let mut files: Vec<PathBuf> =
        fs::read_dir(folder)?.map(|e| Ok(e?.path())).collect::<std::io::Result<_>>()?;
    files.retain(json);
    files.sort();
    let (mut panics, mut read) = (0, 0);
    for run in 0..runs {
        let file = &files[run as usize % files.len()];
        let bytes = fs::read(file)?;
        fs::write(file, damage(&bytes, run))?;
        match catch_unwind(|| read_scene(main, &Default::default()).is_ok()) {
            Ok(was_read) => read += u64::from(was_read),
            Err(_) => {
                println!("  run {run} panics");
                panics += 1;
            }
        }
        fs::write(file, bytes)?;
    }
    Ok((panics, read))
}

/// A copy of `bytes` with something wrong, the same for the same run.
fn damage(bytes: &[u8], run: u64) -> Vec<u8> {
    let mut drawn = 0;
    let mut next = |most: usize| {
        drawn += 1;
        (uniform(run, drawn) * most as f64) as usize % most.max(1)
    };
    let mut damaged = bytes.to_vec();
    match next(8) {
        0 => damaged.truncate(next(bytes.len())),
        1 => {
            let (from, to, length) = (next(bytes.len()), next(bytes.len()), next(64));
            let part = bytes[from..(from + length).min(bytes.len())].to_vec();
            damaged.splice(to..to, part);
        }
        _ => {
            for _ in 0..=next(8) {
                let at = next(bytes.len());
                // Headers are where the harm is done.
                let at = if next(2) == 0 { at % 64.min(bytes.len()) } else { at };
                damaged[at] = match next(4) {
                    0 => 0xff,
                    1 => 0,
                    _ => next(256) as u8,
                };
            }
        }
    }
    damaged
}

/// Peak of resident memory, where the system says it.
fn most_memory() -> String {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.map_or("not known".into(), |text| text.trim().to_owned())
}
