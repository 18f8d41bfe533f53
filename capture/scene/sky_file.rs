//! Reader of the texels of a sky: `.hdr` of Radiance and `.exr`.

use headbox_core::image::codec;
use headbox_core::image::exr_channels::ExrParts;
use headbox_core::memory;
use std::path::Path;

/// Largest half float.
const LARGEST_HALF: f32 = 65_504.0;

/// Negative radiance below which texels are reported: resampling leaves less.
const NEGATIVE: f32 = -1e-3;

/// Clamps a radiance from a file to 0 and, if infinite, to the largest half float; NaN stays.
pub(super) fn sanitise(channel: f32) -> f32 {
    match channel {
        c if c == f32::INFINITY => LARGEST_HALF,
        c if c < 0.0 => 0.0,
        c => c,
    }
}

/// Returns notes on texels whose light is cut off at the largest half float, and on negative ones.
pub(super) fn describe_cut_light(path: &Path, texels: &[[f32; 3]]) -> Vec<String> {
    let count = |test: fn(f32) -> bool| {
        let has = |texel: &&[f32; 3]| texel.iter().any(|&c| test(c));
        texels.iter().filter(has).count()
    };
    let cut = count(|c| c == LARGEST_HALF || c == f32::INFINITY);
    let infinite = count(|c| c == f32::INFINITY);
    let negative = count(|c| c < NEGATIVE);
    let mut notes = Vec::new();
    if cut > 0 {
        notes.push(format!(
            "{}: {cut} pixels reach 65504, the largest half float ({infinite} of them are infinite): brighter light there, \
             such as a sun, is cut off, so that its light and shadows are too weak; --sun adds a sun",
            path.display()
        ));
    }
    if negative > 0 {
        notes.push(format!(
            "{}: {negative} pixels have negative radiance, which counts as 0",
            path.display()
        ));
    }
    notes
}

type Texels = ([u32; 2], Vec<[f32; 3]>);

/// Reads a Radiance picture, whose header may state factors that its texels were multiplied by.
pub(super) fn read_hdr(path: &Path) -> Result<Texels, String> {
    let mut bytes = memory::read_file(path).map_err(|error| error.to_string())?;
    if let Some(rest) = bytes.strip_prefix(b"#?RGBE") {
        // HDRShop's signature, which the decoder does not know.
        bytes = [b"#?RADIANCE", rest].concat();
    }
    let order = ScanOrder::read(&mut bytes);
    let picture = codec::decode(&bytes, Some(path), codec::MAX_BYTES)
        .map_err(|error| error.to_string())?
        .image
        .into_rgb32f();
    let factors = read_factors(&bytes)?;
    let texel = |pixel: &image::Rgb<f32>| match factors {
        [1.0, 1.0, 1.0] => pixel.0,
        _ => std::array::from_fn(|c| pixel.0[c] / factors[c]),
    };
    Ok(order.upright(
        picture.dimensions().into(),
        picture.pixels().map(texel).collect(),
    ))
}

/// Order of the pixels of a Radiance picture, which its resolution line states: `-Y 512 +X 1024`
/// for rows from the top, each from the left; `+X 1024 -Y 512` for columns from the left, each from
/// the top.
#[derive(Clone, Copy)]
struct ScanOrder {
    /// True if scanlines are columns.
    by_column: bool,
    /// True if the first pixel is at the right.
    from_right: bool,
    /// True if the first pixel is at the bottom.
    from_bottom: bool,
}

impl ScanOrder {
    /// Rows from the top, the only order that the decoder knows.
    const UPRIGHT: Self = Self {
        by_column: false,
        from_right: false,
        from_bottom: false,
    };

