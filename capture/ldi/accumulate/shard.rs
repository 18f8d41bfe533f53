//! Shard files: the accumulators of one part of a capture, and their merge.
//!
//! A shard holds integers and minima only ([`Accumulator`]), so that merging all shards gives
//! exactly the result of one run. Light is sampled after the merge, which therefore opens the scene
//! again.

use crate::accumulate::accumulator::Accumulator;
use crate::capture::SceneCapture;
use crate::rays::ray_plan::RayPlan;
use crate::rays::trace_and_accumulate::TracedRays;
use crate::scene_source::fingerprint;
use crate::spec::{CaptureSpec, RunOptions};
use headbox_core::container::{Container, ContainerWriter, FileError, FileKind};
use headbox_core::cube_face::Face;
use serde::{Deserialize, Serialize};
use std::io;
use std::path::{Path, PathBuf};

/// File kind of a part of a capture.
pub const SHARD: FileKind = FileKind::SHARD;

/// Maximum number of shards of a capture.
pub const MAX_PARTS: u32 = 1024;

/// Header of a shard.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShardInfo {
    /// The capture.
    #[serde(rename = "job")]
    pub spec: CaptureSpec,
    /// Checksum of the scene ([`fingerprint`]).
    pub scene_fingerprint: u32,
    /// Triangles of the scene.
    pub triangles: u32,
    /// Number of the part, from 0.
    pub part: u32,
    /// Number of parts.
    pub parts: u32,
    /// Number of rays that this part traced.
    pub rays: u64,
}

impl ShardInfo {
    /// Header of a traced part of a capture.
    pub fn new(capture: &SceneCapture, tracing: &TracedRays) -> Self {
        let scene = capture.tracer.scene();
        let (part, parts) = capture.options.shard;
        Self {
            spec: capture.spec.clone(),
            scene_fingerprint: fingerprint(scene),
            triangles: scene.triangles.len() as u32,
            part,
            parts,
            rays: tracing.rays,
        }
    }
}

/// The label of a part in messages, which count parts from 1: part 0 is the last.
pub fn part_label(part: u32, parts: u32) -> String {
    format!("{}/{parts}", if part == 0 { parts } else { part })
}

