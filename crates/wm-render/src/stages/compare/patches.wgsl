// The differences of each patch: sums of squares and counts above the margin.

// See `grid_moments.wgsl`.
@group(0) @binding(4) var<storage, read> of_groups: array<vec4<f32>>;
// `[patches, 3]`: squares and count of global differences, of local ones; count and means;
// deviations that global and local ones are divided by.
@group(0) @binding(7) var<storage, read_write> of_patches: array<vec4<f32>>;

@compute @workgroup_size(WORKGROUP)
fn patches(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let index = group_index(workgroup);
    if index >= geometry.patch_count {
        return;
    }
    var own: Moments;
    if local < COMPARE_GROUPS {
        let first = of_groups[2u * local];
        own = Moments(first.x, first.yz, of_groups[2u * local + 1u].xy);
    }
    let all = deviations(gathered(local, own));

    let region = patch_of(index);
    own = Moments();
    for (var i = local; i < pixels_in(region); i += WORKGROUP) {
        let pair = pair_at(pixel_in(region, i));
        if counts(pair) {
            own = with_pair(own, pair);
        }
    }
    let found = gathered(local, own);
    let over_all = (1.0 + PATCH_FLOOR) * all;
    let over_own = PATCH_FLOOR * all + deviations(found);
    let says = found.count >= f32(PATCH_FEWEST) && all.x > 0.0 && all.y > 0.0;
    var sums = vec4<f32>(0.0);
    if says {
        for (var i = local; i < pixels_in(region); i += WORKGROUP) {
            let pair = pair_at(pixel_in(region, i));
            if counts(pair) {
                let off = pair - found.mean;
                let by_all = difference(off, over_all);
                let by_own = difference(off, over_own);
                sums += vec4<f32>(by_all * by_all, select(0.0, 1.0, by_all != 0.0),
                    by_own * by_own, select(0.0, 1.0, by_own != 0.0));
            }
        }
    }
    sums = summed(local, sums);
    if local == 0u {
        of_patches[3u * index] = sums;
        of_patches[3u * index + 1u] = vec4<f32>(select(0.0, found.count, says), found.mean, 0.0);
        of_patches[3u * index + 2u] = vec4<f32>(over_all, over_own);
    }
}
