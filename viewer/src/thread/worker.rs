//! The loop of the render thread.

use crate::playback::export;
use crate::playback::thumbnails::ThumbnailCache;
use crate::source::{Entry, FrameSource, HeadboxRequest, Library, PendingSource};
use crate::thread::exchange::{
    Event, ExportOrder, FinishedFrame, Job, Location, Order, Picture, Probe, Shared, SourceInfo,
    WakeCallback,
};
use crate::thread::slot::{Next, Wait};
use egui::ColorImage;
use headbox_core::camera::Camera;
use headbox_core::panics;
use headbox_core::view::{FrameRequest, Refinement, SettingValues};
use std::{
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
    /// Number of sources so far: a job for an earlier one is dropped.
    source_id: u64,
    /// Number of orders to open or close so far.
    orders: u64,
    /// Source that another thread opens.
    coming: Option<PendingSource>,
    library: Option<Box<dyn Library>>,
    thumbnails: ThumbnailCache,
    /// Entries of the start page that have no thumbnail yet, last first.
    without_thumbnail: Vec<Entry>,
    /// Job to render again because its frame can improve, and the time to do so.
    refinement: Option<(Job, Instant)>,
    export: Option<Export>,
}

/// A running export.
struct Export {
    order: ExportOrder,
    next: usize,
}

impl Worker {
    pub(crate) fn new(
        shared: Arc<Shared>,
        events: mpsc::Sender<Event>,
        wake: WakeCallback,
        library: Option<Box<dyn Library>>,
        thumbnails: ThumbnailCache,
    ) -> Self {
        Self {
            shared,
            events,
            wake,
            source: None,
            source_id: 0,
            orders: 0,
            coming: None,
            library,
            thumbnails,
            without_thumbnail: Vec::new(),
            refinement: None,
            export: None,
        }
    }

    /// Runs until the window closes the inbox, initially with `source` or with one that another
    /// thread opens. The newest view has priority, then exports, refinement and thumbnails.
    pub(crate) fn run(
        mut self,
        source: Option<Box<dyn FrameSource>>,
        coming: Option<PendingSource>,
    ) {
        if let Some(source) = source {
            self.install(source);
        }
        if let Some(library) = &self.library {
            let (entries, extensions) = (library.entries(), library.extensions());
            self.without_thumbnail = entries.iter().rev().cloned().collect();
            self.send(Event::Library {
                entries,
                extensions,
            });
        }
        self.coming = coming;
        loop {
            match self.shared.inbox.next(self.request_timeout()) {
                Next::Closed => return,
                Next::Order(order) => self.execute(order),
                Next::Job(job) => self.render(job),
                Next::Nothing if self.coming.is_some() => self.poll_coming(),
                Next::Nothing if self.export.is_some() => self.export_step(),
                Next::Nothing => match self.refinement.take() {
                    Some((job, _)) => self.render(job),
                    None => self.thumbnail_step(),
                },
            }
        }
    }

    /// Installs the source that another thread opens, if it is ready.
    fn poll_coming(&mut self) {
        let Some(coming) = &self.coming else { return };
        let opened = match coming.source.try_recv() {
            Err(mpsc::TryRecvError::Empty) => return,
            Err(mpsc::TryRecvError::Disconnected) => {
                Err(format!("{} could not be opened.", coming.name))
            }
            Ok(opened) => opened,
        };
        self.coming = None;
        match opened {
            Ok(source) => self.install(source),
            Err(error) => self.send_failure(error),
        }
    }

    /// Timeout of the wait for the next request.
    fn request_timeout(&self) -> Wait {
        /// Interval of the test whether a source of another thread is ready.
        const POLL: Duration = Duration::from_millis(10);
        match &self.refinement {
            _ if self.coming.is_some() => Wait::Until(Instant::now() + POLL),
            _ if self.export.is_some() || self.wants_thumbnail() => Wait::No,
            Some((_, due)) => Wait::Until(*due),
            None => Wait::Forever,
        }
    }

    fn send(&self, event: Event) {
        // Fails only if the window is closed: then the event is not needed.
        let _ = self.events.send(event);
        (self.wake)();
    }

    fn install(&mut self, source: Box<dyn FrameSource>) {
        self.source_id += 1;
        (self.refinement, self.export) = (None, None);
        match catch_panic(|| SourceInfo::new(&*source, self.source_id)) {
            Ok(info) => {
                self.source = Some(source);
                let (info, orders) = (Box::new(info), self.orders);
                self.send(Event::Opened { info, orders });
            }
            Err(panic) => self.send_failure(panic),
        }
    }

    fn send_failure(&self, error: String) {
        let orders = self.orders;
        self.send(Event::OpenFailed { error, orders });
    }

    fn execute(&mut self, order: Order) {
        match order {
            Order::Open(location) => {
                (self.orders, self.coming) = (self.orders + 1, None);
                match self.open(&location) {
                    Ok(source) => self.install(source),
                    Err(error) => self.send_failure(error),
                }
            }
            Order::Close => {
                (self.orders, self.coming) = (self.orders + 1, None);
                (self.source, self.refinement, self.export) = (None, None, None);
            }
            Order::Probe(probe) => self.probe(probe),
            Order::Save { id, path } => {
                if let Some(source) = &mut self.source {
                    match catch_panic(|| source.save(id, &path)) {
                        Ok(Ok(done)) => self.send(Event::Done(done)),
                        Ok(Err(error)) => self.send(Event::Error(error)),
                        Err(panic) => self.drop_source(panic),
                    }
                }
            }
            Order::Headbox(request) => self.request_headbox(request),
            Order::Export(order) => self.export = Some(Export { order, next: 0 }),
            Order::CancelExport => {
                if self.export.take().is_some() {
                    self.send(Event::Exported(None));
                }
            }
        }
    }

