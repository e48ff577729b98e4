// The records that touch a packet, in their order, and the keys by which they are sorted.

@group(0) @binding(1) var<storage, read> records: array<RayRecord>;
// The packets that each touches.
@group(0) @binding(2) var<storage, read> counts: array<u32>;
// The first word of each block says how many records of the blocks before touch any.
@group(0) @binding(3) var<storage, read> blocks: array<u32>;
@group(0) @binding(4) var<storage, read_write> distances: array<u32>;
@group(0) @binding(5) var<storage, read_write> names: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn visible(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let block = group_index(workgroup);
    if block * WORKGROUP >= task.records {
        return;
    }
    let name = block * WORKGROUP + local;
    var is_met = false;
    if name < task.records {
        is_met = counts[name] > 0u;
    }
    let place = blocks[block * BLOCK_WORDS] + scan(local, select(0u, 1u, is_met)).x;
    if is_met {
        // Positive floats are in the order of their bits.
        distances[place] = bitcast<u32>(length(records[name].mean - task.center));
        names[place] = name;
    }
}
