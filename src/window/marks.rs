//! Camera positions of an image set and the sparse points of its alignment, drawn over frames.

use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::file_frame::FileFrame;
use headbox_core::statistics::median;
use headbox_images::{Lens, Pinhole, SparsePoint, View};
use headbox_viewer::{
    EyeBounds, FrameReport, FrameRequest, FrameSource, Navigation, Pose, RoomMap, Setting, Swatch,
};
use std::path::Path;
use tiny_skia::{Color, LineCap, Paint, PathBuilder, PixmapMut, Stroke, Transform};

/// Length of a camera's pyramid as a share of the median distance between cameras.
const LENGTH: f64 = 0.4;

/// Eye depth of the near plane for lines as a share of a pyramid's length.
const NEAREST: f64 = 1e-3;

/// Colour of pyramids: yellow.
const CAMERA: [u8; 3] = [255, 210, 40];

const LINE_PX: f32 = 1.5;

/// Half of a point's edge, pixels.
const POINT_PX: i64 = 1;

/// Kind of marks drawn over frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum MarkKind {
    Nothing,
    Cameras,
    Points,
    Both,
}

headbox_core::named_variants!(MarkKind {
    Nothing => "nothing",
    Cameras => "cameras",
    Points => "points",
    Both => "cameras and points",
});

/// Cameras of an image set, and its sparse points.
pub struct Marks {
    cameras: Vec<Pyramid>,
    points: Vec<SparsePoint>,
    length_m: f64,
}

/// View pyramid of a camera.
struct Pyramid {
    eye: DVec3,
    /// Corners of the image relative to the eye, at eye depth 1.
    corners: [DVec3; 4],
}

impl Marks {
    /// Collects the marks of views and sparse points.
    pub fn new(views: &[View], points: Vec<SparsePoint>) -> Self {
        let eyes: Vec<DVec3> = views.iter().map(|view| view.pose.eye).collect();
        Self {
            cameras: views.iter().map(Pyramid::new).collect(),
            points,
            length_m: LENGTH * spacing_m(&eyes).unwrap_or(1.0),
        }
    }

    /// Draws marks over the frame of a camera.
    fn draw(&self, kind: MarkKind, camera: &Camera, pixels: &mut [[u8; 4]]) {
        if matches!(kind, MarkKind::Points | MarkKind::Both) {
            for point in &self.points {
                paint_point(point, camera, pixels);
            }
        }
        if matches!(kind, MarkKind::Cameras | MarkKind::Both) {
            self.draw_cameras(camera, pixels);
        }
    }

    fn draw_cameras(&self, camera: &Camera, pixels: &mut [[u8; 4]]) {
        let mut lines = PathBuilder::new();
        for pyramid in &self.cameras {
            // Seen from inside, a pyramid would only frame the whole view.
            if pyramid.eye.distance(camera.eye()) < self.length_m {
                continue;
            }
            let corners = pyramid
                .corners
                .map(|corner| pyramid.eye + corner * self.length_m);
            let rim = (0..4).map(|i| [corners[i], corners[(i + 1) % 4]]);
            let edges = corners.iter().map(|corner| [pyramid.eye, *corner]);
            for [from, to] in rim.chain(edges) {
                let Some([from, to]) = project_line(camera, from, to, NEAREST * self.length_m)
                else {
                    continue;
                };
                lines.move_to(from[0], from[1]);
                lines.line_to(to[0], to[1]);
            }
        }
        let bytes = bytemuck::cast_slice_mut(pixels);
        let (Some(lines), Some(mut picture)) = (
            lines.finish(),
            PixmapMut::from_bytes(bytes, camera.width(), camera.height()),
        ) else {
            return;
        };
        let mut paint = Paint::default();
        let [r, g, b] = CAMERA;
        paint.set_color(Color::from_rgba8(r, g, b, u8::MAX));
        let stroke = Stroke {
            width: LINE_PX,
            line_cap: LineCap::Round,
            ..Stroke::default()
        };
        picture.stroke_path(&lines, &paint, &stroke, Transform::identity(), None);
    }
}

impl Pyramid {
    fn new(view: &View) -> Self {
        let [width, height] = view.size_px.map(f64::from);
        let corner = |[x, y]: [f64; 2]| match view.lens {
            Lens::Pinhole(Pinhole {
                focal_px,
                principal_px,
                ..
            }) => DVec3::new(
                (x - principal_px[0]) / focal_px[0],
                (principal_px[1] - y) / focal_px[1],
                -1.0,
            ),
            // A panorama has no corners: a square marks its centre.
            Lens::Equirectangular => DVec3::new(x / width - 0.5, 0.5 - y / height, -1.0),
        };
        let corners = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]];
        Self {
            eye: view.pose.eye,
            corners: corners.map(|at| view.pose.world_from_eye * corner(at)),
        }
    }
}

