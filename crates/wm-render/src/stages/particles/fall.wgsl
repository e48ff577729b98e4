// The cover of falling particles, a workgroup each: whole numbers, added by atomics. See the
// contract in `mod.rs`.

const THREADS: u32 = 64u;

// A particle in the picture: the CPU's `Drop` in its order.
struct Drop {
    mean2d: vec2<f32>,
    extent: vec2<f32>,
    // ux, vx, vy, slope_y
    shape: vec4<f32>,
    slope_x: f32,
    reach: f32,
    peak: f32,
    depth: f32,
    rgb: vec3<f32>,
    unused: f32,
}

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> drops: array<Drop>;
@group(0) @binding(2) var<storage, read> alpha: array<f32>;
@group(0) @binding(3) var<storage, read> depths: array<f32>;
// Optical depth, red, green and blue times it, `[H, W, 4]`.
@group(0) @binding(4) var<storage, read_write> sums: array<atomic<u32>>;

@compute @workgroup_size(THREADS)
fn fall(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let index = group_index(workgroup);
    if index >= view.drops {
        return;
    }
    let drop = drops[index];
    let size = vec2<f32>(f32(view.width), f32(view.height));
    let low = vec2<u32>(clamp(floor(drop.mean2d - drop.extent - 0.5), vec2<f32>(0.0), size));
    let high = vec2<u32>(clamp(ceil(drop.mean2d + drop.extent + 0.5), vec2<f32>(0.0), size));
    let columns = high.x - low.x;
    let pixels = columns * (high.y - low.y);
    let end = drop.peak - drop.reach;
    for (var i = local; i < pixels; i += THREADS) {
        let pixel = low + vec2<u32>(i % columns, i / columns);
        let d = vec2<f32>(pixel) + 0.5 - drop.mean2d;
        let u = drop.shape.x * d.x;
        let v = drop.shape.y * d.x + drop.shape.z * d.y;
        let exponent = drop.peak - (u * u + v * v);
        if exponent >= end {
            let at = pixel.y * view.width + pixel.x;
            let covered = alpha[at] >= FRAME_MIN_ALPHA;
            // Where the scene is before it, what the scene leaves open.
            let open = select(1.0 - alpha[at], 1.0, !covered || drop.depth < depths[at]);
            let tau = exp2(exponent) * (open * STEPS);
            atomicAdd(&sums[4u * at], u32(round(tau)));
            for (var k = 0u; k < 3u; k++) {
                atomicAdd(&sums[4u * at + k + 1u], u32(round(tau * drop.rgb[k])));
            }
        }
    }
}
