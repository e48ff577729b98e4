// Which tiles each splat touches. One entry point counts them and then writes them: two would be
// compiled apart, and might round apart. A splat's entries are row by row, so that what is summed
// over them is summed in one order.

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
// How many tiles each touches, by depth; once they are written, where its entries end.
@group(0) @binding(5) var<storage, read_write> counts: array<u32>;
// The same of 256 at a time; after the scan, of those before.
@group(0) @binding(6) var<storage, read_write> sums: array<u32>;
// Tile and record of each entry.
@group(0) @binding(7) var<storage, read_write> tiles: array<u32>;
@group(0) @binding(8) var<storage, read_write> entries: array<u32>;

// Whether alpha reaches 1/255 in the rectangle of a tile's pixel centres: the greatest alpha is on
// one of the two edges that face the centre.
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

// What each thread's splat has: where its entries go, how many there is room for.
var<workgroup> firsts: array<u32, WORKGROUP>;
var<workgroup> rooms: array<u32, WORKGROUP>;
// Threads whose splats have more tiles about them than FEW, and how many tiles these touch.
var<workgroup> large: array<u32, WORKGROUP>;
var<workgroup> large_count: atomic<u32>;
var<workgroup> large_found: array<u32, WORKGROUP>;
// Of 256 tiles a bit for each that is touched.
var<workgroup> touched: array<atomic<u32>, WORKGROUP / 32u>;

// Tile number `i` of a box.
fn tile_of(around: Box, i: u32) -> vec2<u32> {
    return around.first + vec2<u32>(i % around.size.x, i / around.size.x);
}

// Writes entry number `place` of a thread's splat, if there is room.
fn write(thread: u32, name: u32, tile: vec2<u32>, place: u32) {
    if place < rooms[thread] {
        tiles[firsts[thread] + place] = tile.y * view.tile_columns + tile.x;
        entries[firsts[thread] + place] = name;
    }
}

// The work of all threads: one alone would keep the others waiting.
fn all_tiles_of(thread: u32, name: u32, local: u32) {
    let splat = records[name];
    let around = box_of(splat);
    var found = 0u;
    for (var first = 0u; first < around.size.x * around.size.y; first += WORKGROUP) {
        if local < WORKGROUP / 32u {
            atomicStore(&touched[local], 0u);
        }
        workgroupBarrier();
        let tile = tile_of(around, first + local);
        let is_there = first + local < around.size.x * around.size.y;
        let is_touched = is_there && touches(splat, reach_of(splat), vec2<f32>(tile));
        if is_touched {
            atomicOr(&touched[local / 32u], 1u << (local % 32u));
        }
        workgroupBarrier();
        var before = 0u;
        var all = 0u;
        for (var word = 0u; word < WORKGROUP / 32u; word++) {
            let bits = atomicLoad(&touched[word]);
            let own = select(0u, (1u << (local % 32u)) - 1u, word == local / 32u);
            before += countOneBits(bits & select(own, 0xffffffffu, word < local / 32u));
            all += countOneBits(bits);
        }
        if is_touched {
            write(thread, name, tile, found + before);
        }
        found += all;
        workgroupBarrier();
    }
    if local == 0u {
        large_found[thread] = found;
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
    if local == 0u {
        atomicStore(&large_count, 0u);
    }
    workgroupBarrier();

    var own = 0u;
    var is_large = false;
    if there {
        let name = order[i];
        let splat = records[name];
        let around = box_of(splat);
        let count = around.size.x * around.size.y;
        is_large = count > FEW_TILES;
        if is_large {
            large[atomicAdd(&large_count, 1u)] = local;
        } else {
            for (var k = 0u; k < count; k++) {
                let tile = tile_of(around, k);
                if touches(splat, reach_of(splat), vec2<f32>(tile)) {
                    write(local, name, tile, own);
                    own++;
                }
            }
        }
    }
    let many = workgroupUniformLoad(&large_count);
    for (var k = 0u; k < many; k++) {
        let thread = workgroupUniformLoad(&large[k]);
        all_tiles_of(thread, order[group * WORKGROUP + thread], local);
    }
    workgroupBarrier();
    if is_large {
        own = large_found[local];
    }
    let total = scan(local, own).y;
    if task.emits == 0u {
        if there {
            counts[i] = own;
        }
        if local == 0u {
            sums[group] = total;
        }
    } else if there {
        counts[i] = first + room;
    }
}
