//! What the rays so far have found, without light and colours, for a look at it; made anew only where rays have come since.

use super::pixel_set::PixelSet;
use crate::accumulate::accumulator::Sample;
use crate::light::shade::Shader;
use crate::merge::clusters::depth_pixels_of;
use crate::merge::coverage::BinSpan;
use crate::merge::merged_face::MergedFace;
use crate::rays::trace::Tracing;
use crate::settings::CaptureSettings;
use crate::surfaces::unlit::Dark;
use headbox_core::cube_face::Face;
use headbox_core::progress::{Progress, check_cancelled};
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::info::CaptureInfo;
use headbox_cube::model::samples::{CubeLdi, LayeredDepthImage};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use std::io;

/// What the rays so far have found, without light and colours.
pub(crate) struct Shape {
    cube: CubeLdi,
    /// Of the samples of each face.
    spans: Vec<Vec<BinSpan>>,
}

/// What shapes are made of.
pub(crate) struct ShapeSource<'a> {
    /// The scene.
    pub tracer: &'a Tracer,
    /// The lights, of which the sky is seen.
    pub lighting: &'a Lighting,
    /// Of the capture.
    pub settings: &'a CaptureSettings,
    /// Is asked whether the capture was given up, and told nothing.
    pub progress: &'a dyn Progress,
}

impl ShapeSource<'_> {
    /// The shape of all rays so far.
    ///
    /// # Errors
    /// If spilled accumulators cannot be read, or the capture was given up.
    pub(crate) fn shape(&self, run: &Tracing, info: CaptureInfo) -> io::Result<Shape> {
        let faces = Face::ALL
            .map(|face| LayeredDepthImage::empty(face, 0))
            .into();
        let cube = CubeLdi {
            info,
            faces,
            environment: run.misses.environment(self.lighting),
        };
        let mut shape = Shape {
            cube,
            spans: vec![Vec::new(); Face::ALL.len()],
        };
        Face::ALL
            .into_iter()
            .try_for_each(|face| self.make(&mut shape, run, face, None))?;
        Ok(shape)
    }

    /// Makes anew what `samples`, which are in `run` now and were not when the shape was made, have changed: it is then what
    /// [`Self::shape`] gives.
    ///
    /// # Errors
    /// As [`Self::shape`].
    pub(crate) fn renew(
        &self,
        shape: &mut Shape,
        run: &Tracing,
        samples: &[Sample],
    ) -> io::Result<()> {
        shape.cube.environment = run.misses.environment(self.lighting);
        for face in Face::ALL {
            let mut hit = PixelSet::new(self.settings.face_size_px);
            let mut here = samples
                .iter()
                .filter(|sample| sample.face == face)
                .peekable();
            if here.peek().is_some() {
                here.for_each(|sample| hit.insert(sample.x.into(), sample.y.into()));
                self.make(shape, run, face, Some(&hit))?;
            }
        }
        Ok(())
    }

    /// Makes a face, or what new samples in the pixels `hit` have changed: these, by mending the pixels around them, and the alphas of
    /// those around these, which may have been rims.
    fn make(
        &self,
        shape: &mut Shape,
        run: &Tracing,
        face: Face,
        hit: Option<&PixelSet>,
    ) -> io::Result<()> {
        let Self {
            tracer,
            lighting,
            settings,
            progress,
        } = *self;
        let (size_px, rule) = (settings.face_size_px, settings.parameters.merge_rule);
        let bins = DepthBins::new(settings.half_size_m, size_px);
        let shader = Shader {
            tracer,
            lighting,
            samples: 0,
            shape_only: true,
            face_size_px: size_px,
        };
        let merged = hit.map(PixelSet::grown);
        let around = merged.as_ref().map(PixelSet::grown);
        let is_in = |set: &Option<PixelSet>, x: u32, y: u32| {
            set.as_ref().is_none_or(|set| set.contains(x, y))
        };
        let parts = Dark {
            run,
            shader: &shader,
            settings,
            bins: &bins,
            progress,
        }
        .face(face, around.as_ref())?;
        check_cancelled(progress)?;
        let (old, spans) = (
            &mut shape.cube.faces[face.index()],
            &mut shape.spans[face.index()],
        );
        let ldi = std::mem::replace(old, LayeredDepthImage::empty(face, 0));
        let before = MergedFace {
            ldi,
            spans: std::mem::take(spans),
        };
        let mut made = MergedFace::of(face, size_px, |x, y, out| match is_in(&merged, x, y) {
            true => depth_pixels_of(parts.pixel(x, y), rule, lighting.tone, &bins, out),
            false => out.extend(before.pixel(x, y)),
        });
        drop((parts, before));
        made.measure_alphas(tracer, &bins, settings.half_size_m, |x, y| {
            is_in(&around, x, y)
        });
        (*old, *spans) = (made.ldi, made.spans);
        Ok(())
    }
}

