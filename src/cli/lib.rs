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

/// `eprintln!` with control characters escaped.
macro_rules! eprintln {
    ($($text:tt)*) => { $crate::output::print_error_text(format_args!("{}\n", format_args!($($text)*))) };
}

/// Returns a [`UsageError`] with a formatted message.
macro_rules! bail_usage {
    ($($text:tt)*) => { return Err($crate::messages::UsageError(format!($($text)*)).into()) };
}

mod allocator;
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
use headbox_core::{files, memory, panics, simd};
use messages::UsageError;
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

/// Image-based rendering with depth: capture a scene once, then view it from anywhere inside a
/// headbox.
#[derive(Parser)]
#[command(name = "headbox", version, arg_required_else_help = true)]
struct Cli {
    /// Number of threads, at most eight for each core; one for each core by default
    #[arg(long, global = true, value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    /// Memory limit, MiB: input files and captures that need more are refused, and samples of
    /// captures are spilled to a temporary file next to the output. By default files may need half
    /// of the free memory, and captures all
    #[arg(long, global = true, value_name = "MIB", value_parser = clap::value_parser!(u64).range(64..=1 << 24))]
    memory: Option<u64>,
    /// Read files that an input names by absolute paths, `..` or symbolic links even if they are
    /// neither below the input's folder nor below the folder above it
    #[arg(long, global = true)]
    allow_outside: bool,
    /// Folder in which files that an input names (textures, material files, images) are searched,
    /// too; repeatable
    #[arg(long, global = true, value_name = "FOLDER")]
    search: Vec<PathBuf>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Run the whole pipeline on a built-in scene: capture, render, compare with ray-traced truth
    Demo(commands::demo::DemoCommand),
    /// List the built-in scenes, or write one as .obj or .glb
    Scenes(commands::scenes::ScenesCommand),
    /// Capture a scene, a folder of images or a deep EXR as a cube LDI; or one shard of a scene
    Capture(commands::capture::CaptureCommand),
    /// Merge all shards of a capture into a cube LDI
    Merge(commands::merge::MergeCommand),
    /// Make sprites with depth from a scene, a sequence of photographs, or an image and its depth
    Sprite(Box<commands::sprite::SpriteCommand>),
    /// Make a layered lumigraph from a scene or from images of a camera grid: images on a camera
    /// plane, drawn with only as many layers as a view needs
    Lumigraph(Box<commands::lumigraph::LumigraphCommand>),
    /// Read a home of rooms and doors: report errors in it, draw its floor plan, write a .house
    /// file to walk through
    House(commands::house::HouseCommand),
    /// Describe a folder of images and check that poses and depths agree; estimate poses and depth
    /// of photographs
    Images(commands::images::ImagesCommand),
    /// Describe the content of a file; verify its layout
    Info(commands::info::InfoCommand),
    /// Render a frame, a frame per pose of a path, or a film: from a cube LDI, sprites, both
    /// composed, a lumigraph, a house or images
    Render(commands::render::RenderCommand),
    /// Export a capture for other programs: HTML page, glTF, PLY, deep or layered EXR
    Export(commands::export::ExportCommand),
    /// Measure time and error of every variant along a walk through a .house file, against
    /// ray-traced truth and primary rays; to walk interactively, use view
    Walk(commands::walk::WalkCommand),
    /// Ray-trace a reference frame of a scene, or of the scene, light, exposure and camera of an
    /// .ldi file
    Truth(commands::truth::TruthCommand),
    /// Compare two images: FLIP, PSNR, SSIM
    Compare(commands::compare::CompareCommand),
    /// Measure speed against error: tables, charts and a summary
    Report(commands::report::ReportCommand),
    /// Open a window to look around in a scene, a cube LDI, sprites, a lumigraph, a house or images
    #[cfg(feature = "viewer")]
    View(commands::view::ViewCommand),
    /// Print a script that completes commands in a shell
    Completions(help::Completions),
    /// Print the manual as roff: headbox man | man -l -
    Man,
}

/// Runs the command line of this process and returns its exit code: 0 for success, 1 for failure,
/// 2 for wrong usage.
pub fn main() -> ExitCode {
    parse(std::env::args_os()).map_or_else(
        |code| code,
        |cli| {
            if cli.memory.is_some() {
                allocator::return_freed_memory();
            }
            finish(cli)
        },
    )
}

/// Runs a command line, the name of the program first, and returns its exit code. Wrong usage ends
/// the process.
pub fn run_command(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    parse(arguments).map_or_else(|code| code, finish)
}

/// Parses a command line, or prints its help and returns the exit code. Wrong usage ends the
/// process.
fn parse(arguments: impl IntoIterator<Item = OsString>) -> Result<Cli, ExitCode> {
    let parsed = command_line().try_get_matches_from(help::arguments(arguments));
    match parsed.and_then(|matches| Cli::from_arg_matches(&matches)) {
        Ok(cli) => Ok(cli),
        Err(error) if error.use_stderr() => error.exit(),
        Err(help) => Err(match output::check_stdout().and_then(|()| help.print()) {
            Ok(()) => output::flush(),
            Err(error) => output::report_failure(&error),
        }),
    }
}

/// Runs a command to its end, reports its error, and returns the exit code.
fn finish(cli: Cli) -> ExitCode {
    match run(cli) {
        Ok(()) if interrupt::is_requested() => ExitCode::from(interrupt::EXIT_CODE),
        Ok(()) => output::flush(),
        Err(error) => {
            eprintln!("error: {}", messages::one_line(&error));
            ExitCode::from(if error.is::<UsageError>() { 2 } else { 1 })
        }
    }
}

/// Refuses numbers of threads that only cost memory: each has its stack and its buffers.
fn check_threads(threads: u16) -> anyhow::Result<()> {
    const MOST_PER_CORE: usize = 8;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let most = MOST_PER_CORE * cores;
    if usize::from(threads) > most {
        bail_usage!(
            "--threads {threads}: more than {MOST_PER_CORE} for each of {cores} cores would only \
             take memory; give 1 to {most}"
        );
    }
    Ok(())
}

/// Sets the rule for files that inputs name.
fn set_permissions(allow_outside: bool, search: Vec<PathBuf>) -> anyhow::Result<()> {
    if let Some(missing) = search.iter().find(|folder| !folder.is_dir()) {
        bail_usage!("--search {}: there is no such folder", missing.display());
    }
    files::set_permissions(allow_outside, search);
    Ok(())
}

/// Prints no panic that becomes the error of a file.
fn hide_caught_panics() {
    let default = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        if !panics::is_caught() {
            default(panic);
        }
    }));
}

/// Builds the command line with its examples.
fn command_line() -> clap::Command {
    help::with_examples(Cli::command())
}

fn run(cli: Cli) -> anyhow::Result<()> {
    interrupt::handle()?;
    hide_caught_panics();
    simd::requested().map_err(|error| UsageError(error.to_string()))?;
    if let Some(threads) = cli.threads {
        check_threads(threads)?;
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads.into())
            .build_global()?;
    }
    if let Some(mib) = cli.memory {
        memory::set_limit(mib << 20);
    }
    set_permissions(cli.allow_outside, cli.search)?;
    match cli.command {
        Command::Demo(command) => command.run(),
        Command::Scenes(command) => command.run(),
        Command::Capture(command) => command.run(cli.memory),
        Command::Merge(command) => command.run(cli.memory),
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
