//! Results of a walk as a Markdown page.

use super::WalkReport;
use crate::stats::Spread;
use crate::table::{Table, percent};
use std::fmt::Write;

impl WalkReport {
    /// Formats tables of times and errors, exposure errors, layers and threads.
    pub fn to_markdown(&self) -> String {
        let mut page = String::new();
        // Writing to a string cannot fail.
        let _ = self.write_to(&mut page);
        page
    }

    /// Formats the chapter of the results page: a chart, a table and three sentences.
    pub fn to_chapter(&self) -> String {
        let [width, height] = self.size;
        let mut table = Table::new([
            "drawn as",
            "frame ms",
            "95 %",
            "worst",
            "behind",
            "PSNR dB",
            "worst",
            "behind portals",
            "holes there",
            "KiB",
        ]);
        let only_if = |shown: bool, text: String| if shown { text } else { String::new() };
        for row in &self.rows {
            let has_backdrops = row.portals > 0.0;
            table.row([
                row.name.clone(),
                format!("{:.2}", row.frame_ms.median),
                format!("{:.2}", row.frame_ms.p95),
                format!("{:.2}", row.frame_ms.worst),
                only_if(has_backdrops, format!("{:.1}x", row.behind_speedup)),
                format!("{:.2}", row.psnr_db),
                format!("{:.2}", row.least_psnr_db),
                format!("{:.2}", row.behind_psnr_db),
                only_if(has_backdrops, percent(row.hole_share)),
                only_if(row.captures > 0, format!("{:.0}", row.bytes / 1024.0)),
            ]);
        }
        let mut chapter = format!(
            "## Walk through {}\n\n![frame time along the path](results/along-path.svg)\n\n{table}\n\
             {} cells, {} portals, {} triangles, {} poses of {width}x{height} px, {} of them compared with truth; {} threads of {} \
             ({}), commit {}.\n\
             *behind*: time of culled geometry for what the backdrops show, over theirs; primary rays take {:.2} ms (95 %: {:.2}, \
             worst: {:.2}).\n",
            self.scene,
            self.cells,
            self.portals,
            self.triangles,
            self.poses,
            self.truth_poses,
            self.threads,
            self.machine.processor,
            self.machine.simd,
            self.commit,
            self.primary_rays_ms.median,
            self.primary_rays_ms.p95,
            self.primary_rays_ms.worst,
        );
        let backdrops = self.rows.iter().filter(|row| row.portals > 0.0);
        if let Some(best) = backdrops.max_by(|a, b| a.behind_psnr_db.total_cmp(&b.behind_psnr_db)) {
            chapter += &format!(
                "Of the backdrops, **{}** is nearest to truth behind portals ({:.1} dB, {} of its pixels are holes); exposure \
                 errors, layers and threads are in [walk.json](results/walk.json).\n",
                best.name,
                best.behind_psnr_db,
                percent(best.hole_share),
            );
        }
        chapter
    }

    fn write_to(&self, page: &mut String) -> std::fmt::Result {
        let [width, height] = self.size;
        writeln!(page, "# Walk through {}\n", self.scene)?;
        writeln!(
            page,
            "{} cells, {} portals, {} triangles; {} poses at {width}x{height}, {} of them compared with truth; {} threads.\n",
            self.cells, self.portals, self.triangles, self.poses, self.truth_poses, self.threads
        )?;
        writeln!(
            page,
            "Commit {}, {} ({}).\n",
            self.commit, self.machine.processor, self.machine.simd
        )?;
        writeln!(
            page,
            "Times in ms: median (95 %, worst). Primary rays: {}.\n",
            spread(self.primary_rays_ms)
        )?;
        self.times(page)?;
        self.errors(page)?;
        self.captures(page)?;
        self.exposure(page)?;
        self.layers(page)?;
        self.threads(page)
    }

    fn times(&self, page: &mut String) -> std::fmt::Result {
        writeln!(page, "## Frames\n")?;
        writeln!(
            page,
            "`behind`: time of culled geometry for what the backdrops show, over theirs. `lost`: poses at which primary rays \
             are faster. `clipped`: samples that clipping removes.\n"
        )?;
        let mut table = Table::new([
            "drawn as",
            "frame",
            "geometry",
            "backdrops",
            "behind",
            "lost",
            "portals",
            "clipped",
        ]);
        for row in &self.rows {
            let (behind, clipped) = if row.portals > 0.0 {
                (
                    format!("{:.1}x", row.behind_speedup),
                    percent(row.clipped_share),
                )
            } else {
                Default::default()
            };
            table.row([
                row.name.as_str(),
                &spread(row.frame_ms),
                &spread(row.geometry_ms),
                &spread(row.backdrop_ms),
                &behind,
                &percent(row.lost_to_rays),
                &format!("{:.2}", row.portals),
                &clipped,
            ]);
        }
        writeln!(page, "{table}")
    }

