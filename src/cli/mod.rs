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
mod compare;
mod demo;
mod demo_sprites;
mod house;
mod house_file;
mod info;
mod merge;
mod output;
mod progress;
mod render;
mod report;
mod scenes;
mod sprite;
mod truth;
#[cfg(feature = "viewer")]
mod view;
mod walk;

use crate::capture::simd;
use clap::{Parser, Subcommand};
use std::process::ExitCode;

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
    Demo(demo::Demo),
    /// List the built-in scenes
    Scenes,
    /// Capture a scene into a cube LDI (or one shard of it)
    Capture(capture::Capture),
    /// Merge all shards of a capture into a cube LDI
    Merge(merge::Merge),
    /// Make sprites with depth of a scene, or of a picture and its depth
    Sprite(Box<sprite::SpriteCommand>),
    /// Cells and portals of a house: what it has, what is wrong with it, its plan
    House(house::House),
    /// Show what a file holds; check every promise of its layout
    Info(info::Info),
    /// Render a frame of a cube LDI, of sprites or of both, or a frame per pose of a path
    Render(render::Render),
    /// Measure a walk through a house: time and error of every way to draw it, against truth and primary rays
    Walk(walk::Walk),
    /// Ray-trace a reference frame of a scene
    Truth(truth::Truth),
    /// Compare two images: FLIP, PSNR, SSIM
    Compare(compare::Compare),
    /// Measure speed against error: rows, charts, sentences
    Report(report::ReportCommand),
    /// Look around in a cube LDI, in a window
    #[cfg(feature = "viewer")]
    View(view::View),
}

/// A mistake in what the user asked for, as opposed to a failure in doing it: exit code 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct UsageError(String);

/// Runs the command line and returns its exit code: 0 done, 1 failed, 2 wrong usage.
pub fn main() -> ExitCode {
    match run(Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(if error.is::<UsageError>() { 2 } else { 1 })
        }
    }
}

fn run(cli: Cli) -> anyhow::Result<()> {
    crate::files::clean_up_on_interrupt()?;
    simd::requested().map_err(|error| UsageError(error.to_string()))?;
    if let Some(threads) = cli.threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global()?;
    }
    match cli.command {
        Command::Demo(command) => command.run(),
        Command::Scenes => scenes::run(),
        Command::Capture(command) => command.run(),
        Command::Merge(command) => command.run(),
        Command::Sprite(command) => command.run(),
        Command::House(command) => command.run(),
        Command::Info(command) => command.run(),
        Command::Render(command) => command.run(),
        Command::Walk(command) => command.run(),
        Command::Truth(command) => command.run(),
        Command::Compare(command) => command.run(),
        Command::Report(command) => command.run(),
        #[cfg(feature = "viewer")]
        Command::View(command) => command.run(),
    }
}
