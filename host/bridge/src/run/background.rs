//! Work that takes longer than a picture: comparisons of rest pictures, in one thread beside the loop. The thread starts before the
//! loop asks for real-time priority and a core, which every thread that the loop itself starts would inherit.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::LazyLock;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

type Job = Box<dyn FnOnce() + Send>;

/// Jobs that wait; a run has at most one of each fingertip and one re-zero.
const QUEUE: usize = 8;

static WORKER: LazyLock<SyncSender<Job>> = LazyLock::new(|| {
    let (sender, jobs) = sync_channel::<Job>(QUEUE);
    // Not behind the loop, as readers are: a client waits for a re-zero.
    thread::spawn(move || {
        for job in jobs {
            // A panic says so itself, and the next job has nothing to do with it.
            let _ = catch_unwind(AssertUnwindSafe(job));
        }
    });
    sender
});

/// Starts the thread. Later, it would inherit what the loop has asked for.
pub(super) fn start() {
    LazyLock::force(&WORKER);
}

/// Begins work and returns where its result arrives; nothing arrives from work that panics or finds no room in the queue.
pub(super) fn compute<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Receiver<T> {
    let (sender, result) = sync_channel(1);
    let job = move || {
        // Who does not wait any longer needs no result.
        let _ = sender.send(work());
    };
    let _ = WORKER.try_send(Box::new(job));
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(target_os = "linux")]
    #[test]
    fn work_runs_on_any_core_at_ordinary_priority_whoever_asks_for_it() {
        use nix::sched::{CpuSet, sched_setaffinity};
        use nix::unistd::Pid;
        use thread_priority::{NormalThreadSchedulePolicy, ThreadSchedulePolicy, thread_schedule_policy};

        use crate::realtime::{Thread, enter_capture};

        start();
        let on_a_thread_of_its_own = || {
            let all = Thread::current().runs_on();
            // As the loop does; where the system does not allow a priority, only the core counts.
            let _ = enter_capture();
            let mut first = CpuSet::new();
            first.set(all[0]).unwrap();
            sched_setaffinity(Pid::from_raw(0), &first).unwrap();
            assert_eq!(Thread::current().runs_on(), all[..1]);
            let found = compute(|| (Thread::current().runs_on(), thread_schedule_policy().unwrap()));
            let ordinary = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other);
            assert_eq!(found.recv().unwrap(), (all, ordinary));
        };
        thread::spawn(on_a_thread_of_its_own).join().unwrap();
    }

    #[test]
    fn work_that_panics_gives_no_result_and_the_next_one_does() {
        assert!(compute(|| -> u8 { panic!("made to panic") }).recv().is_err());
        assert_eq!(compute(|| 7).recv(), Ok(7));
    }
}