    fn errors(&self, page: &mut String) -> std::fmt::Result {
        writeln!(page, "## Errors against truth\n")?;
        writeln!(
            page,
            "PSNR in dB. Backdrops fill {}.\n",
            percent(
                self.rows
                    .iter()
                    .map(|r| r.backdrop_share)
                    .fold(0.0, f64::max)
            )
        )?;
        let mut table = Table::new([
            "drawn as",
            "frame, median",
            "frame, worst",
            "behind portals",
            "holes behind portals",
        ]);
        for row in &self.rows {
            let [median, worst, behind] =
                [row.psnr_db, row.least_psnr_db, row.behind_psnr_db].map(|db| format!("{db:.2}"));
            table.row([
                row.name.as_str(),
                &median,
                &worst,
                &behind,
                &percent(row.hole_share),
            ]);
        }
        writeln!(page, "{table}")
    }

    fn captures(&self, page: &mut String) -> std::fmt::Result {
        writeln!(page, "## Captures\n\nOne side of one portal.\n")?;
        let mut table = Table::new(["backdrop", "captured", "seconds", "samples", "KiB"]);
        for row in self.rows.iter().filter(|row| row.captures > 0) {
            table.row([
                row.name.as_str(),
                &row.captures.to_string(),
                &spread(row.capture_s),
                &format!("{:.0}", row.samples),
                &format!("{:.0}", row.bytes / 1024.0),
            ]);
        }
        writeln!(page, "{table}")
    }

    fn exposure(&self, page: &mut String) -> std::fmt::Result {
        writeln!(
            page,
            "## Exposure errors\n\nPixels behind portals that show nothing or a wrong surface."
        )?;
        let perfect = self
            .exposure
            .iter()
            .map(|row| row.perfect_by_points_share)
            .fold(0.0, f64::max);
        writeln!(
            page,
            "`by points`: against a truth of one point a pixel, which lacks what is thinner; a perfect frame has {} by it.\n",
            percent(perfect)
        )?;
        let mut table = Table::new([
            "backdrop",
            "wrong",
            "nothing at all",
            "worst pose",
            "wrong by points",
            "samples",
        ]);
        for row in &self.exposure {
            let [wrong, holes, worst, by_points] = [
                row.wrong_share,
                row.hole_share,
                row.worst_share,
                row.wrong_by_points_share,
            ]
            .map(percent);
            table.row([
                row.name.as_str(),
                &wrong,
                &holes,
                &worst,
                &by_points,
                &format!("{:.0}", row.samples),
            ]);
        }
        writeln!(page, "{table}")
    }

    fn layers(&self, page: &mut String) -> std::fmt::Result {
        writeln!(
            page,
            "## Layers\n\nThe papers': 72 / 19 / 6 / 3 % and 79 / 20 (layers 2 and 3) / 1 %.\n"
        )?;
        let mut table = Table::new([
            "backdrop",
            "samples",
            "1",
            "2",
            "3",
            "4+",
            "samples a pixel",
        ]);
        for row in &self.layers {
            let [a, b, c, d] = row.shares.map(percent);
            let samples = format!("{:.0}", row.samples);
            let complexity = format!("{:.2}", row.depth_complexity);
            table.row([row.name.as_str(), &samples, &a, &b, &c, &d, &complexity]);
        }
        writeln!(page, "{table}")
    }

    fn threads(&self, page: &mut String) -> std::fmt::Result {
        writeln!(page, "## Threads\n")?;
        let mut table = Table::new(["divided into", "processors", "times faster", ""]);
        for row in &self.parallel {
            let how = if row.by_the_clock {
                "by the clock"
            } else {
                "by samples, bound"
            };
            table.row([
                row.division.as_str(),
                &row.processors.to_string(),
                &format!("{:.2}", row.speedup),
                how,
            ]);
        }
        write!(page, "{table}")
    }
}

fn spread(values: Spread) -> String {
    format!(
        "{:.2} ({:.2}, {:.2})",
        values.median, values.p95, values.worst
    )
}
