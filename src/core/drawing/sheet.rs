//! Contact sheets: a grid of labelled pictures in one image, such as frame | truth | error map.

use image::{Rgb, RgbImage, imageops};

use crate::drawing::letters;

/// A grid of pictures with titles and captions. All texts may be empty and then take no room.
///
/// ```
/// use headbox_core::drawing::sheet::{Sheet, SheetCell, SheetRow};
///
/// let cell = SheetCell { image: image::RgbImage::new(320, 240), caption: "12.5 ms".into() };
/// let sheet = Sheet {
///     title: "tree".into(),
///     columns: vec!["frame".into()],
///     rows: vec![SheetRow { label: "eye at the centre".into(), cells: vec![cell] }],
/// };
/// assert!(sheet.compose().unwrap().width() > 320);
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sheet {
    /// Above everything.
    pub title: String,
    /// A title above each column; columns beyond its end have none.
    pub columns: Vec<String>,
    /// From top to bottom.
    pub rows: Vec<SheetRow>,
}

/// A row of a [`Sheet`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SheetRow {
    /// Above the pictures of the row.
    pub label: String,
    /// From left to right; rows may differ in length, pictures in size.
    pub cells: Vec<SheetCell>,
}

/// A picture of a [`Sheet`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SheetCell {
    /// Shown pixel by pixel.
    pub image: RgbImage,
    /// Below the picture, broken into lines of the column's width.
    pub caption: String,
}

/// Why a sheet could not be composed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SheetError {
    /// The sheet would be larger than an image that other programs open.
    #[error("a sheet of {width}x{height} pixels is larger than {MAX_SIDE_PX} pixels a side")]
    TooLarge {
        /// Width of the sheet, pixels.
        width: u64,
        /// Height of the sheet, pixels.
        height: u64,
    },
}

/// Largest width and height of a sheet, pixels: what JPEG and most viewers can hold.
pub const MAX_SIDE_PX: u64 = 65_535;

/// Neither white nor black, so that the border of a picture shows.
const PAPER: Rgb<u8> = Rgb([236, 236, 234]);
const INK: Rgb<u8> = Rgb([24, 24, 28]);
const FAINT_INK: Rgb<u8> = Rgb([76, 76, 84]);

/// A column is at least so many times as wide as captions are high, so that captions of thumbnails stay legible.
const MIN_COLUMN: f64 = 8.0;
/// Text grows by [`TEXT_PX`] for every so many pixels of the widest picture.
const PX_PER_TEXT_SCALE: u32 = 300;
/// The least size of captions, pixels; titles are half as large again.
const TEXT_PX: f64 = 12.0;

/// How a text is written.
#[derive(Clone, Copy, Debug, PartialEq)]
struct TextStyle {
    size: f64,
    color: Rgb<u8>,
}

impl Sheet {
    /// The sheet as one image on light paper.
    ///
    /// # Errors
    /// When a side would be longer than [`MAX_SIDE_PX`].
    pub fn compose(&self) -> Result<RgbImage, SheetError> {
        let layout = Layout::new(self);
        let (width, height) = (layout.width(), layout.draw(self, None));
        if width > MAX_SIDE_PX || height > MAX_SIDE_PX {
            return Err(SheetError::TooLarge { width, height });
        }
        let mut image = RgbImage::from_pixel(width as u32, height as u32, PAPER);
        layout.draw(self, Some(&mut image));
        Ok(image)
    }

    fn cells(&self) -> impl Iterator<Item = &SheetCell> {
        self.rows.iter().flat_map(|row| &row.cells)
    }
}

/// Sizes that are the same all over a sheet.
struct Layout {
    title: TextStyle,
    heading: TextStyle,
    caption: TextStyle,
    /// Around the sheet and between pictures, pixels.
    gap: u64,
    /// Left edge and width of each column, pixels.
    columns: Vec<(u64, u64)>,
}

