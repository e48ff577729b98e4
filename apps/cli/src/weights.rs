//! Weights of neural networks: files of the user, or published ones that are downloaded after
//! printing what they are.

use crate::choices::first_given;
use clap::Args;
use std::path::PathBuf;

/// Source of a network's weights.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Network")]
pub(crate) struct WeightsArgs {
    /// File of the network's weights (safetensors or PyTorch); repeat it for several files
    /// [default: download them once, after printing source and licence]
    #[arg(long, value_name = "FILE")]
    pub(crate) weights: Vec<PathBuf>,
    /// Expected SHA-256 of the file of weights
    #[arg(long, value_name = "SHA256")]
    pub(crate) checksum: Option<String>,
    /// Download nothing: the weights must be given or already downloaded
    #[arg(long)]
    offline: bool,
}

impl WeightsArgs {
    /// Returns the name of the first option that was given.
    pub(crate) fn given(&self) -> Option<&'static str> {
        first_given([
            (!self.weights.is_empty(), "--weights"),
            (self.checksum.is_some(), "--checksum"),
            (self.offline, "--offline"),
        ])
    }
}

#[cfg(feature = "nets")]
pub(crate) use with_networks::PublishedWeights;

#[cfg(feature = "nets")]
mod with_networks {
    use super::WeightsArgs;
    use crate::progress;
    use anyhow::{Result, anyhow, bail};
    use std::path::PathBuf;
    use wm_nets::weights::Licence;
    use wm_nets::weights::fetch::{self, Checksum, DownloadSource};

    /// A network whose weights are published.
    pub(crate) struct PublishedWeights {
        /// Name of the network.
        pub(crate) name: String,
        /// Approximate size of the file, bytes.
        pub(crate) bytes: u64,
        pub(crate) licence: Licence,
        pub(crate) source: DownloadSource,
    }

    impl WeightsArgs {
        /// Returns the files of weights: those that are given, or the published ones, cached or
        /// downloaded.
        pub(crate) fn files(&self, published: PublishedWeights) -> Result<Vec<PathBuf>> {
            let checksum: Option<Checksum> = self
                .checksum
                .as_deref()
                .map(str::parse)
                .transpose()
                .map_err(|error| anyhow!("--checksum: {error}"))?;
            if self.weights.is_empty() {
                let PublishedWeights { source, .. } = published;
                let published =
                    PublishedWeights { source: DownloadSource { checksum, ..source }, ..published };
                return Ok(vec![self.fetched(&published)?]);
            }
            self.check(checksum)?;
            Ok(self.weights.clone())
        }

        /// Checks the SHA-256 of the file of weights.
        fn check(&self, checksum: Option<Checksum>) -> Result<()> {
            let Some(expected) = checksum else { return Ok(()) };
            let [file] = &self.weights[..] else {
                bail!(
                    "--checksum is that of one file, and --weights names {}; leave it out",
                    self.weights.len()
                );
            };
            let found = fetch::checksum_of(file)
                .map_err(|error| anyhow!("{}: cannot be read: {error}", file.display()))?;
            if found != expected {
                bail!(
                    "{}: has SHA-256 {found}, not {expected}; get it again, or correct --checksum",
                    file.display()
                );
            }
            Ok(())
        }

        fn fetched(&self, published: &PublishedWeights) -> Result<PathBuf> {
            let PublishedWeights { name, bytes, licence, source } = published;
            let Some(folder) = fetch::cache_folder() else {
                bail!(
                    "there is no folder for weights, since no home is known; give --weights FILE, or set XDG_CACHE_HOME"
                );
            };
            let file = folder.join(&source.file_name);
            let is_there = file.is_file();
            if !is_there && self.offline {
                bail!(
                    "{}: is not there, and --offline forbids to download it; get {} in another way and give it with \
                     --weights",
                    file.display(),
                    source.url
                );
            }
            if !is_there {
                let megabytes = *bytes as f64 * 1e-6;
                eprintln!("weights: {name}, about {megabytes:.0} MB, {}", source.url);
                eprintln!("licence of the weights: {licence}");
                if *licence == Licence::CcByNc4 {
                    eprintln!(
                        "licence of the weights: commercial use is forbidden, of what is made with them too perhaps"
                    );
                }
                eprintln!("weights: they go to {}; Ctrl-C stops it", file.display());
            }
            let bar = progress::bar(*bytes, "bytes");
            let found = fetch::fetch(source, &folder, &mut |progress| {
                if let Some(total) = progress.total {
                    bar.set_length(total);
                }
                bar.set_position(progress.done);
            });
            bar.finish_and_clear();
            Ok(found?)
        }
    }
}
