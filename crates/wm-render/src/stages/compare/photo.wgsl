// A rendered pixel and its photo's; mirrors `gpu::uniforms::comparison`.

struct Comparison {
    // Rows of the photo's exposure, with what is added behind.
    red: vec4<f32>,
    green: vec4<f32>,
    blue: vec4<f32>,
    // Weights over how many values they are a mean of.
    l1: f32,
    dssim: f32,
    // Which of the three is windowed.
    channel: u32,
}

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> comparison: Comparison;
// `[H, W, 3]`
@group(0) @binding(2) var<storage, read> rgb: array<f32>;
// Colour and mask as 16-bit fractions.
@group(0) @binding(3) var<storage, read> photo: array<vec2<u32>>;

fn rendered(at: u32) -> vec3<f32> {
    return vec3<f32>(rgb[3u * at], rgb[3u * at + 1u], rgb[3u * at + 2u]);
}

fn exposed(at: u32) -> vec3<f32> {
    let color = vec4<f32>(rendered(at), 1.0);
    return vec3<f32>(dot(comparison.red, color), dot(comparison.green, color), dot(comparison.blue, color));
}

fn wanted(at: u32) -> vec4<f32> {
    return vec4<f32>(unpack2x16unorm(photo[at].x), unpack2x16unorm(photo[at].y));
}
