//! The way into the microcontroller's bootloader, for a firmware update. It needs no common schema: these messages have a frozen
//! layout. Times in µs of the link's clock.

use gripline_protocol::message::{BOARDS, Bootloader, Hello, Message, MessagePackets, Refusal, Report};
use gripline_protocol::{Event, Parser};

use crate::patience::HANDSHAKE_US;
use crate::{Link, LinkError};

const RETRY_US: u64 = 200_000;
const STEP_US: u64 = 5_000;

/// The device's handshake, whatever its schema.
///
/// # Errors
/// [`LinkError`] when no device does.
pub fn identify(link: &mut dyn Link, session: u32) -> Result<Hello, LinkError> {
    let hello = Message::Hello(Hello::of_this_build(0, session));
    ask(link, &hello, "the handshake", |message| match message {
        Message::Hello(hello) => Some(hello),
        _ => None,
    })
}

/// Restarts it in its bootloader, which leaves this link. `who` is what [`identify`] found.
///
/// # Errors
/// [`LinkError`] when it refuses, or does not know how.
pub fn enter(link: &mut dyn Link, who: &Hello) -> Result<(), LinkError> {
    let request = Message::Bootloader(Bootloader::Enter);
    let question = "the request for its bootloader";
    let answer = ask(link, &request, question, |message| match message {
        Message::Bootloader(answer) => Some(Some(answer)),
        Message::Report(Report::Refused(Refusal::Unreadable)) => Some(None),
        _ => None,
    });
    let link = link.name();
    match answer {
        Ok(Some(Bootloader::Entering)) => Ok(()),
        Ok(Some(Bootloader::Holding)) => Err(LinkError::BootloaderHolding { link }),
        // Firmware of another schema refuses in words of its own.
        Ok(None | Some(Bootloader::Enter)) => Err(unknown(link, who)),
        Err(LinkError::NoAnswer { .. }) if who.check().is_err() => Err(unknown(link, who)),
        Err(error) => Err(error),
    }
}

fn unknown(link: String, who: &Hello) -> LinkError {
    let board = BOARDS.get(usize::from(who.board)).copied().unwrap_or("BOARD");
    LinkError::BootloaderUnknown {
        link,
        board: board.to_owned(),
    }
}

/// Repeats the request until `pick` accepts an answer.
fn ask<T>(
    link: &mut dyn Link,
    message: &Message,
    question: &'static str,
    pick: impl Fn(Message) -> Option<T>,
) -> Result<T, LinkError> {
    let until_us = link.now_us() + HANDSHAKE_US;
    let mut parser = Parser::new();
    let (mut answer, mut id) = (None, 0_u8);
    while link.now_us() < until_us {
        id = id.wrapping_add(1);
        for packet in MessagePackets::new(message, id)? {
            match link.send(&packet) {
                // It is asked again.
                Ok(()) | Err(LinkError::NotTaken { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        let again_us = link.now_us() + RETRY_US;
        while link.now_us() < again_us {
            link.run_until(link.now_us() + STEP_US, &mut |packet| {
                if let Ok(Event::Message(bytes)) = parser.push(packet)
                    && let Ok(message) = Message::from_bytes(bytes)
                    && answer.is_none()
                {
                    answer = pick(message);
                }
            })?;
            if let Some(answer) = answer.take() {
                return Ok(answer);
            }
        }
    }
    Err(LinkError::NoAnswer {
        link: link.name(),
        question,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::EmbeddedLink;
    use gripline_protocol::message::Command;

    #[test]
    fn a_released_gripper_goes_to_its_bootloader_without_a_handshake() {
        let mut link = EmbeddedLink::new();
        let who = identify(&mut link, 1).unwrap();
        assert_eq!(who.check(), Ok(()));
        enter(&mut link, &who).unwrap();
        let mut fresh = EmbeddedLink::new();
        enter(&mut fresh, &who).unwrap();
    }

    #[test]
    fn a_gripper_that_holds_refuses_by_name() {
        let mut link = EmbeddedLink::new();
        let who = identify(&mut link, 1).unwrap();
        for packet in MessagePackets::new(&Message::Command(Command::Hold), 1).unwrap() {
            link.send(&packet).unwrap();
        }
        let error = enter(&mut link, &who).unwrap_err();
        assert!(matches!(error, LinkError::BootloaderHolding { .. }), "{error}");
        assert!(error.to_string().contains("release it"), "{error}");
    }

    /// A microcontroller that answers every message with the same one.
    struct Parrot(Vec<Message>, u64, Vec<Vec<u8>>);

    impl Link for Parrot {
        fn send(&mut self, _: &[u8]) -> Result<(), LinkError> {
            for message in &self.0 {
                let packets = MessagePackets::new(message, 1).unwrap();
                self.2.extend(packets.map(|packet| packet.to_vec()));
            }
            Ok(())
        }

        fn run_until(&mut self, until_us: u64, received: &mut dyn FnMut(&[u8])) -> Result<(), LinkError> {
            self.1 = until_us;
            self.2.drain(..).for_each(|packet| received(&packet));
            Ok(())
        }

        fn now_us(&self) -> u64 {
            self.1
        }

        fn name(&self) -> String {
            "parrot".to_owned()
        }
    }

    #[test]
    fn older_firmware_of_any_schema_is_told_from_silence() {
        let same = Hello::of_this_build(1, 1);
        let other = Hello {
            schema_version: same.schema_version - 1,
            ..same
        };
        let unreadable = Message::Report(Report::Refused(Refusal::Unreadable));
        let error = enter(&mut Parrot(vec![unreadable], 0, Vec::new()), &same).unwrap_err();
        assert!(
            matches!(error, LinkError::BootloaderUnknown { .. }) && error.to_string().contains("stm32f405rg"),
            "{error}"
        );
        let error = enter(&mut Parrot(Vec::new(), 0, Vec::new()), &other).unwrap_err();
        assert!(matches!(error, LinkError::BootloaderUnknown { .. }), "{error}");
        let error = enter(&mut Parrot(Vec::new(), 0, Vec::new()), &same).unwrap_err();
        assert!(matches!(error, LinkError::NoAnswer { .. }), "{error}");
    }
}