    /// Reads the resolution line and replaces it by that of [`Self::UPRIGHT`], with as many
    /// scanlines. A line that is damaged stays, for the decoder to report.
    fn read(bytes: &mut Vec<u8>) -> Self {
        let Some(header) = bytes.windows(2).position(|pair| pair == b"\n\n") else {
            return Self::UPRIGHT;
        };
        let start = header + 2;
        let length = bytes[start..].iter().position(|&byte| byte == b'\n');
        let end = start + length.unwrap_or(bytes.len() - start);
        let line = String::from_utf8_lossy(&bytes[start..end]).into_owned();
        let words: Vec<&str> = line.split_whitespace().collect();
        let &[first, scanlines, second, pixels] = &words[..] else {
            return Self::UPRIGHT;
        };
        let axes = [first, second];
        let by_column = match axes {
            ["-Y" | "+Y", "-X" | "+X"] => false,
            ["-X" | "+X", "-Y" | "+Y"] => true,
            _ => return Self::UPRIGHT,
        };
        let upright = format!("-Y {scanlines} +X {pixels}");
        bytes.splice(start..end, upright.into_bytes());
        Self {
            by_column,
            from_right: axes.contains(&"-X"),
            from_bottom: axes.contains(&"+Y"),
        }
    }

    /// Returns the size and the texels in rows from the top; `[length, count]` are those of the
    /// scanlines in the file.
    fn upright(self, [length, count]: [u32; 2], texels: Vec<[f32; 3]>) -> Texels {
        let [width, height] = if self.by_column {
            [count, length]
        } else {
            [length, count]
        };
        if !(self.by_column || self.from_right || self.from_bottom) {
            return ([width, height], texels);
        }
        let texel = |i: usize| {
            let [x, y] = [i % width as usize, i / width as usize];
            let x = if self.from_right {
                width as usize - 1 - x
            } else {
                x
            };
            let y = if self.from_bottom {
                height as usize - 1 - y
            } else {
                y
            };
            let [scanline, at] = if self.by_column { [x, y] } else { [y, x] };
            texels[scanline * length as usize + at]
        };
        ([width, height], (0..texels.len()).map(texel).collect())
    }
}

/// Returns the product of `EXPOSURE=` and of `COLORCORR=` for each channel of a Radiance header:
/// radiance is the stored value divided by it.
fn read_factors(bytes: &[u8]) -> Result<[f32; 3], String> {
    let mut factors = [1.0f32; 3];
    let lines = bytes.split(|&byte| byte == b'\n');
    let header = lines
        .map(|line| String::from_utf8_lossy(line).trim().to_owned())
        .take_while(|line| !line.is_empty());
    for line in header {
        let Some((key, value)) = line.split_once('=') else {
            continue;
        };
        let key = key.trim();
        if key != "EXPOSURE" && key != "COLORCORR" {
            continue;
        }
        let numbers: Vec<f32> = value
            .split_whitespace()
            .map_while(|it| it.parse().ok())
            .collect();
        let of = match (key, &numbers[..]) {
            ("EXPOSURE", [all]) => [*all; 3],
            ("COLORCORR", [r, g, b]) => [*r, *g, *b],
            _ => [f32::NAN; 3],
        };
        if !of.iter().all(|factor| factor.is_finite() && *factor > 0.0) {
            return Err(format!(
                "the header has \"{line}\", which is not a factor above 0"
            ));
        }
        factors = std::array::from_fn(|c| factors[c] * of[c]);
    }
    Ok(factors)
}

