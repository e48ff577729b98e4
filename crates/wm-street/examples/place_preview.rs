//! Draws a built-in place into PNG files, to look at.
//!
//! `cargo run --release -p wm-street --example place_preview -- <folder> [street|park] [view] [width] [samples]`
//! ray-casts one of the place's views (or `all`, or `dolly:<time>`); `splats` or `splats:<detail>`
//! before the view draws the splats instead, crudely: sorted by depth, front to back, no tiles.

use glam::{DMat3, DVec3};
use std::io::Write as _;
use std::path::Path;
use std::time::Instant;
use wm_scene::{Camera, Splats, quat, sh};
use wm_street::{Park, Place, Street};

fn main() -> std::io::Result<()> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let detail = arguments.iter().position(|a| a.starts_with("splats")).map(|at| {
        let word = arguments.remove(at);
        word.strip_prefix("splats:").map_or(1.0, |detail| detail.parse().expect("the detail, such as 1.5"))
    });
    let text = |index: usize, other: &str| arguments.get(index).cloned().unwrap_or_else(|| other.to_owned());
    let (folder, name, which) = (text(0, "."), text(1, "street"), text(2, "all"));
    let width: u32 = text(3, "600").parse().expect("the width in pixels");
    let samples: u32 = text(4, "2").parse().expect("the samples a side");
    let start = Instant::now();
    let place = if name == "park" { Park::builtin() } else { Street::builtin() };
    println!("built in {:.2} s", start.elapsed().as_secs_f64());
    let splats = detail.map(|detail| splats_of(&place, detail));
    let views = match which.strip_prefix("dolly:") {
        Some(time) => vec![place.dolly(time.parse().expect("a time from 0 to 1"))],
        None => place.views().iter().copied().filter(|view| which == "all" || view.name == which).collect(),
    };
    for view in views {
        let camera = view.camera((width, width * 2 / 3)).expect("the views are sound");
        let start = Instant::now();
        let rgb = match &splats {
            Some(splats) => paint(splats, &camera),
            None => cast(&place, &camera, samples),
        };
        let kind = if splats.is_some() { "splats" } else { "cast" };
        let path = Path::new(&folder)
            .join(format!("{name}_{}_{kind}.png", which.replace(':', "_").replace("all", view.name)));
        std::fs::write(&path, png(&rgb, camera.width, camera.height))?;
        println!("{} in {:.2} s", path.display(), start.elapsed().as_secs_f64());
    }
    Ok(())
}

/// Rows shared out among threads, in order.
fn in_parallel<T: Send>(count: usize, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let next = std::sync::atomic::AtomicUsize::new(0);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mut done: Vec<(usize, T)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads)
            .map(|_| {
                scope.spawn(|| {
                    let mut mine = Vec::new();
                    loop {
                        let index = next.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                        if index >= count {
                            return mine;
                        }
                        mine.push((index, work(index)));
                    }
                })
            })
            .collect();
        workers.into_iter().flat_map(|worker| worker.join().expect("no worker panics")).collect()
    });
    done.sort_by_key(|(index, _)| *index);
    done.into_iter().map(|(_, value)| value).collect()
}

fn cast(place: &Place, camera: &Camera, samples: u32) -> Vec<[f64; 3]> {
    let rows = in_parallel(camera.height as usize, |y| place.photo_row(camera, y as u32, samples));
    rows.into_iter().flatten().map(|pixel| pixel.rgb).collect()
}

fn splats_of(place: &Place, detail: f64) -> Splats {
    let sampling = place.sampling(detail);
    let (start, chunk) = (Instant::now(), 4096);
    let parts = in_parallel(sampling.len().div_ceil(chunk), |part| {
        let range = part * chunk..(part + 1) * chunk;
        range.filter_map(|index| sampling.splat(index)).collect::<Vec<_>>()
    });
    let mut splats = Splats::with_capacity(sampling.len(), 0);
    parts.iter().flatten().for_each(|splat| splats.push(splat));
    println!("{} splats of {} cells in {:.2} s", splats.len(), sampling.len(), start.elapsed().as_secs_f64());
    splats
}

