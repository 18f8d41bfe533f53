//! The captures of a scene that a report compares: the default, and variations of one parameter
//! each.

use super::contender::Role;
use super::subject::{ReportError, Subject};
use crate::plan::Plan;
use headbox_core::cube_face::Face;
use headbox_core::progress::Progress;
use headbox_cube::model::depth_bins::DepthBins;
use headbox_cube::model::parameters::{CaptureParameters, MergeRule, Sampler};
use headbox_cube::model::samples::{CubeSamples, DepthPixel, EncodedNormal, LayeredDepthImage};
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::planes;
use headbox_ldi::capture::SceneCapture;
use headbox_ldi::scene_source::SceneSource;
use headbox_ldi::spec::{CaptureSpec, RunOptions};
use std::sync::Arc;
use std::time::Instant;

/// Group of the error bounds of plane textures.
pub(super) const PRIMITIVES: &str = "primitives";

/// Roles of the default capture: group, variant, whether it is the baseline.
pub(super) const DEFAULT: [(&str, &str, bool); 9] = [
    ("layers", "all", true),
    ("near/far split", "by each face's depths", true),
    ("normal in the splat index", "11 bits", true),
    (PRIMITIVES, "samples alone", true),
    ("novelty stopping", "on", true),
    ("aimed rays", "until 0.01 % of pixels lack something", true),
    ("merging", "average", true),
    ("depth bins", "1 px of parallax", true),
    ("light samples", "4 per depth pixel", true),
];

/// Roles of the default capture in groups that need no other capture.
pub(super) const REPACKED: [(&str, &str, bool); 3] = [DEFAULT[1], DEFAULT[2], DEFAULT[3]];

/// Time below which a capture is repeated, seconds.
const SHORT_S: f64 = 0.5;
/// Number of repetitions of a short capture, of which the fastest counts.
const SHORT_REPEATS: u32 = 3;

/// A capture with its time.
pub struct TimedCapture {
    /// The capture.
    pub ldi: CubeSamples,
    /// Time of tracing, lighting and merging, seconds; the least time of a repeated capture.
    pub seconds: f64,
}

/// Captures one scene with different parameters.
pub struct Captures<'a> {
    /// The scene.
    pub subject: &'a Subject,
    /// Sizes.
    pub plan: &'a Plan,
}

