//! Content of `headbox render`: one way to render a pose of any representation, with its
//! statistics.

use super::geometry::{GeometryContent, GeometryRendered};
use crate::commands::capture::place::{figure, triple};
use crate::commands::house::file::HouseContent;
use crate::words::counted;
use headbox_core::camera::Camera;
use headbox_core::file_frame::FileFrame;
use headbox_core::frame::Frame;
use headbox_core::statistics::median;
use headbox_cube::pack::CubeLdi;
use headbox_cube::render::{RenderSettings, Renderer};
use headbox_lab::baselines::fragments::{FragmentRenderer, FragmentStats};
use headbox_lumigraph::{LumigraphSettings, Slabs, SlabsRenderer};
use headbox_sprite::compose::{ComposeSettings, Composer, Composition};
use image::RgbImage;
use serde_json::{Value, json};
use std::time::Instant;

/// One rendered pose.
pub(super) struct RenderedPose {
    pub(super) image: RgbImage,
    pub(super) ms: Vec<f64>,
    pub(super) stages: Value,
    pub(super) statistics: Value,
    pub(super) depth_pixels_in: u64,
    pub(super) splatted: u64,
    pub(super) hole_pixels: u64,
}

impl RenderedPose {
    pub(super) fn ms_median(&self) -> f64 {
        median(self.ms.iter().copied()).unwrap_or(f64::NAN)
    }

    pub(super) fn hole_fraction(&self) -> f64 {
        self.hole_pixels as f64 / (f64::from(self.image.width()) * f64::from(self.image.height()))
    }
}

/// Representation and its renderer.
pub(super) enum Content {
    House(Box<HouseContent>),
    Geometry(Box<GeometryContent>),
    Lumigraph {
        slabs: Box<Slabs>,
        renderer: Box<SlabsRenderer>,
        settings: LumigraphSettings,
    },
    Cube {
        cube: Box<CubeLdi>,
        renderer: Box<CubeRenderer>,
        settings: RenderSettings,
        /// Table from stored to shown levels, if they differ.
        shown: Option<Box<[u8; 256]>>,
    },
    Layers {
        layers: Box<Composition>,
        composer: Box<Composer>,
        settings: ComposeSettings,
        frame: Frame,
    },
}

/// Division of a cube LDI's frame among threads; all give the same frame.
#[derive(Clone, Copy, Default)]
pub(super) enum Division {
    #[default]
    Bands,
    Fragments,
}

/// Renderer of a single cube LDI.
pub(super) enum CubeRenderer {
    Bands(Box<Renderer>),
    Fragments(Box<FragmentRenderer>),
}

impl CubeRenderer {
    pub(super) fn new(division: Division) -> Self {
        match division {
            Division::Bands => Self::Bands(Box::default()),
            Division::Fragments => Self::Fragments(Box::default()),
        }
    }

    /// Returns the last frame.
    pub(super) fn frame(&self) -> &Frame {
        match self {
            Self::Bands(renderer) => renderer.frame(),
            Self::Fragments(renderer) => renderer.frame(),
        }
    }

    fn render(
        &mut self,
        cube: &CubeLdi,
        camera: &Camera,
        settings: &RenderSettings,
    ) -> (&Frame, FragmentStats) {
        match self {
            Self::Bands(renderer) => {
                let (frame, stats) = renderer.render_with_stats(cube, camera, settings);
                (frame, (*stats).into())
            }
            // One a thread.
            Self::Fragments(renderer) => renderer.render(cube, camera, settings, 0),
        }
    }
}

impl Content {
    /// Renders a pose `repeat` times.
    pub(super) fn render(&mut self, camera: &Camera, repeat: u32) -> anyhow::Result<RenderedPose> {
        match self {
            Self::House(house) => render_house(house, camera, repeat),
            Self::Geometry(geometry) => render_geometry(geometry, camera, repeat),
            Self::Lumigraph {
                slabs,
                renderer,
                settings,
            } => render_lumigraph(renderer, slabs, camera, settings, repeat),
            Self::Cube {
                cube,
                renderer,
                settings,
                shown,
            } => {
                let mut rendered = render_cube(renderer, cube, camera, settings, repeat)?;
                if let Some(shown) = shown {
                    rendered
                        .image
                        .iter_mut()
                        .for_each(|level| *level = shown[usize::from(*level)]);
                }
                Ok(rendered)
            }
            Self::Layers {
                layers,
                composer,
                settings,
                frame,
            } => render_layers(composer, layers, camera, settings, frame, repeat),
        }
    }

