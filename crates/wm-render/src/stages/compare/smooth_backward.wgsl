// Differences of inverse depths of neighbours where the photo is smooth: their sum, and their
// derivative added to what is there. Each pixel looks at its four neighbours, so that no two write
// to one place.

@group(0) @binding(4) var<storage, read> of_groups: array<f32>;
// Colour and mask as 16-bit fractions.
@group(0) @binding(5) var<storage, read> photo: array<vec2<u32>>;
@group(0) @binding(6) var<storage, read_write> upstream: array<f32>;
// `[COMPARE_GROUPS]`
@group(0) @binding(7) var<storage, read_write> totals: array<vec4<f32>>;

fn color_at(at: u32) -> vec3<f32> {
    return vec3<f32>(unpack2x16unorm(photo[at].x), unpack2x16unorm(photo[at].y).x);
}

@compute @workgroup_size(WORKGROUP)
fn smooth_backward(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let group = group_index(workgroup);
    var part = vec4<f32>(0.0);
    if local < COMPARE_GROUPS {
        part.x = of_groups[local];
    }
    let all = summed(local, part).x;
    let scale = geometry.smooth_depth / max(all, 1e-30);
    let pixels = view.width * view.height;
    var own = 0.0;
    for (var at = group * WORKGROUP + local; at < pixels; at += COMPARE_GROUPS * WORKGROUP) {
        let inverse = inverse_depth(at);
        if inverse < 0.0 {
            continue;
        }
        let column = at % view.width;
        // Behind and before, in the row and in the column.
        let there = array<bool, 4>(
            (column + 1u < view.width), (at + view.width < pixels), (column > 0u), (at >= view.width),
        );
        let next = array<u32, 4>(at + 1u, at + view.width, at - 1u, at - view.width);
        let color = color_at(at);
        var by_inverse = 0.0;
        for (var k = 0u; k < 4u; k++) {
            if !there[k] {
                continue;
            }
            let other = inverse_depth(next[k]);
            if other < 0.0 {
                continue;
            }
            let off = abs(color - color_at(next[k]));
            let edge = exp(-(off.r + off.g + off.b) / (3.0 * EDGE));
            // Each pair once.
            own += select(0.0, edge * abs(inverse - other), k < 2u);
            by_inverse += edge * sign(inverse - other);
        }
        upstream[4u * pixels + at] -= scale * by_inverse * inverse * inverse;
    }
    let found = summed(local, vec4<f32>(own / max(all, 1e-30), 0.0, 0.0, 0.0));
    if local == 0u {
        totals[group] = found;
    }
}
