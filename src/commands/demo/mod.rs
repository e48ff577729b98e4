//! demo
use anyhow::Result;
use clap::Args;
/// Options
#[derive(Args, Debug)]
pub struct DemoArgs {}
pub fn run(_: &DemoArgs) -> Result<()> {
    Ok(())
}