impl Layout {
    fn new(sheet: &Sheet) -> Self {
        let widest = sheet.cells().map(|cell| cell.image.width()).max().unwrap_or(0);
        let scale = (widest / PX_PER_TEXT_SCALE).clamp(1, 8);
        let size = TEXT_PX * f64::from(scale);
        let caption = TextStyle { size, color: FAINT_INK };
        let gap = 8 * u64::from(scale);
        let count = sheet.rows.iter().map(|row| row.cells.len()).max().unwrap_or(0).max(sheet.columns.len()).max(1);
        let mut left = gap;
        let columns = (0..count)
            .map(|column| {
                let widths = sheet.rows.iter().filter_map(|row| row.cells.get(column)).map(|cell| cell.image.width());
                let least = (MIN_COLUMN * caption.size) as u64;
                let width = u64::from(widths.max().unwrap_or(0)).max(least);
                let place = (left, width);
                left += width + gap;
                place
            })
            .collect();
        let heading = TextStyle { size, color: INK };
        Self { title: TextStyle { size: 1.5 * size, color: INK }, heading, caption, gap, columns }
    }

    /// Width of the sheet, pixels.
    fn width(&self) -> u64 {
        self.columns.last().map_or(0, |(left, width)| left + width) + self.gap
    }

    /// Draws the sheet, or only measures it without a canvas; returns its height in pixels. One walk for both, so
    /// that what is measured is what is drawn.
    fn draw(&self, sheet: &Sheet, mut canvas: Option<&mut RgbImage>) -> u64 {
        let whole_width = self.width() - 2 * self.gap;
        let mut y = self.gap;
        y += self.above(self.text(&mut canvas, &self.title, (self.gap, y), whole_width, &sheet.title));
        let titles = self.columns.iter().zip(&sheet.columns);
        let heights =
            titles.map(|(&(left, width), title)| self.text(&mut canvas, &self.heading, (left, y), width, title));
        y += self.above(heights.max().unwrap_or(0));
        for row in &sheet.rows {
            y += self.text(&mut canvas, &self.heading, (self.gap, y), whole_width, &row.label);
            y += self.cells(row, y, &mut canvas) + self.gap;
        }
        if sheet.rows.is_empty() { y + self.gap } else { y }
    }

    /// The height of a text that stands apart from what is below it.
    fn above(&self, text_height: u64) -> u64 {
        if text_height > 0 { text_height + self.gap / 2 } else { 0 }
    }

    /// Draws the pictures and captions of a row from `top` down; returns their height.
    fn cells(&self, row: &SheetRow, top: u64, canvas: &mut Option<&mut RgbImage>) -> u64 {
        let picture_height = row.cells.iter().map(|cell| u64::from(cell.image.height())).max().unwrap_or(0);
        let caption_top = top + picture_height + self.gap / 4;
        let mut caption_height = 0;
        for (cell, &(left, width)) in row.cells.iter().zip(&self.columns) {
            if let Some(canvas) = canvas.as_deref_mut() {
                imageops::replace(canvas, &cell.image, left as i64, top as i64);
            }
            let height = self.text(canvas, &self.caption, (left, caption_top), width, &cell.caption);
            caption_height = caption_height.max(height);
        }
        caption_top - top + caption_height
    }

    /// Draws a text, broken into lines of at most `width` pixels; returns its height, 0 for an empty text.
    fn text(
        &self,
        canvas: &mut Option<&mut RgbImage>,
        style: &TextStyle,
        (left, top): (u64, u64),
        width: u64,
        text: &str,
    ) -> u64 {
        let lines = lines(text, |line| letters::width_px(line, style.size) <= width as f64);
        let line_height = u64::from(letters::line_height_px(style.size));
        if let Some(canvas) = canvas.as_deref_mut() {
            for (line, y) in lines.iter().zip((top..).step_by(line_height as usize)) {
                // Composed only when both sides are at most MAX_SIDE_PX.
                letters::draw(canvas, [left as u32, y as u32], style.size, style.color, line);
            }
        }
        lines.len() as u64 * line_height
    }
}

