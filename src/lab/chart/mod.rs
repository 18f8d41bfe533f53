//! Charts as SVG: labelled points, lines and a Pareto front over linear or logarithmic axes.
//!
//! Labels are next to their points and lines: no legend has to be matched by colour.

mod axis;
mod labels;

pub use axis::Axis;

use axis::{Scale, tick_label};
use glam::{DVec2, dvec2};
use headbox_core::drawing::svg::{Color, Svg, TextStyle, text_width};
use labels::{place_labels, push_apart};

/// A point of a series.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartPoint {
    /// Values along both axes. A point that an axis cannot show is left out.
    pub at: [f64; 2],
    /// Label beside the point; may be empty.
    pub name: String,
    /// Interval along x, drawn as a thin line.
    pub spread: Option<[f64; 2]>,
}

impl ChartPoint {
    /// Creates a point without label and interval.
    pub fn new(at: [f64; 2]) -> Self {
        Self {
            at,
            name: String::new(),
            spread: None,
        }
    }
}

/// Points of one colour.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Label in the right margin, joined to the last point; may be empty.
    pub name: String,
    /// Points in order.
    pub points: Vec<ChartPoint>,
    /// Joins the points by a line.
    pub joined: bool,
    /// Draws hollow dots.
    pub hollow: bool,
    /// Index into [`PALETTE`], modulo its length.
    pub color: usize,
}

impl Series {
    /// Creates a line with filled dots.
    pub fn line(name: impl Into<String>, points: Vec<ChartPoint>, color: usize) -> Self {
        Self {
            name: name.into(),
            points,
            joined: true,
            hollow: false,
            color,
        }
    }
}

/// A chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// Heading.
    pub title: String,
    /// Reading aid below the heading.
    pub note: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Series from back to front.
    pub series: Vec<Series>,
    /// Pareto front in order of x, joined by steps.
    pub front: Vec<[f64; 2]>,
}

/// Palette for any colour vision, after Okabe and Ito (2008): any two colours are at least 17
/// CIELAB units apart, also for dichromats.
pub const PALETTE: [Color; 7] = [
    [0, 96, 170],
    [200, 75, 0],
    [0, 145, 100],
    [195, 100, 155],
    [80, 170, 225],
    [220, 155, 0],
    [60, 60, 70],
];

const SIZE: DVec2 = dvec2(800.0, 480.0);
const LEFT: f64 = 68.0;
const RIGHT: f64 = 28.0;
const TOP: f64 = 66.0;
const BOTTOM: f64 = SIZE.y - 56.0;
const INK: Color = [32, 36, 44];
const FAINT_INK: Color = [90, 96, 108];
const GRID: Color = [228, 230, 235];
const FRONT: Color = [150, 156, 168];
const LABEL_PX: f64 = 12.5;
const DOT_PX: f64 = 4.5;
/// Number of points above which a line is drawn thin and without dots.
const MAX_DOTS: usize = 80;

impl Chart {
    /// Draws the chart as an SVG file.
    pub fn to_svg(&self) -> String {
        let mut svg = Svg::new(SIZE, &self.title);
        let plot = Plot::new(self);
        self.draw_axes(&plot, &mut svg);
        let steps = self
            .front
            .windows(2)
            .flat_map(|pair| [pair[0], [pair[1][0], pair[0][1]]]);
        let front: Vec<DVec2> = steps
            .chain(self.front.last().copied())
            .filter_map(|at| plot.position(at))
            .collect();
        svg.lines([&front], FRONT, 1.5);
        let mut lines = vec![front];
        for series in &self.series {
            lines.extend(series.draw(&plot, &mut svg));
        }
        self.draw_labels(&plot, &lines, &mut svg);
        self.draw_series_names(&plot, &mut svg);
        svg.finish()
    }

    fn draw_axes(&self, plot: &Plot, svg: &mut Svg) {
        let right = plot.x.pixels[1];
        for tick in plot.x.ticks() {
            let x = plot.x.position(tick);
            svg.lines([[dvec2(x, TOP), dvec2(x, BOTTOM)]], GRID, 1.0);
            svg.text(
                dvec2(x, BOTTOM + 18.0),
                &tick_label(tick),
                text_style(12.0, FAINT_INK, "middle"),
            );
        }
        for tick in plot.y.ticks() {
            let y = plot.y.position(tick);
            svg.lines([[dvec2(LEFT, y), dvec2(right, y)]], GRID, 1.0);
            svg.text(
                dvec2(LEFT - 8.0, y + 4.0),
                &tick_label(tick),
                text_style(12.0, FAINT_INK, "end"),
            );
        }
        svg.lines([[dvec2(LEFT, BOTTOM), dvec2(right, BOTTOM)]], FRONT, 1.0);
        svg.text(
            dvec2(24.0, 28.0),
            &self.title,
            text_style(18.0, INK, "start"),
        );
        svg.text(
            dvec2(24.0, 48.0),
            &self.note,
            text_style(12.5, FAINT_INK, "start"),
        );
        let style = text_style(13.0, INK, "middle");
        svg.text(
            dvec2(0.5 * (LEFT + right), SIZE.y - 14.0),
            &self.x.name,
            style,
        );
        svg.text(
            dvec2(20.0, 0.5 * (TOP + BOTTOM)),
            &self.y.name,
            TextStyle {
                upwards: true,
                ..style
            },
        );
    }

