// Tile lists that name pairs of splat and tile, as those of training do: the record of each pair is
// here.
@group(0) @binding(8) var<storage, read> names: array<u32>;

fn listed(entry: u32) -> u32 {
    return names[entries[entry]];
}

fn walk(count: u32) {
}
