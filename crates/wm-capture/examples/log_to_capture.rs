//! Turns a driving log into a capture folder:
//! `cargo run --release -p wm-capture --example log_to_capture -- LOG FOLDER [SCENE]`.

use std::ops::ControlFlow;
use wm_capture::{DrivingLog, LogCaptureOptions, LogOptions};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(log), Some(folder)) = (arguments.next(), arguments.next()) else {
        return Err("usage: log_to_capture LOG FOLDER [SCENE]".into());
    };
    let options = LogOptions { scene: arguments.next(), ..LogOptions::default() };
    let Some(log) = DrivingLog::open(log.as_ref(), &options)? else {
        return Err(format!("{log}: no driving log of a known format").into());
    };
    let written = log
        .write_capture(folder.as_ref(), &LogCaptureOptions::default(), &mut |_| ControlFlow::Continue(()))?;
    println!("{written:#?}");
    Ok(())
}
