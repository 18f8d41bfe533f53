//! The view against the renderer that it wraps.

use super::*;
use crate::pack::tests::scattered;
use crate::pack::{SplatIndexLayout, Split};
use crate::render::tests::cameras;

/// A cube with several layers in the only segment of each face.
pub(super) fn cube() -> Arc<CubeLdi> {
    Arc::new(CubeLdi::pack(&scattered(), SplatIndexLayout::Normal, Split::None).expect("packs"))
}

/// A request with settings given as text.
fn request(view: &CubeView, settings: &[(&str, &str)]) -> FrameRequest {
    let table = view.settings();
    let mut values = SettingValues::initial(&table);
    for (id, text) in settings {
        values.set_text(&table, id, text).expect("a setting");
    }
    FrameRequest::complete(cameras()[1], Arc::new(values))
}

#[test]
fn default_settings_render_the_renderers_frame() {
    let mut view = CubeView::new(cube());
    let request = request(&view, &[]);
    let mut renderer = Renderer::new();
    let cube = cube();
    let expected = renderer.render(&cube, &request.camera, &RenderSettings::default());
    let rendered = view.render(&request).expect("renders");
    assert!(rendered.frame == expected);
    assert_eq!(rendered.report.hole_pixels, expected.hole_count());
    assert!(rendered.report.legend.is_empty());
}

#[test]
fn settings_reach_the_renderer() {
    let (cube, mut renderer) = (cube(), Renderer::new());
    let mut view = CubeView::new(Arc::clone(&cube));
    let plain = RenderSettings::default();
    let paper = RenderSettings {
        kernel: SplatKernel::Paper,
        ..plain
    };
    let open = RenderSettings {
        keep_holes: true,
        ..plain
    };
    for (setting, settings) in [(("kernel", "paper"), paper), (("keep-holes", "on"), open)] {
        let mut differs = false;
        for camera in cameras() {
            let request = FrameRequest {
                camera,
                ..request(&view, &[setting])
            };
            let default = renderer.render(&cube, &camera, &plain).clone();
            let expected = renderer.render(&cube, &camera, &settings);
            differs |= *expected != default;
            let rendered = view.render(&request).expect("renders");
            assert!(rendered.frame == expected, "{setting:?}");
        }
        assert!(differs, "{setting:?} changes a frame");
    }
}

#[test]
fn overlays_have_opaque_pixels_and_a_legend() {
    let mut view = CubeView::new(cube());
    for (name, overlay) in Overlay::ALL {
        let request = request(&view, &[(OVERLAY, name)]);
        let rendered = view.render(&request).expect("renders");
        assert!(
            rendered.frame.color.iter().all(|pixel| pixel[3] == 255),
            "{name}"
        );
        assert_eq!(rendered.report.legend.is_empty(), overlay == Overlay::None);
    }
}

#[test]
fn exposure_brightens_and_depth_is_there_on_request() {
    let mut view = CubeView::new(cube());
    let mut mean = |stops: &str| {
        let request = request(&view, &[("exposure", stops)]);
        let rendered = view.render(&request).expect("renders");
        let levels = rendered.frame.color.iter().flat_map(|pixel| &pixel[..3]);
        levels.map(|level| u64::from(*level)).sum::<u64>()
    };
    let means = ["-1", "0", "1"].map(&mut mean);
    assert!(means[0] < means[1] && means[1] < means[2], "{means:?}");
    let mut request = request(&view, &[]);
    request.depth = true;
    let rendered = view.render(&request).expect("renders");
    assert_eq!(rendered.frame.depth_m.len(), rendered.frame.color.len());
}
