//! Screenshots of the window, compared with those in `snapshots/`.
//! `UPDATE_SNAPSHOTS=1 cargo test -p headbox-viewer` rewrites them; inspect them afterwards. A
//! screenshot that differs is saved beside the old one as `NAME.new.png`.

use super::{painter::Painter, *};
use crate::input::keymap::Command;
use crate::thread::history::FrameTimes;
use egui::Key;
use headbox_core::view::Stage;
use image::RgbImage;
use std::path::{Path, PathBuf};

/// Maximum difference of a channel, levels: interpolation and blending in another order.
const LEVELS: u8 = 6;
/// Share of the pixels that may differ by more: edges of glyphs, and checks whose sines are rounded
/// differently.
const PIXELS: f64 = 0.001;

/// A window with a painter.
struct Painted {
    window: Window,
    painter: Painter,
}

fn painted(source: Option<CheckerRoom>, options: ViewerOptions) -> Painted {
    let painter = Painter::default();
    let source = source.map(|room| -> Box<dyn FrameSource> { Box::new(room) });
    let window = open_on(source, options, [900.0, 680.0], painter.clone());
    Painted { window, painter }
}

fn paint_room(kind: Kind, options: ViewerOptions) -> Painted {
    let mut painted = painted(Some(CheckerRoom::new(kind)), options);
    wait(&mut painted.window, "the first frame", |viewer| {
        viewer.shown.is_some()
    });
    settle(&mut painted.window);
    painted
}

/// Replaces the measured times, which differ from run to run, by constants.
fn replace_times(viewer: &mut Viewer) {
    let Some(shown) = &mut viewer.shown else {
        return;
    };
    let stages = |frame: usize| {
        let ms = |name, i: usize| Stage {
            name,
            ms: 2.0 + ((frame * (i + 2)) % 7) as f64 * 0.5,
        };
        vec![ms("cast", 1), ms("shade", 2), ms("wait", 3)]
    };
    shown.render_ms = 12.5;
    shown
        .pictures
        .iter_mut()
        .for_each(|picture| picture.report.stages = stages(0));
    viewer.history.clear();
    for i in 0..90 {
        let (stages, shown_s) = (stages(i), i as f64 * 0.02);
        let render_ms = stages.iter().map(|stage| stage.ms).sum::<f64>() + 0.5;
        viewer.history.push(FrameTimes {
            shown_s,
            render_ms,
            latency_ms: render_ms + 1.0,
            stages,
        });
    }
}

impl Painted {
    /// Compares the window with the screenshot `name`.
    fn compare(&mut self, name: &str) {
        replace_times(self.window.state_mut());
        // Columns have the width of the previous pass.
        self.window.run_steps(4);
        let background = crate::panels::theme::BACKDROP;
        let picture = self
            .painter
            .picture(&self.window.ctx, self.window.output(), background);
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/tests/snapshots");
        let (known, new) = (
            folder.join(format!("{name}.png")),
            folder.join(format!("{name}.new.png")),
        );
        if std::env::var_os("UPDATE_SNAPSHOTS").is_some() {
            picture.save(&known).unwrap();
            return;
        }
        let difference = difference(&picture, &known);
        if difference > PIXELS {
            picture.save(&new).unwrap();
            panic!(
                "{}: {:.2} % of the pixels differ from {}",
                new.display(),
                difference * 100.0,
                known.display()
            );
        }
    }
}

/// Share of the pixels that differ.
fn difference(picture: &RgbImage, known: &PathBuf) -> f64 {
    let Ok(known) = image::open(known).map(|known| known.into_rgb8()) else {
        return 1.0;
    };
    if known.dimensions() != picture.dimensions() {
        return 1.0;
    }
    let differs = |(a, b): (&image::Rgb<u8>, &image::Rgb<u8>)| {
        (0..3).any(|i| a.0[i].abs_diff(b.0[i]) > LEVELS)
    };
    let count = picture
        .pixels()
        .zip(known.pixels())
        .filter(|pair| differs(*pair))
        .count();
    count as f64 / f64::from(picture.width() * picture.height())
}

#[test]
fn start_page() {
    let library: Box<dyn Library> = Box::new(Rooms);
    let mut page = painted(
        None,
        ViewerOptions {
            library: Some(library),
            ..ViewerOptions::default()
        },
    );
    wait(&mut page.window, "the thumbnails", |viewer| {
        viewer.start_page.has_all_thumbnails()
    });
    page.compare("start_page");
}

#[test]
fn panels_and_headbox() {
    paint_room(Kind::Headbox, ViewerOptions::default()).compare("headbox");
}

#[test]
fn comparison_in_stereo() {
    let compare = Some(vec![("lamp".into(), "off".into())]);
    let options = ViewerOptions {
        compare,
        stereo: crate::Stereo::CrossEyed,
        ..ViewerOptions::default()
    };
    paint_room(Kind::Headbox, options).compare("compare_stereo");
}

#[test]
fn plan_fact_and_legend() {
    let settings = vec![("overlay".into(), "face".into())];
    paint_room(
        Kind::Walk,
        ViewerOptions {
            settings,
            ..ViewerOptions::default()
        },
    )
    .compare("walk");
}

#[test]
fn keys_and_messages() {
    let mut room = paint_room(
        Kind::Orbit,
        ViewerOptions {
            panels: false,
            ..ViewerOptions::default()
        },
    );
    press(&mut room.window, Key::F1);
    room.window.state_mut().commands.extend([
        Command::TogglePlayback,
        Command::LoadPath("no/such/path.json".into()),
    ]);
    // A list needs a few passes to measure its size and to fade in.
    room.window.run_steps(30);
    room.compare("keys_messages");
}

#[test]
fn tiny_window_is_laid_out() {
    let mut room = paint_room(Kind::Headbox, ViewerOptions::default());
    for size in [
        [1.0, 1.0],
        [40.0, 30.0],
        [320.0, 20.0],
        [20.0, 400.0],
        [900.0, 680.0],
    ] {
        room.window.set_size(size.into());
        settle(&mut room.window);
        let [width, height] = size_px(&room.window);
        assert!(
            width >= 1 && height >= 1 && width <= 900 && height <= 680,
            "{width}x{height} px"
        );
    }
    // The panel keeps its last width.
    assert!(
        size_px(&room.window)[0] > 500,
        "the frame has its place again"
    );
}

/// 480 points suffice for the frame with its inset, and for the panel over it.
#[test]
fn narrow_window() {
    let mut room = paint_room(Kind::Headbox, ViewerOptions::default());
    room.window.set_size([480.0, 360.0].into());
    settle(&mut room.window);
    room.compare("narrow");
    click(&mut room.window, "Panel");
    room.compare("narrow_unfolded");
}
