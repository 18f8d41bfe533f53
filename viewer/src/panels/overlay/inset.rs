//! Inset: a small 3-D drawing of the headbox with the eye in it.

use crate::input::bounds::EyeBounds;
use crate::input::pose::Pose;
use crate::panels::overlay::strip;
use crate::panels::theme;
use egui::{Align2, FontId, Painter, Pos2, Rect, Stroke, StrokeKind, pos2, vec2};
use glam::{DMat3, DVec3, dvec3};
use headbox_core::file_frame::FileFrame;

/// Distance of the insets from the frame's corner and from each other, points.
pub(crate) const MARGIN_POINTS: f32 = 10.0;
const SIZE_POINTS: f32 = 148.0;
/// Radius of the box's circumscribed sphere as a share of the inset's half width.
const FILL: f64 = 0.88;
/// Yaw of the drawing's camera relative to the eye, radians: slightly from the side, to show depth.
const CAMERA_YAW_RAD: f64 = -0.5;
/// Pitch of the drawing's camera, radians: from above.
const CAMERA_PITCH_RAD: f64 = -0.45;
/// Length of the drawn frustum as a share of the box's half diagonal.
const FRUSTUM_SHARE: f64 = 0.45;

/// Paints an empty inset whose bottom right corner is `corner`, moves the corner up for the next
/// inset, and returns the rectangle to draw in.
///
/// `None` if it does not fit: insets stay in the right half of a frame, below its progress strip.
pub(crate) fn frame(painter: &Painter, rect: Rect, corner: &mut Pos2, title: &str) -> Option<Rect> {
    if corner.y - SIZE_POINTS < rect.top() + MARGIN_POINTS + strip::HEIGHT_POINTS
        || rect.width() < 2.0 * SIZE_POINTS
    {
        return None;
    }
    let rect = Rect::from_min_size(
        *corner - vec2(SIZE_POINTS, SIZE_POINTS),
        vec2(SIZE_POINTS, SIZE_POINTS),
    );
    corner.y -= SIZE_POINTS + MARGIN_POINTS;
    painter.rect(
        rect,
        5.0,
        theme::INSET,
        Stroke::new(1.0, theme::FAINT),
        StrokeKind::Inside,
    );
    painter.text(
        rect.min + vec2(7.0, 5.0),
        Align2::LEFT_TOP,
        title,
        FontId::proportional(11.0),
        theme::INSET_TEXT,
    );
    Some(rect.shrink(6.0))
}

/// Orthographic projection of the inset: box-relative metres to points.
struct Projection {
    page_from_world: DMat3,
    centre: DVec3,
    middle: Pos2,
    points_per_m: f64,
}

impl Projection {
    fn new(rect: Rect, bounds: &EyeBounds, pose: &Pose) -> Self {
        let camera = Pose {
            pitch_rad: CAMERA_PITCH_RAD,
            yaw_rad: pose.yaw_rad + CAMERA_YAW_RAD,
            ..*pose
        };
        Self {
            page_from_world: camera.world_from_eye().transpose(),
            centre: bounds.centre,
            middle: rect.center() + vec2(0.0, 6.0),
            points_per_m: f64::from(rect.width()) / 2.0 * FILL
                / bounds.half_size.length().max(1e-9),
        }
    }

    /// Projects a point: position in the drawing, and depth (metres, larger is nearer).
    fn point(&self, world: DVec3) -> (Pos2, f64) {
        let p = self.page_from_world * (world - self.centre);
        let points = p * self.points_per_m;
        (
            pos2(
                self.middle.x + points.x as f32,
                self.middle.y - points.y as f32,
            ),
            p.z,
        )
    }
}

/// Paints the box with its size in the axes and unit of the file, the eye, its plumb line to the
/// floor, and the frustum of a frame of `aspect` = width / height.
pub(crate) fn paint(
    painter: &Painter,
    rect: Rect,
    bounds: &EyeBounds,
    file_frame: &FileFrame,
    pose: &Pose,
    aspect: f64,
) {
    let painter = painter.with_clip_rect(rect.expand(5.0).intersect(painter.clip_rect()));
    let projection = Projection::new(rect, bounds, pose);
    let near_edge = theme::mix(theme::LINE, theme::WARNING, bounds.edge_share(pose.eye));
    for (a, b) in edges() {
        let [(a, a_near), (b, b_near)] =
            [a, b].map(|corner| projection.point(bounds.centre + bounds.half_size * corner));
        // Edges at the back are drawn thinner and darker.
        let front = a_near + b_near > 0.0;
        let stroke = if front {
            Stroke::new(1.4, near_edge)
        } else {
            Stroke::new(1.0, theme::mix(near_edge, theme::FAINT, 0.6))
        };
        painter.line_segment([a, b], stroke);
    }
    // Floor: the lowest plane perpendicular to the up direction that touches the box.
    let height = (pose.eye - bounds.centre).dot(pose.up) + bounds.half_size.dot(pose.up.abs());
    let floor = pose.eye - pose.up * height;
    let ((eye, _), (foot, _)) = (projection.point(pose.eye), projection.point(floor));
    painter.line_segment([eye, foot], Stroke::new(1.0, theme::FAINT));
    painter.circle_filled(foot, 1.5, theme::FAINT);
    let corners = frustum(pose, aspect, bounds.half_size.length() * FRUSTUM_SHARE)
        .map(|corner| projection.point(corner).0);
    let stroke = Stroke::new(1.2, theme::ACCENT);
    for i in 0..4 {
        painter.line_segment([eye, corners[i]], stroke);
        painter.line_segment([corners[i], corners[(i + 1) % 4]], stroke);
    }
    painter.circle_filled(eye, 3.5, theme::ACCENT);
    painter.text(
        rect.right_bottom(),
        Align2::RIGHT_BOTTOM,
        size_label(bounds.half_size * 2.0, file_frame),
        FontId::proportional(10.0),
        theme::INSET_TEXT,
    );
}

