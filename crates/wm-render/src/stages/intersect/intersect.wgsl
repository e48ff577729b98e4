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

// First and last x, from the centre, of the ellipse within `low` <= y <= `high`, a pixel more each way. The ellipse
// reaches some y there; its ends are where they are in all, or at the edge of the strip that is next to that.
fn span(splat: Record, reach: f32, extent_x: f32, low: f32, high: f32) -> vec2<f32> {
    let square = splat.a.z * splat.a.z + splat.a.w * splat.a.w;
    let y = clamp(vec2<f32>(-1.0, 1.0) * (splat.d.y * extent_x), vec2<f32>(low), vec2<f32>(high));
    let across = splat.a.z * splat.b.x * y;
    let half = sqrt(max(reach * square - across * across, vec2<f32>(0.0))) / square;
    let ends = splat.d.z * y + vec2<f32>(-1.0, 1.0) * half;
    return ends + vec2<f32>(-1.0, 1.0);
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

    var found = 0u;
    if there {
        let name = order[i];
        let splat = records[name];
        let reach = splat.b.y - (LOG2_MIN_ALPHA - TEST_SLACK);
        let extent_x = sqrt(max(reach, 0.0)) / splat.a.z;
        let across = splat.a.w / splat.a.z;
        let extent_y = sqrt(max(reach, 0.0) * (1.0 + across * across)) / splat.b.x;
        // A pixel more each way: the test below is the exact one.
        let extent = vec2<f32>(extent_x, extent_y) + 1.0;
        let last_tile = vec2<f32>(f32(view.tile_columns), f32(view.tiles / view.tile_columns)) - 1.0;
        let low = clamp(floor((splat.a.xy - extent) / TILE_SIDE), vec2<f32>(0.0), last_tile);
        let high = clamp(floor((splat.a.xy + extent) / TILE_SIDE), vec2<f32>(0.0), last_tile);
        for (var y = u32(low.y); y <= u32(high.y); y++) {
            let top = f32(y) * TILE_SIDE + 0.5 - splat.a.y;
            let ends = splat.a.x + span(splat, reach, extent_x, top, top + (TILE_SIDE - 1.0));
            let columns = clamp(floor(ends / TILE_SIDE), vec2<f32>(low.x), vec2<f32>(high.x));
            for (var x = u32(columns.x); x <= u32(columns.y); x++) {
                if touches(splat, reach, vec2<f32>(f32(x), f32(y))) {
                    if found < room {
                        tiles[first + found] = y * view.tile_columns + x;
                        entries[first + found] = name;
                    }
                    found++;
                }
            }
        }
    }
    let total = scan(local, found).y;
    if task.emits == 0u {
        if there {
            counts[i] = found;
        }
        if local == 0u {
            sums[group] = total;
        }
    }
}