    /// Writes the names of points near them.
    fn draw_labels(&self, plot: &Plot, lines: &[Vec<DVec2>], svg: &mut Svg) {
        let points = || {
            self.series
                .iter()
                .flat_map(|series| plot.visible(series).map(move |point| (series, point)))
        };
        let named = || points().filter(|(_, (point, _))| !point.name.is_empty());
        let dots: Vec<(DVec2, &str)> = named()
            .map(|(_, (point, at))| (at, point.name.as_str()))
            .collect();
        let area = [dvec2(LEFT, TOP - 8.0), dvec2(SIZE.x - 6.0, BOTTOM)];
        let placements = place_labels(&dots, LABEL_PX, area, lines);
        for ((series, (point, _)), placement) in named().zip(placements) {
            svg.lines(placement.leader(), series.color(), 0.8);
            let (position, anchor) = placement.baseline();
            svg.text(position, &point.name, series.text_style(anchor));
        }
    }

    /// Writes the names of series in the right margin, joined to their last points.
    fn draw_series_names(&self, plot: &Plot, svg: &mut Svg) {
        let named = self.series.iter().filter(|series| !series.name.is_empty());
        let mut ends: Vec<_> = named
            .filter_map(|series| Some((series, plot.visible(series).last()?.1)))
            .collect();
        ends.sort_by(|a, b| a.1.y.total_cmp(&b.1.y));
        let mut heights: Vec<f64> = ends.iter().map(|(_, end)| end.y).collect();
        push_apart(&mut heights, 1.3 * LABEL_PX, BOTTOM);
        for ((series, end), y) in ends.into_iter().zip(heights) {
            let right = plot.x.pixels[1];
            svg.lines(
                [[end, dvec2(right, end.y), dvec2(right + 9.0, y)]],
                series.color(),
                0.8,
            );
            svg.text(
                dvec2(right + 12.0, y + 0.35 * LABEL_PX),
                &series.name,
                series.text_style("start"),
            );
        }
    }
}

impl Series {
    fn color(&self) -> Color {
        PALETTE[self.color % PALETTE.len()]
    }

    /// Returns the style of labels. They are darker than dots: thin letters need more contrast.
    fn text_style(&self, anchor: &'static str) -> TextStyle {
        text_style(
            LABEL_PX,
            self.color().map(|channel| (f64::from(channel) * 0.7) as u8),
            anchor,
        )
    }

    /// Draws lines and dots; returns the lines.
    fn draw(&self, plot: &Plot, svg: &mut Svg) -> Vec<Vec<DVec2>> {
        let line: Vec<DVec2> = plot.visible(self).map(|(_, at)| at).collect();
        let has_dots = !self.joined || line.len() <= MAX_DOTS;
        let spread = |(point, _): (&ChartPoint, DVec2)| {
            let [low, high] = point.spread?.map(|x| plot.position([x, point.at[1]]));
            Some(vec![low?, high?])
        };
        let spreads: Vec<Vec<DVec2>> = plot.visible(self).filter_map(spread).collect();
        svg.lines(&spreads, self.color(), 1.5);
        if self.joined {
            svg.lines([&line], self.color(), if has_dots { 2.0 } else { 1.2 });
        }
        for at in line.iter().filter(|_| has_dots) {
            svg.circle(
                *at,
                DOT_PX,
                self.color(),
                if self.hollow { [255; 3] } else { self.color() },
            );
        }
        spreads
            .into_iter()
            .chain(self.joined.then_some(line))
            .collect()
    }
}

fn text_style(size: f64, color: Color, anchor: &'static str) -> TextStyle {
    TextStyle {
        size,
        color,
        anchor,
        upwards: false,
        halo: false,
    }
}

/// Scales of both axes.
struct Plot {
    x: Scale,
    y: Scale,
}

impl Plot {
    fn new(chart: &Chart) -> Self {
        let points = || chart.series.iter().flat_map(|series| &series.points);
        let xs = points().flat_map(|point| point.spread.into_iter().flatten().chain([point.at[0]]));
        let names = chart
            .series
            .iter()
            .map(|series| text_width(&series.name, LABEL_PX))
            .fold(0.0, f64::max);
        Self {
            x: Scale::new(&chart.x, [LEFT, SIZE.x - RIGHT - names], xs),
            y: Scale::new(&chart.y, [BOTTOM, TOP], points().map(|point| point.at[1])),
        }
    }

    /// Returns the position of a pair of values, `None` if an axis cannot show it.
    fn position(&self, [x, y]: [f64; 2]) -> Option<DVec2> {
        let position = dvec2(self.x.position(x), self.y.position(y));
        (position.cmpge(DVec2::ZERO) & position.cmple(SIZE))
            .all()
            .then_some(position)
    }

    fn visible<'a>(
        &self,
        series: &'a Series,
    ) -> impl DoubleEndedIterator<Item = (&'a ChartPoint, DVec2)> {
        series
            .points
            .iter()
            .filter_map(|point| Some((point, self.position(point.at)?)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn point_without_position_is_left_out() {
        let point = |x: f64, name: &str| ChartPoint {
            name: name.into(),
            ..ChartPoint::new([x, 0.1])
        };
        let points = vec![
            point(1.0, "left"),
            point(100.0, "<right>"),
            point(0.0, "nowhere"),
        ];
        let chart = Chart {
            title: "title".into(),
            note: "note".into(),
            x: Axis::logarithmic("time, ms"),
            y: Axis::linear("error"),
            series: vec![Series::line("all", points, 0)],
            front: vec![[1.0, 0.1], [100.0, 0.05]],
        };
        let svg = chart.to_svg();
        assert_eq!(svg.matches("<circle").count(), 2);
        assert!(
            svg.contains(">&lt;right&gt;</text>")
                && svg.contains(">all</text>")
                && !svg.contains("nowhere"),
            "{svg}"
        );
        let empty = Chart {
            series: Vec::new(),
            front: Vec::new(),
            ..chart
        }
        .to_svg();
        assert!(
            !empty.contains("NaN") && empty.contains(">time, ms</text>"),
            "{empty}"
        );
    }
}
