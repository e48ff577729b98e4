// The derivative of a splat's colour, as `cpu.rs` has it; see the contract in `mod.rs`.

// `[records][sh_used / 3 + 1][3]`
@group(0) @binding(9) var<storage, read_write> by_sh: array<f32>;

// Writes the derivative by coefficient `k`, whose basis function has this value; gives that by the
// direction.
fn learn(splat: u32, place: u32, k: u32, basis: f32, slopes: vec3<f32>, by: vec3<f32>) -> vec3<f32> {
    let at = place * (chunk.sh_used + 3u) + 3u * k;
    by_sh[at] = basis * by.x;
    by_sh[at + 1u] = basis * by.y;
    by_sh[at + 2u] = basis * by.z;
    if k == 0u {
        return vec3<f32>(0.0);
    }
    return slopes * dot(coefficient(splat, k), by);
}

// `by` are the derivatives by the colour of a splat seen along the unit vector `d`; gives those by
// `d`, not held to the sphere.
fn shade_backward(splat: u32, place: u32, d: vec3<f32>, by: vec3<f32>) -> vec3<f32> {
    let none = vec3<f32>(0.0);
    var sum = learn(splat, place, 0u, C0, none, by);
    if chunk.sh_used >= 9u {
        sum += learn(splat, place, 1u, -C1 * d.y, vec3<f32>(0.0, -C1, 0.0), by);
        sum += learn(splat, place, 2u, C1 * d.z, vec3<f32>(0.0, 0.0, C1), by);
        sum += learn(splat, place, 3u, -C1 * d.x, vec3<f32>(-C1, 0.0, 0.0), by);
    }
    let dd = d * d;
    if chunk.sh_used >= 24u {
        sum += learn(splat, place, 4u, C2[0] * d.x * d.y, C2[0] * vec3<f32>(d.y, d.x, 0.0), by);
        sum += learn(splat, place, 5u, C2[1] * d.y * d.z, C2[1] * vec3<f32>(0.0, d.z, d.y), by);
        let about = C2[2] * (2.0 * dd.z - dd.x - dd.y);
        sum += learn(splat, place, 6u, about, C2[2] * vec3<f32>(-2.0 * d.x, -2.0 * d.y, 4.0 * d.z), by);
        sum += learn(splat, place, 7u, C2[3] * d.x * d.z, C2[3] * vec3<f32>(d.z, 0.0, d.x), by);
        sum += learn(splat, place, 8u, C2[4] * (dd.x - dd.y), C2[4] * vec3<f32>(2.0 * d.x, -2.0 * d.y, 0.0), by);
    }
    if chunk.sh_used >= 45u {
        let xy = d.x * d.y;
        let yz = d.y * d.z;
        let xz = d.x * d.z;
        let apart = dd.x - dd.y;
        let four = 4.0 * dd.z - dd.x - dd.y;
        let wide = 3.0 * (dd.x + dd.y);
        sum += learn(splat, place, 9u, C3[0] * d.y * (3.0 * dd.x - dd.y),
            C3[0] * vec3<f32>(6.0 * xy, 3.0 * apart, 0.0), by);
        sum += learn(splat, place, 10u, C3[1] * xy * d.z, C3[1] * vec3<f32>(yz, xz, xy), by);
        sum += learn(splat, place, 11u, C3[2] * d.y * four,
            C3[2] * vec3<f32>(-2.0 * xy, four - 2.0 * dd.y, 8.0 * yz), by);
        sum += learn(splat, place, 12u, C3[3] * d.z * (2.0 * dd.z - wide),
            C3[3] * vec3<f32>(-6.0 * xz, -6.0 * yz, 6.0 * dd.z - wide), by);
        sum += learn(splat, place, 13u, C3[4] * d.x * four,
            C3[4] * vec3<f32>(four - 2.0 * dd.x, -2.0 * xy, 8.0 * xz), by);
        sum += learn(splat, place, 14u, C3[5] * d.z * apart, C3[5] * vec3<f32>(2.0 * xz, -2.0 * yz, apart), by);
        sum += learn(splat, place, 15u, C3[6] * d.x * (dd.x - 3.0 * dd.y),
            C3[6] * vec3<f32>(3.0 * apart, -6.0 * xy, 0.0), by);
    }
    return sum;
}
