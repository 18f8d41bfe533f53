//! Selection of the images nearest to a view, and a cube of them alone, rebuilt as the view moves
//! (S24).
//!
//! From images all around an object, the paper takes the three "whose direction is closest". That
//! keeps small the angles by which surfaces turn from those images to the frame. Here, images are
//! ranked by these angles themselves: the angle between the viewing directions, plus the angle that
//! the path from eye to eye subtends at the depth of the images. So images taken within a room,
//! which may look one way from many places, are ranked as well. Around an object, the order is the
//! paper's.
//!
//! The cube lies about the eye of the nearest image, whose pixels are then resampled once. Loaded
//! images stay in an LRU cache, so that most rebuilds load none or one.

use super::ImageSetCapture;
use headbox_core::camera::Camera;
use headbox_core::statistics::median;
use headbox_cube::model::samples::CubeSamples;
use headbox_images::{ImageSet, ImagesError, Lens, LoadedView, View};
use rayon::prelude::*;
use std::sync::Arc;

/// A set of images with depth, of which those nearest to a view become a cube.
pub struct NearestImages {
    set: ImageSet,
    job: ImageSetCapture,
    /// Indices of the views that have depth.
    with_depth: Vec<usize>,
    /// Median depth of the images, metres.
    depth_m: f64,
    /// Loaded views by index, the most recently used last.
    cache: Vec<(usize, Arc<LoadedView>)>,
    /// Size limit of the cache, bytes.
    budget: usize,
}

impl NearestImages {
    /// Number of images in a cube (S24).
    pub const COUNT: usize = 3;

    /// Default size limit of the cache, bytes.
    pub const DEFAULT_BUDGET: usize = 1 << 30;

    /// Number of images whose depth is sampled.
    const DEPTH_IMAGES: usize = 8;

    /// The views of a set that have depth. Cubes are built by `job`, but their centres follow the
    /// view. At most `budget` bytes of images stay in memory besides those of the last cube.
    ///
    /// # Errors
    /// [`ImagesError`] of a view that cannot be loaded.
    pub fn new(set: ImageSet, job: ImageSetCapture, budget: usize) -> Result<Self, ImagesError> {
        let with_depth: Vec<usize> = (0..set.views.len())
            .filter(|&i| set.views[i].depth.is_some())
            .collect();
        let sampled: Vec<usize> = with_depth
            .iter()
            .step_by(with_depth.len().div_ceil(Self::DEPTH_IMAGES).max(1))
            .copied()
            .collect();
        let mut near = Self {
            set,
            job,
            with_depth,
            depth_m: 1.0,
            cache: Vec::new(),
            budget,
        };
        let views = near.load(&sampled)?;
        near.depth_m = median(views.iter().filter_map(|view| median_depth(view))).unwrap_or(1.0);
        Ok(near)
    }

    /// The views that [`Self::nearest`] indexes.
    pub fn views(&self) -> &[View] {
        &self.set.views
    }

    /// Median depth of the images, metres, from some of them.
    pub fn depth_m(&self) -> f64 {
        self.depth_m
    }

    /// Indices of the `count` views with depth that are nearest to a camera, the nearest first; on
    /// a tie, the lower index first.
    pub fn nearest(&self, camera: &Camera, count: usize) -> Vec<usize> {
        let mut ranked: Vec<(f64, usize)> = self
            .with_depth
            .iter()
            .map(|&i| (rotation_rad(&self.set.views[i], camera, self.depth_m), i))
            .collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        ranked.into_iter().take(count).map(|(_, i)| i).collect()
    }

    /// Builds the cube of these views, about the eye of the first.
    ///
    /// # Errors
    /// [`ImagesError`] of a view that cannot be loaded.
    pub fn cube(&mut self, chosen: &[usize]) -> Result<CubeSamples, ImagesError> {
        let loaded = self.load(chosen)?;
        let views: Vec<&View> = chosen.iter().map(|&i| &self.set.views[i]).collect();
        let centre = views
            .first()
            .map_or(self.job.centre, |view| view.color_pose().eye);
        ImageSetCapture {
            centre,
            ..self.job.clone()
        }
        .run_loaded(&self.set, &views, &loaded)
    }

