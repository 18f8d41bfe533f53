//! The command line: one file per subcommand. Library code does not depend on it.

/// Replaces the standard library's `println!`, which panics if the reader has closed the pipe, as
/// in `headbox info FILE | head`: this one ends the program, as other programs do.
macro_rules! println {
    ($($text:tt)*) => { $crate::output::print_text(format_args!("{}\n", format_args!($($text)*))) };
}

/// `print!` through the same function as `println!` above.
macro_rules! print {
    ($($text:tt)*) => { $crate::output::print_text(format_args!($($text)*)) };
}

/// Returns a [`UsageError`] with a formatted message.
macro_rules! bail_usage {
    ($($text:tt)*) => { return Err($crate::messages::UsageError(format!($($text)*)).into()) };
}

mod args;
mod commands;
mod help;
mod image_set;
mod interrupt;
mod messages;
mod output;
mod packing;
mod progress;
mod setting_flags;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use headbox_core::simd;
use messages::UsageError;
use std::ffi::OsString;
use std::process::ExitCode;

/// Image-based rendering with depth: capture a scene once, look at it from anywhere inside a
/// headbox.
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
    Demo(commands::demo::DemoCommand),
    /// List the built-in scenes, or write one as .obj or .glb
    Scenes(commands::scenes::ScenesCommand),
    /// Capture a scene into a cube LDI (or one shard of it)
    Capture(commands::capture::CaptureCommand),
    /// Merge all shards of a capture into a cube LDI
    Merge(commands::merge::MergeCommand),
    /// Make sprites with depth of a scene, of a sequence of photographs, or of a picture and its
    /// depth
    Sprite(Box<commands::sprite::SpriteCommand>),
    /// Make a lumigraph of a scene, or of pictures from a grid of places: images on a camera plane,
    /// as few layers as a view needs
    Lumigraph(Box<commands::lumigraph::LumigraphCommand>),
    /// A home to walk through: read its rooms and doors, say what is wrong with them, draw its
    /// plan, write a .house file
    House(commands::house::HouseCommand),
    /// What a folder of pictures holds, and whether its poses and depths agree; where photographs
    /// were taken, and their depth
    Images(commands::images::ImagesCommand),
    /// Show what a file holds; check every promise of its layout
    Info(commands::info::InfoCommand),
    /// Render a frame of a cube LDI, of sprites or of both, or a frame per pose of a path
    Render(commands::render::RenderCommand),
    /// Take a capture to where headbox is not installed: a page to look around in, engines, splat
    /// viewers
    Export(commands::export::ExportCommand),
    /// Measure a walk through a .house file (to just walk, use view): time and error of every way
    /// to draw it, against truth and primary rays
    Walk(commands::walk::WalkCommand),
    /// Ray-trace a reference frame of a scene, or of the scene, light, exposure and camera of an
    /// .ldi file
    Truth(commands::truth::TruthCommand),
    /// Compare two images: FLIP, PSNR, SSIM
    Compare(commands::compare::CompareCommand),
    /// Measure speed against error: rows, charts, sentences
    Report(commands::report::ReportCommand),
    /// Look around in a window: in a scene, a cube LDI, sprites or a house
    #[cfg(feature = "viewer")]
    View(commands::view::ViewCommand),
    /// Print a script by which a shell completes commands
    Completions(help::Completions),
    /// Print the manual, as roff: headbox man | man -l -
    Man,
}

/// Runs the command line of this process and returns its exit code: 0 for success, 1 for failure,
/// 2 for wrong usage.
pub fn main() -> ExitCode {
    run_command(std::env::args_os())
}

/// Runs a command line, the name of the program first, and returns its exit code. Wrong usage ends
/// the process.
pub fn run_command(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let parsed = command_line().try_get_matches_from(help::arguments(arguments));
    let cli = parsed
        .and_then(|matches| Cli::from_arg_matches(&matches))
        .unwrap_or_else(|error| error.exit());
    match run(cli) {
        Ok(()) if interrupt::is_requested() => ExitCode::from(interrupt::EXIT_CODE),
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", messages::one_line(&error));
            ExitCode::from(if error.is::<UsageError>() { 2 } else { 1 })
        }
    }
}

/// Builds the command line with its examples.
fn command_line() -> clap::Command {
    help::with_examples(Cli::command())
}

fn run(cli: Cli) -> anyhow::Result<()> {
    interrupt::handle()?;
    simd::requested().map_err(|error| UsageError(error.to_string()))?;
    if let Some(threads) = cli.threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads.into())
            .build_global()?;
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
        Command::Completions(command) => command.run(command_line()),
        Command::Man => help::print_manual(&command_line()),
    }
}
