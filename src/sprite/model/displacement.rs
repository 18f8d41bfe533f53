//! Displacement of the surface off the plane, and its storage formats (S4, C30).

use crate::SpriteError;

/// Storage format of displacements.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub enum DisplacementFormat {
    /// 8 bits with sign: the paper's choice. Half a step is 1/254 of the largest parallax: 0.04 px
    /// at 10 px (C30).
    #[default]
    I8,
    /// 16 bits with sign.
    I16,
    /// 32-bit floating point.
    F32,
}

/// Stored values.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Values {
    I8(Vec<i8>),
    I16(Vec<i16>),
    F32(Vec<f32>),
}

/// Grid of displacements, row-major: signed distance off the plane over eye depth, dimensionless,
/// positive towards the camera. The grid covers the rectangle of the image and may be coarser.
///
/// Invariants: width x height values; all are finite.
#[derive(Clone, Debug, PartialEq)]
pub struct Displacement {
    width: u32,
    height: u32,
    /// Displacement per stored unit; 1 for `F32`.
    scale: f32,
    values: Values,
}

impl Displacement {
    /// Creates a displacement of zero everywhere.
    pub fn zero(width: u32, height: u32) -> Self {
        Self {
            width,
            height,
            scale: 1.0,
            values: Values::I8(vec![0; width as usize * height as usize]),
        }
    }

    /// Stores `values` (row-major) in a format; integer formats use the finest scale that holds the
    /// largest value.
    ///
    /// # Errors
    /// [`SpriteError::Count`] unless there is one value per pixel, [`SpriteError::NotFinite`].
    pub fn new(
        width: u32,
        height: u32,
        values: &[f32],
        format: DisplacementFormat,
    ) -> Result<Self, SpriteError> {
        if values.iter().any(|v| !v.is_finite()) {
            return Err(SpriteError::NotFinite);
        }
        let largest = values.iter().fold(0.0f32, |max, v| max.max(v.abs()));
        // Displacements so small that the scale is subnormal are stored as zero.
        let finest = |steps: f32| Some(largest / steps).filter(|scale| scale.is_normal());
        let (scale, values) = match format {
            DisplacementFormat::I8 => {
                let scale = finest(f32::from(i8::MAX)).unwrap_or(1.0);
                let stored = values.iter().map(|v| (v / scale).round() as i8);
                (scale, Values::I8(stored.collect()))
            }
            DisplacementFormat::I16 => {
                let scale = finest(f32::from(i16::MAX)).unwrap_or(1.0);
                let stored = values.iter().map(|v| (v / scale).round() as i16);
                (scale, Values::I16(stored.collect()))
            }
            DisplacementFormat::F32 => (1.0, Values::F32(values.to_vec())),
        };
        Self::from_stored(width, height, scale, values)
    }

    /// Creates a displacement from stored values, and checks them.
    pub(super) fn from_stored(
        width: u32,
        height: u32,
        scale: f32,
        values: Values,
    ) -> Result<Self, SpriteError> {
        let (found, finite) = match &values {
            Values::I8(v) => (v.len(), true),
            Values::I16(v) => (v.len(), true),
            Values::F32(v) => (v.len(), v.iter().all(|d| d.is_finite())),
        };
        let expected = width as usize * height as usize;
        if found != expected || expected == 0 {
            return Err(SpriteError::Count { expected, found });
        }
        if !finite || scale < 0.0 || !(scale * f32::from(i16::MAX)).is_finite() {
            return Err(SpriteError::NotFinite);
        }
        Ok(Self {
            width,
            height,
            scale,
            values,
        })
    }

    /// Columns and rows.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Storage format.
    pub fn format(&self) -> DisplacementFormat {
        match self.values {
            Values::I8(_) => DisplacementFormat::I8,
            Values::I16(_) => DisplacementFormat::I16,
            Values::F32(_) => DisplacementFormat::F32,
        }
    }

    /// Displacement per stored unit.
    pub fn scale(&self) -> f32 {
        self.scale
    }

    /// Stored values as little-endian bytes.
    pub fn stored_bytes(&self) -> &[u8] {
        match &self.values {
            Values::I8(v) => bytemuck::cast_slice(v),
            Values::I16(v) => bytemuck::cast_slice(v),
            Values::F32(v) => bytemuck::cast_slice(v),
        }
    }

