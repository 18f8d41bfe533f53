//! Finishes of a Sweet Home 3D home's surfaces.

use super::xml::number;
use glam::DVec2;
use headbox_core::color::linear_from_srgb8;
use roxmltree::Node;

/// An image that is repeated over a surface.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Repeated {
    /// Name of the image in the archive.
    pub(crate) image: String,
    /// Width and height of the image, centimetres.
    size: DVec2,
    /// Offset, in images.
    offset: DVec2,
    /// Rotation, radians.
    angle: f64,
}

impl Repeated {
    /// Returns the texture coordinate of a point on a surface, centimetres to the right and up.
    pub(crate) fn texcoord(&self, place: DVec2) -> DVec2 {
        DVec2::from_angle(self.angle).rotate(place - self.offset * self.size) / self.size
    }
}

/// Finish of a surface; a texture takes precedence over a colour.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Finish {
    pub(crate) color: Option<[f32; 3]>,
    pub(crate) picture: Option<Repeated>,
}

impl Finish {
    /// Returns true if the home specifies a finish.
    pub(crate) fn is_specified(&self) -> bool {
        *self != Self::default()
    }
}

/// Reads the colour of an attribute, and the texture that a child element specifies for its parent.
pub(crate) fn finish(node: Node, color_attribute: &str, texture: Option<&str>) -> Finish {
    let is_texture =
        |child: &Node| child.has_tag_name("texture") && child.attribute("attribute") == texture;
    Finish {
        color: color(node, color_attribute),
        picture: node.children().find(is_texture).and_then(repeated),
    }
}

fn repeated(texture: Node) -> Option<Repeated> {
    let number = |attribute: &str, default: f64| number(texture, attribute).unwrap_or(default);
    let positive = |value: f64, default: f64| if value > 0.0 { value } else { default };
    // Images of models have no size; one metre is assumed.
    let size = DVec2::new(number("width", -1.0), number("height", -1.0))
        .map(|length| positive(length, 100.0));
    Some(Repeated {
        image: texture.attribute("image")?.to_owned(),
        size: size * positive(number("scale", 1.0), 1.0),
        offset: DVec2::new(number("xOffset", 0.0), number("yOffset", 0.0)),
        angle: number("angle", 0.0),
    })
}

/// Reads a colour of alpha, red, green and blue in hexadecimal, sRGB. Returns linear RGB.
pub(crate) fn color(node: Node, attribute: &str) -> Option<[f32; 3]> {
    let argb = u32::from_str_radix(node.attribute(attribute)?, 16).ok()?;
    Some([16, 8, 0].map(|shift| linear_from_srgb8((argb >> shift) as u8)))
}
