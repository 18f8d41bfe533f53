//! Frames left out of an image set, judged against their photographs (E12's protocol, for S12).
//!
//! Every N-th view is left out. It is then shown from the others: by `nearest`, the one view nearest to it warped alone, by `near`, the
//! three nearest merged (what S24 builds while one moves), by `ldi`, all of them merged into one cube, and by view-dependent geometry
//! in each of its ways of texturing (E9). Errors are taken where all show something, so that
//! none gains by leaving out what is hard; the share that each covers stands beside them. Frames are exposed as the
//! photograph was. Where its camera stood is estimated with that of the others, as is usual for sets without surveyed cameras.

use crate::capture::Camera;
use crate::capture::images::{ImageSet, ImagesError, Lens, LoadedView, Registration, View};
use crate::frame::Frame;
use crate::ldi::CubeLdi;
use crate::ldi::from_images::ImagesJob;
use crate::measure::machine::{Machine, commit};
use crate::measure::stats::{Spread, pooled_psnr_db};
use crate::measure::table::{Table, figure, percent};
use crate::metrics;
use crate::packed::{PackError, PackedCube, SplatIndexLayout, Split};
use crate::progress::Progress;
use crate::render::{RenderSettings, Renderer};
use crate::view_geometry::{
    GeometryError, GeometryRenderer, GeometrySettings, Patience, SampleGrid, Texturing, ViewGeometry,
};
use glam::DVec3;
use image::{Rgb, RgbImage};
use serde::Serialize;

/// Why a set could not be measured.
#[derive(Debug, thiserror::Error)]
pub enum ImagesReportError {
    /// A view could not be read.
    #[error(transparent)]
    Images(#[from] ImagesError),
    /// A cube could not be packed.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// There is no view-dependent geometry.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// There is nothing to leave out.
    #[error("{0} views with depth: at least two are needed, so that one can be left out")]
    TooFew(usize),
}

/// One way to show one view that was left out.
#[derive(Clone, Debug, Serialize)]
pub struct HeldOut {
    /// The set.
    pub scene: String,
    /// One of the [`variants`].
    pub variant: &'static str,
    /// The view that was left out.
    pub view: String,
    /// Against the photograph, where all variants and the photograph show something, dB.
    pub psnr_db: f64,
    /// Mean FLIP there.
    pub flip: f64,
    /// Mean absolute difference there, levels of 255 (E12).
    pub mad: f64,
    /// The same near depth edges of the view, which is what the paper's crop shows (C28); NaN without any.
    pub mad_at_edges: f64,
    /// Share of the photograph's pixels that this variant covers.
    pub covered: f64,
    /// Of the frame, by the clock, ms.
    pub frame_ms: f64,
    /// From files to what frames are drawn from, by the clock, ms.
    pub build_ms: f64,
    /// Of that, bytes.
    pub bytes: u64,
}

/// All rows, and where they were measured.
#[derive(Clone, Debug, Serialize)]
pub struct ImagesReport {
    /// The computer.
    pub machine: Machine,
    /// The program.
    pub commit: String,
    /// A view in so many was left out.
    pub hold_out: usize,
    /// A row for each view and variant.
    pub rows: Vec<HeldOut>,
}

/// A frame and its photograph side by side, for looking at.
pub struct SideBySide {
    /// The view's name.
    pub view: String,
    /// The photograph.
    pub photograph: RgbImage,
    /// One for each of the [`variants`]; magenta where nothing is known.
    pub frames: Vec<RgbImage>,
}

/// Cubes that show a view: of the nearest other one alone, of the [`NEAR`] nearest, of all.
const CUBES: [&str; 3] = ["nearest", "near", "ldi"];

/// Ways to show a view: by cubes, and by view-dependent geometry.
pub fn variants() -> impl Iterator<Item = &'static str> + Clone {
    CUBES.into_iter().chain(Texturing::ALL.into_iter().map(|(name, _)| name))
}