    fn request_headbox(&mut self, request: HeadboxRequest) {
        let Some(source) = &mut self.source else {
            return;
        };
        let id = self.source_id;
        let requested = catch_panic(|| {
            let done = source.request_headbox(request)?;
            Ok::<_, String>((done, SourceInfo::new(&**source, id)))
        });
        match requested {
            Ok(Ok((done, info))) => {
                self.refinement = None;
                self.send(Event::HeadboxChanged(Box::new(info)));
                self.send(Event::Done(done));
            }
            Ok(Err(error)) => self.send(Event::Error(error)),
            Err(panic) => self.drop_source(panic),
        }
    }

    fn open(&mut self, location: &Location) -> Result<Box<dyn FrameSource>, String> {
        let library = self
            .library
            .as_mut()
            .ok_or("This window shows one view only and opens no other.")?;
        let opened = match location {
            Location::Entry(id) => catch_panic(|| library.open_entry(id)),
            Location::File(path) => catch_panic(|| library.open_file(path)),
        };
        opened.and_then(|result| result)
    }

    /// Drops a source whose state is unknown after a panic.
    fn drop_source(&mut self, panic: String) {
        (self.source, self.refinement, self.export) = (None, None, None);
        self.send(Event::Lost(panic));
    }

    fn render(&mut self, mut job: Job) {
        self.refinement = None;
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
                    Err(Failure::Error(error)) => return self.send(Event::Error(error)),
                    Err(Failure::Panic(panic)) => return self.drop_source(panic),
                }
            }
        }
        let render_ms = started.elapsed().as_secs_f64() * 1e3;
        let due = pictures
            .iter()
            .filter_map(|p| next_render_time(p.report.refinement))
            .min();
        if let Some(unshown) = self.shared.finished.put(FinishedFrame {
            job: job.clone(),
            pictures,
            render_ms,
        }) {
            self.shared.recycle(unshown.pictures);
        }
        (self.wake)();
        if let Some(due) = due {
            job.round += 1;
            self.refinement = Some((job, due));
        }
    }

    /// Measures the depth of a point by rendering the pixels about it.
    fn probe(&mut self, probe: Probe) {
        let (true, Some(source)) = (probe.source_id == self.source_id, &mut self.source) else {
            return;
        };
        let camera = probe.camera;
        let [width, height] = [camera.width(), camera.height()].map(|side| side as usize);
        let mut pixels = vec![[0; 4]; width * height];
        let request = FrameRequest {
            camera,
            settings: Arc::clone(&probe.settings),
            moving: true,
            complete: false,
            depth: true,
        };
        let [x, y] = [width, height].map(|side| side as f64 / 2.0);
        match catch_panic(|| source.render(&request, &mut pixels)) {
            Ok(Ok(report)) => {
                let ray = camera.direction(x, y);
                let point = report.depth_m.map(|depth_m| camera.eye() + ray * depth_m);
                let probe = Box::new(probe);
                self.send(Event::Probed { probe, point });
            }
            Ok(Err(error)) => self.send(Event::Error(error)),
            Err(panic) => self.drop_source(panic),
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
            Err(Failure::Panic(panic)) => return self.drop_source(panic),
        };
        if !matches!(event, Event::Exported(_)) {
            self.export = None;
            self.send(Event::Exported(None));
        }
        self.send(event);
    }

    fn wants_thumbnail(&self) -> bool {
        // Thumbnails are for the start page only: they would delay the frames of an open source.
        self.source.is_none() && self.library.is_some() && !self.without_thumbnail.is_empty()
    }

    fn thumbnail_step(&mut self) {
        let (Some(library), Some(entry)) = (&mut self.library, self.without_thumbnail.pop()) else {
            return;
        };
        let key = ThumbnailCache::entry_key(&entry.id);
        let known = key.as_ref().and_then(|key| self.thumbnails.read(key));
        let made = match known {
            Some(known) => Ok(Some(known)),
            None => catch_panic(|| {
                let made = library.thumbnail(&entry);
                if let (Some(key), Some(made)) = (&key, &made) {
                    self.thumbnails.write(key, made);
                }
                made
            }),
        };
        match made {
            Ok(Some(thumbnail)) => self.send(Event::Thumbnail {
                id: entry.id,
                thumbnail,
            }),
            Ok(None) => {}
            Err(panic) => self.send(Event::Error(panic)),
        }
    }
}

/// Time to render a frame again; `None` if it cannot improve.
fn next_render_time(refinement: Refinement) -> Option<Instant> {
    match refinement {
        Refinement::Done => None,
        Refinement::Next => Some(Instant::now()),
        Refinement::Later(after) => Some(Instant::now() + after),
    }
}

/// Failure to render or write a picture.
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
    let report = catch_panic(|| source.render(&request, bytemuck::cast_slice_mut(&mut pixels)));
    let report = report.map_err(Failure::Panic)?.map_err(Failure::Error)?;
    Ok(Picture {
        image: Arc::new(ColorImage::new(size, pixels)),
        report,
    })
}

/// Renders and writes the next pose of an export; renders repeatedly while the source converges.
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

/// Maximum number of renderings of an exported frame.
const MAX_EXPORT_ROUNDS: u32 = 64;

/// Runs code of a source or library; a panic becomes an error message.
fn catch_panic<T>(call: impl FnOnce() -> T) -> Result<T, String> {
    // Unwind safety: the caller drops a source that panicked, so its inconsistent state is not used
    // again; a library holds no frame state.
    catch_unwind(AssertUnwindSafe(call)).map_err(|panic| {
        let text = panics::message(&*panic);
        format!("The renderer stopped because of an error in the program: {text}")
    })
}
