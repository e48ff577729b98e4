use crate::attributes::{Attribute, AttributeBlock, SplatAttributes};
use crate::config::{Background, RenderConfig};
use crate::plan::{BlendSurface, CutPlane, DrawPass, SetView};
use crate::reference;
use crate::testing::comparison::{ALL_OUTPUTS, HardSplats, compare, drawn, rendered};
use crate::testing::{Backend, camera, random_splats, threads};
use crate::{
    Channels, CpuConfig, CpuDifferentiable, CpuRenderer, Differentiable, FRONT_CHANNELS, ForwardConfig,
    Frame, Geometry, Gradients, Learn, MedianDepth, Outputs, RenderBackend, Upstream,
};
use wm_scene::{Camera, Rasterization, Splats};

crate::parity! {
    random_scenes => |backend| {
        for degree in 0..=3 {
            check(backend, &[random_splats(900, degree, 10 + u64::from(degree))], Rasterization::Classic);
        }
    };
    hard_scenes => |backend| {
        for (i, hard) in HardSplats::ALL.into_iter().enumerate() {
            eprintln!("{hard:?}");
            check(backend, &[hard.splats(250, 20 + i as u64)], Rasterization::Classic);
        }
    };
    antialiased_scenes => |backend| {
        for hard in [HardSplats::Tiny, HardSplats::Needle, HardSplats::Opaque] {
            check(backend, &[random_splats(300, 0, 40), hard.splats(250, 41)], Rasterization::Antialiased);
        }
    };
    several_sets => |backend| {
        let sets = [random_splats(300, 2, 50), Splats::default(), random_splats(400, 0, 51)];
        check(backend, &sets, Rasterization::Classic);
    };
    split_by_a_surface => |backend| {
        split(backend, &random_splats(900, 2, 70));
        split(backend, &HardSplats::Opaque.splats(250, 71));
        split(backend, &HardSplats::Huge.splats(250, 72));
    };
    cut_by_a_plane => |backend| {
        let cut = CutPlane { normal: [0.6, 0.8, 0.0], height: 0.05 };
        cut_below(backend, &random_splats(900, 1, 73), cut);
    };
    names_of_splats => |backend| {
        names(backend, &random_splats(900, 1, 80));
        names(backend, &HardSplats::Opaque.splats(250, 81));
    };
    weights_of_splats => |backend| {
        weights(backend, [random_splats(700, 1, 80), Splats::default(), random_splats(300, 0, 83)]);
        weights(backend, [HardSplats::Opaque.splats(250, 81), HardSplats::Tiny.splats(250, 84), HardSplats::Huge.splats(50, 85)]);
    };
    no_splats => |backend| check(backend, &[Splats::default()], Rasterization::Classic);
}

/// Splats fade by their index, so that a wrong index shows.
struct Fade;

impl SplatAttributes for Fade {
    fn fill(&self, indices: &[u32], block: &mut AttributeBlock) {
        for (index, factor) in indices.iter().zip(block.column_mut(Attribute::Visibility)) {
            *factor = (index % 7) as f32 / 6.0;
        }
    }
}

fn check(backend: Backend, sets: &[Splats], rasterization: Rasterization) {
    // Sides that no tile, patch or block divides, and one narrower than a block.
    for (width, height, faded) in [(75, 53, false), (34, 18, true), (3, 1, false)] {
        let attributes: Option<&dyn SplatAttributes> = faded.then_some(&Fade);
        let camera = camera(width, height);
        let background = Background::Color([0.2, 0.4, 0.6]);
        let config = RenderConfig { outputs: ALL_OUTPUTS, background, rasterization };
        let sets: Vec<(&Splats, Option<&dyn SplatAttributes>)> =
            sets.iter().map(|set| (set, attributes)).collect();
        rendered(backend, &sets, &DrawPass::new(&[], &camera, &config))
            .unwrap_or_else(|error| panic!("{backend:?}, {width}x{height}: {error}"));
    }
}

