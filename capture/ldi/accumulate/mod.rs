//! Stage 2: accumulators of hits.
//!
//! * [`accumulator`]: one surface in one depth bin of one pixel.
//! * [`tile_store`]: stores accumulators by tiles of a face, and spills them to disk.
//! * [`environment_mask`]: directions in which rays left the scene.
//! * [`shard`]: files of accumulators, and their merge.

pub mod accumulator;
pub mod environment_mask;
pub mod shard;
pub mod tile_store;
