//! A thread that writes for a loop which must not wait: a full pipe, a stopped terminal or a slow reader costs what is written,
//! never the loop. The mailbox is bounded; what does not fit is dropped and counted.

use std::io;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

/// How long the end waits for what is still to be written, where the loop did not wait either.
const END_WAIT: Duration = Duration::from_secs(2);

/// How often the end looks for room.
const STEP: Duration = Duration::from_millis(2);

/// What happens when the mailbox is full.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum WhenFull {
    /// What does not fit is dropped.
    Drop,
    /// The loop has all the time there is, and waits.
    Wait,
}

/// The mailbox and the thread behind it.
#[derive(Debug)]
pub(crate) struct Writer<T> {
    queue: SyncSender<T>,
    ended: Receiver<io::Result<()>>,
    when_full: WhenFull,
    dropped: u64,
}

impl<T: Send + 'static> Writer<T> {
    /// Writes every item with `write`, until it fails.
    pub(crate) fn start(
        room: usize,
        when_full: WhenFull,
        mut write: impl FnMut(T) -> io::Result<()> + Send + 'static,
    ) -> Self {
        let (queue, items) = sync_channel(room);
        let (end, ended) = sync_channel(1);
        thread::spawn(move || {
            let written = items.iter().try_for_each(&mut write);
            // Gives back what it writes to before it says that it has ended.
            drop(write);
            drop(items);
            let _ = end.send(written);
        });
        Self {
            queue,
            ended,
            when_full,
            dropped: 0,
        }
    }

    /// Hands an item over. Returns whether more is wanted: not after a write failed, which [`Self::finish`] tells.
    pub(crate) fn offer(&mut self, item: T) -> bool {
        match self.when_full {
            WhenFull::Wait => self.queue.send(item).is_ok(),
            WhenFull::Drop => match self.queue.try_send(item) {
                Ok(()) => true,
                Err(TrySendError::Full(_)) => {
                    self.dropped += 1;
                    true
                }
                Err(TrySendError::Disconnected(_)) => false,
            },
        }
    }

    /// Hands over the last item, with a bounded wait for room.
    pub(crate) fn wait_once(&self, item: T) {
        let mut item = item;
        let begun = Instant::now();
        loop {
            match self.queue.try_send(item) {
                Err(TrySendError::Full(back))
                    if self.when_full == WhenFull::Wait || begun.elapsed() < END_WAIT =>
                {
                    item = back;
                    thread::sleep(STEP);
                }
                // Where it did not fit, the end says that nobody reads.
                _ => return,
            }
        }
    }

    /// How many did not fit so far.
    pub(crate) const fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Waits until all is written.
    ///
    /// # Errors
    /// What writing said; [`io::ErrorKind::TimedOut`] when its reader takes nothing.
    pub(crate) fn finish(self) -> io::Result<()> {
        drop(self.queue);
        let ended = match self.when_full {
            WhenFull::Wait => self.ended.recv().map_err(|_| RecvTimeoutError::Disconnected),
            WhenFull::Drop => self.ended.recv_timeout(END_WAIT),
        };
        match ended {
            Ok(written) => written,
            Err(RecvTimeoutError::Timeout) => Err(io::Error::new(
                io::ErrorKind::TimedOut,
                format!(
                    "found nobody who reads it for {} s, expected a reader",
                    END_WAIT.as_secs()
                ),
            )),
            Err(RecvTimeoutError::Disconnected) => Err(io::Error::other("its thread panicked")),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;

    #[test]
    fn a_writer_that_stands_still_never_holds_up_the_loop_and_every_drop_is_counted() {
        let written = Arc::new(Mutex::new(Vec::new()));
        let (begun, has_begun) = sync_channel(0);
        let of_thread = Arc::clone(&written);
        let mut writer = Writer::start(4, WhenFull::Drop, move |number: u32| {
            if number == 0 {
                begun.send(()).unwrap();
            }
            of_thread.lock().unwrap().push(number);
            Ok(())
        });
        let held = written.lock().unwrap();
        assert!(writer.offer(0));
        has_begun.recv().unwrap();
        // The thread stands still with the first one in its hands.
        assert!((1..100).all(|number| writer.offer(number)));
        assert_eq!(writer.dropped(), 95);
        drop(held);
        writer.finish().unwrap();
        assert_eq!(*written.lock().unwrap(), [0, 1, 2, 3, 4]);
    }

    #[test]
    fn a_failed_write_is_reported_at_the_end_and_nothing_more_is_wanted() {
        let mut writer = Writer::start(1, WhenFull::Wait, |_: u32| Err(io::ErrorKind::BrokenPipe.into()));
        while writer.offer(1) {}
        assert_eq!(writer.finish().unwrap_err().kind(), io::ErrorKind::BrokenPipe);
    }

    #[test]
    fn an_end_that_nobody_reads_is_reported_and_not_waited_for() {
        let (stop, stopped) = sync_channel::<()>(0);
        let mut writer = Writer::start(1, WhenFull::Drop, move |(): ()| {
            let _ = stopped.recv();
            Ok(())
        });
        assert!(writer.offer(()));
        assert_eq!(writer.finish().unwrap_err().kind(), io::ErrorKind::TimedOut);
        drop(stop);
    }
}
