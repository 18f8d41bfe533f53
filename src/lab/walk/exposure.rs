//! Exposure errors: pixels whose backdrop shows a hole or a wrong surface.
//!
//! Surfaces are identified by colour, in a house without textures and light whose materials have
//! very different colours. A mixture of true surfaces is not an error, nor is low resolution:
//! frames are [`SMALLER`] times smaller than those of the walk, so that a pixel is at least as
//! large as the samples of the coarsest backdrop, and a silhouette may be off by [`OFF_PX`].
//!
//! The truth has the size of the walk's frames. A small truth with one sample per pixel would miss
//! surfaces thinner than its pixels, such as reveals and trims of distant doors, which a backdrop
//! shows correctly. By that measure even a perfect frame (each pixel the mean of those of the large
//! truth) has errors; the report gives both measures, and the second one for a perfect frame.

use super::{MeasureError, MeasureSettings, has_depth, share};
use headbox_core::camera::{Camera, CameraError};
use headbox_core::color::linear_from_srgb8;
use headbox_core::frame::{Coverage, Frame};
use headbox_core::progress::Progress;
use headbox_cube::render::RenderSettings;
use headbox_cube::render::footprint::splat::SplatKernel;
use headbox_house::backdrop::BackdropKind;
use headbox_house::house::{House, HouseError};
use headbox_house::settings::{Near, WalkSettings};
use headbox_house::store::Store;
use headbox_house::variant::HouseVariant;
use headbox_house::walk::Walker;
use headbox_model::PortalModel;
use headbox_raster::PixelContent;
use headbox_trace::sampler::random4;
use serde::{Deserialize, Serialize};

/// Difference in a channel above which a pixel shows another surface, sRGB levels: materials are 60
/// apart.
const WRONG_LEVELS: u8 = 24;

/// Ratio of the walk's frame size to that of the compared frames.
const SMALLER: u32 = 4;

/// Tolerance of a surface's position, pixels.
const OFF_PX: i64 = 1;

/// Exposure errors of one kind of backdrop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExposureRow {
    /// Name of the kind of backdrop.
    pub name: String,
    /// Share of the pixels behind portals that show a hole or a wrong surface.
    pub wrong_share: f64,
    /// The same against a truth of one sample per pixel, which lacks surfaces thinner than a pixel.
    pub wrong_by_points_share: f64,
    /// [`Self::wrong_by_points_share`] of a perfect frame.
    pub perfect_by_points_share: f64,
    /// Share of the pixels behind portals that show a hole; part of [`Self::wrong_share`].
    pub hole_share: f64,
    /// Largest share of wrong pixels of one pose.
    pub worst_share: f64,
    /// Mean number of samples of a backdrop.
    pub samples: f64,
}

/// Measures the exposure errors of every kind of backdrop with depth among the variants.
pub(super) fn errors(
    house: &House,
    cameras: &[Camera],
    settings: &MeasureSettings,
    progress: &dyn Progress,
) -> Result<Vec<ExposureRow>, MeasureError> {
    let house = false_colors(house)?;
    let kinds: Vec<BackdropKind> = settings
        .variants
        .iter()
        .filter_map(|v| v.kind)
        .filter(|kind| has_depth(*kind))
        .collect();
    progress.begin("exposure errors", "kinds", kinds.len() as u64);
    let mut rows: Vec<ExposureRow> = Vec::new();
    for kind in kinds {
        if rows.iter().all(|known| known.name != kind.name()) {
            rows.push(row(&house, cameras, settings, kind)?);
        }
        progress.advance(1);
    }
    Ok(rows)
}

