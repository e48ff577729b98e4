// Sums of threads by subgroups, of any size from four on: those of a subgroup at once, then one
// subgroup after another.

// Splats whose sums are added together.
const SPLATS_PER_SUM: u32 = 4u;
const MAX_SUBGROUPS: u32 = THREADS / MIN_SUBGROUP;

// `[2, SPLATS_PER_SUM, SLOT_VECTORS, MAX_SUBGROUPS]`: while one half is added up the next sums
// go to the other.
var<workgroup> of_subgroups: array<vec4<f32>, 2u * SPLATS_PER_SUM * SLOT_VECTORS * MAX_SUBGROUPS>;
var<private> half: u32 = 0u;
var<private> subgroup: u32;
var<private> subgroups: u32;
var<private> lane: u32;

// Takes a thread's sums of splat number `j` of those together.
fn keep(local: u32, j: u32, sums: Sums) {
    let seen = subgroupAny(sums.seen);
    for (var k = 0u; k < SLOT_VECTORS; k++) {
        var total = vec4<f32>(0.0);
        if seen {
            total = subgroupAdd(sums.numbers[k]);
        }
        if lane == 0u {
            of_subgroups[((half * SPLATS_PER_SUM + j) * SLOT_VECTORS + k) * MAX_SUBGROUPS + subgroup] = total;
        }
    }
}

// Writes the slots of the splats from `first` of a batch of `size` on.
fn add_up(local: u32, first: u32, size: u32) {
    workgroupBarrier();
    let own = first + local / SLOT_VECTORS;
    if local < SPLATS_PER_SUM * SLOT_VECTORS && own < size {
        var total = vec4<f32>(0.0);
        for (var k = 0u; k < subgroups; k++) {
            total += of_subgroups[(half * SPLATS_PER_SUM * SLOT_VECTORS + local) * MAX_SUBGROUPS + k];
        }
        slots[SLOT_VECTORS * batch_pairs[own] + local % SLOT_VECTORS] = total;
    }
    half = 1u - half;
}

@compute @workgroup_size(THREADS)
fn rasterize_backward(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
    @builtin(subgroup_id) own_subgroup: u32,
    @builtin(num_subgroups) all_subgroups: u32,
    @builtin(subgroup_invocation_id) own_lane: u32,
) {
    subgroup = own_subgroup;
    subgroups = all_subgroups;
    lane = own_lane;
    replay_tile(group_index(workgroup), local);
}
