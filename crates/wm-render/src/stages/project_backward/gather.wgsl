// Adds the slots of each splat in view, in the order of its tiles: a thread a number, sixteen
// splats at a time.

// Numbers of a slot.
const SLOT_LENGTH: u32 = 16u;

@group(0) @binding(0) var<storage, read> counters: array<u32, 4>;
// Records by depth, and where the slots of each end.
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> ends: array<u32>;
@group(0) @binding(3) var<storage, read> slots: array<f32>;
// `[records, 16]`
@group(0) @binding(4) var<storage, read_write> pulls: array<f32>;

@compute @workgroup_size(WORKGROUP)
fn gather(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let first = group_index(workgroup) * WORKGROUP;
    let number = local % SLOT_LENGTH;
    for (var i = first + local / SLOT_LENGTH; i < min(first + WORKGROUP, counters[0]); i += WORKGROUP / SLOT_LENGTH) {
        var slot = 0u;
        if i > 0u {
            slot = ends[i - 1u];
        }
        var total = 0.0;
        for (; slot < ends[i]; slot++) {
            total += slots[SLOT_LENGTH * slot + number];
        }
        pulls[SLOT_LENGTH * order[i] + number] = total;
    }
}
