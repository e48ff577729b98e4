// Depth, normals and coverage against what is believed of each pixel: adds them up, and writes all
// derivatives by pictures beside colours. A few workgroups, whose sums the CPU adds in their order.

@group(0) @binding(4) var<storage, read> normal: array<f32>;
@group(0) @binding(6) var<storage, read_write> upstream: array<f32>;
// `[COMPARE_GROUPS]`: of depth, normals and coverage.
@group(0) @binding(7) var<storage, read_write> totals: array<vec4<f32>>;

@compute @workgroup_size(WORKGROUP)
fn pixels_backward(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let group = group_index(workgroup);
    let pixels = view.width * view.height;
    var own = vec4<f32>(0.0);
    for (var at = group * WORKGROUP + local; at < pixels; at += COMPARE_GROUPS * WORKGROUP) {
        let last = unpack2x16snorm(beliefs[3u * at + 2u]);
        var by_alpha = 0.0;
        if last.y >= 0.0 {
            let off = alpha[at] - last.y;
            let beyond = abs(off) - SLACK;
            if beyond > 0.0 {
                own.z += beyond;
                by_alpha = select(-geometry.coverage, geometry.coverage, off > 0.0);
            }
        }
        upstream[3u * pixels + at] = by_alpha;
        if DEPTH {
            let inverse = inverse_depth(at);
            let believed = believed_inverse_depth(at);
            var by_depth = 0.0;
            if inverse > 0.0 && believed > 0.0 {
                let off = log(believed / inverse);
                let exact = max(geometry.sigma / believed, EXACT);
                let root = length(vec2<f32>(off, exact));
                // Of nearly equal ones no difference.
                own.x += off * off / (root + exact);
                by_depth = geometry.depth * off / root * inverse;
            }
            upstream[4u * pixels + at] = by_depth;
        }
        if NORMAL {
            let wanted = vec3<f32>(unpack2x16snorm(beliefs[3u * at + 1u]), last.x);
            let first = 3u * at;
            var by_normal = vec3<f32>(0.0);
            if any(wanted != vec3<f32>(0.0)) && alpha[at] >= COVERED {
                let off = vec3<f32>(normal[first], normal[first + 1u], normal[first + 2u]) - wanted;
                own.y += dot(off, off);
                by_normal = 2.0 * geometry.normal * off;
            }
            for (var k = 0u; k < 3u; k++) {
                upstream[5u * pixels + first + k] = by_normal[k];
            }
        }
    }
    let all = summed(local, own);
    if local == 0u {
        totals[group] = all;
    }
}
