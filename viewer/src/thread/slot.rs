//! Channels between the window and the render thread that keep only the newest value.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Channel that holds at most one value, the newest. Neither side waits for the other.
#[derive(Debug)]
pub(crate) struct Slot<T>(Mutex<Option<T>>);

impl<T> Default for Slot<T> {
    fn default() -> Self {
        Self(Mutex::new(None))
    }
}

impl<T> Slot<T> {
    /// Stores `value` and returns the previous one, if it was not taken, for reuse.
    pub(crate) fn put(&self, value: T) -> Option<T> {
        lock(&self.0).replace(value)
    }

    /// Takes the newest value, if it was not taken before.
    pub(crate) fn take(&self) -> Option<T> {
        lock(&self.0).take()
    }
}

/// Requests to the render thread: a queue of orders, and the newest job.
#[derive(Debug)]
pub(crate) struct Inbox<Order, Job> {
    state: Mutex<InboxState<Order, Job>>,
    changed: Condvar,
}

#[derive(Debug)]
struct InboxState<Order, Job> {
    orders: VecDeque<Order>,
    job: Option<Job>,
    closed: bool,
}

/// Timeout of [`Inbox::next`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wait {
    No,
    Until(Instant),
    Forever,
}

/// Result of [`Inbox::next`].
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Next<Order, Job> {
    /// The oldest order; orders go before jobs.
    Order(Order),
    /// The newest job.
    Job(Job),
    /// The timeout expired.
    Nothing,
    /// The inbox is closed.
    Closed,
}

impl<Order, Job> Default for Inbox<Order, Job> {
    fn default() -> Self {
        let state = InboxState {
            orders: VecDeque::new(),
            job: None,
            closed: false,
        };
        Self {
            state: Mutex::new(state),
            changed: Condvar::new(),
        }
    }
}

impl<Order, Job> Inbox<Order, Job> {
    /// Replaces the waiting job, if any.
    pub(crate) fn put_job(&self, job: Job) {
        lock(&self.state).job = Some(job);
        self.changed.notify_one();
    }

    /// Appends an order.
    pub(crate) fn push_order(&self, order: Order) {
        lock(&self.state).orders.push_back(order);
        self.changed.notify_one();
    }

    /// Closes the inbox: ends all current and future waits.
    pub(crate) fn close(&self) {
        lock(&self.state).closed = true;
        self.changed.notify_all();
    }

    /// Takes the next request.
    pub(crate) fn next(&self, wait: Wait) -> Next<Order, Job> {
        let mut state = lock(&self.state);
        loop {
            if state.closed {
                return Next::Closed;
            }
            if let Some(order) = state.orders.pop_front() {
                return Next::Order(order);
            }
            if let Some(job) = state.job.take() {
                return Next::Job(job);
            }
            let left = match wait {
                Wait::No => return Next::Nothing,
                Wait::Forever => {
                    state = self
                        .changed
                        .wait(state)
                        .unwrap_or_else(PoisonError::into_inner);
                    continue;
                }
                Wait::Until(due) => due.saturating_duration_since(Instant::now()),
            };
            if left.is_zero() {
                return Next::Nothing;
            }
            state = self
                .changed
                .wait_timeout(state, left)
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
    }
}

/// Locks a mutex, even after a panic of another thread: no code of the viewer panics while it holds
/// an inconsistent value.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    #[test]
    fn the_slot_keeps_only_the_newest() {
        let slot = Slot::default();
        assert_eq!(slot.take(), None);
        assert_eq!(slot.put(1), None);
        assert_eq!(slot.put(2), Some(1), "the one nobody took comes back");
        assert_eq!(slot.take(), Some(2));
        assert_eq!(slot.take(), None);
    }

    #[test]
    fn orders_are_kept_in_order_and_go_first() {
        let inbox = Inbox::default();
        inbox.put_job('a');
        inbox.push_order(1);
        inbox.put_job('b');
        inbox.push_order(2);
        assert_eq!(inbox.next(Wait::No), Next::Order(1));
        assert_eq!(inbox.next(Wait::No), Next::Order(2));
        assert_eq!(inbox.next(Wait::No), Next::Job('b'));
        assert_eq!(inbox.next(Wait::No), Next::Nothing);
    }

    #[test]
    fn wait_ends_at_timeout_or_request() {
        let inbox = Inbox::<(), ()>::default();
        assert_eq!(
            inbox.next(Wait::Until(
                Instant::now() + std::time::Duration::from_millis(2)
            )),
            Next::Nothing
        );
        inbox.put_job(());
        assert_eq!(
            inbox.next(Wait::Until(Instant::now())),
            Next::Job(()),
            "what is there needs no time"
        );
    }

    #[test]
    fn closing_wakes_waiting_thread() {
        let inbox = Arc::new(Inbox::<(), ()>::default());
        let sleeper = std::thread::spawn({
            let inbox = Arc::clone(&inbox);
            move || inbox.next(Wait::Forever)
        });
        inbox.close();
        assert_eq!(sleeper.join().unwrap(), Next::Closed);
    }
}
