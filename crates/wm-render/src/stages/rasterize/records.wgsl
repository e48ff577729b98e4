// Tile lists that name records, as those of frames do.
@group(0) @binding(8) var<storage, read_write> counters: Counters;

fn listed(entry: u32) -> u32 {
    return entries[entry];
}

fn walk(count: u32) {
    atomicAdd(&counters.walked, count);
}
