//! The threads on which what viewers get is waited for and encoded: below those that step, and apart from the network's,
//! so that no viewer's work holds up a driver's pose or contact.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};

use kerf_session::priority::stand_back;
use tokio::runtime::{Builder, Handle, Runtime};
use tokio::task::JoinHandle;

/// One suffices: what all viewers of a session share is encoded once, in a third of a millisecond for the liver.
const THREADS: usize = 1;

/// The runtime of viewers' work; it ends with this.
pub struct Viewing {
    handle: Handle,
    runtime: Option<Runtime>,
}

impl Viewing {
    /// Starts its threads.
    ///
    /// # Errors
    /// There are no threads to be had.
    pub fn begin() -> io::Result<Self> {
        let runtime = Builder::new_multi_thread()
            .worker_threads(THREADS)
            .thread_name("kerf-viewers")
            .on_thread_start(stand_back)
            .enable_all()
            .build()?;
        Ok(Self { handle: runtime.handle().clone(), runtime: Some(runtime) })
    }

    /// Viewers' work on a runtime that others run.
    #[cfg(test)]
    pub fn on(handle: Handle) -> Self {
        Self { handle, runtime: None }
    }

    /// Does some work there; it ends when the answer is given up.
    pub fn work<T: Send + 'static>(&self, work: impl Future<Output = T> + Send + 'static) -> Work<T> {
        Work(self.handle.spawn(work))
    }
}

impl Drop for Viewing {
    fn drop(&mut self) {
        // Not waited for: it may end in an async context.
        self.runtime.take().into_iter().for_each(Runtime::shutdown_background);
    }
}

/// Work that is done there; `None` where it panicked or the server has ended.
pub struct Work<T>(JoinHandle<T>);

impl<T> Future for Work<T> {
    type Output = Option<T>;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<T>> {
        Poll::Ready(ready!(Pin::new(&mut self.0).poll(context)).ok())
    }
}

impl<T> Drop for Work<T> {
    fn drop(&mut self) {
        self.0.abort();
    }
}
