//! `devices`: lists the devices that can render, and the one that would.

use crate::scene::RunArgs;
use anyhow::Result;
use clap::Args;

/// Options of `devices`.
#[derive(Args, Debug)]
pub(crate) struct DevicesArgs {
    #[command(flatten)]
    run: RunArgs,
}

/// Runs the command.
pub(crate) fn run(args: &DevicesArgs) -> Result<()> {
    let cpu = RunArgs { device: wm_render::Device::Cpu, ..args.run.clone() };
    println!("{}", cpu.renderer()?.describe());
    gpus();
    println!("--device {} renders on: {}", args.run.device, args.run.renderer()?.describe());
    Ok(())
}

/// A line or two a GPU.
#[cfg(feature = "gpu")]
fn gpus() {
    let adapters = wm_render::gpu::adapters();
    if adapters.is_empty() {
        println!("no GPU: no driver for Vulkan, Metal or DirectX 12 has one");
    }
    for listed in adapters {
        let megabytes = |bytes: u64| bytes as f64 * 1e-6;
        println!("gpu, {} ({}), {}, {}", listed.name, listed.backend, listed.kind.name(), listed.driver);
        println!(
            "  arrays of up to {:.0} MB, buffers of up to {:.0} MB, {} kB shared by a workgroup, stages {} be timed",
            megabytes(listed.most_binding),
            megabytes(listed.most_buffer),
            listed.workgroup_storage / 1024,
            if listed.timestamps { "can" } else { "cannot" },
        );
        match listed.subgroups {
            Some((least, most)) if least == most => println!("  subgroups of {least} threads, made use of"),
            Some((least, most)) => println!("  subgroups of {least} to {most} threads, made use of"),
            None => println!("  no subgroups that can be made use of"),
        }
        if let Some(unfit) = listed.unfit {
            println!("  cannot be used: {unfit}");
        } else if listed.kind == wm_render::gpu::AdapterKind::Software {
            println!("  runs on the processor: only when asked for by name");
        }
    }
}

#[cfg(not(feature = "gpu"))]
fn gpus() {
    println!("no GPU: this program was built without the feature `gpu`");
}
