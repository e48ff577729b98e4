//! The layers that a frame is rendered with.
//!
//! A layer is one entry of `layers!` in `list.rs`: its variant, its constant, its name and its row,
//! which has the words of help, the channels, what is drawn for it, its form as a PNG and its
//! values in a finished picture. The passes of a frame follow from the set of layers that a request
//! asks for. A layer that is a picture of its own has its row beside the function that draws it.

#[macro_use]
mod list;
mod clear;
mod row;
mod set;
mod table;

pub(crate) use row::{LaterFrame, LayerForm, LayerSpan, Row, Source};
pub use set::{Layers, PictureLayer};
pub use table::LayerPasses;

#[cfg(test)]
mod tests {
    use super::*;
    use wm_render::parts::PicturePart;
    use wm_render::{Geometry, MedianDepth, ParticlePass};

    #[test]
    fn only_what_is_asked_for_is_rendered() {
        let passes = |names: &str| -> LayerPasses {
            let layers: Layers = names.split(',').map(|name| name.parse::<PictureLayer>().unwrap()).collect();
            LayerPasses::of(layers)
        };
        assert_eq!(passes("alpha").outputs.geometry, Geometry::None);
        assert_eq!(passes("depth,alpha").outputs.geometry, Geometry::Depth);
        assert_eq!(passes("normal,depth").outputs.geometry, Geometry::DepthNormal);
        assert_eq!(passes("median-depth").outputs.median_depth, MedianDepth::On);
        assert_eq!(passes("transmittance,alpha").outputs.particles, ParticlePass::Off);
        assert_eq!(passes("particles").outputs.particles, ParticlePass::On);
        assert_eq!(
            passes("depth,clean,transmittance").parts,
            [PicturePart::Transmittance, PicturePart::Clean]
        );
        let later = passes("surface-depth,flow-mask,label");
        assert!(!later.picture);
        assert_eq!(later.later, Layers::SURFACE_DEPTH | Layers::FLOW | Layers::LABEL);
        assert!(passes("rgb").picture && passes("water").picture);
    }

    #[test]
    fn sets_have_their_layers() {
        let set = Layers::COLOR | Layers::DEPTH;
        assert!(set.contains(Layers::DEPTH) && !set.contains(Layers::NORMAL));
        assert_eq!(set.iter().collect::<Vec<_>>(), [PictureLayer::Color, PictureLayer::Depth]);
        assert_eq!(set.without(Layers::COLOR), Layers::DEPTH);
        assert_eq!(Layers::default(), Layers::COLOR);
        assert!(PictureLayer::all().all(|layer| layer.name().parse() == Ok(layer)));
    }
}
