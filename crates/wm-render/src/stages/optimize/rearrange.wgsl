// Rows of splats to where the splats are now: a thread per splat, from one piece of what was to one
// of what is.

struct Move {
    // Splats of the piece before, among all.
    first_before: u32,
    count_before: u32,
    // Splats of the piece now.
    first: u32,
    count: u32,
    // Rows a group of sixteen, of moments those of both.
    rows: u32,
    // 1 for moments, which may be forgotten.
    forgets: u32,
    // All splats forget row `forgotten_row` of every `period` rows, those of one moment; no row where
    // `period` is 0.
    forgotten_row: u32,
    period: u32,
}

@group(0) @binding(0) var<uniform> plan: Move;
// Of each splat the one that it comes from, and in the highest bit whether it forgets.
@group(0) @binding(1) var<storage, read> origins: array<u32>;
// `[groups][rows][16]`
@group(0) @binding(2) var<storage, read> before: array<f32>;
@group(0) @binding(3) var<storage, read_write> after: array<f32>;

fn at(splat: u32, row: u32) -> u32 {
    return (splat / GROUP * plan.rows + row) * GROUP + splat % GROUP;
}

@compute @workgroup_size(WORKGROUP)
fn rearrange(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let splat = group_index(workgroup) * WORKGROUP + local;
    if splat >= plan.count {
        return;
    }
    let origin = origins[plan.first + splat];
    // Wraps where it is before the piece.
    let own = (origin & 0x7fffffffu) - plan.first_before;
    if own >= plan.count_before {
        return;
    }
    let forgotten = plan.forgets == 1u && (origin >> 31u) == 1u;
    for (var row = 0u; row < plan.rows; row++) {
        let cleared = plan.period > 0u && row % max(plan.period, 1u) == plan.forgotten_row;
        after[at(splat, row)] = select(before[at(own, row)], 0.0, forgotten || cleared);
    }
}
