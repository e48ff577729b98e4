// A tile and what its windows reach about it.

const SURROUNDINGS_SIDE: u32 = u32(TILE_SIDE) + 2u * WINDOW_RADIUS;

// The pixel of a tile's surroundings, counted in rows of SURROUNDINGS_SIDE; -1 beyond the picture.
fn about(tile: u32, i: u32) -> i32 {
    let corner = vec2<u32>(tile % view.tile_columns, tile / view.tile_columns) * u32(TILE_SIDE);
    let pixel = vec2<i32>(corner + vec2<u32>(i % SURROUNDINGS_SIDE, i / SURROUNDINGS_SIDE)) - i32(WINDOW_RADIUS);
    let inside = all(pixel >= vec2<i32>(0)) && pixel.x < i32(view.width) && pixel.y < i32(view.height);
    return select(-1, pixel.y * i32(view.width) + pixel.x, inside);
}

// Where the window of a thread's pixel begins in rows of SURROUNDINGS_SIDE.
fn window_begin(local: u32) -> u32 {
    return local / u32(TILE_SIDE) * SURROUNDINGS_SIDE + local % u32(TILE_SIDE);
}

// That pixel among its surroundings.
fn middle(local: u32) -> u32 {
    return window_begin(local) + WINDOW_RADIUS * (SURROUNDINGS_SIDE + 1u);
}
