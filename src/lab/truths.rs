//! Truth for a report: ray-traced frames, cached by a digest of all inputs.

use glam::Vec3;
use headbox_core::camera::Camera;
use headbox_core::container::{Container, ContainerWriter, FileError, FileKind};
use headbox_core::file_frame::UpAxis;
use headbox_core::frame::{Coverage, Frame};
use headbox_core::progress::{Progress, Silent};
use headbox_photos::cache::{self, FileLock};
use headbox_scene::scene::Scene;
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::truth::{self, Truth};
use serde::{Deserialize, Serialize};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};

/// Sections of the two halves of the samples. Files of earlier programs lack them and are traced
/// again.
const HALVES: [&str; 2] = ["half 1", "half 2"];

/// Header of a cached frame.
#[derive(Serialize, Deserialize)]
struct Header {
    width: u32,
    height: u32,
    #[serde(with = "headbox_core::metrics::infinite_as_null")]
    standard_error_psnr_db: f64,
}

/// Truth frames of one scene and light, traced or read from the cache.
pub struct Truths<'a> {
    tracer: &'a Tracer,
    lighting: &'a Lighting,
    lit: bool,
    folder: Option<PathBuf>,
    scene: [u64; 2],
}

impl<'a> Truths<'a> {
    /// Creates the truth of a scene; `lit` as in [`truth::render`]. Frames are cached in `folder`,
    /// which must exist.
    pub fn new(
        tracer: &'a Tracer,
        lighting: &'a Lighting,
        lit: bool,
        folder: Option<PathBuf>,
    ) -> Self {
        Self {
            tracer,
            lighting,
            lit,
            folder,
            scene: cache::digest(|hash| hash_scene(tracer.scene(), hash)),
        }
    }

    /// Returns the frame of a camera with `samples` rays per pixel.
    pub fn frame(&self, camera: &Camera, samples: u32, progress: &dyn Progress) -> Truth {
        let path = self
            .folder
            .as_ref()
            .map(|folder| folder.join(self.name(camera, samples)));
        let (path, _) = cache::refuse_links(path);
        let size = (camera.width(), camera.height());
        // A file of another size is not this camera's, whatever its name.
        let cached = path
            .as_deref()
            .and_then(|path| read(path).ok())
            .filter(|truth| (truth.frame.width, truth.frame.height) == size);
        if let Some(truth) = cached {
            // Failing to mark the file as used does no harm.
            let _ = path.as_deref().map(FileLock::of);
            return truth;
        }
        let truth = self.render(camera, samples, progress);
        if let (Some(path), Some(folder)) = (path, &self.folder) {
            // Failing to write the cache costs only time.
            if write(&path, &truth).is_ok() {
                cache::evict_to(folder, cache::MOST_BYTES);
            }
        }
        truth
    }

    fn render(&self, camera: &Camera, samples: u32, progress: &dyn Progress) -> Truth {
        truth::render(
            self.tracer,
            self.lighting,
            self.lit,
            camera,
            samples,
            progress,
        )
    }

    /// Returns the name of a frame's file: a digest of all inputs. It includes a small frame of two
    /// rays per pixel, so that a program with different tracing or light does not find this one's
    /// files.
    fn name(&self, camera: &Camera, samples: u32) -> String {
        let small = Camera::from_parts(
            camera.eye(),
            camera.world_from_eye(),
            camera.focal_px() / 8.0,
            16,
            12,
        );
        let small = small.map(|small| self.render(&small, 2, &Silent).rgb());
        cache::file_name("truth", |hash| {
            self.scene.iter().for_each(|part| hash.write_u64(*part));
            let numbers = [camera.eye().to_array(), [camera.focal_px(), 0.0, 0.0]].concat();
            numbers
                .iter()
                .chain(&camera.world_from_eye().to_cols_array())
                .for_each(|v| hash.write_u64(v.to_bits()));
            [camera.width(), camera.height(), samples]
                .iter()
                .for_each(|v| hash.write_u32(*v));
            self.lighting.bounces.hash(hash);
            hash.write_u32(self.lighting.exposure.to_bits());
            hash.write_u8(u8::from(self.lit));
            small.iter().for_each(|image| hash.write(image.as_raw()));
        })
    }
}