/// Breaks a text at its line ends and, so that lines fit, at spaces; a word that does not fit is broken anywhere.
fn lines(text: &str, fits: impl Fn(&str) -> bool) -> Vec<String> {
    let mut lines = Vec::new();
    for paragraph in text.lines() {
        let mut line = String::new();
        for word in paragraph.split_whitespace() {
            let longer = if line.is_empty() { word.to_owned() } else { format!("{line} {word}") };
            if fits(&longer) {
                line = longer;
                continue;
            }
            if !line.is_empty() {
                lines.push(std::mem::take(&mut line));
            }
            for character in word.chars() {
                line.push(character);
                if !fits(&line) && line.chars().count() > 1 {
                    line.pop();
                    lines.push(std::mem::replace(&mut line, character.to_string()));
                }
            }
        }
        lines.push(line);
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(width: u32, height: u32, shade: u8, caption: &str) -> SheetCell {
        SheetCell { image: RgbImage::from_pixel(width, height, Rgb([shade; 3])), caption: caption.into() }
    }

    fn sheet(rows: Vec<Vec<SheetCell>>) -> Sheet {
        let rows = rows.into_iter().map(|cells| SheetRow { label: String::new(), cells }).collect();
        Sheet { rows, ..Sheet::default() }
    }

    #[test]
    fn every_picture_is_whole_and_none_overlap() {
        let sheet = sheet(vec![vec![cell(100, 30, 1, "a"), cell(130, 50, 2, "")], vec![cell(150, 20, 3, "b b")]]);
        let image = sheet.compose().unwrap();
        let area = |shade| image.pixels().filter(|pixel| pixel.0 == [shade; 3]).count();
        assert_eq!([1, 2, 3].map(area), [3000, 6500, 3000]);
        // Columns: 150 and 130 wide; three gaps of 8.
        assert_eq!(image.width(), 8 + 150 + 8 + 130 + 8);
        assert_eq!(image[(8, 8)].0, [1; 3], "without a title the pictures start at the margin");
        assert_eq!(image[(8 + 150 + 8, 8)].0, [2; 3]);
    }

    #[test]
    fn texts_take_room_only_where_they_are() {
        let bare = sheet(vec![vec![cell(200, 40, 0, ""), cell(200, 40, 0, "")]]);
        let height = |sheet: &Sheet| sheet.compose().unwrap().height();
        let line = letters::line_height_px(TEXT_PX);
        let mut titled = bare.clone();
        titled.columns = vec![String::new(), "truth".into()];
        assert_eq!(height(&titled), height(&bare) + line + 4, "a title stands half a gap apart");
        titled.rows[0].label = "row".into();
        titled.rows[0].cells[0].caption = "two\nlines".into();
        assert_eq!(height(&titled), height(&bare) + 4 * line + 4);
    }

    #[test]
    fn text_scales_with_the_pictures() {
        assert_eq!(Layout::new(&sheet(vec![vec![cell(100, 9, 0, "")]])).caption.size, TEXT_PX);
        assert_eq!(Layout::new(&sheet(vec![vec![cell(1024, 9, 0, "")]])).caption.size, 3.0 * TEXT_PX);
    }

    #[test]
    fn lines_break_at_spaces_and_inside_long_words() {
        let lines = |text: &str, most: usize| lines(text, |line| line.chars().count() <= most);
        assert_eq!(lines("FLIP 0.051  PSNR 31.2 dB", 12), ["FLIP 0.051", "PSNR 31.2 dB"]);
        assert_eq!(lines("a abcdefgh b", 3), ["a", "abc", "def", "gh", "b"]);
        assert_eq!(lines("ab\n\ncd", 3), ["ab", "", "cd"]);
        assert_eq!(lines("ab", 0), ["a", "b"], "a letter that does not fit is a line");
        assert!(lines("", 5).is_empty());
    }

    #[test]
    fn odd_sheets_are_composed_or_refused() {
        assert!(Sheet::default().compose().unwrap().width() > 0);
        assert!(sheet(vec![vec![], vec![cell(0, 0, 0, "empty picture")]]).compose().is_ok());
        let wide = sheet(vec![vec![cell(40_000, 1, 0, ""), cell(40_000, 1, 0, "")]]);
        assert!(matches!(wide.compose(), Err(SheetError::TooLarge { width, .. }) if width > 80_000));
    }
}
