//! Films: encodes frames to MP4 or WebM with an installed ffmpeg, or to an animated PNG or GIF.

pub mod panorama;
mod spherical;
pub mod stereo;

use crate::film::spherical::Spherical;
use crate::film::stereo::View;
use headbox_core::files::write_whole;
use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, RgbImage};
use std::io::{self, Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use tempfile::NamedTempFile;

/// Frames, rendered on demand.
type Frames<'a> = &'a mut dyn Iterator<Item = io::Result<RgbImage>>;

/// Returns true if the file's extension is that of a film.
pub fn is_film(path: &Path) -> bool {
    ENDINGS.iter().any(|ending| has_extension(path, ending))
}

/// File extensions of films.
pub const ENDINGS: [&str; 4] = ["mp4", "webm", "apng", "gif"];

fn has_extension(path: &Path, wanted: &str) -> bool {
    path.extension()
        .is_some_and(|ending| ending.eq_ignore_ascii_case(wanted))
}

/// Writes a film of `count` frames of one size, completely or not at all. `.mp4` and `.webm`
/// contain metadata about the projection of `view`.
///
/// # Errors
/// Errors of rendering a frame, encoding or writing; a message that names ffmpeg if it is missing.
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
        if frame.dimensions() == (width, height) {
            Ok(frame)
        } else {
            Err(io::Error::other("the poses of a film must have one --size"))
        }
    });
    if has_extension(path, "gif") {
        return write_whole(path, |mut to| gif(&mut to, fps, checked));
    }
    if has_extension(path, "apng") {
        return write_whole(path, |mut to| {
            apng(&mut to, [width, height], fps, count, checked)
        });
    }
    let is_webm = has_extension(path, "webm");
    let spherical = Spherical::for_view(view);
    let codec: &[&[&str]] = match is_webm {
        true if spherical.is_some() => &[VP9, &["-f", "mp4"]],
        true => &[VP9, &["-f", "webm"]],
        false => &[H264, &["-movflags", "+faststart", "-f", "mp4"]],
    };
    let mut film = encode([width, height], fps, &codec.concat(), checked)?;
    if let Some(spherical) = spherical {
        let tagged = spherical.add_metadata(std::fs::read(film.path())?)?;
        film = NamedTempFile::new()?;
        film.write_all(&tagged)?;
        if is_webm {
            film = remux_to_webm(&film)?;
        }
    }
    write_whole(path, |mut to| {
        io::copy(&mut film.reopen()?, &mut to).map(drop)
    })
}

/// H.264 settings for browsers and phones; all of them support `yuv420p` and even sides.
const H264: &[&str] = &["-c:v", "libx264", "-crf", "18", "-preset", "medium"];
const VP9: &[&str] = &[
    "-c:v",
    "libvpx-vp9",
    "-crf",
    "28",
    "-b:v",
    "0",
    "-row-mt",
    "1",
];

/// Starts ffmpeg with some arguments, with `film` as output; it only reports errors.
fn ffmpeg(arguments: &[&str], film: &NamedTempFile) -> io::Result<Child> {
    let started = Command::new("ffmpeg")
        .args(["-loglevel", "error", "-y"])
        .args(arguments)
        .arg(film.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn();
    started.map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => io::Error::other(
            "ffmpeg is not installed, which encodes .mp4 and .webm; install it, or write .apng or .gif",
        ),
        _ => error,
    })
}

/// Waits for ffmpeg. If it fails, the error is its own message, else the result of feeding it.
fn wait_for(mut ffmpeg: Child, fed: io::Result<()>) -> io::Result<()> {
    let mut messages = String::new();
    if let Some(mut stderr) = ffmpeg.stderr.take() {
        stderr.read_to_string(&mut messages)?;
    }
    if ffmpeg.wait()?.success() {
        fed
    } else {
        // ffmpeg's message says more than a broken pipe.
        Err(io::Error::other(format!(
            "ffmpeg failed: {}",
            messages.trim()
        )))
    }
}