/// Measures one kind of backdrop at all `cameras`.
fn row(
    house: &House,
    cameras: &[Camera],
    settings: &MeasureSettings,
    kind: BackdropKind,
) -> Result<ExposureRow, MeasureError> {
    let store = Store::new(u64::MAX);
    let walk_settings = WalkSettings {
        backdrops: Some(kind),
        warp: RenderSettings {
            kernel: SplatKernel::Opaque,
            ..RenderSettings::default()
        },
        ..HouseVariant::ALL[0].settings()
    };
    let (mut geometry, mut walker) = (Walker::new(), Walker::new());
    let (mut wrong, mut holes, mut pixels, mut worst) = (0, 0, 0, 0.0f64);
    let (mut by_points, mut perfect_by_points) = (0, 0);
    for walk_camera in cameras {
        // The same portals show backdrops as in the walk.
        let walk_settings = WalkSettings {
            near: Near::Distance(walk_settings.near.distance_m(walk_camera)),
            ..walk_settings
        };
        let camera = &smaller(walk_camera)?;
        Walker::prepare(house, &store, camera, &walk_settings, &settings.quality)?;
        let points = geometry
            .frame(house, &store, camera, &WalkSettings::default())
            .0
            .clone();
        let truth = geometry
            .frame(house, &store, &larger(camera)?, &WalkSettings::default())
            .0;
        let stats = walker
            .frame(house, &store, camera, &walk_settings)
            .1
            .clone();
        let shown = walker.last();
        let behind = |pixel: usize| matches!(shown.seen(pixel), PixelContent::Marker(_));
        let pose_wrong = wrong_pixels(&shown.frame, truth, behind);
        by_points += wrong_pixels(&shown.frame, &points, behind);
        perfect_by_points += wrong_pixels(&averaged(truth), &points, behind);
        // A sliver of a portal has too few pixels for a share.
        if stats.backdrop_pixels * 100 > stats.pixels {
            worst = worst.max(share(pose_wrong as f64, stats.backdrop_pixels as f64));
        }
        wrong += pose_wrong;
        holes += stats.hole_pixels;
        pixels += stats.backdrop_pixels;
    }
    let all = store.all();
    let samples: u64 = all
        .iter()
        .map(|(_, backdrop)| backdrop.sample_count())
        .sum();
    Ok(ExposureRow {
        name: kind.name().into(),
        wrong_share: share(wrong as f64, pixels as f64),
        wrong_by_points_share: share(by_points as f64, pixels as f64),
        perfect_by_points_share: share(perfect_by_points as f64, pixels as f64),
        hole_share: share(holes as f64, pixels as f64),
        worst_share: worst,
        samples: share(samples as f64, all.len() as f64),
    })
}

/// Returns the same view in a frame [`SMALLER`] times smaller.
fn smaller(camera: &Camera) -> Result<Camera, CameraError> {
    let size = [camera.width(), camera.height()].map(|pixels| (pixels / SMALLER).max(1));
    resized(camera, camera.focal_px() / f64::from(SMALLER), size)
}

/// Returns the same view in a frame [`SMALLER`] times larger.
fn larger(camera: &Camera) -> Result<Camera, CameraError> {
    let size = [camera.width(), camera.height()].map(|pixels| pixels * SMALLER);
    resized(camera, camera.focal_px() * f64::from(SMALLER), size)
}

fn resized(
    camera: &Camera,
    focal_px: f64,
    [width, height]: [u32; 2],
) -> Result<Camera, CameraError> {
    let (eye, axes) = (camera.eye(), camera.world_from_eye());
    Camera::from_parts(eye, axes, focal_px, width, height)
}

/// Reduces a frame by [`SMALLER`] with a box filter.
fn averaged(large: &Frame) -> Frame {
    let side = SMALLER as usize;
    let (width, height) = (large.width as usize / side, large.height as usize / side);
    let mut small = Frame::default();
    small.reset(width as u32, height as u32, [0; 3]);
    small.coverage.fill(Coverage::FULL);
    for (i, mean) in small.color.iter_mut().enumerate() {
        let first = i / width * side * large.width as usize + i % width * side;
        let pixel = |k: usize| large.color[first + k / side * large.width as usize + k % side];
        let sum = |c: usize| {
            (0..side * side)
                .map(|k| u32::from(pixel(k)[c]))
                .sum::<u32>()
        };
        *mean = [0, 1, 2, 3].map(|c| (sum(c) / (SMALLER * SMALLER)) as u8);
    }
    small
}