/// Front to back over whole splats: enough to see whether surfaces close.
fn paint(splats: &Splats, camera: &Camera) -> Vec<[f64; 3]> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let rotation = camera.rotation();
    let mut order: Vec<(f64, usize)> = (0..splats.len())
        .filter_map(|i| {
            let z = camera.viewmat.transform_point3(DVec3::from_array(splats.means[i].map(f64::from))).z;
            (z > camera.near).then_some((z, i))
        })
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut picture = vec![([0.0; 3], 1.0); width * height];
    for (_, i) in order {
        let p = camera.viewmat.transform_point3(DVec3::from_array(splats.means[i].map(f64::from)));
        if p.x.abs() > 2.0 * p.z || p.y.abs() > 2.0 * p.z {
            continue;
        }
        let m = quat::to_matrix(splats.quats[i].map(f64::from));
        let axes = DMat3::from_cols_array_2d(&m).transpose();
        let spread = rotation * axes * DMat3::from_diagonal(DVec3::from_array(splats.scales(i)));
        let (jx, jy) = (
            DVec3::new(camera.fx / p.z, 0.0, -camera.fx * p.x / (p.z * p.z)),
            DVec3::new(0.0, camera.fy / p.z, -camera.fy * p.y / (p.z * p.z)),
        );
        let (sx, sy) = (spread.transpose() * jx, spread.transpose() * jy);
        let (a, b, c) = (sx.dot(sx) + 0.3, sx.dot(sy), sy.dot(sy) + 0.3);
        let det = a * c - b * b;
        let (u, v) = (camera.fx * p.x / p.z + camera.cx, camera.fy * p.y / p.z + camera.cy);
        let (rx, ry) = (3.0 * a.sqrt(), 3.0 * c.sqrt());
        let color = sh::color(splats.sh_of(i), [0.0, 0.0, 1.0]);
        let opacity = splats.opacity(i);
        let clip = |value: f64, most: usize| value.clamp(0.0, most as f64) as usize;
        for y in clip(v - ry, height)..clip(v + ry + 1.0, height) {
            for x in clip(u - rx, width)..clip(u + rx + 1.0, width) {
                let pixel = &mut picture[y * width + x];
                if pixel.1 < 1e-3 {
                    continue;
                }
                let (dx, dy) = (x as f64 + 0.5 - u, y as f64 + 0.5 - v);
                let power = 0.5 * (c * dx * dx - 2.0 * b * dx * dy + a * dy * dy) / det;
                let alpha = (opacity * (-power).exp()).min(0.99);
                if alpha < 1.0 / 255.0 {
                    continue;
                }
                for (channel, value) in color.iter().enumerate() {
                    pixel.0[channel] += pixel.1 * alpha * value.max(0.0);
                }
                pixel.1 *= 1.0 - alpha;
            }
        }
    }
    // What is left open is magenta, so that holes are seen.
    picture.into_iter().map(|(rgb, rest)| [rgb[0] + rest, rgb[1], rgb[2] + rest]).collect()
}

/// An 8-bit PNG without compression.
fn png(rgb: &[[f64; 3]], width: u32, height: u32) -> Vec<u8> {
    let mut raw = Vec::new();
    for row in rgb.chunks(width as usize) {
        raw.push(0);
        raw.extend(row.iter().flatten().map(|v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8));
    }
    let mut data = vec![0x78, 0x01];
    let blocks = raw.chunks(65_535);
    let last = blocks.len() - 1;
    for (index, block) in blocks.enumerate() {
        let length = block.len() as u16;
        data.push(u8::from(index == last));
        data.extend(length.to_le_bytes());
        data.extend((!length).to_le_bytes());
        data.extend(block);
    }
    let (mut low, mut high) = (1u32, 0u32);
    for byte in &raw {
        low = (low + u32::from(*byte)) % 65_521;
        high = (high + low) % 65_521;
    }
    data.extend((high << 16 | low).to_be_bytes());
    let mut header = Vec::new();
    header.extend(width.to_be_bytes());
    header.extend(height.to_be_bytes());
    header.extend([8, 2, 0, 0, 0]);
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    for (name, body) in [(b"IHDR", &header), (b"IDAT", &data), (b"IEND", &Vec::new())] {
        file.extend((body.len() as u32).to_be_bytes());
        let from = file.len();
        file.write_all(name).and_then(|()| file.write_all(body)).expect("a vector takes all");
        let crc = crc32(&file[from..]);
        file.extend(crc.to_be_bytes());
    }
    file
}

fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for byte in bytes {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg());
        }
    }
    !crc
}
