//! What is known of the object since the hold began.

/// What is known of the object since the hold began.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Object {
    /// It touched a fingertip.
    pub(super) was_felt: bool,
    /// Since when no fingertip feels it, µs.
    pub(super) gone_us: Option<u64>,
    /// It has been gone for long enough.
    pub(super) is_gone: bool,
    /// The gripper held something and reports that it no longer does.
    pub(super) is_lost_by_gripper: bool,
}