/// Converts a film from MP4 to WebM. ffmpeg only writes `Projection` and `StereoMode` if it read
/// them from a file.
fn remux_to_webm(film: &NamedTempFile) -> io::Result<NamedTempFile> {
    let webm = NamedTempFile::new()?;
    let from = film.path().to_string_lossy();
    wait_for(
        ffmpeg(
            &["-f", "mp4", "-i", &from, "-c", "copy", "-f", "webm"],
            &webm,
        )?,
        Ok(()),
    )?;
    Ok(webm)
}

/// Encodes frames with ffmpeg to a temporary file.
fn encode(
    [width, height]: [u32; 2],
    fps: u32,
    codec: &[&str],
    frames: Frames,
) -> io::Result<NamedTempFile> {
    let film = NamedTempFile::new()?;
    let (size, rate) = (format!("{width}x{height}"), fps.to_string());
    let raw = [
        "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", &size, "-r", &rate, "-i", "-",
    ];
    let even = [
        "-vf",
        "pad=ceil(iw/2)*2:ceil(ih/2)*2",
        "-pix_fmt",
        "yuv420p",
    ];
    let mut ffmpeg = ffmpeg(&[&raw, even.as_slice(), codec].concat(), &film)?;
    let fed = feed(&mut ffmpeg, frames);
    wait_for(ffmpeg, fed)?;
    Ok(film)
}

fn feed(ffmpeg: &mut Child, frames: Frames) -> io::Result<()> {
    let Some(mut pipe) = ffmpeg.stdin.take() else {
        return Err(io::Error::other("ffmpeg takes no input"));
    };
    for frame in frames {
        pipe.write_all(frame?.as_raw())?;
    }
    Ok(())
}

fn gif(to: &mut dyn Write, fps: u32, frames: Frames) -> io::Result<()> {
    /// Speed of the colour quantisation: 1 is the slowest and best, 30 the fastest.
    const SPEED: i32 = 10;
    let mut encoder = GifEncoder::new_with_speed(to, SPEED);
    encoder
        .set_repeat(Repeat::Infinite)
        .map_err(io::Error::other)?;
    let mut next = 0;
    for (frame, number) in frames.zip(0u32..) {
        let frame = frame?;
        if number < next {
            continue;
        }
        let hundredths;
        (next, hundredths) = gif_delay(number, fps);
        let rgba = image::DynamicImage::ImageRgb8(frame).into_rgba8();
        let frame =
            image::Frame::from_parts(rgba, 0, 0, Delay::from_numer_denom_ms(10 * hundredths, 1));
        encoder.encode_frame(frame).map_err(io::Error::other)?;
    }
    Ok(())
}

/// Returns the frame that follows frame `number` in a GIF, and the delay to it in hundredths of a
/// second. A GIF counts in hundredths, and players replace a delay of one by ten: frames that would
/// follow sooner are dropped.
fn gif_delay(number: u32, fps: u32) -> (u32, u32) {
    const LEAST: u64 = 2;
    let (fps, number) = (u64::from(fps.max(1)), u64::from(number));
    let start = |number: u64| (200 * number + fps) / (2 * fps);
    let mut next = number + 1;
    while start(next) < start(number) + LEAST {
        next += 1;
    }
    (next as u32, (start(next) - start(number)) as u32)
}

