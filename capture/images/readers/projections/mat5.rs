//! Numeric variables of MATLAB files, version 5 (`-v6`) and 7 (`-v7`, compressed elements).
//!
//! Layout: "MAT-File Format", The MathWorks. A file is a header of 128 bytes and elements with a
//! tag of type and length. Only real numeric arrays, and cell arrays of them, are read; other
//! variables are skipped.

use flate2::read::ZlibDecoder;
use std::io::Read;

/// Length of the header, bytes.
const HEADER: usize = 128;

/// Maximum length of a decompressed element, bytes: projection matrices of 600,000 images.
const MAX_ELEMENT: u64 = 64 << 20;

/// Types of elements.
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;

/// Class of cell arrays, and the classes of numeric arrays (from double to 32-bit integers).
const CELL: u32 = 1;
const NUMERIC: std::ops::RangeInclusive<u32> = 6..=13;

/// Flag of complex arrays.
const COMPLEX: u32 = 0x800;

/// Real numeric array.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Array {
    /// Lengths along its dimensions.
    pub(super) dimensions: Vec<usize>,
    /// Values, first dimension fastest (by columns).
    pub(super) values: Vec<f64>,
}

/// Value of a variable.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    /// A real numeric array.
    Numeric(Array),
    /// A cell array of numeric arrays.
    Cells(Vec<Array>),
}

/// Reads the variable called `name`; `None` if the file has none of real numbers.
///
/// # Errors
/// The problem, as the rest of a sentence about the file.
pub(super) fn read_variable(bytes: &[u8], name: &str) -> Result<Option<Value>, String> {
    if bytes.starts_with(b"MATLAB 7.3") || bytes.starts_with(b"\x89HDF") {
        return Err("is a MATLAB 7.3 (HDF5) file; save it again with -v7".into());
    }
    let is_big_endian = match bytes.get(HEADER - 2..HEADER) {
        Some(b"IM") => false,
        Some(b"MI") => true,
        _ => return Err("not a MATLAB 5 file".into()),
    };
    let mut elements = Elements {
        bytes: &bytes[HEADER..],
        is_big_endian,
    };
    while let Some(element) = elements.take_next()? {
        let value = if element.kind == COMPRESSED {
            let inflated = inflate(element.bytes)?;
            let mut inner = Elements {
                bytes: &inflated,
                is_big_endian,
            };
            match inner.take_next()? {
                Some(element) => read_named(&element, name, is_big_endian)?,
                None => None,
            }
        } else {
            read_named(&element, name, is_big_endian)?
        };
        if value.is_some() {
            return Ok(value);
        }
    }
    Ok(None)
}

fn inflate(bytes: &[u8]) -> Result<Vec<u8>, String> {
    let mut inflated = Vec::new();
    ZlibDecoder::new(bytes)
        .take(MAX_ELEMENT + 1)
        .read_to_end(&mut inflated)
        .map_err(|cause| format!("has a damaged compressed element ({cause})"))?;
    if inflated.len() as u64 > MAX_ELEMENT {
        return Err("has a compressed element of more than 64 MB".into());
    }
    Ok(inflated)
}

/// Returns the value of a matrix element if it has this name and is numeric.
fn read_named(
    element: &Element<'_>,
    name: &str,
    is_big_endian: bool,
) -> Result<Option<Value>, String> {
    if element.kind != MATRIX {
        return Ok(None);
    }
    let matrix = Matrix::read(element.bytes, is_big_endian)?;
    if matrix.name != name.as_bytes() {
        return Ok(None);
    }
    if matrix.class != CELL {
        return Ok(matrix.into_array()?.map(Value::Numeric));
    }
    let mut contents = matrix.contents;
    let mut cells = Vec::new();
    while let Some(cell) = contents.take_next()? {
        if cell.kind != MATRIX {
            return Err("has a cell that is not an array".into());
        }
        let array = Matrix::read(cell.bytes, is_big_endian)?.into_array()?;
        cells.push(array.ok_or("has a cell that is not an array of real numbers")?);
    }
    Ok(Some(Value::Cells(cells)))
}

/// Matrix element without its values.
struct Matrix<'a> {
    class: u32,
    is_complex: bool,
    dimensions: Vec<usize>,
    name: &'a [u8],
    /// Elements after the name.
    contents: Elements<'a>,
}