    /// Warns of eyes outside the headbox, from where nobody has looked.
    pub(super) fn warn_if_outside(&self, cameras: &[Camera], frame: &FileFrame) {
        let Self::Cube { cube, .. } = self else {
            return;
        };
        let (centre, half_size_m) = (cube.info.centre, cube.info.half_size_m);
        let outside = |camera: &&Camera| {
            (camera.eye() - centre).abs().max_element() > half_size_m * (1.0 + 1e-9)
        };
        let count = cameras.iter().filter(outside).count();
        if count == 0 {
            return;
        }
        let which = if cameras.len() == 1 {
            "the eye is".into()
        } else {
            format!("{count} of {} eyes are", cameras.len())
        };
        eprintln!(
            "warning: {which} outside the headbox ({} and {} to each side along the axes, in the file's axes and unit). What \
             is seen from there only is missing: expect holes, and surfaces where they are not",
            triple(frame.file_from_world(centre)),
            figure(half_size_m / frame.unit_m)
        );
    }

    /// Name of the variant; for sprites with cubes that of the sprites.
    pub(super) fn variant(&self) -> &'static str {
        match self {
            Self::House(house) => house.variant(),
            Self::Geometry(geometry) => geometry.variant(),
            Self::Lumigraph { settings, .. } => settings.blend.name(),
            Self::Cube { settings, .. } => settings.kernel.name(),
            Self::Layers {
                layers, settings, ..
            } if layers.sprites().sprites().is_empty() => settings.cubes.kernel.name(),
            Self::Layers { settings, .. } => settings.sprites.variant.name(),
        }
    }

    pub(super) fn summary(&self, rendered: &RenderedPose) -> String {
        match self {
            Self::House(house) => format!("{}, {} splats", house.variant(), rendered.splatted),
            Self::Geometry(geometry) => {
                format!(
                    "{}, {} triangles of {} samples",
                    geometry.variant(),
                    rendered.splatted,
                    rendered.depth_pixels_in
                )
            }
            Self::Lumigraph { slabs, .. } => {
                // What is at infinity is drawn, too.
                let all: usize = slabs.all().iter().map(|slab| slab.layers().len() + 1).sum();
                format!(
                    "{} layers of {all} with infinity",
                    rendered.statistics["layers"]
                )
            }
            Self::Cube { cube, .. } => {
                // One depth pixel may be splatted in several bands of rows.
                format!(
                    "{} splats of {} depth pixels",
                    rendered.splatted,
                    cube.depth_pixel_count()
                )
            }
            Self::Layers { layers, .. } => {
                let counts = [
                    layers.sprites().sprites().len(),
                    layers.cubes().len(),
                    layers.polygons().len(),
                ];
                let kinds = counts
                    .into_iter()
                    .zip(["sprite", "cube LDI", "model"])
                    .filter(|(count, _)| *count > 0);
                kinds
                    .map(|(count, kind)| counted(count as u64, kind))
                    .collect::<Vec<_>>()
                    .join(", ")
            }
        }
    }
}

fn render_house(
    house: &mut HouseContent,
    camera: &Camera,
    repeat: u32,
) -> anyhow::Result<RenderedPose> {
    let walked = house.render(camera, repeat)?;
    let stats = walked.stats;
    Ok(RenderedPose {
        image: walked.image,
        ms: walked.ms,
        stages: json!({"geometry_ms": stats.geometry_ms, "backdrop_ms": stats.backdrop_ms}),
        depth_pixels_in: stats.backdrop.depth_pixels_in,
        splatted: stats.backdrop.splatted,
        hole_pixels: stats.hole_pixels,
        statistics: serde_json::to_value(stats)?,
    })
}

