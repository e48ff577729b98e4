// A background that is mixed between NODES x NODES nodes of each patch, on its first and last edge
// and between: `[patches, NODES, NODES, 3]`.

const PATCH: u32 = u32(TILE_SIDE);

fn node(at: u32) -> vec3<f32> {
    return vec3<f32>(background[3u * at], background[3u * at + 1u], background[3u * at + 2u]);
}

// Along the rows of nodes first, then down the columns of pixels, as on the CPU.
fn behind(at: u32) -> vec3<f32> {
    let pixel = vec2<u32>(at % view.width, at / view.width);
    let patch_at = pixel / PATCH;
    let first_node = (patch_at.y * view.tile_columns + patch_at.x) * NODES * NODES;
    let place = (vec2<f32>(pixel % PATCH) + 0.5) * (f32(NODES - 1u) / f32(PATCH));
    let first = min(vec2<u32>(place), vec2<u32>(NODES - 2u));
    let share = place - vec2<f32>(first);
    let corner = first_node + first.y * NODES + first.x;
    let above = mix(node(corner), node(corner + 1u), share.x);
    let below = mix(node(corner + NODES), node(corner + NODES + 1u), share.x);
    return mix(above, below, share.y);
}
