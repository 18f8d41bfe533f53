//! The loop of the render thread.

use crate::playback::export;
use crate::source::{Entry, FrameSource, Library, PendingSource};
use crate::thread::exchange::{
    Event, ExportOrder, FinishedFrame, Job, Location, Order, Picture, Shared, SourceInfo,
    WakeCallback,
};
use crate::thread::slot::{Next, Wait};
use egui::ColorImage;
use headbox_core::camera::Camera;
use headbox_core::view::SettingValues;
use headbox_core::view::{FrameRequest, Refinement};
use std::{
    any::Any,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{Arc, mpsc},
    time::{Duration, Instant},
};

/// State of the render thread.
pub(crate) struct Worker {
    shared: Arc<Shared>,
    events: mpsc::Sender<Event>,
    wake: WakeCallback,
    source: Option<Box<dyn FrameSource>>,
    coming: Option<PendingSource>,
    /// Counts sources, so that jobs meant for an earlier one are known.
    source_id: u64,
    library: Option<Box<dyn Library>>,
    /// Entries of the start page that have no picture yet, last first.
    unpictured: Vec<Entry>,
    /// The job to render again because its frame can become better, and when.
    again: Option<(Job, Instant)>,
    export: Option<Export>,
}

/// An export under way.
struct Export {
    order: ExportOrder,
    next: usize,
}

impl Worker {
    pub(crate) fn new(
        shared: Arc<Shared>,
        events: mpsc::Sender<Event>,
        wake: WakeCallback,
        source: Option<Box<dyn FrameSource>>,
        coming: Option<PendingSource>,
        library: Option<Box<dyn Library>>,
    ) -> Self {
        let (unpictured, again, export) = (Vec::new(), None, None);
        Self {
            shared,
            events,
            wake,
            source,
            coming,
            source_id: 0,
            library,
            unpictured,
            again,
            export,
        }
    }

    /// Works until the window closes the inbox. The newest view goes first, then exports,
    /// refinement and thumbnails.
    pub(crate) fn run(mut self) {
        if let Some(source) = self.source.take() {
            self.install(source);
        }
        if let Some(library) = &self.library {
            let (entries, extensions) = (library.entries(), library.extensions());
            self.unpictured = entries.iter().rev().cloned().collect();
            self.tell(Event::Offers {
                entries,
                extensions,
            });
        }
        if let Some(coming) = self.coming.take() {
            self.await_source(&coming);
        }
        loop {
            match self.shared.inbox.next(self.patience()) {
                Next::Closed => return,
                Next::Order(order) => self.obey(order),
                Next::Job(job) => self.render(job),
                Next::Nothing if self.export.is_some() => self.export_step(),
                Next::Nothing => match self.again.take() {
                    Some((job, _)) => self.render(job),
                    None => self.thumbnail_step(),
                },
            }
        }
    }

    /// Waits for a source that is opened elsewhere, or for the end of the window.
    fn await_source(&mut self, coming: &PendingSource) {
        /// Between two looks at whether the window was closed.
        const LOOK: Duration = Duration::from_millis(50);
        while !self.shared.inbox.is_closed() {
            match coming.source.recv_timeout(LOOK) {
                Err(mpsc::RecvTimeoutError::Timeout) => {}
                Err(mpsc::RecvTimeoutError::Disconnected) => {
                    return self.tell(Event::OpenFailed(format!(
                        "{} could not be opened.",
                        coming.name
                    )));
                }
                Ok(Ok(source)) => return self.install(source),
                Ok(Err(error)) => return self.tell(Event::OpenFailed(error)),
            }
        }
    }

    /// Time to wait for a newer request.
    fn patience(&self) -> Wait {
        match &self.again {
            _ if self.export.is_some() || self.wants_thumbnail() => Wait::No,
            Some((_, due)) => Wait::Until(*due),
            None => Wait::Forever,
        }
    }

    fn tell(&self, event: Event) {
        // The window may be gone already; then nobody needs to know.
        let _ = self.events.send(event);
        (self.wake)();
    }

    fn install(&mut self, source: Box<dyn FrameSource>) {
        self.source_id += 1;
        (self.again, self.export) = (None, None);
        let info = guarded(|| SourceInfo::of(&*source, self.source_id));
        match info {
            Ok(info) => {
                self.source = Some(source);
                self.tell(Event::Opened(Box::new(info)));
            }
            Err(panic) => self.tell(Event::OpenFailed(panic)),
        }
    }

    fn obey(&mut self, order: Order) {
        match order {
            Order::Open(location) => match self.open(&location) {
                Ok(source) => self.install(source),
                Err(error) => self.tell(Event::OpenFailed(error)),
            },
            Order::Close => (self.source, self.again, self.export) = (None, None, None),
            Order::Act(action) => {
                if let Some(source) = &mut self.source {
                    match guarded(|| source.act(action)) {
                        Ok(Ok(done)) => self.tell(Event::Done(done)),
                        Ok(Err(error)) => self.tell(Event::Error(error)),
                        Err(panic) => self.lose(panic),
                    }
                }
            }
            Order::Export(order) => self.export = Some(Export { order, next: 0 }),
            Order::CancelExport => {
                if self.export.take().is_some() {
                    self.tell(Event::Exported(None));
                }
            }
        }
    }

    fn open(&mut self, location: &Location) -> Result<Box<dyn FrameSource>, String> {
        let library = self
            .library
            .as_mut()
            .ok_or("This window shows one view only and opens no other.")?;
        let opened = match location {
            Location::Entry(id) => guarded(|| library.open_entry(id)),
            Location::File(path) => guarded(|| library.open_file(path)),
        };
        opened.and_then(|result| result)
    }

