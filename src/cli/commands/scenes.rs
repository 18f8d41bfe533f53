//! `headbox scenes`.

use crate::messages::format_count;
use crate::output::print_notes;
use anyhow::Context;
use clap::Args;
use headbox_core::files::write_whole;
use headbox_ldi::scene_source::SceneSource;
use headbox_scene::save::{losses, scene_files};
use std::path::Path;

#[derive(Args)]
pub(crate) struct ScenesCommand {
    /// Write scene NAME to FILE for other programs instead of listing the scenes: an .obj, with its
    /// .mtl and a .png per texture in the same folder, or a .glb; metres, Y up, without sun and sky
    #[arg(long, num_args = 2, value_names = ["NAME", "FILE"])]
    export: Option<Vec<String>>,
}

impl ScenesCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        match self.export.as_deref() {
            Some([name, file]) => export(name, Path::new(file)),
            _ => {
                list();
                Ok(())
            }
        }
    }
}

/// Lists the built-in scenes, one per line.
fn list() {
    for scene in headbox_scenes::all() {
        println!("builtin:{:<12} {}", scene.name, scene.description);
    }
}

fn export(name: &str, path: &Path) -> anyhow::Result<()> {
    let name = name.strip_prefix("builtin:").unwrap_or(name);
    let scene = SceneSource::new(format!("builtin:{name}")).open()?;
    let files = scene_files(&scene, path)?;
    print_notes(losses(&scene, path));
    // The named file is written last: if it exists, the scene is complete.
    for file in files.iter().rev() {
        write_whole(&file.path, |w| std::io::Write::write_all(w, &file.bytes))
            .with_context(|| format!("{} could not be written", file.path.display()))?;
    }
    let files = format_count(files.len() as u64, "file");
    println!(
        "{}: {} triangles, {files}",
        path.display(),
        scene.triangles.len()
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Corners, and colour and light of the middle, of every triangle, by material.
    fn shown(scene: &headbox_scene::scene::Scene) -> Vec<[f64; 15]> {
        let middle = 1.0 / 3.0;
        let mut order: Vec<u32> = (0..scene.triangles.len() as u32).collect();
        order.sort_by_key(|&i| scene.triangles[i as usize].material);
        order
            .into_iter()
            .map(|i| {
                let surface = scene.surface(i, middle, middle);
                let corners = scene.corners(i).map(|p| p.to_array());
                let looks = [surface.albedo, surface.emission].map(|color| color.map(f64::from));
                let all = [corners.as_flattened(), looks.as_flattened()].concat();
                std::array::from_fn(|k| all[k])
            })
            .collect()
    }

    #[test]
    fn exported_scenes_look_the_same() {
        let folder = tempfile::tempdir().expect("a folder");
        for name in ["bump", "interior", "poles"] {
            let built = SceneSource::new(format!("builtin:{name}"))
                .open()
                .expect("built in");
            let expected = shown(&built);
            for (ending, off) in [("obj", 2e-5), ("glb", 2e-5)] {
                let path = folder.path().join(format!("{name}.{ending}"));
                export(name, &path).expect("exported");
                let read = SceneSource::new(path.to_string_lossy())
                    .open()
                    .expect("read back");
                let found = shown(&read);
                assert_eq!(
                    found.len(),
                    expected.len(),
                    "{name}.{ending}: {:?}",
                    read.summary.notes
                );
                let off_by = |(a, b): (&[f64; 15], &[f64; 15])| {
                    a.iter()
                        .zip(b)
                        .map(|(a, b)| (a - b).abs() / b.abs().max(1.0))
                        .fold(0.0, f64::max)
                };
                let worst = found.iter().zip(&expected).map(off_by).fold(0.0, f64::max);
                assert!(worst < off, "{name}.{ending}: {worst}");
            }
        }
        assert!(export("nowhere", Path::new("a.obj")).is_err());
    }
}
