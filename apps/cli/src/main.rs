//! The program. All of it is in the library target `weather_magician_cli`, so that others can run
//! it in their own process.

#[cfg(feature = "viewer")]
use mimalloc::MiMalloc;
use std::process::ExitCode;

#[cfg(feature = "viewer")]
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

fn main() -> ExitCode {
    ExitCode::from(weather_magician_cli::run(std::env::args_os()))
}