/// The median splat has the median depth, on every pixel.
fn names(backend: Backend, splats: &Splats) {
    let camera = camera(75, 53);
    let mut renderer = backend.renderer();
    let set = [SetView::plain(renderer.load(splats).unwrap())];
    let mut draw = |median_depth| {
        let outputs = Outputs { median_depth, ..Outputs::default() };
        let config = RenderConfig { outputs, ..RenderConfig::default() };
        drawn(&mut *renderer, &DrawPass::new(&set, &camera, &config))
    };
    let (depths, names) = (draw(MedianDepth::On), draw(MedianDepth::Splat));
    assert_eq!(depths.rgb, names.rgb);
    let mut seen = 0;
    for (pixel, depth) in depths.median_depth.iter().enumerate() {
        let Some(splat) = names.median_splat(pixel) else {
            assert_eq!(*depth, 0.0, "{backend:?}, {pixel}");
            continue;
        };
        let mean = glam::DVec3::from_array(splats.means[splat as usize].map(f64::from));
        let own = camera.viewmat.transform_point3(mean).z;
        assert!((f64::from(*depth) - own).abs() < 1e-5 * own, "{backend:?}, {pixel}: {depth} and {own}");
        seen += 1;
    }
    assert!(seen > 100, "{seen}");
}

/// Weights are those of training, set after set, but for what is rounded at each tile.
fn weights(backend: Backend, sets: [Splats; 3]) {
    let camera = camera(75, 53);
    let mut renderer = backend.renderer();
    let views = sets.each_ref().map(|set| SetView::plain(renderer.load(set).unwrap()));
    let config = RenderConfig::default();
    let mut found = vec![9.0; 3];
    renderer.weigh(&DrawPass::new(&views, &camera, &config), &mut found).unwrap();
    let all = sets.into_iter().fold(Splats::default(), Splats::joined);
    let mut training = CpuDifferentiable::new(CpuConfig::default()).unwrap();
    let (mut frame, mut gradients) = (Frame::default(), Gradients::default());
    let config = ForwardConfig { channels: Channels::Depth, sh_degree: 0, ..ForwardConfig::default() };
    training.forward(&all, &camera, &config, &mut frame).unwrap();
    training.backward(&all, &Upstream::default(), Learn::NONE, &mut gradients).unwrap();
    let mut wanted = vec![0.0; all.len()];
    for (index, weight) in gradients.visible.iter().zip(&gradients.weights) {
        wanted[*index as usize] = *weight;
    }
    assert_eq!(found.len(), wanted.len());
    assert!(found.iter().sum::<f32>() > 100.0);
    // A tile's sum is rounded, and on a GPU that of a pixel.
    let rounded = 0.5 * 20.0 / 1024.0 + 0.5 * (75.0 * 53.0) / 16384.0;
    for (splat, (found, wanted)) in found.iter().zip(&wanted).enumerate() {
        let most = rounded + 0.01 * wanted;
        assert!((found - wanted).abs() < most, "{backend:?}, {splat}: {found} and {wanted}");
    }
}

fn render(splats: &Splats, camera: &Camera, count: usize, outputs: Outputs) -> Frame {
    let mut renderer = CpuRenderer::new(threads(count)).unwrap();
    let config = RenderConfig { outputs, ..RenderConfig::default() };
    drawn(&mut renderer, &DrawPass::new(&[SetView::transient(splats)], camera, &config))
}

#[test]
fn bytes_are_the_same_for_any_number_of_threads() {
    let splats = random_splats(20_000, 1, 60);
    let camera = camera(333, 217);
    let one = render(&splats, &camera, 1, ALL_OUTPUTS);
    for threads in [2, 7] {
        assert_eq!(render(&splats, &camera, threads, ALL_OUTPUTS), one);
    }
}

#[test]
fn geometry_changes_no_color() {
    let splats = random_splats(3000, 0, 61);
    let camera = camera(100, 80);
    let all = render(&splats, &camera, 2, ALL_OUTPUTS);
    for geometry in [Geometry::None, Geometry::Depth, Geometry::DepthNormal] {
        let frame = render(&splats, &camera, 2, Outputs { geometry, ..Outputs::default() });
        assert_eq!(frame.rgb, all.rgb);
        assert_eq!(frame.alpha, all.alpha);
        assert!(frame.median_depth.is_empty());
        assert_eq!(frame.depth.is_empty(), geometry == Geometry::None);
        assert_eq!(frame.normal.is_empty(), geometry != Geometry::DepthNormal);
    }
}

#[test]
fn a_frame_is_reused_for_other_sizes_and_outputs() {
    let splats = random_splats(500, 0, 62);
    let mut renderer = CpuRenderer::new(CpuConfig::default()).unwrap();
    let set = renderer.load(&splats).unwrap();
    let mut frame = Frame::default();
    for (width, height, outputs) in
        [(64, 48, ALL_OUTPUTS), (20, 90, Outputs::default()), (64, 48, ALL_OUTPUTS)]
    {
        let camera = camera(width, height);
        let config = RenderConfig { outputs, ..RenderConfig::default() };
        let pass = DrawPass::new(&[SetView::plain(set)], &camera, &config);
        renderer.render(&pass, &mut frame).unwrap();
        assert_eq!(frame, render(&splats, &camera, 2, outputs));
    }
}

