//! Several light slabs of one scene, each a lumigraph with its own plane, rendered as one (the
//! paper's limitation 4).
//!
//! A slab fits a ray that runs in the viewing direction of its cameras and crosses its plane
//! between them. A frame draws the two slabs that fit its rays best, with shares that are a
//! continuous function of the camera: the share of the second falls to 0 before a third takes its
//! place, and the two change roles at one half, so that there is no jump as the eye moves from one
//! slab to the next.

use crate::grid::PlaneView;
use crate::{Lumigraph, LumigraphError, LumigraphInfo, optimal_disparity};
use glam::DVec2;
use headbox_core::camera::Camera;

/// Maximum number of slabs: a hundred planes about an object are more than enough.
pub const MAX_SLABS: usize = 256;

/// Largest difference in misfit from the best slab at which a second one is blended in, radians:
/// rotated planes blend within about seven degrees to either side of the middle.
const BLEND_RANGE: f64 = 0.5;

/// Positions of the probe rays of a frame, as shares of its width and height.
const PROBES: [f64; 3] = [1.0 / 6.0, 0.5, 5.0 / 6.0];

/// Light slabs of one scene, at least one.
#[derive(Clone, Debug)]
pub struct Slabs {
    slabs: Vec<Lumigraph>,
}

/// A slab in a frame, with its share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlabShare {
    /// Index of the slab.
    pub slab: usize,
    /// Its share; the shares of a frame add up to 1.
    pub share: f64,
}

impl From<Lumigraph> for Slabs {
    fn from(lumigraph: Lumigraph) -> Self {
        Self {
            slabs: vec![lumigraph],
        }
    }
}

impl Slabs {
    /// Creates a set of slabs; info and environment of the first become those of all.
    ///
    /// # Errors
    /// [`LumigraphError::Slabs`] if there are none or too many.
    pub fn new(mut slabs: Vec<Lumigraph>) -> Result<Self, LumigraphError> {
        if slabs.is_empty() || slabs.len() > MAX_SLABS {
            return Err(LumigraphError::Slabs(slabs.len()));
        }
        let (info, environment) = (slabs[0].info.clone(), slabs[0].environment.clone());
        for slab in &mut slabs[1..] {
            (slab.info, slab.environment) = (info.clone(), environment.clone());
        }
        Ok(Self { slabs })
    }

    /// All slabs.
    pub fn all(&self) -> &[Lumigraph] {
        &self.slabs
    }

    /// The first slab.
    pub fn first(&self) -> &Lumigraph {
        &self.slabs[0]
    }

    /// Returns the only slab; `None` if there are several.
    pub fn into_single(self) -> Option<Lumigraph> {
        <[Lumigraph; 1]>::try_from(self.slabs)
            .ok()
            .map(|[slab]| slab)
    }

    /// Source of the slabs.
    pub fn info(&self) -> &LumigraphInfo {
        &self.first().info
    }

    /// Returns the slabs to draw for a camera with their shares: the best first, and at most one
    /// more.
    pub fn shares(&self, camera: &Camera) -> Vec<SlabShare> {
        let misfits = self.slabs.iter().map(|slab| misfit(slab, camera));
        let mut order: Vec<(usize, f64)> = misfits.enumerate().collect();
        order.sort_by(|(_, a), (_, b)| a.total_cmp(b));
        let [(best, least), ref others @ ..] = order[..] else {
            return Vec::new();
        };
        let limit = others.get(1).map_or(least + BLEND_RANGE, |(_, third)| {
            third.min(least + BLEND_RANGE)
        });
        let second = others.first().filter(|(_, misfit)| *misfit < limit);
        let share = |slab: usize, share: f64| SlabShare { slab, share };
        let Some(&(second, misfit)) = second else {
            return vec![share(best, 1.0)];
        };
        let second_share = 0.5 * smoothstep((limit - misfit) / (limit - least));
        vec![share(best, 1.0 - second_share), share(second, second_share)]
    }
}

/// Cubic from 0 at 0 to 1 at 1, with slope 0 at both ends.
fn smoothstep(x: f64) -> f64 {
    x * x * (3.0 - 2.0 * x)
}