impl<'a> Matrix<'a> {
    fn read(bytes: &'a [u8], is_big_endian: bool) -> Result<Self, String> {
        let mut contents = Elements {
            bytes,
            is_big_endian,
        };
        let mut next = || {
            contents
                .take_next()?
                .ok_or_else(|| "ends within an array".to_owned())
        };
        let flags = next()?.numbers(is_big_endian)?;
        let dimensions = next()?.numbers(is_big_endian)?;
        let name = next()?.bytes;
        let flags = *flags.first().ok_or("has an array without flags")? as u32;
        Ok(Self {
            class: flags & 0xff,
            is_complex: flags & COMPLEX != 0,
            dimensions: dimensions.iter().map(|length| *length as usize).collect(),
            name,
            contents,
        })
    }

    /// The array; `None` if it is not of real numbers.
    fn into_array(mut self) -> Result<Option<Array>, String> {
        if !NUMERIC.contains(&self.class) || self.is_complex {
            return Ok(None);
        }
        let is_big_endian = self.contents.is_big_endian;
        let values = match self.contents.take_next()? {
            Some(element) => element.numbers(is_big_endian)?,
            None => Vec::new(),
        };
        let expected = self
            .dimensions
            .iter()
            .try_fold(1usize, |product, length| product.checked_mul(*length));
        if expected != Some(values.len()) {
            return Err(format!(
                "has an array of {:?} values with {} of them",
                self.dimensions,
                values.len()
            ));
        }
        Ok(Some(Array {
            dimensions: self.dimensions,
            values,
        }))
    }
}

/// Element: its type and its bytes.
struct Element<'a> {
    kind: u32,
    bytes: &'a [u8],
}

impl Element<'_> {
    /// The values of a numeric element.
    fn numbers(&self, is_big_endian: bool) -> Result<Vec<f64>, String> {
        macro_rules! values {
            ($kind:ty) => {
                self.bytes
                    .chunks_exact(size_of::<$kind>())
                    .map(|bytes| {
                        let mut array = [0; size_of::<$kind>()];
                        array.copy_from_slice(bytes);
                        if is_big_endian {
                            f64::from(<$kind>::from_be_bytes(array))
                        } else {
                            f64::from(<$kind>::from_le_bytes(array))
                        }
                    })
                    .collect()
            };
        }
        Ok(match self.kind {
            1 => values!(i8),
            2 => values!(u8),
            3 => values!(i16),
            4 => values!(u16),
            5 => values!(i32),
            6 => values!(u32),
            7 => values!(f32),
            9 => values!(f64),
            kind => {
                return Err(format!(
                    "has numbers of type {kind}, which is not supported"
                ));
            }
        })
    }
}

/// Elements that follow each other.
struct Elements<'a> {
    bytes: &'a [u8],
    is_big_endian: bool,
}

impl<'a> Elements<'a> {
    fn word(&self, at: usize) -> Option<u32> {
        let bytes: [u8; 4] = self.bytes.get(at..at + 4)?.try_into().ok()?;
        Some(if self.is_big_endian {
            u32::from_be_bytes(bytes)
        } else {
            u32::from_le_bytes(bytes)
        })
    }

    /// The next element; `None` at the end.
    fn take_next(&mut self) -> Result<Option<Element<'a>>, String> {
        let Some(tag) = self.word(0) else {
            return Ok(None);
        };
        let ends = || "ends within an element".to_owned();
        // Up to four bytes lie within the tag itself, whose upper half is their number.
        let (kind, start, length, padded) = if tag >> 16 != 0 {
            (tag & 0xffff, 4, (tag >> 16) as usize, 8)
        } else {
            let length = self.word(4).ok_or_else(ends)? as usize;
            // Compressed elements are not padded.
            let padded = if tag == COMPRESSED {
                length
            } else {
                length.next_multiple_of(8)
            };
            (tag, 8, length, 8 + padded)
        };
        if start == 4 && length > 4 {
            return Err("has a short element of more than four bytes".into());
        }
        let bytes = self.bytes.get(start..start + length).ok_or_else(ends)?;
        // Some writers leave out the padding of the last element.
        self.bytes = self.bytes.get(padded..).unwrap_or_default();
        Ok(Some(Element { kind, bytes }))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use std::io::Write;

    /// Element with its tag and padding, little-endian.
    fn element(kind: u32, bytes: &[u8]) -> Vec<u8> {
        let mut all = kind.to_le_bytes().to_vec();
        all.extend((bytes.len() as u32).to_le_bytes());
        all.extend(bytes);
        all.resize(all.len().next_multiple_of(8), 0);
        all
    }