    /// Displacement of the pixel in column `x` of row `y`; 0 outside.
    pub fn at(&self, x: u32, y: u32) -> f32 {
        let index = y as usize * self.width as usize + x as usize;
        let stored = match &self.values {
            Values::I8(v) => v.get(index).map(|&v| f32::from(v)),
            Values::I16(v) => v.get(index).map(|&v| f32::from(v)),
            Values::F32(v) => v.get(index).copied(),
        };
        stored.filter(|_| x < self.width).unwrap_or(0.0) * self.scale
    }

    /// All displacements, row-major.
    pub fn to_f32(&self) -> Vec<f32> {
        let scaled = |stored: f32| stored * self.scale;
        match &self.values {
            Values::I8(v) => v.iter().map(|&v| scaled(f32::from(v))).collect(),
            Values::I16(v) => v.iter().map(|&v| scaled(f32::from(v))).collect(),
            Values::F32(v) => v.clone(),
        }
    }

    /// Returns the displacement at a resolution lower by `factor` (0 counts as 1; sizes are rounded
    /// up): each cell is the mean of the cells that it overlaps.
    ///
    /// # Errors
    /// [`SpriteError::NotFinite`] if the mean of the largest values overflows.
    pub fn reduced(&self, factor: u32) -> Result<Self, SpriteError> {
        let factor = factor.max(1);
        let (width, height) = (self.width.div_ceil(factor), self.height.div_ceil(factor));
        // Range of the `all` finer columns (or rows) that coarse column `i` of `count` overlaps.
        let range = |i: u32, all: u32, count: u32| {
            let edge = |i: u32| u64::from(i) * u64::from(all);
            (
                (edge(i) / u64::from(count)) as u32,
                edge(i + 1).div_ceil(u64::from(count)) as u32,
            )
        };
        let mean = |i: usize| {
            let (x0, x1) = range(i as u32 % width, self.width, width);
            let (y0, y1) = range(i as u32 / width, self.height, height);
            let cells = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y)));
            let sum: f64 = cells.map(|(x, y)| f64::from(self.at(x, y))).sum();
            (sum / (f64::from(x1 - x0) * f64::from(y1 - y0))) as f32
        };
        let values: Vec<f32> = (0..width as usize * height as usize).map(mean).collect();
        Self::new(width, height, &values, self.format())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_hold_values_to_half_a_step() {
        let values: Vec<f32> = (0..600).map(|i| (i as f32 * 0.37).sin() * 0.02).collect();
        for (format, steps) in [
            (DisplacementFormat::I8, 127.0),
            (DisplacementFormat::I16, 32767.0),
        ] {
            let stored = Displacement::new(30, 20, &values, format).expect("finite");
            // A little beyond half a step: the scale itself is rounded.
            let half_step = 0.02 / steps * 0.5 * 1.001;
            assert!(
                stored
                    .to_f32()
                    .iter()
                    .zip(&values)
                    .all(|(a, b)| (a - b).abs() <= half_step + 1e-8)
            );
            assert_eq!(stored.format(), format);
        }
        assert_eq!(
            Displacement::new(30, 20, &values, DisplacementFormat::F32)
                .expect("finite")
                .to_f32(),
            values
        );
    }

    #[test]
    fn bad_values_are_refused() {
        let new = |values: &[f32]| Displacement::new(2, 1, values, DisplacementFormat::I8);
        assert_eq!(
            new(&[0.0]),
            Err(SpriteError::Count {
                expected: 2,
                found: 1
            })
        );
        assert_eq!(new(&[0.0, f32::INFINITY]), Err(SpriteError::NotFinite));
        let nan = Displacement::new(1, 1, &[f32::NAN], DisplacementFormat::F32);
        assert_eq!(nan, Err(SpriteError::NotFinite));
        assert_eq!(new(&[0.0, 1e-42]).expect("tiny").to_f32(), [0.0, 0.0]);
    }

    #[test]
    fn reduction_takes_means() {
        let values = [1.0, 3.0, 5.0, 1.0, 3.0, 7.0];
        let reduced =
            Displacement::new(3, 2, &values, DisplacementFormat::F32).and_then(|d| d.reduced(2));
        let reduced = reduced.expect("finite");
        assert_eq!((reduced.size(), reduced.to_f32()), ((2, 1), vec![2.0, 4.5]));
    }
}