fn write(path: &Path, truth: &Truth) -> Result<(), FileError> {
    let Frame {
        width,
        height,
        coverage,
        ..
    } = &truth.frame;
    let header = Header {
        width: *width,
        height: *height,
        standard_error_psnr_db: truth.standard_error_psnr_db,
    };
    let shares: Vec<f32> = coverage
        .iter()
        .map(|pixel| f32::from(pixel.splat_share()) / 255.0)
        .collect();
    let mut writer = ContainerWriter::new(FileKind::TRUTH);
    writer.section("info", move || Ok(serde_json::to_vec(&header)?));
    writer.section("color", || Ok(truth.rgb().into_raw()));
    for (name, half) in HALVES.into_iter().zip(&truth.halves) {
        writer.section(name, || Ok(half.as_flattened().to_vec()));
    }
    writer.section("surface", || Ok(bytemuck::cast_slice(&shares).to_vec()));
    writer.write(path)
}

fn read(path: &Path) -> Result<Truth, FileError> {
    let file = Container::open(path, FileKind::TRUTH)?;
    let info = file.section("info")?;
    let Header {
        width,
        height,
        standard_error_psnr_db,
    } = info.json()?;
    let pixels = (width as usize).saturating_mul(height as usize);
    let color: Vec<[u8; 3]> = file.section("color")?.array(pixels)?;
    let half = |name| -> Result<Vec<[u8; 3]>, FileError> { file.section(name)?.array(pixels) };
    let halves = [half(HALVES[0])?, half(HALVES[1])?];
    let shares: Vec<f32> = file.section("surface")?.array(pixels)?;
    let color = color.into_iter().map(|[r, g, b]| [r, g, b, 255]).collect();
    Ok(Truth {
        frame: Frame {
            width,
            height,
            color,
            coverage: shares.into_iter().map(coverage_from_share).collect(),
            depth_m: Vec::new(),
        },
        radiance: Vec::new(),
        halves,
        standard_error_psnr_db,
    })
}

/// Returns the coverage of a stored share; a partial share never gives full coverage.
fn coverage_from_share(share: f32) -> Coverage {
    const ROUNDING: f32 = 0.01;
    if share > 0.0 {
        Coverage::from_splat_share((share * 255.0 + ROUNDING) as u8)
    } else {
        Coverage::ENVIRONMENT
    }
}

fn hash_scene(scene: &Scene, hash: &mut DefaultHasher) {
    let vectors = |hash: &mut DefaultHasher, vectors: &[Vec3]| {
        hash.write_usize(vectors.len());
        hash.write(bytemuck::cast_slice(vectors));
    };
    hash.write(bytemuck::cast_slice(&scene.positions));
    vectors(hash, &scene.normals);
    vectors(hash, &scene.colors);
    hash.write(bytemuck::cast_slice(&scene.texcoords));
    hash.write(bytemuck::cast_slice(&scene.emission_texcoords));
    hash.write(bytemuck::cast_slice(&scene.opacities));
    for triangle in &scene.triangles {
        hash.write(bytemuck::cast_slice(&triangle.vertices));
        hash.write_u32(triangle.material);
    }
    for material in &scene.materials {
        hash.write(format!("{material:?}").as_bytes());
    }
    for texture in &scene.textures {
        [texture.width(), texture.height()]
            .iter()
            .for_each(|side| hash.write_u32(*side));
        hash.write(bytemuck::cast_slice(texture.texels()));
        hash.write(format!("{:?}", texture.sampler()).as_bytes());
    }
    hash.write(
        format!(
            "{:?}{:?}{:?}{}",
            scene.sun,
            scene.sky,
            scene.lamps,
            scene.frame.up == UpAxis::Z
        )
        .as_bytes(),
    );
}

