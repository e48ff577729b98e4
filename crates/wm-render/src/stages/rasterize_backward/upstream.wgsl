// From the derivative of the loss by each pixel's pictures to that by its sums; see the contract in
// `mod.rs`.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> training: Training;
// What blending kept.
@group(0) @binding(2) var<storage, read> rgb: array<f32>;
@group(0) @binding(3) var<storage, read> alpha: array<f32>;
@group(0) @binding(4) var<storage, read> depths: array<f32>;
@group(0) @binding(5) var<storage, read> normal: array<f32>;
// The derivatives by colour `[H, W, 3]`, alpha `[H, W]`, depth `[H, W]` and normal `[H, W, 3]`, one
// after another.
@group(0) @binding(6) var<storage, read> upstream: array<f32>;
// `[H, W, 2]`: by colour and depth; by normal, and what is still to come.
@group(0) @binding(7) var<storage, read_write> states: array<vec4<f32>>;

@compute @workgroup_size(WORKGROUP)
fn by_sums(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let at = group_index(workgroup) * WORKGROUP + local;
    let pixels = view.width * view.height;
    if at >= pixels {
        return;
    }
    let coverage = alpha[at];
    let covered = coverage >= FRAME_MIN_ALPHA;
    var by_alpha = upstream[3u * pixels + at];
    var by_rgb = vec3<f32>(0.0);
    var by_depth = 0.0;
    var by_normal = vec3<f32>(0.0);
    var remaining = 0.0;
    if COLOR {
        by_rgb = vec3<f32>(upstream[3u * at], upstream[3u * at + 1u], upstream[3u * at + 2u]);
        by_alpha -= dot(by_rgb, training.background);
        remaining = dot(by_rgb, vec3<f32>(rgb[3u * at], rgb[3u * at + 1u], rgb[3u * at + 2u]));
    }
    if DEPTH {
        let inverse = select(0.0, 1.0 / max(coverage, FRAME_MIN_ALPHA), covered);
        by_depth = upstream[4u * pixels + at] * inverse;
        let share = by_depth * depths[at];
        if training.depth_detached == 0u {
            by_alpha -= share * inverse;
        }
        remaining += share;
    }
    if NORMAL {
        let sum = vec3<f32>(normal[3u * at], normal[3u * at + 1u], normal[3u * at + 2u]);
        let first = 5u * pixels + 3u * at;
        let by_unit = vec3<f32>(upstream[first], upstream[first + 1u], upstream[first + 2u]);
        let squared = dot(sum, sum);
        let inverse = select(0.0, 1.0 / sqrt(max(squared, 1e-20)), covered && squared > 1e-20);
        let along = dot(sum, by_unit) * (inverse * inverse);
        // Turning a normal pulls on nothing along it: what is to come is 0 but for rounding.
        by_normal = (by_unit - along * sum) * inverse;
        remaining += dot(by_normal, sum);
    }
    remaining -= by_alpha * (1.0 - coverage);
    states[2u * at] = vec4<f32>(by_rgb, by_depth);
    states[2u * at + 1u] = vec4<f32>(by_normal, remaining);
}
