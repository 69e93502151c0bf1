//! The readers of a stream: each has a short queue, and misses data while it is full.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The readers of one kind of stream.
#[derive(Debug, Default)]
pub(crate) struct Readers {
    state: Mutex<State>,
    count: AtomicUsize,
}

#[derive(Debug, Default)]
struct State {
    senders: Vec<SyncSender<Arc<str>>>,
    is_over: bool,
}

impl Readers {
    /// Whether there are readers; takes no lock.
    pub(crate) fn is_wanted(&self) -> bool {
        self.count.load(Ordering::Relaxed) > 0
    }

    /// Adds a reader with a queue of this length; `None` once the run is over.
    pub(crate) fn join(&self, waiting: usize) -> Option<Receiver<Arc<str>>> {
        let mut state = self.state();
        if state.is_over {
            return None;
        }
        let (sender, receiver) = sync_channel(waiting);
        state.senders.push(sender);
        self.count.store(state.senders.len(), Ordering::Relaxed);
        Some(receiver)
    }

    /// Sends it to all readers with room.
    pub(crate) fn send(&self, text: &Arc<str>) {
        let mut state = self.state();
        state.senders.retain(|sender| {
            !matches!(
                sender.try_send(Arc::clone(text)),
                Err(TrySendError::Disconnected(_))
            )
        });
        self.count.store(state.senders.len(), Ordering::Relaxed);
    }

    /// Ends every stream.
    pub(crate) fn close(&self) {
        let mut state = self.state();
        state.senders.clear();
        state.is_over = true;
        self.count.store(0, Ordering::Relaxed);
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_is_slow_misses_and_who_has_gone_is_forgotten() {
        let readers = Readers::default();
        let (slow, quick) = (readers.join(2).unwrap(), readers.join(10).unwrap());
        for number in 0..5 {
            readers.send(&number.to_string().into());
        }
        assert_eq!(
            slow.try_iter().map(|text| text.to_string()).collect::<Vec<_>>(),
            ["0", "1"]
        );
        assert_eq!(quick.try_iter().count(), 5);
        drop((slow, quick));
        assert!(readers.is_wanted());
        readers.send(&"last".into());
        assert!(!readers.is_wanted());
    }

    #[test]
    fn the_end_of_the_run_ends_every_stream() {
        let readers = Readers::default();
        let reader = readers.join(1).unwrap();
        readers.close();
        assert!(reader.recv().is_err() && readers.join(1).is_none());
    }
}
