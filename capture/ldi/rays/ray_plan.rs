//! Where the remaining rays go: a pilot round over all strata shows where new depth pixels are still being found.
//!
//! After the pilot, a depth pixel that was met by a single ray of the whole capture is evidence of others not met at
//! all: the probability that the next ray of a population finds something new is estimated by the share of its rays
//! that found something seen once (Good 1953, "The population frequencies of species and the estimation of population
//! parameters"; the estimate is Turing's). The population is a *group* of strata: one direction cell and a block of
//! position cells. The plan is a pure function of the pilot's accumulators, which every shard traces whole, so that all
//! shards agree on it.

use crate::accumulate::accumulator::Accumulator;
use crate::accumulate::tiles::TileStore;
use headbox_trace::sampler::{RayKey, Strata};
use rayon::prelude::*;
use std::io;

/// Position cells are pooled into at most this many blocks a side.
const MAX_BLOCKS: u32 = 8;

/// Pilot rays that a group should have: a share of singles below a few per cent cannot be told from fewer.
const PILOT_RAYS_PER_GROUP: u32 = 64;

/// Strata that share an estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Groups {
    strata: Strata,
    blocks: u32,
    domains: u32,
}

impl Groups {
    /// The groups of `domains` ray domains.
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

    /// The group of a position cell in a direction cell.
    #[inline]
    pub fn of_cell(&self, domain: u8, direction_cell: u32, position_cell: u32) -> usize {
        let n = self.strata.per_dimension;
        let block = |i: u32| i * self.blocks / n;
        let blocks = block(position_cell / n) * self.blocks + block(position_cell % n);
        ((u32::from(domain) * self.strata.direction_cells() + direction_cell)
            * self.blocks
            * self.blocks
            + blocks) as usize
    }

    fn of_key(&self, key: RayKey) -> usize {
        let cells = self.strata.position_cells();
        self.of_cell(key.domain(), key.stratum() / cells, key.stratum() % cells)
    }
}

/// How many rays each stratum has been given so far, by group.
#[derive(Clone, Debug, PartialEq)]
pub struct RayPlan {
    /// The groups.
    pub groups: Groups,
    /// Rays per stratum of the pilot round: the first so many of each stratum.
    pub pilot_rays: u32,
    /// Rays per stratum after the pilot, by group.
    pub more_rays: Vec<u32>,
}

impl RayPlan {
    /// Rays of a stratum traced in the pilot: a quarter, at least one.
    pub fn pilot_share(strata: &Strata) -> u32 {
        strata.rays.div_ceil(4)
    }

    /// Every stratum gets all its rays (novelty stopping off).
    pub fn full(strata: Strata, domains: u32) -> Self {
        let groups = Groups::new(strata, domains);
        let pilot_rays = Self::pilot_share(&strata);
        Self {
            groups,
            pilot_rays,
            more_rays: vec![strata.rays - pilot_rays; groups.count()],
        }
    }

    /// The plan that follows from a pilot: a group where the next ray is new with probability `novelty` or more gets
    /// all its rays, one where it is less likely gets proportionally fewer, but one more per stratum at least: those
    /// were not chosen by what they found, so that [`Self::missing_estimate`] may rely on them.
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
        if novelty <= 0.0 {
            return Ok(plan);
        }
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

    /// Rays that the plan traces in one domain's direction cell.
    pub fn rays_in_cell(&self, domain: u8, direction_cell: u32) -> u64 {
        let cells = 0..self.groups.strata.position_cells();
        let more = |cell| self.more_rays[self.groups.of_cell(domain, direction_cell, cell)];
        cells
            .map(|cell| u64::from(self.pilot_rays + more(cell)))
            .sum()
    }

    /// Per domain: the estimated probability that a fresh ray, uniform over the domain's strata, would find a depth
    /// pixel that the store does not hold. Counts singles among the rays after the pilot only: where the pilot chanced
    /// to find little, it was given fewer rays, and its own share of singles is too low.
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

/// Sum over the strata of each group of what `per_stratum` says for the group.
fn group_rays(groups: &Groups, per_stratum: impl Fn(usize) -> u32) -> Vec<u64> {
    let mut strata_in_block = vec![0u64; (groups.blocks * groups.blocks) as usize];
    for cell in 0..groups.strata.position_cells() {
        strata_in_block[groups.of_cell(0, 0, cell)] += 1;
    }
    (0..groups.count())
        .map(|g| strata_in_block[g % strata_in_block.len()] * u64::from(per_stratum(g)))
        .collect()
}

/// Number of depth bins met by exactly one ray, by the group of that ray; counts rays numbered `first` and up, and only those of
/// the plan: rays that were aimed say nothing of others.
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
                counts[groups.of_key(*key)] += 1;
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
