//! The geometry pass: depth pixels of all rays so far, without light and colour, for test views.
//! After more rays, only the pixels that they hit are rebuilt.

use super::pixel_set::PixelSet;
use crate::capture::SceneCapture;
use crate::light::shade::Shader;
use crate::merge::clusters::PixelMerger;
use crate::merge::coverage::BinSpan;
use crate::merge::merged_face::MergedFace;
use crate::rays::trace_and_accumulate::TracedRays;
use crate::surfaces::unlit::UnlitFaces;
use headbox_core::cube_face::Face;
use headbox_core::progress::check_cancelled;
use headbox_cube::model::samples::{CubeSamples, LayeredDepthImage};
use std::io;

/// Depth pixels of all rays so far, without light and colour.
pub(crate) struct GeometryCube {
    pub(crate) cube: CubeSamples,
    /// Bin spans of the depth pixels of each face.
    spans: Vec<Vec<BinSpan>>,
}

impl GeometryCube {
    /// Builds the geometry of all rays so far.
    ///
    /// # Errors
    /// If spilled accumulators cannot be read, or if the capture was cancelled.
    pub(crate) fn build(capture: &SceneCapture, tracing: &TracedRays) -> io::Result<Self> {
        let faces = Face::ALL
            .map(|face| LayeredDepthImage::empty(face, 0))
            .into();
        let mut geometry = Self {
            cube: CubeSamples {
                info: capture.info(),
                faces,
                environment: tracing.environment_mask.environment(capture.lighting),
            },
            spans: vec![Vec::new(); Face::ALL.len()],
        };
        for face in Face::ALL {
            geometry.build_face(capture, tracing, face, None)?;
        }
        Ok(geometry)
    }

    /// Rebuilds the depth pixels that samples in the pixels `hit` of each face, which were added to
    /// `tracing` since the last build, have changed. The result equals that of [`Self::build`].
    ///
    /// # Errors
    /// See [`Self::build`].
    pub(crate) fn update(
        &mut self,
        capture: &SceneCapture,
        tracing: &TracedRays,
        hit: &[PixelSet],
    ) -> io::Result<()> {
        self.cube.environment = tracing.environment_mask.environment(capture.lighting);
        for face in Face::ALL {
            let hit = &hit[face.index()];
            if !hit.is_empty() {
                self.build_face(capture, tracing, face, Some(hit))?;
            }
        }
        Ok(())
    }

    /// Builds a face, or only the part that new samples in the pixels `hit` have changed: also the
    /// pixels around these, through repair of pinholes, and the alphas one pixel farther, where a
    /// rim may have been.
    fn build_face(
        &mut self,
        capture: &SceneCapture,
        tracing: &TracedRays,
        face: Face,
        hit: Option<&PixelSet>,
    ) -> io::Result<()> {
        let SceneCapture {
            spec,
            tracer,
            lighting,
            options,
        } = *capture;
        let size_px = spec.face_size_px;
        let bins = spec.depth_bins();
        let shader = Shader {
            capture: *capture,
            geometry_only: true,
        };
        let merged = hit.map(PixelSet::dilated);
        let measured = merged.as_ref().map(PixelSet::dilated);
        let is_in = |set: &Option<PixelSet>, x: u32, y: u32| {
            set.as_ref().is_none_or(|set| set.contains(x, y))
        };
        let unlit = UnlitFaces {
            tracing,
            shader: &shader,
        };
        let surfaces = unlit.build(face, measured.as_ref())?;
        check_cancelled(options.progress)?;
        let face_ldi = &mut self.cube.faces[face.index()];
        let face_spans = &mut self.spans[face.index()];
        let before = MergedFace {
            ldi: std::mem::replace(face_ldi, LayeredDepthImage::empty(face, 0)),
            spans: std::mem::take(face_spans),
        };
        let merger = PixelMerger {
            rule: spec.parameters.merge_rule,
            tone: lighting.tone,
            bins: &bins,
            shares: None,
        };
        let mut after = MergedFace::new(face, size_px, |x, y, out| {
            if is_in(&merged, x, y) {
                merger.merge([x, y], surfaces.pixel(x, y), out);
            } else {
                out.extend(before.pixel(x, y));
            }
        });
        drop((surfaces, before));
        after.measure_rim_alphas(tracer, &bins, spec.half_size_m, |x, y| {
            is_in(&measured, x, y)
        });
        *face_ldi = after.ldi;
        *face_spans = after.spans;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accumulate::accumulator::Sample;
    use crate::accumulate::tile_store::InsertScratch;
    use crate::rays::trace_and_accumulate::HitRouter;
    use crate::scene_source::SceneSource;
    use crate::spec::{CaptureSpec, RunOptions};
    use glam::Vec3;
    use headbox_core::random::Rng;
    use headbox_trace::bvh::{Ray, Tracer};
    use headbox_trace::light::Lighting;
    use headbox_trace::sampler::RayKey;
    use headbox_trace::viewpoint::place_headbox;
    use std::sync::Arc;

    /// Hits of random rays from the centre, which the capture itself does not trace.
    fn random_samples(router: &HitRouter, count: u64) -> Vec<Sample> {
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
    fn updated_geometry_equals_a_full_build() {
        let scene_source = SceneSource::new("builtin:miniature");
        let scene = Arc::new(scene_source.open().unwrap());
        let headbox = place_headbox(&scene, None, None).unwrap();
        let mut spec = CaptureSpec::new(scene_source, headbox.centre, headbox.half_size_m);
        spec.face_size_px = 70;
        spec.parameters.strata = 6;
        spec.parameters.rays_per_stratum = 4;
        let tracer = Tracer::new(Arc::clone(&scene), headbox.centre);
        let lighting = Lighting::unmetered(&tracer, 1);
        let options = RunOptions::default();
        let capture = SceneCapture::new(&spec, &tracer, &lighting, &options);
        let tracing = capture.trace().unwrap();
        let router = HitRouter::new(&capture, &tracing.environment_mask);
        let mut geometry = GeometryCube::build(&capture, &tracing).unwrap();
        for count in [40, 0, 400] {
            let samples = random_samples(&router, count);
            let before = geometry.cube.clone();
            tracing
                .store
                .insert(&samples, &mut InsertScratch::default())
                .unwrap();
            let mut hit: Vec<PixelSet> = Face::ALL.map(|_| PixelSet::new(70)).into();
            for sample in &samples {
                hit[sample.face.index()].insert(sample.x.into(), sample.y.into());
            }
            geometry.update(&capture, &tracing, &hit).unwrap();
            let expected = GeometryCube::build(&capture, &tracing).unwrap();
            assert!(
                geometry.cube == expected.cube && geometry.spans == expected.spans,
                "{count} more rays"
            );
            assert_eq!(
                geometry.cube != before,
                count > 0,
                "more rays change the geometry"
            );
        }
    }
}