    fn matrix(class: u32, dimensions: &[i32], name: &str, contents: &[u8]) -> Vec<u8> {
        let flags = [class.to_le_bytes(), [0; 4]].concat();
        let lengths: Vec<u8> = dimensions.iter().flat_map(|d| d.to_le_bytes()).collect();
        let mut body = [element(6, &flags), element(5, &lengths)].concat();
        if name.len() <= 4 && !name.is_empty() {
            // The short form.
            body.extend((1u32 | (name.len() as u32) << 16).to_le_bytes());
            let mut short = name.as_bytes().to_vec();
            short.resize(4, 0);
            body.extend(short);
        } else {
            body.extend(element(1, name.as_bytes()));
        }
        body.extend(contents);
        element(MATRIX, &body)
    }

    fn doubles(values: &[f64]) -> Vec<u8> {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        element(9, &bytes)
    }

    /// File of elements, each compressed if `is_compressed`.
    fn file(elements: &[Vec<u8>], is_compressed: bool) -> Vec<u8> {
        let mut bytes = vec![b' '; HEADER];
        bytes[..10].copy_from_slice(b"MATLAB 5.0");
        bytes[124..].copy_from_slice(&[0, 1, b'I', b'M']);
        for element in elements {
            if is_compressed {
                let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), Default::default());
                encoder.write_all(element).expect("memory");
                let deflated = encoder.finish().expect("memory");
                bytes.extend(COMPRESSED.to_le_bytes());
                bytes.extend((deflated.len() as u32).to_le_bytes());
                bytes.extend(deflated);
            } else {
                bytes.extend(element);
            }
        }
        bytes
    }

    /// File with a variable `note` and a cell array `P` of 3x4 matrices, by columns.
    pub(in crate::readers) fn cells(matrices: &[[f64; 12]], is_compressed: bool) -> Vec<u8> {
        let cells: Vec<u8> = matrices
            .iter()
            .flat_map(|values| matrix(6, &[3, 4], "", &doubles(values)))
            .collect();
        let note = matrix(6, &[1, 1], "a_longer_name", &doubles(&[7.0]));
        let cells = matrix(CELL, &[1, matrices.len() as i32], "P", &cells);
        file(&[note, cells], is_compressed)
    }

    const A: [f64; 12] = [1., 2., 3., 4., 5., 6., 7., 8., 9., 10., 11., 12.];
    const B: [f64; 12] = [0.5; 12];

    #[test]
    fn cells_read_compressed_or_not() {
        for is_compressed in [false, true] {
            let bytes = cells(&[A, B], is_compressed);
            let Some(Value::Cells(found)) = read_variable(&bytes, "P").expect("reads") else {
                panic!("cells");
            };
            let expected = [A, B].map(|values| Array {
                dimensions: vec![3, 4],
                values: values.to_vec(),
            });
            assert_eq!(found, expected);
            assert_eq!(read_variable(&bytes, "Q"), Ok(None));
        }
    }

    #[test]
    fn stacked_array_of_small_integers_read() {
        let bytes: Vec<u8> = (0..24).collect();
        let stacked = matrix(6, &[3, 4, 2], "P", &element(2, &bytes));
        let Some(Value::Numeric(found)) =
            read_variable(&file(&[stacked], false), "P").expect("reads")
        else {
            panic!("an array");
        };
        assert_eq!(found.dimensions, [3, 4, 2]);
        assert_eq!(found.values[23], 23.0);
    }

    #[test]
    fn damage_is_reported() {
        let whole = cells(&[A, B], false);
        assert!(read_variable(b"MATLAB 7.3 MAT-file", "P").is_err_and(|e| e.contains("-v7")));
        assert!(read_variable(b"plain text", "P").is_err_and(|e| e.contains("not a MATLAB 5")));
        for length in HEADER..whole.len() - 8 {
            // Truncated anywhere: an error, or the variable is not there.
            assert!(
                !matches!(read_variable(&whole[..length], "P"), Ok(Some(_))),
                "{length}"
            );
        }
        let mut compressed = cells(&[A], true);
        let last = compressed.len() - 20;
        compressed[last] ^= 0xff;
        assert!(read_variable(&compressed, "P").is_err_and(|e| e.contains("compressed")));
        let wrong = matrix(6, &[3, 5], "P", &doubles(&A));
        assert!(read_variable(&file(&[wrong], false), "P").is_err());
    }
}
