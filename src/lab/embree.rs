//! Embree as a baseline: primary rays of the same camera, traced in a separate process.
//!
//! The environment variable [`PROGRAM`] names the program, built from `benches/rivals/embree.cpp`,
//! whose header documents the build and the protocol. Nothing here links to Embree, so that it
//! remains optional.

use headbox_core::camera::Camera;
use headbox_trace::bvh::Tracer;
use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Error, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// Environment variable with the path of the program.
pub const PROGRAM: &str = "HEADBOX_EMBREE";

/// An Embree process with a scene. Dropping it ends the process.
pub struct Embree {
    child: Child,
    cameras: ChildStdin,
    answers: BufReader<ChildStdout>,
    origin: glam::DVec3,
    /// Embree's version, as reported by the program.
    pub version: String,
}

/// Time and hits of a traced frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayFrame {
    /// Time of the fastest kind of query, ms.
    pub ms: f64,
    /// Number of pixels whose ray hits a triangle.
    pub hits: u64,
}

impl Embree {
    /// Starts `program` with a tracer's triangles and a number of threads.
    ///
    /// # Errors
    /// An error of the system, if the program does not start or does not answer.
    pub fn start(program: &OsStr, tracer: &Tracer, threads: usize) -> Result<Self, Error> {
        // The program answers after it has read the file; then the folder is deleted.
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("triangles");
        std::fs::write(&path, triangles(tracer))?;
        let mut command = Command::new(program);
        command
            .arg(&path)
            .arg(threads.to_string())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        let mut child = command.spawn()?;
        let (Some(cameras), Some(answers)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(Error::other("it has no standard input or output"));
        };
        let mut started = Self {
            child,
            cameras,
            answers: BufReader::new(answers),
            origin: tracer.origin(),
            version: String::new(),
        };
        started.version = started.answer()?;
        Ok(started)
    }

    /// Traces a frame.
    ///
    /// # Errors
    /// An error of the system, if the program has ended, or an error with an invalid answer.
    pub fn trace(&mut self, camera: &Camera) -> Result<RayFrame, Error> {
        let axes = camera.world_from_eye();
        let vectors = [
            camera.eye() - self.origin,
            axes.col(0),
            axes.col(1),
            -axes.col(2),
        ];
        let numbers: Vec<String> = vectors
            .iter()
            .flat_map(|v| v.to_array())
            .map(|v| v.to_string())
            .collect();
        let (focal_px, width, height) = (camera.focal_px(), camera.width(), camera.height());
        writeln!(
            self.cameras,
            "{} {focal_px} {width} {height}",
            numbers.join(" ")
        )?;
        self.cameras.flush()?;
        let answer = self.answer()?;
        let mut words = answer.split(' ');
        let ms = words.next().and_then(|word| word.parse().ok());
        let hits = words.next().and_then(|word| word.parse().ok());
        match (ms, hits) {
            (Some(ms), Some(hits)) => Ok(RayFrame { ms, hits }),
            _ => Err(Error::other(format!("its answer is none: {answer:?}"))),
        }
    }

    /// Reads a line of the program's output.
    fn answer(&mut self) -> Result<String, Error> {
        let mut line = String::new();
        match self.answers.read_line(&mut line)? {
            0 => Err(Error::other("it ended without an answer")),
            _ => Ok(line.trim_end().to_owned()),
        }
    }
}

impl Drop for Embree {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Serialises the triangles for the program, with positions in the tracer's frame.
fn triangles(tracer: &Tracer) -> Vec<u8> {
    let scene = tracer.scene();
    let local = scene
        .positions
        .iter()
        .flat_map(|p| (*p - tracer.origin()).as_vec3().to_array());
    let mut bytes = Vec::with_capacity(8 + 12 * (scene.positions.len() + scene.triangles.len()));
    bytes.extend((scene.positions.len() as u32).to_le_bytes());
    bytes.extend((scene.triangles.len() as u32).to_le_bytes());
    local.for_each(|v| bytes.extend(v.to_le_bytes()));
    scene
        .triangles
        .iter()
        .flat_map(|t| t.vertices)
        .for_each(|v| bytes.extend(v.to_le_bytes()));
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use std::sync::Arc;

    fn bump() -> (Tracer, Camera) {
        let scene = Arc::new(headbox_scenes::build("bump", 0).expect("built in"));
        let centre = scene.headbox.expect("it has one").centre;
        let eye = centre + DVec3::new(0.1, 0.05, 0.0);
        let camera = Camera::look_at(eye, eye - DVec3::Z, DVec3::Y, 70.0, [64, 48]).expect("valid");
        (Tracer::new(scene, centre), camera)
    }

    /// A substitute program that counts its input tests the protocol without Embree.
    #[cfg(unix)]
    #[test]
    fn frames_are_traced_by_substitute_program() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().expect("a folder");
        let program = folder.path().join("stand-in");
        let text = "#!/bin/sh\nwc -c < \"$1\"\nwhile read -r line; do\nset -- $line\necho \"2.5 $#\"\ndone\n";
        std::fs::write(&program, text).expect("written");
        std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755))
            .expect("made executable");
        let (tracer, camera) = bump();
        let mut embree = Embree::start(program.as_os_str(), &tracer, 2).expect("it starts");
        let scene = tracer.scene();
        let bytes = 8 + 12 * (scene.positions.len() + scene.triangles.len());
        assert_eq!(embree.version.trim(), bytes.to_string());
        for _ in 0..2 {
            assert_eq!(
                embree.trace(&camera).expect("an answer"),
                RayFrame { ms: 2.5, hits: 15 }
            );
        }
        assert!(Embree::start(OsStr::new("/nowhere/at/all"), &tracer, 1).is_err());
        assert!(
            Embree::start(OsStr::new("true"), &tracer, 1).is_err(),
            "a program that says nothing"
        );
    }

    #[test]
    fn embree_and_tracer_hit_same_pixels() {
        let Some(program) = std::env::var_os(PROGRAM) else {
            println!("skipped: {PROGRAM} is not set");
            return;
        };
        let (tracer, camera) = bump();
        let found = Embree::start(&program, &tracer, 1)
            .expect("it starts")
            .trace(&camera)
            .expect("an answer");
        let origin = (camera.eye() - tracer.origin()).as_vec3();
        let pixels =
            (0..48).flat_map(|y| (0..64).map(move |x| (f64::from(x) + 0.5, f64::from(y) + 0.5)));
        let meets = |(x, y): &(f64, f64)| {
            let direction = camera.direction(*x, *y).as_vec3();
            let ray = headbox_trace::bvh::Ray {
                origin,
                direction,
                t_min: 0.0,
                t_max: f32::INFINITY,
            };
            tracer.closest(&ray).is_some()
        };
        let expected = pixels.filter(meets).count() as i64;
        assert!(
            (found.hits as i64 - expected).abs() <= 3 && found.ms > 0.0,
            "{found:?} for {expected} hits"
        );
    }
}