impl Captures<'_> {
    /// Returns the specification of the default capture.
    fn spec(&self) -> CaptureSpec {
        let quality = self.plan.quality;
        CaptureSpec {
            face_size_px: quality.face_size_px,
            parameters: CaptureParameters {
                strata: quality.strata,
                rays_per_stratum: quality.rays,
                seed: self.plan.seed,
                bounces: self.subject.lighting.bounces,
                light_samples: if self.subject.lit {
                    quality.light_samples
                } else {
                    0
                },
                ..CaptureParameters::DEFAULT
            },
            ..CaptureSpec::new(
                SceneSource::new(&self.subject.name),
                self.plan.centre,
                self.plan.half_size_m,
            )
        }
    }

    /// Captures with the default parameters, modified by `change`.
    ///
    /// # Errors
    /// [`ReportError::Capture`].
    pub fn capture(
        &self,
        change: impl FnOnce(&mut CaptureSpec),
        progress: &dyn Progress,
    ) -> Result<TimedCapture, ReportError> {
        let mut spec = self.spec();
        change(&mut spec);
        let options = RunOptions {
            progress,
            ..RunOptions::default()
        };
        let run = || {
            let start = Instant::now();
            let Subject {
                tracer, lighting, ..
            } = self.subject;
            let (ldi, _) = SceneCapture::new(&spec, tracer, lighting, &options).run()?;
            Ok::<_, ReportError>(TimedCapture {
                ldi,
                seconds: start.elapsed().as_secs_f64(),
            })
        };
        let mut capture = run()?;
        // Other load on the machine distorts a short time.
        if capture.seconds < SHORT_S {
            for _ in 1..SHORT_REPEATS {
                capture.seconds = capture.seconds.min(run()?.seconds);
            }
        }
        Ok(capture)
    }

    /// Makes captures that differ from the default one in one parameter each.
    ///
    /// # Errors
    /// [`ReportError::Capture`].
    pub fn variations(
        &self,
        default: &TimedCapture,
        progress: &dyn Progress,
    ) -> Result<Vec<(Vec<Role>, TimedCapture)>, ReportError> {
        let (strata, rays) = (self.plan.quality.strata, self.plan.quality.rays);
        let mut captures = Vec::new();
        let mut add = |roles, change: &dyn Fn(&mut CaptureSpec)| -> Result<(), ReportError> {
            captures.push((roles, self.capture(change, progress)?));
            Ok(())
        };
        add(vec![Role::other("aimed rays", "none")], &|spec| {
            spec.parameters.holes = 1.0;
        })?;
        add(vec![Role::other("novelty stopping", "off")], &|spec| {
            spec.parameters.novelty = 0.0;
        })?;
        // Random rays only, without novelty stopping and aimed rays.
        let all_rays =
            |spec: &mut CaptureSpec| (spec.parameters.novelty, spec.parameters.holes) = (0.0, 1.0);
        add(
            vec![
                Role::baseline("sampler", "stratified"),
                Role::baseline("rays", format!("{strata}^4 x {rays}")),
            ],
            &all_rays,
        )?;
        for (name, sampler) in [
            ("white noise", Sampler::WhiteNoise),
            ("centre rays", Sampler::CentreRays),
        ] {
            add(vec![Role::other("sampler", name)], &|spec| {
                all_rays(spec);
                spec.parameters.sampler = sampler;
            })?;
        }
        for (n, m) in [
            (strata / 2, rays / 4),
            (strata / 2, rays),
            (strata, rays / 4),
            (strata, rays * 4),
        ] {
            let m = m.max(1);
            add(vec![Role::other("rays", format!("{n}^4 x {m}"))], &|spec| {
                all_rays(spec);
                (spec.parameters.strata, spec.parameters.rays_per_stratum) = (n, m);
            })?;
        }
        for (name, rule) in [
            ("keep the smaller area", MergeRule::SmallerArea),
            ("keep both if colours differ", MergeRule::ColorsApart),
        ] {
            add(vec![Role::other("merging", name)], &|spec| {
                spec.parameters.merge_rule = rule;
            })?;
        }
        if self.subject.lit {
            for samples in [1, 16] {
                let name = format!("{samples} per depth pixel");
                add(vec![Role::other("light samples", name)], &|spec| {
                    spec.parameters.light_samples = samples;
                })?;
            }
        }
        let mut edit = |role, change: &dyn Fn(&mut CubeSamples)| {
            let mut ldi = default.ldi.clone();
            change(&mut ldi);
            let seconds = default.seconds;
            captures.push((vec![role], TimedCapture { ldi, seconds }));
        };
        for parallax in [2.0, 4.0, 8.0] {
            let role = Role::other("depth bins", format!("{parallax} px of parallax"));
            edit(role, &|ldi| coarsen(ldi, parallax));
        }
        edit(
            Role::other("layers", "the nearest of each pixel (a depth image a face)"),
            &keep_nearest,
        );
        Ok(captures)
    }
}

/// Packs a capture in the default layout.
///
/// # Errors
/// [`ReportError::Pack`].
pub fn pack(ldi: &CubeSamples, split: Split) -> Result<Arc<CubeLdi>, ReportError> {
    let cube = CubeLdi::pack(ldi, SplatIndexLayout::Normal, split)?;
    Ok(Arc::new(cube))
}

/// Packs a capture in the default layout with plane textures.
///
/// # Errors
/// [`ReportError::Pack`].
pub fn pack_planes(ldi: &CubeSamples, error_px: f64) -> Result<Arc<CubeLdi>, ReportError> {
    let layout = SplatIndexLayout::Normal;
    let cube = planes::pack(ldi.clone(), layout, Split::Auto, error_px)?;
    Ok(Arc::new(cube))
}

/// Keeps the nearest sample of each pixel: six depth images.
fn keep_nearest(ldi: &mut CubeSamples) {
    for face in &mut ldi.faces {
        let mut nearest = LayeredDepthImage::empty(face.face, face.size_px);
        for (pixel, ends) in face.offsets.windows(2).enumerate() {
            nearest
                .samples
                .extend(face.samples[ends[0] as usize..ends[1] as usize].last());
            nearest.offsets[pixel + 1] = nearest.samples.len() as u32;
        }
        *face = nearest;
    }
}

