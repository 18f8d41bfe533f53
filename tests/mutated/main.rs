//! Damaged files of every kind. A separate program: its allocator records the largest allocation of
//! the whole process, so no other tests may run in it.

mod files;
mod houses;
mod image_sets;
mod mend;
mod mutations;
mod pictures;
mod scenes;
