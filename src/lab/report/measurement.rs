//! Measurement of contenders: times in turns, and errors against truth.

use super::contender::{Contender, ContenderFrame, Role};
use super::row::{DisplacementError, Row, WorstFrame};
use crate::plan::{Eye, EyeSet, Place};
use crate::stats::{Spread, mean, pooled_psnr_db, psnr_from_mse};
use crate::turns::{least, run_in_turns, time_ms};
use headbox_core::metrics;
use headbox_core::metrics::{Comparison, MetricError, UnbiasedError};
use headbox_core::progress::Progress;
use headbox_core::statistics::median;
use headbox_trace::truth::Truth;
use image::RgbImage;
use rayon::prelude::*;

/// Measurement of one contender.
#[derive(Clone, Debug, Default)]
pub struct Measurement {
    /// Frame times by eye and round, ms; empty for eyes outside the contender's set.
    pub ms: Vec<Vec<f64>>,
    /// Frames by eye; `None` for eyes outside the contender's set and not on the path.
    pub pictures: Vec<Option<ContenderFrame>>,
    /// Mean of [`Draw::depth_pixels`](super::contender::Draw::depth_pixels) over eyes.
    pub depth_pixels_in: f64,
}

/// Time above which a frame is drawn [`SLOW_ROUNDS`] times per eye and without warm-up, ms: its
/// data do not fit into a cache.
const SLOW_MS: f64 = 100.0;
/// Time above which a frame is drawn once per eye, ms.
const SLOWEST_MS: f64 = 1000.0;
/// Rounds of slow frames: three, so that a frame disturbed by other load is not the least.
const SLOW_ROUNDS: u32 = 3;

/// Draws every contender for every eye, in turns ([`crate::turns`]). Each timed frame follows an
/// untimed one that loads its data into the cache, as in use.
pub fn draw_in_turns(
    contenders: &mut [Contender],
    eyes: &[Eye],
    rounds: u32,
    progress: &dyn Progress,
) -> Vec<Measurement> {
    let empty = Measurement {
        ms: vec![Vec::new(); eyes.len()],
        ..Measurement::default()
    };
    let mut measured = vec![empty; contenders.len()];
    let mut slow = vec![false; contenders.len()];
    progress.begin(
        "frames",
        "frames",
        eyes.len() as u64 * contenders.len() as u64 * u64::from(rounds + 1),
    );
    for (number, eye) in eyes.iter().enumerate() {
        let mut rounds_drawn = vec![0; contenders.len()];
        for (contender, measurement) in contenders.iter_mut().zip(&mut measured) {
            let is_drawn = eye.belongs_to(contender.eyes) || eye.place == Place::Path;
            measurement.pictures.push(is_drawn.then(|| {
                let Contender { pool, draw, .. } = contender;
                pool.install(|| {
                    measurement.depth_pixels_in += draw.depth_pixels(&eye.camera) as f64;
                    draw.picture(&eye.camera)
                })
            }));
            progress.advance(1);
        }
        let times = run_in_turns(contenders, rounds, |index, contender| {
            progress.advance(1);
            let drawn = &mut rounds_drawn[index];
            if !eye.belongs_to(contender.eyes) || (slow[index] && *drawn >= SLOW_ROUNDS) {
                return None;
            }
            *drawn += 1;
            let Contender { pool, draw, .. } = contender;
            let ms = pool.install(|| {
                if !slow[index] {
                    draw.draw(&eye.camera);
                }
                time_ms(|| draw.draw(&eye.camera))
            });
            slow[index] |= ms > SLOW_MS;
            if ms > SLOWEST_MS {
                *drawn = SLOW_ROUNDS;
            }
            Some(ms)
        });
        for (measurement, ms) in measured.iter_mut().zip(times) {
            measurement.ms[number] = ms;
        }
    }
    for measurement in &mut measured {
        let frames = measurement.pictures.iter().flatten().count();
        measurement.depth_pixels_in /= frames.max(1) as f64;
    }
    measured
}

/// Comparisons of one contender's frames with truth, by eye.
type EyeComparisons = Vec<Option<Comparison>>;

