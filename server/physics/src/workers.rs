//! Threads lent to the core by whoever owns them.

use rayon::ThreadPool;
use rayon::prelude::*;

/// The threads a step may use. Work is split into fixed chunks whatever their number, so the result
/// has the same bits at any thread count.
#[derive(Clone, Copy, Default)]
pub struct Workers<'a> {
    pool: Option<&'a ThreadPool>,
}

impl<'a> Workers<'a> {
    /// Everything runs on the calling thread.
    #[must_use]
    pub fn serial() -> Self {
        Self { pool: None }
    }

    /// Chunks are shared out to the threads of `pool`; a pool of one thread counts as serial.
    #[must_use]
    pub fn of(pool: &'a ThreadPool) -> Self {
        Self { pool: (pool.current_num_threads() > 1).then_some(pool) }
    }

    /// Calls `work(chunk index, chunk)` for each chunk of `size` elements, in parallel where threads
    /// are lent.
    pub fn for_chunks<T: Send, F: Fn(usize, &mut [T]) + Sync>(&self, data: &mut [T], size: usize, work: F) {
        match self.pool {
            Some(pool) if data.len() > size => {
                pool.install(|| data.par_chunks_mut(size).enumerate().for_each(|(i, chunk)| work(i, chunk)));
            }
            _ => data.chunks_mut(size).enumerate().for_each(|(i, chunk)| work(i, chunk)),
        }
    }
}
