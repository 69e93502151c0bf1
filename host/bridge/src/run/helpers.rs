//! Threads that help the loop with a picture: the force network shares the search of its particles with them.

use std::sync::mpsc;

use rayon_core::{ThreadPool, ThreadPoolBuilder};

use crate::realtime::{self, Thread};

/// The helpers of the thread that started them. They sleep between the pictures.
#[derive(Default)]
pub(super) struct Helpers {
    /// Dropping it ends them.
    _pool: Option<ThreadPool>,
    threads: Vec<Thread>,
    /// The core that the loop had when they were last told to leave it.
    core: Option<usize>,
}

impl Helpers {
    /// Starts helpers, so that the calling thread and they are `threads`, but no more than there are cores. With `realtime` they ask for
    /// the camera thread's priority. Without any a run is only slower.
    pub(super) fn start(threads: usize, realtime: bool) -> Self {
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let threads = threads.min(cores);
        if threads < 2 {
            return Self::default();
        }
        let (sender, started) = mpsc::channel();
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads)
            .use_current_thread()
            .thread_name(|index| format!("network {index}"))
            .start_handler(move |_| {
                // What is refused is told of the loop's own thread.
                if realtime {
                    let _ = realtime::enter_capture();
                }
                let _ = sender.send(Thread::current());
            })
            .build();
        match pool {
            Ok(pool) => Self {
                _pool: Some(pool),
                threads: started.iter().take(threads - 1).collect(),
                core: None,
            },
            Err(why) => {
                tracing::warn!("network.threads: {why}; the loop works alone");
                Self::default()
            }
        }
    }

    /// Keeps them off the core that the calling thread is on now. Linux may wake a helper where its waker runs although another core
    /// idles, and there it helps nobody.
    pub(super) fn leave_this_core(&mut self) {
        let core = realtime::current_core();
        if core == self.core {
            return;
        }
        self.core = core;
        if let Some(core) = core {
            self.threads.iter().for_each(|thread| thread.keep_off(core));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn helpers_are_as_many_as_asked_for_and_as_there_are_cores() {
        let cores = std::thread::available_parallelism().unwrap().get();
        for (asked, expected) in [(1, 0), (2, 2.min(cores) - 1), (10_000, cores - 1)] {
            // A thread belongs to one pool for good.
            let started = std::thread::spawn(move || Helpers::start(asked, false).threads.len());
            assert_eq!(started.join().unwrap(), expected, "{asked}");
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn helpers_leave_the_core_of_the_loop_and_no_other() {
        let on_its_own_thread = || {
            let mut helpers = Helpers::start(2, false);
            let all = Thread::current().runs_on();
            helpers.leave_this_core();
            let core = helpers.core.unwrap();
            for helper in &helpers.threads {
                let others: Vec<_> = all.iter().copied().filter(|&other| other != core).collect();
                assert_eq!(helper.runs_on(), others);
            }
        };
        std::thread::spawn(on_its_own_thread).join().unwrap();
    }
}
