//! A made-up USB bus with the firmware's library at its end, on a clock of the test's own; times in µs.
//! Shared by the tests of links and the test of random faults.
#![allow(dead_code, reason = "every test takes its share")]

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::rc::Rc;
use std::time::Duration;

use gripline_firmware::{Program, ResetCause, Start};
use gripline_link::LinkError;
use gripline_link::hot_plug::{Clock, Device, DeviceError};
use gripline_link::usb::{Attached, Bus};
use gripline_protocol::message::{Command, Hello, Message, MessagePackets};
use gripline_protocol::{Event, Parser};

/// Is shown the microcontroller, the time, and when it was last told to hold.
type Watcher = Box<dyn FnMut(&Program, u64, u64)>;

/// The world: what is attached, and the one microcontroller in it.
pub(crate) struct World {
    pub(crate) now_us: Cell<u64>,
    pub(crate) attached: RefCell<Vec<Attached>>,
    pub(crate) device: RefCell<gripline_firmware::Device>,
    /// Since when the microcontroller runs, and until when it is down after a reset.
    started_us: Cell<u64>,
    pub(crate) down_until_us: Cell<u64>,
    starts: Cell<u32>,
    /// What the host's clock shows more than the world's.
    pub(crate) host_ahead_us: Cell<i64>,
    next_tick_us: Cell<u64>,
    /// Looks at the microcontroller after everything that happens to it.
    pub(crate) watch: RefCell<Option<Watcher>>,
    /// When it was last told to hold: that counts as fresh for a moment.
    told_us: Cell<u64>,
    replies: RefCell<VecDeque<Vec<u8>>>,
    /// Nothing is taken though the device is there.
    pub(crate) is_stuck: Cell<bool>,
    /// What it says of itself in the handshake, instead of the truth.
    pub(crate) stranger: Cell<Option<Hello>>,
    pub(crate) opened: Cell<u32>,
    /// What is attached can be used from then on.
    pub(crate) ready_us: Cell<u64>,
}

pub(crate) fn device(serial: &str, place: &str) -> Attached {
    Attached {
        serial: Some(serial.to_owned()),
        place: place.to_owned(),
    }
}

impl World {
    pub(crate) fn with(attached: Vec<Attached>) -> Rc<Self> {
        Rc::new(Self {
            now_us: Cell::new(0),
            attached: RefCell::new(attached),
            device: RefCell::new(gripline_firmware::Device::new(Start {
                session: 7,
                ..Start::default()
            })),
            started_us: Cell::new(0),
            down_until_us: Cell::new(0),
            starts: Cell::new(7),
            host_ahead_us: Cell::new(0),
            next_tick_us: Cell::new(1_000),
            watch: RefCell::new(None),
            told_us: Cell::new(0),
            replies: RefCell::default(),
            is_stuck: Cell::new(false),
            stranger: Cell::new(None),
            opened: Cell::new(0),
            ready_us: Cell::new(0),
        })
    }

    /// The microcontroller lives on whether its cable is in or not.
    pub(crate) fn pass_to(&self, until_us: u64) {
        while self.next_tick_us.get() <= until_us {
            let now_us = self.next_tick_us.get();
            if now_us >= self.down_until_us.get() {
                let _ = self.device.borrow_mut().tick(now_us - self.started_us.get());
                self.look(now_us);
            }
            self.next_tick_us.set(now_us + 1_000);
            self.collect();
        }
        self.now_us.set(until_us.max(self.now_us.get()));
    }

    fn look(&self, now_us: u64) {
        if let Some(watch) = self.watch.borrow_mut().as_mut() {
            watch(&self.device.borrow().program, now_us, self.told_us.get());
        }
    }

    /// As a watchdog does it: everything is forgotten but the line.
    pub(crate) fn reset(&self, cause: ResetCause, down_us: u64) {
        self.starts.set(self.starts.get() + 1);
        self.started_us.set(self.now_us.get() + down_us);
        self.down_until_us.set(self.now_us.get() + down_us);
        let line = self.device.borrow().program.line();
        self.device.replace(gripline_firmware::Device::new(Start {
            reset: cause,
            restored_line: (cause != ResetCause::PowerOn).then_some(line),
            session: self.starts.get(),
            ..Start::default()
        }));
        self.replies.borrow_mut().clear();
    }

