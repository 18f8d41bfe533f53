//! Films: frames one after the other to MP4 or WebM through ffmpeg, where it is installed, or to an animated PNG or GIF.

use super::spherical;
use super::stereo::View;
use crate::capture::files::write_whole;
use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, RgbImage};
use std::io::{self, Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use tempfile::NamedTempFile;

/// Frames as they are made.
type Frames<'a> = &'a mut dyn Iterator<Item = io::Result<RgbImage>>;

/// Whether the ending of a file is that of a film.
pub fn is_film(path: &Path) -> bool {
    ENDINGS.iter().any(|ending| has_ending(path, ending))
}

/// All endings of films.
pub const ENDINGS: [&str; 4] = ["mp4", "webm", "apng", "gif"];

fn has_ending(path: &Path, wanted: &str) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(wanted))
}

/// Writes a film of `count` frames of one size, whole or not at all. An `.mp4` says what of its surroundings a `view` shows.
///
/// # Errors
/// What making a frame, encoding or writing reports; a sentence that names ffmpeg where it is missing.
pub fn write(
    path: &Path,
    [width, height]: [u32; 2],
    fps: u32,
    count: u32,
    view: View,
    frames: Frames,
) -> io::Result<()> {
    let checked = &mut frames.map(|frame| {
        let frame = frame?;
        match frame.dimensions() == (width, height) {
            true => Ok(frame),
            false => Err(io::Error::other("the poses of a film must have one --size")),
        }
    });
    if has_ending(path, "gif") {
        return write_whole(path, |mut to| gif(&mut to, fps, checked));
    }
    if has_ending(path, "apng") {
        return write_whole(path, |mut to| apng(&mut to, [width, height], fps, count, checked));
    }
    if has_ending(path, "webm") {
        let film = encode([width, height], fps, WEBM, checked)?;
        return write_whole(path, |mut to| io::copy(&mut film.reopen()?, &mut to).map(drop));
    }
    let film = encode([width, height], fps, MP4, checked)?;
    let tagged = spherical::tagged(std::fs::read(film.path())?, view)?;
    write_whole(path, |to| to.write_all(&tagged))
}

/// Browsers and phones play this; `yuv420p` and even sides are what they all can.
const MP4: &[&str] = &["-c:v", "libx264", "-crf", "18", "-preset", "medium", "-movflags", "+faststart", "-f", "mp4"];
const WEBM: &[&str] = &["-c:v", "libvpx-vp9", "-crf", "28", "-b:v", "0", "-row-mt", "1", "-f", "webm"];

/// The file that ffmpeg makes.
fn encode([width, height]: [u32; 2], fps: u32, codec: &[&str], frames: Frames) -> io::Result<NamedTempFile> {
    let film = NamedTempFile::new()?;
    let started = Command::new("ffmpeg")
        .args(["-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"])
        .args(["-s", &format!("{width}x{height}"), "-r", &fps.to_string(), "-i", "-"])
        .args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p"])
        .args(codec)
        .arg(film.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn();
    let mut ffmpeg = started.map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => io::Error::other(
            "ffmpeg is not installed, which encodes .mp4 and .webm; install it, or write .apng or .gif",
        ),
        _ => error,
    })?;
    let fed = feed(&mut ffmpeg, frames);
    let mut words = String::new();
    ffmpeg.stderr.take().map(|mut stderr| stderr.read_to_string(&mut words)).transpose()?;
    let status = ffmpeg.wait()?;
    match (status.success(), fed) {
        (true, fed) => fed?,
        // A pipe that broke says less than who broke it.
        (false, _) => return Err(io::Error::other(format!("ffmpeg failed: {}", words.trim()))),
    }
    Ok(film)
}

fn feed(ffmpeg: &mut Child, frames: Frames) -> io::Result<()> {
    let Some(mut pipe) = ffmpeg.stdin.take() else { return Err(io::Error::other("ffmpeg takes no input")) };
    for frame in frames {
        pipe.write_all(frame?.as_raw())?;
    }
    Ok(())
}

fn gif(to: &mut dyn Write, fps: u32, frames: Frames) -> io::Result<()> {
    /// 1 is the slowest and best, 30 the fastest.
    const SPEED: i32 = 10;
    let mut encoder = GifEncoder::new_with_speed(to, SPEED);
    encoder.set_repeat(Repeat::Infinite).map_err(io::Error::other)?;
    for frame in frames {
        let rgba = image::DynamicImage::ImageRgb8(frame?).into_rgba8();
        let frame = image::Frame::from_parts(rgba, 0, 0, Delay::from_numer_denom_ms(1000, fps));
        encoder.encode_frame(frame).map_err(io::Error::other)?;
    }
    Ok(())
}

fn apng(to: &mut dyn Write, [width, height]: [u32; 2], fps: u32, count: u32, frames: Frames) -> io::Result<()> {
    let mut encoder = png::Encoder::new(to, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_animated(count, 0).map_err(io::Error::other)?;
    encoder.set_frame_delay(1, u16::try_from(fps).unwrap_or(u16::MAX)).map_err(io::Error::other)?;
    let mut writer = encoder.write_header().map_err(io::Error::other)?;
    for frame in frames {
        writer.write_image_data(frame?.as_raw()).map_err(io::Error::other)?;
    }
    writer.finish().map_err(io::Error::other)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(size: [u32; 2]) -> impl Iterator<Item = io::Result<RgbImage>> {
        (0..3u8).map(move |i| Ok(RgbImage::from_pixel(size[0], size[1], image::Rgb([80 * i, 10, 200]))))
    }

    #[test]
    fn animated_pictures_keep_all_frames() {
        let folder = tempfile::tempdir().unwrap();
        let [gif, apng] = ["a.gif", "a.apng"].map(|name| folder.path().join(name));
        for path in [&gif, &apng] {
            write(path, [5, 4], 10, 3, View::Frame, &mut frames([5, 4])).unwrap();
        }
        let bytes = std::fs::read(&apng).unwrap();
        let reader = png::Decoder::new(io::Cursor::new(&bytes)).read_info().unwrap();
        assert_eq!(reader.info().animation_control().map(|control| control.num_frames), Some(3));
        use image::AnimationDecoder;
        let decoder = image::codecs::gif::GifDecoder::new(io::Cursor::new(std::fs::read(&gif).unwrap())).unwrap();
        assert_eq!(decoder.into_frames().count(), 3);
    }

    #[test]
    fn frames_of_another_size_leave_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gif");
        let error = write(&path, [6, 4], 10, 3, View::Frame, &mut frames([5, 4])).unwrap_err();
        assert!(error.to_string().contains("one --size") && !path.exists());
    }
}
