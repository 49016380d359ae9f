//! A mailbox with one slot: the newest item wins.
//!
//! A queue between capture and inference would add its length to the age of every picture. Here a new item replaces one that has not been
//! taken, and the replaced one is counted as dropped. The end is an item of its own kind: it is seen after the last item
//! and stays visible, so a reader can neither miss an error nor wait for a writer that is gone.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::Error;

/// How a stream of items ended.
#[derive(Debug, Clone)]
pub enum End {
    /// The source has no more pictures, or was told to stop.
    Finished,
    /// The source failed.
    Failed(Arc<Error>),
    /// The writing side went away without a word: its thread panicked.
    Abandoned,
}

/// What a reader finds.
#[derive(Debug)]
pub enum Wait<T> {
    /// An item that nobody has taken yet.
    Item(T),
    /// Nothing new within the time given.
    Empty,
    /// Nothing more will come.
    Ended(End),
}

#[derive(Debug)]
struct State<T> {
    slot: Option<T>,
    published: u64,
    dropped: u64,
    end: Option<End>,
    reader_gone: bool,
}

#[derive(Debug)]
struct Shared<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
}

impl<T> Shared<T> {
    fn lock(&self) -> MutexGuard<'_, State<T>> {
        // A panic while the lock is held leaves whole values behind: every change is one assignment.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Makes an empty mailbox.
///
/// ```
/// use ogg::capture::{End, Wait, mailbox};
/// let (publisher, latest) = mailbox();
/// publisher.publish(1);
/// publisher.publish(2);
/// publisher.finish();
/// assert!(matches!(latest.try_take(), Wait::Item(2)));
/// assert!(matches!(latest.try_take(), Wait::Ended(End::Finished)));
/// assert_eq!((latest.published(), latest.dropped()), (2, 1));
/// ```
pub fn mailbox<T>() -> (Publisher<T>, Latest<T>) {
    let state = State { slot: None, published: 0, dropped: 0, end: None, reader_gone: false };
    let shared = Arc::new(Shared { state: Mutex::new(state), changed: Condvar::new() });
    (Publisher { shared: Arc::clone(&shared) }, Latest { shared })
}

/// The writing side of a mailbox.
#[derive(Debug)]
pub struct Publisher<T> {
    shared: Arc<Shared<T>>,
}

impl<T> Publisher<T> {
    /// Puts an item into the slot, over one that has not been taken. Never waits for the reader. False once the reader is gone.
    pub fn publish(&self, item: T) -> bool {
        let mut state = self.shared.lock();
        if state.reader_gone {
            return false;
        }
        state.published += 1;
        if state.slot.replace(item).is_some() {
            state.dropped += 1;
        }
        drop(state);
        self.shared.changed.notify_all();
        true
    }

    /// Ends the stream without a failure.
    pub fn finish(self) {
        self.end(End::Finished);
    }

    /// Ends the stream with a failure.
    pub fn fail(self, error: Error) {
        self.end(End::Failed(Arc::new(error)));
    }

    fn end(&self, end: End) {
        self.shared.lock().end.get_or_insert(end);
        self.shared.changed.notify_all();
    }
}

impl<T> Drop for Publisher<T> {
    fn drop(&mut self) {
        self.end(End::Abandoned);
    }
}

/// The reading side of a mailbox.
#[derive(Debug)]
pub struct Latest<T> {
    shared: Arc<Shared<T>>,
}

impl<T> Latest<T> {
    /// Takes the newest item, if there is one that has not been taken.
    pub fn try_take(&self) -> Wait<T> {
        Self::take_from(&mut self.shared.lock())
    }

    /// Takes the newest item, waiting at most `timeout` for one.
    pub fn take(&self, timeout: Duration) -> Wait<T> {
        let nothing = |state: &mut State<T>| state.slot.is_none() && state.end.is_none();
        let (mut state, _) = self
            .shared
            .changed
            .wait_timeout_while(self.shared.lock(), timeout, nothing)
            .unwrap_or_else(PoisonError::into_inner);
        Self::take_from(&mut state)
    }

    fn take_from(state: &mut State<T>) -> Wait<T> {
        match (state.slot.take(), &state.end) {
            (Some(item), _) => Wait::Item(item),
            (None, Some(end)) => Wait::Ended(end.clone()),
            (None, None) => Wait::Empty,
        }
    }

    /// Items that were put in.
    pub fn published(&self) -> u64 {
        self.shared.lock().published
    }

    /// Items that were replaced before anybody took them.
    pub fn dropped(&self) -> u64 {
        self.shared.lock().dropped
    }
}

impl<T> Drop for Latest<T> {
    fn drop(&mut self) {
        self.shared.lock().reader_gone = true;
    }
}

#[cfg(test)]
mod tests {
    use std::thread;

    use super::*;

    #[test]
    fn an_empty_box_gives_nothing_and_does_not_end() {
        let (_publisher, latest) = mailbox::<u8>();
        assert!(matches!(latest.try_take(), Wait::Empty));
        assert!(matches!(latest.take(Duration::ZERO), Wait::Empty));
    }

    #[test]
    fn an_error_is_seen_after_the_last_item_and_stays() {
        let (publisher, latest) = mailbox();
        publisher.publish(7);
        publisher.fail(Error::Parameter { field: "rate", expected: "more", got: "less".to_owned() });
        assert!(matches!(latest.try_take(), Wait::Item(7)));
        for _ in 0..2 {
            let Wait::Ended(End::Failed(error)) = latest.try_take() else { panic!("the error is delivered") };
            assert_eq!(error.to_string(), "rate: expected more, got less");
        }
    }

    #[test]
    fn a_writer_that_panics_is_reported_to_a_waiting_reader() {
        let (publisher, latest) = mailbox::<u8>();
        let writer = thread::spawn(move || {
            let _publisher = publisher;
            // Unwinds like a panic and prints nothing.
            std::panic::resume_unwind(Box::new(()));
        });
        assert!(writer.join().is_err());
        assert!(matches!(latest.take(Duration::from_mins(1)), Wait::Ended(End::Abandoned)));
    }

    #[test]
    fn a_writer_learns_that_the_reader_is_gone() {
        let (publisher, latest) = mailbox();
        assert!(publisher.publish(1));
        drop(latest);
        assert!(!publisher.publish(2));
    }

    #[test]
    fn every_item_is_either_taken_or_counted_as_dropped_and_order_is_kept() {
        const ITEMS: u64 = 20_000;
        let (publisher, latest) = mailbox();
        let writer = thread::spawn(move || {
            for item in 0..ITEMS {
                publisher.publish(item);
            }
            publisher.finish();
        });
        let mut taken = Vec::new();
        loop {
            match latest.take(Duration::from_mins(1)) {
                Wait::Item(item) => taken.push(item),
                Wait::Ended(End::Finished) => break,
                other => panic!("{other:?}"),
            }
        }
        writer.join().unwrap();
        assert!(taken.is_sorted());
        assert_eq!(taken.last(), Some(&(ITEMS - 1)));
        assert_eq!(taken.len() as u64 + latest.dropped(), ITEMS);
    }
}
