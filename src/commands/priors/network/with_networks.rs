//! In a build with networks: Depth Anything.

use super::super::PriorsArgs;
use super::super::work::{Answer, Source};
use super::{NetworkArgs, SizeArg, VersionArg};
use crate::dataset::Dataset;
use crate::progress;
use anyhow::{Result, bail};
use std::path::PathBuf;
use wm_nets::DepthAnything;
use wm_nets::depth_anything::{Licence, PhotoError, Size, Version};
use wm_nets::weights::fetch::{self, Checksum};
use wm_train::maps::{Filter, Map};
use wm_train::priors::files::shrunk;
use wm_train::priors::fit::Freedom;
use wm_train::priors::given::{Given, GivenDepth, SkyBy};

/// A network with its weights.
struct Network {
    network: DepthAnything,
    /// Most pixels of a map.
    pixels: u32,
    name: String,
}

/// Gets and reads the weights. What is downloaded is said before.
pub fn open(args: &PriorsArgs) -> Result<Box<dyn Source>> {
    let given = &args.network;
    let version = match given.version {
        VersionArg::V1 => Version::V1,
        VersionArg::V2 => Version::V2,
    };
    let checksum: Option<Checksum> = given
        .checksum
        .as_deref()
        .map(str::parse)
        .transpose()
        .map_err(|error| anyhow::anyhow!("--checksum: {error}"))?;
    let files = match given.weights.is_empty() {
        true => vec![fetched(given, version, checksum)?],
        false => {
            check(given, checksum)?;
            given.weights.clone()
        }
    };
    let network = DepthAnything::read(&files, version)?;
    let found = network.size();
    if let Some(wanted) = given.network.map(size_of)
        && found != Some(wanted)
    {
        let found = found.map_or("of no published size", word);
        let file = files[0].display();
        bail!(
            "{file}: the network is {found}, not {}; leave out --model, or give other weights",
            word(wanted)
        );
    }
    let size = network.size().map_or("of another size", word);
    let files = files.iter().map(|file| file.display().to_string()).collect::<Vec<_>>().join(" and ");
    let name = format!("network: Depth Anything {version:?} {size}, {files}");
    Ok(Box::new(Network { network, pixels: args.map_pixels, name }))
}

fn size_of(model: SizeArg) -> Size {
    match model {
        SizeArg::Small => Size::Small,
        SizeArg::Base => Size::Base,
        SizeArg::Large => Size::Large,
    }
}

const fn word(size: Size) -> &'static str {
    match size {
        Size::Small => "small",
        Size::Base => "base",
        Size::Large => "large",
    }
}

/// Bytes of published weights, 4 each.
const fn bytes(size: Size) -> u64 {
    match size {
        Size::Small => 99_000_000,
        Size::Base => 390_000_000,
        Size::Large => 1_341_000_000,
    }
}

/// Compares the one file of weights with its checksum.
fn check(given: &NetworkArgs, checksum: Option<Checksum>) -> Result<()> {
    let Some(expected) = checksum else { return Ok(()) };
    let [file] = &given.weights[..] else {
        bail!("--checksum is that of one file, and --weights names {}; leave it out", given.weights.len());
    };
    let found = fetch::checksum_of(file)
        .map_err(|error| anyhow::anyhow!("{}: cannot be read: {error}", file.display()))?;
    if found != expected {
        bail!("{}: has SHA-256 {found}, not {expected}; get it again, or correct --checksum", file.display());
    }
    Ok(())
}

/// The file of published weights, from the cache or the network.
fn fetched(given: &NetworkArgs, version: Version, checksum: Option<Checksum>) -> Result<PathBuf> {
    let size = given.network.map_or(Size::Small, size_of);
    let mut source = DepthAnything::source(size, version);
    source.checksum = checksum;
    let Some(folder) = fetch::cache_folder() else {
        bail!(
            "there is no folder for weights, since no home is known; give --weights FILE, or set XDG_CACHE_HOME"
        );
    };
    let file = folder.join(&source.file_name);
    let is_there = file.is_file();
    if !is_there && given.offline {
        bail!(
            "{}: is not there, and --offline forbids to download it; get {} in another way and give it with --weights",
            file.display(),
            source.url
        );
    }
    if !is_there {
        let licence = DepthAnything::licence(size, version);
        let megabytes = bytes(size) as f64 * 1e-6;
        eprintln!(
            "weights: Depth Anything {version:?} {}, about {megabytes:.0} MB, {}",
            word(size),
            source.url
        );
        eprintln!("licence of the weights: {licence}");
        if licence == Licence::CcByNc4 {
            eprintln!(
                "licence of the weights: commercial use is forbidden, of what is made with them too perhaps"
            );
        }
        eprintln!("weights: they go to {}; Ctrl-C stops it", file.display());
    }
    let bar = progress::bar(bytes(size), "bytes");
    let found = fetch::fetch(&source, &folder, &mut |progress| {
        if let Some(total) = progress.total {
            bar.set_length(total);
        }
        bar.set_position(progress.done);
    });
    bar.finish_and_clear();
    Ok(found?)
}

impl Source for Network {
    fn name(&self) -> String {
        self.name.clone()
    }

    /// One: the network itself runs on all threads.
    fn at_once(&self) -> usize {
        1
    }

    fn look(&self, data: &Dataset, place: usize) -> Result<Answer> {
        let photo = data.photos.get(place, 0)?;
        let found = match self.network.predict(&photo.rgb_f32(), photo.width as usize) {
            Ok(found) => found,
            // Every photo would have that.
            Err(error @ PhotoError::NotFinite) => bail!("{}: {error}", data.name(place)),
            Err(error) => return Ok(Answer::Nothing(error.to_string())),
        };
        let map = Map::new(found.width as u32, found.height as u32, 1, found.values);
        let pixels = map.pixels().min(self.pixels as usize);
        // Whole patches have not quite the photo's shape; by much only where a network is small.
        let is_alike = map.check_shape(photo.width, photo.height).is_ok();
        let (width, height) = match is_alike && pixels == map.pixels() {
            true => (map.width, map.height),
            false => shrunk((photo.width, photo.height), pixels),
        };
        let values = map.resampled(width, height, Filter::Area).values;
        let depth = Some(GivenDepth { values, freedom: Freedom::ScaleShift, sky_by: SkyBy::Least });
        Ok(Answer::Given(Given { width, height, depth, ..Given::default() }))
    }
}
