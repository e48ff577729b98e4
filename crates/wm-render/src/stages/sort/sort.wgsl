// Stable radix sort of (key, value) pairs by eight bits of the keys, least significant first:
// count, scan, scatter. Three dispatches, none of whose workgroups waits for another, and no
// subgroups.

struct Pass {
    // First of the eight bits.
    shift: u32,
    // 0 for the splats in view, 1 for the entries of the tile lists.
    of_entries: u32,
    // 1 where each value is its own index, not yet written.
    numbered: u32,
}

@group(0) @binding(0) var<uniform> digits: Pass;
@group(0) @binding(1) var<storage, read> counters: array<u32, 4>;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read> values: array<u32>;
// `[DIGITS][blocks]`: how many of a block have a digit, then how many of the blocks before.
@group(0) @binding(4) var<storage, read_write> histogram: array<u32>;
// How many have a digit, of all blocks.
@group(0) @binding(5) var<storage, read_write> totals: array<u32>;
@group(0) @binding(6) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(7) var<storage, read_write> sorted_values: array<u32>;

fn pairs() -> u32 {
    return counters[digits.of_entries];
}

fn block_count() -> u32 {
    return (pairs() + SORT_BLOCK - 1u) / SORT_BLOCK;
}

fn digit(key: u32) -> u32 {
    return (key >> digits.shift) & (DIGITS - 1u);
}

var<workgroup> counts: array<atomic<u32>, DIGITS>;

@compute @workgroup_size(WORKGROUP)
fn count(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let block = group_index(workgroup);
    if block >= block_count() {
        return;
    }
    atomicStore(&counts[local], 0u);
    workgroupBarrier();
    for (var round = 0u; round < SORT_ROUNDS; round++) {
        let i = block * SORT_BLOCK + round * WORKGROUP + local;
        if i < pairs() {
            atomicAdd(&counts[digit(keys[i])], 1u);
        }
    }
    workgroupBarrier();
    histogram[local * block_count() + block] = atomicLoad(&counts[local]);
}

// One workgroup a digit.
@compute @workgroup_size(WORKGROUP)
fn scan_digits(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let blocks = block_count();
    var before = 0u;
    for (var first = 0u; first < blocks; first += WORKGROUP) {
        let block = first + local;
        let at = workgroup.x * blocks + block;
        var own = 0u;
        if block < blocks {
            own = histogram[at];
        }
        let scanned = scan(local, own);
        if block < blocks {
            histogram[at] = before + scanned.x;
        }
        before += scanned.y;
    }
    if local == 0u {
        totals[workgroup.x] = before;
    }
}

// Where the next pair of each digit goes.
var<workgroup> places: array<u32, DIGITS>;
// `[8][DIGITS]`: a bit for each thread that holds the digit. Ranks from bits are those of the order
// of threads.
var<workgroup> holders: array<atomic<u32>, 2048>;

@compute @workgroup_size(WORKGROUP)
fn scatter(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let block = group_index(workgroup);
    if block >= block_count() {
        return;
    }
    let below = scan(local, totals[local]).x;
    places[local] = below + histogram[local * block_count() + block];
    for (var word = 0u; word < 8u; word++) {
        atomicStore(&holders[word * DIGITS + local], 0u);
    }
    workgroupBarrier();
    for (var round = 0u; round < SORT_ROUNDS; round++) {
        let i = block * SORT_BLOCK + round * WORKGROUP + local;
        let there = i < pairs();
        var key = 0u;
        if there {
            key = keys[i];
            atomicOr(&holders[local / 32u * DIGITS + digit(key)], 1u << (local % 32u));
        }
        workgroupBarrier();
        if there {
            let own = digit(key);
            var place = places[own];
            for (var word = 0u; word < local / 32u; word++) {
                place += countOneBits(atomicLoad(&holders[word * DIGITS + own]));
            }
            let before = (1u << (local % 32u)) - 1u;
            place += countOneBits(atomicLoad(&holders[local / 32u * DIGITS + own]) & before);
            var value = i;
            if digits.numbered == 0u {
                value = values[i];
            }
            sorted_keys[place] = key;
            sorted_values[place] = value;
        }
        workgroupBarrier();
        // Each thread looks after one digit.
        var held = 0u;
        for (var word = 0u; word < 8u; word++) {
            held += countOneBits(atomicExchange(&holders[word * DIGITS + local], 0u));
        }
        places[local] += held;
        workgroupBarrier();
    }
}
