//! LPIPS of the held-out photos, if weights are given.

use super::args::ReconstructArgs;
use anyhow::{Result, bail};
use weather_magician::train::session::PerceptualMetric;

/// Reads the weights; `None` if none are given.
pub(crate) fn read(args: &ReconstructArgs) -> Result<Option<Box<dyn PerceptualMetric>>> {
    if args.photos.lpips.is_empty() {
        return Ok(None);
    }
    if cfg!(feature = "nets") && args.photos.held_out.eval_every == 0 {
        bail!("--lpips measures held-out photos, and none are held out; give --eval-every too");
    }
    open(args).map(Some)
}

#[cfg(not(feature = "nets"))]
fn open(_: &ReconstructArgs) -> Result<Box<dyn PerceptualMetric>> {
    bail!("--lpips: this build has no neural networks; build it with `--features nets`, or leave --lpips out")
}

#[cfg(feature = "nets")]
fn open(args: &ReconstructArgs) -> Result<Box<dyn PerceptualMetric>> {
    let threads = args.run.threads.map_or(0, usize::from);
    let threads = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    Ok(Box::new(Lpips { network: wm_nets::Lpips::read(&args.photos.lpips)?, threads }))
}

/// The network and the threads that it runs on.
#[cfg(feature = "nets")]
struct Lpips {
    network: wm_nets::Lpips,
    threads: rayon::ThreadPool,
}

#[cfg(feature = "nets")]
impl PerceptualMetric for Lpips {
    fn smallest_side(&self) -> u32 {
        wm_nets::Lpips::MIN_SIDE_PX as u32
    }

    fn distance(&self, image: &[f32], photo: &[f32], mask: Option<&[f32]>, width: usize) -> f64 {
        self.threads.install(|| self.network.distance(image, photo, mask, width))
    }
}