/// Views that a cube is built of while one moves (S24).
const NEAR: usize = 3;

/// Where nothing is known of a pixel.
const HOLE: [u8; 3] = [255, 0, 255];

/// A pixel counts as covered from this share of 255 on.
const COVERED: u8 = 128;

/// How view-dependent geometry is made and drawn.
pub struct Geometry {
    /// Of frames; how they are textured does not count.
    pub settings: GeometrySettings,
    /// Of depth images.
    pub samples: SampleGrid,
    /// Bytes for pictures.
    pub budget: usize,
}

/// Measures a set; `show` is given every view's frames. With `hold_out` 1 each view is left out alone, else every
/// `hold_out`-th at once.
///
/// # Errors
/// See [`ImagesReportError`].
pub fn measure(
    set: &ImageSet,
    job: &ImagesJob,
    geometry: &Geometry,
    hold_out: usize,
    progress: &dyn Progress,
    show: &mut dyn FnMut(SideBySide),
) -> Result<ImagesReport, ImagesReportError> {
    let views: Vec<&View> = set.with_depth().collect();
    if views.len() < 2 {
        return Err(ImagesReportError::TooFew(views.len()));
    }
    let hold_out = hold_out.clamp(1, views.len());
    let rounds: Vec<Vec<usize>> = match hold_out {
        1 => (0..views.len()).map(|i| vec![i]).collect(),
        n => vec![(n / 2..views.len()).step_by(n).collect()],
    };
    let started = std::time::Instant::now();
    let opened = ViewGeometry::open(set, &views, &geometry.samples, geometry.budget, progress)?;
    let geometry_ms = started.elapsed().as_secs_f64() * 1e3;
    let mut bench = Bench {
        set,
        job,
        views: &views,
        progress,
        renderer: Renderer::new(),
        geometry: opened,
        geometry_ms,
        settings: GeometrySettings { hole_color_srgb: HOLE, ..geometry.settings },
        geometry_renderer: GeometryRenderer::new(),
        rows: Vec::new(),
    };
    for left_out in &rounds {
        bench.geometry.leave_out(left_out);
        let kept: Vec<&View> = (0..views.len()).filter(|i| !left_out.contains(i)).map(|i| views[i]).collect();
        let all = bench.cube(job.centre, &kept)?;
        for &i in left_out {
            bench.judge(i, left_out, &all, show)?;
        }
    }
    Ok(ImagesReport { machine: Machine::here(), commit: commit(), hold_out, rows: bench.rows })
}

struct Bench<'a> {
    set: &'a ImageSet,
    job: &'a ImagesJob,
    views: &'a [&'a View],
    progress: &'a dyn Progress,
    renderer: Renderer,
    geometry: ViewGeometry,
    geometry_ms: f64,
    settings: GeometrySettings,
    geometry_renderer: GeometryRenderer,
    rows: Vec<HeldOut>,
}

/// A frame of one variant.
struct Drawn {
    picture: RgbImage,
    covered: Vec<bool>,
    frame_ms: f64,
    build_ms: f64,
    bytes: u64,
}

/// A cube, and how long it took from files, ms.
type Built = (PackedCube, f64);

