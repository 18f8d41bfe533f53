//! How far light errs from the truth, and what it costs: `cargo test --release --lib light_error -- --ignored --nocapture`.

use super::*;
use crate::capture::light::Lighting;
use crate::capture::srgb8_from_linear;
use crate::capture::trace::Tracer;
use crate::capture::viewpoint::place_headbox;
use crate::ldi::accumulate::DepthBins;
use crate::ldi::build::{self, Tracing};
use crate::ldi::finish::dark_face;
use crate::ldi::job::CaptureJob;
use crate::ldi::mend::Mender;
use crate::ldi::parameters::{CaptureParameters, CaptureSettings, Resources};
use crate::progress::Silent;
use crate::scene_source::SceneSource;
use std::sync::Arc;

const FACE_SIZE_PX: u32 = 512;

/// Of so many parts one is held against truth.
const ONE_IN: u32 = 401;

/// Samples of each of two truths. What they err by is independent, so that the mean product of the differences from either is
/// the mean square error without that of the truth.
const TRUTH_SAMPLES: u32 = 512;

/// A scene whose rays are traced.
struct Study {
    tracer: Tracer,
    lighting: Lighting,
    settings: CaptureSettings,
    tracing: Tracing,
}

impl Study {
    fn new(source: SceneSource) -> Self {
        let scene = Arc::new(source.open().unwrap());
        let headbox = place_headbox(&scene, None, None).unwrap();
        let tracer = Tracer::new(scene, headbox.centre);
        let lighting = Lighting::measure(&tracer, CaptureParameters::DEFAULT.bounces);
        let mut job = CaptureJob::new(source, headbox.centre, headbox.half_size_m);
        job.face_size_px = FACE_SIZE_PX;
        job.parameters = CaptureParameters { strata: 24, rays_per_stratum: 8, ..CaptureParameters::DEFAULT };
        let settings = job.settings(&Resources::default(), (0, 1));
        let tracing = build::trace(&tracer, &settings, &Silent).unwrap();
        Self { tracer, lighting, settings, tracing }
    }

    fn shader(&self) -> Shader<'_> {
        Shader {
            tracer: &self.tracer,
            lighting: &self.lighting,
            samples: self.settings.parameters.light_samples,
            shape_only: false,
            face_size_px: self.settings.face_size_px,
        }
    }

    /// The parts of a face as they are before they are lit.
    fn dark(&self, face: Face) -> FaceParts {
        let (shader, half_size_m) = (self.shader(), self.settings.half_size_m);
        let mut parts = dark_face(&self.tracing, face, &shader, &Silent).unwrap();
        let bins = DepthBins::new(half_size_m, FACE_SIZE_PX);
        Mender { face, shader: &shader, bins: &bins, half_size_m: half_size_m as f32 }.mend(&mut parts);
        parts
    }

    /// The colours of a part by two independent truths, sRGB.
    fn truths(&self, part: &LitPart, face: Face, pixel: [u32; 2]) -> [[u8; 3]; 2] {
        let (shader, spot) = (self.shader(), self.shader().spot(part));
        [0, 1].map(|half| {
            let [stream, ..] = random4([pixel[0], pixel[1], part.primitive, half]);
            let light = |index: u32| {
                let sample = LightSample { stream, index };
                let point = spot.point(&sample, face, pixel, FACE_SIZE_PX);
                Vec3::from_array(shader.lighting.radiosity_per_albedo(shader.tracer, &point, &sample))
            };
            let soft = (0..TRUTH_SAMPLES).map(light).sum::<Vec3>() * (self.lighting.exposure / TRUTH_SAMPLES as f32);
            srgb(&LitPart { sun: Vec3::ZERO, soft, ..*part })
        })
    }
}

fn srgb(part: &LitPart) -> [u8; 3] {
    part.color().to_array().map(srgb8_from_linear)
}

/// Seconds of processor time that this process took so far.
fn processor_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
    [11, 12].iter().map(|&field| fields[field].parse::<f64>().unwrap() / 100.0).sum()
}

/// Prints the error of the colours of a scene's parts, and the processor time for their light.
fn report(name: &str) {
    let study = Study::new(SceneSource::new(name));
    let (mut count, mut seconds, mut squares, mut points) = (0, 0.0, 0.0, 0.0);
    for face in Face::ALL {
        let mut parts = study.dark(face);
        count += parts.parts.len();
        let start = processor_seconds();
        illuminate(&mut parts, face, &study.shader(), &Silent);
        seconds += processor_seconds() - start;
        let chosen = |&(p, _): &(u32, [u32; 2])| random4([p, face.index() as u32, 0, 0])[0].is_multiple_of(ONE_IN);
        let pixels = (0..FACE_SIZE_PX * FACE_SIZE_PX).map(|pixel| [pixel % FACE_SIZE_PX, pixel / FACE_SIZE_PX]);
        let all = pixels.flat_map(|[x, y]| parts.range(x, y).map(move |p| (p as u32, [x, y])));
        let chosen: Vec<(u32, [u32; 2])> = all.filter(chosen).collect();
        let error = |&(p, pixel): &(u32, [u32; 2])| {
            let part = &parts.parts[p as usize];
            let (found, truths) = (srgb(part), study.truths(part, face, pixel));
            let product = |c: usize| {
                let [a, b] = truths.map(|truth| f64::from(found[c]) - f64::from(truth[c]));
                a * b
            };
            (0..3).map(product).sum::<f64>() / 3.0
        };
        let errors: Vec<f64> = chosen.par_iter().map(error).collect();
        squares += errors.iter().sum::<f64>();
        points += chosen.len() as f64;
    }
    let db = 10.0 * (255.0 * 255.0 * points / squares).log10();
    println!("{name}: {db:.1} dB at {points} of {count} parts, {:.2} us each", seconds * 1e6 / count as f64);
}

#[test]
#[ignore = "a measurement"]
fn light_error_of_interior() {
    report("builtin:interior");
}

#[test]
#[ignore = "a measurement"]
fn light_error_of_tree() {
    report("builtin:tree");
}

#[test]
#[ignore = "a measurement"]
fn light_error_of_ward() {
    report("builtin:ward");
}

/// Of the file that `HEADBOX_LIGHT_SCENE` names.
#[test]
#[ignore = "a measurement"]
fn light_error_of_file() {
    report(&std::env::var("HEADBOX_LIGHT_SCENE").unwrap());
}
