//! Decoder of buffer views that `EXT_meshopt_compression` or `KHR_meshopt_compression` compresses,
//! written after appendices A and B of those extensions.

use serde::Deserialize;

/// Number of elements that share the header bits of a byte position.
const GROUP: usize = 16;
/// Number of entries of the two queues of triangle mode.
const FIFO: usize = 16;

/// The extension's object in a buffer view.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct CompressedView {
    /// Index of the buffer with the compressed bytes.
    pub(super) buffer: usize,
    #[serde(default)]
    pub(super) byte_offset: usize,
    pub(super) byte_length: usize,
    byte_stride: usize,
    count: usize,
    mode: Mode,
    #[serde(default)]
    filter: Filter,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
enum Mode {
    Attributes,
    Triangles,
    Indices,
    /// A mode of a later version.
    #[serde(other)]
    Unknown,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
enum Filter {
    #[default]
    None,
    Octahedral,
    Quaternion,
    Exponential,
    Color,
    /// A filter of a later version.
    #[serde(other)]
    Unknown,
}

impl CompressedView {
    /// Decodes the bytes of the view: `count` elements of `byte_stride` bytes. Returns `None` if
    /// they are malformed.
    pub(super) fn decode(&self, bytes: &[u8]) -> Option<Vec<u8>> {
        let (count, stride) = (self.count, self.byte_stride);
        match (self.mode, self.filter) {
            (Mode::Attributes, filter) => {
                let mut values = attributes(bytes, count, stride)?;
                apply_filter(filter, &mut values, stride)?;
                Some(values)
            }
            (_, Filter::None) => {
                let indices = match self.mode {
                    Mode::Triangles => triangles(bytes, count)?,
                    Mode::Indices => index_sequence(bytes, count)?,
                    Mode::Attributes | Mode::Unknown => return None,
                };
                match stride {
                    2 => Some(
                        indices
                            .iter()
                            .flat_map(|&i| (i as u16).to_le_bytes())
                            .collect(),
                    ),
                    4 => Some(indices.iter().flat_map(|i| i.to_le_bytes()).collect()),
                    _ => None,
                }
            }
            _ => None,
        }
    }
}

/// Takes `length` bytes from the front.
fn take<'a>(bytes: &mut &'a [u8], length: usize) -> Option<&'a [u8]> {
    let (front, rest) = bytes.split_at_checked(length)?;
    *bytes = rest;
    Some(front)
}

fn take_byte(bytes: &mut &[u8]) -> Option<u8> {
    take(bytes, 1).map(|byte| byte[0])
}

/// Takes a number of seven bits a byte (LEB128), at most five bytes.
fn take_varint(bytes: &mut &[u8]) -> Option<u32> {
    let mut value = 0;
    for shift in (0..35).step_by(7) {
        let byte = take_byte(bytes)?;
        value |= u32::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return Some(value);
        }
    }
    None
}

fn unzigzag(value: u32) -> u32 {
    (value >> 1) ^ (value & 1).wrapping_neg()
}

