//! Writes a small synthetic set in a layout and its numbers in `truth.json`, for scripts that read
//! it with other programs:
//! `cargo run -p wm-batch --features testing --example synthetic_set -- LAYOUT FOLDER`.

use wm_batch::testing;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(layout), Some(folder)) = (arguments.next(), arguments.next()) else {
        return Err("usage: synthetic_set LAYOUT FOLDER".into());
    };
    let mut files = testing::FolderSink(folder.into());
    testing::write(testing::layout(&layout), &mut files)?;
    let truth = serde_json::to_vec_pretty(&testing::truth(&testing::set()))?;
    wm_batch::FileSink::write(&mut files, "truth.json", &truth)?;
    Ok(())
}
