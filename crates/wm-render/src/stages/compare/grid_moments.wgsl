// Moments of the whole grid: of a few workgroups, which who reads them merges.

// `[COMPARE_GROUPS, 2]`: count and means; squares.
@group(0) @binding(7) var<storage, read_write> of_groups: array<vec4<f32>>;

@compute @workgroup_size(WORKGROUP)
fn grid_moments(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let group = group_index(workgroup);
    let all = geometry.columns * geometry.rows;
    var own: Moments;
    for (var i = group * WORKGROUP + local; i < all; i += COMPARE_GROUPS * WORKGROUP) {
        let pair = pair_at(pixel_of(i % geometry.columns, i / geometry.columns));
        if counts(pair) {
            own = with_pair(own, pair);
        }
    }
    let found = gathered(local, own);
    if local == 0u {
        of_groups[2u * group] = vec4<f32>(found.count, found.mean, 0.0);
        of_groups[2u * group + 1u] = vec4<f32>(found.squares, 0.0, 0.0);
    }
}