    /// Drops a source whose state is unknown after a panic.
    fn lose(&mut self, panic: String) {
        (self.source, self.again, self.export) = (None, None, None);
        self.tell(Event::Lost(panic));
    }

    fn render(&mut self, mut job: Job) {
        self.again = None;
        if job.source_id != self.source_id {
            return;
        }
        let Some(source) = &mut self.source else {
            return;
        };
        let started = Instant::now();
        let mut pictures = Vec::with_capacity(job.cameras.len() * job.sets.len());
        for camera in &job.cameras {
            for settings in &job.sets {
                match render_picture(&mut **source, &self.shared, *camera, settings, job.moving) {
                    Ok(picture) => pictures.push(picture),
                    Err(Failure::Error(error)) => return self.tell(Event::Error(error)),
                    Err(Failure::Panic(panic)) => return self.lose(panic),
                }
            }
        }
        let render_ms = started.elapsed().as_secs_f64() * 1e3;
        let due = pictures
            .iter()
            .filter_map(|p| due(p.report.refinement))
            .min();
        if let Some(unseen) = self.shared.finished.put(FinishedFrame {
            job: job.clone(),
            pictures,
            render_ms,
        }) {
            self.shared.recycle(unseen.pictures);
        }
        (self.wake)();
        if let Some(due) = due {
            job.round += 1;
            self.again = Some((job, due));
        }
    }

    /// Writes the next frame of the export.
    fn export_step(&mut self) {
        let (Some(export), Some(source)) = (&mut self.export, &mut self.source) else {
            self.export = None;
            return;
        };
        let total = export.order.path.poses().len();
        let event = match export_frame(&mut **source, &self.shared, export) {
            Ok(()) if export.next < total => Event::Exported(Some([export.next, total])),
            Ok(()) => Event::Done(format!(
                "{total} frames are in {}.",
                export.order.dir.display()
            )),
            Err(Failure::Error(error)) => Event::Error(error),
            Err(Failure::Panic(panic)) => return self.lose(panic),
        };
        if !matches!(event, Event::Exported(_)) {
            self.export = None;
            self.tell(Event::Exported(None));
        }
        self.tell(event);
    }

    fn wants_thumbnail(&self) -> bool {
        // Pictures are for the start page; a view that is being looked at has the thread to itself.
        self.source.is_none() && self.library.is_some() && !self.unpictured.is_empty()
    }

    fn thumbnail_step(&mut self) {
        let (Some(library), Some(entry)) = (&mut self.library, self.unpictured.pop()) else {
            return;
        };
        match guarded(|| library.thumbnail(&entry)) {
            Ok(Some(thumbnail)) => self.tell(Event::Thumbnail {
                id: entry.id,
                thumbnail,
            }),
            Ok(None) => {}
            Err(panic) => self.tell(Event::Error(panic)),
        }
    }
}

/// When to render a frame again.
fn due(refinement: Refinement) -> Option<Instant> {
    match refinement {
        Refinement::Done => None,
        Refinement::Next => Some(Instant::now()),
        Refinement::Later(after) => Some(Instant::now() + after),
    }
}

/// Why a picture could not be made.
enum Failure {
    Error(String),
    Panic(String),
}

fn render_picture(
    source: &mut dyn FrameSource,
    shared: &Shared,
    camera: Camera,
    settings: &Arc<SettingValues>,
    moving: bool,
) -> Result<Picture, Failure> {
    let size = [camera.width() as usize, camera.height() as usize];
    let mut pixels = shared.buffer(size[0] * size[1]);
    let request = FrameRequest {
        camera,
        settings: Arc::clone(settings),
        moving,
        complete: false,
        depth: false,
    };
    let report = guarded(|| source.render(&request, bytemuck::cast_slice_mut(&mut pixels)));
    let report = report.map_err(Failure::Panic)?.map_err(Failure::Error)?;
    Ok(Picture {
        image: Arc::new(ColorImage::new(size, pixels)),
        report,
    })
}

/// Renders and writes the next pose of an export; a source that converges is asked until it is
/// done.
fn export_frame(
    source: &mut dyn FrameSource,
    shared: &Shared,
    export: &mut Export,
) -> Result<(), Failure> {
    let order = &export.order;
    let pose = order.path.poses()[export.next].pose;
    let camera = pose
        .camera(order.size[0], order.size[1])
        .map_err(|e| Failure::Error(e.to_string()))?;
    let mut picture = render_picture(source, shared, camera, &order.settings, false)?;
    for _ in 1..MAX_EXPORT_ROUNDS {
        if picture.report.refinement != Refinement::Next {
            break;
        }
        shared.recycle([picture]);
        picture = render_picture(source, shared, camera, &order.settings, false)?;
    }
    let path = order.dir.join(format!("frame-{:05}.png", export.next));
    let written = export::write_png(
        &path,
        picture.image.width(),
        bytemuck::cast_slice(&picture.image.pixels),
    );
    shared.recycle([picture]);
    export.next += 1;
    written.map_err(|e| Failure::Error(format!("{} cannot be written: {e}.", path.display())))
}

/// Rounds after which a frame of an export is taken as it is.
const MAX_EXPORT_ROUNDS: u32 = 64;

/// Runs code of a source or library; a panic there becomes a sentence for the person at the window.
fn guarded<T>(call: impl FnOnce() -> T) -> Result<T, String> {
    // A source that panicked is dropped by the caller, so nothing half-done is seen again; a
    // library holds no frame state.
    catch_unwind(AssertUnwindSafe(call)).map_err(|panic| {
        let text = panic_text(&*panic);
        format!("The renderer stopped because of an error in the program: {text}")
    })
}

fn panic_text(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied())
        .unwrap_or("no details")
}
