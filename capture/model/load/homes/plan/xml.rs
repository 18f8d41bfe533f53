//! Helpers for a home's XML.

use roxmltree::Node;

/// Returns the elements of a name below a node, in the order of the file (doors may be in groups of
/// furniture).
pub(super) fn elements<'a>(
    root: Node<'a, 'a>,
    name: &'static str,
) -> impl Iterator<Item = Node<'a, 'a>> {
    root.descendants()
        .filter(move |node| node.has_tag_name(name))
}

/// Returns a finite number in an attribute.
pub(crate) fn number(node: Node, attribute: &str) -> Option<f64> {
    node.attribute(attribute)?
        .parse()
        .ok()
        .filter(|value: &f64| value.is_finite())
}
