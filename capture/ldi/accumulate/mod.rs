//! Step 2: accumulators of hits, the tiles that store them, shards of them, and the mask of rays that left the scene.

pub mod accumulator;
pub mod environment_mask;
pub mod shard;
pub mod tiles;