    fn collect(&self) {
        while let Some(packet) = self.device.borrow_mut().next_packet() {
            let reply = self.disguised(&packet);
            self.replies.borrow_mut().push_back(reply);
        }
    }

    /// A handshake says what the stranger would say.
    fn disguised(&self, packet: &[u8]) -> Vec<u8> {
        let mut parser = Parser::new();
        let (Some(stranger), Ok(Event::Message(message))) = (self.stranger.get(), parser.push(packet)) else {
            return packet.to_vec();
        };
        let Ok(Message::Hello(_)) = Message::from_bytes(message) else {
            return packet.to_vec();
        };
        MessagePackets::new(&Message::Hello(stranger), 1)
            .unwrap()
            .next()
            .unwrap()
            .to_vec()
    }

    fn is_there(&self, serial: &str) -> bool {
        let attached = self.attached.borrow();
        attached
            .iter()
            .any(|device| device.serial.as_deref() == Some(serial))
    }

    pub(crate) fn pull(&self) -> Vec<Attached> {
        // What was on the wire is lost.
        self.replies.borrow_mut().clear();
        self.attached.take()
    }
}

pub(crate) struct FakeClock(pub(crate) Rc<World>);

impl Clock for FakeClock {
    fn now_us(&self) -> u64 {
        self.0
            .now_us
            .get()
            .wrapping_add_signed(self.0.host_ahead_us.get())
    }

    fn wait_until(&self, us: u64) {
        self.0
            .pass_to(us.saturating_add_signed(-self.0.host_ahead_us.get()));
    }
}

pub(crate) struct FakeBus(pub(crate) Rc<World>);

impl Bus for FakeBus {
    fn attached(&mut self) -> Result<Vec<Attached>, String> {
        Ok(self.0.attached.borrow().clone())
    }

    fn open(&mut self, number: usize, link: &str) -> Result<Box<dyn Device>, LinkError> {
        if self.0.now_us.get() < self.0.ready_us.get() {
            return Err(LinkError::NotReady {
                link: link.to_owned(),
                found: "interface not found".to_owned(),
            });
        }
        self.0.opened.set(self.0.opened.get() + 1);
        let serial = self.0.attached.borrow()[number].serial.clone();
        Ok(Box::new(FakeDevice {
            world: Rc::clone(&self.0),
            serial: serial.unwrap_or_default(),
        }))
    }
}

struct FakeDevice {
    world: Rc<World>,
    serial: String,
}

impl FakeDevice {
    fn check(&self) -> Result<(), DeviceError> {
        if self.world.is_there(&self.serial) {
            Ok(())
        } else {
            Err(DeviceError::Gone("device disconnected".to_owned()))
        }
    }
}

impl Device for FakeDevice {
    fn send(&mut self, packet: &[u8]) -> Result<(), DeviceError> {
        self.check()?;
        let world = &self.world;
        if world.is_stuck.get() {
            return Err(DeviceError::Busy);
        }
        let now_us = world.now_us.get();
        if now_us >= world.down_until_us.get() {
            if let Ok(Event::Message(message)) = Parser::new().push(packet)
                && let Ok(Message::Command(Command::Hold)) = Message::from_bytes(message)
            {
                world.told_us.set(now_us);
            }
            let _ = world
                .device
                .borrow_mut()
                .packet(packet, now_us - world.started_us.get());
            world.look(now_us);
            world.collect();
        }
        Ok(())
    }

    fn receive(&mut self, patience: Duration, received: &mut dyn FnMut(&[u8])) -> Result<(), DeviceError> {
        self.check()?;
        self.world
            .pass_to(self.world.now_us.get() + patience.as_micros() as u64);
        while let Some(packet) = self.world.replies.borrow_mut().pop_front() {
            received(&packet);
        }
        Ok(())
    }
}
