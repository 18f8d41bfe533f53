//! What a chart is drawn of, and the SVG file of it.

use std::fmt::Write;

/// sRGB.
pub(super) type Color = [u8; 3];

/// Where a text stands against its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// One thing to draw; lengths in pixels of the SVG, row 0 on top.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Mark {
    Line {
        points: Vec<[f64; 2]>,
        color: Color,
        width: f64,
        dashed: bool,
    },
    Dot {
        at: [f64; 2],
        radius: f64,
        color: Color,
        filled: bool,
    },
    /// `at` is on the baseline. Turned by a quarter to the left if `upright` is false.
    Text {
        at: [f64; 2],
        size: f64,
        color: Color,
        anchor: Anchor,
        upright: bool,
        text: String,
    },
}

/// All marks of a chart, drawn in their order on white.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Drawing {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) marks: Vec<Mark>,
}

impl Drawing {
    /// The drawing as an SVG file.
    pub fn to_svg(&self) -> String {
        let (width, height) = (self.width, self.height);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
             font-family=\"Ubuntu, 'Helvetica Neue', Arial, sans-serif\" font-weight=\"300\">\n\
             <rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n"
        );
        for mark in &self.marks {
            svg += &element(mark);
        }
        svg + "</svg>\n"
    }
}

fn hex([r, g, b]: Color) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn element(mark: &Mark) -> String {
    match mark {
        Mark::Line { points, color, width, dashed } => {
            let mut list = String::new();
            for [x, y] in points {
                // Writing to a string cannot fail.
                let _ = write!(list, "{x:.2},{y:.2} ");
            }
            let dash = if *dashed { " stroke-dasharray=\"4 4\"" } else { "" };
            let (list, color) = (list.trim_end(), hex(*color));
            format!("<polyline points=\"{list}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\"{dash}/>\n")
        }
        Mark::Dot { at: [x, y], radius, color, filled } => {
            let (fill, color) = (if *filled { hex(*color) } else { "#ffffff".into() }, hex(*color));
            format!(
                "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius}\" fill=\"{fill}\" stroke=\"{color}\" stroke-width=\"1.6\"/>\n"
            )
        }
        Mark::Text { at: [x, y], size, color, anchor, upright, text } => {
            let anchor = match anchor {
                Anchor::Start => "start",
                Anchor::Middle => "middle",
                Anchor::End => "end",
            };
            let turn = if *upright { String::new() } else { format!(" transform=\"rotate(-90 {x:.2} {y:.2})\"") };
            let text = text.replace('&', "&amp;").replace('<', "&lt;");
            let color = hex(*color);
            format!(
                "<text x=\"{x:.2}\" y=\"{y:.2}\" font-size=\"{size}\" fill=\"{color}\" text-anchor=\"{anchor}\"{turn}>{text}</text>\n"
            )
        }
    }
}
