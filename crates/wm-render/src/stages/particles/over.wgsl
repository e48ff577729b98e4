// What falls, over a finished pixel: transmittances multiply, colours average, in linear light.

@group(0) @binding(4) var<storage, read> falling: array<u32>;
// Light and coverage, `[H, W, 4]`.
@group(0) @binding(5) var<storage, read_write> apart: array<f32>;

fn with_falling(at: u32, rgb: vec3<f32>) -> vec3<f32> {
    let steps = f32(falling[4u * at]);
    let sums = vec3<f32>(
        f32(falling[4u * at + 1u]), f32(falling[4u * at + 2u]), f32(falling[4u * at + 3u]),
    );
    let kept = exp2(max(steps * (-LOG2E / STEPS), -126.0));
    let light = sums * ((1.0 - kept) / max(steps, 1.0));
    if APART {
        apart[4u * at] = light.x;
        apart[4u * at + 1u] = light.y;
        apart[4u * at + 2u] = light.z;
        apart[4u * at + 3u] = 1.0 - kept;
    }
    if !OVER || (steps == 0.0 && all(sums == vec3<f32>(0.0))) {
        return rgb;
    }
    return srgb_encode(srgb_decode(rgb) * kept + light);
}
