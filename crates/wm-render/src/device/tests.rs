use super::*;

#[test]
fn devices_are_read_as_they_are_written() {
    for text in ["auto", "cpu", "gpu", "gpu:NVIDIA GeForce"] {
        assert_eq!(text.parse::<Device>().unwrap().to_string(), text);
    }
    for text in ["", "GPU", "gpu:", "gpu: ", "tpu"] {
        let error = text.parse::<Device>().unwrap_err();
        assert!(error.starts_with(&format!("`{text}` is no device")), "{error}");
    }
}

#[cfg(feature = "gpu")]
mod with_gpu {
    use super::*;
    use crate::config::RenderConfig;
    use crate::hooks::Hooks;
    use crate::plan::{DrawPass, SetView};
    use crate::testing::comparison::{HeavyAir, drawn, step};
    use crate::testing::{
        Backend, RandomLoss, camera, fallible_differentiable, gpu_renderer, random_splats, threads,
    };
    use std::sync::atomic::{AtomicU32, Ordering};

    /// As `auto` makes it where there is a GPU; counts the warnings.
    fn fallible(warn: fn(&RenderError)) -> AnyRenderer {
        let config = threads(2);
        let body = Body::Gpu { gpu: Box::new(gpu_renderer()), kept: Some(Vec::new()) };
        AnyRenderer { config, path: SimdPath::select(config.simd).unwrap(), body, warn: Box::new(warn) }
    }

    #[test]
    fn what_the_gpu_cannot_the_cpu_draws_with_one_warning() {
        static WARNINGS: AtomicU32 = AtomicU32::new(0);
        let Some(_) = Backend::gpu() else { return };
        let mut renderer = fallible(|_| {
            WARNINGS.fetch_add(1, Ordering::Relaxed);
        });
        let sets = [1, 2, 3].map(|seed| renderer.load(&random_splats(200, 1, seed)).unwrap());
        renderer.unload(sets[1]);
        let (camera, config) = (camera(64, 48), RenderConfig::default());
        let views = [SetView::plain(sets[0]), SetView::plain(sets[2])];
        let plain = DrawPass::new(&views, &camera, &config);
        let air = plain.clone().with_hooks(Hooks { medium: Some(&HeavyAir), ..Hooks::default() });
        let before = drawn(&mut renderer, &plain);
        assert!(renderer.is_gpu());
        let through = drawn(&mut renderer, &air);
        assert!(!renderer.is_gpu() && WARNINGS.load(Ordering::Relaxed) == 1);
        // Every splat is grey through that air, and so is the background.
        assert!(through.rgb.iter().all(|v| (v - 0.25).abs() < 1e-3));
        let after = drawn(&mut renderer, &plain);
        let most = before.rgb.iter().zip(&after.rgb).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(most < 1e-2 && most > 0.0, "{most}");
        // The name of the set that is gone is free.
        assert_eq!(renderer.load(&Splats::default()).unwrap(), sets[1]);
        assert_eq!(WARNINGS.load(Ordering::Relaxed), 1);
    }

    /// A GPU that is lost between the passes of a step, and one that is lost before.
    #[test]
    fn what_a_lost_gpu_leaves_the_cpu_derives_with_one_warning() {
        static WARNINGS: AtomicU32 = AtomicU32::new(0);
        let Some(_) = Backend::gpu() else { return };
        let (splats, camera) = (random_splats(300, 1, 4), camera(64, 48));
        let config = ForwardConfig { sh_degree: 1, ..ForwardConfig::default() };
        let loss = RandomLoss::new(config.channels, 64 * 48, 5, |_| true);
        let mut cpu = CpuDifferentiable::new(threads(2)).unwrap();
        let (_, want) = step(&mut cpu, &splats, &camera, &config, Learn::ALL, 5).unwrap();
        for (place, lost_before) in [true, false].into_iter().enumerate() {
            let (mut any, gpu) = fallible_differentiable(|_| {
                WARNINGS.fetch_add(1, Ordering::Relaxed);
            });
            if lost_before {
                gpu.lose();
            }
            any.forward(&splats, &camera, &config, &mut Frame::default()).unwrap();
            gpu.lose();
            let mut gradients = Gradients::default();
            any.backward(&splats, &loss.upstream(), Learn::ALL, &mut gradients).unwrap();
            assert!(gradients == want);
            assert_eq!(WARNINGS.load(Ordering::Relaxed) as usize, place + 1);
            assert!(any.describe().starts_with("cpu, "));
        }
    }
}
