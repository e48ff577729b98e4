//! How long Depth Anything takes, and how much memory: weights' file, version (v1, v2), then sizes such as 518x700.
//! Threads are those of `RAYON_NUM_THREADS`.

use std::process::ExitCode;
use std::time::Instant;
use wm_nets::DepthAnything;
use wm_nets::depth_anything::Version;

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [file, version, sizes @ ..] = &args[..] else {
        eprintln!("give a file of weights, v1 or v2, and sizes of photos such as 518x700");
        return ExitCode::FAILURE;
    };
    let version = if version == "v1" { Version::V1 } else { Version::V2 };
    let start = Instant::now();
    let network = match DepthAnything::read(&[file.into()], version) {
        Ok(network) => network,
        Err(error) => {
            eprintln!("{error}");
            return ExitCode::FAILURE;
        }
    };
    println!("{:?}: loaded in {:.2} s, {}", network.size(), start.elapsed().as_secs_f64(), memory());
    for size in sizes {
        let Some((Ok(width), Ok(height))) =
            size.split_once('x').map(|(w, h)| (w.parse::<usize>(), h.parse::<usize>()))
        else {
            eprintln!("{size}: give a size as 518x700");
            return ExitCode::FAILURE;
        };
        let rgb: Vec<f32> = (0..3 * width * height).map(|i| (i * 7919 % 1009) as f32 / 1008.0).collect();
        let start = Instant::now();
        match network.predict(&rgb, width) {
            Ok(disparity) => println!(
                "{size}: {:.2} s to {}x{}, {}",
                start.elapsed().as_secs_f64(),
                disparity.width,
                disparity.height,
                memory()
            ),
            Err(error) => println!("{size}: {error}"),
        }
    }
    ExitCode::SUCCESS
}

/// The most memory that was held so far, where the system tells.
fn memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<f64>().ok());
    kib.map_or("memory unknown".into(), |kib| format!("at most {:.0} MB held", kib * 1.024e-3))
}