#[test]
fn an_unloaded_set_is_named() {
    let mut renderer = CpuRenderer::new(CpuConfig::default()).unwrap();
    let set = renderer.load(&random_splats(5, 0, 63)).unwrap();
    renderer.unload(set);
    let (camera, config) = (camera(8, 8), RenderConfig::default());
    let pass = DrawPass::new(&[SetView::plain(set)], &camera, &config);
    let error = renderer.render(&pass, &mut Frame::default()).unwrap_err();
    assert_eq!(error.to_string(), "splat set 0 is not loaded");
}

/// A slanted surface with holes, in view z.
fn slanted(camera: &Camera) -> Vec<f32> {
    let depth = |i: u32| {
        let (x, y) = (i % camera.width, i / camera.width);
        let hole = (x / 5 + y / 3) % 4 == 0;
        if hole { f32::NAN } else { 4.2 + 0.05 * x as f32 + 0.02 * y as f32 }
    };
    (0..camera.width * camera.height).map(depth).collect()
}

/// A surface changes nothing of the picture, and what is before it is as in f64.
fn split(backend: Backend, splats: &Splats) {
    for (width, height) in [(75, 53), (34, 18), (3, 1)] {
        let camera = camera(width, height);
        let config = RenderConfig { outputs: ALL_OUTPUTS, ..RenderConfig::default() };
        let mut renderer = backend.renderer();
        let sets = [SetView::plain(renderer.load(splats).unwrap())];
        let pass = DrawPass::new(&sets, &camera, &config);
        let whole = drawn(&mut *renderer, &pass);
        let depth = slanted(&camera);
        let surface = BlendSurface { depth: &depth, normal: [0.0, 0.6, 0.8] };
        let split = DrawPass { surface: Some(surface), ..pass };
        let mut frame = drawn(&mut *renderer, &split);
        let front: [_; FRONT_CHANNELS] = std::array::from_fn(|part| frame.front_sums(part));
        frame.front.clear();
        let sets = [(splats, None)];
        let want = reference::frame::render(&sets, &split);
        match backend {
            // Another program, whose products and sums a driver may join otherwise.
            #[cfg(feature = "gpu")]
            Backend::Gpu => compare(&frame, &want, 2.0).unwrap_or_else(|error| panic!("{error}")),
            Backend::Cpu(_) => assert_eq!(frame, whole, "{backend:?}: a surface changes no picture"),
        }
        for (i, want_front) in want.front.iter().enumerate() {
            let got: [f32; FRONT_CHANNELS] = std::array::from_fn(|part| front[part][i]);
            let slack = want.slack[i] + want.front_slack[i];
            let slopes = want.slope_slack[i];
            for (k, (got, want)) in got.iter().zip(want_front).enumerate() {
                // Nothing is nearer than the near plane, whose reciprocal is 5.
                let largest = if k == 3 { 5.0 } else { 2.0 };
                let rounding = if k == 3 { slopes } else { 0.0 };
                let bound = largest * (1e-4 + 1.01 * slack) + rounding;
                let off = (f64::from(*got) - want).abs();
                assert!(
                    off <= bound,
                    "{backend:?}, {width}x{height}, pixel {i}, {k}: {got} for {want}, {bound}"
                );
            }
            // Without a surface everything is before it.
            if depth[i].is_nan() {
                assert_eq!(got[4], frame.alpha[i], "{backend:?}, pixel {i}");
            }
        }
    }
}

/// A cut draws exactly the splats whose centres lie above the plane.
fn cut_below(backend: Backend, splats: &Splats, cut: CutPlane) {
    let camera = camera(75, 53);
    let config = RenderConfig { outputs: ALL_OUTPUTS, ..RenderConfig::default() };
    let whole = DrawPass::new(&[], &camera, &config);
    let pass = DrawPass { cut: Some(cut), ..whole.clone() };
    let frame =
        rendered(backend, &[(splats, None)], &pass).unwrap_or_else(|error| panic!("{backend:?}: {error}"));
    let all = reference::frame::render(&[(splats, None)], &whole);
    assert!(compare(&frame, &all, 2.0).is_err(), "{backend:?}: the cut takes something away");
}
