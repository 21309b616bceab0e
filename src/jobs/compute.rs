//! The bridge from tokio to rayon.

use std::any::Any;
use std::fmt;
use std::future::Future;
use std::io::{self, Seek, SeekFrom, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::{ThreadPool, ThreadPoolBuilder};
use tokio::sync::oneshot;

/// Recursive factorizations and tree builds run deeper than the 2 MiB that threads get by default.
const STACK_BYTES: usize = 16 << 20;

/// How far a pool's threads give way to others: to those that talk to clients above all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Urgency {
    /// They give way to nobody.
    Prompt,
    /// They make large answers, and give way to threads that are done in a moment.
    Answers,
    /// They analyze, for up to hours.
    Background,
}

impl Urgency {
    /// Of 19: in the background, the least share that still leaves a tenth of a core that others want too.
    fn niceness(self) -> i32 {
        match self {
            Self::Prompt => 0,
            Self::Answers => 5,
            Self::Background => 10,
        }
    }
}

/// Tells work whether anybody still waits for it.
#[derive(Debug, Clone, Default)]
pub struct Wanted(Arc<AtomicBool>);

impl Wanted {
    /// Whether anybody still waits. Work that goes on for long asks between its pieces.
    #[must_use]
    pub fn is_wanted(&self) -> bool {
        !self.0.load(Ordering::Relaxed)
    }

    /// `inner`, which fails once nobody waits any more.
    pub fn writer<W: Write>(&self, inner: W) -> WantedWriter<W> {
        WantedWriter { wanted: self.clone(), inner }
    }
}

/// A writer that fails, by [`io::ErrorKind::ConnectionAborted`], once nobody waits for what is written.
#[derive(Debug)]
pub struct WantedWriter<W> {
    wanted: Wanted,
    inner: W,
}

impl<W: Write> Write for WantedWriter<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if !self.wanted.is_wanted() {
            return Err(io::Error::new(io::ErrorKind::ConnectionAborted, "nobody waits for it any more"));
        }
        self.inner.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

impl<W: Seek> Seek for WantedWriter<W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.inner.seek(to)
    }
}

/// Says that nobody waits any more when it is dropped.
struct Waiting(Wanted);

impl Drop for Waiting {
    fn drop(&mut self) {
        self.0.0.store(true, Ordering::Relaxed);
    }
}

/// A private pool of threads for numerical work, apart from tokio's and from rayon's global one.
///
/// Work waits until a thread is free, so what is done in a moment must not share a pool with what takes long: the service
/// makes a pool for each kind of work and leaves it to the operating system to share the cores.
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
    /// A pool of `threads` threads, called `name-0` and so on, that give way to nobody.
    ///
    /// # Errors
    /// [`ComputeError::Threads`].
    pub fn new(name: &'static str, threads: usize) -> Result<Self, ComputeError> {
        Self::with_urgency(name, threads, Urgency::Prompt)
    }

    /// As [`Self::new`], of threads that give way to more urgent ones.
    ///
    /// # Errors
    /// [`ComputeError::Threads`].
    pub fn with_urgency(name: &'static str, threads: usize, urgency: Urgency) -> Result<Self, ComputeError> {
        let begin = move |_| {
            if urgency != Urgency::Prompt {
                // On Linux a thread has a niceness of its own. Without it everything works, only later.
                let _ = rustix::process::nice(urgency.niceness());
            }
        };
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

    /// Starts `work` on the pool at once; the future waits for it. Parallel iterators inside it stay on the pool. Work that
    /// has not begun when the future is dropped never begins; work that runs is not stopped: see
    /// [`Self::run_while_wanted`].
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
        self.run_while_wanted(move |_| work())
    }

    /// As [`Self::run`], for work that is long enough to ask between its pieces whether anybody still waits for it.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn run_while_wanted<T, F>(
        &self,
        work: F,
    ) -> impl Future<Output = Result<T, ComputeError>> + Send + 'static + use<T, F>
    where
        T: Send + 'static,
        F: FnOnce(&Wanted) -> T + Send + 'static,
    {
        let (tell, told) = oneshot::channel();
        let wanted = Wanted::default();
        let waiting = Waiting(wanted.clone());
        self.pool.spawn(move || {
            if !wanted.is_wanted() {
                return;
            }
            // What the work shares with others, it shares behind locks and atomics that panics leave readable.
            let result = catch_unwind(AssertUnwindSafe(|| work(&wanted)));
            // Nobody may be waiting any more.
            let _ = tell.send(result.map_err(|panic| ComputeError::Panicked(words(&*panic))));
        });
        async move {
            let _waiting = waiting;
            told.await.unwrap_or_else(|_| Err(ComputeError::Panicked("its result was lost".to_owned())))
        }
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
    async fn work_that_nobody_waits_for_never_begins() {
        let compute = Compute::new("sand", 1).unwrap();
        let (begin, begun) = std::sync::mpsc::channel();
        let occupied = compute.run(move || begun.recv().unwrap());
        let (tell, mut told) = oneshot::channel();
        drop(compute.run(move || tell.send(()).unwrap()));
        begin.send(()).unwrap();
        occupied.await.unwrap();
        compute.run(|| ()).await.unwrap();
        assert!(matches!(told.try_recv(), Err(oneshot::error::TryRecvError::Closed)));
    }

    #[tokio::test]
    async fn work_is_told_between_its_pieces_that_nobody_waits_any_more() {
        let compute = Compute::new("sand", 1).unwrap();
        let (tell, told) = oneshot::channel();
        let (begin, mut begun) = oneshot::channel();
        let endless = compute.run_while_wanted(move |wanted| {
            begin.send(()).unwrap();
            let mut writer = wanted.writer(io::sink());
            while writer.write_all(b"sand").is_ok() {}
            tell.send(wanted.is_wanted()).unwrap();
        });
        let mut endless = Box::pin(endless);
        assert!(futures_util::poll!(&mut endless).is_pending());
        while begun.try_recv().is_err() {
            tokio::task::yield_now().await;
        }
        drop(endless);
        assert!(!told.await.unwrap());
        assert_eq!(compute.run(|| 5).await, Ok(5));
    }

    #[tokio::test]
    async fn threads_give_way_by_their_urgency() {
        let niceness = || rustix::process::getpriority_process(None).unwrap();
        let own = niceness();
        for urgency in [Urgency::Prompt, Urgency::Answers, Urgency::Background] {
            let compute = Compute::with_urgency("sand", 1, urgency).unwrap();
            assert_eq!(compute.run(niceness).await, Ok((own + urgency.niceness()).min(19)), "{urgency:?}");
        }
        assert_eq!(niceness(), own);
    }

    #[test]
    fn a_pool_has_at_least_one_thread() {
        assert_eq!(Compute::new("sand", 0).unwrap().threads(), 1);
    }
}
