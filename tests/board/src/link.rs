//! A link to the board of all host tests, which the test keeps a hand on while a session has it. Times in µs of the board's clock.

use std::cell::RefCell;
use std::rc::Rc;

use gripline_firmware::Start;
use gripline_link::{Link, LinkError};
use gripline_protocol::message::Message;
use gripline_protocol::{Event, Parser};

use crate::TestBoard;

/// The board, and what the host said to it.
pub struct Bench {
    /// The board.
    pub board: TestBoard,
    /// Every message of the host.
    pub heard: Vec<Message>,
    ear: Parser,
}

impl Bench {
    /// A board that was just powered on, in its first session.
    #[must_use]
    pub fn shared() -> Rc<RefCell<Self>> {
        let start = Start {
            session: 1,
            ..Start::default()
        };
        Rc::new(RefCell::new(Self {
            board: TestBoard::new(start),
            heard: Vec::new(),
            ear: Parser::new(),
        }))
    }
}

/// The link to a bench.
pub struct BenchLink(pub Rc<RefCell<Bench>>);

impl Link for BenchLink {
    fn send(&mut self, packet: &[u8]) -> Result<(), LinkError> {
        let mut bench = self.0.borrow_mut();
        if let Ok(Event::Message(bytes)) = bench.ear.push(packet)
            && let Ok(message) = Message::from_bytes(bytes)
        {
            bench.heard.push(message);
        }
        let _ = bench.board.packet(packet);
        Ok(())
    }

    fn run_until(&mut self, until_us: u64, received: &mut dyn FnMut(&[u8])) -> Result<(), LinkError> {
        let mut bench = self.0.borrow_mut();
        bench.board.pass_to(until_us, |_, _| {});
        while let Some(packet) = bench.board.replies.pop_front() {
            received(&packet);
        }
        Ok(())
    }

    fn now_us(&self) -> u64 {
        self.0.borrow().board.now_us()
    }

    fn name(&self) -> String {
        "bench".to_owned()
    }
}