fn apng(
    to: &mut dyn Write,
    [width, height]: [u32; 2],
    fps: u32,
    count: u32,
    frames: Frames,
) -> io::Result<()> {
    let mut encoder = png::Encoder::new(to, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_animated(count, 0).map_err(io::Error::other)?;
    encoder
        .set_frame_delay(1, u16::try_from(fps).unwrap_or(u16::MAX))
        .map_err(io::Error::other)?;
    let mut writer = encoder.write_header().map_err(io::Error::other)?;
    for frame in frames {
        writer
            .write_image_data(frame?.as_raw())
            .map_err(io::Error::other)?;
    }
    writer.finish().map_err(io::Error::other)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gif_keeps_time() {
        for fps in [1, 7, 24, 30, 50, 60, 240] {
            let (mut number, mut hundredths, mut shown) = (0, 0, 0u32);
            while number < fps {
                let (next, delay) = gif_delay(number, fps);
                assert!(delay >= 2, "{fps}: {delay}");
                (number, hundredths, shown) = (next, hundredths + delay, shown + 1);
            }
            assert!(
                hundredths.abs_diff(100) <= 2,
                "{fps}: {hundredths} hundredths of a second"
            );
            // Of 60 a second every third is left out. The last may end after the second.
            let expected: u32 = if fps == 60 { 40 } else { fps.min(50) };
            assert!(shown.abs_diff(expected) <= 1, "{fps}: {shown}");
        }
    }

    fn frames(size: [u32; 2]) -> impl Iterator<Item = io::Result<RgbImage>> {
        (0..3u8).map(move |i| {
            Ok(RgbImage::from_pixel(
                size[0],
                size[1],
                image::Rgb([80 * i, 10, 200]),
            ))
        })
    }

    #[test]
    fn animated_pictures_keep_all_frames() {
        let folder = tempfile::tempdir().unwrap();
        let [gif, apng] = ["a.gif", "a.apng"].map(|name| folder.path().join(name));
        for path in [&gif, &apng] {
            write(path, [5, 4], 10, 3, View::Frame, &mut frames([5, 4])).unwrap();
        }
        let bytes = std::fs::read(&apng).unwrap();
        let reader = png::Decoder::new(io::Cursor::new(&bytes))
            .read_info()
            .unwrap();
        assert_eq!(
            reader
                .info()
                .animation_control()
                .map(|control| control.num_frames),
            Some(3)
        );
        use image::AnimationDecoder;
        let decoder =
            image::codecs::gif::GifDecoder::new(io::Cursor::new(std::fs::read(&gif).unwrap()))
                .unwrap();
        assert_eq!(decoder.into_frames().count(), 3);
    }

    #[test]
    fn frames_of_another_size_leave_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gif");
        let error = write(&path, [6, 4], 10, 3, View::Frame, &mut frames([5, 4])).unwrap_err();
        assert!(error.to_string().contains("one --size") && !path.exists());
    }

    /// Parsed by Matroska's own element numbers: the projection, and the half for each eye.
    #[test]
    fn webm_films_declare_projection() {
        let folder = tempfile::tempdir().unwrap();
        for (view, size, stereo, beside) in [
            (View::Panorama, [64, 32], None, 0u32),
            (View::StereoPanorama(0.06), [64, 64], Some(3), 0),
            (View::HalfSpheres(0.06), [64, 32], Some(1), 1 << 30),
            (View::Frame, [64, 32], None, 0),
        ] {
            let path = folder.path().join("a.webm");
            match write(&path, size, 10, 3, view, &mut frames(size)) {
                Err(error) if error.to_string().contains("ffmpeg is not installed") => {
                    return println!("skipped: {error}");
                }
                written => written.unwrap(),
            }
            let film = std::fs::read(&path).unwrap();
            assert!(film.starts_with(&[0x1a, 0x45, 0xdf, 0xa3]));
            let find = |bytes: &[u8]| film.windows(bytes.len()).position(|found| found == bytes);
            // Elements ProjectionType (1: equirectangular), ProjectionPrivate (the box `equi`
            // without its head), StereoMode (1: side by side, 3: one above the other, the left eye
            // first).
            let private: Vec<u8> = [0, 0, 0, beside, beside]
                .into_iter()
                .flat_map(u32::to_be_bytes)
                .collect();
            let projection = find(&[&[0x76, 0x72, 0x94], private.as_slice()].concat());
            assert_eq!(
                find(&[0x76, 0x71, 0x81, 1]).is_some(),
                view != View::Frame,
                "{view:?}"
            );
            assert_eq!(projection.is_some(), view != View::Frame, "{view:?}");
            let modes = [1, 3].map(|mode| find(&[0x53, 0xb8, 0x81, mode]).is_some());
            assert_eq!(modes, [stereo == Some(1), stereo == Some(3)], "{view:?}");
        }
    }
}
