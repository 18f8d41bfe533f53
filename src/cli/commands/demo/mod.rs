//! `headbox demo`: capture, rendering and comparison with truth, end to end.

mod sprites;

use crate::commands::capture::place::place_headbox;
use crate::commands::demo::sprites::print_sprite_rows;
use crate::output::{Outputs, peak_rss_mb, save_picture, write_text};
use crate::packing::describe_cube;
use crate::progress::{Bar, PlannedStage};
use clap::Args;
use glam::DVec3;
use headbox_core::camera::{Camera, CameraError};
use headbox_core::drawing::contact_sheet::{SheetRow, contact_sheet};
use headbox_core::frame::Coverage;
use headbox_core::headbox::Headbox;
use headbox_core::metrics::{self, Comparison};
use headbox_core::progress::Silent;
use headbox_cube::model::parameters::CaptureParameters;
use headbox_cube::pack::{CubeLdi, SplatIndexLayout, Split};
use headbox_cube::planes;
use headbox_cube::render::{RenderSettings, Renderer};
use headbox_lab::cube_map::CubeMap;
use headbox_ldi::capture::SceneCapture;
use headbox_ldi::scene_source::SceneSource;
use headbox_ldi::spec::{CaptureSpec, RunOptions};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::truth::{self, Truth};
use image::RgbImage;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

#[derive(Args)]
pub(crate) struct DemoCommand {
    /// Folder for the capture, the frames and the contact sheet
    #[arg(long, default_value = "headbox-demo")]
    out: PathBuf,
    /// Use small sizes: less than a minute
    #[arg(long)]
    quick: bool,
    /// Do not open a window at the end
    #[arg(long)]
    no_window: bool,
    /// Scene to capture
    #[arg(long, default_value = "builtin:tree")]
    scene: String,
}

/// Sizes of a demo.
struct Sizes {
    face_size_px: u32,
    strata: u32,
    rays: u32,
    light_samples: u32,
    frame: (u32, u32),
    truth_samples: u32,
}

const FULL: Sizes = Sizes {
    face_size_px: 1024,
    strata: 32,
    rays: 16,
    light_samples: 4,
    frame: (640, 480),
    truth_samples: 64,
};
const QUICK: Sizes = Sizes {
    face_size_px: 384,
    strata: 16,
    rays: 16,
    light_samples: 4,
    frame: (320, 240),
    truth_samples: 36,
};

/// Eye positions in the headbox, in half-sizes: the centre, and five off it.
const EYES: [(&str, [f64; 3]); 6] = [
    ("centre", [0.0, 0.0, 0.0]),
    ("right", [0.6, 0.0, 0.0]),
    ("left, up", [-0.5, 0.5, 0.2]),
    ("forward", [0.1, 0.0, -0.8]),
    ("back, down", [-0.3, -0.6, 0.7]),
    ("corner", [0.95, 0.95, 0.95]),
];

/// Frame and comparison with truth at one eye position.
struct Row {
    label: &'static str,
    frame: RgbImage,
    truth: Truth,
    map: RgbImage,
    ms: f64,
    hole_fraction: f64,
    comparison: Comparison,
}

