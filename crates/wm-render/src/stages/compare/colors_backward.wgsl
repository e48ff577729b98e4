// Adds the derivative of absolute differences, goes back through the exposure, and adds everything
// up: a few workgroups, whose sums the CPU adds in their order.

@group(0) @binding(5) var<storage, read> sums: array<f32>;
@group(0) @binding(6) var<storage, read_write> upstream: array<f32>;
// `[COMPARE_GROUPS, 4]`: absolute differences and similarity; rows of the derivative by the
// exposure.
@group(0) @binding(7) var<storage, read_write> totals: array<vec4<f32>>;

@compute @workgroup_size(WORKGROUP)
fn colors_backward(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let group = group_index(workgroup);
    let first = group * WORKGROUP + local;
    let stride = COMPARE_GROUPS * WORKGROUP;
    var own: array<vec4<f32>, 4>;
    for (var at = first; at < view.width * view.height; at += stride) {
        let truth = wanted(at);
        let off = exposed(at) - truth.rgb;
        own[0].x += truth.w * (abs(off.r) + abs(off.g) + abs(off.b));
        let by_similarity = vec3<f32>(upstream[3u * at], upstream[3u * at + 1u], upstream[3u * at + 2u]);
        let by = by_similarity + comparison.l1 * truth.w * sign(off);
        let color = vec4<f32>(rendered(at), 1.0);
        own[1] += by.r * color;
        own[2] += by.g * color;
        own[3] += by.b * color;
        let back = by.r * comparison.red + by.g * comparison.green + by.b * comparison.blue;
        upstream[3u * at] = back.r;
        upstream[3u * at + 1u] = back.g;
        upstream[3u * at + 2u] = back.b;
    }
    for (var i = first; i < 3u * view.tiles; i += stride) {
        own[0].y += sums[i];
    }
    for (var k = 0u; k < 4u; k++) {
        let all = summed(local, own[k]);
        if local == 0u {
            totals[4u * group + k] = all;
        }
    }
}