/// Returns the misfit of a slab and a frame, radians: mean over probe rays of the angle to the
/// cameras' viewing direction plus the distance outside the grid at which they cross the plane, as
/// seen from the middle of the disparities (at most 1). A continuous function of the camera.
fn misfit(slab: &Lumigraph, camera: &Camera) -> f64 {
    let grid = slab.grid();
    let view = PlaneView::new(grid, camera);
    let [width, height] = view.size;
    let ends = |positions: &[f64]| [positions[0], positions[positions.len() - 1]];
    let (columns, rows) = (ends(grid.columns()), ends(grid.rows()));
    let disparity = slab.range().map_or(0.0, optimal_disparity);
    let ray_misfit = |share: [f64; 2]| {
        let at = [width * share[0], height * share[1]];
        let direction = view.start + view.step[0] * at[0] + view.step[1] * at[1];
        let turned = (direction.z / direction.length()).clamp(-1.0, 1.0).acos();
        let Some(slopes) = view.slopes(at) else {
            return turned + 1.0;
        };
        let crossing = view.crossing(slopes);
        let outside = |at: f64, [low, high]: [f64; 2]| (low - at).max(at - high).max(0.0);
        let off = DVec2::new(outside(crossing.x, columns), outside(crossing.y, rows)).length();
        turned + (off * disparity).min(1.0)
    };
    let rays = PROBES.into_iter().flat_map(|x| PROBES.map(|y| [x, y]));
    rays.map(ray_misfit).sum::<f64>() / (PROBES.len() * PROBES.len()) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{Bed, psnr_db, unmerged};
    use crate::{CameraGrid, LumigraphSettings, Placement, SlabsRenderer, render_slabs_by_rays};
    use glam::DVec3;
    use headbox_core::frame::Frame;
    use headbox_core::progress::Silent;
    use headbox_trace::truth;

    /// About what planes are turned: the dome of `bump`.
    const CENTRE: DVec3 = DVec3::ZERO;
    const RADIUS: f64 = 3.0;

    fn turned(bed: &Bed, degrees: f64) -> CameraGrid {
        bed.grid
            .turned(CENTRE, DVec3::Y, f64::to_radians(degrees))
            .expect("a line")
    }

    /// Planes turned by -30, 0 and 30 degrees.
    fn three(size: u32) -> (Bed, Slabs) {
        let places = CameraGrid::even_positions(3, 0.8);
        let bed = Bed::new(places.clone(), places, [size, size]);
        let slab = |degrees: f64| {
            let raw = bed
                .capture(false, 4)
                .run(&turned(&bed, degrees), &Silent)
                .expect("captured");
            raw.layered(200, Placement::Histogram).expect("layered")
        };
        let slabs = Slabs::new([-30.0, 0.0, 30.0].map(slab).to_vec()).expect("slabs");
        (bed, slabs)
    }

    /// An eye that goes round and looks at the middle.
    fn camera(degrees: f64, size: u32) -> Camera {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let eye = CENTRE + DVec3::new(sin, 0.05, cos) * RADIUS;
        Camera::look_at(eye, CENTRE, DVec3::Y, 25.0, [size, size]).expect("valid")
    }

    fn draw(slabs: &Slabs, camera: &Camera) -> Frame {
        draw_as(slabs, camera, &LumigraphSettings::default())
    }

    fn draw_as(slabs: &Slabs, camera: &Camera, settings: &LumigraphSettings) -> Frame {
        SlabsRenderer::new()
            .render(slabs, camera, settings)
            .0
            .clone()
    }

    #[test]
    fn slab_shares_are_smooth() {
        let (_, slabs) = three(16);
        let of = |shares: &[SlabShare], slab: usize| {
            shares
                .iter()
                .find(|s| s.slab == slab)
                .map_or(0.0, |s| s.share)
        };
        let mut before: Option<Vec<SlabShare>> = None;
        let mut mixed = 0;
        for step in -500..=500 {
            let degrees = f64::from(step) * 0.1;
            let shares = slabs.shares(&camera(degrees, 16));
            assert!(
                (shares.iter().map(|s| s.share).sum::<f64>() - 1.0).abs() < 1e-12
                    && shares.len() <= 2
            );
            let nearest = if degrees < -15.0 {
                0
            } else {
                1 + usize::from(degrees > 15.0)
            };
            assert!(of(&shares, nearest) > 0.49, "{degrees}: {shares:?}");
            mixed += usize::from(shares.len() == 2);
            // A smooth step over some degrees takes no more than this of them in a tenth of one.
            if let Some(before) = &before {
                assert!(
                    (0..3).all(|slab| (of(&shares, slab) - of(before, slab)).abs() < 0.05),
                    "{degrees}"
                );
            }
            before = Some(shares);
        }
        assert!((20..700).contains(&mixed), "{mixed}");
        for (slab, degrees) in [-30.0, 0.0, 30.0].into_iter().enumerate() {
            assert_eq!(
                slabs.shares(&camera(degrees, 16)),
                [SlabShare { slab, share: 1.0 }]
            );
        }
        // Away from all of them, and where a third is as good as the second.
        assert_eq!(
            slabs
                .shares(&camera(180.0, 16))
                .iter()
                .map(|s| s.share)
                .sum::<f64>(),
            1.0
        );
        let eye = DVec3::new(0.0, 0.05, RADIUS);
        let above = Camera::look_at(eye, CENTRE, DVec3::Y, 25.0, [16, 16]).expect("valid");
        assert_eq!(slabs.shares(&above).len(), 1, "both neighbours are as far");
    }

    /// Largest ratio of the change between frames during a hand-over of slabs to that with one
    /// slab, over pixels that all know: two images of one surface, each with its own error, replace
    /// each other over a third of the way.
    const HAND_OVER: f64 = 1.6;

    /// The same over all pixels: what one slab alone knows, at the frame's sides, fades in over
    /// half of that.
    const FADE: f64 = 2.5;

    #[test]
    fn slab_hand_over_is_smooth() {
        let (_, slabs) = three(96);
        // Merged layers move textures by up to a pixel as they change, which a frame of 72 pixels
        // shows more than what is looked for.
        let settings = unmerged();
        let alone: Vec<Slabs> = slabs
            .all()
            .iter()
            .map(|slab| Slabs::from(slab.clone()))
            .collect();
        let mean = |frames: [&Frame; 2], wanted: &dyn Fn(usize) -> bool| {
            let pixels: Vec<usize> = (0..frames[0].color.len()).filter(|i| wanted(*i)).collect();
            let off = |i: &usize| {
                let [a, b] = frames.map(|frame| frame.color[*i]);
                (0..3).map(|c| u64::from(a[c].abs_diff(b[c]))).sum::<u64>()
            };
            pixels.iter().map(off).sum::<u64>() as f64 / (3 * pixels.len().max(1)) as f64
        };
        // Over what all slabs of a frame know, and over all; of frames of one slab and of those of
        // two.
        let (mut within, mut across) = ([0.0f64; 2], [0.0f64; 2]);
        let mut before: Option<(Frame, usize, Vec<bool>)> = None;
        for step in -4..=64 {
            let camera = camera(f64::from(step) * 0.5, 72);
            let (frame, shares) = (draw_as(&slabs, &camera, &settings), slabs.shares(&camera));
            let mut known = vec![true; frame.color.len()];
            for share in &shares {
                let own = draw_as(&alone[share.slab], &camera, &settings);
                known
                    .iter_mut()
                    .zip(&own.coverage)
                    .for_each(|(known, own)| *known &= !own.is_hole());
            }
            if let Some((last, count, known_before)) = &before {
                let both = |i: usize| known[i] && known_before[i];
                let differs = [mean([&frame, last], &both), mean([&frame, last], &|_| true)];
                let to = if shares.len() == 1 && *count == 1 {
                    &mut within
                } else {
                    &mut across
                };
                to.iter_mut()
                    .zip(differs)
                    .for_each(|(to, differs)| *to = to.max(differs));
            }
            before = Some((frame, shares.len(), known));
        }
        assert!(
            within[0] > 0.0 && across[0] > 0.0,
            "{across:?} levels, within a slab {within:?}"
        );
        let bounds = [HAND_OVER, FADE].into_iter().zip(across).zip(within);
        assert!(
            bounds
                .clone()
                .all(|((bound, across), within)| across <= bound * within),
            "{:?}",
            bounds.collect::<Vec<_>>()
        );
    }

    #[test]
    fn two_slab_frames_match_oracle() {
        let (bed, slabs) = three(128);
        for degrees in [0.0, 13.0, 15.0, 17.5] {
            let camera = camera(degrees, 64);
            let found = draw(&slabs, &camera);
            let rays = render_slabs_by_rays(&slabs, &camera, &LumigraphSettings::default());
            let off = found
                .color
                .iter()
                .zip(&rays.color)
                .filter(|(a, b)| (0..3).any(|c| a[c].abs_diff(b[c]) > 2));
            assert!(off.count() <= 8, "rounding, and texels beside, {degrees}");
            let truth =
                truth::render(&bed.tracer, &bed.lighting, false, &camera, 32, &Silent).frame;
            let db = psnr_db(&found.color, &truth.color);
            assert!(db > 20.0, "{db} dB at {degrees} degrees");
        }
        let pool = |threads| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .expect("a pool")
        };
        let [one, three] =
            [1, 3].map(|threads| pool(threads).install(|| draw(&slabs, &camera(15.0, 64))));
        assert_eq!(one, three);
    }

    #[test]
    fn slabs_fill_each_others_holes() {
        let (_, mut slabs) = three(64);
        let camera = camera(15.0, 48);
        // Of the third slab nothing is known.
        let blind = &slabs.slabs[2];
        let unknown = blind.layers().len() as u16 + 1;
        let pictures = blind.pictures().iter().map(|picture| {
            let (color, index) = (picture.color.clone(), vec![unknown; picture.index.len()]);
            crate::Picture { color, index }
        });
        let pictures = pictures.collect();
        slabs.slabs[2] = Lumigraph::new(blind.grid().clone(), blind.layers().to_vec(), pictures)
            .expect("a lumigraph");
        assert_eq!(slabs.shares(&camera).len(), 2);
        let alone = draw(&Slabs::from(slabs.slabs[1].clone()), &camera);
        let seen = |i: usize| alone.coverage[i].splat_share() > 0;
        let both = draw(&slabs, &camera);
        let same = (0..both.color.len())
            .filter(|&i| seen(i))
            .all(|i| both.color[i] == alone.color[i]);
        assert!(same && (0..both.color.len()).filter(|&i| seen(i)).count() > 1000);
    }

    #[test]
    fn slab_files_round_trip() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.lumi");
        let (_, slabs) = three(24);
        slabs.write(&path).expect("written");
        let back = Slabs::read(&path).expect("read");
        assert_eq!(back.all().len(), 3);
        for (a, b) in back.all().iter().zip(slabs.all()) {
            assert_eq!(
                (a.grid(), a.layers(), a.pictures()),
                (b.grid(), b.layers(), b.pictures())
            );
            assert_eq!(
                (&a.info, &a.environment),
                (&slabs.first().info, &slabs.first().environment)
            );
        }
        let refused = Lumigraph::read(&path)
            .expect_err("there are several")
            .to_string();
        assert!(refused.contains("one light slab"), "{refused}");
        let [own, of_one] = ["b.lumi", "c.lumi"].map(|name| folder.path().join(name));
        slabs.first().write(&own).expect("written");
        Slabs::from(slabs.first().clone())
            .write(&of_one)
            .expect("written");
        let bytes = |path| std::fs::read(path).expect("read");
        let own_bytes = bytes(&own);
        assert_eq!(own_bytes, bytes(&of_one));
        assert!(
            !own_bytes.windows(6).any(|window| window == b"others"),
            "what older programs do not know"
        );
        assert!(matches!(
            Slabs::new(Vec::new()),
            Err(LumigraphError::Slabs(0))
        ));
    }
}
