//! The plan of the rays after the pilot: rays go where new depth pixels are still being found.
//!
//! A *single* is a depth pixel that exactly one ray has hit. Singles after the pilot are evidence
//! of depth pixels that no ray has hit yet: the probability that the next ray of a population finds
//! a new one is estimated by the share of its rays that hit singles (Good 1953, "The population
//! frequencies of species and the estimation of population parameters"; the estimate is Turing's).
//! The population is a *group* of strata: one direction cell and a block of position cells. The
//! plan is a pure function of the pilot's accumulators. Every shard traces the whole pilot, so that
//! all shards agree on the plan.

use crate::accumulate::accumulator::Accumulator;
use crate::accumulate::tile_store::TileStore;
use headbox_trace::sampler::{RayKey, Strata};
use rayon::prelude::*;
use std::io;

/// Maximum number of blocks along a side into which position cells are pooled.
const MAX_BLOCKS: u32 = 8;

/// Approximate minimum number of pilot rays of a group: fewer cannot resolve a share of singles of
/// a few per cent.
const PILOT_RAYS_PER_GROUP: u32 = 64;

/// Division of the strata into groups that share an estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Groups {
    strata: Strata,
    blocks: u32,
    domains: u32,
}

impl Groups {
    /// Groups of `domains` ray domains.
    pub fn new(strata: Strata, domains: u32) -> Self {
        let pilot_rays = strata.position_cells() * RayPlan::pilot_share(&strata);
        let blocks = (pilot_rays / PILOT_RAYS_PER_GROUP)
            .isqrt()
            .clamp(1, MAX_BLOCKS);
        Self {
            strata,
            blocks: blocks.min(strata.per_dimension),
            domains,
        }
    }

    /// Number of groups, all domains.
    pub fn count(&self) -> usize {
        (self.domains * self.per_domain()) as usize
    }

    fn per_domain(&self) -> u32 {
        self.strata.direction_cells() * self.blocks * self.blocks
    }

    /// Index of the group of a position cell in a direction cell.
    #[inline]
    pub fn index(&self, domain: u8, direction_cell: u32, position_cell: u32) -> usize {
        let n = self.strata.per_dimension;
        let block = |i: u32| i * self.blocks / n;
        let blocks = block(position_cell / n) * self.blocks + block(position_cell % n);
        ((u32::from(domain) * self.strata.direction_cells() + direction_cell)
            * self.blocks
            * self.blocks
            + blocks) as usize
    }

    fn ray_group(&self, key: RayKey) -> usize {
        let cells = self.strata.position_cells();
        self.index(key.domain(), key.stratum() / cells, key.stratum() % cells)
    }
}

/// Number of rays of each stratum, by group.
#[derive(Clone, Debug, PartialEq)]
pub struct RayPlan {
    /// Division of the strata into groups.
    pub groups: Groups,
    /// Rays per stratum of the pilot round: the first of each stratum.
    pub pilot_rays: u32,
    /// Rays per stratum after the pilot, by group.
    pub more_rays: Vec<u32>,
}

impl RayPlan {
    /// Number of rays of a stratum traced in the pilot: a quarter, at least one.
    pub fn pilot_share(strata: &Strata) -> u32 {
        strata.rays.div_ceil(4)
    }

    /// The plan in which every stratum gets all its rays (novelty stopping off).
    pub fn full(strata: Strata, domains: u32) -> Self {
        let groups = Groups::new(strata, domains);
        let pilot_rays = Self::pilot_share(&strata);
        Self {
            groups,
            pilot_rays,
            more_rays: vec![strata.rays - pilot_rays; groups.count()],
        }
    }

    /// The plan that follows from a pilot. A group whose next ray finds a new depth pixel with
    /// probability `novelty` or more gets all its rays; one in which that is less likely gets
    /// proportionally fewer, but at least one more per stratum: the plan does not depend on the
    /// hits of these rays, so that [`Self::missing_estimate`] may rely on them.
    ///
    /// # Errors
    /// If spilled accumulators cannot be read.
    pub fn from_pilot(
        strata: Strata,
        domains: u32,
        store: &TileStore,
        novelty: f64,
    ) -> io::Result<Self> {
        let mut plan = Self::full(strata, domains);
        let rest = strata.rays - plan.pilot_rays;
        let rays = group_rays(&plan.groups, |_| plan.pilot_rays);
        for ((more, singles), rays) in plan
            .more_rays
            .iter_mut()
            .zip(count_singles(&plan.groups, 0, store)?)
            .zip(rays)
        {
            let share = f64::from(singles) / rays.max(1) as f64 / novelty;
            *more = ((f64::from(rest) * share.min(1.0)).ceil() as u32)
                .max(1)
                .min(rest);
        }
        Ok(plan)
    }

