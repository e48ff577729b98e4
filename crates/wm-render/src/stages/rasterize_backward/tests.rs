use crate::differentiable::{Channels, ForwardConfig};
use crate::testing::{Backend, camera, gradient_errors, gradients_of, random_splats};
use wm_scene::Splats;

crate::parity! {
    every_picture_pulls_as_the_referee_says => |backend| {
        let channels =
            [Channels::Color, Channels::ColorDepth, Channels::ColorDepthNormal, Channels::Depth];
        for (i, channels) in channels.into_iter().enumerate() {
            let background = [0.3, 0.6, 0.1];
            let config = ForwardConfig { channels, background, sh_degree: 1, ..ForwardConfig::default() };
            check(backend, &random_splats(900, 1, 70 + i as u64), &config);
        }
    };
}

fn check(backend: Backend, splats: &Splats, config: &ForwardConfig) {
    // Sides that no tile, patch or block divides, and one narrower than a block.
    for (width, height) in [(75, 53), (34, 18), (3, 2)] {
        let (got, want) = gradients_of(backend, splats, &camera(width, height), config, 71);
        assert!(got.visible.is_sorted() && !got.is_empty());
        for (name, error) in gradient_errors(&got, &want) {
            eprintln!("{backend:?} {:?} {width}x{height}: {name} {error:.1e}", config.channels);
            // Where the whole scene is three pixels wide, the rounding of the centres in px tells; and
            // weights count pixels that are not steady too.
            let bound = if width == 3 { 5e-4 } else { 1e-5 };
            let bound = if name == "weights" { 2e-4 } else { bound };
            assert!(error < bound, "{backend:?}, {config:?}, {width}x{height}: {name} is off by {error:.1e}");
        }
    }
}
