use crate::differentiable::{Channels, ForwardConfig, Opacity};
use crate::even_air::EvenAir;
use crate::simd::SimdChoice;
use crate::testing::comparison::{HardSplats, gradient_errors, gradients_of};
use crate::testing::{Backend, camera, random_splats};
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
    splats_learn_alike_through_the_air => |backend| {
        let air = Some(EvenAir { extinction: 0.3, airlight: [0.5, 0.6, 0.7] });
        for sh_degree in [0, 2] {
            let config = ForwardConfig { sh_degree, air, ..ForwardConfig::default() };
            // Powers err by 1e-6 each, of which a slope has four.
            check(backend, "air", &random_splats(500, 3, 80), &config, 2e-5);
        }
    };
    hard_splats_learn_alike => |backend| {
        for hard in HardSplats::ALL {
            for rasterization in [Rasterization::Classic, Rasterization::Antialiased] {
                let config = ForwardConfig {
                    channels: Channels::ColorDepthNormal,
                    background: [0.5; 3],
                    rasterization,
                    sh_degree: 1,
                    ..ForwardConfig::default()
                };
                let mut splats = hard.splats(250, 81);
                if hard == HardSplats::NearPlane {
                    // Most would be outside the picture.
                    splats.means.iter_mut().for_each(|m| (m[0], m[1]) = (0.05 * m[0], 0.05 * m[1]));
                }
                let tolerance = match hard {
                    HardSplats::Needle | HardSplats::NearPlane | HardSplats::Behind => 1e-3,
                    // The centre's error, some ulp of up to 75 px, over a standard deviation of 0.5
                    // px.
                    HardSplats::Tiny => 3e-4,
                    _ => 1e-5,
                };
                check(backend, &format!("{hard:?}"), &splats, &config, tolerance);
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
        // Weights count pixels that are not steady too. What is no parameter's gradient may err
        // twice as much, and the portable path, which rounds products before sums, five times.
        let bound = match (name, backend) {
            ("weights", _) => 1e-3,
            (_, Backend::Cpu(path)) if path.choice() == SimdChoice::Portable => 5.0 * tolerance,
            ("means2d" | "absgrads", _) => 2.0 * tolerance,
            _ => tolerance,
        };
        let mode = config.rasterization;
        eprintln!("{backend:?} {what}, {mode:?}, degree {}: {name} {error:.1e}", config.sh_degree);
        assert!(error < bound, "{backend:?}, {what}, {mode:?}: {name} is off by {error:.1e}");
    }
}
