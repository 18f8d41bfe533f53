//! Walks through a house: frames (`walk`, `visit`, `settings`, `variant`), with backdrops built in
//! advance (`tour`), along paths (`walk_path`) that go around obstacles (`route`).

mod route;
pub mod settings;
pub mod tour;
pub mod variant;
pub mod visit;
pub mod walk;
pub mod walk_path;
