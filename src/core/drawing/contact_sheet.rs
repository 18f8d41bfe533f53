//! Contact sheets: an HTML page of captioned pictures, such as frame | truth | error map.

use super::escape;

/// A row of a contact sheet: pictures side by side, wrapped where the window is too narrow.
#[derive(Clone, Debug, Default)]
pub struct SheetRow {
    /// Heading of the row.
    pub label: String,
    /// File of each picture, relative to the page, and its caption.
    pub pictures: Vec<(String, String)>,
}

/// Returns the page as HTML. The pictures stay in files of their own.
pub fn contact_sheet(title: &str, rows: &[SheetRow]) -> String {
    let title = escape(title);
    let mut html = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<title>{title}</title>\n<style>\n\
         body{{font:15px sans-serif;margin:1.5em;background:#ececea;color:#18181c}}\n\
         h2{{font-size:1em;margin:1.5em 0 .5em}}\n\
         div{{display:grid;grid-template-columns:repeat(auto-fit,minmax(15em,max-content));gap:1em}}\n\
         figure{{margin:0}}\nimg{{max-width:100%}}\n</style>\n<h1>{title}</h1>\n"
    );
    for row in rows {
        html += &format!("<h2>{}</h2>\n<div>\n", escape(&row.label));
        for (file, caption) in &row.pictures {
            let (file, caption) = (escape(file), escape(caption));
            html += &format!(
                "<figure><a href=\"{file}\"><img src=\"{file}\" alt=\"{caption}\"></a>\
                 <figcaption>{caption}</figcaption></figure>\n"
            );
        }
        html += "</div>\n";
    }
    html + "</html>\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_in_caption_is_escaped() {
        let pictures = vec![("a.png".to_owned(), "\"x\" < 3\0".to_owned())];
        let html = contact_sheet(
            "sheet",
            &[SheetRow {
                label: "R & D".into(),
                pictures,
            }],
        );
        assert!(
            html.contains("<img src=\"a.png\" alt=\"&quot;x&quot; &lt; 3\">"),
            "{html}"
        );
        assert!(html.contains("<h2>R &amp; D</h2>"), "{html}");
    }
}
