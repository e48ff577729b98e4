// Which splats are in view: a bit for each, and how many a block holds.

var<workgroup> in_view: array<atomic<u32>, 8>;

// Phrased so that what is no number is not in view.
fn is_in_view(p: Projected) -> bool {
    let reach = max(p.log2_opacity - (LOG2_MIN_ALPHA - TEST_SLACK), 0.0) * (2.0 * LN_2);
    let extent = sqrt(reach * p.cov.xz);
    let low = p.mean2d + extent;
    let high = p.mean2d - extent;
    return p.z > view.near && p.det < MAX_DET && p.log2_opacity >= LOG2_MIN_ALPHA
        && dot(view.cut.xyz, p.offset) >= view.cut.w && low.x >= 0.5 && low.y >= 0.5 && high.x <= view.size.x - 0.5 && high.y <= view.size.y - 0.5;
}

@compute @workgroup_size(WORKGROUP)
fn cull(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let block = group_index(workgroup);
    if block >= chunk.blocks {
        return;
    }
    if local < 8u {
        atomicStore(&in_view[local], 0u);
    }
    workgroupBarrier();
    let splat = block * WORKGROUP + local;
    let hidden = splat >= chunk.splats || (view.sky_left_out != 0u && is_sky(splat));
    if !hidden && is_in_view(project(splat)) {
        atomicOr(&in_view[local / 32u], 1u << (local % 32u));
    }
    workgroupBarrier();
    if local == 0u {
        let at = chunk.first_block + block;
        var count = 0u;
        for (var word = 0u; word < 8u; word++) {
            let bits = atomicLoad(&in_view[word]);
            blocks[at].mask[word] = bits;
            count += countOneBits(bits);
        }
        blocks[at].count = count;
    }
}