impl DemoCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let sizes = if self.quick { QUICK } else { FULL };
        let outputs = Outputs::new(false, [&self.scene]).folder(&self.out)?;
        let source = SceneSource::new(&self.scene);
        let scene = Arc::new(source.open()?);
        outputs.add_scene(&scene)?;
        let Headbox {
            centre,
            half_size_m,
        } = place_headbox(&scene, None, None)?;
        println!(
            "{}: {} triangles, headbox {:.3} m a side",
            self.scene,
            scene.triangles.len(),
            2.0 * half_size_m
        );
        let tracer = Tracer::new(scene, centre);
        let spec = spec(&sizes, source, centre, half_size_m);
        let lighting = Lighting::prepare(
            &tracer,
            centre,
            spec.parameters.bounces,
            spec.parameters.light_samples > 0,
        );
        let cube = self.capture(&spec, &tracer, &lighting)?;
        let rows = render_rows(&cube, &tracer, &lighting, &sizes)?;
        self.save(&rows)?;
        print_table(&rows);
        print_cube_map_row(&tracer, &lighting, &cube, &sizes, &rows)?;
        let cameras: Vec<Camera> = EYES
            .iter()
            .map(|(_, offset)| camera(&cube, *offset, &sizes))
            .collect::<Result<_, _>>()?;
        let truths: Vec<RgbImage> = rows.iter().map(|row| row.truth.rgb()).collect();
        print_sprite_rows(&self.out, &tracer, &lighting, &cameras, &truths)?;
        self.print_next_steps();
        self.open_window();
        Ok(())
    }

    /// Opens the window on the capture; without a display only prints a message.
    #[cfg(feature = "viewer")]
    fn open_window(&self) {
        if !self.no_window
            && let Err(error) = super::view::show(&self.out.join("demo.ldi"))
        {
            eprintln!("no window: {error:#}");
        }
    }

    #[cfg(not(feature = "viewer"))]
    fn open_window(&self) {
        if !self.no_window {
            eprintln!("no window: this program was built without the viewer feature");
        }
    }

    fn capture(
        &self,
        spec: &CaptureSpec,
        tracer: &Tracer,
        lighting: &Lighting,
    ) -> anyhow::Result<CubeLdi> {
        let start = Instant::now();
        let bar = Bar::new();
        let options = RunOptions {
            progress: &bar,
            ..RunOptions::default()
        };
        let (ldi, trace_time) = SceneCapture::new(spec, tracer, lighting, &options).run()?;
        bar.finish();
        let cube = planes::pack(
            ldi,
            SplatIndexLayout::Normal,
            Split::Auto,
            planes::DEFAULT_ERROR_PX,
        )?;
        let path = self.out.join("demo.ldi");
        cube.write(&path)?;
        let (rays, kept) = (cube.info.rays_traced, describe_cube(&cube));
        println!(
            "captured {kept} from {rays} rays: {:.1} s, of which tracing {:.1} s ({:.1} Mrays/s){}",
            start.elapsed().as_secs_f64(),
            trace_time.as_secs_f64(),
            rays as f64 / trace_time.as_secs_f64() / 1e6,
            peak_rss_mb().map_or(String::new(), |mb| format!("; peak memory {mb:.0} MiB")),
        );
        println!(
            "wrote {} ({:.1} MB)\n",
            path.display(),
            std::fs::metadata(&path)?.len() as f64 / 1e6
        );
        Ok(cube)
    }

    fn save(&self, rows: &[Row]) -> anyhow::Result<()> {
        let mut sheet = Vec::new();
        for (i, row) in rows.iter().enumerate() {
            let Row {
                label,
                frame,
                truth,
                map,
                ms,
                comparison,
                ..
            } = row;
            let [flip, psnr, truth_psnr] = [
                comparison.flip,
                comparison.psnr_db,
                truth.standard_error_psnr_db,
            ];
            let mut pictures = Vec::new();
            for (name, image, caption) in [
                ("frame", frame, format!("headbox: {ms:.2} ms")),
                (
                    "truth",
                    &truth.rgb(),
                    format!("ray-traced truth: standard error {truth_psnr:.1} dB"),
                ),
                (
                    "error",
                    map,
                    format!("FLIP error: mean {flip:.3}, PSNR {psnr:.1} dB"),
                ),
            ] {
                let file = format!("{name}_{i}.png");
                save_picture(&self.out.join(&file), image)?;
                pictures.push((file, caption));
            }
            sheet.push(SheetRow {
                label: (*label).into(),
                pictures,
            });
        }
        let title = format!("headbox demo: {}", self.scene);
        write_text(&self.out.join("sheet.html"), &contact_sheet(&title, &sheet))?;
        write_text(&self.out.join("table.csv"), &csv(rows))
    }

    fn print_next_steps(&self) {
        let out = self.out.display();
        println!("\nframes, truth and a contact sheet are in {out}: open {out}/sheet.html first");
        println!(
            "next, look from elsewhere:  headbox render {out}/demo.ldi -o frame.png --eye 1.2,1.8,9 --look-at 0,4,0"
        );
        println!("or capture your own scene:  headbox capture scene.obj -o scene.ldi");
    }
}

fn spec(sizes: &Sizes, scene: SceneSource, centre: DVec3, half_size_m: f64) -> CaptureSpec {
    CaptureSpec {
        face_size_px: sizes.face_size_px,
        parameters: CaptureParameters {
            strata: sizes.strata,
            rays_per_stratum: sizes.rays,
            light_samples: sizes.light_samples,
            ..CaptureParameters::DEFAULT
        },
        ..CaptureSpec::new(scene, centre, half_size_m)
    }
}

/// Camera at an eye position, toward the side face with the most depth pixels.
fn camera(cube: &CubeLdi, offset: [f64; 3], sizes: &Sizes) -> Result<Camera, CameraError> {
    let count = |normal: DVec3| -> usize {
        let face = cube.segments.iter().filter(|s| s.face.normal() == normal);
        face.map(|s| s.depth_pixels.len()).sum()
    };
    let sides = [DVec3::NEG_Z, DVec3::X, DVec3::Z, DVec3::NEG_X];
    let ahead = sides
        .into_iter()
        .max_by_key(|&side| count(side))
        .unwrap_or(DVec3::NEG_Z);
    // Offsets are given for a view along -Z: turn them with the view.
    let right = ahead.cross(DVec3::Y);
    let [x, y, z] = offset;
    let eye = cube.info.centre + (right * x + DVec3::Y * y - ahead * z) * cube.info.half_size_m;
    let (width, height) = sizes.frame;
    Camera::look_at(
        eye,
        eye + ahead + DVec3::Y * 0.15,
        DVec3::Y,
        60.0,
        [width, height],
    )
}

