use super::*;
use crate::testing::comparison::{ALL_OUTPUTS, drawn};
use crate::testing::{Backend, camera, random_splats};

crate::parity! {
    passes_of_a_plan_are_those_of_renders => separate_renders;
    transient_splats_are_drawn_like_loaded_ones => transient;
    effects_see_whole_pictures => effects;
}

fn config() -> RenderConfig {
    RenderConfig { outputs: ALL_OUTPUTS, ..RenderConfig::default() }
}

/// Sizes differ, so that what one pass leaves in the memory of another would show.
fn separate_renders(backend: Backend) {
    let mut renderer = backend.renderer();
    let sets = [(300, 1), (2000, 2), (50, 3)]
        .map(|(count, seed)| renderer.load(&random_splats(count, 1, seed)).unwrap());
    let passes = [(75, 53), (130, 90), (33, 17)].map(|(width, height)| camera(width, height));
    let passes: Vec<DrawPass<'_>> = passes
        .iter()
        .zip(sets)
        .map(|(camera, set)| DrawPass::new(&[SetView::plain(set)], camera, &config()))
        .collect();
    let want: Vec<Frame> = passes.iter().map(|pass| drawn(&mut *renderer, pass)).collect();
    let mut plan = FramePlan::new();
    let ids: Vec<PictureId> = passes.iter().map(|pass| plan.draw(pass.clone())).collect();
    // The last of several passes into one picture stays.
    plan.draw_into(ids[0], passes[2].clone());
    let mut pictures = Pictures::default();
    for _ in 0..2 {
        let stats = renderer.execute(&plan, &mut pictures).unwrap();
        assert!(stats.visible > 0);
        assert!(pictures[ids[0]] == want[2] && pictures[ids[1]] == want[1] && pictures[ids[2]] == want[2]);
    }
}

fn transient(backend: Backend) {
    let mut renderer = backend.renderer();
    let (splats, camera) = (random_splats(500, 2, 4), camera(75, 53));
    let set = renderer.load(&splats).unwrap();
    let want = drawn(&mut *renderer, &DrawPass::new(&[SetView::plain(set)], &camera, &config()));
    renderer.unload(set);
    let got = drawn(&mut *renderer, &DrawPass::new(&[SetView::transient(&splats)], &camera, &config()));
    assert!(got == want);
    // It is gone afterwards: its name is free.
    assert_eq!(renderer.load(&splats).unwrap(), set);
}

/// Adds the coverage of the inputs to red.
struct Overlay;

impl PictureEffect for Overlay {
    fn apply(&self, _: SimdPath, picture: &mut Frame, inputs: &[&Frame]) {
        let Frame { rgb, .. } = picture;
        for input in inputs {
            assert!(input.depth.len() == input.pixels() && input.normal.len() == 3 * input.pixels());
            rgb.iter_mut().step_by(3).zip(&input.alpha).for_each(|(red, cover)| *red += cover);
        }
    }
}

fn effects(backend: Backend) {
    let mut renderer = backend.renderer();
    let (camera, config) = (camera(75, 53), config());
    let [first, second] = [4, 5].map(|seed| random_splats(400, 1, seed));
    let [a, b] =
        [&first, &second].map(|splats| DrawPass::new(&[SetView::transient(splats)], &camera, &config));
    let mut want = drawn(&mut *renderer, &a);
    let (scene, noise) = (want.clone(), drawn(&mut *renderer, &b));
    Overlay.apply(SimdPath::available()[0], &mut want, &[&noise]);
    Overlay.apply(SimdPath::available()[0], &mut want, &[&scene]);
    let mut plan = FramePlan::new();
    let picture = plan.draw(a.clone());
    let other = plan.draw(b);
    plan.apply(&Overlay, picture, &[other]);
    // The picture of the second pass is drawn over once it was read.
    plan.draw_into(other, a);
    plan.apply(&Overlay, picture, &[other]);
    let mut pictures = Pictures::default();
    renderer.execute(&plan, &mut pictures).unwrap();
    assert!(pictures[picture] == want && pictures[other] == scene);
}

#[test]
#[should_panic(expected = "picture 1 is not of this plan, which has 1")]
fn a_picture_of_another_plan_is_refused() {
    let (camera, config) = (camera(8, 8), config());
    let pass = DrawPass::new(&[], &camera, &config);
    let (mut one, mut other) = (FramePlan::new(), FramePlan::new());
    one.draw(pass.clone());
    let foreign = one.draw(pass.clone());
    other.draw(pass.clone());
    other.draw_into(foreign, pass);
}