/// Decodes mode 0: `count` elements of `stride` bytes.
fn attributes(bytes: &[u8], count: usize, stride: usize) -> Option<Vec<u8>> {
    let (&header, body) = bytes.split_first()?;
    let is_version_1 = match header {
        0xa0 => false,
        0xa1 => true,
        _ => return None,
    };
    if stride == 0 || stride > 256 || !stride.is_multiple_of(4) {
        return None;
    }
    let channels = stride / 4;
    let (tail, padded_tail) = if is_version_1 {
        (stride + channels, 24)
    } else {
        (stride, 32)
    };
    let mut data = body.get(..body.len().checked_sub(tail.max(padded_tail))?)?;
    let (baseline, modes) = body[body.len() - tail..].split_at(stride);
    let block = ((8192 / stride) & !(GROUP - 1)).min(256);
    // Least size of the blocks: two bits for each byte position of a group, or in version 1 two
    // bits for each byte position of a block. What is allocated follows the size of the file.
    let least = match is_version_1 {
        true => count.div_ceil(block).checked_mul(channels)?,
        false => count.div_ceil(4 * GROUP).checked_mul(stride)?,
    };
    if least > data.len() {
        return None;
    }
    let mut elements = vec![0; count.checked_mul(stride)?];
    let mut previous = baseline.to_vec();
    for chunk in elements.chunks_mut(block * stride) {
        let n = chunk.len() / stride;
        let controls = match is_version_1 {
            true => Some(take(&mut data, channels)?),
            false => None,
        };
        for channel in 0..channels {
            let mut deltas = [const { Vec::new() }; 4];
            for (byte, deltas) in deltas.iter_mut().enumerate() {
                let control = controls.map(|controls| controls[channel] >> (2 * byte) & 3);
                *deltas = byte_deltas(&mut data, n, control)?;
            }
            let mode = modes.get(channel).copied().unwrap_or(0);
            let last = &mut previous[4 * channel..][..4];
            for i in 0..n {
                let delta: [u8; 4] = std::array::from_fn(|byte| deltas[byte][i]);
                let value = add_delta(mode, [last[0], last[1], last[2], last[3]], delta)?;
                last.copy_from_slice(&value);
                chunk[i * stride + 4 * channel..][..4].copy_from_slice(&value);
            }
        }
    }
    data.is_empty().then_some(elements)
}

/// Adds a delta to the four bytes of a channel.
fn add_delta(mode: u8, previous: [u8; 4], delta: [u8; 4]) -> Option<[u8; 4]> {
    match mode {
        0 => Some(std::array::from_fn(|i| {
            previous[i].wrapping_add(unzigzag(delta[i].into()) as u8)
        })),
        1 => {
            let half = |bytes: [u8; 4], i: usize| u16::from_le_bytes([bytes[i], bytes[i + 1]]);
            let sum = |i| {
                let delta = unzigzag(half(delta, i).into()) as u16;
                half(previous, i).wrapping_add(delta).to_le_bytes()
            };
            let ([a, b], [c, d]) = (sum(0), sum(2));
            Some([a, b, c, d])
        }
        _ if mode & 15 == 2 => {
            let delta = u32::from_le_bytes(delta).rotate_left((mode >> 4).into());
            Some((u32::from_le_bytes(previous) ^ delta).to_le_bytes())
        }
        _ => None,
    }
}

/// Decodes the deltas of `n` elements at one byte position; `control` is absent in version 0.
fn byte_deltas(data: &mut &[u8], n: usize, control: Option<u8>) -> Option<Vec<u8>> {
    let widths = match control {
        None => [0, 2, 4, 8],
        Some(0) => [0, 1, 2, 4],
        Some(1) => [1, 2, 4, 8],
        Some(2) => return Some(vec![0; n]),
        Some(_) => return Some(take(data, n)?.to_vec()),
    };
    let groups = n.div_ceil(GROUP);
    let header = take(data, groups.div_ceil(4))?;
    let mut deltas = Vec::with_capacity(groups * GROUP);
    for group in 0..groups {
        match widths[usize::from(header[group / 4] >> (2 * (group % 4)) & 3)] {
            0 => deltas.extend([0; GROUP]),
            8 => deltas.extend(take(data, GROUP)?),
            width => {
                let packed = take(data, GROUP * width / 8)?;
                let sentinel = (1 << width) - 1;
                for i in 0..GROUP {
                    let bit = i * width % 8;
                    // Single bits are stored from the least significant one, others from the most.
                    let shift = if width == 1 { bit } else { 8 - width - bit };
                    let value = packed[i * width / 8] >> shift & sentinel;
                    deltas.push(if value == sentinel {
                        take_byte(data)?
                    } else {
                        value
                    });
                }
            }
        }
    }
    Some(deltas)
}

/// Queue of the last [`FIFO`] entries.
struct Fifo<T> {
    entries: [Option<T>; FIFO],
    next: usize,
}

impl<T: Copy> Fifo<T> {
    fn new() -> Self {
        Self {
            entries: [None; FIFO],
            next: 0,
        }
    }

