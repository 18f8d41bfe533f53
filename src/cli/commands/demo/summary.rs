//! Table, closing sentence and picture of a demo.

use super::Sizes;
use super::measure::Row;
use headbox_core::metrics::Comparison;
use headbox_lab::machine::Machine;
use image::RgbImage;

/// Distance between the panels of the picture, pixels.
const GAP_PX: u32 = 4;

/// Facts of a demo beside its rows.
pub(super) struct Summary {
    triangles: usize,
    sizes: Sizes,
    machine: Machine,
}

impl Summary {
    pub(super) fn new(triangles: usize, sizes: &Sizes) -> Self {
        Self {
            triangles,
            sizes: *sizes,
            machine: Machine::here(),
        }
    }

    /// Table of errors and times, with a legend.
    pub(super) fn table(&self, rows: &[Row]) -> String {
        let Sizes {
            frame: [width, height],
            face_size_px,
            truth_samples,
            ..
        } = self.sizes;
        let mut text = String::from(
            "   eye off      error against truth           time of a frame\n\
             the centre   headbox       cube map      headbox   ray tracer\n",
        );
        for row in rows {
            text += &format!(
                "{:>8.2} m   {}   {}   {:>5.1} ms   {:>6.2} s\n",
                row.distance_m,
                error(&row.frame_error),
                error(&row.map_error),
                row.frame_ms,
                row.truth_s
            );
        }
        let noise_db = rows
            .iter()
            .map(|row| row.truth.standard_error_psnr_db)
            .fold(f64::INFINITY, f64::min);
        text += &format!(
            "error: PSNR (higher is better) and FLIP (0 is equal, 1 is black on white)\n\
             truth: {truth_samples} rays a pixel, frames of {width}x{height}; its own error is {noise_db:.1} dB or better\n\
             cube map: an environment map traced at the centre, the only place where it is right; faces of \
             {face_size_px} px as in the capture\n"
        );
        text
    }

    /// Formats the closing sentence: frame rate and error of the farthest eye, and the time that a
    /// ray tracer needs for that frame.
    pub(super) fn sentence(&self, row: &Row) -> String {
        let Machine {
            processor, threads, ..
        } = &self.machine;
        let samples = self.sizes.truth_samples;
        let noise_db = row.truth.standard_error_psnr_db;
        let as_wrong_s = seconds_for_error(row.truth_s, samples, noise_db, row.frame_error.psnr_db);
        format!(
            "{} triangles, path traced once: {:.0} frames a second on this CPU ({processor}, {threads} threads)\n\
             at {:.1} dB, {:.1} m off the centre; a cube map has {:.1} dB there. A ray tracer needs {:.1} s for\n\
             that frame with {samples} rays a pixel, and {as_wrong_s:.2} s with so few that its noise equals our error.",
            grouped(self.triangles as u64),
            1e3 / row.frame_ms,
            row.frame_error.psnr_db,
            row.distance_m,
            row.map_error.psnr_db,
            row.truth_s,
        )
    }
}

/// Time in which a ray tracer reaches an error, seconds, given the time and the noise (PSNR, dB) of
/// a frame with `samples` rays a pixel: the squared error of noise falls with the number of rays.
/// At least one ray a pixel is traced.
fn seconds_for_error(seconds: f64, samples: u32, noise_db: f64, error_db: f64) -> f64 {
    let share = 10f64.powf((error_db - noise_db) / 10.0);
    seconds * share.max(1.0 / f64::from(samples.max(1)))
}

fn error(comparison: &Comparison) -> String {
    format!("{:>4.1} dB {:.3}", comparison.psnr_db, comparison.flip)
}

/// Formats a count with commas between thousands: `526,288`.
pub(super) fn grouped(count: u64) -> String {
    if count < 1000 {
        return count.to_string();
    }
    format!("{},{:03}", grouped(count / 1000), count % 1000)
}

/// Frame, truth and cube map side by side on white.
pub(super) fn picture(row: &Row) -> RgbImage {
    side_by_side(&[&row.frame, &row.truth.rgb(), &row.map])
}

/// Images side by side on white.
fn side_by_side(images: &[&RgbImage]) -> RgbImage {
    let width = images.iter().map(|image| image.width() + GAP_PX).sum();
    let height = images
        .iter()
        .map(|image| image.height())
        .max()
        .unwrap_or_default();
    let white = image::Rgb([255; 3]);
    let mut sheet = RgbImage::from_pixel(u32::saturating_sub(width, GAP_PX), height, white);
    let mut left = 0;
    for image in images {
        image::imageops::replace(&mut sheet, *image, left, 0);
        left += i64::from(image.width() + GAP_PX);
    }
    sheet
}

/// The rows as comma-separated values.
pub(super) fn csv(rows: &[Row]) -> String {
    let mut text = String::from(
        "distance_m,headbox_psnr_db,headbox_flip,cube_map_psnr_db,cube_map_flip,headbox_ms,truth_s,truth_noise_db\n",
    );
    for row in rows {
        let (ours, map) = (&row.frame_error, &row.map_error);
        text += &format!(
            "{:.4},{},{},{},{},{:.3},{:.3},{}\n",
            row.distance_m,
            ours.psnr_db,
            ours.flip,
            map.psnr_db,
            map.flip,
            row.frame_ms,
            row.truth_s,
            row.truth.standard_error_psnr_db
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_grouped() {
        let cases = [
            (0, "0"),
            (999, "999"),
            (1000, "1,000"),
            (1_020_003, "1,020,003"),
        ];
        for (count, text) in cases {
            assert_eq!(grouped(count), text);
        }
    }

    #[test]
    fn ten_times_the_squared_error_takes_a_tenth_of_the_time() {
        assert!((seconds_for_error(4.0, 16, 36.0, 26.0) - 0.4).abs() < 1e-12);
        // One ray a pixel is the least.
        assert!((seconds_for_error(4.0, 16, 36.0, 6.0) - 0.25).abs() < 1e-12);
    }

    #[test]
    fn panels_stand_side_by_side() {
        let panel = |level| RgbImage::from_pixel(3, 2, image::Rgb([level; 3]));
        let sheet = side_by_side(&[&panel(10), &panel(20)]);
        assert_eq!(sheet.dimensions(), (3 + GAP_PX + 3, 2));
        let row: Vec<u8> = (0..sheet.width())
            .map(|x| sheet.get_pixel(x, 1).0[0])
            .collect();
        assert_eq!(row, [10, 10, 10, 255, 255, 255, 255, 20, 20, 20]);
    }
}