    /// Number of rays that the plan traces in a direction cell.
    pub fn rays_in_cell(&self, domain: u8, direction_cell: u32) -> u64 {
        let cells = 0..self.groups.strata.position_cells();
        let more = |cell| self.more_rays[self.groups.index(domain, direction_cell, cell)];
        cells
            .map(|cell| u64::from(self.pilot_rays + more(cell)))
            .sum()
    }

    /// Estimates, for each domain, the probability that a fresh ray, uniform over the domain's
    /// strata, would find a depth pixel that the store does not hold. Counts singles among the rays
    /// after the pilot only: where the pilot happened to find little, the plan gives fewer rays,
    /// and the pilot's own share of singles is too low.
    ///
    /// # Errors
    /// If spilled accumulators cannot be read.
    pub fn missing_estimate(&self, store: &TileStore) -> io::Result<Vec<f64>> {
        let first = if self.groups.strata.rays > self.pilot_rays {
            self.pilot_rays
        } else {
            0
        };
        let singles = count_singles(&self.groups, first, store)?;
        let rays = group_rays(&self.groups, |group| {
            self.pilot_rays + self.more_rays[group] - first
        });
        let per_stratum = group_rays(&self.groups, |_| 1);
        let strata_per_domain = f64::from(self.groups.strata.direction_cells())
            * f64::from(self.groups.strata.position_cells());
        let domain_estimate = |domain: usize| {
            let groups = self.groups.per_domain() as usize;
            let share = |g: usize| {
                per_stratum[g] as f64 / strata_per_domain * f64::from(singles[g])
                    / rays[g].max(1) as f64
            };
            (domain * groups..(domain + 1) * groups).map(share).sum()
        };
        Ok((0..self.groups.domains as usize)
            .map(domain_estimate)
            .collect())
    }
}

/// Number of rays of each group, if each of its strata has `per_stratum` of the group.
fn group_rays(groups: &Groups, per_stratum: impl Fn(usize) -> u32) -> Vec<u64> {
    let mut strata_in_block = vec![0u64; (groups.blocks * groups.blocks) as usize];
    for cell in 0..groups.strata.position_cells() {
        strata_in_block[groups.index(0, 0, cell)] += 1;
    }
    (0..groups.count())
        .map(|g| strata_in_block[g % strata_in_block.len()] * u64::from(per_stratum(g)))
        .collect()
}

/// Counts depth bins hit by exactly one ray, by the group of that ray. Counts only rays of the plan
/// with numbers from `first` on: aimed rays are not evidence of missing depth pixels.
fn count_singles(groups: &Groups, first: u32, store: &TileStore) -> io::Result<Vec<u32>> {
    let count_tile = |mut counts: Vec<u32>, tile: usize| {
        for bin in store
            .tile_run(tile)?
            .chunk_by(|a, b| (a.link, a.bin) == (b.link, b.bin))
        {
            if let [Accumulator { count: 1, key, .. }] = bin
                && key.ray() >= first
                && u32::from(key.domain()) < groups.domains
            {
                counts[groups.ray_group(*key)] += 1;
            }
        }
        Ok(counts)
    };
    let zero = || vec![0u32; groups.count()];
    let add = |mut a: Vec<u32>, b: Vec<u32>| {
        a.iter_mut().zip(&b).for_each(|(a, b)| *a += b);
        Ok(a)
    };
    // A few long folds instead of one per tile: each carries a table of all groups.
    let tiles: Vec<usize> = (0..store.tile_count()).collect();
    let per_fold = tiles
        .len()
        .div_ceil(2 * rayon::current_num_threads())
        .max(1);
    tiles
        .par_chunks(per_fold)
        .map(|chunk| {
            chunk
                .iter()
                .try_fold(zero(), |counts, &tile| count_tile(counts, tile))
        })
        .try_reduce(zero, add)
}
