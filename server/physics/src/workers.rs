//! Threads lent to the core by whoever owns them.

use rayon::ThreadPool;

/// The threads a step may use. Work is split into fixed chunks whatever their number, so the result
/// has the same bits at any thread count.
#[derive(Clone, Copy, Default)]
pub struct Workers<'a> {
    pool: Option<&'a ThreadPool>,
}

/// Slices of one length that are cut at the same places.
pub trait Slices: Send + Sized {
    /// Length of each.
    fn count(&self) -> usize;
    /// The first `middle` entries of each, and the rest.
    fn cut(self, middle: usize) -> (Self, Self);
}

impl<T: Sync> Slices for &[T] {
    fn count(&self) -> usize {
        self.len()
    }
    fn cut(self, middle: usize) -> (Self, Self) {
        self.split_at(middle)
    }
}

impl<T: Send> Slices for &mut [T] {
    fn count(&self) -> usize {
        self.len()
    }
    fn cut(self, middle: usize) -> (Self, Self) {
        self.split_at_mut(middle)
    }
}

macro_rules! slices_of_tuples {
    ($($slices:ident $low:ident $high:ident),+) => {
        impl<$($slices: Slices),+> Slices for ($($slices,)+) {
            fn count(&self) -> usize {
                self.0.count()
            }
            #[allow(non_snake_case, reason = "each slice is named after its type")]
            fn cut(self, middle: usize) -> (Self, Self) {
                let ($($slices,)+) = self;
                $(let ($low, $high) = $slices.cut(middle);)+
                (($($low,)+), ($($high,)+))
            }
        }
    };
}

slices_of_tuples!(A a b, B c d);
slices_of_tuples!(A a b, B c d, C e f);
slices_of_tuples!(A a b, B c d, C e f, D g h);
slices_of_tuples!(A a b, B c d, C e f, D g h, E i j);

/// A slice that is cut in groups of entries.
pub struct Groups<'a, T> {
    /// The entries; the last group may have fewer.
    pub entries: &'a mut [T],
    /// Entries per group.
    pub size: usize,
}

impl<T: Send> Slices for Groups<'_, T> {
    fn count(&self) -> usize {
        self.entries.len().div_ceil(self.size)
    }
    fn cut(self, middle: usize) -> (Self, Self) {
        let (low, high) = self.entries.split_at_mut(middle * self.size);
        (Self { entries: low, size: self.size }, Self { entries: high, size: self.size })
    }
}

/// How finely work is divided among threads.
#[derive(Clone, Copy, Debug)]
pub struct Grain {
    /// Entries of a chunk. The order in which results are joined depends on it.
    pub chunk: usize,
    /// Chunks below which it costs more to hand them to another thread than to do them: some 20 us of work.
    pub least: usize,
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

    /// Runs `work` on one of the threads: what it hands to the others then costs no more than a call.
    pub fn run<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match self.pool {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }

    /// Calls `work(chunk index, chunk)` for each chunk, in parallel where threads are lent and it pays.
    pub(crate) fn for_chunks<S: Slices>(&self, data: S, grain: Grain, work: impl Fn(usize, S) + Sync) {
        self.reduce_chunks(data, grain, work, |(), ()| ());
    }

    /// The same, with the results joined in an order that depends on the number of chunks alone.
    pub(crate) fn reduce_chunks<S: Slices, R: Send>(
        &self,
        data: S,
        grain: Grain,
        work: impl Fn(usize, S) -> R + Sync,
        join: impl Fn(R, R) -> R + Sync,
    ) -> R {
        match self.pool {
            Some(pool) if data.count() >= 2 * grain.least * grain.chunk => {
                pool.install(|| divide(data, 0, grain, &work, &join))
            }
            _ => divide(data, 0, Grain { least: usize::MAX, ..grain }, &work, &join),
        }
    }
}

/// Halves the chunks until one is left, both halves at once where each is worth a thread.
fn divide<S: Slices, R: Send>(
    data: S,
    first: usize,
    grain: Grain,
    work: &(impl Fn(usize, S) -> R + Sync),
    join: &(impl Fn(R, R) -> R + Sync),
) -> R {
    let half = data.count().div_ceil(grain.chunk) / 2;
    if half == 0 {
        return work(first, data);
    }
    let (low, high) = data.cut(half * grain.chunk);
    let low = || divide(low, first, grain, work, join);
    let high = || divide(high, first + half, grain, work, join);
    let (low, high) = if half >= grain.least { rayon::join(low, high) } else { (low(), high()) };
    join(low, high)
}