    fn push(&mut self, entry: T) {
        self.entries[self.next] = Some(entry);
        self.next = (self.next + 1) % FIFO;
    }

    /// Returns the entry of the given age, 0 for the most recent one.
    fn get(&self, age: usize) -> Option<T> {
        self.entries[(self.next + 2 * FIFO - 1 - age) % FIFO]
    }
}

/// Decodes mode 1: a list of triangles of `count` indices.
fn triangles(bytes: &[u8], count: usize) -> Option<Vec<u32>> {
    let body = bytes.strip_prefix(&[0xe1])?;
    let (body, table) = body.split_at_checked(body.len().checked_sub(16)?)?;
    if !count.is_multiple_of(3) {
        return None;
    }
    let (codes, mut data) = body.split_at_checked(count / 3)?;
    let mut indices = Vec::with_capacity(count);
    let mut edges = Fifo::new();
    let mut vertices = Fifo::new();
    let (mut next, mut last) = (0_u32, 0_u32);
    let new_vertex = |next: &mut u32| {
        let vertex = *next;
        *next = next.wrapping_add(1);
        vertex
    };
    for &code in codes {
        let (x, y) = (usize::from(code >> 4), usize::from(code & 15));
        let triangle = if x < 15 {
            let [a, b] = edges.get(x)?;
            let c = match y {
                0 => new_vertex(&mut next),
                1..=12 => vertices.get(y)?,
                _ => {
                    let delta = match y {
                        13 => u32::MAX,
                        14 => 1,
                        _ => unzigzag(take_varint(&mut data)?),
                    };
                    last = last.wrapping_add(delta);
                    last
                }
            };
            if !(1..=12).contains(&y) {
                vertices.push(c);
            }
            [a, b, c]
        } else {
            let is_explicit = y >= 14;
            let pair = if is_explicit {
                take_byte(&mut data)?
            } else {
                table[y]
            };
            if is_explicit && pair == 0 {
                next = 0;
            }
            let references = [if y == 15 { 15 } else { 0 }, pair >> 4, pair & 15];
            let mut triangle = [0; 3];
            let mut is_new = [true; 3];
            for (i, reference) in references.into_iter().enumerate() {
                triangle[i] = match reference {
                    0 => new_vertex(&mut next),
                    15 if !is_explicit => return None,
                    15 => {
                        last = last.wrapping_add(unzigzag(take_varint(&mut data)?));
                        last
                    }
                    age => {
                        is_new[i] = false;
                        vertices.get(usize::from(age) - 1)?
                    }
                };
            }
            edges.push([triangle[1], triangle[0]]);
            for (vertex, _) in triangle.into_iter().zip(is_new).filter(|&(_, new)| new) {
                vertices.push(vertex);
            }
            triangle
        };
        let [a, b, c] = triangle;
        edges.push([c, b]);
        edges.push([a, c]);
        indices.extend(triangle);
    }
    data.is_empty().then_some(indices)
}

/// Decodes mode 2: `count` indices without topology.
fn index_sequence(bytes: &[u8], count: usize) -> Option<Vec<u32>> {
    let body = bytes.strip_prefix(&[0xd1])?;
    let mut data = body.get(..body.len().checked_sub(4)?)?;
    if count > data.len() {
        return None;
    }
    let mut last = [0_u32; 2];
    let mut indices = Vec::with_capacity(count);
    for _ in 0..count {
        let value = take_varint(&mut data)?;
        let baseline = &mut last[value as usize & 1];
        *baseline = baseline.wrapping_add(unzigzag(value >> 1));
        indices.push(*baseline);
    }
    data.is_empty().then_some(indices)
}

