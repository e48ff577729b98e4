// The derivative of the patches' differences by depth, added to what is there.

@group(0) @binding(4) var<storage, read> of_patches: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> upstream: array<f32>;
@group(0) @binding(7) var<storage, read> totals: array<vec4<f32>>;

@compute @workgroup_size(WORKGROUP)
fn patches_backward(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let index = group_index(workgroup);
    if index >= geometry.patch_count {
        return;
    }
    let known = of_patches[3u * index + 1u];
    if known.x == 0.0 {
        return;
    }
    let mean = known.yz;
    let over = of_patches[3u * index + 2u];
    // By a difference: each is squared, in the mean of those above the margin.
    let slope = 2.0 * vec2<f32>(1.0, geometry.local) / max(totals[0].yw, vec2<f32>(1.0));
    let region = patch_of(index);
    var own = vec4<f32>(0.0);
    for (var i = local; i < pixels_in(region); i += WORKGROUP) {
        let pair = pair_at(pixel_in(region, i));
        if counts(pair) {
            let off = pair - mean;
            let by = slope * vec2<f32>(difference(off, over.xy), difference(off, over.zw));
            own += vec4<f32>(by, by.y * off.x, 0.0);
        }
    }
    let sums = summed(local, own) / known.x;
    // The patch's own deviation moves with its pixels.
    let all_x = over.x / (1.0 + PATCH_FLOOR);
    let own_x = over.z - PATCH_FLOOR * all_x;
    var along = 0.0;
    if own_x > 1e-6 * all_x {
        along = sums.z / (own_x * over.z * over.z);
    }
    let pixels = view.width * view.height;
    for (var i = local; i < pixels_in(region); i += WORKGROUP) {
        let at = pixel_in(region, i);
        let pair = pair_at(at);
        if counts(pair) {
            let off = pair - mean;
            let by = slope * vec2<f32>(difference(off, over.xy), difference(off, over.zw));
            let by_inverse = (by.x - sums.x) / over.x + (by.y - sums.y) / over.z - off.x * along;
            upstream[4u * pixels + at] -= geometry.patches * by_inverse * pair.x * pair.x;
        }
    }
}
