use crate::differentiable::{Channels, ForwardConfig};
use crate::testing::comparison::{gradient_errors, gradients_of};
use crate::testing::{Backend, camera, random_splats};
use wm_scene::Splats;

crate::parity! {
    every_picture_pulls_as_the_reference_says => |backend| {
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
        assert!(got.visible.is_sorted() && !got.visible.is_empty());
        for (name, error) in gradient_errors(&got, &want) {
            eprintln!("{backend:?} {:?} {width}x{height}: {name} {error:.1e}", config.channels);
            // Where the whole scene is three pixels wide, the rounding of the centres in px tells;
            // and weights count pixels that are not steady too.
            let bound = if width == 3 { 5e-4 } else { 1e-5 };
            let bound = if name == "weights" { 2e-4 } else { bound };
            assert!(error < bound, "{backend:?}, {config:?}, {width}x{height}: {name} is off by {error:.1e}");
        }
    }
}

/// By subgroups and without the same splats are pulled alike, but for the order in which threads
/// are added.
#[cfg(feature = "gpu")]
#[test]
fn subgroups_add_up_the_same() {
    use crate::gpu::{Gpu, GpuConfig, GpuDifferentiable, Subgroups};
    use crate::gradients::Learn;
    use crate::testing::{ANY_GPU, comparison::step};
    let Some(_) = Backend::gpu() else { return };
    let splats = random_splats(900, 1, 77);
    let camera = camera(75, 53);
    let config =
        ForwardConfig { channels: Channels::ColorDepthNormal, sh_degree: 1, ..ForwardConfig::default() };
    let [with, without] = [Subgroups::Used, Subgroups::Unused].map(|subgroups| {
        let gpu = Gpu::open(&GpuConfig { subgroups, ..ANY_GPU }).unwrap();
        if gpu.subgroups != subgroups {
            eprintln!("skipped: {} has no subgroups", gpu.describe());
        }
        let mut device = GpuDifferentiable::new(gpu, crate::CpuConfig::default()).unwrap();
        step(&mut device, &splats, &camera, &config, Learn::ALL, 9).unwrap().1
    });
    assert!(!with.visible.is_empty() && with.visible == without.visible);
    for (name, a, b) in [
        ("means", with.means.as_flattened(), without.means.as_flattened()),
        ("scales", with.log_scales.as_flattened(), without.log_scales.as_flattened()),
        ("opacities", &with.logit_opacities[..], &without.logit_opacities[..]),
        ("sh", &with.sh[..], &without.sh[..]),
        ("absgrads", with.absgrads.as_flattened(), without.absgrads.as_flattened()),
    ] {
        let square = |values: &mut dyn Iterator<Item = f32>| values.map(|v| f64::from(v * v)).sum::<f64>();
        let off = square(&mut a.iter().zip(b).map(|(a, b)| a - b)) / square(&mut b.iter().copied());
        assert!(off.sqrt() < 1e-5, "{name} differs by {:.1e}", off.sqrt());
    }
}
