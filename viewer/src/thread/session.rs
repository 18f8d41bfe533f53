//! The render thread and the window's end of it.
//!
//! The window asks for the newest view and shows the latest finished frame; neither side waits for
//! the other. Everything slow (opening, rendering, writing path frames, thumbnails) happens on the
//! thread.

use crate::source::{FrameSource, Library, PendingSource};
use crate::thread::exchange::{Event, FinishedFrame, Job, Order, Picture, Shared, WakeCallback};
use crate::thread::worker::Worker;
use std::{
    sync::{Arc, mpsc},
    thread::{Builder, JoinHandle},
    time::Instant,
};

/// Something that is being opened.
pub(crate) struct Opening {
    pub what: String,
    pub since: Instant,
}

impl Opening {
    pub(crate) fn begin(what: String) -> Self {
        Self {
            what,
            since: Instant::now(),
        }
    }
}

/// The window's end of the render thread. Dropping it waits for the frame and the files in hand.
pub(crate) struct Session {
    shared: Arc<Shared>,
    sender: mpsc::Sender<Event>,
    events: mpsc::Receiver<Event>,
    wake: WakeCallback,
    threads: Vec<JoinHandle<()>>,
}

impl Session {
    /// Starts the thread; `wake` is called whenever there is news.
    pub(crate) fn start(
        source: Option<Box<dyn FrameSource>>,
        coming: Option<PendingSource>,
        library: Option<Box<dyn Library>>,
        wake: WakeCallback,
    ) -> std::io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let (sender, events) = mpsc::channel();
        let worker = Worker::new(
            Arc::clone(&shared),
            sender.clone(),
            Arc::clone(&wake),
            source,
            coming,
            library,
        );
        let thread = Builder::new()
            .name("render".into())
            .spawn(move || worker.run())?;
        Ok(Self {
            shared,
            sender,
            events,
            wake,
            threads: vec![thread],
        })
    }

    /// Asks for a view in place of any that was not begun.
    pub(crate) fn request(&self, job: Job) {
        self.shared.inbox.put_job(job);
    }

    /// Gives an order.
    pub(crate) fn order(&self, order: Order) {
        self.shared.inbox.push_order(order);
    }

    /// The latest finished frame, if it was not taken before.
    pub(crate) fn latest(&self) -> Option<FinishedFrame> {
        self.shared.finished.take()
    }

    /// The oldest piece of news not yet read.
    pub(crate) fn news(&self) -> Option<Event> {
        self.events.try_recv().ok()
    }

    /// Gives pictures back for reuse.
    pub(crate) fn recycle(&self, pictures: Vec<Picture>) {
        self.shared.recycle(pictures);
    }

    /// Does something slow (writing a file) on a thread of its own and tells the outcome as a
    /// message.
    pub(crate) fn in_background(
        &mut self,
        work: impl FnOnce() -> Result<String, String> + Send + 'static,
    ) {
        self.threads.retain(|thread| !thread.is_finished());
        let (sender, wake) = (self.sender.clone(), Arc::clone(&self.wake));
        let spawned = Builder::new().name("file".into()).spawn(move || {
            // The window may be gone already; then nobody needs to know.
            let _ = sender.send(work().map_or_else(Event::Error, Event::Done));
            wake();
        });
        match spawned {
            Ok(thread) => self.threads.push(thread),
            Err(error) => {
                // The receiver is ours, so this cannot fail.
                let _ = self
                    .sender
                    .send(Event::Error(format!("Cannot start a thread: {error}.")));
            }
        }
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.shared.inbox.close();
        for thread in self.threads.drain(..) {
            // A panic there has been reported as a message already.
            let _ = thread.join();
        }
    }
}
