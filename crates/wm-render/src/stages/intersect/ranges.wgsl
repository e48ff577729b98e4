// Where the list of each tile begins in the sorted entries.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> counters: array<u32, 4>;
@group(0) @binding(2) var<storage, read> tiles: array<u32>;
// `[tiles + 1]`
@group(0) @binding(3) var<storage, read_write> tile_offsets: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn ranges(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let tile = group_index(workgroup) * WORKGROUP + local;
    if tile > view.tiles {
        return;
    }
    var low = 0u;
    var high = counters[1];
    while low < high {
        let middle = low + (high - low) / 2u;
        if tiles[middle] < tile {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    tile_offsets[tile] = low;
}
