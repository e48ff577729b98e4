//! Renders frames in order while another thread writes those before.

use crate::{interrupt, progress};
use anyhow::{Result, anyhow};
use std::sync::mpsc::{channel, sync_channel};

/// Number of frames between renderer and writer; more would only use memory.
const WAITING: usize = 2;

/// Renders `frames` in order into values of `T` while another thread writes them; returns the number written. Fewer than
/// all means that Ctrl-C was pressed.
///
/// # Errors
/// The first error of `render` or `write`.
pub fn pipeline<T: Default + Send>(
    frames: &[u32],
    render: &mut dyn FnMut(u32, &mut T) -> Result<()>,
    write: &mut (dyn FnMut(u32, &T) -> Result<()> + Send),
) -> Result<u32> {
    let bar = progress::bar(frames.len() as u64, "frames");
    let outcome = std::thread::scope(|scope| {
        let (send, receive) = sync_channel::<(u32, T)>(WAITING);
        let (give_back, returned) = channel::<T>();
        let bar = &bar;
        let writer = scope.spawn(move || -> Result<u32> {
            let mut written = 0;
            for (index, frame) in receive {
                write(index, &frame)?;
                written += 1;
                bar.inc(1);
                // The renderer may have finished.
                let _ = give_back.send(frame);
            }
            Ok(written)
        });
        let mut fault = None;
        for index in frames {
            if interrupt::asked() {
                break;
            }
            let mut frame = returned.try_recv().unwrap_or_default();
            if let Err(error) = render(*index, &mut frame) {
                fault = Some(error);
                break;
            }
            // A closed channel means that the writer failed: its error is reported.
            if send.send((*index, frame)).is_err() {
                break;
            }
        }
        drop(send);
        let written = writer.join().map_err(|_| anyhow!("the thread that writes frames failed"))??;
        match fault {
            Some(error) => Err(error),
            None => Ok(written),
        }
    });
    bar.finish_and_clear();
    outcome
}