impl Shape {
    /// As a cube.
    pub(crate) fn cube(&self) -> &CubeLdi {
        &self.cube
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accumulate::tiles::InsertScratch;
    use crate::job::CaptureJob;
    use crate::rays::trace;
    use crate::rays::trace::Router;
    use crate::scene_source::SceneSource;
    use crate::settings::Resources;
    use glam::Vec3;
    use headbox_core::progress::Silent;
    use headbox_core::random::Rng;
    use headbox_trace::bvh::Ray;
    use headbox_trace::sampler::RayKey;
    use headbox_trace::viewpoint::place_headbox;
    use std::sync::Arc;

    /// What rays from the centre meet; other rays than those of a capture.
    fn more_samples(router: &Router, count: u64) -> Vec<Sample> {
        let mut random = Rng::new(5);
        let sample = |number: u64| {
            let direction = Vec3::from_array([(); 3].map(|()| random.unit() as f32 - 0.5));
            let direction = direction.normalize();
            let ray = Ray {
                origin: Vec3::ZERO,
                direction,
                t_min: 0.0,
                t_max: f32::INFINITY,
            };
            let hit = router.tracer.closest(&ray)?;
            Some(router.sample(&ray, &hit, RayKey::new(6, number as u32, 0)))
        };
        (0..count).filter_map(sample).collect()
    }

    #[test]
    fn a_renewed_shape_is_the_shape_of_all_rays() {
        let scene_source = SceneSource::new("builtin:miniature");
        let scene = Arc::new(scene_source.open().unwrap());
        let headbox = place_headbox(&scene, None, None).unwrap();
        let mut job = CaptureJob::new(scene_source, headbox.centre, headbox.half_size_m);
        (
            job.face_size_px,
            job.parameters.strata,
            job.parameters.rays_per_stratum,
        ) = (70, 6, 4);
        let tracer = Tracer::new(Arc::clone(&scene), headbox.centre);
        let (lighting, settings) = (
            Lighting::of_scene(&tracer, 1),
            job.settings(&Resources::default(), (0, 1)),
        );
        let run = trace::trace(&tracer, &settings, &Silent).unwrap();
        let source = ShapeSource {
            tracer: &tracer,
            lighting: &lighting,
            settings: &settings,
            progress: &Silent,
        };
        let whole = || {
            source
                .shape(&run, job.shape_info(&tracer, &lighting))
                .unwrap()
        };
        let mut shape = whole();
        for count in [40, 0, 400] {
            let bins = DepthBins::new(job.half_size_m, job.face_size_px);
            let router = Router {
                tracer: &tracer,
                bins,
                size_px: job.face_size_px,
                misses: &run.misses,
            };
            let samples = more_samples(&router, count);
            let before = shape.cube.clone();
            run.store
                .insert(&samples, &mut InsertScratch::default())
                .unwrap();
            source.renew(&mut shape, &run, &samples).unwrap();
            let expected = whole();
            assert!(
                shape.cube == expected.cube && shape.spans == expected.spans,
                "{count} more rays"
            );
            assert_eq!(
                shape.cube != before,
                count > 0,
                "the rays were meant to find something"
            );
        }
    }
}