/// Error while shards are merged.
#[derive(Debug, thiserror::Error)]
pub enum ShardError {
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// Accumulators could not be spilled.
    #[error("accumulators could not be written to the temporary file: {0}")]
    SpillFile(#[from] io::Error),
    /// The shards are parts of different captures.
    #[error("{} and {} are parts of different captures; give all shards of one capture", .0.display(), .1.display())]
    Different(PathBuf, PathBuf),
    /// A part is missing or was given twice.
    #[error("the capture was cut into {parts} shards; {problem}")]
    Incomplete {
        /// Number of parts of the capture.
        parts: u32,
        /// The missing and the repeated parts.
        problem: String,
    },
}

/// Names of the sections with accumulators, by index of the face.
const SECTIONS: [&str; 6] = [
    "samples +X",
    "samples -X",
    "samples +Y",
    "samples -Y",
    "samples +Z",
    "samples -Z",
];

/// Writes a shard.
///
/// # Errors
/// [`FileError::Io`].
pub fn write(path: &Path, info: &ShardInfo, tracing: &TracedRays) -> Result<(), FileError> {
    let mut writer = ContainerWriter::new(SHARD);
    writer.section("info", || Ok(serde_json::to_vec(info)?));
    writer.section("plan", || {
        Ok(bytemuck::cast_slice(&tracing.plan.more_rays).to_vec())
    });
    writer.section("misses", || {
        Ok(bytemuck::cast_slice(&tracing.environment_mask.words()).to_vec())
    });
    let store = &tracing.store;
    let per_face = store.tile_count() / 6;
    for face in Face::ALL {
        writer.section(SECTIONS[face.index()], move || {
            let mut counts = Vec::new();
            let mut samples = Vec::new();
            for tile in face.index() * per_face..(face.index() + 1) * per_face {
                let run = store.tile_run(tile)?;
                counts.push(run.len() as u64);
                samples.extend_from_slice(bytemuck::cast_slice(&run));
            }
            Ok([bytemuck::cast_slice(&counts), samples.as_slice()].concat())
        });
    }
    writer.write(path)
}

/// Reads the header of a shard.
///
/// # Errors
/// See [`FileError`].
pub fn read_info(path: &Path) -> Result<ShardInfo, FileError> {
    let section = Container::open(path, SHARD)?.section("info")?;
    let info: ShardInfo = section.json()?;
    let strata = 1..=headbox_trace::sampler::Strata::MAX_PER_DIMENSION;
    let sizes = 1..=headbox_cube::model::validate::MAX_FACE_SIZE_PX;
    if !strata.contains(&info.spec.parameters.strata)
        || !sizes.contains(&info.spec.face_size_px)
        || !(1..=MAX_PARTS).contains(&info.parts)
        || info.part >= info.parts
    {
        return Err(section.damaged("strata, face size and part in range", "others"));
    }
    Ok(info)
}

/// Checks that `infos` are all parts of one capture, each once.
///
/// # Errors
/// [`ShardError::Different`] or [`ShardError::Incomplete`].
pub fn check_complete(infos: &[(PathBuf, ShardInfo)]) -> Result<(), ShardError> {
    let Some((first_path, first)) = infos.first() else {
        return Err(ShardError::Incomplete {
            parts: 0,
            problem: "no shard was given".into(),
        });
    };
    let differs = |info: &ShardInfo| {
        info.spec != first.spec
            || info.scene_fingerprint != first.scene_fingerprint
            || info.parts != first.parts
    };
    if let Some((path, _)) = infos.iter().find(|(_, info)| differs(info)) {
        return Err(ShardError::Different(first_path.clone(), path.clone()));
    }
    let mut counts = vec![0u32; first.parts as usize];
    for (_, info) in infos {
        counts[info.part as usize] += 1;
    }
    let problem = |name: &str, selected: fn(u32) -> bool| {
        let labels: Vec<String> = (0..first.parts)
            .filter(|&part| selected(counts[part as usize]))
            .map(|part| part_label(part, first.parts))
            .collect();
        (!labels.is_empty()).then(|| format!("{name}: {}", labels.join(", ")))
    };
    let missing = problem("missing", |count| count == 0);
    let repeated = problem("given twice", |count| count > 1);
    let problems: Vec<String> = missing.into_iter().chain(repeated).collect();
    if problems.is_empty() {
        return Ok(());
    }
    Err(ShardError::Incomplete {
        parts: first.parts,
        problem: problems.join("; "),
    })
}

/// Adds a shard's accumulators to `tracing`, whose store and plan belong to the same capture.
///
/// # Errors
/// See [`ShardError`].
pub fn absorb(path: &Path, info: &ShardInfo, tracing: &mut TracedRays) -> Result<(), ShardError> {
    let file = Container::open(path, SHARD)?;
    let mut plan = file.section("plan")?;
    let more_rays: Vec<u32> = plan.array(tracing.plan.groups.count())?;
    plan.end()?;
    let most = info.spec.parameters.rays_per_stratum - tracing.plan.pilot_rays;
    if more_rays.iter().any(|&rays| rays > most) {
        return Err(plan
            .damaged(format!("at most {most} more rays in each stratum"), "more")
            .into());
    }
    tracing.plan = RayPlan {
        more_rays,
        ..tracing.plan.clone()
    };
    let mut mask = file.section("misses")?;
    let words: Vec<u64> = mask.array(tracing.environment_mask.words().len())?;
    mask.end()?;
    tracing.environment_mask.absorb(&words);
    tracing.rays += info.rays;
    let per_face = tracing.store.tile_count() / 6;
    for face in Face::ALL {
        let mut section = file.section(SECTIONS[face.index()])?;
        let counts: Vec<u64> = section.array(per_face)?;
        for (i, &count) in counts.iter().enumerate() {
            let run: Vec<Accumulator> =
                section.array(usize::try_from(count).unwrap_or(usize::MAX))?;
            if run
                .iter()
                .any(|acc| acc.primitive >= info.triangles || acc.count == 0)
            {
                return Err(section
                    .damaged("samples of triangles that the scene has", "others")
                    .into());
            }
            tracing
                .store
                .absorb_run(face.index() * per_face + i, &run)?;
        }
        section.end()?;
    }
    Ok(())
}

/// Checks a whole shard as a merge does. Returns the number of its accumulators.
///
/// # Errors
/// See [`ShardError`].
pub fn check(path: &Path, info: &ShardInfo) -> Result<u64, ShardError> {
    let mut tracing = TracedRays::empty(&info.spec, &RunOptions::default())?;
    absorb(path, info, &mut tracing)?;
    (0..tracing.store.tile_count())
        .map(|tile| Ok(tracing.store.tile_run(tile)?.len() as u64))
        .sum()
}
