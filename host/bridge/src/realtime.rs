//! Priorities of a run's threads. On request, real-time settings for the calling thread: SCHED_FIFO, memory that is never swapped,
//! one core. Readers' threads always run behind, and helpers on other cores. Linux only. Reports what the system does not allow, with a
//! remedy; a run works without it.

/// Percent of the range from minimum to maximum priority: above ordinary programs, below the kernel's interrupt threads (50).
#[cfg(target_os = "linux")]
const PRIORITY: u8 = 40;
/// The same for the camera thread: below the loop, which has work only when the camera thread has none.
#[cfg(target_os = "linux")]
const CAPTURE_PRIORITY: u8 = 39;
/// The same for the threads that serve readers, at ordinary priority: a niceness of 10.
#[cfg(target_os = "linux")]
const READERS_PRIORITY: u8 = 22;

/// Requests all of it and returns what was refused, one line each. `core` counts from 0; `None` is the last one.
#[cfg(target_os = "linux")]
pub(crate) fn enter(core: Option<usize>) -> Vec<String> {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let core = core.unwrap_or(cores - 1);
    [
        scheduler(PRIORITY).err().map(|why| {
            lack(
                "priority (SCHED_FIFO)",
                &why,
                "CAP_SYS_NICE or an rtprio limit (LimitRTPRIO=40 in the unit)",
            )
        }),
        locked_memory().err().map(|why| {
            lack(
                "locked memory",
                &why,
                "CAP_IPC_LOCK or a memlock limit (LimitMEMLOCK=infinity in the unit)",
            )
        }),
        pinned(core).err().map(|why| {
            lack(
                &format!("core {core}"),
                &why,
                "a core that this program may use, see realtime.core",
            )
        }),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// Calls `start` so that the threads that it starts, and theirs, run behind the loop: with a niceness of 10, a tenth of the
/// loop's share of a busy core. Not less, because requests come through them. Elsewhere than on Linux it only calls.
///
/// # Panics
/// When `start` does.
pub(crate) fn behind<T: Send>(start: impl FnOnce() -> T + Send) -> T {
    let begin = || {
        #[cfg(target_os = "linux")]
        if let Err(why) = nice() {
            tracing::warn!("readers keep the priority of the loop: {why}");
        }
        start()
    };
    std::thread::scope(|scope| {
        let begun = scope.spawn(begin).join();
        begun.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}

/// Requests only the priority, for the camera thread, which may use any core. Returns what was refused.
#[cfg(target_os = "linux")]
pub(crate) fn enter_capture() -> Option<String> {
    let why = scheduler(CAPTURE_PRIORITY).err()?;
    Some(lack(
        "priority of the camera's thread (SCHED_FIFO)",
        &why,
        "CAP_SYS_NICE or an rtprio limit (LimitRTPRIO=40 in the unit)",
    ))
}

/// There is nothing to ask for.
#[cfg(not(target_os = "linux"))]
pub(crate) fn enter_capture() -> Option<String> {
    None
}

/// There is nothing to ask for.
#[cfg(not(target_os = "linux"))]
pub(crate) fn enter(_core: Option<usize>) -> Vec<String> {
    vec![lack("everything", "this system is not Linux", "Linux")]
}

/// A thread, and the cores that it may use.
#[cfg(target_os = "linux")]
#[derive(Debug, Clone, Copy)]
pub(crate) struct Thread {
    id: nix::unistd::Pid,
    cores: Option<nix::sched::CpuSet>,
}

#[cfg(target_os = "linux")]
impl Thread {
    /// The calling one.
    pub(crate) fn current() -> Self {
        let id = nix::unistd::gettid();
        Self {
            id,
            cores: nix::sched::sched_getaffinity(id).ok(),
        }
    }

    /// Lets it run on its cores without this one; on all of them when there is no other. Where the system does not allow it, nothing changes.
    pub(crate) fn keep_off(&self, core: usize) {
        let Some(all) = self.cores else {
            return;
        };
        let mut others = all;
        let is_empty = |cores: &nix::sched::CpuSet| {
            (0..nix::sched::CpuSet::count()).all(|core| !cores.is_set(core).unwrap_or(false))
        };
        let cores = match others.unset(core) {
            Ok(()) if !is_empty(&others) => others,
            _ => all,
        };
        let _ = nix::sched::sched_setaffinity(self.id, &cores);
    }

    /// The cores that it may run on now, from 0.
    #[cfg(test)]
    pub(crate) fn runs_on(&self) -> Vec<usize> {
        let now = nix::sched::sched_getaffinity(self.id).unwrap();
        let all = 0..nix::sched::CpuSet::count();
        all.filter(|&core| now.is_set(core).unwrap()).collect()
    }
}

/// The core that the calling thread is on; `None` when the system does not say.
#[cfg(target_os = "linux")]
pub(crate) fn current_core() -> Option<usize> {
    nix::sched::sched_getcpu().ok()
}

/// A thread, which no other system than Linux is asked to move.
#[cfg(not(target_os = "linux"))]
#[derive(Debug, Clone, Copy)]
pub(crate) struct Thread;

#[cfg(not(target_os = "linux"))]
impl Thread {
    /// The calling one.
    pub(crate) fn current() -> Self {
        Self
    }

    /// Nothing.
    pub(crate) fn keep_off(&self, _core: usize) {}
}

/// Not known.
#[cfg(not(target_os = "linux"))]
pub(crate) fn current_core() -> Option<usize> {
    None
}

fn lack(what: &str, why: &str, expected: &str) -> String {
    format!("no real time: {what}: {why}, expected {expected}; the run goes on without")
}

#[cfg(target_os = "linux")]
fn nice() -> Result<(), String> {
    use thread_priority::unix::{
        NormalThreadSchedulePolicy, ThreadSchedulePolicy, set_thread_priority_and_policy, thread_native_id,
    };
    set_thread_priority_and_policy(
        thread_native_id(),
        thread_priority::ThreadPriority::Crossplatform(READERS_PRIORITY.try_into()?),
        ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other),
    )
    .map_err(reason)
}

#[cfg(target_os = "linux")]
fn reason(error: thread_priority::Error) -> String {
    match error {
        thread_priority::Error::OS(number) => std::io::Error::from_raw_os_error(number).to_string(),
        other => format!("{other:?}"),
    }
}

#[cfg(target_os = "linux")]
fn scheduler(priority: u8) -> Result<(), String> {
    use thread_priority::unix::{
        RealtimeThreadSchedulePolicy, ThreadSchedulePolicy, set_thread_priority_and_policy, thread_native_id,
    };
    let priority = priority.try_into()?;
    set_thread_priority_and_policy(
        thread_native_id(),
        thread_priority::ThreadPriority::Crossplatform(priority),
        ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo),
    )
    .map_err(reason)
}

#[cfg(target_os = "linux")]
fn locked_memory() -> Result<(), String> {
    use nix::sys::mman::{MlockAllFlags, mlockall};
    mlockall(MlockAllFlags::MCL_CURRENT | MlockAllFlags::MCL_FUTURE).map_err(|error| error.desc().to_owned())
}

#[cfg(target_os = "linux")]
fn pinned(core: usize) -> Result<(), String> {
    let mut cores = nix::sched::CpuSet::new();
    let this_thread = nix::unistd::Pid::from_raw(0);
    cores
        .set(core)
        .and_then(|()| nix::sched::sched_setaffinity(this_thread, &cores))
        .map_err(|error| error.desc().to_owned())
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    /// Niceness of the calling thread, from the system.
    fn niceness() -> i64 {
        let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
        // After the name, which may contain anything: state, parent and so on; the niceness is the 19th of all.
        let (_, fields) = stat.rsplit_once(") ").unwrap();
        fields.split(' ').nth(16).unwrap().parse().unwrap()
    }

    #[test]
    fn readers_and_what_they_start_run_behind_and_the_caller_as_before() {
        let before = niceness();
        let (of_readers, of_their_own) =
            behind(|| (niceness(), std::thread::spawn(niceness).join().unwrap()));
        assert_eq!((of_readers, of_their_own), (10, 10));
        assert_eq!(niceness(), before);
    }

    #[test]
    fn a_thread_is_kept_off_a_core_unless_it_has_no_other() {
        let on_its_own_thread = || {
            let thread = Thread::current();
            let all = thread.runs_on();
            for &core in &all {
                thread.keep_off(core);
                let others: Vec<_> = all.iter().copied().filter(|&other| other != core).collect();
                assert_eq!(
                    thread.runs_on(),
                    if others.is_empty() { all.clone() } else { others }
                );
            }
            pinned(all[0]).unwrap();
            Thread::current().keep_off(all[0]);
            assert_eq!(thread.runs_on(), all[..1]);
        };
        std::thread::spawn(on_its_own_thread).join().unwrap();
    }
}
