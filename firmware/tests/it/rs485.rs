//! The RS-485 transceiver on a fake UART and a fake pin of embedded-hal.

use std::cell::RefCell;
use std::convert::Infallible;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

use embedded_hal::digital::{ErrorType as PinErrorType, OutputPin};
use embedded_io_async::{ErrorKind, ErrorType, Write};
use gripline_firmware::rs485::{SendError, Transceiver};

/// What happened, in order.
#[derive(Debug, PartialEq, Eq)]
enum Event {
    Driver(bool),
    Byte(u8),
    Flushed,
}

struct Pin<'a>(&'a RefCell<Vec<Event>>);

impl PinErrorType for Pin<'_> {
    type Error = Infallible;
}

impl OutputPin for Pin<'_> {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.0.borrow_mut().push(Event::Driver(false));
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.0.borrow_mut().push(Event::Driver(true));
        Ok(())
    }
}

/// Takes two bytes at a time and fails after `room` bytes.
struct Uart<'a> {
    events: &'a RefCell<Vec<Event>>,
    room: usize,
}

impl ErrorType for Uart<'_> {
    type Error = ErrorKind;
}

impl Write for Uart<'_> {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, ErrorKind> {
        if self.room == 0 {
            return Err(ErrorKind::BrokenPipe);
        }
        let count = bytes.len().min(2).min(self.room);
        self.room -= count;
        let mut events = self.events.borrow_mut();
        events.extend(bytes[..count].iter().copied().map(Event::Byte));
        Ok(count)
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        self.events.borrow_mut().push(Event::Flushed);
        Ok(())
    }
}

/// Sends three bytes over a UART with so much room.
fn send(room: usize) -> (Result<(), SendError<ErrorKind, Infallible>>, Vec<Event>) {
    let events = RefCell::default();
    let uart = Uart {
        events: &events,
        room,
    };
    let Ok(mut bus) = Transceiver::new(uart, Pin(&events));
    let sent = match pin!(bus.send(&[9, 3, 7])).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(sent) => sent,
        Poll::Pending => panic!("the fakes never wait"),
    };
    (sent, events.into_inner())
}

#[test]
fn the_driver_is_on_from_before_the_first_byte_until_the_last_one_is_out() {
    let (sent, events) = send(3);
    assert_eq!(sent, Ok(()));
    assert_eq!(
        events,
        [
            Event::Driver(false),
            Event::Driver(true),
            Event::Byte(9),
            Event::Byte(3),
            Event::Byte(7),
            Event::Flushed,
            Event::Driver(false),
        ]
    );
}

#[test]
fn a_uart_that_fails_leaves_the_driver_off_and_the_bus_to_the_gripper() {
    let (sent, events) = send(2);
    assert_eq!(sent, Err(SendError::Uart(ErrorKind::BrokenPipe)));
    assert_eq!(events.last(), Some(&Event::Driver(false)));
}
