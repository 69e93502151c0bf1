//! A made-up USB bus with the firmware's library at its end, on a clock of the test's own; times in µs.
//! Shared by the tests of links and the test of random faults.
#![allow(dead_code, reason = "every test takes its share")]

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::time::Duration;

use gripline_firmware::{Program, ResetCause, Start};
use gripline_link::LinkError;
use gripline_link::hot_plug::{Clock, Device, DeviceError};
use gripline_link::usb::{Attached, Bus};
use gripline_protocol::message::{Command, Hello, Message, MessagePackets};
use gripline_protocol::{Event, Parser};
use gripline_test_board::TestBoard;

/// Is shown the microcontroller, the time, and when it was last told to hold.
type Watcher = Box<dyn FnMut(&Program, u64, u64)>;

/// The world: what is attached, and the one microcontroller in it.
pub(crate) struct World {
    pub(crate) attached: RefCell<Vec<Attached>>,
    pub(crate) board: RefCell<TestBoard>,
    /// What the host's clock shows more than the world's.
    pub(crate) host_ahead_us: Cell<i64>,
    /// Looks at the microcontroller after everything that happens to it.
    pub(crate) watch: RefCell<Option<Watcher>>,
    /// When it was last told to hold: that counts as fresh for a moment.
    told_us: Cell<u64>,
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
            attached: RefCell::new(attached),
            board: RefCell::new(TestBoard::new(Start {
                session: 7,
                ..Start::default()
            })),
            host_ahead_us: Cell::new(0),
            watch: RefCell::new(None),
            told_us: Cell::new(0),
            is_stuck: Cell::new(false),
            stranger: Cell::new(None),
            opened: Cell::new(0),
            ready_us: Cell::new(0),
        })
    }

    pub(crate) fn now_us(&self) -> u64 {
        self.board.borrow().now_us()
    }

    /// The microcontroller lives on whether its cable is in or not.
    pub(crate) fn pass_to(&self, until_us: u64) {
        let mut watch = self.watch.borrow_mut();
        self.board.borrow_mut().pass_to(until_us, |program, now_us| {
            if let Some(watch) = watch.as_mut() {
                watch(program, now_us, self.told_us.get());
            }
        });
    }

    /// As a watchdog does it: everything is forgotten but the line.
    pub(crate) fn reset(&self, cause: ResetCause, down_us: u64) {
        self.board.borrow_mut().reset(cause, down_us);
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
        self.board.borrow_mut().replies.clear();
        self.attached.take()
    }
}

pub(crate) struct FakeClock(pub(crate) Rc<World>);

impl Clock for FakeClock {
    fn now_us(&self) -> u64 {
        self.0.now_us().wrapping_add_signed(self.0.host_ahead_us.get())
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
        if self.0.now_us() < self.0.ready_us.get() {
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
        let now_us = world.now_us();
        if let Ok(Event::Message(message)) = Parser::new().push(packet)
            && let Ok(Message::Command(Command::Hold)) = Message::from_bytes(message)
            && world.board.borrow().is_up()
        {
            world.told_us.set(now_us);
        }
        let mut board = world.board.borrow_mut();
        if board.packet(packet).is_some()
            && let Some(watch) = world.watch.borrow_mut().as_mut()
        {
            watch(board.program(), now_us, world.told_us.get());
        }
        Ok(())
    }

    fn receive(&mut self, patience: Duration, received: &mut dyn FnMut(&[u8])) -> Result<(), DeviceError> {
        self.check()?;
        self.world
            .pass_to(self.world.now_us() + patience.as_micros() as u64);
        loop {
            let packet = self.world.board.borrow_mut().replies.pop_front();
            let Some(packet) = packet else {
                return Ok(());
            };
            received(&self.world.disguised(&packet));
        }
    }
}
