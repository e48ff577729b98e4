//! bench
use anyhow::Result;
use clap::Args;
/// Options
#[derive(Args, Debug)]
pub struct BenchArgs {}
pub fn run(_: &BenchArgs) -> Result<()> {
    Ok(())
}