    /// Loads views, which then are the most recently used.
    fn load(&mut self, chosen: &[usize]) -> Result<Vec<Arc<LoadedView>>, ImagesError> {
        let Self {
            set, cache, budget, ..
        } = self;
        let cached = |i: usize| {
            cache
                .iter()
                .find(|(index, _)| *index == i)
                .map(|(_, view)| Arc::clone(view))
        };
        let load = |&i: &usize| cached(i).map_or_else(|| set.views[i].load().map(Arc::new), Ok);
        let loaded: Vec<Arc<LoadedView>> = chosen.par_iter().map(load).collect::<Result<_, _>>()?;
        cache.retain(|(index, _)| !chosen.contains(index));
        cache.extend(chosen.iter().copied().zip(loaded.iter().map(Arc::clone)));
        let mut bytes: usize = cache.iter().map(|(_, view)| memory_bytes(view)).sum();
        let old = cache.len() - chosen.len();
        let evicted = cache[..old].iter().take_while(|(_, view)| {
            let exceeds = bytes > *budget;
            bytes -= memory_bytes(view);
            exceeds
        });
        let evicted = evicted.count();
        cache.drain(..evicted);
        Ok(loaded)
    }
}

/// Angle by which a surface at depth `depth_m` turns from a view's image to a camera's frame,
/// radians.
fn rotation_rad(view: &View, camera: &Camera, depth_m: f64) -> f64 {
    let pose = view.color_pose();
    let turn = match view.lens {
        Lens::Equirectangular => 0.0, // sees all directions
        Lens::Pinhole(_) => (-pose.world_from_eye.z_axis).angle_between(camera.forward()),
    };
    turn + pose.eye.distance(camera.eye()) / depth_m
}

/// Median depth of the pixels in some rows and columns.
fn median_depth(view: &LoadedView) -> Option<f64> {
    /// Pixels between sampled rows and columns.
    const STEP: usize = 8;
    let [width, height] = view.size_px;
    let pixels = (0..height)
        .step_by(STEP)
        .flat_map(|y| (0..width).step_by(STEP).map(move |x| (x, y)));
    median(
        pixels
            .filter_map(|(x, y)| view.depth_at(x, y))
            .map(f64::from),
    )
}

