// Light in air, as `optics.rs` has it: layers that thin upwards, less what of them is drawn drop by
// drop.
//
// `air`: number of layers and of tables; metres a scene unit; up, three numbers. Then of each
// layer: extinction a metre times log2(e), three; airlight, three; density at the camera; 1 / scale
// height, 0 for none. Then of each table: airlight, three; mean extinction and its growth to the
// next node, NODES times.

const AIR_HEAD: u32 = 6u;
const AIR_LAYER: u32 = 8u;
const AIR_TABLE: u32 = 3u + 2u * NODES;

// `(1 - e^-x) / x`: mean density along a ray that rises through `x` scale heights.
fn mean_density(x: f32) -> f32 {
    // The quotient loses digits at small x, the series at large: they meet where both have six.
    let small = 1.0 + x * (-0.5 + x * (1.0 / 6.0 + x * (-1.0 / 24.0 + x * (1.0 / 120.0 - x / 720.0))));
    let decay = exp2(clamp(x * -LOG2E, -126.0, 126.0));
    let large = (1.0 - decay) / select(x, 1.0, x == 0.0);
    return select(large, small, x * x < 0.25 * 0.25);
}

// Optical depth of what a table says is drawn over `metres`.
fn drawn_depth(table: u32, metres: f32) -> f32 {
    let within = min(metres, TABLE_FAR);
    // A float's exponent and its next three bits are the number of its node.
    let bits = bitcast<u32>(max(within, TABLE_NEAR));
    let share = bitcast<f32>(((bits & 0xfffffu) << 3u) | 0x3f800000u) - 1.0;
    let node = min((bits >> 20u) - (bitcast<u32>(TABLE_NEAR) >> 20u), NODES - 1u);
    let at = table + 3u + 2u * node;
    return (air[at] + air[at + 1u] * share) * within;
}

fn air_vector(at: u32) -> vec3<f32> {
    return vec3<f32>(air[at], air[at + 1u], air[at + 2u]);
}

fn evaluate_air(direction: vec3<f32>, distance: f32) -> AirOnRay {
    let layers = u32(air[0]);
    let tables = u32(air[1]);
    var metres = FAR_METRES;
    if distance < FAR_AWAY {
        metres = min(distance * air[2], FAR_METRES);
    }
    let rise = dot(direction, air_vector(3u));
    var depth = vec3<f32>(0.0);
    var added = vec3<f32>(0.0);
    for (var i = 0u; i < layers; i++) {
        let at = AIR_HEAD + i * AIR_LAYER;
        var path = metres;
        let per_height = air[at + 7u];
        if per_height > 0.0 {
            path = min(metres * mean_density(metres * rise * per_height) * air[at + 6u], LONGEST_METRES);
        }
        let own = path * air_vector(at);
        depth += own;
        added += own * air_vector(at + 3u);
    }
    for (var i = 0u; i < tables; i++) {
        let at = AIR_HEAD + layers * AIR_LAYER + i * AIR_TABLE;
        let own = drawn_depth(at, metres) * -LOG2E;
        depth += own;
        added += own * air_vector(at);
    }
    let kept = exp2(clamp(-depth, vec3<f32>(-126.0), vec3<f32>(0.0)));
    // The radiance of an endless path.
    var endless = added / max(depth, vec3<f32>(1e-30));
    if layers == 1u && tables == 0u {
        endless = air_vector(AIR_HEAD + 3u);
    }
    return AirOnRay(kept, endless * (1.0 - kept));
}
