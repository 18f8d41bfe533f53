//! SVG drawings and HTML pages of images, written without fonts or a rasteriser.

pub mod contact_sheet;
pub mod svg;

/// Escapes text for HTML and SVG. Control characters, which XML forbids, are dropped.
fn escape(text: &str) -> String {
    let text = text.replace(char::is_control, "");
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
