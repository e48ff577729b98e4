// Blends the lists of packets: a workgroup per packet, a thread per ray. See the contract in
// `mod.rs`.

@group(0) @binding(1) var<storage, read> offsets: array<u32>;
@group(0) @binding(2) var<storage, read> entries: array<u32>;
@group(0) @binding(3) var<storage, read> records: array<RayRecord>;
@group(0) @binding(4) var<storage, read> features: array<f32>;
// Direction and 1, or 0 for what pads a packet; offset of the origin from the middle of the group.
@group(0) @binding(5) var<storage, read> rays: array<vec4<f32>>;
// `[rays][4 + FEATURES]`, bits of floats: coverage, distance; then the splat; then the sums of
// values and of features.
@group(0) @binding(6) var<storage, read_write> hits: array<u32>;
@group(0) @binding(7) var<storage, read_write> counters: Counters;

// `M` times the way from the mean to the middle of the group; log2 of the opacity.
var<workgroup> middles: array<vec4<f32>, PACKET>;
var<workgroup> rows: array<array<vec3<f32>, 3>, PACKET>;
var<workgroup> indices: array<u32, PACKET>;
var<workgroup> values: array<f32, PACKET>;
var<workgroup> seen: array<array<vec3<f32>, 2>, PACKET>;
// Rays that still go on.
var<workgroup> open: atomic<u32>;

// A splat that may be the hit, as `cpu.rs` keeps them.
struct Hit {
    // Transmittance behind it.
    after: f32,
    distance: f32,
    splat: u32,
}

const INFINITY: u32 = 0x7f800000u;
const NO_SPLAT: u32 = 0xffffffffu;

@compute @workgroup_size(PACKET)
fn blend(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let packet = group_index(workgroup);
    if packet >= task.end - task.first {
        return;
    }
    let ray = packet * PACKET + local;
    let direction = rays[2u * ray].xyz;
    let offset = rays[2u * ray + 1u].xyz;
    var transmittance = rays[2u * ray].w;
    var coverage = 0.0;
    var value = 0.0;
    var sums = array<vec3<f32>, 2>(vec3<f32>(0.0), vec3<f32>(0.0));
    var kept: array<Hit, HITS>;
    var kept_count = 0u;
    let begin = offsets[packet];
    let end = offsets[packet + 1u];
    if local == 0u {
        // The longest list: loops in software end early.
        atomicMax(&counters.walked, end - begin);
    }
    for (var first = begin; first < end; first += PACKET) {
        let size = min(PACKET, end - first);
        if local < size {
            let name = entries[first + local];
            let record = records[name];
            let away = task.center - record.mean;
            let middle = vec3<f32>(dot(record.row_0, away), dot(record.row_1, away), dot(record.row_2, away));
            middles[local] = vec4<f32>(middle, record.log2_opacity);
            rows[local][0] = record.row_0;
            rows[local][1] = record.row_1;
            rows[local][2] = record.row_2;
            indices[local] = record.index;
            values[local] = record.value;
            for (var k = 0u; 3u * k < FEATURES; k++) {
                let at = FEATURES * name + 3u * k;
                seen[local][k] = vec3<f32>(features[at], features[at + 1u], features[at + 2u]);
            }
        }
        if local == 0u {
            atomicStore(&open, 0u);
        }
        workgroupBarrier();
        if transmittance > 0.0 {
            for (var k = 0u; k < size; k++) {
                let row = rows[k];
                var a = middles[k].xyz;
                if task.radius > 0.0 {
                    a += vec3<f32>(dot(row[0], offset), dot(row[1], offset), dot(row[2], offset));
                }
                let b = vec3<f32>(dot(row[0], direction), dot(row[1], direction), dot(row[2], direction));
                let normal = cross(a, b);
                let across = dot(normal, normal);
                let square = dot(b, b);
                let along = dot(a, b);
                let log2_opacity = middles[k].w;
                if across <= square * (log2_opacity - LOG2_MIN_ALPHA) && along < 0.0 {
                    let alpha = exp2(min(log2_opacity - across / square, LOG2_MAX_ALPHA));
                    let after = transmittance * (1.0 - alpha);
                    if after <= MIN_TRANSMITTANCE {
                        transmittance = 0.0;
                        break;
                    }
                    let weight = alpha * transmittance;
                    if transmittance > LEAST_HIT && after <= SOONEST_HIT {
                        kept[min(kept_count, HITS - 1u)] = Hit(after, -along / square, indices[k]);
                        kept_count++;
                    }
                    coverage += weight;
                    value += weight * values[k];
                    for (var j = 0u; 3u * j < FEATURES; j++) {
                        sums[j] += weight * seen[k][j];
                    }
                    transmittance = after;
                }
            }
        }
        if transmittance > 0.0 {
            atomicStore(&open, 1u);
        }
        if workgroupUniformLoad(&open) == 0u {
            break;
        }
    }

    var distance = INFINITY;
    var splat = NO_SPLAT;
    if coverage >= LEAST_HIT {
        let half = select(LEAST_HIT, 0.5 * coverage, coverage < WHOLE);
        // More than are kept are faint ones close to each other: the last that is kept stands for
        // them.
        for (var k = 0u; k < min(kept_count, HITS); k++) {
            distance = bitcast<u32>(kept[k].distance);
            splat = kept[k].splat;
            if kept[k].after <= 1.0 - half {
                break;
            }
        }
    }
    let at = (4u + FEATURES) * ray;
    hits[at] = bitcast<u32>(coverage);
    hits[at + 1u] = distance;
    hits[at + 2u] = splat;
    hits[at + 3u] = bitcast<u32>(value);
    for (var j = 0u; j < FEATURES; j++) {
        hits[at + 4u + j] = bitcast<u32>(sums[j / 3u][j % 3u]);
    }
}
