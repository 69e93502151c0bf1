//! Real time for the threads that call: SCHED_FIFO, memory that is never swapped, one core. Linux only.
//! What the system does not allow is told, with what to do about it; nothing of it is needed to run.

/// Per cent of the way from the least to the greatest: above ordinary programs, below the kernel's interrupt threads (50).
#[cfg(target_os = "linux")]
const PRIORITY: u8 = 40;
/// The same for what takes and decodes pictures: below the loop, which has work only when they have none.
#[cfg(target_os = "linux")]
const CAPTURE_PRIORITY: u8 = 39;

/// Asks for all of it and returns what could not be had, a line each. `core` counts from 0; `None` is the last one.
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

/// Asks for the priority alone, for the thread that takes and decodes a camera's pictures: it may use any core. Returns what could not be
/// had.
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

fn lack(what: &str, why: &str, expected: &str) -> String {
    format!("no real time: {what}: {why}, expected {expected}; the run goes on without")
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
    .map_err(|error| match error {
        thread_priority::Error::OS(number) => std::io::Error::from_raw_os_error(number).to_string(),
        other => format!("{other:?}"),
    })
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
