//! Times of the two clocks that meet in a force map. They share no zero ([`crate::clock_sync`]), so each has a type.
//! Units: µs.

/// A time on the host's clock, µs: when a picture was taken. Wraps after 71 minutes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct HostMicros(pub u32);

impl HostMicros {
    /// Time since `earlier`, µs; right up to 71 minutes.
    #[must_use]
    pub const fn since(self, earlier: Self) -> u32 {
        self.0.wrapping_sub(earlier.0)
    }

    /// This time plus `us`.
    #[must_use]
    pub const fn later_by(self, us: u32) -> Self {
        Self(self.0.wrapping_add(us))
    }
}

/// A time on the microcontroller's clock, µs since its start: when a map arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DeviceMicros(pub u64);
