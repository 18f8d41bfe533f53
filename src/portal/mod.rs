//! Walking portal models: geometry for the cell that the eye is in and for near cells, images behind the other portals
//! (inventory R1 to R16, P1 to P9).
//!
//! * [`cull`]: which cells show, and through which part of the frame (R1).

pub mod cull;
