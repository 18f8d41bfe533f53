//! The built-in procedural scenes of headbox: small generators over a seed.