/// Median distance of an eye from the nearest other one, metres.
fn spacing_m(eyes: &[DVec3]) -> Option<f64> {
    /// Maximum number of eyes whose distances are measured.
    const MAX_SAMPLES: usize = 256;
    let step = eyes.len().div_ceil(MAX_SAMPLES).max(1);
    let nearest = |i: usize| {
        let others = eyes.iter().enumerate().filter(|(other, _)| *other != i);
        others
            .map(|(_, eye)| eye.distance(eyes[i]))
            .filter(|distance| *distance > 0.0)
            .fold(f64::INFINITY, f64::min)
    };
    let distances = (0..eyes.len()).step_by(step).map(nearest);
    median(distances.filter(|distance| distance.is_finite()))
}

/// Projects a line segment, clipped by a near plane at eye depth `nearest_m`; returns its ends in
/// pixels.
fn project_line(camera: &Camera, from: DVec3, to: DVec3, nearest_m: f64) -> Option<[[f32; 2]; 2]> {
    let depth = |point: DVec3| (point - camera.eye()).dot(camera.forward());
    let [near, far] = [depth(from), depth(to)];
    let clip = |point: DVec3, own: f64, other: DVec3, others: f64| {
        if own >= nearest_m {
            Some(point)
        } else if others >= nearest_m {
            Some(point + (other - point) * ((nearest_m - own) / (others - own)))
        } else {
            None
        }
    };
    let ends = [clip(from, near, to, far)?, clip(to, far, from, near)?];
    let [from, to] = ends.map(|point| camera.project(point));
    let px = |at: [f64; 3]| [at[0] as f32, at[1] as f32];
    // Drops lines close to the near plane, whose pixel coordinates are huge.
    let is_sane = |at: &[f32; 2]| at.iter().all(|x| x.abs() < 1e6);
    Some([px(from?), px(to?)]).filter(|ends| ends.iter().all(is_sane))
}

fn paint_point(point: &SparsePoint, camera: &Camera, pixels: &mut [[u8; 4]]) {
    let Some([x, y, _]) = camera.project(point.position) else {
        return;
    };
    let [width, height] = [camera.width(), camera.height()].map(i64::from);
    let [r, g, b] = point.color;
    let span = |at: f64, end: i64| {
        // The cast saturates, so positions far outside the frame stay outside.
        let middle = at.round() as i64;
        middle.saturating_sub(POINT_PX).clamp(0, end)..middle.saturating_add(POINT_PX).clamp(0, end)
    };
    for row in span(y, height) {
        for column in span(x, width) {
            pixels[(row * width + column) as usize] = [r, g, b, u8::MAX];
        }
    }
}

/// Source whose frames are overlaid with marks.
pub(crate) struct MarkedSource {
    pub(crate) source: Box<dyn FrameSource>,
    pub(crate) marks: Marks,
}

impl FrameSource for MarkedSource {
    fn title(&self) -> String {
        self.source.title()
    }

    fn start_pose(&self) -> Pose {
        self.source.start_pose()
    }

    fn bounds(&self) -> Option<EyeBounds> {
        self.source.bounds()
    }

    fn navigation(&self) -> Navigation {
        self.source.navigation()
    }

    fn speed_m_per_s(&self) -> f64 {
        self.source.speed_m_per_s()
    }

    fn plan(&self) -> Option<RoomMap> {
        self.source.plan()
    }

    fn notes(&self) -> Vec<String> {
        self.source.notes()
    }