fn memory_bytes(view: &LoadedView) -> usize {
    size_of_val(view.color.as_slice()) + size_of_val(view.depth.as_slice())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};
    use headbox_core::progress::Silent;
    use headbox_fixtures::{frame_at, image_set, plane_view, saved};
    use headbox_images::Pose;
    use tempfile::TempDir;

    const SIZE: [u32; 2] = [48, 36];

    /// Images of a plane at Z = -3 from these eyes.
    fn set(eyes: &[DVec3]) -> (TempDir, ImageSet) {
        let folder = tempfile::tempdir().expect("a folder");
        let view = |(i, eye): (usize, &DVec3)| {
            saved(
                &plane_view(*eye, eye.z + 3.0, SIZE),
                folder.path(),
                &i.to_string(),
            )
        };
        let views: Vec<View> = eyes.iter().enumerate().map(view).collect();
        let set = image_set(folder.path(), &views);
        (folder, set)
    }

    fn near(set: &ImageSet, budget: usize) -> NearestImages {
        NearestImages::new(set.clone(), ImageSetCapture::suggest(set), budget).expect("opens")
    }

    fn scattered_eyes(count: u32) -> Vec<DVec3> {
        let share = |n: u32, of: u32| f64::from(n % of) / f64::from(of) - 0.5;
        (0..count)
            .map(|i| DVec3::new(share(i * 7, 13), share(i * 5, 11), 0.2 * share(i, 3)))
            .collect()
    }

    /// Selects the nearest views by definition, one after the other.
    fn oracle(views: &[View], camera: &Camera, depth: f64, count: usize) -> Vec<usize> {
        let ahead = camera.forward();
        let rotation = |view: &View| {
            let axis = view.pose.world_from_eye * DVec3::NEG_Z;
            let angle = (axis.dot(ahead) / (axis.length() * ahead.length()))
                .clamp(-1.0, 1.0)
                .acos();
            angle
                + (view.pose.eye - camera.eye())
                    .dot(view.pose.eye - camera.eye())
                    .sqrt()
                    / depth
        };
        let mut left: Vec<usize> = (0..views.len())
            .filter(|&i| views[i].depth.is_some())
            .collect();
        let mut chosen = Vec::new();
        while chosen.len() < count && !left.is_empty() {
            let mut best = 0;
            for candidate in 1..left.len() {
                if rotation(&views[left[candidate]]) < rotation(&views[left[best]]) {
                    best = candidate;
                }
            }
            chosen.push(left.remove(best));
        }
        chosen
    }

    #[test]
    fn nearest_views_match_the_definition() {
        let (_folder, mut set) = set(&scattered_eyes(20));
        for (i, view) in set.views.iter_mut().enumerate() {
            view.pose.world_from_eye = DMat3::from_rotation_y(0.3 * (i as f64 * 1.7).sin());
        }
        set.views[4].depth = None;
        let near = near(&set, usize::MAX);
        for (i, eye) in scattered_eyes(9).into_iter().enumerate() {
            let camera = frame_at(eye * 1.3, SIZE);
            for count in [0, 1, 3, i, 19, 100] {
                assert_eq!(
                    near.nearest(&camera, count),
                    oracle(&set.views, &camera, near.depth_m(), count),
                    "{count}"
                );
            }
        }
    }

    #[test]
    fn nearest_views_around_an_object_match_the_paper() {
        let (_folder, mut set) = set(&scattered_eyes(24));
        for (i, view) in set.views.iter_mut().enumerate() {
            // On a turntable, shuffled, 15 degrees apart.
            let turn = DMat3::from_rotation_y((15.0 * f64::from(i as u32 * 7 % 24)).to_radians());
            view.pose = Pose {
                eye: turn * DVec3::Z * 3.0,
                world_from_eye: turn,
            };
        }
        let near = near(&set, usize::MAX);
        for degrees in [0.4, 33.0, 97.2, 181.1, 300.0] {
            let eye = DMat3::from_rotation_y(f64::to_radians(degrees)) * DVec3::Z * 3.3;
            let camera = Camera::look_at(eye, DVec3::ZERO, DVec3::Y, 40.0, SIZE).expect("a camera");
            let mut expected: Vec<usize> = (0..24).collect();
            let direction = |i: usize| set.views[i].pose.eye.angle_between(eye);
            expected.sort_by(|&a, &b| direction(a).total_cmp(&direction(b)));
            assert_eq!(near.nearest(&camera, 3), expected[..3], "{degrees}");
        }
    }

    #[test]
    fn cube_equals_a_job_from_files() {
        let (_folder, set) = set(&scattered_eyes(7));
        let mut near = near(&set, usize::MAX);
        for chosen in [vec![2, 0, 5], vec![5, 2, 0], vec![6], vec![]] {
            let cube = near.cube(&chosen).expect("built");
            let views: Vec<&View> = chosen.iter().map(|&i| &set.views[i]).collect();
            let job = ImageSetCapture::suggest(&set);
            let centre = views.first().map_or(job.centre, |view| view.pose.eye);
            let expected = ImageSetCapture { centre, ..job }
                .run(&set, &views, &Silent)
                .expect("built");
            assert!(cube == expected, "{chosen:?}");
            assert_eq!(
                cube.faces.iter().all(|face| face.samples.is_empty()),
                chosen.is_empty()
            );
        }
    }

    #[test]
    fn cache_keeps_the_most_recently_used() {
        let (_folder, set) = set(&scattered_eyes(6));
        let one = memory_bytes(&set.views[0].load().expect("loads"));
        let mut near = near(&set, 3 * one);
        let cached = |near: &NearestImages| near.cache.iter().map(|(i, _)| *i).collect::<Vec<_>>();
        assert_eq!(
            cached(&near),
            [0, 1, 2, 3, 4, 5],
            "beyond the budget while they are used"
        );
        near.cube(&[1, 3]).expect("built");
        assert_eq!(cached(&near), [5, 1, 3]);
        near.cube(&[0]).expect("built");
        assert_eq!(cached(&near), [1, 3, 0]);
        std::fs::remove_file(&set.views[2].color).expect("removed");
        std::fs::remove_file(&set.views[3].color).expect("removed");
        let error = near.cube(&[3, 2]).expect_err("gone").to_string();
        assert!(error.contains("2.png"), "{error}");
        near.cube(&[3]).expect("in memory");
    }

    #[test]
    fn set_without_depth_has_no_nearest_views() {
        let (_folder, mut set) = set(&scattered_eyes(2));
        set.views.iter_mut().for_each(|view| view.depth = None);
        let near = near(&set, usize::MAX);
        assert!(near.nearest(&frame_at(DVec3::ZERO, SIZE), 3).is_empty() && near.depth_m() == 1.0);
    }
}
