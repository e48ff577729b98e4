// The sum of inverse depths: of a few workgroups, which who reads them adds.

@group(0) @binding(7) var<storage, read_write> of_groups: array<f32>;

@compute @workgroup_size(WORKGROUP)
fn inverse_depths(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let group = group_index(workgroup);
    var own = 0.0;
    for (var at = group * WORKGROUP + local; at < view.width * view.height; at += COMPARE_GROUPS * WORKGROUP) {
        own += max(inverse_depth(at), 0.0);
    }
    let all = summed(local, vec4<f32>(own, 0.0, 0.0, 0.0)).x;
    if local == 0u {
        of_groups[group] = all;
    }
}
