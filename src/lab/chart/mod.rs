//! Charts: points with names, lines, a front.
//!
//! Why no crate: those that draw charts leave the hardest part, names that cover nothing, to their callers, and bring readers of
//! fonts of their own.

mod labels;
mod scale;

pub use scale::Spacing;

use headbox_core::drawing::{Anchor, Color, Drawing, Mark};
use labels::Labels;
use scale::Scale;

/// An axis.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Axis {
    /// What it shows, with its unit.
    pub name: String,
    /// How.
    pub spacing: Spacing,
}

/// A point with a name of its own, or none.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartPoint {
    /// Along the two axes.
    pub at: [f64; 2],
    /// Written beside it.
    pub name: String,
    /// How far it scatters along x: drawn as a thin line.
    pub spread: Option<[f64; 2]>,
}

/// Points that belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Written at its last point; may be empty.
    pub name: String,
    /// In order.
    pub points: Vec<ChartPoint>,
    /// Whether a line joins them.
    pub joined: bool,
    /// Whether its dots are hollow.
    pub hollow: bool,
    /// Which of [`Chart::PALETTE`]; any number will do.
    pub color: usize,
}

/// A chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// Above all.
    pub title: String,
    /// Below the title: what to look for.
    pub note: String,
    /// Horizontal.
    pub x: Axis,
    /// Vertical.
    pub y: Axis,
    /// What is shown.
    pub series: Vec<Series>,
    /// Points, in order of x, joined by steps: the front that nothing beats.
    pub front: Vec<[f64; 2]>,
}

const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 460.0;
const LEFT: f64 = 68.0;
const RIGHT: f64 = 28.0;
const TOP: f64 = 66.0;
const BOTTOM: f64 = 56.0;
const INK: Color = [32, 36, 44];
const FAINT: Color = [104, 110, 122];
const GRID: Color = [228, 230, 235];
const FRONT: Color = [150, 156, 168];
const NAME_PX: f64 = 12.0;
const DOT_PX: f64 = 4.5;
/// A line of more points than this is drawn thin and without dots.
const MOST_DOTS: usize = 80;

impl Chart {
    /// Colours that people with any sight can tell apart (Okabe and Ito 2008), without yellow, which is faint on white.
    pub const PALETTE: [[u8; 3]; 7] =
        [[0, 114, 178], [213, 94, 0], [0, 138, 100], [190, 90, 150], [70, 160, 215], [200, 140, 0], [80, 80, 90]];

    /// The chart, drawn.
    pub fn draw(&self) -> Drawing {
        let points = || self.series.iter().flat_map(|series| &series.points);
        let spreads = points().filter_map(|point| point.spread).flatten();
        let x = Scale::around(points().map(|point| point.at[0]).chain(spreads), self.x.spacing);
        let y = Scale::around(points().map(|point| point.at[1]), self.y.spacing);
        let frame = PlotArea { x, y };
        let mut marks = Vec::new();
        self.draw_axes(&frame, &mut marks);
        let steps = self.front.windows(2).flat_map(|pair| [pair[0], [pair[1][0], pair[0][1]]]);
        let front: Vec<[f64; 2]> = steps.chain(self.front.last().copied()).map(|p| frame.place(p)).collect();
        if front.len() > 1 {
            marks.push(Mark::Line { points: front.clone(), color: FRONT, width: 1.5, dashed: false });
        }
        let mut labels = Labels::new([LEFT, TOP - 8.0, WIDTH - 6.0, HEIGHT - BOTTOM]);
        labels.avoid_line(&front);
        let visible = |series: &Series| -> Vec<(ChartPoint, [f64; 2])> {
            let placed = series.points.iter().map(|point| (point.clone(), frame.place(point.at)));
            placed.filter(|(_, at)| at.iter().all(|c| c.is_finite())).collect()
        };
        for series in &self.series {
            let color = Self::PALETTE[series.color % Self::PALETTE.len()];
            let placed = visible(series);
            let line: Vec<[f64; 2]> = placed.iter().map(|(_, at)| *at).collect();
            if series.joined && line.len() > 1 {
                labels.avoid_line(&line);
                let width = if line.len() > MOST_DOTS { 1.0 } else { 2.0 };
                marks.push(Mark::Line { points: line.clone(), color, width, dashed: false });
            }
            let dotted = !series.joined || line.len() <= MOST_DOTS;
            for (point, at) in placed.iter().filter(|_| dotted) {
                let ends = point.spread.map(|ends| ends.map(|x| frame.place([x, point.at[1]])));
                if let Some(ends) = ends.filter(|ends| ends.as_flattened().iter().all(|c| c.is_finite())) {
                    labels.avoid_line(&ends);
                    marks.push(Mark::Line { points: ends.into(), color, width: 1.5, dashed: false });
                }
                let at = *at;
                labels.avoid_dot(at, DOT_PX);
                marks.push(Mark::Dot { at, radius: DOT_PX, color, filled: !series.hollow });
            }
        }
        for series in &self.series {
            let color = Self::PALETTE[series.color % Self::PALETTE.len()];
            let placed = visible(series);
            for (i, (point, at)) in placed.iter().enumerate() {
                let name = if i + 1 == placed.len() && !series.name.is_empty() { &series.name } else { &point.name };
                if !name.is_empty() {
                    let (at, anchor) = labels.place(*at, name, NAME_PX, DOT_PX);
                    let text = name.clone();
                    marks.push(Mark::Text { at, size: NAME_PX, color, anchor, upright: true, halo: false, text });
                }
            }
        }
        Drawing { width: WIDTH as u32, height: HEIGHT as u32, fineness: 2.0, marks }
    }

