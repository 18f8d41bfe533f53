//! OpenEXR files for compositing: all samples of each pixel as deep data, or as flat layers.
//!
//! The six faces of the cube are stacked vertically as in OpenEXR's cubic environment maps
//! (`ImfEnvmap.h`), whose faces are those of a cube LDI. A single face is the image of a 90-degree
//! camera at the centre of the headbox. Colours are linear light with sRGB's primaries,
//! premultiplied by alpha; 1 is white, and captures that keep light above white exceed it. `Z` is
//! eye depth of the face's camera, metres. The world has Y up; cameras follow OpenEXR's convention
//! ([`DeepView::from_camera`]).

use super::ExportError;
use super::stacks::{Deep, Stacks};
use crate::pieces;
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, ImageAttributes, IntegerBounds, Layer,
    LayerAttributes, SmallVec, Text, WritableImage, f16,
};
use headbox_core::camera::{Camera, CameraError};
use headbox_core::cube_face::Face;
use headbox_core::progress::Progress;
use headbox_cube::pack::CubeLdi;
use headbox_images::deep_exr::{DeepChannel, DeepCompression, DeepImage, DeepKind, DeepView};
use rayon::prelude::*;
use std::io::{self, Write};

/// Faces in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Faces {
    /// All six faces, stacked vertically.
    All,
    /// One face, as the image of a camera.
    One(Face),
}

impl Faces {
    fn list(self) -> Vec<Face> {
        match self {
            Self::All => Face::ALL.into(),
            Self::One(face) => vec![face],
        }
    }

    fn view(self, cube: &CubeLdi) -> Result<DeepView, CameraError> {
        let Self::One(face) = self else {
            return Ok(DeepView {
                cube: true,
                ..DeepView::default()
            });
        };
        let px = cube.face_size_px;
        let camera = Camera::from_parts(
            cube.info.centre,
            face.world_from_eye(),
            f64::from(px) / 2.0,
            px,
            px,
        )?;
        Ok(DeepView::from_camera(&camera))
    }
}

/// Summary of a written file.
#[derive(Clone, Copy, Debug)]
pub struct DeepSummary {
    /// Number of samples.
    pub samples: u64,
    /// Width and height, pixels.
    pub size_px: [u32; 2],
}

/// Writes all samples as one deep scanline image, tidy, with ZIPS compression.
///
/// # Errors
/// [`ExportError::Empty`], [`ExportError::Io`].
pub fn write(
    cube: &CubeLdi,
    faces: Faces,
    progress: &dyn Progress,
    to: &mut dyn Write,
) -> Result<DeepSummary, ExportError> {
    let stacks = stacks(cube, faces, progress)?;
    let mut offsets = vec![0u32];
    for face in &stacks {
        let before = offsets[offsets.len() - 1];
        offsets.extend(face.offsets[1..].iter().map(|end| before + end));
    }
    let values = |value: &(dyn Fn(&Deep) -> f32 + Sync)| -> Vec<f32> {
        stacks
            .iter()
            .flat_map(|face| &face.samples)
            .map(value)
            .collect()
    };
    let mut channels: Vec<DeepChannel> = ["A", "B", "G", "R"]
        .into_iter()
        .zip([3, 2, 1, 0])
        .map(|(name, i)| DeepChannel {
            name: name.into(),
            kind: DeepKind::Half,
            values: values(&|s| s.rgba[i]),
        })
        .collect();
    channels.push(DeepChannel {
        name: "Z".into(),
        kind: DeepKind::Float,
        values: values(&|s| s.depth_m),
    });
    let size_px = [cube.face_size_px, cube.face_size_px * stacks.len() as u32];
    let samples = u64::from(offsets[offsets.len() - 1]);
    let image = DeepImage {
        size_px,
        origin_px: [0, 0],
        stored_px: size_px,
        offsets,
        channels,
        view: faces.view(cube)?,
    };
    let bytes = image
        .to_bytes(DeepCompression::Zips)
        .map_err(|(field, cause)| io::Error::other(format!("{field}: {cause}")))?;
    to.write_all(&bytes)?;
    Ok(DeepSummary { samples, size_px })
}

