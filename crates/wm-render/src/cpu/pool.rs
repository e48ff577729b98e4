//! The threads of the CPU back end.

use crate::config::CpuConfig;
use crate::error::RenderError;
use crate::simd::SimdPath;
use std::sync::Arc;

/// The SIMD path and the threads of `config`.
pub(crate) fn start(config: CpuConfig) -> Result<(SimdPath, Arc<rayon::ThreadPool>), RenderError> {
    let path = SimdPath::select(config.simd).ok_or(RenderError::NoSimd(config.simd.name()))?;
    Ok((path, pool(config.threads.unwrap_or(0))?))
}

/// Starts a pool of threads; 0 for one per core.
///
/// # Errors
/// [`RenderError::Threads`] if they cannot be started.
#[cfg(not(target_arch = "wasm32"))]
pub fn pool(threads: usize) -> Result<Arc<rayon::ThreadPool>, RenderError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map(Arc::new).map_err(|error| RenderError::Threads { threads, reason: error.to_string() })
}

/// Makes a pool of the only thread in a browser.
///
/// # Errors
/// [`RenderError::Threads`] if it is in another pool.
#[cfg(target_arch = "wasm32")]
pub fn pool(_: usize) -> Result<Arc<rayon::ThreadPool>, RenderError> {
    static POOL: std::sync::OnceLock<Arc<rayon::ThreadPool>> = std::sync::OnceLock::new();
    if let Some(pool) = POOL.get() {
        return Ok(Arc::clone(pool));
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build();
    let pool = pool.map_err(|error| RenderError::Threads { threads: 1, reason: error.to_string() })?;
    Ok(Arc::clone(POOL.get_or_init(|| Arc::new(pool))))
}
