//! Failures of the file system that tests ask for, as the environment variable `WM_FAIL_FILES`
//! says: `write:3` fails the third write of the process, `rename:1` its first rename, and
//! `kill-rename:2` ends the process before its second rename, as a power cut does.

use std::io;

/// An operation of [`super::TempFile`] that can fail.
#[derive(Clone, Copy, Debug)]
pub(super) enum Operation {
    Create,
    Write,
    Flush,
    Rename,
}

/// Fails if tests ask for it.
#[cfg(not(any(test, feature = "testing")))]
#[allow(clippy::unnecessary_wraps)]
pub(super) fn check(_: Operation) -> io::Result<()> {
    Ok(())
}

#[cfg(any(test, feature = "testing"))]
pub(super) fn check(operation: Operation) -> io::Result<()> {
    use std::sync::{
        LazyLock,
        atomic::{AtomicU64, Ordering},
    };
    struct Wanted {
        operation: String,
        number: u64,
        is_kill: bool,
    }
    static WANTED: LazyLock<Option<Wanted>> = LazyLock::new(|| {
        let text = std::env::var("WM_FAIL_FILES").ok()?;
        let (operation, number) = text.split_once(':')?;
        let killed = operation.strip_prefix("kill-");
        Some(Wanted {
            operation: killed.unwrap_or(operation).into(),
            number: number.parse().ok()?,
            is_kill: killed.is_some(),
        })
    });
    static OPERATION_COUNT: AtomicU64 = AtomicU64::new(0);
    let Some(wanted) = &*WANTED else { return Ok(()) };
    if !format!("{operation:?}").eq_ignore_ascii_case(&wanted.operation)
        || OPERATION_COUNT.fetch_add(1, Ordering::Relaxed) + 1 != wanted.number
    {
        return Ok(());
    }
    if wanted.is_kill {
        std::process::abort();
    }
    Err(io::Error::from(io::ErrorKind::StorageFull))
}
