//! The background on the GPU. It is one colour, or a picture that the CPU paints and uploads: skies
//! and panoramas have no form for the GPU yet. Pixel effects run on the CPU, on the picture that
//! came back.

use crate::differentiable::Channels;
use crate::gpu::buffers::{ParticleBlend, Room};
use crate::gpu::recorder::{Groups, Recorder, with_buffers, with_numbered};
use crate::gpu::source::{COLOR, Program, TRAINING, WORKGROUP, switches};
use crate::stages::particles::gpu::OVER;

/// The form of the background behind the splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum BackgroundForm {
    /// One colour.
    Color,
    /// Colours interpolated between nodes; the number of nodes along a side of each patch.
    Nodes(u32),
    /// A picture.
    Picture,
}

/// One colour behind everything.
const ONE_COLOR: &str =
    "fn behind(at: u32) -> vec3<f32> { return vec3<f32>(background[0], background[1], background[2]); }";
/// A picture behind it, `[H, W, 3]`.
const PICTURE: &str = "fn behind(at: u32) -> vec3<f32> {
    return vec3<f32>(background[3u * at], background[3u * at + 1u], background[3u * at + 2u]);
}";
/// No particles.
const NO_PARTICLES: &str = "fn with_falling(at: u32, rgb: vec3<f32>) -> vec3<f32> { return rgb; }";

/// Puts the background behind and the particles before the splats.
pub(crate) fn composite_program(form: BackgroundForm, particles: ParticleBlend) -> Program {
    let program = Program::new("composite", &[include_str!("composite.wgsl")]);
    let program = match form {
        BackgroundForm::Color => program.with(ONE_COLOR),
        BackgroundForm::Nodes(nodes) => {
            program.with(format!("const NODES = {nodes}u;")).with(include_str!("nodes.wgsl"))
        }
        BackgroundForm::Picture => program.with(PICTURE),
    };
    if particles == ParticleBlend::None {
        return program.with(NO_PARTICLES);
    }
    let is_apart = matches!(particles, ParticleBlend::Separate | ParticleBlend::Apart);
    let is_over = particles != ParticleBlend::Apart;
    let switches = format!("const APART: bool = {is_apart};\nconst OVER: bool = {is_over};");
    program.with(switches).with(COLOR).with(OVER)
}

/// Makes the pictures of a step of training from its sums.
pub(crate) fn finish_program(channels: Channels) -> Program {
    Program::new("finish", &[TRAINING, include_str!("finish.wgsl")]).with(switches(channels))
}

/// Finishes `pixels` pixels of a frame.
pub(crate) fn composite(
    recorder: &mut Recorder<'_>,
    pixels: u32,
    form: BackgroundForm,
    particles: ParticleBlend,
    room: &Room,
    background: &wgpu::Buffer,
) {
    let mut bindings = with_buffers(vec![(0, recorder.view())], [&room.rgb, &room.alpha, background]);
    if particles != ParticleBlend::None {
        bindings = with_numbered(bindings, [(4, &room.falling), (5, &room.apart)]);
    }
    let groups = Groups::Direct(pixels.div_ceil(WORKGROUP));
    recorder.dispatch(composite_program(form, particles), groups, bindings);
}

/// Finishes `pixels` pixels of the sums of a step of training to its pictures: colour, depth and
/// normal. `training` is the structure of that name.
pub(crate) fn finish(
    recorder: &mut Recorder<'_>,
    pixels: u32,
    channels: Channels,
    training: wgpu::BindingResource<'_>,
    sums: &Room,
    pictures: [&wgpu::Buffer; 3],
) {
    let Room { rgb, alpha, depths, normal, .. } = sums;
    let structures = vec![(0, recorder.view()), (1, training)];
    let bindings = with_buffers(with_buffers(structures, [rgb, alpha, depths, normal]), pictures);
    recorder.dispatch(finish_program(channels), Groups::Direct(pixels.div_ceil(WORKGROUP)), bindings);
}
