//! `headbox scenes`.

/// Lists the built-in scenes, a line each.
pub(super) fn run() -> anyhow::Result<()> {
    for scene in crate::scenes::all() {
        println!("builtin:{:<12} {}", scene.name, scene.description);
    }
    Ok(())
}