/// Reads the colours of an EXR, also those of a layer ([`ExrParts::color`]).
pub(super) fn read_exr(path: &Path) -> Result<Texels, String> {
    let parts = ExrParts::read(path).map_err(|error| error.to_string())?;
    let Some([Some(r), Some(g), Some(b), _]) = parts.color() else {
        return Err(format!(
            "has no channels R, G and B, nor Y alone; its channels are {}",
            parts.describe()
        ));
    };
    let _memory = parts.reserve(r, 12).map_err(|error| error.to_string())?;
    let [width, height] = parts.size_px(r);
    let stride = width as usize;
    let mut texels = vec![[0f32; 3]; stride * height as usize];
    let decoded = parts.decode(path, &[r, g, b], &mut |channel, [x, y], row| {
        let start = y * stride + x;
        for (texel, value) in texels[start..start + row.len()].iter_mut().zip(row) {
            texel[channel] = *value;
        }
    });
    decoded.map_err(|error| error.to_string())?;
    parts.convert_to_rec709(r, texels.iter_mut());
    Ok(([width, height], texels))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_in_every_scan_order_are_upright() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sky.hdr");
        // The mantissa of red is 128 + 10 (3 y + x) at column x of three, row y of two from the top.
        let texel = |x: u8, y: u8| [128 + 10 * (3 * y + x), 128, 128, 129];
        let mut read_all = Vec::new();
        for [y_axis, x_axis] in ["-Y", "+Y"]
            .into_iter()
            .flat_map(|y| ["+X", "-X"].map(|x| [y, x]))
        {
            let x = |i| if x_axis == "+X" { i } else { 2 - i };
            let y = |i| if y_axis == "-Y" { i } else { 1 - i };
            let rows = (0..2).flat_map(|j| (0..3).flat_map(move |i| texel(x(i), y(j))));
            let columns = (0..3).flat_map(|i| (0..2).flat_map(move |j| texel(x(i), y(j))));
            for (line, pixels) in [
                (format!("{y_axis} 2 {x_axis} 3"), rows.collect::<Vec<u8>>()),
                (format!("{x_axis} 3 {y_axis} 2"), columns.collect()),
            ] {
                let header = format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{line}\n");
                std::fs::write(&path, [header.as_bytes(), &pixels].concat()).unwrap();
                read_all.push((line, read_hdr(&path).unwrap()));
            }
        }
        let (_, upright) = &read_all[0];
        assert_eq!(upright.0, [3, 2]);
        assert!(upright.1.is_sorted_by(|a, b| a[0] < b[0]), "{upright:?}");
        for (line, read) in &read_all {
            assert_eq!(read, upright, "{line}");
        }
    }

    #[test]
    fn signature_of_hdrshop_is_known() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sky.hdr");
        let mut bytes = b"#?RGBE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n".to_vec();
        bytes.extend([128, 128, 128, 129].repeat(2));
        std::fs::write(&path, bytes).unwrap();
        assert_eq!(read_hdr(&path), Ok(([2, 1], vec![[1.0; 3]; 2])));
    }

    #[test]
    fn factors_of_header_are_multiplied() {
        let read = |more: &str| {
            read_factors(
                format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n{more}\n\n-Y 4 +X 8\nEXPOSURE=9\n")
                    .as_bytes(),
            )
        };
        assert_eq!(read(""), Ok([1.0; 3]));
        assert_eq!(read("EXPOSURE= 2.0\nEXPOSURE=4"), Ok([8.0; 3]));
        assert_eq!(read("EXPOSURE=2\nCOLORCORR=1 2 3"), Ok([2.0, 4.0, 6.0]));
        for wrong in ["EXPOSURE=0", "EXPOSURE=x", "EXPOSURE=-1", "COLORCORR=1 2"] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn cut_light_is_noted_with_counts() {
        let path = Path::new("s.exr");
        assert!(describe_cut_light(path, &[[1.0, 65_000.0, -1e-5]]).is_empty());
        let texels = [[65_504.0; 3], [1.0, f32::INFINITY, 1.0], [-0.5, 0.0, 0.0]];
        let notes = describe_cut_light(path, &texels);
        assert!(
            notes[0].contains("s.exr: 2 pixels") && notes[0].contains("(1 of them"),
            "{notes:?}"
        );
        assert!(notes[1].contains("1 pixels have negative"), "{notes:?}");
    }

    #[test]
    fn invalid_radiance_is_sanitised() {
        let found = [-1e-3, 0.0, 0.5, f32::INFINITY, f32::NEG_INFINITY].map(sanitise);
        assert_eq!(found, [0.0, 0.0, 0.5, 65_504.0, 0.0]);
        assert!(sanitise(f32::NAN).is_nan(), "which is an error");
    }
}
