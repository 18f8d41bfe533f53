//! Comparison of a cube LDI with ray-traced truth: the overlays "truth" and "error" (FLIP).

use crate::reference::{LitScene, Reference, Traced};
use glam::Vec3;
use headbox_core::camera::Camera;
use headbox_core::color::{linear_from_srgb8, srgb8_from_linear};
use headbox_core::file_frame::FileFrame;
use headbox_core::frame::Frame;
use headbox_core::headbox::Headbox;
use headbox_core::metrics;
use headbox_core::view::paint::{figure, opaque, swatch};
use headbox_core::view::{
    Control, Figure, FrameRequest, OVERLAY, Ongoing, Origin, Refinement, Rendered, Setting,
    StartView, Statistics, Swatch, View,
};
use headbox_cube::pack::CubeLdi;
use headbox_cube::view::CubeView;
use image::{Rgb, RgbImage};
use std::sync::Arc;
use std::time::Duration;

/// Interval between two polls of truth.
const POLL: Duration = Duration::from_millis(150);

/// Function that opens a lit scene; may be slow.
pub type OpenScene = Arc<dyn Fn() -> Result<LitScene, String> + Send + Sync>;

/// Overlays that need truth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TruthOverlay {
    /// The ray-traced view.
    Truth,
    /// The frame's FLIP error against it.
    Error,
}

headbox_core::named_variants!(TruthOverlay { Truth => "truth", Error => "error" });

impl TruthOverlay {
    fn legend(self) -> Vec<Swatch> {
        match self {
            Self::Truth => Vec::new(),
            Self::Error => vec![
                swatch([0, 0, 4], "FLIP 0: no difference is seen"),
                swatch([252, 253, 191], "FLIP 1: as far as it goes"),
            ],
        }
    }
}

/// A [`CubeView`] with two more overlays, which need the captured scene: ray-traced truth, and the
/// frame's error against it. Truth is refined in the background while the camera rests.
pub struct TruthView {
    view: CubeView,
    scene: OpenScene,
    reference: Option<Reference>,
    painted: Frame,
    /// Overlay of the last frame.
    overlay: Option<TruthOverlay>,
}

impl TruthView {
    /// Creates a view of `cube`, with truth from the scene that its header names.
    pub fn new(cube: impl Into<Arc<CubeLdi>>) -> Self {
        let cube = cube.into();
        let info = cube.info.clone();
        Self::with_scene(cube, Arc::new(move || LitScene::reopen(&info)))
    }

    /// Creates a view of `cube`, with truth from a scene that `scene` opens on first use.
    pub fn with_scene(cube: Arc<CubeLdi>, scene: OpenScene) -> Self {
        Self {
            view: CubeView::new(cube),
            scene,
            reference: None,
            painted: Frame::default(),
            overlay: None,
        }
    }

    /// The cube that is shown.
    pub fn cube(&self) -> &Arc<CubeLdi> {
        self.view.cube()
    }

    /// Replaces the cube by another one of the same scene.
    pub fn show(&mut self, cube: Arc<CubeLdi>) {
        self.view.show(cube);
    }

    /// Settings of every cube LDI, with the two overlays.
    pub fn setting_table() -> Vec<Setting> {
        let mut settings = CubeView::setting_table();
        for setting in settings.iter_mut().filter(|setting| setting.id == OVERLAY) {
            if let Control::Choice { options, .. } = &mut setting.control {
                options.extend(TruthOverlay::ALL.map(|overlay| overlay.name().to_owned()));
            }
            setting.tooltip += " Also the ray-traced truth of this view, or the error of the frame against it (FLIP, black 0 to \
                 yellow 1); both are refined while the eye rests.";
        }
        settings
    }

    /// Progress of truth, if the last frame showed it.
    fn ongoing(&self) -> Option<Ongoing> {
        self.overlay.and(self.reference.as_ref())?.ongoing()
    }

    /// Paints the overlay, if truth is already available.
    fn paint(
        &mut self,
        overlay: TruthOverlay,
        camera: &Camera,
    ) -> Result<(Vec<Figure>, Refinement), String> {
        let reference = match &self.reference {
            Some(reference) => reference,
            None => {
                let scene = Arc::clone(&self.scene);
                self.reference.insert(Reference::start(move || scene())?)
            }
        };
        let Some(traced) = reference.request(camera)? else {
            return Ok((Vec::new(), Refinement::Later(POLL)));
        };
        let refinement = if traced.is_final() {
            Refinement::Done
        } else {
            Refinement::Later(POLL)
        };
        let figures = compare(overlay, &traced, &mut self.painted)?;
        Ok((figures, refinement))
    }
}