/// Returns the rows of contenders measured against `truths`, one for each role, by group in the
/// order of first occurrence.
///
/// # Errors
/// [`MetricError`] if a frame and its truth differ in size.
pub fn rows(
    scene: &str,
    contenders: &[Contender],
    measured: &[Measurement],
    eyes: &[Eye],
    truths: &[Truth],
) -> Result<Vec<Row>, MetricError> {
    let compare = |measurement: &Measurement| -> Result<EyeComparisons, MetricError> {
        let pairs = measurement.pictures.iter().zip(truths);
        pairs
            .map(|(frame, truth)| {
                let frame = frame.as_ref();
                frame
                    .map(|frame| metrics::compare(&truth.rgb(), &frame.color))
                    .transpose()
            })
            .collect()
    };
    let comparisons: Vec<EyeComparisons> =
        measured.par_iter().map(compare).collect::<Result<_, _>>()?;
    let mut rows = Vec::new();
    let mut groups: Vec<&str> = Vec::new();
    for role in contenders.iter().flat_map(|c| &c.roles) {
        if !groups.contains(&role.group) {
            groups.push(role.group);
        }
    }
    for group in groups {
        let roles = |index: usize| {
            let roles = &contenders[index].roles;
            roles.iter().filter(|role| role.group == group)
        };
        let members: Vec<usize> = (0..contenders.len())
            .filter(|&index| roles(index).count() > 0)
            .collect();
        // The first member if the group has no baseline.
        let baseline = members
            .iter()
            .find(|&&index| roles(index).any(|role| role.baseline))
            .unwrap_or(&members[0]);
        // One set of eyes for the whole group, so that its rows can be compared.
        let set = members
            .iter()
            .map(|&index| contenders[index].eyes)
            .reduce(|a, b| if a.contains(b) { b } else { a })
            .unwrap_or_default();
        for index in &members {
            for role in roles(*index) {
                let errors = RowErrors {
                    eyes,
                    set,
                    truths,
                    comparisons: &comparisons[*index],
                    measurement: &measured[*index],
                };
                rows.push(Row {
                    baseline: index == baseline,
                    ..errors.row(scene, role, &contenders[*index], &measured[*baseline])?
                });
            }
        }
    }
    Ok(rows)
}

/// Errors of one contender over the eyes of a row.
struct RowErrors<'a> {
    eyes: &'a [Eye],
    set: EyeSet,
    truths: &'a [Truth],
    comparisons: &'a EyeComparisons,
    measurement: &'a Measurement,
}

