// Colours of the splats in view: spherical harmonics. `[groups][sh_rows][16]`, three rows a
// coefficient.
@group(0) @binding(5) var<storage, read> sh_rest: array<f32>;

fn coefficient(splat: u32, k: u32) -> vec3<f32> {
    let at = (splat / GROUP * chunk.sh_rows + 3u * (k - 1u)) * GROUP + splat % GROUP;
    return vec3<f32>(sh_rest[at], sh_rest[at + GROUP], sh_rest[at + 2u * GROUP]);
}

// Display-referred, not below 0, of a splat seen along the unit vector `d` (world axes).
fn shade(splat: u32, d: vec3<f32>) -> vec3<f32> {
    var rgb = vec3<f32>(0.5) + C0 * numbers(splat, ROW_DC);
    if chunk.sh_used >= 9u {
        rgb += (-C1 * d.y) * coefficient(splat, 1u);
        rgb += (C1 * d.z) * coefficient(splat, 2u);
        rgb += (-C1 * d.x) * coefficient(splat, 3u);
    }
    let dd = d * d;
    if chunk.sh_used >= 24u {
        rgb += (C2[0] * d.x * d.y) * coefficient(splat, 4u);
        rgb += (C2[1] * d.y * d.z) * coefficient(splat, 5u);
        rgb += (C2[2] * (2.0 * dd.z - dd.x - dd.y)) * coefficient(splat, 6u);
        rgb += (C2[3] * d.x * d.z) * coefficient(splat, 7u);
        rgb += (C2[4] * (dd.x - dd.y)) * coefficient(splat, 8u);
    }
    if chunk.sh_used >= 45u {
        rgb += (C3[0] * d.y * (3.0 * dd.x - dd.y)) * coefficient(splat, 9u);
        rgb += (C3[1] * d.x * d.y * d.z) * coefficient(splat, 10u);
        rgb += (C3[2] * d.y * (4.0 * dd.z - dd.x - dd.y)) * coefficient(splat, 11u);
        rgb += (C3[3] * d.z * (2.0 * dd.z - 3.0 * (dd.x + dd.y))) * coefficient(splat, 12u);
        rgb += (C3[4] * d.x * (4.0 * dd.z - dd.x - dd.y)) * coefficient(splat, 13u);
        rgb += (C3[5] * d.z * (dd.x - dd.y)) * coefficient(splat, 14u);
        rgb += (C3[6] * d.x * (dd.x - 3.0 * dd.y)) * coefficient(splat, 15u);
    }
    return max(rgb, vec3<f32>(0.0));
}
