//! What a drawing is made of, and the SVG file of it.

use std::fmt::Write;

/// sRGB.
pub type Color = [u8; 3];

/// Where a text stands against its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// It begins there.
    Start,
    /// Its middle is there.
    Middle,
    /// It ends there.
    End,
}

/// One thing to draw; lengths in pixels of the SVG, row 0 on top.
#[derive(Clone, Debug, PartialEq)]
pub enum Mark {
    /// Points joined in their order.
    Line {
        /// Its corners.
        points: Vec<[f64; 2]>,
        /// Of the line.
        color: Color,
        /// Of the line.
        width: f64,
        /// Whether it has gaps.
        dashed: bool,
    },
    /// Separate lines, each from point to point.
    Strokes {
        /// Their ends.
        ends: Vec<[[f64; 2]; 2]>,
        /// Of the lines.
        color: Color,
        /// Of the lines.
        width: f64,
    },
    /// Filled polygons; what two of them cover is covered.
    Area {
        /// Their corners.
        outlines: Vec<Vec<[f64; 2]>>,
        /// Of the inside.
        color: Color,
    },
    /// A white rectangle with a border.
    Box {
        /// Its upper left corner.
        at: [f64; 2],
        /// Width and height.
        size: [f64; 2],
        /// Of the border.
        color: Color,
    },
    /// A circle.
    Dot {
        /// Its middle.
        at: [f64; 2],
        /// To the middle of its line.
        radius: f64,
        /// Of its line, and of its inside if it is filled.
        color: Color,
        /// Else it is white.
        filled: bool,
    },
    /// A line of text.
    Text {
        /// On the baseline.
        at: [f64; 2],
        /// Height of the letters' body.
        size: f64,
        /// Of the letters.
        color: Color,
        /// Which part of it stands at its place.
        anchor: Anchor,
        /// Turned by a quarter to the left if not.
        upright: bool,
        /// Whether white surrounds the letters, for names on top of other things.
        halo: bool,
        /// The words.
        text: String,
    },
}

/// Width of the white around letters that have a halo.
pub(super) const HALO_PX: f64 = 4.0;

/// Width of a box's border.
pub(super) const BORDER_PX: f64 = 1.2;

/// Marks, drawn in their order on white.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Drawing {
    /// Pixels of the SVG.
    pub width: u32,
    /// Pixels of the SVG.
    pub height: u32,
    /// Pixels of the picture for each of the SVG.
    pub fineness: f32,
    /// From below.
    pub marks: Vec<Mark>,
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

fn listed(points: &[[f64; 2]]) -> String {
    let mut list = String::new();
    for [x, y] in points {
        // Writing to a string cannot fail.
        let _ = write!(list, "{x:.2},{y:.2} ");
    }
    list.trim_end().to_owned()
}

fn element(mark: &Mark) -> String {
    match mark {
        Mark::Line { points, color, width, dashed } => {
            let dash = if *dashed { " stroke-dasharray=\"4 4\"" } else { "" };
            let (list, color) = (listed(points), hex(*color));
            format!("<polyline points=\"{list}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\"{dash}/>\n")
        }
        Mark::Strokes { ends, color, width } => {
            let color = hex(*color);
            let mut path = String::new();
            for [[ax, ay], [bx, by]] in ends {
                let _ = write!(path, "M{ax:.1} {ay:.1}L{bx:.1} {by:.1}");
            }
            format!("<path fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\" d=\"{path}\"/>\n")
        }
        Mark::Area { outlines, color } => {
            let color = hex(*color);
            let polygon =
                |points: &Vec<[f64; 2]>| format!("<polygon points=\"{}\" fill=\"{color}\"/>\n", listed(points));
            outlines.iter().map(polygon).collect()
        }
        Mark::Box { at: [x, y], size: [width, height], color } => format!(
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"#ffffff\" stroke=\"{}\" \
             stroke-width=\"{BORDER_PX}\"/>\n",
            hex(*color)
        ),
        Mark::Dot { at: [x, y], radius, color, filled } => {
            let (fill, color) = (if *filled { hex(*color) } else { "#ffffff".into() }, hex(*color));
            format!(
                "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius}\" fill=\"{fill}\" stroke=\"{color}\" stroke-width=\"1.6\"/>\n"
            )
        }
        Mark::Text { at: [x, y], size, color, anchor, upright, halo, text } => {
            let anchor = match anchor {
                Anchor::Start => "start",
                Anchor::Middle => "middle",
                Anchor::End => "end",
            };
            let turn = if *upright { String::new() } else { format!(" transform=\"rotate(-90 {x:.2} {y:.2})\"") };
            let halo = if *halo {
                format!(" stroke=\"#ffffff\" stroke-width=\"{HALO_PX}\" paint-order=\"stroke\"")
            } else {
                String::new()
            };
            let text = text.replace('&', "&amp;").replace('<', "&lt;");
            let color = hex(*color);
            format!(
                "<text x=\"{x:.2}\" y=\"{y:.2}\" font-size=\"{size}\" fill=\"{color}\" text-anchor=\"{anchor}\"{turn}{halo}>{text}</text>\n"
            )
        }
    }
}
