//! What the checks share: names, patience, and waiting.

use std::thread;
use std::time::{Duration, Instant};

/// A device that is plugged in again is to be back within this time.
pub(super) const BACK_WITHIN: Duration = Duration::from_secs(1);
/// Waiting for something that has no bound of its own.
pub(super) const PATIENCE: Duration = Duration::from_mins(1);
pub(super) const CAMERA: &str = "/dev/video0";
/// Rest pictures of the simulated fingertip, written by the host: the camera's own move, so a start would refuse them.
pub(super) const REST: &str = "/rest.toml";
/// Pictures of a camera that shows no fingertip cannot be believed: the run ends with code 3, and the forces are zero.
pub(super) const WITH_LOSS: i32 = 3;

pub(super) fn back_in_time(returns: &[Duration]) -> Result<String, String> {
    let slowest = returns.iter().max().copied().unwrap_or_default();
    let summary = format!("back {:.2} s after the system had it", slowest.as_secs_f64());
    if slowest > BACK_WITHIN {
        Err(summary)
    } else {
        Ok(summary)
    }
}

pub(super) fn wait_for(is_there: impl Fn() -> bool, what: &str) -> Result<(), String> {
    let start = Instant::now();
    while !is_there() {
        if start.elapsed() > PATIENCE {
            return Err(format!("{what}: not there after {} s", PATIENCE.as_secs()));
        }
        thread::sleep(Duration::from_millis(20));
    }
    Ok(())
}
