// The derivative of blending: a workgroup of 64 threads per tile, a block of 2x2 px per thread; see
// the contract in `mod.rs`. Sums over pixels are added in a fixed order: four in the thread, then
// those of the threads, by `shared.wgsl` or `subgroups.wgsl`, which have the entry point, and by
// `SPLATS_PER_SUM` splats at a time.

const THREADS: u32 = 64u;
// A slot as vectors.
const SLOT_VECTORS: u32 = 4u;

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> tile_offsets: array<u32>;
// The pair of each entry of the sorted lists, and the record of each pair.
@group(0) @binding(2) var<storage, read> pairs: array<u32>;
@group(0) @binding(3) var<storage, read> names: array<u32>;
// The records as four vectors each.
@group(0) @binding(4) var<storage, read> records: array<vec4<f32>>;
// See `upstream.wgsl`.
@group(0) @binding(5) var<storage, read> states: array<vec4<f32>>;
// `[pairs, 4]`: the numbers of `Slot`.
@group(0) @binding(6) var<storage, read_write> slots: array<vec4<f32>>;

var<workgroup> batch: array<array<vec4<f32>, 4>, BATCH>;
var<workgroup> batch_pairs: array<u32, BATCH>;
// Pixels that still take light.
var<workgroup> open: atomic<u32>;

// Four pixels.
struct Block {
    x: vec4<f32>,
    y: vec4<f32>,
    // 0 for pixels that have stopped or are outside the picture.
    transmittance: vec4<f32>,
    remaining: vec4<f32>,
    // Derivatives by the sums.
    by_rgb: array<vec4<f32>, 3>,
    by_depth: vec4<f32>,
    by_normal: array<vec4<f32>, 3>,
}

fn sum(values: vec4<f32>) -> f32 {
    return (values.x + values.y) + (values.z + values.w);
}

// The numbers of a slot.
struct Sums {
    // Whether one of the pixels sees the splat; else all are 0.
    seen: bool,
    numbers: array<vec4<f32>, 4>,
}

// One splat blended over the block once more: what its pixels pull on it.
fn replay(block: ptr<function, Block>, splat: array<vec4<f32>, 4>) -> Sums {
    var sums: Sums;
    let a = splat[0];
    let b = splat[1];
    let c = splat[2];
    let dx = (*block).x - a.x;
    let u = a.z * dx;
    let v = a.w * dx + b.x * ((*block).y - a.y);
    let q = b.y - u * u - v * v;
    let seen = (q >= vec4<f32>(LOG2_MIN_ALPHA)) & ((*block).transmittance > vec4<f32>(0.0));
    if !any(seen) {
        return sums;
    }
    sums.seen = true;
    let alpha = select(vec4<f32>(0.0), exp2(min(q, vec4<f32>(LOG2_MAX_ALPHA))), seen);
    let before = (*block).transmittance;
    let next = before - alpha * before;
    let takes = next > vec4<f32>(MIN_TRANSMITTANCE);
    let weight = select(vec4<f32>(0.0), alpha * before, takes);
    var value = vec4<f32>(0.0);
    if COLOR {
        value += (*block).by_rgb[0] * b.z + (*block).by_rgb[1] * b.w + (*block).by_rgb[2] * c.x;
    }
    if DEPTH {
        value += (*block).by_depth * c.y;
    }
    if NORMAL {
        value += (*block).by_normal[0] * c.z + (*block).by_normal[1] * c.w + (*block).by_normal[2] * splat[3].x;
    }
    let own = weight * value;
    let remaining = (*block).remaining - own;
    (*block).remaining = remaining;
    (*block).transmittance = select(vec4<f32>(0.0), next, takes);
    // Where alpha is held at its limit nothing pulls on it.
    let pulls = takes & (q < vec4<f32>(LOG2_MAX_ALPHA));
    let pull = select(vec4<f32>(0.0), own - alpha / (1.0 - alpha) * remaining, pulls);

    let by_u = pull * u;
    let by_v = pull * v;
    sums.numbers[0] = vec4<f32>(sum(pull), sum(by_u), sum(by_v), dot(by_u, u));
    sums.numbers[1] = vec4<f32>(dot(by_u, v), dot(by_v, v), sum(abs(by_u * a.z + by_v * a.w)), sum(abs(by_v)));
    sums.numbers[2].x = sum(weight);
    if COLOR {
        sums.numbers[2].y = dot(weight, (*block).by_rgb[0]);
        sums.numbers[2].z = dot(weight, (*block).by_rgb[1]);
        sums.numbers[2].w = dot(weight, (*block).by_rgb[2]);
    }
    if DEPTH {
        sums.numbers[3].x = dot(weight, (*block).by_depth);
    }
    if NORMAL {
        sums.numbers[3].y = dot(weight, (*block).by_normal[0]);
        sums.numbers[3].z = dot(weight, (*block).by_normal[1]);
        sums.numbers[3].w = dot(weight, (*block).by_normal[2]);
    }
    return sums;
}

fn replay_tile(tile: u32, local: u32) {
    if tile >= view.tiles {
        return;
    }
    let corner = vec2<u32>(tile % view.tile_columns, tile / view.tile_columns) * u32(TILE_SIDE)
        + 2u * vec2<u32>(local % 8u, local / 8u);
    var block: Block;
    for (var k = 0u; k < 4u; k++) {
        let pixel = corner + vec2<u32>(k % 2u, k / 2u);
        block.x[k] = f32(pixel.x) + 0.5;
        block.y[k] = f32(pixel.y) + 0.5;
        if pixel.x < view.width && pixel.y < view.height {
            let at = 2u * (pixel.y * view.width + pixel.x);
            let first = states[at];
            let second = states[at + 1u];
            block.transmittance[k] = 1.0;
            block.remaining[k] = second.w;
            block.by_depth[k] = first.w;
            block.by_rgb[0][k] = first.x;
            block.by_rgb[1][k] = first.y;
            block.by_rgb[2][k] = first.z;
            block.by_normal[0][k] = second.x;
            block.by_normal[1][k] = second.y;
            block.by_normal[2][k] = second.z;
        }
    }

    let end = tile_offsets[tile + 1u];
    var first = tile_offsets[tile];
    while first < end {
        let size = min(BATCH, end - first);
        if local < size {
            let pair = pairs[first + local];
            let record = 4u * names[pair];
            batch_pairs[local] = pair;
            for (var k = 0u; k < SLOT_VECTORS; k++) {
                batch[local][k] = records[record + k];
            }
        }
        if local == 0u {
            atomicStore(&open, 0u);
        }
        workgroupBarrier();
        for (var i = 0u; i < size; i += SPLATS_PER_SUM) {
            for (var j = 0u; j < SPLATS_PER_SUM; j++) {
                var sums: Sums;
                if i + j < size {
                    sums = replay(&block, batch[i + j]);
                }
                keep(local, j, sums);
            }
            add_up(local, i, size);
        }
        if any(block.transmittance > vec4<f32>(0.0)) {
            atomicStore(&open, 1u);
        }
        first += size;
        if workgroupUniformLoad(&open) == 0u {
            break;
        }
    }
    // What no pixel sees is pulled by none.
    for (var i = first + local; i < end; i += THREADS) {
        for (var k = 0u; k < SLOT_VECTORS; k++) {
            slots[SLOT_VECTORS * pairs[i] + k] = vec4<f32>(0.0);
        }
    }
}
