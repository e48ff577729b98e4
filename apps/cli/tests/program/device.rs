//! The choice of a device, and that a GPU draws every weather as the CPU does.

use crate::common::*;
use crate::process::{printed, said};
use wm_render::gpu::adapters;
use wm_render::testing::Backend;
use wm_scene::{Lamp, Metadata};
use wm_street::dataset::DatasetOptions;

const SIZE: (u32, u32) = (120, 80);

/// The GPU as `--device` names it; `None` without one.
fn gpu() -> Option<String> {
    Backend::gpu()?;
    let fit = adapters().into_iter().find(|listed| listed.unfit.is_none()).unwrap();
    Some(format!("gpu:{}", fit.name))
}

#[test]
fn devices_are_listed() {
    let said = printed(&run(&["devices", "--device", "cpu"]));
    assert!(said.starts_with("cpu, ") && said.contains("--device cpu renders on: cpu, "), "{said}");
    for listed in adapters() {
        assert!(said.contains(&listed.name), "{said}");
    }
}

#[test]
fn a_device_that_is_not_there_is_one_line() {
    for (device, reason) in [("gpu:no such one", "`no such one`"), ("tpu", "`tpu` is no device")] {
        let output = binary().args(["devices", "--device", device]).output().unwrap();
        let said = said(&output);
        // Drivers may have something to say before.
        let last = said.trim_end().lines().last().unwrap_or_default();
        assert!(!output.status.success() && last.starts_with("error: ") && last.contains(reason), "{said}");
    }
}

/// Photos of the built-in street, on both devices: how near the ones that are held out are met, dB.
#[test]
fn a_training_ends_as_near_as_the_cpus() {
    let Some(gpu) = gpu() else { return };
    let workshop = Workshop::new();
    let options = DatasetOptions { count: 9, size: (48, 32), points: 300, ..DatasetOptions::TINY };
    workshop.photos("set", &options);
    let psnr = ["cpu", &gpu].map(|device| {
        // Few steps: with more of them so few photos are learnt by heart, and no two ways of
        // rounding end alike.
        let words = "reconstruct set --no-assets --out scene.ply --steps 100 --max-splats 800 --sh-degree 1 \
                     --eval-every 3 --sky-splats 200 --overwrite --device";
        let mut command = workshop.command(words);
        let output = command.arg(device).output().unwrap();
        let said = printed(&output) + &said(&output);
        assert!(output.status.success(), "{said}");
        let is_on = if device == "cpu" { " s on cpu, " } else { " s on gpu, " };
        assert!(said.contains(is_on), "{said}");
        let mean = said.lines().find_map(|line| line.strip_prefix("held-out mean of 3: ")).unwrap();
        mean.split(' ').next().unwrap().parse::<f64>().unwrap()
    });
    println!("{psnr:?} dB");
    assert!((psnr[0] - psnr[1]).abs() < 0.2 && psnr[0] > 15.0, "{psnr:?}");
}

/// By the pictures' own numbers: what may be off is a splat at a cut.
#[test]
fn every_weather_is_the_cpus() {
    let Some(gpu) = gpu() else { return };
    let lamp = Lamp { aim: Some([0.0, 0.0, -1.0]), ..Lamp::new([-1.5, 1.0, 4.0]) };
    let facts = Metadata { lamps: Some(vec![lamp]), ..yard_metadata(1.0) };
    let yard = Shot::yard_with(SIZE, &facts);
    for weather in [
        "",
        "--set fog.mor=40",
        "--set fog.mor=60 --set fog.scale_height=8 --set smog.mor=300",
        "--set rain.rate=60 --set wind.speed=6",
        "--set snowfall.rate=3 --set sky=overcast",
        "--set snow_cover.depth=0.15",
        "--set fog.mor=80 --set look.exposure=-0.5 --set look.saturation=0.6",
        "--weather fog --set fidelity=paper",
        "--set rain.rate=20 --set fidelity=paper",
        "--set light.model=overcast",
        "--set light.model=clear --set light.sun_elevation=30 --set light.photos=diffuse --set haze.mor=3000",
        "--set light.model=night --set light.lamps=on --set light.exposure=-2 --set fog.mor=60",
        "--set light.model=night --set light.lamps=on --set light.headlamps=on --set rain.rate=60 --set snow_cover.depth=0.1",
        "--set light.model=night --set lightning.rate=120 --set lightning.distance=400 --set lightning.exposure=2",
        "--set light.model=clear --set light.photos=diffuse --set light.clouds=0.5 --set light.cloud_shadows=on",
        "--set lens.rate=20 --set lens.distance=0.1 --set lens.dirt=0.1",
    ] {
        let pictures = ["cpu", &gpu].map(|device| {
            let drawn = yard.command("picture.exr", weather).arg("--device").arg(device).output().unwrap();
            assert!(drawn.status.success(), "{weather}: {}", said(&drawn));
            read_exr(&yard.path("picture.exr"))
        });
        let [cpu, gpu] = pictures.each_ref().map(|picture| picture.pixels.as_flattened());
        let off: Vec<f64> = cpu.iter().zip(gpu).map(|(a, b)| (a - b).abs()).collect();
        let (most, mean) = (largest(off.iter().copied()), off.iter().sum::<f64>() / off.len() as f64);
        println!("`{weather}`: mean {mean:.1e}, most {most:.1e}");
        assert!(mean < 2e-5 && most < 0.02, "{weather}: {mean} {most}");
        assert!(cpu != gpu || weather.is_empty(), "`{weather}`: one device drew both");
    }
}
