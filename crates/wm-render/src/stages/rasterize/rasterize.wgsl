// Front-to-back blending: a workgroup for each tile, a thread for each pixel. See the contract in
// `mod.rs`. Depth and normal are finished here, by the contract of the composite, except in
// training, which keeps the sums.

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> tile_offsets: array<u32>;
@group(0) @binding(2) var<storage, read> entries: array<u32>;
// The records as four vectors each.
@group(0) @binding(3) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> rgb: array<f32>;
@group(0) @binding(5) var<storage, read_write> alpha: array<f32>;
// Expected depths, then median depths, then the reciprocal depths of the surface (0 for none), then
// the sums that it splits, FRONT_CHANNELS numbers per pixel. They share a buffer, since portable
// adapters have eight storage buffers and no more.
@group(0) @binding(6) var<storage, read_write> depths: array<f32>;
@group(0) @binding(7) var<storage, read_write> normal: array<f32>;

var<workgroup> batch: array<array<vec4<f32>, 4>, BATCH>;
// Pixels that still take light.
var<workgroup> open: atomic<u32>;

@compute @workgroup_size(WORKGROUP)
fn rasterize(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let tile = group_index(workgroup);
    if tile >= view.tiles {
        return;
    }
    // Blocks of 8x4 px, so that threads side by side skip the same splats.
    let within = vec2<u32>((local & 7u) | ((local >> 2u) & 8u), ((local >> 3u) & 3u) | ((local >> 4u) & 12u));
    let corner = vec2<u32>(tile % view.tile_columns, tile / view.tile_columns) * u32(TILE_SIDE);
    let pixel = corner + within;
    let inside = pixel.x < view.width && pixel.y < view.height;
    let center = vec2<f32>(pixel) + 0.5;

    // A pixel that has stopped carries transmittance 0, so one comparison does for both.
    var transmittance = select(0.0, 1.0, inside);
    var coverage = 0.0;
    var color = vec3<f32>(0.0);
    var depth_sum = 0.0;
    var normal_sum = vec3<f32>(0.0);
    var median = 0.0;
    var surface = 0.0;
    var front_color = vec3<f32>(0.0);
    var behind_depth = 0.0;
    var front_coverage = 0.0;
    if SPLIT && inside {
        surface = depths[SURFACE_PLANE * view.width * view.height + pixel.y * view.width + pixel.x];
    }
    let begin = tile_offsets[tile];
    let end = tile_offsets[tile + 1u];
    for (var first = begin; first < end; first += BATCH) {
        let size = min(BATCH, end - first);
        // Four threads per record, each a quarter.
        if local / 4u < size {
            batch[local / 4u][local % 4u] = records[4u * listed(first + local / 4u) + local % 4u];
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
                    let weight = own * transmittance;
                    let c = batch[k][2];
                    if MEDIAN && transmittance > 0.5 {
                        median = c.y;
                    }
                    coverage += weight;
                    if COLOR {
                        color += weight * vec3<f32>(b.zw, c.x);
                    }
                    if DEPTH {
                        depth_sum += weight * c.y;
                    }
                    if SPLIT {
                        let word = bitcast<u32>(batch[k][3].w);
                        let slopes = bitcast<vec2<f32>>(vec2<u32>(word & 0xffff0000u, word << 16u));
                        let reciprocal = 1.0 / c.y + dot(slopes, d);
                        if surface == 0.0 || reciprocal > surface {
                            front_color += weight * vec3<f32>(b.zw, c.x);
                            front_coverage += weight;
                        } else {
                            behind_depth += weight * max(reciprocal, 0.0);
                        }
                    }
                    if NORMAL {
                        normal_sum += weight * vec3<f32>(c.zw, batch[k][3].x);
                    }
                    transmittance = next;
                }
            }
        }
        if transmittance > 0.0 {
            atomicStore(&open, 1u);
        }
        if local == 0u {
            walk(size);
        }
        if workgroupUniformLoad(&open) == 0u {
            break;
        }
    }

    if !inside {
        return;
    }
    let at = pixel.y * view.width + pixel.x;
    alpha[at] = coverage;
    let covered = coverage >= FRAME_MIN_ALPHA;
    let squared = dot(normal_sum, normal_sum);
    var depth = depth_sum;
    var unit = normal_sum;
    if !KEEPS_SUMS {
        depth = select(0.0, depth_sum / max(coverage, FRAME_MIN_ALPHA), covered);
        unit = normal_sum * select(0.0, inverseSqrt(max(squared, 1e-20)), covered && squared > 1e-20);
    }
    for (var k = 0u; k < 3u; k++) {
        if COLOR {
            rgb[3u * at + k] = color[k];
        }
        if NORMAL {
            normal[3u * at + k] = unit[k];
        }
    }
    if DEPTH {
        depths[at] = depth;
    }
    if SPLIT {
        let column = at % view.width;
        let group = column / FRONT_GROUP * FRONT_GROUP;
        let count = min(FRONT_GROUP, view.width - group);
        let first = at - column + group;
        let front = (SURFACE_PLANE + 1u) * view.width * view.height + FRONT_CHANNELS * first + column - group;
        depths[front] = front_color.x;
        depths[front + count] = front_color.y;
        depths[front + 2u * count] = front_color.z;
        depths[front + 3u * count] = behind_depth;
        depths[front + 4u * count] = front_coverage;
    }
    if MEDIAN {
        depths[view.width * view.height + at] = select(0.0, median, coverage >= 0.5);
    }
}
