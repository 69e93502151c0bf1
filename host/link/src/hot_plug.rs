//! A link to a device that may be pulled out and come back. While it is away, packets are lost and counted, never queued. The link
//! polls for the device at 10 Hz, so a missed hot-plug event does no harm. Times in µs since the link was opened. The first opening
//! waits for a device that is just being plugged in; without a device it fails.

use std::thread;
use std::time::{Duration, Instant};

use crate::error::LinkError;
use crate::link::{Link, Presence};
use crate::patience::READY_WITHIN;

/// Polling interval for a device that is away.
const POLL_PERIOD_US: u64 = 100_000;

/// Errors of a connected device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum DeviceError {
    /// It accepts nothing at the moment.
    Busy,
    /// It is gone: why.
    Gone(String),
}

/// A connected device, until its first [`DeviceError::Gone`].
pub trait Device {
    /// Sends one packet of at most 64 bytes.
    ///
    /// # Errors
    /// [`DeviceError`] when it does not accept the packet.
    fn send(&mut self, packet: &[u8]) -> Result<(), DeviceError>;

    /// Passes received packets to `received`, at most for this time; it may return earlier.
    ///
    /// # Errors
    /// [`DeviceError`] when it is gone.
    fn receive(&mut self, patience: Duration, received: &mut dyn FnMut(&[u8])) -> Result<(), DeviceError>;
}

/// Knows which device is meant, and opens it.
pub trait Finder {
    /// Opens it, if it is connected.
    ///
    /// # Errors
    /// [`LinkError`] with the reason.
    fn find(&mut self) -> Result<Box<dyn Device>, LinkError>;

    /// What it is, for people.
    fn name(&self) -> String;
}

/// The clock of a link: the wall clock, or a test's.
pub trait Clock {
    /// Time since the link was opened, µs.
    fn now_us(&self) -> u64;

    /// Waits.
    fn wait_until(&self, us: u64);
}

/// The clock on the wall.
#[derive(Debug)]
pub struct WallClock(Instant);

impl WallClock {
    /// It is 0 now.
    #[must_use]
    pub fn starting_now() -> Self {
        Self(Instant::now())
    }
}

impl Clock for WallClock {
    fn now_us(&self) -> u64 {
        self.0.elapsed().as_micros() as u64
    }

    fn wait_until(&self, us: u64) {
        thread::sleep(Duration::from_micros(us.saturating_sub(self.now_us())));
    }
}

/// The link.
pub struct HotPlug<C = WallClock> {
    finder: Box<dyn Finder>,
    clock: C,
    device: Option<Box<dyn Device>>,
    presence: Presence,
    next_poll_us: u64,
}

impl HotPlug {
    /// Opens the device for the first time.
    ///
    /// # Errors
    /// [`LinkError`] when it cannot be opened now.
    pub fn open(finder: Box<dyn Finder>) -> Result<Self, LinkError> {
        Self::open_with(finder, WallClock::starting_now())
    }
}

impl<C: Clock> HotPlug<C> {
    /// The same with another clock.
    ///
    /// # Errors
    /// As [`HotPlug::open`].
    pub fn open_with(mut finder: Box<dyn Finder>, clock: C) -> Result<Self, LinkError> {
        let until_us = clock.now_us() + READY_WITHIN.as_micros() as u64;
        let device = loop {
            match finder.find() {
                Err(LinkError::NotReady { .. }) if clock.now_us() < until_us => {
                    clock.wait_until(clock.now_us() + POLL_PERIOD_US);
                }
                found => break found?,
            }
        };
        Ok(Self {
            device: Some(device),
            finder,
            clock,
            presence: Presence::default(),
            next_poll_us: 0,
        })
    }

    fn lose(&mut self, why: String) {
        self.device = None;
        self.presence.losses += 1;
        self.presence.away = Some(why);
        self.next_poll_us = self.clock.now_us();
    }

    fn poll(&mut self) {
        match self.finder.find() {
            Ok(device) => {
                self.device = Some(device);
                self.presence.away = None;
            }
            Err(why) => {
                self.presence.away = Some(why.to_string());
                self.next_poll_us = self.clock.now_us() + POLL_PERIOD_US;
            }
        }
    }
}

impl<C: Clock> Link for HotPlug<C> {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        let found = match self.device.as_mut().map(|device| device.send(packet)) {
            Some(Ok(())) => return Ok(()),
            Some(Err(DeviceError::Busy)) => "it does not take packets".to_owned(),
            Some(Err(DeviceError::Gone(why))) => {
                self.lose(why.clone());
                why
            }
            None => "it is away".to_owned(),
        };
        self.presence.packets_lost += 1;
        Err(LinkError::NotTaken {
            link: self.finder.name(),
            found,
        })
    }

    fn run_until(&mut self, until_us: u64, received: &mut dyn FnMut(&[u8])) -> Result<(), LinkError> {
        loop {
            let now_us = self.clock.now_us();
            if let Some(device) = &mut self.device {
                let patience = Duration::from_micros(until_us.saturating_sub(now_us));
                match device.receive(patience, received) {
                    Err(DeviceError::Gone(why)) => self.lose(why),
                    Ok(()) | Err(DeviceError::Busy) => {}
                }
            } else if now_us >= self.next_poll_us {
                self.poll();
            } else {
                self.clock.wait_until(until_us.min(self.next_poll_us));
            }
            if self.clock.now_us() >= until_us {
                return Ok(());
            }
        }
    }

    fn now_us(&self) -> u64 {
        self.clock.now_us()
    }

    fn is_real_time(&self) -> bool {
        true
    }

    fn name(&self) -> String {
        format!("microcontroller on {}", self.finder.name())
    }

    fn presence(&self) -> Presence {
        self.presence.clone()
    }
}
