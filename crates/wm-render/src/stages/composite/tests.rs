use super::background::{BackgroundScratch, BackgroundView};
use crate::config::{Background, RenderConfig, SkyGradient};
use crate::hooks::{
    AirGroup, AirOnRay, Backdrop, Detail, GROUP, Hooks, Medium, PATCH, PATCH_PIXELS, PixelBatch, PixelEffect,
    ShadeGroup, SkySplats, WgslSource,
};
use crate::plan::{DrawPass, SetView, Shading};
use crate::simd::SimdPath;
use crate::testing::comparison::{ALL_OUTPUTS, drawn, rendered};
use crate::testing::{Backend, camera, random_splats};
use crate::{Frame, Geometry, Outputs};
use wm_scene::{Camera, Group};

crate::parity! {
    a_backdrop_is_behind_all_and_seen_through_the_air => backdrop;
    effects_see_every_pixel_once => effects;
    a_sky_stands_behind_every_pixel => sky;
    what_is_empty_is_zero => empty;
}

/// The nodes are within a tenth of an 8-bit step of the sky itself, but for the rows next to the
/// horizon, whose kink it rounds off by the slope's change over one pixel.
#[test]
fn the_background_follows_the_sky() {
    let path = SimdPath::select(crate::simd::SimdChoice::Auto).unwrap();
    let background = Background::Sky(SkyGradient::daylight([0.0, -1.0, 0.0]));
    for (width, height) in [(320, 200), (900, 600)] {
        let camera = camera(width, height);
        let grid = BackgroundView::new(&background, None, Shading::Color, &camera, path);
        for (patch_x, patch_y) in [(0, 0), (2, 1), (3, 2)] {
            let mut out = [[0.0; PATCH_PIXELS]; 3];
            grid.fill(patch_x, patch_y, &mut BackgroundScratch::default(), &mut out);
            for i in 0..PATCH_PIXELS {
                let (x, y) = (patch_x * PATCH + i % PATCH, patch_y * PATCH + i / PATCH);
                let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
                let want = background.color(ray.to_array());
                let tolerance = if ray.y.abs() < 0.03 { 2.0 } else { 0.1 } / 255.0;
                for k in 0..3 {
                    assert!((f64::from(out[k][i]) - want[k]).abs() < tolerance, "{x} {y} {}", ray.y);
                }
            }
        }
    }
}

/// The background of each pixel of an empty picture, of nodes four, eight and a whole patch along
/// its side: mixed of numbers about 1 by seven roundings.
fn sky(backend: Backend) {
    let background = Background::Sky(SkyGradient::daylight([0.0, -1.0, 0.0]));
    let config = RenderConfig { background, ..RenderConfig::default() };
    let mut renderer = backend.renderer();
    for (width, height) in [(900, 601), (322, 200), (70, 50)] {
        let camera = camera(width, height);
        let frame = drawn(&mut *renderer, &DrawPass::new(&[], &camera, &config));
        let grid = BackgroundView::new(&background, None, Shading::Color, &camera, SimdPath::available()[0]);
        let mut out = [[0.0; PATCH_PIXELS]; 3];
        for row in 0..(height as usize).div_ceil(PATCH) {
            for column in 0..(width as usize).div_ceil(PATCH) {
                grid.fill(column, row, &mut BackgroundScratch::default(), &mut out);
                for i in 0..PATCH_PIXELS {
                    let (x, y) = (column * PATCH + i % PATCH, row * PATCH + i / PATCH);
                    if x < width as usize && y < height as usize {
                        let got = &frame.rgb[3 * (y * width as usize + x)..][..3];
                        (0..3).for_each(|k| assert!((got[k] - out[k][i]).abs() < 2e-6, "{x} {y}"));
                    }
                }
            }
        }
    }
}

/// Writes the coordinates of each pixel, and what it reads.
struct Coordinates;

impl PixelEffect for Coordinates {
    fn apply(&self, _: SimdPath, pixels: &mut PixelBatch<'_>) {
        for i in 0..PATCH_PIXELS {
            pixels.rgb[0][i] += pixels.x as f32 + (i % PATCH) as f32;
            pixels.rgb[1][i] += pixels.y as f32 + (i / PATCH) as f32;
            pixels.rgb[2][i] = pixels.depth_sum[i] / pixels.alpha[i].max(1e-9);
        }
    }
}

fn frame(backend: Backend, camera: &Camera, effects: &[&dyn PixelEffect]) -> Frame {
    let outputs = Outputs { geometry: Geometry::DepthNormal, ..Outputs::default() };
    let config = RenderConfig { outputs, ..RenderConfig::default() };
    let hooks = Hooks { pixels: effects.to_vec(), ..Hooks::default() };
    let splats = random_splats(400, 0, 3);
    let pass = DrawPass::new(&[SetView::transient(&splats)], camera, &config).with_hooks(hooks);
    drawn(&mut *backend.renderer(), &pass)
}

