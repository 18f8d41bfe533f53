//! Camera models of COLMAP, by name and number, with their parameters.

use crate::cameras::camera_model::{CameraModel, Polynomial, Projection};
use crate::cameras::lens::{Distortion, Lens, Pinhole};
use crate::cameras::rectify::ImageLens;

/// Names and parameter counts of COLMAP's camera models by number.
const MODELS: [(&str, usize); 18] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    ("SIMPLE_DIVISION", 4),
    ("DIVISION", 5),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
    ("EUCM", 6),
    ("EQUIRECTANGULAR", 2),
];

/// Smallest omega of the FOV model that distorts, radians.
const MIN_OMEGA: f64 = 1e-6;

/// Returns the name and the number of parameters of a model by its number.
pub(super) fn model_of_number(number: u32) -> Option<(&'static str, usize)> {
    MODELS.get(number as usize).copied()
}

/// Converts a camera model and its parameters.
///
/// # Errors
/// The problem, as the rest of a sentence about the camera.
pub(super) fn parse_lens(name: &str, p: &[f64]) -> Result<ImageLens, String> {
    let Some(&(_, count)) = MODELS.iter().find(|(known, _)| *known == name) else {
        let known: Vec<&str> = MODELS.iter().map(|(known, _)| *known).collect();
        return Err(format!(
            "has the unknown model {name}; expected {}: run COLMAP's image_undistorter first",
            known.join(", ")
        ));
    };
    if p.len() != count {
        return Err(format!("has {} parameters; {name} has {count}", p.len()));
    }
    if name == "EQUIRECTANGULAR" {
        return Ok(ImageLens::Direct(Lens::Equirectangular));
    }
    let has_one_focal = matches!(
        name,
        "SIMPLE_PINHOLE"
            | "SIMPLE_RADIAL"
            | "RADIAL"
            | "SIMPLE_RADIAL_FISHEYE"
            | "RADIAL_FISHEYE"
            | "SIMPLE_DIVISION"
            | "SIMPLE_FISHEYE"
    );
    let (focal_px, principal_px, k) = if has_one_focal {
        ([p[0]; 2], [p[1], p[2]], &p[3..])
    } else {
        ([p[0], p[1]], [p[2], p[3]], &p[4..])
    };
    let fisheye = |radial: &[f64], tangential, prism, is_chained| {
        Projection::Fisheye(Polynomial::of_angles(radial, tangential, prism, is_chained))
    };
    let projection = match name {
        "OPENCV_FISHEYE"
        | "SIMPLE_RADIAL_FISHEYE"
        | "RADIAL_FISHEYE"
        | "SIMPLE_FISHEYE"
        | "FISHEYE" => fisheye(k, [0.0; 2], [0.0; 4], false),
        "THIN_PRISM_FISHEYE" => fisheye(
            &[k[0], k[1], k[4], k[5]],
            [k[2], k[3]],
            [k[6], 0.0, k[7], 0.0],
            false,
        ),
        // The tangential terms are in the other order than OpenCV's.
        "RAD_TAN_THIN_PRISM_FISHEYE" => {
            fisheye(&k[..6], [k[7], k[6]], [k[8], k[9], k[10], k[11]], true)
        }
        "FOV" if k[0].abs() >= MIN_OMEGA => Projection::FieldOfView(k[0]),
        "SIMPLE_DIVISION" | "DIVISION" => Projection::Division(k[0]),
        "EUCM" => Projection::ExtendedUnified([k[0], k[1]]),
        _ => {
            let k = |i: usize| k.get(i).copied().unwrap_or(0.0);
            let (radial, tangential) = match name {
                "SIMPLE_RADIAL" | "RADIAL" => ([k(0), k(1), 0.0, 0.0, 0.0, 0.0], [0.0; 2]),
                "OPENCV" | "FULL_OPENCV" => ([k(0), k(1), k(4), k(5), k(6), k(7)], [k(2), k(3)]),
                _ => ([0.0; 6], [0.0; 2]),
            };
            let pinhole = Pinhole {
                focal_px,
                principal_px,
                distortion: Distortion { radial, tangential },
            };
            return Ok(ImageLens::Direct(Lens::Pinhole(pinhole.checked()?)));
        }
    };
    let model = CameraModel {
        focal_px,
        principal_px,
        projection,
    };
    Ok(ImageLens::Resampled(model.checked()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// Projects the direction (0.3, 0.2, 1) of OpenCV's axes.
    fn projected(name: &str, parameters: &[f64]) -> [f64; 2] {
        let point = DVec3::new(0.3, -0.2, -1.0);
        match parse_lens(name, parameters).expect("a lens") {
            ImageLens::Resampled(model) => model.project(point).expect("seen"),
            ImageLens::Direct(Lens::Pinhole(lens)) => {
                let p = lens.distortion.apply(glam::DVec2::new(0.3, 0.2));
                [0, 1].map(|i| lens.principal_px[i] + lens.focal_px[i] * p[i])
            }
            ImageLens::Direct(Lens::Equirectangular) => {
                let [x, y, _] = Lens::Equirectangular
                    .project(point, [200, 100])
                    .expect("seen");
                [x, y]
            }
        }
    }

    #[test]
    fn models_project_as_colmap() {
        // Worked out by hand from the definitions of COLMAP's models.
        let r2: f64 = 0.13;
        let theta = r2.sqrt().atan();
        let (u, v) = (0.3 / r2.sqrt() * theta, 0.2 / r2.sqrt() * theta);
        let t2 = theta * theta;
        let radial = |d: f64| [80.0 + 100.0 * u * d, 60.0 + 100.0 * v * d];
        let one = |k: &[f64]| [&[100.0, 80.0, 60.0][..], k].concat();
        let two = |k: &[f64]| [&[100.0, 100.0, 80.0, 60.0][..], k].concat();
        let plane = |x: f64, y: f64| [80.0 + 100.0 * x, 60.0 + 100.0 * y];
        let omega: f64 = 0.8;
        let fov = (2.0 * r2.sqrt() * (omega / 2.0).tan()).atan() / (r2.sqrt() * omega);
        let division = 2.0 / (1.0 + (1.0 + 4.0 * 0.1 * r2).sqrt());
        let unified = 1.0 / (0.6 * (1.1 * r2 + 1.0).sqrt() + 0.4);
        let thin = {
            let d = 1.0 + 0.1 * t2 + 0.02 * t2 * t2;
            plane(
                u * d + 2.0 * 0.01 * u * v + 0.02 * (t2 + 2.0 * u * u) + 0.03 * t2,
                v * d + 2.0 * 0.02 * u * v + 0.01 * (t2 + 2.0 * v * v) + 0.04 * t2,
            )
        };
        let chained = {
            let d = 1.0 + 0.1 * t2;
            let (x, y) = (u * d, v * d);
            let r2 = x * x + y * y;
            plane(
                x + 2.0 * 0.02 * x * y + 0.01 * (r2 + 2.0 * x * x) + 0.001 * r2 + 0.002 * r2 * r2,
                y + 2.0 * 0.01 * x * y + 0.02 * (r2 + 2.0 * y * y) + 0.003 * r2 + 0.004 * r2 * r2,
            )
        };
        let table: [(&str, Vec<f64>, [f64; 2]); 15] = [
            ("SIMPLE_PINHOLE", one(&[]), plane(0.3, 0.2)),
            (
                "SIMPLE_RADIAL",
                one(&[0.1]),
                plane(0.3 * 1.013, 0.2 * 1.013),
            ),
            ("SIMPLE_FISHEYE", one(&[]), radial(1.0)),
            ("FISHEYE", two(&[]), radial(1.0)),
            ("SIMPLE_RADIAL_FISHEYE", one(&[0.1]), radial(1.0 + 0.1 * t2)),
            (
                "RADIAL_FISHEYE",
                one(&[0.1, 0.2]),
                radial(1.0 + 0.1 * t2 + 0.2 * t2 * t2),
            ),
            (
                "OPENCV_FISHEYE",
                two(&[0.1, 0.2, 0.3, 0.4]),
                radial(1.0 + t2 * (0.1 + t2 * (0.2 + t2 * (0.3 + t2 * 0.4)))),
            ),
            ("FOV", two(&[omega]), plane(0.3 * fov, 0.2 * fov)),
            ("FOV", two(&[0.0]), plane(0.3, 0.2)),
            (
                "SIMPLE_DIVISION",
                one(&[-0.1]),
                plane(0.3 * division, 0.2 * division),
            ),
            (
                "DIVISION",
                two(&[-0.1]),
                plane(0.3 * division, 0.2 * division),
            ),
            (
                "EUCM",
                two(&[0.6, 1.1]),
                plane(0.3 * unified, 0.2 * unified),
            ),
            (
                "THIN_PRISM_FISHEYE",
                two(&[0.1, 0.02, 0.01, 0.02, 0.0, 0.0, 0.03, 0.04]),
                thin,
            ),
            (
                "RAD_TAN_THIN_PRISM_FISHEYE",
                two(&[
                    0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.01, 0.02, 0.001, 0.002, 0.003, 0.004,
                ]),
                chained,
            ),
            (
                "EQUIRECTANGULAR",
                vec![200.0, 100.0],
                [
                    100.0 + 200.0 * 0.3_f64.atan() / std::f64::consts::TAU,
                    50.0 + 100.0 * (0.2 / 1.09_f64.sqrt()).atan() / std::f64::consts::PI,
                ],
            ),
        ];
        for (name, parameters, expected) in table {
            let [x, y] = projected(name, &parameters);
            let error = (x - expected[0]).hypot(y - expected[1]);
            assert!(error < 1e-9, "{name}: {x}, {y}, not {expected:?}");
        }
    }

    #[test]
    fn unknown_model_and_wrong_count_named() {
        let error = parse_lens("PANINI", &[1.0]).expect_err("unknown");
        assert!(
            error.contains("PANINI") && error.contains("EUCM"),
            "{error}"
        );
        let error = parse_lens("OPENCV_FISHEYE", &[1.0; 7]).expect_err("too few");
        assert!(
            error.contains("7 parameters") && error.contains('8'),
            "{error}"
        );
    }
}