/// Returns the same house with one colour per material, and without light.
fn false_colors(house: &House) -> Result<House, HouseError> {
    let mut model = PortalModel {
        scene: (**house.scene()).clone(),
        ..house.plan().clone()
    };
    for (i, material) in (0u32..).zip(&mut model.scene.materials) {
        let hash = random4([i, 1, 2, 3]);
        // Four levels for each channel.
        material.albedo = [0, 1, 2].map(|c| linear_from_srgb8(60 * (hash[c] >> 30) as u8 + 20));
        material.albedo_texture = None;
        material.emission = [0.0; 3];
        material.emission_texture = None;
    }
    model.scene.colors.clear();
    House::new(model)
}

/// Counts the pixels, among those selected by `counts`, that are holes or whose colour is not a
/// mixture of true pixels nearby: a channel lies outside their range. The truth may be an integer
/// number of times larger than the frame.
fn wrong_pixels(frame: &Frame, truth: &Frame, counts: impl Fn(usize) -> bool) -> u64 {
    let width = i64::from(frame.width);
    let times = (i64::from(truth.width) / width.max(1)).max(1);
    let around = |at: i64, end: u32| {
        ((at - OFF_PX) * times).max(0)..((at + OFF_PX + 1) * times).min(i64::from(end))
    };
    let is_wrong = |pixel: usize| {
        let color = frame.color[pixel];
        let (mut least, mut most) = ([255; 3], [0; 3]);
        for y in around(pixel as i64 / width, truth.height) {
            for x in around(pixel as i64 % width, truth.width) {
                let other = truth.color[(y * i64::from(truth.width) + x) as usize];
                (0..3).for_each(|c| {
                    (least[c], most[c]) = (other[c].min(least[c]), other[c].max(most[c]));
                });
            }
        }
        let outside = |c: usize| {
            color[c] < u8::saturating_sub(least[c], WRONG_LEVELS)
                || color[c] > u8::saturating_add(most[c], WRONG_LEVELS)
        };
        frame.coverage[pixel].is_hole() || (0..3).any(outside)
    };
    (0..frame.color.len())
        .filter(|&pixel| counts(pixel) && is_wrong(pixel))
        .count() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Creates a dark frame without holes, with a red column.
    fn dark_frame(width: u32, height: u32, red_column: Option<usize>) -> Frame {
        let mut frame = Frame::default();
        frame.reset(width, height, [20, 20, 20]);
        frame.coverage.fill(Coverage::FULL);
        if let Some(column) = red_column {
            let pixels = frame.color.iter_mut().skip(column);
            pixels
                .step_by(width as usize)
                .for_each(|color| *color = [200, 20, 20, 255]);
        }
        frame
    }

    #[test]
    fn neighbour_mixtures_are_not_exposure_errors() {
        let truth = dark_frame(8, 3, Some(4));
        let mut frame = truth.clone();
        let wrong = |frame: &Frame| wrong_pixels(frame, &truth, |_| true);
        assert_eq!(wrong(&frame), 0);
        frame.color[8 + 3] = [110, 30, 20, 255];
        assert_eq!(wrong(&frame), 0, "between its neighbours");
        frame.color[8 + 1] = [110, 30, 20, 255];
        frame.color[8 + 4] = [200, 80, 20, 255];
        frame.coverage[0] = Coverage::HOLE;
        assert_eq!(wrong(&frame), 3);
        assert_eq!(wrong_pixels(&frame, &truth, |pixel| pixel > 0), 2);
    }

    #[test]
    fn thin_surface_counts_as_present() {
        // A line in column 4, between the samples of a truth of one sample per pixel.
        let truth = dark_frame(8 * SMALLER, 4 * SMALLER, Some(4 * SMALLER as usize));
        let points = dark_frame(8, 4, None);
        let wrong =
            |frame: &Frame| [&truth, &points].map(|truth| wrong_pixels(frame, truth, |_| true));
        let mut frame = points.clone();
        frame.color[8 + 4] = [200, 20, 20, 255];
        assert_eq!(wrong(&frame), [0, 1]);
        frame.color[8 + 6] = [200, 20, 20, 255];
        assert_eq!(wrong(&frame)[0], 1, "two pixels from its place");
        let perfect = averaged(&truth);
        assert_eq!(
            perfect.color[8 + 4],
            [20 + 180 / SMALLER as u8, 20, 20, 255]
        );
        assert_eq!(wrong(&perfect), [0, 4]);
    }
}
