//! Processor time of this process: all threads, user and system.

/// Seconds since the process began; `None` where the system does not tell.
#[cfg(target_os = "linux")]
pub(super) fn cpu_s() -> Option<f64> {
    use nix::sys::resource::{UsageWho, getrusage};
    let usage = getrusage(UsageWho::RUSAGE_SELF).ok()?;
    let seconds = |time: nix::sys::time::TimeVal| time.tv_sec() as f64 + time.tv_usec() as f64 / 1e6;
    Some(seconds(usage.user_time()) + seconds(usage.system_time()))
}

/// Seconds since the process began; `None` where the system does not tell.
#[cfg(not(target_os = "linux"))]
pub(super) fn cpu_s() -> Option<f64> {
    None
}
