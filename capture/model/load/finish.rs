//! Finishes of a Sweet Home 3D home's surfaces.

use super::xml::number;
use glam::DVec2;
use roxmltree::Node;

/// A picture that is repeated over a surface.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Repeated {
    /// Name of the picture in the archive.
    pub(super) image: String,
    /// Width and height of one picture.
    size: DVec2,
    /// Moves it, in pictures.
    offset: DVec2,
    /// Turns it, radians.
    angle: f64,
}

impl Repeated {
    /// The texture coordinate of a place on a surface, centimetres to the right and up.
    pub(super) fn at(&self, place: DVec2) -> DVec2 {
        DVec2::from_angle(self.angle).rotate(place - self.offset * self.size) / self.size
    }
}

/// Finish of a surface; a texture takes precedence over a colour.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Finish {
    pub(super) color: Option<[f32; 3]>,
    pub(super) picture: Option<Repeated>,
}

impl Finish {
    /// Returns true if the home specifies a finish.
    pub(super) fn is_said(&self) -> bool {
        *self != Self::default()
    }
}

/// The colour in an attribute, and the picture of a child that says that it is this texture of its
/// parent.
pub(super) fn finish(node: Node, color_attribute: &str, texture: Option<&str>) -> Finish {
    let is_it =
        |child: &Node| child.has_tag_name("texture") && child.attribute("attribute") == texture;
    Finish {
        color: color(node, color_attribute),
        picture: node.children().find(is_it).and_then(repeated),
    }
}

fn repeated(texture: Node) -> Option<Repeated> {
    let number = |attribute: &str, unsaid: f64| number(texture, attribute).unwrap_or(unsaid);
    let positive = |value: f64, unsaid: f64| if value > 0.0 { value } else { unsaid };
    // Pictures out of models have no size and are as if of a metre.
    let size = DVec2::new(number("width", -1.0), number("height", -1.0))
        .map(|length| positive(length, 100.0));
    Some(Repeated {
        image: texture.attribute("image")?.to_owned(),
        size: size * positive(number("scale", 1.0), 1.0),
        offset: DVec2::new(number("xOffset", 0.0), number("yOffset", 0.0)),
        angle: number("angle", 0.0),
    })
}

/// A colour written as alpha, red, green and blue in hexadecimal; taken as linear, as the export
/// does.
pub(super) fn color(node: Node, attribute: &str) -> Option<[f32; 3]> {
    let argb = u32::from_str_radix(node.attribute(attribute)?, 16).ok()?;
    Some([16, 8, 0].map(|shift| f32::from((argb >> shift) as u8) / 255.0))
}
