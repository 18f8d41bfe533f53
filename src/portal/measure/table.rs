//! What was found, as a page in Markdown.

use super::{Spread, VariantRow, WalkReport};
use std::fmt::Write;

impl WalkReport {
    /// Tables of times and errors, exposure errors, layers and threads.
    pub fn to_markdown(&self) -> String {
        let mut page = String::new();
        // Writing to a string cannot fail.
        let _ = self.write_to(&mut page);
        page
    }

    fn write_to(&self, page: &mut String) -> std::fmt::Result {
        let [width, height] = self.size;
        writeln!(page, "# Walk through {}\n", self.scene)?;
        writeln!(
            page,
            "{} cells, {} portals, {} triangles; {} poses at {width}x{height}, {} of them compared with truth; {} threads.\n",
            self.cells, self.portals, self.triangles, self.poses, self.truth_poses, self.threads
        )?;
        writeln!(page, "Times in ms: median (95 %, worst). Primary rays: {}.\n", spread(self.primary_rays_ms))?;
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
        writeln!(page, "| drawn as | frame | geometry | backdrops | behind | lost | portals | clipped |")?;
        writeln!(page, "| --- | --- | --- | --- | --- | --- | --- | --- |")?;
        for row in &self.rows {
            let (behind, clipped) = match row.portals > 0.0 {
                true => (format!("{:.1}x", row.behind_speedup), percent(row.clipped_share)),
                false => ("".into(), "".into()),
            };
            let VariantRow { name, frame_ms, geometry_ms, backdrop_ms, lost_to_rays, portals, .. } = row;
            writeln!(
                page,
                "| {name} | {} | {} | {} | {behind} | {} | {portals:.2} | {clipped} |",
                spread(*frame_ms),
                spread(*geometry_ms),
                spread(*backdrop_ms),
                percent(*lost_to_rays)
            )?;
        }
        writeln!(page)
    }

    fn errors(&self, page: &mut String) -> std::fmt::Result {
        writeln!(page, "## Errors against truth\n")?;
        writeln!(
            page,
            "PSNR in dB. Backdrops fill {}.\n",
            percent(self.rows.iter().map(|r| r.backdrop_share).fold(0.0, f64::max))
        )?;
        writeln!(page, "| drawn as | frame, median | frame, worst | behind portals | holes behind portals |")?;
        writeln!(page, "| --- | --- | --- | --- | --- |")?;
        for row in &self.rows {
            writeln!(
                page,
                "| {} | {:.2} | {:.2} | {:.2} | {} |",
                row.name,
                row.psnr_db,
                row.least_psnr_db,
                row.behind_psnr_db,
                percent(row.hole_share)
            )?;
        }
        writeln!(page)
    }

    fn captures(&self, page: &mut String) -> std::fmt::Result {
        writeln!(page, "## Captures\n\nOne side of one portal.\n")?;
        writeln!(page, "| backdrop | captured | seconds | samples | KiB |")?;
        writeln!(page, "| --- | --- | --- | --- | --- |")?;
        for row in self.rows.iter().filter(|row| row.captures > 0) {
            let (samples, kib) = (row.samples, row.bytes / 1024.0);
            writeln!(
                page,
                "| {} | {} | {} | {samples:.0} | {kib:.0} |",
                row.name,
                row.captures,
                spread(row.capture_s)
            )?;
        }
        writeln!(page)
    }

    fn exposure(&self, page: &mut String) -> std::fmt::Result {
        writeln!(page, "## Exposure errors\n\nPixels behind portals that show nothing or a wrong surface.")?;
        let perfect = self.exposure.iter().map(|row| row.perfect_by_points_share).fold(0.0, f64::max);
        writeln!(
            page,
            "`by points`: against a truth of one point a pixel, which lacks what is thinner; a perfect frame has {} by it.\n",
            percent(perfect)
        )?;
        writeln!(page, "| backdrop | wrong | nothing at all | worst pose | wrong by points | samples |")?;
        writeln!(page, "| --- | --- | --- | --- | --- | --- |")?;
        for row in &self.exposure {
            let [wrong, holes, worst, by_points] =
                [row.wrong_share, row.hole_share, row.worst_share, row.wrong_by_points_share].map(percent);
            writeln!(page, "| {} | {wrong} | {holes} | {worst} | {by_points} | {:.0} |", row.name, row.samples)?;
        }
        writeln!(page)
    }

    fn layers(&self, page: &mut String) -> std::fmt::Result {
        writeln!(page, "## Layers\n\nThe papers': 72 / 19 / 6 / 3 % and 79 / 20 (layers 2 and 3) / 1 %.\n")?;
        writeln!(page, "| backdrop | samples | 1 | 2 | 3 | 4+ | samples a pixel |")?;
        writeln!(page, "| --- | --- | --- | --- | --- | --- | --- |")?;
        for row in &self.layers {
            let [a, b, c, d] = row.shares.map(percent);
            let (samples, complexity) = (row.samples, row.depth_complexity);
            writeln!(page, "| {} | {samples:.0} | {a} | {b} | {c} | {d} | {complexity:.2} |", row.name)?;
        }
        writeln!(page)
    }

    fn threads(&self, page: &mut String) -> std::fmt::Result {
        writeln!(page, "## Threads\n")?;
        writeln!(page, "| divided into | processors | times faster | |")?;
        writeln!(page, "| --- | --- | --- | --- |")?;
        for row in &self.parallel {
            let how = if row.by_the_clock { "by the clock" } else { "by samples, bound" };
            writeln!(page, "| {} | {} | {:.2} | {how} |", row.division, row.processors, row.speedup)?;
        }
        Ok(())
    }
}

fn spread(of: Spread) -> String {
    format!("{:.2} ({:.2}, {:.2})", of.median, of.p95, of.worst)
}

fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    if percent < 1.0 { format!("{percent:.3} %") } else { format!("{percent:.1} %") }
}