fn effects(backend: Backend) {
    let camera = camera(77, 41);
    let plain = frame(backend, &camera, &[]);
    let changed = frame(backend, &camera, &[&Coordinates]);
    for y in 0..41 {
        for x in 0..77 {
            let i = plain.index(x, y);
            let (before, after) = (plain.rgb_at(x, y), changed.rgb_at(x, y));
            assert!((after[0] - before[0] - x as f32).abs() < 1e-4);
            assert!((after[1] - before[1] - y as f32).abs() < 1e-4);
            if plain.alpha[i] > 0.01 {
                assert!((after[2] / plain.depth[i] - 1.0).abs() < 1e-5);
            }
        }
    }
}

fn empty(backend: Backend) {
    let frame = frame(backend, &camera(200, 150), &[]);
    let mut empty = 0;
    for i in 0..frame.pixels() {
        let normal = &frame.normal[3 * i..3 * i + 3];
        let length: f32 = normal.iter().map(|v| v * v).sum();
        if frame.alpha[i] < crate::frame::MIN_ALPHA {
            assert_eq!((frame.depth[i], length), (0.0, 0.0));
            empty += 1;
        } else {
            assert!(frame.depth[i] > 0.0 && (length - 1.0).abs() < 1e-5);
        }
    }
    assert!(empty > 100);
}

/// Stripes of a few pixels, and how scenes' own skies are taken.
struct Stripes(SkySplats);

impl Backdrop for Stripes {
    fn paint(&self, pixel: f64, groups: &mut [ShadeGroup]) {
        for group in groups {
            for lane in 0..GROUP {
                let direction = [0, 1, 2].map(|k| f64::from(group.direction[k][lane]));
                let color = self.reference(pixel, direction);
                for k in 0..3 {
                    group.rgb[k][lane] = color[k] as f32;
                }
            }
        }
    }

    fn reference(&self, pixel: f64, direction: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|k| 0.5 + 0.4 * (direction[k] / pixel).sin())
    }

    fn detail(&self) -> Detail {
        Detail::Fine
    }

    fn sky_splats(&self) -> SkySplats {
        self.0
    }
}

/// Keeps half of the light of what is at infinity, and all else.
struct Half;

impl Medium for Half {
    fn evaluate(&self, _: SimdPath, _: [f32; 3], rays: &[ShadeGroup], out: &mut [AirGroup]) {
        for (rays, out) in rays.iter().zip(out) {
            let kept = rays.distance.map(|distance| if distance.is_infinite() { 0.5 } else { 1.0 });
            *out = AirGroup { transmittance: [kept; 3], ..AirGroup::default() };
        }
    }

    fn evaluate_reference(&self, _: [f64; 3], _: [f64; 3], distance: f64) -> AirOnRay {
        let kept = if distance.is_infinite() { 0.5 } else { 1.0 };
        AirOnRay { transmittance: [kept; 3], ..AirOnRay::CLEAR }
    }

    fn wgsl(&self, _: [f32; 3]) -> Option<WgslSource> {
        let wgsl = "fn evaluate_air(direction: vec3<f32>, distance: f32) -> AirOnRay {
            return AirOnRay(vec3<f32>(select(1.0, air[0], distance >= FAR_AWAY)), vec3<f32>(0.0));
        }";
        Some(WgslSource { wgsl: wgsl.into(), parameters: vec![0.5] })
    }
}

/// Directions in f32 are off by 1e-7, a pixel is 1 / 60: the stripes by 4e-6 or less.
fn backdrop(backend: Backend) {
    let mut splats = random_splats(300, 0, 4);
    (0..300).step_by(2).for_each(|i| splats.groups[i] = Group::Sky);
    let camera = camera(70, 50);
    // Of a colour that shows wherever the hook is forgotten.
    let background = Background::Color([9.0; 3]);
    let config = RenderConfig { outputs: ALL_OUTPUTS, background, ..RenderConfig::default() };
    let mut covered = Vec::new();
    for sky_splats in [SkySplats::Kept, SkySplats::LeftOut] {
        for medium in [None, Some(&Half as &dyn Medium)] {
            let stripes = Stripes(sky_splats);
            let hooks = Hooks { background: Some(&stripes), medium, ..Hooks::default() };
            let pass = DrawPass::new(&[], &camera, &config).with_hooks(hooks);
            let frame = rendered(backend, &[(&splats, None)], &pass).unwrap();
            covered.push(frame.alpha.iter().sum::<f32>());
        }
    }
    assert!(covered[2] < 0.9 * covered[0], "{covered:?}");
}
