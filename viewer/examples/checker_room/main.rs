//! The viewer on a synthetic source. Without options: the start page.
//!
//!     cargo run --release -p headbox-viewer --example checker_room -- room

mod room;

use headbox_viewer::{Exit, Library, ReplayMode, Stereo, ViewerOptions};
use room::Rooms;
use std::process::ExitCode;

const USAGE: &str = "usage: checker_room [room|ball|hall] [--size WxH] [--path FILE] [--every-pose] [--frames N] \
    [--exit-after-path] [--screenshot FILE] [--stereo cross|parallel] [--set ID=VALUE] [--compare ID=VALUE] \
    [--no-panels] [--out DIR]";

fn main() -> ExitCode {
    let mut options = ViewerOptions::default();
    let source = match parse(std::env::args().skip(1), &mut options) {
        Ok(id) => id.map(|id| Rooms.open_entry(&id)).transpose(),
        Err(wrong) => {
            eprintln!("{wrong}\n{USAGE}");
            return ExitCode::from(2);
        }
    };
    options.library = Some(Box::new(Rooms));
    let done =
        source.and_then(|source| headbox_viewer::run(source, options).map_err(|e| e.to_string()));
    match done.and_then(|summary| serde_json::to_string(&summary).map_err(|e| e.to_string())) {
        Ok(summary) => {
            println!("{summary}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Reads the options; returns which room to open at once.
fn parse(
    mut args: impl Iterator<Item = String>,
    options: &mut ViewerOptions,
) -> Result<Option<String>, String> {
    let mut room = None;
    while let Some(arg) = args.next() {
        let mut value = || args.next().ok_or_else(|| format!("{arg} needs a value"));
        match arg.as_str() {
            "--size" => {
                let text = value()?;
                let sides = text
                    .split_once('x')
                    .and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
                options.window_size_points =
                    sides.ok_or_else(|| format!("--size {text}: expected WxH"))?;
            }
            "--path" => options.path = Some(value()?.into()),
            "--every-pose" => options.replay = ReplayMode::EveryPose,
            "--frames" => {
                let text = value()?;
                options.exit = Exit::AfterFrames(
                    text.parse()
                        .map_err(|_| format!("--frames {text}: expected a number"))?,
                );
            }
            "--exit-after-path" => options.exit = Exit::AfterPath,
            "--screenshot" => options.screenshot = Some(value()?.into()),
            "--stereo" => {
                options.stereo = if value()? == "cross" {
                    Stereo::CrossEyed
                } else {
                    Stereo::Parallel
                };
            }
            "--set" => options.settings.push(pair(&value()?)?),
            "--compare" => options
                .compare
                .get_or_insert_default()
                .push(pair(&value()?)?),
            "--no-panels" => options.panels = false,
            "--out" => options.output_dir = value()?.into(),
            _ if arg.starts_with('-') || room.is_some() => return Err(format!("unexpected {arg}")),
            _ => room = Some(arg),
        }
    }
    Ok(room)
}

fn pair(text: &str) -> Result<(String, String), String> {
    let (id, value) = text
        .split_once('=')
        .ok_or_else(|| format!("{text}: expected ID=VALUE"))?;
    Ok((id.into(), value.into()))
}