impl Bench<'_> {
    fn cube(&self, centre: DVec3, views: &[&View]) -> Result<Built, ImagesReportError> {
        let started = std::time::Instant::now();
        let job = ImagesJob { centre, ..self.job.clone() };
        let cube: CubeLdi = job.run(self.set, views, self.progress)?;
        let packed = PackedCube::pack(&cube, SplatIndexLayout::Normal, Split::Auto)?;
        Ok((packed, started.elapsed().as_secs_f64() * 1e3))
    }

    fn judge(
        &mut self,
        i: usize,
        left_out: &[usize],
        all: &Built,
        show: &mut dyn FnMut(SideBySide),
    ) -> Result<(), ImagesReportError> {
        let view = self.views[i];
        let gain = view.registration.map_or([1.0; 3], |registration| registration.gain);
        // As it was exposed: frames are then exposed alike.
        let registration = view.registration.map(|registration| Registration { gain: [1.0; 3], ..registration });
        let held = View { registration, ..view.clone() }.load()?;
        let Some(camera) = camera_of(&held) else { return Ok(()) };
        let (photograph, visible) = photograph(&held, &camera);
        let near = self.nearest(&held, i, left_out);
        let Some(nearest) = near.first() else { return Ok(()) };
        let centre = nearest.color_pose().eye;
        let [alone, few] = [self.cube(centre, &near[..1])?, self.cube(centre, &near)?];
        let mut drawn: Vec<Drawn> =
            [&alone, &few, all].into_iter().map(|cube| self.draw(cube, &camera, gain)).collect();
        drawn.extend(Texturing::ALL.into_iter().map(|(_, texturing)| self.draw_geometry(texturing, &camera, gain)));
        let judged: Vec<bool> =
            (0..visible.len()).map(|p| visible[p] && drawn.iter().all(|drawn| drawn.covered[p])).collect();
        let edges = near_edges(&held, &camera);
        let at_edges: Vec<bool> = judged.iter().zip(&edges).map(|(judged, edge)| *judged && *edge).collect();
        for (variant, drawn) in variants().zip(&drawn) {
            let (psnr_db, flip) = errors(&photograph, &drawn.picture, &judged);
            let mad = |pixels: &[bool]| mean_difference(&photograph, &drawn.picture, pixels);
            let covered =
                drawn.covered.iter().zip(&visible).filter(|(covered, visible)| **covered && **visible).count();
            self.rows.push(HeldOut {
                scene: self.set.folder.display().to_string(),
                variant,
                view: view.name.clone(),
                psnr_db,
                flip,
                mad: mad(&judged),
                mad_at_edges: mad(&at_edges),
                covered: covered as f64 / visible.iter().filter(|visible| **visible).count().max(1) as f64,
                frame_ms: drawn.frame_ms,
                build_ms: drawn.build_ms,
                bytes: drawn.bytes,
            });
        }
        let frames = drawn.into_iter().map(|drawn| drawn.picture).collect();
        show(SideBySide { view: view.name.clone(), photograph, frames });
        Ok(())
    }

    /// The views from which a held-out view's points move least in the picture, of those that are kept, the nearest first.
    fn nearest(&self, held: &LoadedView, i: usize, left_out: &[usize]) -> Vec<&View> {
        let mut depths: Vec<f32> = held.depth.iter().copied().filter(|depth| depth.is_finite()).collect();
        depths.sort_by(f32::total_cmp);
        let depth = f64::from(depths.get(depths.len() / 2).copied().unwrap_or(1.0));
        let moved = |view: &View| {
            let pose = view.color_pose();
            pose.eye.distance(held.pose.eye) / depth
                + pose.world_from_eye.z_axis.angle_between(held.pose.world_from_eye.z_axis)
        };
        let kept = |j: &usize| *j != i && !left_out.contains(j);
        let mut views: Vec<&View> = (0..self.views.len()).filter(kept).map(|j| self.views[j]).collect();
        views.sort_by(|a, b| moved(a).total_cmp(&moved(b)));
        views.truncate(NEAR);
        views
    }

    /// Draws a cube.
    fn draw(&mut self, (cube, build_ms): &Built, camera: &Camera, gain: [f32; 3]) -> Drawn {
        let settings = RenderSettings { hole_color_srgb: HOLE, keep_holes: true, ..RenderSettings::default() };
        self.renderer.render(cube, camera, &settings);
        self.renderer.render(cube, camera, &settings);
        let (frame, stats) = self.renderer.render_with_stats(cube, camera, &settings);
        Drawn::new(frame, gain, stats.frame_ms, *build_ms, cube.bytes())
    }

    /// Draws view-dependent geometry in a way.
    fn draw_geometry(&mut self, texturing: Texturing, camera: &Camera, gain: [f32; 3]) -> Drawn {
        let settings = GeometrySettings { texturing, ..self.settings };
        self.geometry_renderer.render(&self.geometry, camera, &settings, Patience::Wait);
        let (frame, stats) = self.geometry_renderer.render(&self.geometry, camera, &settings, Patience::Wait);
        Drawn::new(frame, gain, stats.frame_ms, self.geometry_ms, self.geometry.bytes())
    }
}

