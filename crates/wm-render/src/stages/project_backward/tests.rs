use crate::differentiable::{Channels, ForwardConfig, Opacity};
use crate::testing::{Backend, Hard, camera, gradient_errors, gradients_of, random_splats};
use wm_scene::{Rasterization, Splats};

crate::parity! {
    random_splats_learn_alike => |backend| {
        for sh_degree in 0..=3 {
            for rasterization in [Rasterization::Classic, Rasterization::Antialiased] {
                let channels = Channels::ColorDepthNormal;
                let config = ForwardConfig { channels, rasterization, sh_degree, ..ForwardConfig::default() };
                check(backend, "random", &random_splats(500, 3, 80), &config, 1e-5);
            }
        }
    };
    hard_splats_learn_alike => |backend| {
        for hard in Hard::ALL {
            for rasterization in [Rasterization::Classic, Rasterization::Antialiased] {
                let config = ForwardConfig {
                    channels: Channels::ColorDepthNormal,
                    background: [0.5; 3],
                    rasterization,
                    sh_degree: 1,
                    ..ForwardConfig::default()
                };
                let mut splats = hard.splats(250, 81);
                if hard == Hard::NearPlane {
                    // Most would be outside the picture.
                    splats.means.iter_mut().for_each(|m| (m[0], m[1]) = (0.05 * m[0], 0.05 * m[1]));
                }
                let loose = matches!(hard, Hard::Needle | Hard::NearPlane | Hard::Behind);
                check(backend, &format!("{hard:?}"), &splats, &config, if loose { 1e-3 } else { 1e-5 });
            }
        }
    };
    fixed_opacity_learns_alike => |backend| {
        let opacity = Opacity::Fixed(0.95);
        let config = ForwardConfig { channels: Channels::Depth, opacity, sh_degree: 0, ..ForwardConfig::default() };
        check(backend, "fixed", &random_splats(300, 0, 82), &config, 1e-5);
    };
}

fn check(backend: Backend, what: &str, splats: &Splats, config: &ForwardConfig, tolerance: f64) {
    let (got, want) = gradients_of(backend, splats, &camera(75, 53), config, 83);
    for (name, error) in gradient_errors(&got, &want) {
        let bound = if name == "weights" { 1e-3 } else { tolerance };
        let mode = config.rasterization;
        eprintln!("{what}, {mode:?}, degree {}: {name} {error:.1e}", config.sh_degree);
        assert!(error < bound, "{backend:?}, {what}, {mode:?}: {name} is off by {error:.1e}");
    }
}
