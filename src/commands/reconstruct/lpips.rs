//! LPIPS of the held-out photos, where weights are given. Everything that may be wrong with them is said
//! before the training.

#[cfg(feature = "nets")]
pub use with_networks::Lpips;
#[cfg(not(feature = "nets"))]
pub use without_networks::Lpips;

#[cfg(feature = "nets")]
mod with_networks {
    use super::super::{ReconstructArgs, data::Data};
    use anyhow::{Result, bail};

    /// Measures how alike pictures look.
    pub struct Lpips {
        network: wm_nets::Lpips,
        threads: rayon::ThreadPool,
    }

    impl Lpips {
        /// Reads the weights; `None` if none are given.
        pub fn read(args: &ReconstructArgs) -> Result<Option<Self>> {
            let files = &args.photos.lpips;
            if files.is_empty() {
                return Ok(None);
            }
            if args.photos.eval_every == 0 {
                bail!("--lpips measures held-out photos, and none are held out; give --eval-every too");
            }
            let threads = args.run.threads.map_or(0, usize::from);
            let threads = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
            Ok(Some(Self { network: wm_nets::Lpips::read(files)?, threads }))
        }

        /// Refuses held-out photos that are too small.
        pub fn check(&self, data: &Data) -> Result<()> {
            const LEAST: u32 = wm_nets::Lpips::SMALLEST as u32;
            for place in &data.held_out {
                let camera = data.photos.camera(*place, 0);
                if camera.width.min(camera.height) < LEAST {
                    bail!(
                        "{}: {}x{} px is too small for --lpips, which needs {LEAST} on each side; raise --longest, \
                         hold out other photos, or leave --lpips out",
                        data.name(*place),
                        camera.width,
                        camera.height
                    );
                }
            }
            Ok(())
        }

        /// The distance of two pictures, `[H, W, 3]`, 0-1. Where a mask, `[H, W]`, leaves the photo out it
        /// stands in both.
        pub fn distance(&self, shown: &[f32], photo: &[f32], mask: Option<&[f32]>, width: usize) -> f64 {
            self.threads.install(|| self.network.distance(shown, photo, mask, width))
        }
    }
}

#[cfg(not(feature = "nets"))]
mod without_networks {
    use super::super::{ReconstructArgs, data::Data};
    use anyhow::{Result, bail};

    /// There is none.
    pub enum Lpips {}

    impl Lpips {
        pub fn read(args: &ReconstructArgs) -> Result<Option<Self>> {
            if args.photos.lpips.is_empty() {
                return Ok(None);
            }
            bail!(
                "--lpips: this build has no neural networks; build it with `--features nets`, or leave --lpips out"
            )
        }

        pub fn check(&self, _: &Data) -> Result<()> {
            match *self {}
        }

        pub fn distance(&self, _: &[f32], _: &[f32], _: Option<&[f32]>, _: usize) -> f64 {
            match *self {}
        }
    }
}
