//! A simulated USB bus with the board of all host tests at its end, on a clock of the test's own. Times in µs.
//!
//! Limits: one device, whatever is attached; transfers take no time.

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::time::Duration;

use gripline_firmware::{Program, ResetCause, Start};
use gripline_link::LinkError;
use gripline_link::hot_plug::{Clock, Device, DeviceError};
use gripline_link::usb::{Attached, Bus};
use gripline_protocol::message::{Command, Hello, Message, MessagePackets};
use gripline_protocol::{Event, Parser};

use crate::TestBoard;

/// Sees the program, the time and when a Hold last came, both in µs.
type Watcher = Box<dyn FnMut(&Program, u64, u64)>;

/// What is attached, and the one microcontroller on it.
pub struct FakeUsb {
    /// What the host finds on the bus.
    pub attached: RefCell<Vec<Attached>>,
    /// The microcontroller. It lives on while its cable is out.
    pub board: RefCell<TestBoard>,
    /// How far the host's clock is ahead of the test's, µs.
    pub host_ahead_us: Cell<i64>,
    /// Called after every packet and every tick.
    pub watch: RefCell<Option<Watcher>>,
    /// When a Hold last came: it counts as fresh for a moment.
    stamp_us: Cell<u64>,
    /// The device is there and takes nothing.
    pub is_stuck: Cell<bool>,
    /// Its answer to the handshake, instead of its own.
    pub stranger: Cell<Option<Hello>>,
    /// How often it was opened.
    pub opened: Cell<u32>,
    /// Opening fails before this time, µs.
    pub ready_us: Cell<u64>,
}

/// A device with this serial number at this place of the bus.
#[must_use]
pub fn device(serial: &str, place: &str) -> Attached {
    Attached {
        serial: Some(serial.to_owned()),
        place: place.to_owned(),
    }
}

impl FakeUsb {
    /// A bus with these devices.
    #[must_use]
    pub fn with(attached: Vec<Attached>) -> Rc<Self> {
        Rc::new(Self {
            attached: RefCell::new(attached),
            board: RefCell::new(TestBoard::new(Start {
                session: 7,
                ..Start::default()
            })),
            host_ahead_us: Cell::new(0),
            watch: RefCell::new(None),
            stamp_us: Cell::new(0),
            is_stuck: Cell::new(false),
            stranger: Cell::new(None),
            opened: Cell::new(0),
            ready_us: Cell::new(0),
        })
    }

    /// The test's time, µs.
    #[must_use]
    pub fn now_us(&self) -> u64 {
        self.board.borrow().now_us()
    }

    /// Time passes; the microcontroller runs whether its cable is in or not.
    pub fn pass_to(&self, until_us: u64) {
        let mut watch = self.watch.borrow_mut();
        self.board.borrow_mut().pass_to(until_us, |program, now_us| {
            if let Some(watch) = watch.as_mut() {
                watch(program, now_us, self.stamp_us.get());
            }
        });
    }

    /// Resets the microcontroller: without a power cut it keeps the line and nothing else.
    pub fn reset(&self, cause: ResetCause, down_us: u64) {
        self.board.borrow_mut().reset(cause, down_us);
    }

    /// The packet, with the stranger's answer in place of a handshake's.
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

    /// Pulls every cable; what was on the wire is lost. Returns what was attached.
    pub fn pull(&self) -> Vec<Attached> {
        self.board.borrow_mut().replies.clear();
        self.attached.take()
    }
}

/// The host's clock.
pub struct FakeClock(pub Rc<FakeUsb>);

impl Clock for FakeClock {
    fn now_us(&self) -> u64 {
        self.0.now_us().wrapping_add_signed(self.0.host_ahead_us.get())
    }

    fn wait_until(&self, us: u64) {
        self.0
            .pass_to(us.saturating_add_signed(-self.0.host_ahead_us.get()));
    }
}

/// The bus, as a host sees it.
pub struct FakeBus(pub Rc<FakeUsb>);

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
            usb: Rc::clone(&self.0),
            serial: serial.unwrap_or_default(),
        }))
    }
}

struct FakeDevice {
    usb: Rc<FakeUsb>,
    serial: String,
}

impl FakeDevice {
    fn check(&self) -> Result<(), DeviceError> {
        if self.usb.is_there(&self.serial) {
            Ok(())
        } else {
            Err(DeviceError::Gone("device disconnected".to_owned()))
        }
    }
}

impl Device for FakeDevice {
    fn send(&mut self, packet: &[u8]) -> Result<(), DeviceError> {
        self.check()?;
        let usb = &self.usb;
        if usb.is_stuck.get() {
            return Err(DeviceError::Busy);
        }
        let now_us = usb.now_us();
        if let Ok(Event::Message(message)) = Parser::new().push(packet)
            && let Ok(Message::Command(Command::Hold)) = Message::from_bytes(message)
            && usb.board.borrow().is_up()
        {
            usb.stamp_us.set(now_us);
        }
        let mut board = usb.board.borrow_mut();
        if board.packet(packet).is_some()
            && let Some(watch) = usb.watch.borrow_mut().as_mut()
        {
            watch(board.program(), now_us, usb.stamp_us.get());
        }
        Ok(())
    }

    fn receive(&mut self, patience: Duration, received: &mut dyn FnMut(&[u8])) -> Result<(), DeviceError> {
        self.check()?;
        self.usb.pass_to(self.usb.now_us() + patience.as_micros() as u64);
        loop {
            let packet = self.usb.board.borrow_mut().replies.pop_front();
            let Some(packet) = packet else {
                return Ok(());
            };
            received(&self.usb.disguised(&packet));
        }
    }
}
