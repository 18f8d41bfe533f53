//! Explanations of the terms in the panel of the window.

/// Terms of figures, facts and overlays, each with its explanation.
pub(super) const TERMS: [(&str, &str); 47] = [
    // Stages.
    ("clear", "Empties the frame's buffers."),
    (
        "warp",
        "Moves depth pixels to where this eye sees them, and paints their footprints.",
    ),
    (
        "finish",
        "Blends what was painted, lays it over the environment, and turns it into colours for the screen.",
    ),
    ("geometry", "Draws the cells near the eye as triangles."),
    (
        "backdrop",
        "Draws what stands behind portals that are not near: images with depth.",
    ),
    // Figures.
    (
        "depth pixels",
        "Samples of the layered depth image: each a colour, a depth and the size of its surface patch.",
    ),
    (
        "depth pixels in",
        "Depth pixels that clipping let through: they were warped for this frame.",
    ),
    (
        "splatted",
        "Depth pixels that landed in the frame and were painted as footprints.",
    ),
    (
        "of about 1 px",
        "Depth pixels painted as footprints of about one pixel.",
    ),
    (
        "of about 3 px",
        "Depth pixels painted as footprints of about three pixels across.",
    ),
    (
        "of about 5 px",
        "Depth pixels painted as footprints of about five pixels across.",
    ),
    (
        "of 7 px or more",
        "Depth pixels painted as footprints of seven pixels across or more: the eye is near, or the face coarse.",
    ),
    (
        "hole pixels",
        "Pixels of the frame of which nothing is known: no footprint, and no ray that left the scene there.",
    ),
    (
        "face size",
        "Pixels along an edge of each of the six faces of the cube about the headbox.",
    ),
    (
        "FLIP",
        "How different two pictures look to a person, 0 (no difference) to 1 (Andersson et al. 2020).",
    ),
    (
        "PSNR",
        "Peak signal-to-noise ratio of the frame against truth: 20 dB is poor, 40 dB hard to tell apart.",
    ),
    (
        "rays per pixel of truth",
        "How many camera rays truth was averaged from; it is refined while the eye rests.",
    ),
    (
        "truth's own error",
        "How far truth itself still is from its limit, as a PSNR: the more, the better.",
    ),
    (
        "width of footprints",
        "Mean width of the footprints in front.",
    ),
    (
        "draws a pixel, mean",
        "How often a pixel that was drawn was drawn, on the average.",
    ),
    (
        "draws a pixel, most",
        "How often the pixel was drawn that was drawn most.",
    ),
    (
        "depth pixels kept",
        "Depth pixels that clipping kept for this view.",
    ),
    (
        "outside of rectangles",
        "Depth pixels left out because they lie outside the part of their face that the view can show.",
    ),
    (
        "in hidden blocks",
        "Depth pixels left out because their whole block of the face lies outside the view or is hidden.",
    ),
    (
        "cells as geometry",
        "Rooms drawn as triangles in this frame.",
    ),
    (
        "triangles drawn",
        "Triangles that face the eye and lie in the view.",
    ),
    (
        "portals as backdrops",
        "Openings behind which an image with depth stands in for the rooms.",
    ),
    (
        "backdrops missing",
        "Openings whose backdrop is not built yet: geometry is drawn instead.",
    ),
    (
        "pixels of backdrops",
        "Share of the frame that shows backdrops.",
    ),
    (
        "memory of backdrops",
        "Memory that all backdrops take that were built or read.",
    ),
    // Facts.
    (
        "SIMD level",
        "The processor's vector instructions that frames are drawn with (HEADBOX_SIMD chooses another).",
    ),
    (
        "in the file",
        "The up axis and unit that were taken for the scene's file.",
    ),
    (
        "light",
        "Colours are plain until light has been computed for every vertex.",
    ),
    (
        "the eye is in",
        "The room in which the eye stands; portals lead out of it.",
    ),
    // Overlays.
    ("none", "The frame as it is, nothing painted over it."),
    (
        "holes",
        "Pixels of which nothing is known, in magenta over the dimmed frame.",
    ),
    (
        "coverage",
        "The share of each pixel that footprints cover, black 0 to white 1.",
    ),
    (
        "depth",
        "Depth pixels by their distance from the centre of the headbox: red near, blue far.",
    ),
    (
        "layer",
        "Layers: in one pixel of a face several surfaces lie behind each other; the nearest is layer 0, orange.",
    ),
    (
        "face",
        "Depth pixels by the face of the cube that they were captured on.",
    ),
    (
        "segment",
        "Near and far segment: each face is split by depth, so that a few bits of depth are enough for each part.",
    ),
    (
        "primitive",
        "What stands for a surface: a depth pixel, or a picture on a plane.",
    ),
    (
        "footprint",
        "How wide the footprint in front is that covers a pixel.",
    ),
    ("overdraw", "How often each pixel was drawn."),
    (
        "clipping",
        "Clipping leaves out what this view cannot show before it is warped: shown on the unfolded faces.",
    ),
    (
        "truth",
        "The same view, ray-traced; refined while the eye rests.",
    ),
    (
        "error",
        "Where the frame differs from truth (FLIP), black 0 to yellow 1; refined while the eye rests.",
    ),
];

#[cfg(test)]
mod tests {
    use super::*;
    use headbox_core::view::{Control, OVERLAY};
    use headbox_views::TruthView;

    #[test]
    fn every_overlay_has_a_term() {
        for (i, (term, sentence)) in TERMS.iter().enumerate() {
            assert!(
                sentence.ends_with(['.', ')']) && sentence.len() > 20,
                "{term}"
            );
            assert!(
                TERMS[..i].iter().all(|(other, _)| other != term),
                "{term} twice"
            );
        }
        let settings = TruthView::setting_table();
        let overlay = settings.iter().find(|setting| setting.id == OVERLAY);
        let Some(Control::Choice { options, .. }) = overlay.map(|setting| &setting.control) else {
            panic!("overlays are a choice");
        };
        for name in options {
            assert!(TERMS.iter().any(|(term, _)| term == name), "{name}");
        }
    }
}
