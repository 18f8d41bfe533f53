//! A representation of another crate, registered by one call, in all four clients: `render`, the
//! window, `report` and `export`. No file of the project refers to it.

use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::file_frame::FileFrame;
use headbox_core::frame::{Coverage, Frame};
use headbox_core::headbox::Headbox;
use headbox_core::view::{
    FrameReport, FrameRequest, Origin, Rendered, Setting, SettingValues, StartView, View,
};
use headbox_views::{ExportSummary, Exporter, Representation};
use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

/// View that colours each direction differently, scaled by a gain from the file.
struct DirectionView {
    gain: f64,
    frame: Frame,
}

fn settings() -> Vec<Setting> {
    vec![
        Setting::choice(
            "axes",
            "Axes",
            "Which axes have a colour (no unit).",
            &["all", "level"],
        )
        .with_flag("variant"),
        Setting::number("gain", "Gain", "Factor on the colours.", 1.0, 0.0..=4.0, "")
            .with_flag("gain"),
    ]
}

impl View for DirectionView {
    fn kind(&self) -> &'static str {
        "direction map"
    }

    fn start(&self, _: [u32; 2]) -> StartView {
        StartView {
            eye: DVec3::ZERO,
            forward: DVec3::NEG_Z,
            up: DVec3::Y,
            fov_y_deg: 60.0,
        }
    }

    fn origin(&self) -> Option<Origin> {
        Some(Origin {
            scene: "builtin:bump".into(),
            frame: FileFrame::default(),
            light: headbox_core::light_parameters::LightParameters::default(),
            headbox: Headbox {
                centre: DVec3::ZERO,
                half_size_m: 0.5,
            },
            lit: false,
        })
    }

    fn primitives(&self) -> (u64, &'static str) {
        (1, "maps")
    }

    fn bytes(&self) -> u64 {
        8
    }

    fn settings(&self) -> Vec<Setting> {
        settings()
    }

    fn render(&mut self, request: &FrameRequest) -> Result<Rendered<'_>, String> {
        let gain = self.gain * request.settings.number("gain")?;
        let height = f64::from(u8::from(request.settings.choice("axes")? == 0));
        let camera = &request.camera;
        self.frame.reset(camera.width(), camera.height(), [0; 3]);
        let pixels = self.frame.color.iter_mut().zip(&mut self.frame.coverage);
        for (i, (pixel, coverage)) in pixels.enumerate() {
            let [x, y] = [i as u32 % camera.width(), i as u32 / camera.width()];
            let ray = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let ray = ray.normalize() * DVec3::new(1.0, height, 1.0);
            let [r, g, b] = ((ray * 0.5 + 0.5) * 255.0 * gain)
                .to_array()
                .map(|c| c as u8);
            *pixel = [r, g, b, 255];
            *coverage = Coverage::FULL;
        }
        Ok(Rendered {
            frame: &self.frame,
            report: FrameReport {
                ms: 1.0,
                ..FrameReport::default()
            },
        })
    }
}

const DIRECTIONS: Representation = Representation {
    name: "direction map",
    extension: "directions",
    tag: None,
    open: |path| {
        let gain = std::fs::read_to_string(path)?;
        Ok(Box::new(DirectionView {
            gain: gain.trim().parse().unwrap_or(1.0),
            frame: Frame::default(),
        }))
    },
    settings,
    exporters: &[Exporter {
        extension: "ply",
        write: |view, options, _, to| {
            writeln!(to, "{} of {}", options.title, view.kind())?;
            Ok(ExportSummary::default())
        },
    }],
};

fn headbox(arguments: &[&str], folder: &Path) -> ExitCode {
    let words = ["headbox"].iter().chain(arguments);
    let words = words.map(|word| word.replace("DIR", &folder.to_string_lossy()));
    headbox_cli::run_command(words.map(OsString::from))
}

#[test]
fn one_registration_reaches_every_client() {
    headbox_views::add(DIRECTIONS);
    let dir = tempfile::tempdir().expect("a folder");
    let folder = dir.path();
    let file = folder.join("x.directions");
    std::fs::write(&file, "0.5").expect("writes");
    let size = "--size=32x24";

    // Flags of `render` come from the settings.
    let run = |arguments: &[&str]| assert_eq!(headbox(arguments, folder), ExitCode::SUCCESS);
    run(&["render", "DIR/x.directions", "-o", "DIR/a.png", size]);
    let louder = [
        "render",
        "DIR/x.directions",
        "-o",
        "DIR/b.png",
        size,
        "--gain=2",
    ];
    run(&louder);
    let level = [
        "render",
        "DIR/x.directions",
        "-o",
        "DIR/c.png",
        size,
        "--variant=level",
    ];
    run(&level);
    let pixels = |name: &str| {
        let picture = image::open(folder.join(name)).expect("a picture").to_rgb8();
        picture.into_raw()
    };
    let [a, b, c] = ["a.png", "b.png", "c.png"].map(pixels);
    assert!(a != b && a != c && a.len() == 32 * 24 * 3);
    // A flag of other representations is refused.
    let foreign = [
        "render",
        "DIR/x.directions",
        "-o",
        "DIR/d.png",
        "--fill-steps=2",
    ];
    assert_eq!(headbox(&foreign, folder), ExitCode::from(2));

    // The window opens it and shows its settings.
    let mut source = headbox_window::open(&file.to_string_lossy()).expect("opens");
    assert_eq!(source.title(), "x.directions (direction map)");
    let panel = source.settings();
    assert!(panel.iter().any(|setting| setting.id == "gain"));
    let camera = Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 60.0, [32, 24]);
    let request = FrameRequest {
        complete: false,
        ..FrameRequest::complete(
            camera.expect("valid"),
            Arc::new(SettingValues::initial(&panel)),
        )
    };
    let mut shown = vec![[0; 4]; 32 * 24];
    source.render(&request, &mut shown).expect("renders");
    let shown: Vec<u8> = shown.iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
    assert!(shown == a, "the window shows what `render` writes");

    // Only the exports that were registered with it.
    run(&["export", "DIR/x.directions", "-o", "DIR/x.ply"]);
    let exported = std::fs::read_to_string(folder.join("x.ply")).expect("a file");
    assert_eq!(exported, "x of direction map\n");
    let page = ["export", "DIR/x.directions", "-o", "DIR/x.html"];
    assert_eq!(headbox(&page, folder), ExitCode::FAILURE);

    // The report compares its variants with representations made of the scene.
    run(&[
        "report",
        "DIR/x.directions",
        "--quick",
        "-o",
        "DIR/report",
        "--cache",
        "DIR/truth",
    ]);
    let csv = std::fs::read_to_string(folder.join("report/report.csv")).expect("a table");
    for variant in ["direction map, all", "direction map, level"] {
        assert!(csv.contains(variant), "{variant}:\n{csv}");
    }
}
