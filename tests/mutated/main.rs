//! Damaged files of every kind. A program of its own: its allocator notes the largest allocation of
//! the whole process, so that nothing else may run beside it.

mod files;
mod houses;
mod mutations;
