//! What a device in its bootloader says of itself: its states, and its status codes in words.

/// The longest that one operation may take: the erasure of 128 KiB takes up to 4 s at the lowest supply (data sheet).
pub(crate) const OPERATION_MS: u32 = 10_000;

/// States of a device (DFU 1.1, section 6.1.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// Waits for requests.
    Idle,
    /// A block came; the next question for the status begins the work.
    DownloadSync,
    /// Works.
    DownloadBusy,
    /// Waits for the next block.
    DownloadIdle,
    /// Starts what was written.
    Manifest,
    /// Waits for the next question for data.
    UploadIdle,
    /// Refused something.
    Error,
    /// Any other.
    Other(u8),
}

impl State {
    pub(crate) const fn of(number: u8) -> Self {
        match number {
            2 => Self::Idle,
            3 => Self::DownloadSync,
            4 => Self::DownloadBusy,
            5 => Self::DownloadIdle,
            7 => Self::Manifest,
            9 => Self::UploadIdle,
            10 => Self::Error,
            other => Self::Other(other),
        }
    }
}

/// What a status code says (DFU 1.1, section 6.1.2).
pub(crate) fn meaning(code: u8) -> &'static str {
    match code {
        0x01 => "the file is not for this device",
        0x02 => "the file fails a check of the device",
        0x03 => "the memory cannot be written",
        0x04 => "the memory cannot be erased",
        0x05 => "the memory is not erased",
        0x06 => "programming the memory failed",
        0x07 => "what was programmed reads otherwise",
        0x08 => "the address is out of range",
        0x0B => "a failure that the vendor defines, such as read protection",
        0x0F => "an unexpected request",
        _ => "unknown",
    }
}
