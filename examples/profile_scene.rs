//! Makes gsplat's public profiling scene: the SfM points of the Mip-NeRF 360 garden, repeated on a
//! grid, with random sizes, rotations, opacities and SH of degree 3.
//!
//! ```text
//! cargo run --release --example profile_scene -- POINTS_DIR GRID OUT_DIR
//! weather-magician bench OUT_DIR --camera 1
//! ```
//!
//! POINTS_DIR holds `garden_points.ply` (binary, x y z red green blue) and `garden_cameras.json`;
//! GRID is 1, 3 or 5 (0.11, 1.01 and 2.8 million splats). OUT_DIR becomes a folder as a 3DGS
//! training writes it, with the three cameras.

use std::error::Error;
use std::path::Path;
use wm_scene::random::uniform;
use wm_scene::{Group, Scene, Splats, formats::write_scene, sh, splats::logit};

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().collect();
    let [_, points, grid, out] = &args[..] else {
        return Err("usage: profile_scene POINTS_DIR GRID OUT_DIR".into());
    };
    let (points, out) = (Path::new(points), Path::new(out));
    let grid: i32 = grid.parse()?;
    let bytes = std::fs::read(points.join("garden_points.ply"))?;
    let end = b"end_header\n";
    let body = bytes.windows(end.len()).position(|w| w == end).ok_or("no PLY header")? + end.len();
    let rows: Vec<([f32; 3], [u8; 3])> = bytes[body..]
        .chunks_exact(15)
        .map(|row| {
            let coordinate =
                |k: usize| f32::from_le_bytes([row[4 * k], row[4 * k + 1], row[4 * k + 2], row[4 * k + 3]]);
            ([coordinate(0), coordinate(1), coordinate(2)], [row[12], row[13], row[14]])
        })
        .filter(|(mean, _)| mean.iter().all(|v| v.abs() <= 2.0))
        .collect();

    let mut splats = Splats::with_capacity(rows.len() * (grid * grid) as usize, 3);
    let half = grid / 2;
    for (copy_x, copy_y) in (-half..=half).flat_map(|x| (-half..=half).map(move |y| (x, y))) {
        for (mean, color) in &rows {
            let index = splats.len() as u64;
            let u = |k: u64| uniform(42, index * 64 + k);
            // Box and Muller.
            let normal =
                |k: u64| (-2.0 * u(k).max(1e-12).ln()).sqrt() * (std::f64::consts::TAU * u(k + 1)).cos();
            splats.means.push([mean[0] + 4.0 * copy_x as f32, mean[1] + 4.0 * copy_y as f32, mean[2]]);
            splats.log_scales.push([0, 1, 2].map(|k| (1e-4 + 0.0199 * u(k)).ln() as f32));
            splats.quats.push([3, 5, 7, 9].map(|k| normal(k) as f32));
            splats.logit_opacities.push(logit(u(11)) as f32);
            splats.sh.extend(color.map(|c| sh::dc_of(f64::from(c) / 255.0) as f32));
            splats.sh.extend((0..45).map(|k| (0.05 * normal(12 + k)) as f32));
            splats.groups.push(Group::Scene);
        }
    }
    let folder = out.join("point_cloud/iteration_0");
    std::fs::create_dir_all(&folder)?;
    let count = splats.len();
    write_scene(&folder.join("point_cloud.ply"), &Scene { splats, ..Scene::default() })?;
    std::fs::write(out.join("cameras.json"), cameras(&points.join("garden_cameras.json"))?)?;
    println!("{count} splats and 3 cameras in {}", out.display());
    Ok(())
}

/// The cameras in the form of the reference 3DGS.
fn cameras(path: &Path) -> Result<String, Box<dyn Error>> {
    let file: serde_json::Value = serde_json::from_slice(&std::fs::read(path)?)?;
    let number = |value: &serde_json::Value| value.as_f64().ok_or("a number is missing");
    let mut views = Vec::new();
    let matrices = file["viewmats_world_to_camera"].as_array().ok_or("no viewmats")?;
    for (id, matrix) in matrices.iter().enumerate() {
        let mut rows = [0.0; 16];
        for (k, value) in rows.iter_mut().enumerate() {
            *value = number(&matrix[k / 4][k % 4])?;
        }
        let viewmat = glam::DMat4::from_cols_array(&rows).transpose();
        let world = viewmat.inverse();
        let rotation = glam::DMat3::from_mat4(world).transpose();
        let k = &file["Ks"][id];
        views.push(serde_json::json!({
            "id": id,
            "img_name": format!("garden_{id}"),
            "width": file["width"],
            "height": file["height"],
            "position": world.w_axis.truncate().to_array(),
            "rotation": [rotation.x_axis.to_array(), rotation.y_axis.to_array(), rotation.z_axis.to_array()],
            "fx": number(&k[0][0])?,
            "fy": number(&k[1][1])?,
        }));
    }
    Ok(serde_json::to_string_pretty(&views)?)
}
