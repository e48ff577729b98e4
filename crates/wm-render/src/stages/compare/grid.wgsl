// Pixels that are compared: those of a grid.

// The pixel of the picture in a place of the grid.
fn pixel_of(column: u32, row: u32) -> u32 {
    let x = min((2u * column + 1u) * view.width / (2u * geometry.columns), view.width - 1u);
    let y = min((2u * row + 1u) * view.height / (2u * geometry.rows), view.height - 1u);
    return y * view.width + x;
}

// Rendered and believed inverse depth; below 0 where one of them does not count.
fn pair_at(at: u32) -> vec2<f32> {
    return vec2<f32>(inverse_depth(at), believed_inverse_depth(at));
}

fn counts(pair: vec2<f32>) -> bool {
    return pair.x > 0.0 && pair.y >= 0.0;
}
