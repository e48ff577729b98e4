// The packets that each splat touches, as `cpu.rs` finds them. One entry point counts them and then
// writes them: two would be compiled apart, and might round apart. It counts in the order of the
// records, and writes in the order of their distances.

struct Cone {
    axis: vec3<f32>,
    // Far below 0 for a half space and more.
    cos: f32,
    sin: f32,
}

@group(0) @binding(1) var<uniform> view: View;
@group(0) @binding(2) var<storage, read> counters: array<u32, 4>;
@group(0) @binding(3) var<storage, read> records: array<RayRecord>;
// Level by level, the packets' own first.
@group(0) @binding(4) var<storage, read> cones: array<Cone>;
// The records that touch a packet, by distance.
@group(0) @binding(5) var<storage, read> order: array<u32>;
// The number of packets that each record touches.
@group(0) @binding(6) var<storage, read_write> counts: array<u32>;
// While it counts, how many of a block of records touch any, in its first word; while it writes,
// the entries before each 256 of the order.
@group(0) @binding(7) var<storage, read_write> sums: array<u32>;
// Packet and record of each entry.
@group(0) @binding(8) var<storage, read_write> packets: array<u32>;
@group(0) @binding(9) var<storage, read_write> entries: array<u32>;

// Cones of a level.
fn size_of(level: u32) -> u32 {
    let each = 1u << (CHILD_BITS * level);
    return (task.packets + each - 1u) / each;
}

// Walks the tree from left to right, without a stack: the children of cone `i` are those from
// CHILDREN i on. Writes the packets from `place` on, as far as there is room, if this is asked for;
// returns their number.
fn touched(name: u32, place: u32, room: u32) -> u32 {
    let record = records[name];
    let way = record.mean - task.center;
    let distance = length(way);
    let reach = record.reach + task.radius;
    // Of a splat that holds the middle, which may be met in any direction. Phrased so that what is
    // no number is tested nowhere else.
    let is_inside = !(distance > reach);
    let tangent = sqrt(max((distance + reach) * (distance - reach), 0.0));
    let slack = RAY_SLACK * distance;
    var level = task.top;
    var at = task.top_at;
    var i = 0u;
    var found = 0u;
    loop {
        let begin = i << (CHILD_BITS * level);
        if i >= size_of(level) || begin >= task.end {
            break;
        }
        var is_touched = begin + (1u << (CHILD_BITS * level)) > task.first;
        if is_touched && !is_inside {
            let cone = cones[at + i];
            is_touched = dot(way, cone.axis) + slack >= cone.cos * tangent - cone.sin * reach;
        }
        if is_touched && level > 0u {
            level--;
            at -= size_of(level);
            i = i << CHILD_BITS;
            continue;
        }
        if is_touched {
            if task.emits != 0u && found < room {
                packets[place + found] = i - task.first;
                entries[place + found] = name;
            }
            found++;
        }
        i++;
        while level < task.top && (i & (CHILDREN - 1u)) == 0u {
            i = i >> CHILD_BITS;
            at += size_of(level);
            level++;
        }
    }
    return found;
}

@compute @workgroup_size(WORKGROUP)
fn touch(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let block = group_index(workgroup);
    var total = task.records;
    if task.emits != 0u {
        total = counters[0];
    }
    if block * WORKGROUP >= total {
        return;
    }
    let i = block * WORKGROUP + local;
    let there = i < total;
    var name = i;
    var room = 0u;
    if there && task.emits != 0u {
        name = order[i];
        room = counts[name];
    }
    var first = scan(local, room).x;
    if task.emits != 0u {
        first += sums[block];
        // What does not fit is left out, and these packets are traced again.
        room = min(room, max(view.entry_capacity, first) - first);
    }
    var found = 0u;
    if there {
        found = touched(name, first, room);
    }
    let met = scan(local, select(0u, 1u, found > 0u)).y;
    if task.emits == 0u {
        if there {
            counts[i] = found;
        }
        if local == 0u {
            sums[block * BLOCK_WORDS] = met;
        }
    }
}