/// Applies a filter of appendix B to elements of `stride` bytes.
fn apply_filter(filter: Filter, bytes: &mut [u8], stride: usize) -> Option<()> {
    match (filter, stride) {
        (Filter::None, _) => {}
        (Filter::Octahedral, 4) => map_bytes(bytes, |v| {
            octahedral(v.map(|c| c.cast_signed().into()), 127.0)
        }),
        (Filter::Octahedral, 8) => map_shorts(bytes, |v| {
            octahedral(v.map(|c| c.cast_signed().into()), 32_767.0)
        }),
        (Filter::Quaternion, 8) => map_shorts(bytes, |v| quaternion(v.map(u16::cast_signed))),
        (Filter::Color, 4) => map_bytes(bytes, |[y, co, cg, alpha]| {
            ycocg(
                [
                    y.into(),
                    co.cast_signed().into(),
                    cg.cast_signed().into(),
                    alpha.into(),
                ],
                255.0,
            )
        }),
        (Filter::Color, 8) => map_shorts(bytes, |[y, co, cg, alpha]| {
            ycocg(
                [
                    y.into(),
                    co.cast_signed().into(),
                    cg.cast_signed().into(),
                    alpha.into(),
                ],
                65_535.0,
            )
        }),
        (Filter::Exponential, _) => {
            for word in bytes.as_chunks_mut::<4>().0 {
                let value = i32::from_le_bytes(*word);
                let mantissa = f64::from(value << 8 >> 8);
                *word = ((mantissa * f64::from(value >> 24).exp2()) as f32).to_le_bytes();
            }
        }
        _ => return None,
    }
    Some(())
}

fn map_bytes(bytes: &mut [u8], decode: impl Fn([u8; 4]) -> [f32; 4]) {
    for element in bytes.as_chunks_mut::<4>().0 {
        *element = decode(*element).map(|c| c.round() as i32 as u8);
    }
}

fn map_shorts(bytes: &mut [u8], decode: impl Fn([u16; 4]) -> [f32; 4]) {
    for element in bytes.as_chunks_mut::<8>().0 {
        let [a, b, c, d, e, f, g, h] = *element;
        let shorts = [[a, b], [c, d], [e, f], [g, h]].map(u16::from_le_bytes);
        let [x, y, z, w] = decode(shorts).map(|c| (c.round() as i32 as u16).to_le_bytes());
        *element = [x[0], x[1], y[0], y[1], z[0], z[1], w[0], w[1]];
    }
}

/// Decodes filter 1: a unit vector; `greatest` is 1.0 in the output.
fn octahedral([x, y, one, w]: [i32; 4], greatest: f32) -> [f32; 4] {
    let one = one as f32;
    let (mut x, mut y) = (x as f32 / one, y as f32 / one);
    let z = 1.0 - x.abs() - y.abs();
    let folded = z.min(0.0);
    x -= folded.copysign(x);
    y -= folded.copysign(y);
    let scale = greatest / (x * x + y * y + z * z).sqrt();
    [x * scale, y * scale, z * scale, w as f32]
}

/// Decodes filter 2: a unit quaternion without its largest component.
fn quaternion([x, y, z, scale]: [i16; 4]) -> [f32; 4] {
    let one = f32::from(scale | 3);
    let [x, y, z] = [x, y, z].map(|c| f32::from(c) / one * std::f32::consts::FRAC_1_SQRT_2);
    let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    let largest = usize::from(scale.cast_unsigned() & 3);
    let mut quaternion = [0.0; 4];
    for (i, component) in [w, x, y, z].into_iter().enumerate() {
        quaternion[(largest + i) % 4] = component * 32_767.0;
    }
    quaternion
}

/// Decodes filter 4: a colour as Y, Co, Cg and alpha; `greatest` is 1.0 in the output.
fn ycocg([y, co, cg, alpha]: [i32; 4], greatest: f32) -> [f32; 4] {
    // The most significant bit of alpha is that above its value.
    let one = (1_i64 << (32 - (alpha as u32).leading_zeros())) - 1;
    let scale = greatest / (one.max(1) as f32);
    let alpha = alpha & (one >> 1) as i32;
    let alpha = alpha << 1 | alpha & 1;
    [y + co - cg, y + cg, y - co - cg, alpha].map(|c| c as f32 * scale)
}
