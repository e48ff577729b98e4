use super::*;
use crate::differentiable::{Channels, Drawn, Opacity};
use crate::simd::SimdChoice;
use crate::testing::{RandomLoss, camera, random_splats};
use wm_scene::Rasterization;

const CONFIG: ForwardConfig = ForwardConfig {
    channels: Channels::ColorDepthNormal,
    background: [0.2, 0.4, 0.6],
    rasterization: Rasterization::Antialiased,
    opacity: Opacity::Stored,
    drawn: Drawn::All,
    sh_degree: 2,
};

fn renderer(threads: usize) -> CpuDifferentiable {
    CpuDifferentiable::new(CpuConfig { threads: Some(threads), simd: SimdChoice::Auto }).unwrap()
}

fn step(
    renderer: &mut CpuDifferentiable,
    splats: &Splats,
    config: &ForwardConfig,
    learn: Learn,
) -> (Frame, Gradients) {
    let (mut frame, mut gradients) = (Frame::default(), Gradients::default());
    renderer.forward(splats, &camera(333, 217), config, &mut frame).unwrap();
    let loss = RandomLoss::new(config.channels, frame.pixels(), 5, |_| true);
    renderer.backward(splats, &loss.upstream(), learn, &mut gradients).unwrap();
    (frame, gradients)
}

#[test]
fn bytes_are_the_same_for_any_number_of_threads() {
    let splats = random_splats(20_000, 2, 90);
    let one = step(&mut renderer(1), &splats, &CONFIG, Learn::ALL);
    assert!(one.1.len() > 5000 && one.1.means.iter().flatten().any(|v| *v != 0.0));
    for threads in [2, 7] {
        assert!(step(&mut renderer(threads), &splats, &CONFIG, Learn::ALL) == one, "{threads} threads");
    }
}
