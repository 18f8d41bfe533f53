//! Faces of a cube and their cameras.

use glam::{DMat3, DVec3, Vec3};

/// Largest side of a cube face or of the environment, pixels.
pub const MAX_FACE_SIZE_PX: u32 = 8192;

/// Face of a cube, which is also the camera that looks through it from the centre.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
pub enum Face {
    /// +X
    PosX,
    /// -X
    NegX,
    /// +Y
    PosY,
    /// -Y
    NegY,
    /// +Z
    PosZ,
    /// -Z
    NegZ,
}

// In the order of their indices.
crate::named_variants!(Face {
    PosX => "+X",
    NegX => "-X",
    PosY => "+Y",
    NegY => "-Y",
    PosZ => "+Z",
    NegZ => "-Z",
});

impl Face {
    /// Index, 0 to 5: the position in [`Self::ALL`].
    pub fn index(self) -> usize {
        self as usize
    }

    /// Outward normal, which is also the viewing direction of the face's camera.
    pub fn normal(self) -> DVec3 {
        [
            DVec3::X,
            DVec3::NEG_X,
            DVec3::Y,
            DVec3::NEG_Y,
            DVec3::Z,
            DVec3::NEG_Z,
        ][self.index()]
    }

    /// Direction that points up in the face's image.
    pub fn up(self) -> DVec3 {
        match self {
            Self::PosY => DVec3::Z,
            Self::NegY => DVec3::NEG_Z,
            _ => DVec3::Y,
        }
    }

    /// Direction that points right in the face's image.
    pub fn right(self) -> DVec3 {
        self.normal().cross(self.up())
    }

    /// Rotation of the face's camera: columns right, up, back.
    pub fn world_from_eye(self) -> DMat3 {
        DMat3::from_cols(self.right(), self.up(), -self.normal())
    }

    /// Returns the face whose frustum contains the point `from_centre` (relative to the centre):
    /// the axis of the largest absolute coordinate; ties go to the lower index.
    pub fn containing(from_centre: DVec3) -> Self {
        let a = from_centre.abs();
        let axis = if a.x >= a.y && a.x >= a.z {
            0
        } else {
            1 + usize::from(a.z > a.y)
        };
        Self::ALL[2 * axis + usize::from(from_centre[axis] < 0.0)]
    }

    /// Returns the face that contains a point (relative to the centre; ties as in
    /// [`Self::containing`]) and the point's coordinates in the face's eye space, as
    /// [`Self::eye_space`].
    #[inline]
    pub fn locate(from_centre: Vec3) -> (Self, [f32; 3]) {
        let Vec3 { x, y, z } = from_centre;
        let a = from_centre.abs();
        let face = if a.x >= a.y && a.x >= a.z {
            if x < 0.0 { Self::NegX } else { Self::PosX }
        } else if a.z > a.y {
            if z < 0.0 { Self::NegZ } else { Self::PosZ }
        } else if y < 0.0 {
            Self::NegY
        } else {
            Self::PosY
        };
        (face, face.eye_space(from_centre))
    }

    /// Returns the coordinates of a point (relative to the centre) in the face's eye space: right,
    /// up, and eye depth. All are exact.
    #[inline]
    pub fn eye_space(self, from_centre: Vec3) -> [f32; 3] {
        let Vec3 { x, y, z } = from_centre;
        match self {
            Self::PosX => [z, y, x],
            Self::NegX => [-z, y, -x],
            Self::PosY => [x, z, y],
            Self::NegY => [x, -z, -y],
            Self::PosZ => [-x, y, z],
            Self::NegZ => [x, y, -z],
        }
    }

    /// Projects a point relative to the centre, which must be in front of the face, to its image of
    /// `size_px` pixels a side: position in pixels (row 0 on top), and eye depth.
    pub fn project(self, from_centre: DVec3, size_px: u32) -> [f64; 3] {
        let eye_depth = from_centre.dot(self.normal());
        let half = f64::from(size_px) / 2.0;
        let x = from_centre.dot(self.right()) / eye_depth;
        let y = from_centre.dot(self.up()) / eye_depth;
        [half * (1.0 + x), half * (1.0 - y), eye_depth]
    }

    /// Returns the direction from the centre through an image position in pixels, scaled to eye
    /// depth 1.
    #[inline]
    pub fn direction(self, x_px: f64, y_px: f64, size_px: u32) -> DVec3 {
        let half = f64::from(size_px) / 2.0;
        let (right, up) = (x_px / half - 1.0, 1.0 - y_px / half);
        // The inverse of [`Self::eye_space`].
        match self {
            Self::PosX => DVec3::new(1.0, up, right),
            Self::NegX => DVec3::new(-1.0, up, -right),
            Self::PosY => DVec3::new(right, 1.0, up),
            Self::NegY => DVec3::new(right, -1.0, -up),
            Self::PosZ => DVec3::new(-right, up, 1.0),
            Self::NegZ => DVec3::new(right, up, -1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    #[test]
    fn direction_projects_into_containing_face() {
        for (i, face) in Face::ALL.into_iter().enumerate() {
            assert_eq!(face.index(), i);
            assert_eq!(
                face.right().cross(face.up()),
                -face.normal(),
                "right-handed"
            );
            for (x, y) in [(0.1, 0.1), (7.9, 3.0), (4.0, 4.0), (2.5, 7.5)] {
                let direction = face.direction(x, y, 8);
                assert_eq!(Face::containing(direction * 3.0), face);
                let [px, py, eye_depth] = face.project(direction * 3.0, 8);
                assert!(
                    (px - x).abs() < 1e-12
                        && (py - y).abs() < 1e-12
                        && (eye_depth - 3.0).abs() < 1e-12
                );
            }
        }
        assert_eq!(
            Face::containing(dvec3(1.0, 1.0, -1.0)),
            Face::PosX,
            "ties go to the lower index"
        );
        assert_eq!(
            Face::containing(dvec3(0.0, -1.0, 1.0)),
            Face::NegY,
            "ties go to the lower index"
        );
    }

    #[test]
    fn locate_gives_face_and_eye_coordinates() {
        for i in 0..343 {
            let point = dvec3(
                f64::from(i % 7) - 3.0,
                f64::from(i / 7 % 7) - 3.0,
                f64::from(i / 49) - 3.0,
            );
            if point == DVec3::ZERO {
                continue;
            }
            let (face, local) = Face::locate(point.as_vec3());
            assert_eq!(face, Face::containing(point));
            let expected =
                [face.right(), face.up(), face.normal()].map(|axis| point.dot(axis) as f32);
            assert_eq!(local, expected);
        }
    }
}