impl Drawn {
    /// Of a frame, each channel's levels times its gain.
    fn new(frame: &Frame, gain: [f32; 3], frame_ms: f64, build_ms: f64, bytes: usize) -> Self {
        let pixel = |x: u32, y: u32| {
            let color = frame.color[(y * frame.width + x) as usize];
            let exposed = |c: usize| (f32::from(color[c]) * gain[c] + 0.5).min(255.0) as u8;
            if frame.coverage[(y * frame.width + x) as usize].splat_share() < COVERED {
                Rgb(HOLE)
            } else {
                Rgb([0, 1, 2].map(exposed))
            }
        };
        Self {
            picture: RgbImage::from_fn(frame.width, frame.height, pixel),
            covered: frame.coverage.iter().map(|coverage| coverage.splat_share() >= COVERED).collect(),
            frame_ms,
            build_ms,
            bytes: bytes as u64,
        }
    }
}

/// The camera of a view with square pixels.
pub(super) fn camera_of(view: &LoadedView) -> Option<Camera> {
    let Lens::Pinhole(pinhole) = view.lens else { return None };
    let [width, height] = view.size_px;
    let camera =
        Camera::from_parts(view.pose.eye, view.pose.world_from_eye, pinhole.focal_px[1], width, height).ok()?;
    Some(camera.with_principal_px(pinhole.principal_px))
}

/// What a view shows on a camera's pixels, and which of these it shows at all.
pub(super) fn photograph(view: &LoadedView, camera: &Camera) -> (RgbImage, Vec<bool>) {
    let (mut picture, mut visible) = (RgbImage::new(camera.width(), camera.height()), Vec::new());
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let direction = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let there = view.lens.project(view.pose.world_from_eye.transpose() * direction, view.size_px);
        let color = there.and_then(|[px, py, _]| {
            let inside = px >= 0.0 && py >= 0.0 && px < f64::from(view.size_px[0]) && py < f64::from(view.size_px[1]);
            let opaque = inside && view.color[py as usize * view.size_px[0] as usize + px as usize][3] > 0;
            opaque.then(|| view.color_at([px, py])).flatten()
        });
        visible.push(color.is_some());
        *pixel = Rgb(color.unwrap_or_default().map(|c| (c + 0.5) as u8));
    }
    (picture, visible)
}

/// PSNR in dB and mean FLIP over the pixels that are judged.
pub(super) fn errors(photograph: &RgbImage, frame: &RgbImage, judged: &[bool]) -> (f64, f64) {
    let mut test = frame.clone();
    let (mut squares, mut count) = (0.0, 0u64);
    for ((truth, test), judged) in photograph.pixels().zip(test.pixels_mut()).zip(judged) {
        if *judged {
            count += 1;
            squares += (0..3).map(|c| f64::from(truth[c].abs_diff(test[c])).powi(2)).sum::<f64>();
        } else {
            *test = *truth; // no error
        }
    }
    let mean_square = squares / (3.0 * count.max(1) as f64);
    let share = count as f64 / judged.len().max(1) as f64;
    let flip = metrics::compare(photograph, &test).map_or(f64::NAN, |comparison| comparison.flip / share);
    (10.0 * (255.0f64.powi(2) / mean_square).log10(), flip)
}

