//! A mailbox of one between two stages that run beside each other: who puts never waits, who takes gets the newest, and
//! what was overtaken before it was taken is counted. Nothing ever queues.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The mailbox; both sides hold it in an `Arc`.
#[derive(Debug)]
pub struct Mailbox<T> {
    slot: Mutex<Slot<T>>,
    changed: Condvar,
}

#[derive(Debug)]
struct Slot<T> {
    newest: Option<T>,
    overtaken: u64,
    is_closed: bool,
}

/// What a taker finds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Taken<T> {
    /// The newest.
    New(T),
    /// Nothing came in time.
    Nothing,
    /// Nothing is there and nothing will come any more.
    Closed,
}

impl<T> Default for Mailbox<T> {
    fn default() -> Self {
        Self {
            slot: Mutex::new(Slot {
                newest: None,
                overtaken: 0,
                is_closed: false,
            }),
            changed: Condvar::new(),
        }
    }
}

impl<T> Mailbox<T> {
    /// A slot is whole whenever its lock is free, whoever panicked.
    fn slot(&self) -> MutexGuard<'_, Slot<T>> {
        self.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts the newest in and returns what it overtook.
    pub fn put(&self, newest: T) -> Option<T> {
        let mut slot = self.slot();
        let overtaken = slot.newest.replace(newest);
        slot.overtaken += u64::from(overtaken.is_some());
        drop(slot);
        self.changed.notify_all();
        overtaken
    }

    /// Nothing more will come; what is there can still be taken.
    pub fn close(&self) {
        self.slot().is_closed = true;
        self.changed.notify_all();
    }

    /// Whether anything is there to be taken.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.slot().newest.is_some()
    }

    /// How many were overtaken before anybody took them.
    #[must_use]
    pub fn overtaken(&self) -> u64 {
        self.slot().overtaken
    }

    /// Waits until something is there, or for so long; answers whether there is.
    pub fn wait(&self, patience: Duration) -> bool {
        let waited = self.changed.wait_timeout_while(self.slot(), patience, |slot| {
            slot.newest.is_none() && !slot.is_closed
        });
        let (slot, _) = waited.unwrap_or_else(PoisonError::into_inner);
        slot.newest.is_some()
    }

    /// Takes the newest, waiting for so long when there is none.
    pub fn take(&self, patience: Duration) -> Taken<T> {
        self.wait(patience);
        let mut slot = self.slot();
        match slot.newest.take() {
            Some(newest) => Taken::New(newest),
            None if slot.is_closed => Taken::Closed,
            None => Taken::Nothing,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::thread;

    use super::*;

    #[test]
    fn the_newest_is_taken_once_and_everything_it_overtook_is_counted() {
        let mailbox = Mailbox::default();
        assert_eq!(mailbox.take(Duration::ZERO), Taken::Nothing);
        assert_eq!(mailbox.put(1), None);
        assert_eq!(mailbox.put(2), Some(1));
        assert_eq!(mailbox.put(3), Some(2));
        assert!(mailbox.is_full());
        assert_eq!(mailbox.take(Duration::ZERO), Taken::New(3));
        assert_eq!(mailbox.take(Duration::ZERO), Taken::Nothing);
        assert_eq!(mailbox.overtaken(), 2);
    }

    #[test]
    fn what_was_put_before_the_end_can_still_be_taken() {
        let mailbox = Mailbox::default();
        mailbox.put(7);
        mailbox.close();
        assert_eq!(mailbox.take(Duration::MAX), Taken::New(7));
        assert_eq!(mailbox.take(Duration::MAX), Taken::Closed);
    }

    #[test]
    fn between_two_threads_every_one_is_taken_or_counted_and_the_order_is_kept() {
        let mailbox = Arc::new(Mailbox::default());
        let putting = Arc::clone(&mailbox);
        let putter = thread::spawn(move || {
            for number in 1..=10_000_u64 {
                putting.put(number);
                if number.is_multiple_of(3) {
                    thread::yield_now();
                }
            }
            putting.close();
        });
        let (mut taken, mut last) = (0, 0);
        while let Taken::New(number) = mailbox.take(Duration::MAX) {
            assert!(number > last);
            (taken, last) = (taken + 1, number);
        }
        putter.join().unwrap();
        assert_eq!((last, taken + mailbox.overtaken()), (10_000, 10_000));
    }
}