/// Formats the size of a box (world metres) in the axes and unit of the file, to a centimetre.
fn size_label(size: DVec3, file_frame: &FileFrame) -> String {
    let decimals = (2.5 + file_frame.unit_m.log10()).clamp(0.0, 12.0) as usize;
    let edges = file_frame.file_from_world(size).abs().to_array();
    let edges = edges.map(|edge| format!("{edge:.decimals$}")).join(" x ");
    let unit = file_frame.unit_name().map(|unit| format!(" {unit}"));
    edges + &unit.unwrap_or_default()
}

/// Corners of the view at a distance of `length` metres along the diagonal rays.
fn frustum(pose: &Pose, aspect: f64, length: f64) -> [DVec3; 4] {
    let half_height = (pose.fov_y_deg.to_radians() / 2.0).tan();
    [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)].map(|(x, y)| {
        let ray = dvec3(x * half_height * aspect, y * half_height, -1.0).normalize();
        pose.eye + pose.world_from_eye() * ray * length
    })
}

/// Twelve edges of the cube from -1 to 1.
pub(crate) fn edges() -> impl Iterator<Item = (DVec3, DVec3)> {
    let corner =
        |i: usize| DVec3::from([0, 1, 2].map(|axis| if i >> axis & 1 == 1 { 1.0 } else { -1.0 }));
    (0..8)
        .flat_map(move |i| (0..3).map(move |axis| (i, i | 1 << axis)))
        .filter(|(a, b)| a != b)
        .map(move |(a, b)| (corner(a), corner(b)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::file_frame::UpAxis;

    #[test]
    fn a_cube_has_twelve_edges_of_length_2() {
        assert_eq!(edges().count(), 12);
        assert!(edges().all(|(a, b)| a.distance(b) == 2.0));
    }

    #[test]
    fn the_box_fits_the_inset_from_every_side() {
        let rect = Rect::from_min_size(pos2(10.0, 20.0), vec2(136.0, 136.0));
        let bounds = EyeBounds {
            centre: dvec3(5.0, -3.0, 2.0),
            half_size: dvec3(0.5, 0.5, 2.0),
        };
        for i in 0..64 {
            let up = [DVec3::Y, DVec3::X, dvec3(0.3, -0.2, 0.8)][i as usize % 3];
            let pose =
                Pose::upright(DVec3::ZERO, DVec3::NEG_Z, up, 60.0).turned(f64::from(i) * 0.1, 0.0);
            let projection = Projection::new(rect, &bounds, &pose);
            for (a, _) in edges() {
                assert!(
                    rect.expand(6.0)
                        .contains(projection.point(bounds.centre + bounds.half_size * a).0)
                );
            }
        }
    }

    #[test]
    fn forward_is_into_the_page_and_up() {
        let rect = Rect::from_min_size(Pos2::ZERO, vec2(100.0, 100.0));
        let bounds = EyeBounds {
            centre: DVec3::ZERO,
            half_size: DVec3::ONE,
        };
        let ups = [DVec3::Y, DVec3::NEG_Y, dvec3(0.8, 0.6, 0.0)];
        for (up, yaw) in ups
            .into_iter()
            .flat_map(|up| [0.0, 1.0, 4.0].map(|yaw| (up, yaw)))
        {
            let pose = Pose {
                eye: DVec3::ZERO,
                yaw_rad: yaw,
                pitch_rad: 0.0,
                fov_y_deg: 60.0,
                up,
            };
            let projection = Projection::new(rect, &bounds, &pose);
            let ((eye, _), (ahead, nearness)) =
                (projection.point(pose.eye), projection.point(pose.forward()));
            assert!(ahead.y < eye.y && nearness < 0.0, "{yaw}");
        }
    }

    #[test]
    fn size_is_in_the_files_axes_and_unit() {
        let size = dvec3(0.4, 1.2, 0.8);
        let label = |up, unit_m| size_label(size, &FileFrame { up, unit_m });
        assert_eq!(label(UpAxis::Y, 1.0), "0.40 x 1.20 x 0.80 m");
        assert_eq!(label(UpAxis::Z, 0.01), "40 x 80 x 120 cm");
        assert_eq!(label(UpAxis::Y, 0.025), "16 x 48 x 32");
    }
}
