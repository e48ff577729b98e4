// Adds the gradients of another render of the same view to those of a step, where both have the
// splat.

struct Learn {
    // 1 for what learns from it.
    means: f32,
    quats: f32,
    log_scales: f32,
    opacities: f32,
    sh: f32,
}

// What the step has in view; `blocks` has what the other render does.
@group(0) @binding(2) var<storage, read> step_blocks: array<Block>;
@group(0) @binding(5) var<storage, read> other: array<f32>;
@group(0) @binding(6) var<storage, read> other_by_sh: array<f32>;
@group(0) @binding(7) var<storage, read_write> gradients: array<f32>;
@group(0) @binding(8) var<storage, read_write> by_sh: array<f32>;
@group(0) @binding(10) var<uniform> learn: Learn;

fn add(to_place: u32, from_place: u32, first: u32, count: u32, share: f32) {
    for (var k = first; k < first + count; k++) {
        gradients[to_place * GRADIENT_ROW + k] += share * other[from_place * GRADIENT_ROW + k];
    }
}

@compute @workgroup_size(WORKGROUP)
fn add_gradients(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let block = group_index(workgroup);
    if block >= chunk.blocks {
        return;
    }
    let from_place = place_of(chunk.first_block + block, local);
    let to_place = place_in(step_blocks[chunk.first_block + block], local);
    if from_place == NOT_IN_VIEW || to_place == NOT_IN_VIEW {
        return;
    }
    add(to_place, from_place, GRADIENT_MEAN, 3u, learn.means);
    add(to_place, from_place, GRADIENT_QUAT, 4u, learn.quats);
    add(to_place, from_place, GRADIENT_SCALE, 3u, learn.log_scales);
    add(to_place, from_place, GRADIENT_OPACITY, 1u, learn.opacities);
    if learn.sh > 0.0 {
        let row = chunk.sh_used + 3u;
        for (var k = 0u; k < row; k++) {
            by_sh[to_place * row + k] += other_by_sh[from_place * row + k];
        }
    }
}
