//! Shard files: the accumulators of one part of a capture, and their merger.
//!
//! A shard holds integers and minima only ([`Accumulator`]), so that merging all shards gives exactly what one run
//! would have given. Light is sampled after the merger, which therefore opens the scene again.

use crate::accumulate::accumulator::Accumulator;
use crate::accumulate::environment_mask::MissMap;
use crate::accumulate::tiles::TileStore;
use crate::job::CaptureJob;
use crate::rays::ray_plan::RayPlan;
use crate::rays::trace::Tracing;
use headbox_core::container::{Container, ContainerWriter, FileError, FileKind};
use headbox_core::cube_face::Face;
use serde::{Deserialize, Serialize};
use std::io;
use std::path::{Path, PathBuf};

/// A part of a capture.
pub const SHARD: FileKind = FileKind::SHARD;

/// Into so many shards a capture is cut at most.
pub const MAX_PARTS: u32 = 1024;

/// What a shard says of itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShardInfo {
    /// The capture.
    pub job: CaptureJob,
    /// Checksum of the scene ([`crate::scene_source::fingerprint`]).
    pub scene_fingerprint: u32,
    /// Triangles of the scene.
    pub triangles: u32,
    /// Which part, from 0.
    pub part: u32,
    /// Of how many.
    pub parts: u32,
    /// Rays that this part traced.
    pub rays: u64,
}

/// How people number a part: from 1, so that part 0, which holds what is left over, is the last.
pub fn numbered(part: u32, parts: u32) -> String {
    format!("{}/{parts}", if part == 0 { parts } else { part })
}

/// Why shards could not be merged.
#[derive(Debug, thiserror::Error)]
pub enum ShardError {
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The disk failed while accumulators were spilled.
    #[error("accumulators could not be written to the temporary file: {0}")]
    Spill(#[from] io::Error),
    /// Parts of different captures.
    #[error("{} and {} are parts of different captures; give all shards of one capture", .0.display(), .1.display())]
    Different(PathBuf, PathBuf),
    /// Not every part, or one twice.
    #[error("the capture was cut into {parts} shards; {problem}")]
    Incomplete {
        /// How many there must be.
        parts: u32,
        /// What is wrong.
        problem: String,
    },
}

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
pub fn write(path: &Path, info: &ShardInfo, tracing: &Tracing) -> Result<(), FileError> {
    let mut writer = ContainerWriter::new(SHARD);
    writer.section("info", || Ok(serde_json::to_vec(info)?));
    writer.section("plan", || {
        Ok(bytemuck::cast_slice(&tracing.plan.more_rays).to_vec())
    });
    writer.section("misses", || {
        Ok(bytemuck::cast_slice(&tracing.misses.words()).to_vec())
    });
    let store = &tracing.store;
    let per_face = store.tile_count() / 6;
    for face in Face::ALL {
        writer.section(SECTIONS[face.index()], move || {
            let (mut counts, mut samples) = (Vec::new(), Vec::new());
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

/// Reads what a shard says of itself.
///
/// # Errors
/// See [`FileError`].
pub fn read_info(path: &Path) -> Result<ShardInfo, FileError> {
    let section = Container::open(path, SHARD)?.section("info")?;
    let info: ShardInfo = section.json()?;
    let strata = 1..=headbox_trace::sampler::Strata::MAX_PER_DIMENSION;
    let sizes = 1..=headbox_cube::model::validate::MAX_FACE_SIZE_PX;
    if !strata.contains(&info.job.parameters.strata)
        || !sizes.contains(&info.job.face_size_px)
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
    let what = |info: &ShardInfo| (info.job.clone(), info.scene_fingerprint, info.parts);
    if let Some((path, _)) = infos.iter().find(|(_, info)| what(info) != what(first)) {
        return Err(ShardError::Different(first_path.clone(), path.clone()));
    }
    let mut seen = vec![0u32; first.parts as usize];
    infos
        .iter()
        .for_each(|(_, info)| seen[info.part as usize] += 1);
    let numbers = |wanted: fn(u32) -> bool| -> Vec<String> {
        let chosen = seen.iter().enumerate().filter(|(_, count)| wanted(**count));
        chosen
            .map(|(part, _)| numbered(part as u32, first.parts))
            .collect()
    };
    let (missing, twice) = (numbers(|n| n == 0), numbers(|n| n > 1));
    if missing.is_empty() && twice.is_empty() {
        return Ok(());
    }
    let mut problem = Vec::new();
    if !missing.is_empty() {
        problem.push(format!("missing: {}", missing.join(", ")));
    }
    if !twice.is_empty() {
        problem.push(format!("given twice: {}", twice.join(", ")));
    }
    Err(ShardError::Incomplete {
        parts: first.parts,
        problem: problem.join("; "),
    })
}

/// Adds a shard's accumulators to `tracing`, whose store and plan belong to the same capture.
///
/// # Errors
/// See [`ShardError`].
pub fn absorb(path: &Path, info: &ShardInfo, tracing: &mut Tracing) -> Result<(), ShardError> {
    let file = Container::open(path, SHARD)?;
    let mut plan = file.section("plan")?;
    let more_rays: Vec<u32> = plan.array(tracing.plan.groups.count())?;
    plan.end()?;
    let most = info.job.parameters.rays_per_stratum - tracing.plan.pilot_rays;
    if more_rays.iter().any(|&rays| rays > most) {
        return Err(plan
            .damaged(format!("at most {most} more rays in each stratum"), "more")
            .into());
    }
    tracing.plan = RayPlan {
        more_rays,
        ..tracing.plan.clone()
    };
    let mut misses = file.section("misses")?;
    let words: Vec<u64> = misses.array(tracing.misses.words().len())?;
    misses.end()?;
    tracing.misses.absorb(&words);
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

/// Checks a shard whole, as a merger would; the number of its accumulators.
///
/// # Errors
/// See [`ShardError`].
pub fn check(path: &Path, info: &ShardInfo) -> Result<u64, ShardError> {
    let mut tracing = info.empty_tracing(None)?;
    absorb(path, info, &mut tracing)?;
    let mut accumulators = 0;
    for tile in 0..tracing.store.tile_count() {
        accumulators += tracing.store.tile_run(tile)?.len() as u64;
    }
    Ok(accumulators)
}

impl ShardInfo {
    /// An empty tracing into which all parts of the capture can be absorbed.
    ///
    /// # Errors
    /// If the spill file cannot be made.
    pub fn empty_tracing(&self, budget: Option<(u64, PathBuf)>) -> io::Result<Tracing> {
        let settings = self
            .job
            .settings(&crate::settings::Resources { budget }, (0, 1));
        let budget = settings
            .resources
            .budget
            .as_ref()
            .map(|(bytes, dir)| (*bytes, dir.as_path()));
        Ok(Tracing {
            store: TileStore::new(self.job.face_size_px, budget)?,
            misses: MissMap::new(self.job.face_size_px),
            plan: RayPlan::full(crate::settings::strata_of(&settings.parameters), 6),
            rays: 0,
            holes: None,
        })
    }
}