    fn draw_axes(&self, frame: &PlotArea, marks: &mut Vec<Mark>) {
        let text = |at, size, color, anchor, text: &str| Mark::Text {
            at,
            size,
            color,
            anchor,
            upright: true,
            halo: false,
            text: text.into(),
        };
        marks.push(text([LEFT - 44.0, 28.0], 18.0, INK, Anchor::Start, &self.title));
        marks.push(text([LEFT - 44.0, 48.0], 12.5, FAINT, Anchor::Start, &self.note));
        let line =
            |points: [[f64; 2]; 2], color| Mark::Line { points: points.into(), color, width: 1.0, dashed: false };
        for tick in frame.x.ticks() {
            let x = LEFT + frame.x.place(tick.value) * (WIDTH - LEFT - RIGHT);
            marks.push(line([[x, TOP], [x, HEIGHT - BOTTOM]], GRID));
            marks.push(text([x, HEIGHT - BOTTOM + 18.0], 12.0, FAINT, Anchor::Middle, &tick.label));
        }
        for tick in frame.y.ticks() {
            let y = HEIGHT - BOTTOM - frame.y.place(tick.value) * (HEIGHT - TOP - BOTTOM);
            marks.push(line([[LEFT, y], [WIDTH - RIGHT, y]], GRID));
            marks.push(text([LEFT - 8.0, y + 4.0], 12.0, FAINT, Anchor::End, &tick.label));
        }
        marks.push(line([[LEFT, HEIGHT - BOTTOM], [WIDTH - RIGHT, HEIGHT - BOTTOM]], FRONT));
        let middle = [(LEFT + WIDTH - RIGHT) / 2.0, (TOP + HEIGHT - BOTTOM) / 2.0];
        marks.push(text([middle[0], HEIGHT - 14.0], 13.0, INK, Anchor::Middle, &self.x.name));
        marks.push(Mark::Text {
            at: [20.0, middle[1]],
            size: 13.0,
            color: INK,
            anchor: Anchor::Middle,
            upright: false,
            halo: false,
            text: self.y.name.clone(),
        });
    }
}

/// Where values lie on the paper.
struct PlotArea {
    x: Scale,
    y: Scale,
}

impl PlotArea {
    fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let at = |place: f64, low: f64, high: f64| low + place * (high - low);
        [at(self.x.place(x), LEFT, WIDTH - RIGHT), at(self.y.place(y), HEIGHT - BOTTOM, TOP)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart() -> Chart {
        let axis = |name: &str, spacing| Axis { name: name.into(), spacing };
        let point = |x: f64, y: f64, name: &str| ChartPoint { at: [x, y], name: name.into(), spread: None };
        let points = vec![point(1.0, 0.1, "left"), point(100.0, 0.05, "right & <low>"), point(0.0, 0.2, "nowhere")];
        Chart {
            title: "title".into(),
            note: "note".into(),
            x: axis("time, ms", Spacing::Logarithmic),
            y: axis("error", Spacing::Linear),
            series: vec![Series { name: String::new(), points, joined: false, hollow: false, color: 0 }],
            front: vec![[1.0, 0.1], [100.0, 0.05]],
        }
    }

    #[test]
    fn a_chart_shows_its_points_and_escapes_its_texts() {
        let svg = chart().draw().to_svg();
        assert_eq!(svg.matches("<circle").count(), 2, "0 has no place on a logarithmic axis");
        assert!(svg.contains(">right &amp; &lt;low></text>") && !svg.contains("nowhere") && svg.contains(">note<"));
        assert_eq!(svg, chart().draw().to_svg());
    }

    #[test]
    fn the_picture_has_ink_where_the_dots_are() {
        let drawing = chart().draw();
        let image = drawing.to_image().expect("it has a size");
        assert_eq!(image.dimensions(), (2 * WIDTH as u32, 2 * HEIGHT as u32));
        for mark in &drawing.marks {
            if let Mark::Dot { at: [x, y], color, .. } = mark {
                assert_eq!(image.get_pixel((2.0 * x) as u32, (2.0 * y) as u32).0, *color);
            }
        }
        let inked = image.pixels().filter(|pixel| pixel.0 == INK).count();
        assert!(inked > 100, "letters are drawn: {inked}");
    }

    #[test]
    fn an_empty_chart_is_drawn() {
        let empty = Chart { series: vec![], front: vec![], ..chart() };
        assert!(empty.draw().to_image().is_some());
    }
}
