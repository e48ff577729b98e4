//! From a normalised photo to disparity: DINOv2's blocks, four of whose outputs the head puts
//! together (DPT).

use super::model::PATCH;
use crate::ops::{Activation, Convolution, Enlarge, Image, Linear, Norm};
use crate::transformer::{Block, Embedding};

/// All weights.
#[derive(Debug)]
pub(crate) struct Network {
    pub(crate) backbone: Backbone,
    pub(crate) head: Head,
}

/// The vision transformer.
#[derive(Debug)]
pub(crate) struct Backbone {
    pub(crate) embedding: Embedding,
    pub(crate) blocks: Vec<Block>,
    pub(crate) norm: Norm,
    pub(crate) heads: usize,
    /// After how many blocks the head takes the features.
    pub(crate) taps: [usize; 4],
}

/// The head that makes disparity of features.
#[derive(Debug)]
pub(crate) struct Head {
    /// 1x1 px, of each tap.
    pub(crate) project: [Linear; 4],
    /// Taps to 4, 2, 1 and 1/2 px a patch.
    pub(crate) enlarge: [Enlarge; 2],
    pub(crate) shrink: Convolution,
    pub(crate) reduce: [Convolution; 4],
    /// From the smallest image to the largest.
    pub(crate) fusions: [Fusion; 4],
    pub(crate) last: [Convolution; 2],
    /// Makes one number per pixel.
    pub(crate) depth: Linear,
}

/// Adds a tap's image to what comes from the smaller ones.
#[derive(Debug)]
pub(crate) struct Fusion {
    /// For the image that is added; the smallest has none.
    pub(crate) added: Option<ResidualUnit>,
    pub(crate) sum: ResidualUnit,
    pub(crate) project: Linear,
}

/// Two convolutions that are added to what they are made from.
#[derive(Debug)]
pub(crate) struct ResidualUnit(pub [Convolution; 2]);

impl Network {
    /// Disparity of a normalised photo of whole patches, one channel at its size.
    pub(crate) fn disparity(&self, photo: &Image) -> Image {
        let (columns, rows) = (photo.width / PATCH, photo.height / PATCH);
        self.head.disparity(self.backbone.features(photo, columns, rows))
    }
}

impl Backbone {
    /// Returns the features of the patches after each tapped block.
    fn features(&self, photo: &Image, columns: usize, rows: usize) -> [Image; 4] {
        let mut x = self.embedding.apply(photo);
        let channels = self.embedding.class.len();
        let mut features = Vec::new();
        for (index, block) in self.blocks.iter().enumerate() {
            block.apply(&mut x, self.heads);
            if self.taps.contains(&(index + 1)) {
                let mut values = self.norm.apply(&x);
                values.drain(..channels);
                features.push(Image { values, width: columns, height: rows, channels });
            }
        }
        features.try_into().expect("four taps, each within the blocks")
    }
}

impl Head {
    fn disparity(&self, features: [Image; 4]) -> Image {
        let (width, height) = (features[0].width * PATCH, features[0].height * PATCH);
        let [a, b, c, d] = &self.project;
        let [first, second, third, fourth] = features;
        let images = [
            self.enlarge[0].apply(a.over(first)),
            self.enlarge[1].apply(b.over(second)),
            c.over(third),
            self.shrink.apply(&d.over(fourth), Activation::Nothing),
        ];
        let levels: [Image; 4] =
            std::array::from_fn(|index| self.reduce[index].apply(&images[index], Activation::Nothing));
        let mut fused = None;
        for (index, fusion) in (0..4).rev().zip(&self.fusions) {
            // As large as the next one, the last twice as large as it is.
            let (width, height) = match index {
                0 => (2 * levels[0].width, 2 * levels[0].height),
                _ => (levels[index - 1].width, levels[index - 1].height),
            };
            let image = fusion.apply(fused.take(), &levels[index]);
            fused = Some(image.bilinear(width, height));
        }
        let image = self.last[0].apply(&fused.expect("four levels"), Activation::Nothing);
        let image = self.last[1].apply(&image.bilinear(width, height), Activation::Relu);
        self.depth.over(image).relu()
    }
}

impl Fusion {
    /// `smaller` was made as large as `image`. What comes out is to be resized: the order of this
    /// and of the product does not matter but for the work, since the weights of a resized pixel
    /// add up to 1.
    fn apply(&self, smaller: Option<Image>, image: &Image) -> Image {
        let sum = match (smaller, &self.added) {
            (Some(mut smaller), Some(added)) => {
                smaller.add(&added.apply(image));
                smaller
            }
            _ => image.clone(),
        };
        self.project.over(self.sum.apply(&sum))
    }
}

impl ResidualUnit {
    fn apply(&self, image: &Image) -> Image {
        let inner = self.0[0].apply(&image.relu(), Activation::Relu);
        let mut sum = self.0[1].apply(&inner, Activation::Nothing);
        sum.add(image);
        sum
    }
}