/// Estimates the rays per pixel for a standard error of `wanted_db`, given `reached_db` after
/// `samples`: the squared error is proportional to 1 / samples. Adds a margin of a fifth; returns
/// at most 16 times as many, because the standard error measured with few samples is unreliable.
pub fn samples_for(wanted_db: f64, reached_db: f64, samples: u32, most: u32) -> u32 {
    let factor = (10f64.powf((wanted_db - reached_db) / 10.0) * 1.2).clamp(1.0, 16.0);
    let required = (f64::from(samples) * factor / 16.0).ceil() * 16.0;
    (required as u32).clamp(samples, most.max(samples))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stats::psnr_from_mse;
    use glam::DVec3;
    use headbox_core::metrics;
    use std::sync::Arc;

    #[test]
    fn truth_cache_keys_camera_and_light() {
        let scene = Arc::new(headbox_scenes::build("bump", 0).expect("built in"));
        let headbox = scene.headbox.expect("it has one");
        let tracer = Tracer::new(scene, headbox.centre);
        let lighting = Lighting::measure(&tracer, 0);
        let folder = tempfile::tempdir().expect("a folder");
        let files = || std::fs::read_dir(folder.path()).expect("there").count();
        let camera = |x: f64| {
            let eye = headbox.centre + DVec3::X * x;
            Camera::look_at(eye, eye - DVec3::Z, DVec3::Y, 60.0, [20, 10]).expect("valid")
        };
        let truths = Truths::new(&tracer, &lighting, true, Some(folder.path().into()));
        let first = truths.frame(&camera(0.0), 4, &Silent);
        // The file has no radiance.
        let cached = Truth {
            radiance: Vec::new(),
            ..first.clone()
        };
        assert_eq!(
            (cached, files()),
            (truths.frame(&camera(0.0), 4, &Silent), 1)
        );
        assert_eq!(
            first,
            Truths::new(&tracer, &lighting, true, None).frame(&camera(0.0), 4, &Silent)
        );
        truths.frame(&camera(0.01), 4, &Silent);
        truths.frame(&camera(0.0), 6, &Silent);
        let mut brighter = lighting.clone();
        brighter.exposure *= 2.0;
        let other = Truths::new(&tracer, &brighter, true, Some(folder.path().into())).frame(
            &camera(0.0),
            4,
            &Silent,
        );
        assert_eq!(files(), 4);
        assert_ne!(first.frame.color, other.frame.color);
        // The least recently used frames are evicted.
        let large = folder.path().join(cache::file_name("truth", |_| {}));
        let file = std::fs::File::create(&large).expect("made");
        file.set_len(cache::MOST_BYTES).expect("nothing is written");
        file.set_modified(std::time::SystemTime::UNIX_EPOCH)
            .expect("a time");
        truths.frame(&camera(0.0), 4, &Silent);
        assert!(large.exists(), "nothing was written");
        truths.frame(&camera(0.02), 4, &Silent);
        assert_eq!((large.exists(), files()), (false, 5));
        // A damaged file is ignored.
        let damaged = std::fs::read_dir(folder.path()).expect("there").flatten();
        damaged.for_each(|file| std::fs::write(file.path(), b"HEADBOX\0trth").expect("written"));
        assert_eq!(first, truths.frame(&camera(0.0), 4, &Silent));
    }

    #[test]
    fn error_excludes_truth_noise() {
        let scene = Arc::new(headbox_scenes::build("ward", 0).expect("built in"));
        let centre = scene.headbox.expect("it has one").centre;
        let tracer = Tracer::new(scene, centre);
        let lighting = Lighting::measure(&tracer, 1);
        let camera =
            Camera::look_at(centre, centre - DVec3::Z, DVec3::Y, 60.0, [48, 36]).expect("valid");
        let frame = |samples| truth::render(&tracer, &lighting, true, &camera, samples, &Silent);
        // A picture with a known error against converged truth.
        let mut off = frame(2048).rgb();
        for (i, level) in off.iter_mut().enumerate() {
            *level = if i % 2 == 0 {
                level.saturating_add(8)
            } else {
                level.saturating_sub(8)
            };
        }
        let exact = metrics::psnr_db(&frame(4096).rgb(), &off).expect("sizes fit");
        let noisy = frame(64);
        let seen = metrics::psnr_db(&noisy.rgb(), &off).expect("sizes fit");
        let [first, second] = &noisy.halves();
        let own = psnr_from_mse(
            metrics::own_error([first, second], &off)
                .expect("sizes fit")
                .mse,
        );
        assert!(
            seen < exact - 2.0,
            "the noise of truth shows: {seen} and {exact} dB"
        );
        // sRGB levels are not linear in light, so that noise shifts their mean slightly.
        assert!((own - exact).abs() < 0.5, "{own} and {exact} dB");
    }

    #[test]
    fn samples_grow_with_required_error() {
        assert_eq!(samples_for(30.0, 40.0, 64, 4096), 64, "enough already");
        assert_eq!(
            samples_for(30.0, 24.0, 64, 4096),
            320,
            "four times and a fifth"
        );
        assert_eq!(samples_for(60.0, 20.0, 64, 4096), 1024, "not all at once");
        assert_eq!(
            samples_for(60.0, 20.0, 512, 1024),
            1024,
            "not beyond the limit"
        );
    }
}
