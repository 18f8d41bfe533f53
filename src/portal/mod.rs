//! Portal models for people and for walking.

pub mod plan;
