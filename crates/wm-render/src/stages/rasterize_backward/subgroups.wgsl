// Sums of threads by subgroups, of any size from four on: those of a subgroup at once, then one
// subgroup after another.

// Splats whose sums are added together.
const TOGETHER: u32 = 4u;
const MOST_SUBGROUPS: u32 = THREADS / MIN_SUBGROUP;

// `[2, TOGETHER, QUARTERS, MOST_SUBGROUPS]`: while one half is added up the next sums go to the
// other.
var<workgroup> of_subgroups: array<vec4<f32>, 2u * TOGETHER * QUARTERS * MOST_SUBGROUPS>;
var<private> half: u32 = 0u;
var<private> subgroup: u32;
var<private> subgroups: u32;
var<private> lane: u32;

// Takes a thread's sums of splat number `j` of those together.
fn keep(local: u32, j: u32, sums: Sums) {
    let seen = subgroupAny(sums.seen);
    for (var k = 0u; k < QUARTERS; k++) {
        var total = vec4<f32>(0.0);
        if seen {
            total = subgroupAdd(sums.numbers[k]);
        }
        if lane == 0u {
            of_subgroups[((half * TOGETHER + j) * QUARTERS + k) * MOST_SUBGROUPS + subgroup] = total;
        }
    }
}

// Writes the slots of the splats from `first` of a batch of `size` on.
fn add_up(local: u32, first: u32, size: u32) {
    workgroupBarrier();
    let own = first + local / QUARTERS;
    if local < TOGETHER * QUARTERS && own < size {
        var total = vec4<f32>(0.0);
        for (var k = 0u; k < subgroups; k++) {
            total += of_subgroups[(half * TOGETHER * QUARTERS + local) * MOST_SUBGROUPS + k];
        }
        slots[QUARTERS * batch_pairs[own] + local % QUARTERS] = total;
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
