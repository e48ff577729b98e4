// What is told about a step of training; mirrors `gpu::uniforms::training`.
struct Training {
    // The colour behind all splats.
    background: vec3<f32>,
    // 1 where the gradient of expected depth takes alpha for a constant.
    depth_detached: u32,
}
