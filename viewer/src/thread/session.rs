//! The window's handle of the render thread.
//!
//! The window requests the newest view and shows the latest finished frame; neither side waits for
//! the other. Everything slow (opening, rendering, writing path frames, thumbnails) runs on the
//! thread.

use crate::playback::thumbnails::ThumbnailCache;
use crate::source::{FrameSource, Library, PendingSource};
use crate::thread::exchange::{Event, FinishedFrame, Job, Order, Picture, Shared, WakeCallback};
use crate::thread::worker::Worker;
use std::{
    sync::{Arc, mpsc},
    thread::{Builder, JoinHandle},
    time::Instant,
};

/// A file or scene that is being opened.
pub(crate) struct Opening {
    pub name: String,
    pub since: Instant,
}

/// The window's handle of the render thread. Dropping it waits for unfinished frames and files.
pub(crate) struct Session {
    shared: Arc<Shared>,
    sender: mpsc::Sender<Event>,
    events: mpsc::Receiver<Event>,
    wake: WakeCallback,
    threads: Vec<JoinHandle<()>>,
}

impl Session {
    /// Starts the thread; `wake` is called for every event and finished frame.
    pub(crate) fn start(
        source: Option<Box<dyn FrameSource>>,
        coming: Option<PendingSource>,
        library: Option<Box<dyn Library>>,
        thumbnails: ThumbnailCache,
        wake: WakeCallback,
    ) -> std::io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let (sender, events) = mpsc::channel();
        let worker = Worker::new(
            Arc::clone(&shared),
            sender.clone(),
            Arc::clone(&wake),
            library,
            thumbnails,
        );
        let thread = Builder::new()
            .name("render".into())
            .spawn(move || worker.run(source, coming))?;
        Ok(Self {
            shared,
            sender,
            events,
            wake,
            threads: vec![thread],
        })
    }

    /// Requests a view; replaces a request that was not started.
    pub(crate) fn request(&self, job: Job) {
        self.shared.inbox.put_job(job);
    }

    /// Queues an order.
    pub(crate) fn order(&self, order: Order) {
        self.shared.inbox.push_order(order);
    }

    /// Takes the latest finished frame, if it was not taken before.
    pub(crate) fn take_frame(&self) -> Option<FinishedFrame> {
        self.shared.finished.take()
    }

    /// Takes the oldest event that was not yet read.
    pub(crate) fn next_event(&self) -> Option<Event> {
        self.events.try_recv().ok()
    }

    /// Returns the buffers of pictures to the pool.
    pub(crate) fn recycle(&self, pictures: Vec<Picture>) {
        self.shared.recycle(pictures);
    }

    /// Sends the event that `wait` returns, from its own thread. The window does not wait for it
    /// when it closes.
    pub(crate) fn send_later(&self, wait: impl FnOnce() -> Event + Send + 'static) {
        let (sender, wake) = (self.sender.clone(), Arc::clone(&self.wake));
        let spawned = Builder::new().name("dialog".into()).spawn(move || {
            // Fails only if the window is closed.
            let _ = sender.send(wait());
            wake();
        });
        if let Err(error) = spawned {
            self.send_thread_error(&error);
        }
    }

    fn send_thread_error(&self, error: &std::io::Error) {
        // The receiver is ours, so this cannot fail.
        let _ = self
            .sender
            .send(Event::Error(format!("Cannot start a thread: {error}.")));
    }

    /// Runs slow work (writing a file) on its own thread and reports the outcome as a message.
    pub(crate) fn run_in_background(
        &mut self,
        work: impl FnOnce() -> Result<String, String> + Send + 'static,
    ) {
        self.threads.retain(|thread| !thread.is_finished());
        let (sender, wake) = (self.sender.clone(), Arc::clone(&self.wake));
        let spawned = Builder::new().name("file".into()).spawn(move || {
            // Fails only if the window is closed: then the message is not needed.
            let _ = sender.send(work().map_or_else(Event::Error, Event::Done));
            wake();
        });
        match spawned {
            Ok(thread) => self.threads.push(thread),
            Err(error) => self.send_thread_error(&error),
        }
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.shared.inbox.close();
        for thread in self.threads.drain(..) {
            // A panic of the thread has already been reported as a message.
            let _ = thread.join();
        }
    }
}