fn render_geometry(
    geometry: &mut GeometryContent,
    camera: &Camera,
    repeat: u32,
) -> anyhow::Result<RenderedPose> {
    let GeometryRendered { image, ms, stats } = geometry.render(camera, repeat)?;
    Ok(RenderedPose {
        image,
        ms,
        stages: json!({
            "rank_ms": stats.rank_ms, "fetch_ms": stats.fetch_ms, "fuse_ms": stats.fuse_ms, "mesh_ms": stats.mesh_ms,
            "texture_ms": stats.texture_ms,
        }),
        statistics: serde_json::to_value(stats)?,
        depth_pixels_in: stats.samples,
        splatted: stats.triangles,
        hole_pixels: stats.hole_pixels,
    })
}

fn render_lumigraph(
    renderer: &mut SlabsRenderer,
    slabs: &Slabs,
    camera: &Camera,
    settings: &LumigraphSettings,
    repeat: u32,
) -> anyhow::Result<RenderedPose> {
    let mut ms = Vec::with_capacity(repeat as usize);
    loop {
        let (frame, stats) = renderer.render(slabs, camera, settings);
        ms.push(stats.frame_ms);
        if ms.len() >= repeat as usize {
            return Ok(RenderedPose {
                image: frame.to_rgb()?,
                ms,
                stages: json!({"plan_ms": stats.plan_ms, "draw_ms": stats.frame_ms - stats.plan_ms}),
                statistics: serde_json::to_value(stats)?,
                depth_pixels_in: 0,
                splatted: 0,
                hole_pixels: stats.hole_pixels,
            });
        }
    }
}

fn render_cube(
    renderer: &mut CubeRenderer,
    cube: &CubeLdi,
    camera: &Camera,
    settings: &RenderSettings,
    repeat: u32,
) -> anyhow::Result<RenderedPose> {
    let mut ms = Vec::with_capacity(repeat as usize);
    loop {
        let start = Instant::now();
        let (frame, all_stats) = renderer.render(cube, camera, settings);
        let stats = &all_stats.frame;
        ms.push(start.elapsed().as_secs_f64() * 1e3);
        if ms.len() >= repeat as usize {
            let mut rendered = RenderedPose {
                image: frame.to_rgb()?,
                ms,
                stages: json!({"clear_ms": stats.clear_ms, "warp_ms": stats.warp_ms, "finish_ms": stats.finish_ms}),
                statistics: serde_json::to_value(all_stats)?,
                depth_pixels_in: stats.depth_pixels_in,
                splatted: stats.splatted,
                hole_pixels: stats.hole_pixels,
            };
            let clipping = Renderer::new().clip_counts(cube, camera, settings);
            rendered.statistics["clipping"] = serde_json::to_value(clipping)?;
            return Ok(rendered);
        }
    }
}

fn render_layers(
    composer: &mut Composer,
    layers: &Composition,
    camera: &Camera,
    settings: &ComposeSettings,
    frame: &mut Frame,
    repeat: u32,
) -> anyhow::Result<RenderedPose> {
    let mut ms = Vec::with_capacity(repeat as usize);
    loop {
        let start = Instant::now();
        let stats = layers.render(composer, camera, settings, frame);
        ms.push(start.elapsed().as_secs_f64() * 1e3);
        if ms.len() >= repeat as usize {
            return Ok(RenderedPose {
                image: frame.to_rgb()?,
                ms,
                stages: json!({
                    "sprites_ms": stats.sprites_ms, "cubes_ms": stats.cubes_ms, "polygons_ms": stats.polygons_ms,
                    "compose_ms": stats.compose_ms,
                }),
                statistics: json!({
                    "outcomes": stats.outcomes, "order": stats.order, "sprites": settings.sprites,
                }),
                depth_pixels_in: stats.depth_pixels_in,
                splatted: stats.splatted,
                hole_pixels: stats.hole_pixels,
            });
        }
    }
}