impl RowErrors<'_> {
    /// Iterates over the indices of the row's eyes and the comparisons there.
    fn row_eyes(&self) -> impl Iterator<Item = (usize, &Comparison)> {
        let belongs = |(i, eye): (usize, &Eye)| eye.belongs_to(self.set).then_some(i);
        self.eyes
            .iter()
            .enumerate()
            .filter_map(belongs)
            .filter_map(|i| Some((i, self.comparisons[i].as_ref()?)))
    }

    fn row(
        &self,
        scene: &str,
        role: &Role,
        contender: &Contender,
        baseline: &Measurement,
    ) -> Result<Row, MetricError> {
        let ms = self
            .row_eyes()
            .flat_map(|(i, _)| self.measurement.ms[i].iter().copied());
        let spread = Spread::from_values(&ms.collect::<Vec<f64>>()).unwrap_or_default();
        let ratios = self
            .row_eyes()
            .filter_map(|(i, _)| Some(least(&self.measurement.ms[i])? / least(&baseline.ms[i])?));
        let worst = self.row_eyes().max_by(|a, b| a.1.flip.total_cmp(&b.1.flip));
        let worst = worst.map(|(eye, c)| WorstFrame {
            eye,
            flip: c.flip,
            psnr_db: c.psnr_db,
        });
        let displacement = self
            .row_eyes()
            .filter_map(|(i, c)| match self.eyes[i].place {
                Place::Line(share) => Some(DisplacementError {
                    share,
                    flip: c.flip,
                    psnr_db: c.psnr_db,
                }),
                _ => None,
            });
        let holes: Option<Vec<f64>> = self
            .row_eyes()
            .map(|(i, _)| {
                self.measurement.pictures[i]
                    .as_ref()?
                    .hole_fraction(&self.truths[i].frame.coverage)
            })
            .collect();
        let to_baseline = self.row_eyes().filter_map(|(i, _)| {
            let [mine, theirs] =
                [self.measurement, baseline].map(|m| m.pictures[i].as_ref().map(|p| &p.color));
            Some(metrics::psnr_db(theirs?, mine?))
        });
        let to_baseline: Vec<f64> = to_baseline.collect::<Result<_, _>>()?;
        Ok(Row {
            scene: scene.into(),
            group: role.group.into(),
            variant: role.variant.clone(),
            baseline: role.baseline,
            traces: contender.traces,
            eyes: self.set,
            threads: contender.pool.current_num_threads(),
            ms_median: spread.median,
            ms_quartiles: spread.quartiles,
            time_ratio: median(ratios).unwrap_or(1.0),
            depth_pixels_in: self.measurement.depth_pixels_in,
            depth_pixels_m_per_s: self.measurement.depth_pixels_in / spread.median.max(1e-9) / 1e3,
            bytes: contender.bytes,
            depth_pixels: contender.depth_pixels,
            capture_s: contender.capture_s,
            rays: contender.rays,
            flip: mean(self.row_eyes().map(|(_, c)| c.flip)),
            psnr_db: pooled_psnr_db(self.row_eyes().map(|(_, c)| c.psnr_db)),
            own_psnr_db: self.own_psnr_db()?,
            ssim: mean(self.row_eyes().map(|(_, c)| c.ssim)),
            hole_fraction: holes.map(mean),
            worst: worst.unwrap_or_default(),
            flicker: self.flicker(),
            psnr_to_baseline_db: pooled_psnr_db(to_baseline),
            displacement: displacement.collect(),
        })
    }

    /// Returns the PSNR of the frames of all eyes without the noise of truth, if that error is
    /// significant.
    fn own_psnr_db(&self) -> Result<Option<f64>, MetricError> {
        /// Smallest significant error, standard errors.
        const SIGNIFICANT: f64 = 5.0;
        let pictures = self
            .row_eyes()
            .filter_map(|(i, _)| Some((i, &self.measurement.pictures[i].as_ref()?.color)));
        let own = |(i, picture): (usize, &RgbImage)| {
            let [first, second] = &self.truths[i].halves();
            metrics::own_error([first, second], picture)
        };
        let errors: Vec<UnbiasedError> = pictures.map(own).collect::<Result<_, _>>()?;
        let mse = mean(errors.iter().map(|error| error.mse));
        let variance: f64 = errors
            .iter()
            .map(|error| error.standard_error.powi(2))
            .sum();
        let standard_error = variance.sqrt() / errors.len() as f64;
        Ok((mse > 0.0 && mse >= SIGNIFICANT * standard_error).then(|| psnr_from_mse(mse)))
    }

    /// Returns the root mean square change of the error (0..=1, signed, per channel) between
    /// neighbouring eyes of the path.
    fn flicker(&self) -> Option<f64> {
        let path: Vec<usize> = (0..self.eyes.len())
            .filter(|&i| self.eyes[i].place == Place::Path)
            .collect();
        let error = |i: usize| -> Option<Vec<f64>> {
            let picture = self.measurement.pictures[i].as_ref()?;
            let truth = self.truths[i].rgb();
            let pairs = picture.color.as_raw().iter().zip(truth.as_raw());
            Some(
                pairs
                    .map(|(a, b)| (f64::from(*a) - f64::from(*b)) / 255.0)
                    .collect(),
            )
        };
        let errors: Vec<Vec<f64>> = path.into_iter().map(error).collect::<Option<_>>()?;
        let change =
            |pair: &[Vec<f64>]| mean(pair[0].iter().zip(&pair[1]).map(|(a, b)| (a - b).powi(2)));
        (errors.len() > 1).then(|| mean(errors.windows(2).map(change)).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{Plan, Quality};
    use crate::report::contender::Draw;
    use glam::DVec3;
    use headbox_core::camera::Camera;
    use headbox_core::frame::{Coverage, Frame};
    use image::Rgb;
    use std::sync::Arc;

    /// Renderer of grey frames.
    struct Grey(u8);

    impl Draw for Grey {
        fn draw(&mut self, _: &Camera) {}

        fn depth_pixels(&mut self, _: &Camera) -> u64 {
            10
        }

        fn picture(&mut self, camera: &Camera) -> ContenderFrame {
            let color = RgbImage::from_pixel(camera.width(), camera.height(), Rgb([self.0; 3]));
            ContenderFrame {
                color,
                origins: Vec::new(),
            }
        }
    }

    fn grey(level: u8, eyes: EyeSet, roles: Vec<Role>) -> Contender {
        let pool = Arc::new(
            rayon::ThreadPoolBuilder::new()
                .num_threads(1)
                .build()
                .expect("a thread"),
        );
        Contender {
            roles,
            eyes,
            traces: false,
            pool,
            bytes: 1,
            depth_pixels: 10,
            capture_s: None,
            rays: None,
            draw: Box::new(Grey(level)),
        }
    }

    #[test]
    fn rows_match_analytic_errors() {
        let quality = Quality {
            frame_px: [12, 9],
            ..Quality::QUICK
        };
        let plan = Plan::new(quality, DVec3::ZERO, 1.0, DVec3::NEG_Z, 5).expect("valid");
        let truth = |(i, _): (usize, &Eye)| Truth {
            radiance: Vec::new(),
            halves: [97 - i as u8 % 2, 103 + i as u8 % 2].map(|level| vec![[level; 3]; 108]),
            frame: Frame {
                width: 12,
                height: 9,
                color: vec![[100, 100, 100, 255]; 108],
                coverage: vec![Coverage::FULL; 108],
                depth_m: Vec::new(),
            },
            standard_error_psnr_db: 60.0,
        };
        let truths: Vec<Truth> = plan.eyes.iter().enumerate().map(truth).collect();
        let mut contenders = [
            grey(
                110,
                EyeSet::All,
                vec![
                    Role::baseline("a", "ten off"),
                    Role::baseline("b", "the same"),
                ],
            ),
            grey(102, EyeSet::All, vec![Role::other("a", "two off")]),
            grey(100, EyeSet::Ahead, vec![Role::other("b", "right")]),
        ];
        let measured = draw_in_turns(
            &mut contenders,
            &plan.eyes,
            3,
            &headbox_core::progress::Silent,
        );
        assert!(
            measured[2].pictures[0].is_none() && measured[2].ms[0].is_empty(),
            "not judged by uniform eyes"
        );
        let rows = rows("s", &contenders, &measured, &plan.eyes, &truths).expect("sizes fit");
        let names: Vec<_> = rows
            .iter()
            .map(|r| (r.group.as_str(), r.variant.as_str(), r.eyes))
            .collect();
        let (all, ahead) = (EyeSet::All, EyeSet::Ahead);
        let expected = [
            ("a", "ten off", all),
            ("a", "two off", all),
            ("b", "the same", ahead),
            ("b", "right", ahead),
        ];
        assert_eq!(names, expected);
        let psnr = |off: f64| 20.0 * (255.0 / off).log10();
        assert!(
            (rows[0].psnr_db - psnr(10.0)).abs() < 1e-9
                && (rows[1].psnr_db - psnr(2.0)).abs() < 1e-9
        );
        assert!((rows[1].psnr_to_baseline_db - psnr(8.0)).abs() < 1e-9);
        // The halves differ from truth by three levels, at every second eye by four.
        let error_eyes = plan
            .eyes
            .iter()
            .enumerate()
            .filter(|(_, eye)| eye.belongs_to(all));
        let products = error_eyes.map(|(i, _)| if i % 2 == 0 { 7.0 * 13.0 } else { 6.0 * 14.0 });
        let own = psnr_from_mse(mean(products) / 255f64.powi(2));
        assert!(
            rows[0]
                .own_psnr_db
                .is_some_and(|db| (db - own).abs() < 1e-9),
            "{:?}",
            rows[0].own_psnr_db
        );
        assert_eq!(
            (rows[1].own_psnr_db, rows[3].own_psnr_db),
            (None, None),
            "less than noise is not told"
        );
        assert!(rows[3].psnr_db.is_infinite() && rows[2].psnr_to_baseline_db.is_infinite());
        assert_eq!(rows[0].displacement.len(), 4);
        assert_eq!((rows[0].flicker, rows[0].hole_fraction), (Some(0.0), None));
        assert_eq!((rows[0].depth_pixels_in, rows[0].time_ratio), (10.0, 1.0));
        assert!(rows[0].baseline && !rows[1].baseline && rows[2].baseline);
    }
}