    fn terms(&self) -> &'static [(&'static str, &'static str)] {
        self.source.terms()
    }

    fn file_frame(&self) -> FileFrame {
        self.source.file_frame()
    }

    fn settings(&self) -> Vec<Setting> {
        let marks = Setting::choice(
            "marks",
            "Drawn over it",
            "Where the pictures were taken, as pyramids that open to what each shows, and the points that they were aligned by (of a COLMAP \
             model); both also where something hides them.",
            &MarkKind::ALL.map(MarkKind::name),
        );
        self.source.settings().into_iter().chain([marks]).collect()
    }

    fn render(
        &mut self,
        request: &FrameRequest,
        pixels: &mut [[u8; 4]],
    ) -> Result<FrameReport, String> {
        let mut report = self.source.render(request, pixels)?;
        let kind = MarkKind::ALL
            .get(request.settings.choice("marks")?)
            .copied()
            .unwrap_or(MarkKind::Nothing);
        self.marks.draw(kind, &request.camera, pixels);
        if matches!(kind, MarkKind::Cameras | MarkKind::Both) {
            let label = format!("where {} pictures were taken", self.marks.cameras.len());
            report.legend.push(Swatch {
                color: CAMERA,
                label,
            });
        }
        Ok(report)
    }

    fn save(&mut self, id: &str, path: &Path) -> Result<String, String> {
        self.source.save(id, path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;
    use headbox_fixtures::{plane_view, saved};

    const SIZE: [u32; 2] = [200, 100];

    /// Three pictures side by side, and points: one ahead, one behind the eye, one nowhere.
    fn marks() -> Marks {
        let folder = tempfile::tempdir().unwrap();
        let eyes = [-1.0, 0.0, 1.0].map(|x| DVec3::new(x, 0.0, 0.0));
        let views = eyes.map(|eye| saved(&plane_view(eye, 3.0, [40, 30]), folder.path(), "view"));
        let at = |z: f64, color| SparsePoint {
            position: DVec3::new(0.5, -0.5, z),
            color,
        };
        let nowhere = SparsePoint {
            position: DVec3::splat(f64::INFINITY),
            color: [9; 3],
        };
        Marks::new(&views, vec![at(-4.0, [1, 2, 3]), at(9.0, [7; 3]), nowhere])
    }

    fn drawn(over: MarkKind, eye: DVec3) -> (Camera, Vec<[u8; 4]>) {
        let camera = Camera::from_parts(eye, DMat3::IDENTITY, 80.0, SIZE[0], SIZE[1]).unwrap();
        let mut pixels = vec![[200, 100, 50, 255]; (SIZE[0] * SIZE[1]) as usize];
        marks().draw(over, &camera, &mut pixels);
        (camera, pixels)
    }

    fn at(camera: &Camera, pixels: &[[u8; 4]], point: DVec3) -> [u8; 3] {
        let [x, y, _] = camera.project(point).unwrap();
        let [r, g, b, _] = pixels[y as usize * SIZE[0] as usize + x as usize];
        [r, g, b]
    }

    fn count(pixels: &[[u8; 4]], is: impl Fn([u8; 3]) -> bool) -> usize {
        pixels.iter().filter(|&&[r, g, b, _]| is([r, g, b])).count()
    }

    #[test]
    fn camera_marks_and_points_project_correctly() {
        let eye = DVec3::new(0.0, 0.0, 3.0);
        let background = |color: [u8; 3]| color == [200, 100, 50];
        let (_, nothing) = drawn(MarkKind::Nothing, eye);
        assert!(
            nothing
                .iter()
                .all(|&[r, g, b, a]| background([r, g, b]) && a == 255)
        );
        let (camera, points) = drawn(MarkKind::Points, eye);
        assert_eq!(at(&camera, &points, DVec3::new(0.5, -0.5, -4.0)), [1, 2, 3]);
        assert_eq!(
            count(&points, |color| !background(color)),
            4,
            "what is behind the eye or nowhere is not drawn"
        );
        let (camera, cameras) = drawn(MarkKind::Cameras, eye);
        // Eyes are a metre apart.
        let marks = marks();
        assert!((marks.length_m - 0.4).abs() < 1e-12);
        for pyramid in &marks.cameras {
            let corner = pyramid.eye + pyramid.corners[0] * marks.length_m;
            for share in [0.25, 0.5, 0.75] {
                let [r, g, b] = at(&camera, &cameras, pyramid.eye.lerp(corner, share));
                assert!(
                    r > 225 && g > 150 && b < 50,
                    "{share} from eye to corner: {r} {g} {b}"
                );
            }
        }
        let (_, both) = drawn(MarkKind::Both, eye);
        let changed = |pixels: &[[u8; 4]]| count(pixels, |color| !background(color));
        assert!(changed(&both) > changed(&cameras) && changed(&both) <= changed(&cameras) + 4);
    }

    #[test]
    fn own_camera_and_background_have_no_marks() {
        let changed = |eye: DVec3| {
            count(&drawn(MarkKind::Cameras, eye).1, |color| {
                color != [200, 100, 50]
            })
        };
        // From the middle camera, the other two are outside of the frame.
        assert_eq!(changed(DVec3::ZERO), 0);
        assert_eq!(changed(DVec3::new(0.0, 0.0, -3.0)), 0);
        // A line through the eye's plane is clipped there, from either end.
        let camera =
            Camera::from_parts(DVec3::ZERO, DMat3::IDENTITY, 80.0, SIZE[0], SIZE[1]).unwrap();
        let (ahead, behind) = (DVec3::new(0.5, 0.0, -1.0), DVec3::new(0.5, 0.0, 1.0));
        let [from, to] = project_line(&camera, ahead, behind, 0.5).unwrap();
        assert_eq!((from, to), ([140.0, 50.0], [180.0, 50.0]));
        assert_eq!(project_line(&camera, behind, ahead, 0.5), Some([to, from]));
        assert_eq!(project_line(&camera, behind, behind * 2.0, 0.5), None);
    }
}