fn render_rows(
    cube: &CubeLdi,
    tracer: &Tracer,
    lighting: &Lighting,
    sizes: &Sizes,
) -> anyhow::Result<Vec<Row>> {
    const REPEATS: usize = 9;
    let mut renderer = Renderer::new();
    let settings = RenderSettings::default();
    let stage = PlannedStage {
        stages: &["truth"],
        times: EYES.len() as u32,
        weight: 1.0,
    };
    let bar = Bar::planned(vec![stage], false);
    let mut rows = Vec::with_capacity(EYES.len());
    for (label, offset) in EYES {
        let camera = camera(cube, offset, sizes)?;
        let mut ms = Vec::with_capacity(REPEATS);
        for _ in 0..REPEATS {
            let start = Instant::now();
            renderer.render(cube, &camera, &settings);
            ms.push(start.elapsed().as_secs_f64() * 1e3);
        }
        ms.sort_by(f64::total_cmp);
        let (frame, _) = renderer.render_with_stats(cube, &camera, &settings);
        let truth = truth::render(tracer, lighting, true, &camera, sizes.truth_samples, &bar);
        // A hole has no splat and no environment, or environment where truth is only geometry.
        let hole = |(pixel, truth): (&Coverage, &Coverage)| {
            pixel.splat_share() == 0 && (*truth == Coverage::FULL || pixel.is_hole())
        };
        let holes = frame
            .coverage
            .iter()
            .zip(&truth.frame.coverage)
            .filter(|&pair| hole(pair))
            .count();
        let hole_fraction = holes as f64 / frame.color.len() as f64;
        let frame = frame.to_rgb()?;
        let (comparison, map) = metrics::compare_with_map(&truth.rgb(), &frame)?;
        rows.push(Row {
            label,
            frame,
            truth,
            map: map.to_magma(),
            ms: ms[REPEATS / 2],
            hole_fraction,
            comparison,
        });
    }
    bar.finish();
    Ok(rows)
}

fn print_table(rows: &[Row]) {
    println!("eye           ms/frame    FLIP  PSNR dB    SSIM   holes %  (truth's own error, dB)");
    for row in rows {
        let c = &row.comparison;
        println!(
            "{:<12} {:>9.2} {:>7.4} {:>8.2} {:>7.4} {:>9.3}  ({:.1})",
            row.label,
            row.ms,
            c.flip,
            c.psnr_db,
            c.ssim,
            row.hole_fraction * 100.0,
            row.truth.standard_error_psnr_db
        );
    }
    let off_centre = rows[1..]
        .iter()
        .map(|row| row.comparison.psnr_db)
        .sum::<f64>()
        / (rows.len() - 1) as f64;
    println!("mean PSNR off centre: {off_centre:.2} dB");
}

/// Prints the errors of a ray-traced cube map of the same face size, seen from the centre: the best
/// that any method without depth can do.
fn print_cube_map_row(
    tracer: &Tracer,
    lighting: &Lighting,
    cube: &CubeLdi,
    sizes: &Sizes,
    rows: &[Row],
) -> anyhow::Result<()> {
    let camera = camera(cube, EYES[0].1, sizes)?;
    let (centre, face_px) = (cube.info.centre, cube.face_size_px);
    let map = CubeMap::trace_for(
        tracer,
        lighting,
        centre,
        &[camera],
        face_px,
        sizes.light_samples,
        &Silent,
    );
    let c = metrics::compare(&rows[0].truth.rgb(), &map.resample(&camera))?;
    println!(
        "cube map of equal face size, bilinear, from the centre: FLIP {:.4}, PSNR {:.2} dB",
        c.flip, c.psnr_db
    );
    Ok(())
}

fn csv(rows: &[Row]) -> String {
    let mut text = String::from("eye,ms,flip,psnr_db,ssim,hole_fraction,truth_error_psnr_db\n");
    for row in rows {
        let (c, label) = (&row.comparison, row.label.replace(',', ""));
        let (ms, holes, error) = (row.ms, row.hole_fraction, row.truth.standard_error_psnr_db);
        text += &format!(
            "{label},{ms:.3},{},{},{},{holes},{error}\n",
            c.flip, c.psnr_db, c.ssim
        );
    }
    text
}
