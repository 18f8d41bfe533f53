//! Markdown tables and number formats.

use std::fmt::{Display, Formatter, Result};

/// A Markdown table.
#[derive(Clone, Debug)]
pub struct Table {
    text: String,
}

impl Table {
    /// Creates a table without rows.
    pub fn new<S: AsRef<str>>(header: impl IntoIterator<Item = S>) -> Self {
        let mut table = Self {
            text: String::new(),
        };
        let columns = table.line(header);
        table.line(std::iter::repeat_n("---", columns));
        table
    }

    /// Adds a row.
    pub fn row<S: AsRef<str>>(&mut self, cells: impl IntoIterator<Item = S>) {
        self.line(cells);
    }

    /// Writes a line of the table; returns the number of cells.
    fn line<S: AsRef<str>>(&mut self, cells: impl IntoIterator<Item = S>) -> usize {
        self.text.push('|');
        let mut columns = 0;
        for cell in cells {
            // Escaped: a bar would end the cell.
            self.text += &format!(" {} |", cell.as_ref().replace('|', "\\|"));
            columns += 1;
        }
        self.text.push('\n');
        columns
    }
}

impl Display for Table {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        f.write_str(&self.text)
    }
}

/// Formats a number with three significant digits, fewer if it is small.
pub fn figure(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        size if !size.is_finite() => "not measurable".into(),
        size if !(0.001..1e7).contains(&size) => format!("{value:.1e}"),
        size if size >= 100.0 => format!("{value:.0}"),
        size if size >= 10.0 => format!("{value:.1}"),
        size if size >= 0.1 => format!("{value:.2}"),
        _ => format!("{value:.3}"),
    }
}

/// Formats a share in percent.
pub fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    if percent < 1.0 {
        format!("{percent:.3} %")
    } else {
        format!("{percent:.1} %")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_has_one_line_per_row() {
        let mut table = Table::new(["a", "b"]);
        table.row(["1", "2|3"]);
        assert_eq!(
            table.to_string(),
            "| a | b |\n| --- | --- |\n| 1 | 2\\|3 |\n"
        );
    }

    #[test]
    fn figures_have_three_digits() {
        let written = [
            0.0,
            123.4,
            12.34,
            1.234,
            0.1234,
            0.001234,
            1.5e-7,
            2e8,
            f64::NAN,
            -3.0,
        ]
        .map(figure);
        assert_eq!(
            written,
            [
                "0",
                "123",
                "12.3",
                "1.23",
                "0.12",
                "0.001",
                "1.5e-7",
                "2.0e8",
                "not measurable",
                "-3.00"
            ]
        );
        assert_eq!([percent(0.001234), percent(0.5)], ["0.123 %", "50.0 %"]);
    }
}