/// Writes `layers` flat parts: the nearest sample of each pixel, the next one, ..., and in the last
/// part the composite of all deeper samples. The composite of all parts is the image.
///
/// # Errors
/// [`ExportError::Empty`], [`ExportError::Io`].
pub fn write_layers(
    cube: &CubeLdi,
    faces: Faces,
    layers: usize,
    progress: &dyn Progress,
    to: &mut dyn Write,
) -> Result<DeepSummary, ExportError> {
    let stacks = stacks(cube, faces, progress)?;
    let size_px = [cube.face_size_px, cube.face_size_px * stacks.len() as u32];
    let size = exr::math::Vec2(size_px[0] as usize, size_px[1] as usize);
    let view = faces.view(cube)?;
    let parts: SmallVec<[Layer<AnyChannels<FlatSamples>>; 2]> = (0..layers)
        .map(|i| {
            let mut attributes =
                LayerAttributes::named(Text::new_or_panic(format!("layer{}", i + 1)));
            attributes.environment_map = view
                .cube
                .then_some(exr::meta::attribute::EnvironmentMap::Cube);
            attributes.world_to_camera = view.world_to_camera;
            attributes.world_to_normalized_device = view.world_to_ndc;
            Layer::new(
                size,
                attributes,
                Encoding::SMALL_LOSSLESS,
                layer(&stacks, i, i + 1 == layers),
            )
        })
        .collect();
    let window = IntegerBounds::from_dimensions(size);
    let image = Image::from_layers(ImageAttributes::new(window), parts);
    let mut file = io::Cursor::new(Vec::new());
    image
        .write()
        .to_buffered(&mut file)
        .map_err(io::Error::other)?;
    to.write_all(file.get_ref())?;
    Ok(DeepSummary {
        samples: stacks.iter().map(|face| face.samples.len() as u64).sum(),
        size_px,
    })
}

fn stacks(
    cube: &CubeLdi,
    faces: Faces,
    progress: &dyn Progress,
) -> Result<Vec<Stacks>, ExportError> {
    super::check_memory(cube)?;
    let faces = faces.list();
    progress.begin("sorting samples", "faces", 1 + faces.len() as u64);
    let cube = &pieces::with_merged_coverage(cube);
    progress.advance(1);
    let face_stacks = |face| {
        let stacks = Stacks::new(cube, face);
        progress.advance(1);
        stacks
    };
    let stacks: Vec<Stacks> = faces.into_par_iter().map(face_stacks).collect();
    if stacks.iter().all(|face| face.samples.is_empty()) {
        Err(ExportError::Empty)
    } else {
        Ok(stacks)
    }
}

/// Returns the channels of sample number `i` of each pixel; with `last`, composited with all
/// samples behind it.
fn layer(stacks: &[Stacks], i: usize, last: bool) -> AnyChannels<FlatSamples> {
    const NOTHING: Deep = Deep {
        depth_m: f32::INFINITY,
        rgba: [0.0; 4],
    };
    let found: Vec<Deep> = stacks
        .iter()
        .flat_map(|face| (0..face.offsets.len() - 1).map(move |at| face.pixel(at)))
        .map(|pixel| match pixel.get(i..) {
            Some([first, behind @ ..]) if last => behind
                .iter()
                .fold(*first, |front, behind| front.over(*behind)),
            Some([first, ..]) => *first,
            _ => NOTHING,
        })
        .collect();
    let channel = |name: &str, samples| AnyChannel::new(name, samples);
    let half = |i: usize| {
        FlatSamples::F16(
            found
                .iter()
                .map(|sample| f16::from_f32(sample.rgba[i]))
                .collect(),
        )
    };
    let [r, g, b, a] = [0, 1, 2, 3].map(half);
    let depth = FlatSamples::F32(found.iter().map(|sample| sample.depth_m).collect());
    AnyChannels::sort(SmallVec::from_vec(vec![
        channel("R", r),
        channel("G", g),
        channel("B", b),
        channel("A", a),
        channel("Z", depth),
    ]))
}
