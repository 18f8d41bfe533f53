//! Header of a PLY: elements with their properties, and comments.

/// Order of the bytes of values, or text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Type {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Type {
    fn parse(word: &str) -> Option<Self> {
        Some(match word {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    /// Size of a binary value, bytes.
    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Value of white in a colour.
    pub(super) fn white(self) -> f64 {
        match self {
            Self::U8 => 255.0,
            Self::U16 => 65_535.0,
            _ => 1.0,
        }
    }
}

/// Property of an element: a number, or a list of numbers after their count.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) count: Option<Type>,
    pub(super) value: Type,
}

/// Kind of records.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Element {
    pub(super) name: String,
    /// Number of records.
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// Returns the index of the property with one of the names.
    pub(super) fn find(&self, names: &[&str]) -> Option<usize> {
        names
            .iter()
            .find_map(|name| self.properties.iter().position(|p| p.name == *name))
    }

    /// Least size of a record, bytes.
    fn least_size(&self, format: Format) -> u64 {
        let size = |property: &Property| match format {
            Format::Ascii => 2, // a digit and a space
            _ => property.count.unwrap_or(property.value).size() as u64,
        };
        self.properties.iter().map(size).sum()
    }
}

/// Header of a PLY.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) format: Format,
    pub(super) elements: Vec<Element>,
    /// Names of image files in `TextureFile` comments.
    pub(super) textures: Vec<String>,
    /// Comments, a line each.
    pub(super) comments: String,
    /// Offset of the first record, bytes.
    pub(super) end: usize,
}

impl Header {
    /// Parses the header of a file, and checks that the file can hold its elements.
    ///
    /// # Errors
    /// A description of the defect.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, String> {
        let mut header = Self {
            format: Format::Ascii,
            elements: Vec::new(),
            textures: Vec::new(),
            comments: String::new(),
            end: 0,
        };
        let mut format = None;
        for number in 1.. {
            let line = header
                .next_line(bytes)
                .ok_or("its header has no end_header")?;
            let line = String::from_utf8_lossy(line);
            let line = line.trim();
            if number == 1 {
                if line != "ply" {
                    return Err("not a PLY: it does not begin with \"ply\"".into());
                }
                continue;
            }
            match line.split_whitespace().collect::<Vec<_>>().as_slice() {
                ["end_header"] => break,
                ["format", name, _] => {
                    format = match *name {
                        "ascii" => Some(Format::Ascii),
                        "binary_little_endian" => Some(Format::LittleEndian),
                        "binary_big_endian" => Some(Format::BigEndian),
                        _ => None,
                    }
                }
                ["comment", ..] => header.add_comment(line),
                ["obj_info", ..] | [] => {}
                _ => header
                    .add_statement(line)
                    .ok_or_else(|| format!("\"{}\" is not a line of a PLY header", short(line)))?,
            }
        }
        header.format = format.ok_or("its header names no known format")?;
        header.check_counts(bytes.len() - header.end)?;
        Ok(header)
    }

    /// Returns the next line without its end, which is a line feed, a carriage return or both.
    fn next_line<'a>(&mut self, bytes: &'a [u8]) -> Option<&'a [u8]> {
        let rest = &bytes[self.end..];
        let length = rest.iter().position(|b| matches!(b, b'\n' | b'\r'))?;
        let ends = if rest[length..].starts_with(b"\r\n") {
            2
        } else {
            1
        };
        self.end += length + ends;
        Some(&rest[..length])
    }

    fn add_comment(&mut self, line: &str) {
        let text = line["comment".len()..].trim();
        let is_texture = text
            .get(..11)
            .is_some_and(|word| word.eq_ignore_ascii_case("TextureFile"));
        if is_texture {
            self.textures.push(text[11..].trim().to_owned());
        }
        self.comments += text;
        self.comments.push('\n');
    }

    /// Adds an element or a property; `None` if the line is neither.
    fn add_statement(&mut self, line: &str) -> Option<()> {
        let words: Vec<&str> = line.split_whitespace().collect();
        let property = |name: &str, count, value| {
            Some(Property {
                name: name.to_owned(),
                count,
                value: Type::parse(value)?,
            })
        };
        let property = match *words.as_slice() {
            ["element", name, count] => {
                self.elements.push(Element {
                    name: name.to_owned(),
                    count: count.parse().ok()?,
                    properties: Vec::new(),
                });
                return Some(());
            }
            ["property", "list", count, value, name] => {
                property(name, Some(Type::parse(count)?), value)?
            }
            ["property", value, name] => property(name, None, value)?,
            _ => return None,
        };
        self.elements.last_mut()?.properties.push(property);
        Some(())
    }

    fn check_counts(&self, size: usize) -> Result<(), String> {
        let mut least = 0_u64;
        for element in &self.elements {
            let bytes = element.count.checked_mul(element.least_size(self.format));
            least = least.saturating_add(bytes.unwrap_or(u64::MAX));
            // The last number of a text needs no space.
            if least > size as u64 + 1 {
                return Err(format!(
                    "its header declares {} records of the element \"{}\", more than its {size} \
                     bytes of data can hold; the file is damaged or incomplete",
                    element.count, element.name
                ));
            }
        }
        Ok(())
    }
}

fn short(line: &str) -> String {
    line.chars().take(80).collect()
}
