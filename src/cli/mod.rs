//! The command line: one file per subcommand. Library code knows nothing of it.

/// The standard library's `println` panics where nobody reads any more, as in `headbox info FILE | head`. This one ends
/// the program then, as other programs do.
macro_rules! println {
    ($($text:tt)*) => { $crate::cli::output::print_text(format_args!("{}\n", format_args!($($text)*))) };
}

/// As `println` above.
macro_rules! print {
    ($($text:tt)*) => { $crate::cli::output::print_text(format_args!($($text)*)) };
}

mod args;
mod capture;
mod capture_deep;
mod capture_images;
mod compare;
mod content;
mod demo;
mod demo_sprites;
mod estimate;
mod export;
mod exported;
mod face_size;
mod geometry;
mod help;
mod house;
mod house_file;
mod image_set;
mod images;
mod images_depth;
mod images_report;
mod info;
mod interrupt;
mod lumigraph;
mod lumigraph_images;
mod merge;
mod output;
mod packing;
mod place;
mod polygons;
mod progress;
mod radiance;
mod render;
mod report;
mod scenes;
mod sprite;
mod sprite_sequence;
mod truth;
#[cfg(feature = "viewer")]
mod view;
mod walk;
mod words;

use crate::capture::simd;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use std::process::ExitCode;
use words::UsageError;

/// Image-based rendering with depth: capture a scene once, look at it from anywhere inside a headbox.
#[derive(Parser)]
#[command(name = "headbox", version, arg_required_else_help = true)]
struct Cli {
    /// Threads to use; all cores if absent
    #[arg(long, global = true, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// The main job end to end on a built-in scene: capture, render, compare with truth
    Demo(demo::DemoCommand),
    /// List the built-in scenes, or write one as .obj or .glb
    Scenes(scenes::ScenesCommand),
    /// Capture a scene into a cube LDI (or one shard of it)
    Capture(capture::CaptureCommand),
    /// Merge all shards of a capture into a cube LDI
    Merge(merge::MergeCommand),
    /// Make sprites with depth of a scene, of a sequence of photographs, or of a picture and its depth
    Sprite(Box<sprite::SpriteCommand>),
    /// Make a lumigraph of a scene, or of pictures from a grid of places: images on a camera plane, as few layers as a view needs
    Lumigraph(Box<lumigraph::LumigraphCommand>),
    /// A home to walk through: read its rooms and doors, say what is wrong with them, draw its plan, write a .house file
    House(house::HouseCommand),
    /// What a folder of pictures holds, and whether its poses and depths agree; where photographs were taken, and their depth
    Images(images::ImagesCommand),
    /// Show what a file holds; check every promise of its layout
    Info(info::InfoCommand),
    /// Render a frame of a cube LDI, of sprites or of both, or a frame per pose of a path
    Render(render::RenderCommand),
    /// Take a capture to where headbox is not installed: a page to look around in, engines, splat viewers
    Export(export::ExportCommand),
    /// Measure a walk through a .house file (to just walk, use view): time and error of every way to draw it, against truth and primary rays
    Walk(walk::WalkCommand),
    /// Ray-trace a reference frame of a scene
    Truth(truth::TruthCommand),
    /// Compare two images: FLIP, PSNR, SSIM
    Compare(compare::CompareCommand),
    /// Measure speed against error: rows, charts, sentences
    Report(report::ReportCommand),
    /// Look around in a window: in a scene, a cube LDI, sprites or a house
    #[cfg(feature = "viewer")]
    View(view::ViewCommand),
    /// Print a script by which a shell completes commands
    Completions(help::Completions),
    /// Print the manual, as roff: headbox man | man -l -
    Man,
}

/// Runs the command line and returns its exit code: 0 done, 1 failed, 2 wrong usage.
pub fn main() -> ExitCode {
    let parsed = whole().try_get_matches_from(help::arguments());
    let cli = parsed.and_then(|matches| Cli::from_arg_matches(&matches)).unwrap_or_else(|error| error.exit());
    match run(cli) {
        Ok(()) if interrupt::asked() => ExitCode::from(interrupt::EXIT_CODE),
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", words::sentence(&error));
            ExitCode::from(if error.is::<UsageError>() { 2 } else { 1 })
        }
    }
}

/// The whole command line, with its examples.
fn whole() -> clap::Command {
    help::with_examples(Cli::command())
}

fn run(cli: Cli) -> anyhow::Result<()> {
    interrupt::handle()?;
    simd::requested().map_err(|error| UsageError(error.to_string()))?;
    if let Some(threads) = cli.threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global()?;
    }
    match cli.command {
        Command::Demo(command) => command.run(),
        Command::Scenes(command) => command.run(),
        Command::Capture(command) => command.run(),
        Command::Merge(command) => command.run(),
        Command::Sprite(command) => command.run(),
        Command::Lumigraph(command) => command.run(),
        Command::House(command) => command.run(),
        Command::Images(command) => command.run(),
        Command::Info(command) => command.run(),
        Command::Render(command) => command.run(),
        Command::Export(command) => command.run(),
        Command::Walk(command) => command.run(),
        Command::Truth(command) => command.run(),
        Command::Compare(command) => command.run(),
        Command::Report(command) => command.run(),
        #[cfg(feature = "viewer")]
        Command::View(command) => command.run(),
        Command::Completions(command) => command.run(whole()),
        Command::Man => help::print_manual(&whole()),
    }
}
