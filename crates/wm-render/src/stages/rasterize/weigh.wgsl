// The weights of records, summed over the pixels: a workgroup per tile, a thread per pixel. What is
// blended is what `rasterize.wgsl` blends. Sums are whole numbers: they do not depend on the order
// of the threads.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> tile_offsets: array<u32>;
@group(0) @binding(2) var<storage, read> entries: array<u32>;
// The records as four vectors each.
@group(0) @binding(3) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> weights: array<atomic<u32>>;

// A pixel counts finer than what is told of a tile: many small weights are not lost.
const FINER = 16.0;

var<workgroup> batch: array<array<vec4<f32>, 2>, BATCH>;
var<workgroup> sums: array<atomic<u32>, BATCH>;
// Pixels that still take light.
var<workgroup> open: atomic<u32>;

@compute @workgroup_size(WORKGROUP)
fn weigh(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let tile = group_index(workgroup);
    if tile >= view.tiles {
        return;
    }
    let within = vec2<u32>((local & 7u) | ((local >> 2u) & 8u), ((local >> 3u) & 3u) | ((local >> 4u) & 12u));
    let corner = vec2<u32>(tile % view.tile_columns, tile / view.tile_columns) * u32(TILE_SIDE);
    let pixel = corner + within;
    let inside = pixel.x < view.width && pixel.y < view.height;
    let center = vec2<f32>(pixel) + 0.5;

    var transmittance = select(0.0, 1.0, inside);
    let begin = tile_offsets[tile];
    let end = tile_offsets[tile + 1u];
    for (var first = begin; first < end; first += BATCH) {
        let size = min(BATCH, end - first);
        if local / 2u < size {
            batch[local / 2u][local % 2u] = records[4u * entries[first + local / 2u] + local % 2u];
        }
        if local < BATCH {
            atomicStore(&sums[local], 0u);
        }
        if local == 0u {
            atomicStore(&open, 0u);
        }
        workgroupBarrier();
        if transmittance > 0.0 {
            for (var k = 0u; k < size; k++) {
                let a = batch[k][0];
                let b = batch[k][1];
                let d = center - a.xy;
                let u = a.z * d.x;
                let v = a.w * d.x + b.x * d.y;
                let q = b.y - u * u - v * v;
                if q >= LOG2_MIN_ALPHA {
                    let own = exp2(min(q, LOG2_MAX_ALPHA));
                    let next = transmittance - own * transmittance;
                    if next <= MIN_TRANSMITTANCE {
                        transmittance = 0.0;
                        break;
                    }
                    atomicAdd(&sums[k], u32(own * transmittance * (WEIGHT_UNITS * FINER) + 0.5));
                    transmittance = next;
                }
            }
        }
        if transmittance > 0.0 {
            atomicStore(&open, 1u);
        }
        workgroupBarrier();
        if local < size {
            let units = u32(f32(atomicLoad(&sums[local])) / FINER + 0.5);
            if units > 0u {
                atomicAdd(&weights[entries[first + local]], units);
            }
        }
        if workgroupUniformLoad(&open) == 0u {
            break;
        }
    }
}
