//! Contenders that draw cubes: settings of the renderer, of packing and of quantisation.

use super::contender_list::{CLIPPING, ContenderList, OPAQUE_PACKING, WITH_PLANES};
use super::{
    Contender, ExactDraw, FragmentDraw, LdiDraw, OracleDraw, PointCloud, Role, WarpArithmetic,
    WarpOnly,
};
use crate::plan::EyeSet;
use crate::report::captures::{PRIMITIVES, TimedCapture, pack, pack_planes, quantised};
use crate::report::subject::ReportError;
use headbox_cube::model::samples::CubeSamples;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split, UnquantisedCube};
use headbox_cube::planes::DEFAULT_ERROR_PX;
use headbox_cube::render::RenderSettings;
use headbox_cube::render::footprint::splat::SplatKernel;
use std::sync::Arc;

/// Group of the divisions of a frame among threads.
const PARALLEL: &str = "threads share a frame by";

/// Group of the formats of depth pixels.
const PACKING: &str = "depth pixel";

/// Name of the default format of depth pixels.
const PACKED: &str = "8 bytes, 11 bits of normal";

impl ContenderList<'_> {
    /// Adds a packed cube with the default settings of the renderer.
    pub(super) fn add_ldi(
        &mut self,
        roles: Vec<Role>,
        cube: &Arc<CubeLdi>,
        capture_s: Option<f64>,
    ) {
        let contender = self.ldi(roles, cube, RenderSettings::default(), capture_s);
        self.contenders.push(contender);
    }

    /// Returns a contender that draws a packed cube.
    pub(super) fn ldi(
        &self,
        roles: Vec<Role>,
        cube: &Arc<CubeLdi>,
        settings: RenderSettings,
        capture_s: Option<f64>,
    ) -> Contender {
        Contender {
            roles,
            eyes: EyeSet::All,
            traces: false,
            pool: Arc::clone(&self.all),
            bytes: cube.bytes() as u64,
            depth_pixels: cube.depth_pixel_count() as u64,
            capture_s,
            rays: Some(cube.info.rays_traced),
            draw: Box::new(LdiDraw::new(Arc::clone(cube), settings)),
        }
    }

    /// Adds the default capture under every setting of the renderer; `more`: further roles of the
    /// default settings.
    pub(super) fn add_renderings(
        &mut self,
        cube: &Arc<CubeLdi>,
        capture_s: Option<f64>,
        more: &[(&'static str, &str, bool)],
    ) {
        let default = RenderSettings::default();
        let mut roles = vec![
            Role::baseline("representation", "LDI"),
            Role::baseline("footprints", "tents, averaged per surface"),
            Role::other(
                "threads",
                format!("{} threads", self.all.current_num_threads()),
            ),
            Role::baseline(PARALLEL, "bands of rows"),
            Role::baseline(PACKING, PACKED),
        ];
        roles.extend(
            more.iter()
                .map(|&(group, variant, baseline)| Role::new(group, variant, baseline)),
        );
        self.add_ldi(roles, cube, capture_s);
        let footprint = |name| Role::other("footprints", name);
        for (kernel, roles) in [
            (
                SplatKernel::Paper,
                vec![
                    Role::other("representation", "LDI, paper's splats"),
                    footprint("squares of 4 integer sizes (paper)"),
                ],
            ),
            (
                SplatKernel::Opaque,
                vec![
                    Role::other("representation", "LDI, opaque rectangles"),
                    footprint("opaque rectangles of exact size"),
                    Role::baseline(OPAQUE_PACKING, PACKED),
                ],
            ),
            (
                SplatKernel::Ellipse,
                vec![footprint("elliptical Gaussians in floating point")],
            ),
            (SplatKernel::Point, vec![footprint("single pixels")]),
            (
                SplatKernel::Square3,
                vec![footprint("3x3 px, whatever their size")],
            ),
        ] {
            let settings = RenderSettings { kernel, ..default };
            let contender = self.ldi(roles, cube, settings, capture_s);
            self.contenders.push(contender);
        }
        for (unclipped, name) in [(false, "on"), (true, "off")] {
            let settings = RenderSettings {
                unclipped,
                // One band: without clipping, each band would warp every depth pixel.
                band_rows: self.plan.quality.frame_px[1],
                ..default
            };
            let role = Role::new(CLIPPING, name, !unclipped);
            self.contenders.push(Contender {
                pool: Arc::clone(&self.one),
                ..self.ldi(vec![role], cube, settings, capture_s)
            });
        }
        for (count, name) in [
            (0, "fragments along epipolar lines, one a thread"),
            (8, "eight such fragments"),
        ] {
            let role = Role::other(PARALLEL, name);
            self.contenders.push(Contender {
                draw: Box::new(FragmentDraw::new(Arc::clone(cube), count)),
                ..self.ldi(vec![role], cube, default, capture_s)
            });
        }
        let role = Role::baseline("threads", "1 thread");
        self.contenders.push(Contender {
            pool: Arc::clone(&self.one),
            ..self.ldi(vec![role], cube, default, capture_s)
        });
        for (stamp, name) in [(1, "points, 1 px"), (3, "points, 3x3 px")] {
            let points = PointCloud::new(cube, stamp);
            let role = Role::other("representation", name);
            self.contenders.push(Contender {
                bytes: points.bytes(),
                draw: Box::new(points),
                ..self.ldi(vec![role], cube, default, capture_s)
            });
        }
        for (arithmetic, name) in [
            (WarpArithmetic::Direct, "direct, in f64"),
            (
                WarpArithmetic::RunningSum,
                "a running sum along each row, in f32 (paper)",
            ),
            (
                WarpArithmetic::Anchored,
                "from an anchor every 64 columns, in f32",
            ),
        ] {
            let group = "incremental warp (single pixels, 1 thread)";
            let role = Role::new(group, name, arithmetic == WarpArithmetic::Direct);
            self.contenders.push(Contender {
                pool: Arc::clone(&self.one),
                draw: Box::new(WarpOnly::new(Arc::clone(cube), arithmetic)),
                ..self.ldi(vec![role], cube, default, capture_s)
            });
        }
    }

    /// Adds the default capture packed with other settings.
    pub(super) fn add_repacked(&mut self, capture: &TimedCapture) -> Result<(), ReportError> {
        let capture_s = Some(capture.seconds);
        let unsplit = pack(&capture.ldi, Split::None)?;
        let roles = vec![Role::other("near/far split", "none")];
        self.add_ldi(roles, &unsplit, capture_s);
        for (group, kernel) in [
            (PACKING, SplatKernel::Tent),
            (OPAQUE_PACKING, SplatKernel::Opaque),
        ] {
            let exact = UnquantisedCube::pack(&capture.ldi, SplatIndexLayout::Normal, Split::Auto)?;
            let settings = RenderSettings {
                kernel,
                ..RenderSettings::default()
            };
            let packed_bytes: usize = exact
                .cube
                .segments
                .iter()
                .map(|s| size_of_val(&s.depth_pixels[..]))
                .sum();
            let role = Role::other(group, "24 bytes, nothing quantised");
            self.contenders.push(Contender {
                bytes: (exact.cube.bytes() - packed_bytes + exact.depth_pixel_bytes()) as u64,
                draw: Box::new(ExactDraw::new(exact, settings)),
                ..self.ldi(vec![role], &unsplit, settings, capture_s)
            });
        }
        let paper = CubeLdi::pack(&capture.ldi, SplatIndexLayout::Paper, Split::Auto)?;
        let roles = vec![
            Role::other(
                "normal in the splat index",
                "6 bits, and 5 of depth (paper)",
            ),
            Role::other(PACKING, "8 bytes, 6 bits of normal and 5 of depth (paper)"),
        ];
        self.add_ldi(roles, &Arc::new(paper), capture_s);
        Ok(())
    }

    /// Adds the default capture with plane textures within several error bounds; returns that of
    /// the default bound.
    pub(super) fn add_primitives(
        &mut self,
        capture: &TimedCapture,
    ) -> Result<Arc<CubeLdi>, ReportError> {
        let default = pack_planes(&capture.ldi, DEFAULT_ERROR_PX)?;
        let within =
            |error_px: f64| Role::other(PRIMITIVES, format!("planes within {error_px} px"));
        let roles = vec![
            Role::other("representation", WITH_PLANES),
            within(DEFAULT_ERROR_PX),
        ];
        self.add_ldi(roles, &default, Some(capture.seconds));
        for error_px in [0.25, 1.0, 2.0] {
            let cube = pack_planes(&capture.ldi, error_px)?;
            self.add_ldi(vec![within(error_px)], &cube, Some(capture.seconds));
        }
        Ok(default)
    }

    /// Adds contenders that measure the cost of quantisation, one quantity at a time, with the
    /// reference renderer, which quantises nothing.
    pub(super) fn add_quantised(&mut self, ldi: &CubeSamples, cube: &Arc<CubeLdi>) {
        for (variant, baseline, edited) in quantised(ldi, cube) {
            let role = Role::new("quantisation (direct warp in f64)", variant, baseline);
            self.contenders.push(Contender {
                eyes: EyeSet::Ahead,
                pool: Arc::clone(&self.one),
                draw: Box::new(OracleDraw::new(edited)),
                ..self.ldi(vec![role], cube, RenderSettings::default(), None)
            });
        }
    }
}
