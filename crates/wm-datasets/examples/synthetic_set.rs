//! Writes a small synthetic set in a layout, for scripts that read it with other programs:
//! `cargo run -p wm-datasets --features testing --example synthetic_set -- LAYOUT FOLDER`.

use wm_datasets::{find_layout, testing};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(layout), Some(folder)) = (arguments.next(), arguments.next()) else {
        return Err("usage: synthetic_set LAYOUT FOLDER".into());
    };
    testing::write(find_layout(&layout)?, &mut testing::FolderSink(folder.into()))?;
    Ok(())
}
