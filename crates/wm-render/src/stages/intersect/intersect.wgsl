// Which tiles each splat touches. One entry point counts them and then writes them: two would be compiled apart, and
// might round apart.

struct Task {
    // 0 to count, 1 to write.
    emits: u32,
}

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> task: Task;
@group(0) @binding(2) var<storage, read> counters: array<u32, 4>;
@group(0) @binding(3) var<storage, read> records: array<Record>;
// Records by depth.
@group(0) @binding(4) var<storage, read> order: array<u32>;
// How many tiles each touches, by depth.
@group(0) @binding(5) var<storage, read_write> counts: array<u32>;
// The same of 256 at a time; after the scan, of those before.
@group(0) @binding(6) var<storage, read_write> sums: array<u32>;
// Tile and record of each entry.
@group(0) @binding(7) var<storage, read_write> tiles: array<u32>;
@group(0) @binding(8) var<storage, read_write> entries: array<u32>;

// Whether alpha reaches 1/255 in the rectangle of a tile's pixel centres: the greatest alpha is on one of the two edges
// that face the centre.
fn touches(splat: Record, reach: f32, tile: vec2<f32>) -> bool {
    let low = tile * TILE_SIDE + 0.5 - splat.a.xy;
    let high = low + (TILE_SIDE - 1.0);
    let near = min(max(vec2<f32>(0.0), low), high);
    let best_y = min(max(near.x * splat.d.y, low.y), high.y);
    let best_x = min(max(near.y * splat.d.z, low.x), high.x);
    let u = vec2<f32>(near.x, best_x) * splat.a.z;
    let v = vec2<f32>(near.x, best_x) * splat.a.w + vec2<f32>(best_y, near.y) * splat.b.x;
    let q = u * u + v * v;
    return min(q.x, q.y) <= reach;
}

// The tiles about a splat: first column and row, numbers of columns and rows.
struct Box {
    first: vec2<u32>,
    size: vec2<u32>,
}

fn reach_of(splat: Record) -> f32 {
    return splat.b.y - (LOG2_MIN_ALPHA - TEST_SLACK);
}

fn box_of(splat: Record) -> Box {
    let reach = max(reach_of(splat), 0.0);
    let across = splat.a.w / splat.a.z;
    // A pixel more each way: the test above is the exact one.
    let extent = sqrt(reach * vec2<f32>(1.0, 1.0 + across * across)) / vec2<f32>(splat.a.z, splat.b.x) + 1.0;
    let last = vec2<f32>(f32(view.tile_columns), f32(view.tiles / view.tile_columns)) - 1.0;
    let low = vec2<u32>(clamp(floor((splat.a.xy - extent) / TILE_SIDE), vec2<f32>(0.0), last));
    let high = vec2<u32>(clamp(floor((splat.a.xy + extent) / TILE_SIDE), vec2<f32>(0.0), last));
    return Box(low, high - low + 1u);
}

// What each thread's splat has: where its entries go, how many there is room for, how many tiles it touches.
var<workgroup> firsts: array<u32, WORKGROUP>;
var<workgroup> rooms: array<u32, WORKGROUP>;
var<workgroup> found: array<atomic<u32>, WORKGROUP>;
// Threads whose splats have more tiles about them than FEW.
var<workgroup> large: array<u32, WORKGROUP>;
var<workgroup> large_count: atomic<u32>;

// Adds tile number `i` of a box to a thread's splat, if it is touched. In which order does not count: a splat's tiles
// are all different, and the sort by tile keeps only the order of splats.
fn add(thread: u32, name: u32, splat: Record, around: Box, i: u32) {
    let tile = around.first + vec2<u32>(i % around.size.x, i / around.size.x);
    if touches(splat, reach_of(splat), vec2<f32>(tile)) {
        let place = atomicAdd(&found[thread], 1u);
        if place < rooms[thread] {
            tiles[firsts[thread] + place] = tile.y * view.tile_columns + tile.x;
            entries[firsts[thread] + place] = name;
        }
    }
}

@compute @workgroup_size(WORKGROUP)
fn intersect(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let group = group_index(workgroup);
    let visible = counters[0];
    if group * WORKGROUP >= visible {
        return;
    }
    let i = group * WORKGROUP + local;
    let there = i < visible;
    var room = 0u;
    if there && task.emits != 0u {
        room = counts[i];
    }
    var first = scan(local, room).x;
    if task.emits != 0u {
        first += sums[group];
        // What does not fit is left out, and the frame made again.
        room = min(room, max(view.entry_capacity, first) - first);
    }
    firsts[local] = first;
    rooms[local] = room;
    atomicStore(&found[local], 0u);
    if local == 0u {
        atomicStore(&large_count, 0u);
    }
    workgroupBarrier();

    if there {
        let name = order[i];
        let splat = records[name];
        let around = box_of(splat);
        let count = around.size.x * around.size.y;
        if count > FEW_TILES {
            large[atomicAdd(&large_count, 1u)] = local;
        } else {
            for (var tile = 0u; tile < count; tile++) {
                add(local, name, splat, around, tile);
            }
        }
    }
    // Large ones are the work of all threads: one alone would keep the others waiting.
    let many = workgroupUniformLoad(&large_count);
    for (var k = 0u; k < many; k++) {
        let thread = large[k];
        let name = order[group * WORKGROUP + thread];
        let splat = records[name];
        let around = box_of(splat);
        for (var tile = local; tile < around.size.x * around.size.y; tile += WORKGROUP) {
            add(thread, name, splat, around, tile);
        }
    }
    workgroupBarrier();
    let own = atomicLoad(&found[local]);
    let total = scan(local, own).y;
    if task.emits == 0u {
        if there {
            counts[i] = own;
        }
        if local == 0u {
            sums[group] = total;
        }
    }
}
