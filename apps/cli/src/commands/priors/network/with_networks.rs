//! Builds with networks: Depth Anything.

use super::super::source::{PriorAnswer, PriorEstimator};
use super::args::{NetworkArgs, SizeArg, VersionArg};
use crate::dataset::Dataset;
use crate::weights::PublishedWeights;
use anyhow::{Result, bail};
use weather_magician::train::priors::files::size_within;
use weather_magician::train::priors::fit::Freedom;
use weather_magician::train::priors::given::{Given, GivenDepth, SkyBy};
use weather_magician::wm_image::maps::{Filter, Map};
use wm_nets::DepthAnything;
use wm_nets::depth_anything::{DisparityError, ModelSize, Version};

/// A network with its weights.
struct Network {
    network: DepthAnything,
    /// Maximum number of pixels of a map.
    pixels: u32,
    name: String,
}

/// Reads the weights, after downloading them if necessary. Prints what is downloaded. Maps will
/// have at most `map_pixels` pixels.
pub(crate) fn open(args: &NetworkArgs, map_pixels: u32) -> Result<Box<dyn PriorEstimator>> {
    let version = match args.version {
        VersionArg::V1 => Version::V1,
        VersionArg::V2 => Version::V2,
    };
    let size = args.network.map_or(ModelSize::Small, size_of);
    let files = args.weights.files(PublishedWeights {
        name: format!("Depth Anything {version:?} {}", word(size)),
        bytes: bytes(size),
        licence: DepthAnything::licence(size, version),
        source: DepthAnything::source(size, version),
    })?;
    let network = DepthAnything::read(&files, version)?;
    let found = network.size();
    if let Some(wanted) = args.network.map(size_of)
        && found != Some(wanted)
    {
        let found = found.map_or("of no published size", word);
        let file = files[0].display();
        bail!(
            "{file}: the network is {found}, not {}; leave out --network, or give other weights",
            word(wanted)
        );
    }
    let size = network.size().map_or("of another size", word);
    let files = files.iter().map(|file| file.display().to_string()).collect::<Vec<_>>().join(" and ");
    let name = format!("network: Depth Anything {version:?} {size}, {files}");
    Ok(Box::new(Network { network, pixels: map_pixels, name }))
}

fn size_of(model: SizeArg) -> ModelSize {
    match model {
        SizeArg::Small => ModelSize::Small,
        SizeArg::Base => ModelSize::Base,
        SizeArg::Large => ModelSize::Large,
    }
}

const fn word(size: ModelSize) -> &'static str {
    match size {
        ModelSize::Small => "small",
        ModelSize::Base => "base",
        ModelSize::Large => "large",
    }
}

/// Sizes of published weights, bytes.
const fn bytes(size: ModelSize) -> u64 {
    match size {
        ModelSize::Small => 99_000_000,
        ModelSize::Base => 390_000_000,
        ModelSize::Large => 1_341_000_000,
    }
}

impl PriorEstimator for Network {
    fn name(&self) -> String {
        self.name.clone()
    }

    /// One: the network itself runs on all threads.
    fn batch_size(&self) -> usize {
        1
    }

    fn estimate(&self, data: &Dataset, place: usize) -> Result<PriorAnswer> {
        let photo = data.photos.get(place, 0)?;
        let found = match self.network.predict(&photo.rgb_f32(), photo.width as usize) {
            Ok(found) => found,
            // Every photo would have that.
            Err(error @ DisparityError::NotFinite) => bail!("{}: {error}", data.name(place)),
            Err(error) => return Ok(PriorAnswer::Nothing(error.to_string())),
        };
        let map = Map::new(found.width as u32, found.height as u32, 1, found.values);
        let pixels = map.pixels().min(self.pixels as usize);
        // Whole patches have not quite the photo's shape; by much only where a network is small.
        let is_alike = map.check_shape(photo.width, photo.height).is_ok();
        let (width, height) = match is_alike && pixels == map.pixels() {
            true => (map.width, map.height),
            false => size_within(photo.width, photo.height, pixels),
        };
        let values = map.resampled(width, height, Filter::Area).values;
        let depth = Some(GivenDepth { values, freedom: Freedom::ScaleShift, sky_by: SkyBy::Least });
        Ok(PriorAnswer::Given(Given { width, height, depth, ..Given::default() }))
    }
}
