//! Which link's maps count. One host owns a gripper at a time, so maps come over one link at a time: while those of one link are
//! fresh, those of the other are refused in constant time. So a map's last packet never waits for the sums of another link's map.
//!
//! Units: µs since start. Messages are always accepted from both links.

use crate::link::LinkId;

/// The link whose maps count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MapSource {
    link: LinkId,
    /// The other link may not begin before this.
    until_us: u64,
}

impl MapSource {
    /// The first map decides the link.
    pub(super) const fn new() -> Self {
        Self {
            link: LinkId::Usb,
            until_us: 0,
        }
    }

    /// Whether a map of this link that has begun counts.
    #[inline]
    pub(super) fn is(&self, link: LinkId) -> bool {
        self.link as u8 == link as u8
    }

    /// A map of the other link begins. It takes over when no map of this link was completed for `stale_ms`, and then has the same
    /// time for its first map. Incomplete maps do not keep a link.
    #[inline]
    pub(super) fn take_over(&mut self, link: LinkId, now_us: u64, stale_ms: u16) -> bool {
        if now_us < self.until_us {
            return false;
        }
        self.link = link;
        self.keep(now_us, stale_ms);
        true
    }

    /// A map of the link was completed.
    #[inline]
    pub(super) fn keep(&mut self, now_us: u64, stale_ms: u16) {
        self.until_us = now_us + u64::from(stale_ms) * 1_000;
    }
}