impl View for TruthView {
    fn kind(&self) -> &'static str {
        self.view.kind()
    }

    fn start(&self, size_px: [u32; 2]) -> StartView {
        self.view.start(size_px)
    }

    fn headbox(&self) -> Option<Headbox> {
        self.view.headbox()
    }

    fn file_frame(&self) -> FileFrame {
        self.view.file_frame()
    }

    fn origin(&self) -> Option<Origin> {
        self.view.origin()
    }

    fn primitives(&self) -> (u64, &'static str) {
        self.view.primitives()
    }

    fn bytes(&self) -> u64 {
        self.view.bytes()
    }

    fn settings(&self) -> Vec<Setting> {
        Self::setting_table()
    }

    fn render(&mut self, request: &FrameRequest) -> Result<Rendered<'_>, String> {
        let choice = request.settings.choice(OVERLAY)?;
        let overlay = choice
            .checked_sub(self.view.overlay_count())
            .and_then(|i| TruthOverlay::ALL.get(i).copied());
        self.overlay = overlay.filter(|_| !request.moving);
        let Some(overlay) = overlay else {
            if let Some(reference) = &self.reference {
                reference.clear();
            }
            return self.view.render(request);
        };
        let Rendered { frame, mut report } = self.view.render(request)?;
        self.painted.clone_from(frame);
        let (figures, refinement) = self.paint(overlay, &request.camera)?;
        report.figures.splice(0..0, figures);
        report.legend = overlay.legend();
        report.refinement = refinement;
        report.ongoing = self.ongoing();
        Ok(Rendered {
            frame: &self.painted,
            report,
        })
    }

    fn statistics(&mut self, request: &FrameRequest) -> Statistics {
        self.view.statistics(request)
    }

    fn level_radiance(&self) -> Option<[f32; 256]> {
        self.view.level_radiance()
    }
}

/// Downsamples an image by the integer factor `side`: means of squares in linear light, cropped at
/// the right and lower borders.
fn downsample(image: &RgbImage, side: u32) -> RgbImage {
    let (width, height) = image.dimensions();
    RgbImage::from_fn(width.div_ceil(side), height.div_ceil(side), |x, y| {
        let columns = x * side..((x + 1) * side).min(width);
        let square = (y * side..((y + 1) * side).min(height))
            .flat_map(|y| columns.clone().map(move |x| (x, y)));
        let (mut sum, mut count) = (Vec3::ZERO, 0.0);
        for (x, y) in square {
            sum += Vec3::from(image.get_pixel(x, y).0.map(linear_from_srgb8));
            count += 1.0;
        }
        Rgb((sum / count).to_array().map(srgb8_from_linear))
    })
}

/// Compares a frame with truth, paints the overlay over it, and returns the figures.
fn compare(
    overlay: TruthOverlay,
    traced: &Traced,
    frame: &mut Frame,
) -> Result<Vec<Figure>, String> {
    let mut image = frame.to_rgb().map_err(|error| error.to_string())?;
    let (truth, side) = (&traced.truth.rgb(), traced.coarseness());
    if side > 1 {
        image = downsample(&image, side);
    }
    let message = |error: metrics::MetricError| error.to_string();
    let map =
        metrics::flip_map(truth, &image, metrics::DEFAULT_PIXELS_PER_DEGREE).map_err(message)?;
    let psnr_db = metrics::psnr_db(truth, &image).map_err(message)?;
    let picture = match overlay {
        TruthOverlay::Truth => truth,
        TruthOverlay::Error => &map.to_magma(),
    };
    let width = frame.width.max(1) as usize;
    for (i, pixel) in frame.color.iter_mut().enumerate() {
        let (x, y) = ((i % width) as u32 / side, (i / width) as u32 / side);
        let [r, g, b] = picture
            .get_pixel_checked(x, y)
            .map_or([0; 3], |color| color.0);
        *pixel = opaque([r, g, b]);
    }
    Ok(vec![
        figure("FLIP", map.mean, ""),
        figure("PSNR", psnr_db, "dB"),
        figure("rays per pixel of truth", traced.samples().into(), ""),
        figure(
            "truth's own error",
            traced.truth.standard_error_psnr_db,
            "dB",
        ),
    ])
}