/// Mean absolute difference over the pixels that are judged, levels of 255; NaN if there are none.
pub(super) fn mean_difference(photograph: &RgbImage, frame: &RgbImage, judged: &[bool]) -> f64 {
    let pixels = photograph.pixels().zip(frame.pixels()).zip(judged).filter(|(_, judged)| **judged);
    let (mut sum, mut count) = (0u64, 0u64);
    for ((truth, test), _) in pixels {
        sum += (0..3).map(|c| u64::from(truth[c].abs_diff(test[c]))).sum::<u64>();
        count += 3;
    }
    sum as f64 / count as f64
}

/// Which of a camera's pixels lie near a depth edge of the view, or near where its depth ends.
fn near_edges(view: &LoadedView, camera: &Camera) -> Vec<bool> {
    /// Neighbours whose depths differ by more than this share belong to different surfaces.
    const EDGE: f32 = 0.1;
    /// Half of a window's side, pixels.
    const NEAR_PX: usize = 6;
    let [width, height] = view.size_px.map(|side| side as usize);
    let depth = |x: usize, y: usize| view.depth.get(y * width + x).copied().unwrap_or(f32::NAN);
    let parts = |a: f32, b: f32| (a - b).abs() > EDGE * a.min(b);
    let mut near = vec![false; camera.width() as usize * camera.height() as usize];
    for (x, y) in (0..height.saturating_sub(1)).flat_map(|y| (0..width.saturating_sub(1)).map(move |x| (x, y))) {
        let here = depth(x, y);
        if !(parts(here, depth(x + 1, y)) || parts(here, depth(x, y + 1))) {
            continue;
        }
        let columns = x.saturating_sub(NEAR_PX)..(x + NEAR_PX + 1).min(width);
        for row in y.saturating_sub(NEAR_PX)..(y + NEAR_PX + 1).min(height) {
            near[row * width + columns.start..row * width + columns.end].fill(true);
        }
    }
    near
}

impl ImagesReport {
    /// Some lines and a table.
    pub fn summary(&self) -> String {
        let of = |variant: &'static str| self.rows.iter().filter(move |row| row.variant == variant);
        let psnr = |variant: &'static str| pooled_psnr_db(of(variant).map(|row| row.psnr_db));
        let mean = |variant: &'static str, value: fn(&HeldOut) -> f64| {
            Spread::of(&of(variant).map(value).collect::<Vec<_>>()).map_or(f64::NAN, |spread| spread.mean)
        };
        let head = ["variant", "PSNR dB", "FLIP", "MAD", "MAD at edges", "covered", "frame ms", "build ms", "MB"];
        let mut table = Table::new(head);
        for variant in variants() {
            table.row([
                variant.into(),
                format!("{:.2}", psnr(variant)),
                format!("{:.4}", mean(variant, |row| row.flip)),
                format!("{:.2}", mean(variant, |row| row.mad)),
                format!("{:.2}", mean(variant, |row| row.mad_at_edges)),
                percent(mean(variant, |row| row.covered)),
                figure(mean(variant, |row| row.frame_ms)),
                figure(mean(variant, |row| row.build_ms)),
                figure(mean(variant, |row| row.bytes as f64 / 1e6)),
            ]);
        }
        let held = of("ldi").count();
        format!(
            "# Views left out of an image set\n\n{held} views left out (1 in {}), shown from the others and judged against their \
             photographs where all ways show something.\nBeside the nearest image alone, the LDI of the {NEAR} nearest is {:.2} dB nearer to \
             the photograph, that of all images {:.2} dB; it covers {} of it instead of {}.\nCommit {}, {}, {} threads, {}.\n\n{table}",
            self.hold_out,
            psnr("near") - psnr("nearest"),
            psnr("ldi") - psnr("nearest"),
            percent(mean("ldi", |row| row.covered)),
            percent(mean("nearest", |row| row.covered)),
            self.commit,
            self.machine.processor,
            self.machine.threads,
            self.machine.simd,
        )
    }
}
