//! Measures time and memory of a network: `depth_anything` or `clip`, the file of its weights, then
//! sizes of images such as 518x700. Threads are those of `RAYON_NUM_THREADS`. Depth Anything's
//! weights are of V2.

use std::process::ExitCode;
use std::time::Instant;
use wm_nets::depth_anything::Version;
use wm_nets::{Clip, DepthAnything};

/// Runs on a picture, 8 bit, of a width, and says what came out.
type Network = Box<dyn Fn(&[u8], usize) -> Result<String, String>>;

fn open(network: &str, file: &str) -> Result<Network, String> {
    let files = [file.into()];
    match network {
        "depth_anything" => {
            let network = DepthAnything::read(&files, Version::V2).map_err(|error| error.to_string())?;
            Ok(Box::new(move |levels, width| {
                let rgb: Vec<f32> = levels.iter().map(|level| f32::from(*level) / 255.0).collect();
                let found = network.predict(&rgb, width).map_err(|error| error.to_string())?;
                Ok(format!("{}x{}", found.width, found.height))
            }))
        }
        "clip" => {
            let network = Clip::read(&files).map_err(|error| error.to_string())?;
            Ok(Box::new(move |levels, width| {
                let found = network.embed(levels, width).map_err(|error| error.to_string())?;
                Ok(format!("{} numbers, {:?}...", found.len(), &found[..3.min(found.len())]))
            }))
        }
        other => Err(format!("{other}: give depth_anything or clip")),
    }
}

fn run(args: &[String]) -> Result<(), String> {
    let [network, file, sizes @ ..] = args else {
        return Err(
            "give depth_anything or clip, a file of weights, and sizes of pictures such as 518x700".into()
        );
    };
    let start = Instant::now();
    let network = open(network, file)?;
    println!("loaded in {:.2} s, {}", start.elapsed().as_secs_f64(), memory());
    for size in sizes {
        let sides = size.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
        let (width, height): (usize, usize) =
            sides.ok_or_else(|| format!("{size}: give a size as 518x700"))?;
        let levels: Vec<u8> = (0..3 * width * height).map(|i| (i * 7919 % 251) as u8).collect();
        let start = Instant::now();
        let found = network(&levels, width)?;
        println!("{size}: {:.2} s to {found}, {}", start.elapsed().as_secs_f64(), memory());
    }
    Ok(())
}

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    match run(&args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

/// The most memory that was held so far, where the system tells.
fn memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<f64>().ok());
    kib.map_or("memory unknown".into(), |kib| format!("at most {:.0} MB held", kib * 1.024e-3))
}
