// The packets that 256 records touch together, by distance.

@group(0) @binding(1) var<storage, read> counters: array<u32, 4>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> counts: array<u32>;
@group(0) @binding(4) var<storage, read_write> sums: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn sum_counts(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let block = group_index(workgroup);
    let i = block * WORKGROUP + local;
    var own = 0u;
    if i < counters[0] && i < task.records {
        own = counts[order[i]];
    }
    let total = scan(local, own).y;
    if local == 0u && i < counters[0] {
        sums[block] = total;
    }
}