/// Merges samples of one pixel with a relative parallax of at most `parallax_px` within the
/// headbox, as wider depth bins would: the mean of inverse depth, colour and alpha, the normal of
/// the nearest.
fn coarsen(ldi: &mut CubeSamples, parallax_px: f64) {
    let half_size_m = ldi.info.half_size_m;
    for face in &mut ldi.faces {
        let bins = DepthBins::new(half_size_m, face.size_px);
        let width = (bins.inverse_depth(1.0) * parallax_px / DepthBins::PARALLAX_PX) as f32;
        let mut merged = LayeredDepthImage::empty(face.face, face.size_px);
        for (pixel, ends) in face.offsets.windows(2).enumerate() {
            // Farthest first: a cluster starts at its farthest sample.
            let mut rest = &face.samples[ends[0] as usize..ends[1] as usize];
            while let Some(first) = rest.first() {
                let end = rest
                    .partition_point(|s| s.inverse_depth < first.inverse_depth + width)
                    .max(1);
                merged.samples.push(merge(&rest[..end]));
                rest = &rest[end..];
            }
            merged.offsets[pixel + 1] = merged.samples.len() as u32;
        }
        *face = merged;
    }
}

fn merge(cluster: &[DepthPixel]) -> DepthPixel {
    let count = cluster.len() as f32;
    let mean = |value: &dyn Fn(&DepthPixel) -> f32| cluster.iter().map(value).sum::<f32>() / count;
    let nearest = cluster[cluster.len() - 1];
    let channel = |c: usize| mean(&|s| f32::from(s.color_srgb[c])).round() as u8;
    DepthPixel {
        inverse_depth: mean(&|s| s.inverse_depth),
        normal: nearest.normal,
        color_srgb: [channel(0), channel(1), channel(2), channel(3)],
    }
}

/// Returns copies of a capture with one quantity quantised as in a packed layout: name, whether it
/// is the baseline (nothing quantised), capture.
pub(super) fn quantised(
    ldi: &CubeSamples,
    cube: &CubeLdi,
) -> Vec<(&'static str, bool, CubeSamples)> {
    let normal = |layout: SplatIndexLayout, face: Face, sample: &DepthPixel| {
        let in_face = face.world_from_eye().transpose() * sample.normal.decode().as_dvec3();
        let eye_depth = 1.0 / f64::from(sample.inverse_depth);
        let range = headbox_cube::pack::splat_index::DepthCodeRange {
            nearest_m: eye_depth,
            farthest_m: eye_depth,
        };
        let coded = layout
            .normal(layout.encode(in_face, eye_depth, range))
            .as_dvec3();
        EncodedNormal::new((face.world_from_eye() * coded).as_vec3())
    };
    let edited = |edit: &dyn Fn(Face, &mut DepthPixel)| {
        let mut copy = ldi.clone();
        for LayeredDepthImage { face, samples, .. } in &mut copy.faces {
            samples.iter_mut().for_each(|sample| edit(*face, sample));
        }
        copy
    };
    let with_depth = |bits: u32| {
        edited(&|face, sample| {
            // The range is that of the segment that contains the sample.
            let q = f64::from(sample.inverse_depth);
            let segment = cube.segments.iter().find(|s| {
                s.face == face
                    && (s.inverse_depth_min..=s.inverse_depth_max).contains(&sample.inverse_depth)
            });
            if let Some(segment) = segment {
                let least = f64::from(segment.inverse_depth_min);
                let most = f64::from(segment.inverse_depth_max);
                let steps = f64::from((1u32 << bits) - 1);
                let step = (most - least) / steps;
                let code = if step > 0.0 {
                    ((q - least) / step).round()
                } else {
                    0.0
                };
                sample.inverse_depth = (least + code * step) as f32;
            }
        })
    };
    vec![
        ("nothing quantised", true, ldi.clone()),
        ("depth in 20 bits", false, with_depth(20)),
        ("depth in 10 bits", false, with_depth(10)),
        (
            "normals in 11 bits",
            false,
            edited(&|f, s| s.normal = normal(SplatIndexLayout::Normal, f, s)),
        ),
        (
            "normals in 6 bits (paper)",
            false,
            edited(&|f, s| s.normal = normal(SplatIndexLayout::Paper, f, s)),
        ),
    ]
}
