//! The bridge from tokio to rayon.

use std::any::Any;
use std::fmt;
use std::future::Future;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use rayon::{ThreadPool, ThreadPoolBuilder};
use tokio::sync::oneshot;

/// Recursive factorizations and tree builds run deeper than the 2 MiB that threads get by default.
const STACK_BYTES: usize = 16 << 20;

/// Of 19: the least share that still leaves analyses a tenth of a core that others want too.
const NICENESS: i32 = 10;

/// A private pool of threads for numerical work, apart from tokio's and from rayon's global one.
///
/// Work waits until a thread is free, so work that answers a request must not share a pool with analyses, which run for
/// an hour: the service makes one pool for each and leaves it to the operating system to share the cores.
#[derive(Clone)]
pub struct Compute {
    pool: Arc<ThreadPool>,
}

/// Why a computation gave nothing.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ComputeError {
    /// The threads could not be started.
    #[error("the threads could not be started: {0}")]
    Threads(String),
    /// The work panicked.
    #[error("the computation panicked: {0}")]
    Panicked(String),
}

impl Compute {
    /// A pool of `threads` threads, called `name-0` and so on.
    ///
    /// # Errors
    /// [`ComputeError::Threads`].
    pub fn new(name: &'static str, threads: usize) -> Result<Self, ComputeError> {
        Self::with(name, threads, |_| {})
    }

    /// As [`Self::new`], with threads that give way to all others: to those that answer requests above all.
    ///
    /// # Errors
    /// [`ComputeError::Threads`].
    pub fn in_background(name: &'static str, threads: usize) -> Result<Self, ComputeError> {
        Self::with(name, threads, |_| {
            // On Linux a thread has a niceness of its own. Without it everything works, only later.
            let _ = rustix::process::nice(NICENESS);
        })
    }

    fn with(
        name: &'static str,
        threads: usize,
        begin: impl Fn(usize) + Send + Sync + 'static,
    ) -> Result<Self, ComputeError> {
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads.max(1))
            .thread_name(move |index| format!("{name}-{index}"))
            .stack_size(STACK_BYTES)
            .start_handler(begin)
            .build()
            .map_err(|e| ComputeError::Threads(e.to_string()))?;
        Ok(Self { pool: Arc::new(pool) })
    }

    /// Number of threads.
    #[must_use]
    pub fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }

    /// Starts `work` on the pool at once; the future waits for it. Parallel iterators inside it stay on the pool. Dropping
    /// the future does not stop the work: pass a [`crate::progress::Progress`] in and cancel that.
    ///
    /// # Errors
    /// [`ComputeError::Panicked`]: a panic in the numerics ends the computation, not the service.
    pub fn run<T, F>(
        &self,
        work: F,
    ) -> impl Future<Output = Result<T, ComputeError>> + Send + 'static + use<T, F>
    where
        T: Send + 'static,
        F: FnOnce() -> T + Send + 'static,
    {
        let (tell, told) = oneshot::channel();
        self.pool.spawn(move || {
            // What the work shares with others, it shares behind locks and atomics that panics leave readable.
            let result = catch_unwind(AssertUnwindSafe(work));
            // Nobody may be waiting any more.
            let _ = tell.send(result.map_err(|panic| ComputeError::Panicked(words(&*panic))));
        });
        async { told.await.unwrap_or_else(|_| Err(ComputeError::Panicked("its result was lost".to_owned()))) }
    }
}

impl fmt::Debug for Compute {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Compute({} threads)", self.threads())
    }
}

fn words(panic: &(dyn Any + Send)) -> String {
    let literal = panic.downcast_ref::<&'static str>().map(|text| (*text).to_owned());
    literal.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "without words".to_owned())
}

#[cfg(test)]
mod tests {
    use rayon::prelude::*;

    use super::*;

    #[tokio::test]
    async fn work_and_its_parallel_parts_run_on_the_named_threads() {
        let compute = Compute::new("sand", 2).unwrap();
        let names = compute
            .run(|| {
                let name = |_| std::thread::current().name().map(str::to_owned);
                (0..64).into_par_iter().map(name).collect::<Vec<_>>()
            })
            .await
            .unwrap();
        assert!(names.iter().all(|name| name.as_ref().is_some_and(|name| name.starts_with("sand-"))));
    }

    #[tokio::test]
    async fn a_panic_is_an_error_and_the_pool_goes_on() {
        let compute = Compute::new("sand", 1).unwrap();
        let panicked = compute.run(|| panic!("pivot {} is zero", 7)).await;
        assert_eq!(panicked, Err::<(), _>(ComputeError::Panicked("pivot 7 is zero".to_owned())));
        assert_eq!(compute.run(|| 5).await, Ok(5));
    }

    #[tokio::test]
    async fn a_panic_in_a_parallel_part_is_an_error_too() {
        let compute = Compute::new("sand", 2).unwrap();
        let panicked = compute.run(|| (0..64).into_par_iter().for_each(|i| assert!(i != 40, "forty"))).await;
        assert_eq!(panicked, Err(ComputeError::Panicked("forty".to_owned())));
    }

    #[tokio::test]
    async fn work_whose_future_is_dropped_still_runs() {
        let compute = Compute::new("sand", 1).unwrap();
        let (tell, told) = oneshot::channel();
        drop(compute.run(move || tell.send(()).unwrap()));
        told.await.unwrap();
    }

    #[tokio::test]
    async fn threads_in_the_background_give_way_and_others_do_not() {
        let niceness = || rustix::process::getpriority_process(None).unwrap();
        let own = niceness();
        let background = Compute::in_background("sand", 1).unwrap();
        assert_eq!(background.run(niceness).await, Ok((own + NICENESS).min(19)));
        assert_eq!(Compute::new("sand", 1).unwrap().run(niceness).await, Ok(own));
        assert_eq!(niceness(), own);
    }

    #[test]
    fn a_pool_has_at_least_one_thread() {
        assert_eq!(Compute::new("sand", 0).unwrap().threads(), 1);
    }
}
