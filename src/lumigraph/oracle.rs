//! Reference renderer: ray by ray, in `f64`, through each camera's own projection (L9; C21).

use super::Lumigraph;
use super::grid::PlaneView;
use super::settings::{Blend, LumigraphSettings};
use crate::render::layer_in_view::MergedLayer;
use crate::render::merge::Merger;
use crate::render::plan::{Step, merged_layers, steps};
use crate::render::pyramid::{Level, Texel};
use glam::DVec3;
use headbox_core::camera::Camera;
use headbox_core::color::srgb8_from_linear;
use headbox_core::frame::{Coverage, Frame};

/// Renders the same frame as [`super::LumigraphRenderer::render`] to within rounding: positions
/// there have 24 bits, so that a position near the border of a texel may find the next one.
pub fn render(lumigraph: &Lumigraph, camera: &Camera, settings: &LumigraphSettings) -> Frame {
    let view = PlaneView::new(lumigraph.grid(), camera);
    let layers = merged_layers(lumigraph, &view, settings, &mut Merger::default());
    let mut frame = Frame::default();
    frame.reset(camera.width(), camera.height(), settings.hole_color_srgb);
    let width = camera.width() as usize;
    for (i, (color, coverage)) in frame.color.iter_mut().zip(&mut frame.coverage).enumerate() {
        let direction = camera.direction((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let ray = Ray {
            lumigraph,
            eye: camera.eye(),
            direction,
        };
        let steps = steps(
            lumigraph.grid().columns().len(),
            lumigraph.grid().rows().len(),
        );
        match ray.trace(&layers, settings.blend, &steps) {
            RayResult::Color(linear) => {
                let [r, g, b] = linear.map(|c| srgb8_from_linear(c as f32));
                (*color, *coverage) = ([r, g, b, 255], Coverage::FULL);
            }
            RayResult::Hidden => {}
            RayResult::Nothing => {
                if let Some([r, g, b]) = lumigraph.environment.sample(direction.as_vec3()) {
                    (*color, *coverage) = ([r, g, b, 255], Coverage::ENVIRONMENT);
                }
            }
        }
    }
    frame
}

/// Result of a ray.
enum RayResult {
    /// Linear red, green and blue, 1 for white.
    Color([f64; 3]),
    /// The cameras of the cell see an occluder.
    Hidden,
    /// No camera of the cell covers the ray.
    Nothing,
}

struct Ray<'a> {
    lumigraph: &'a Lumigraph,
    eye: DVec3,
    direction: DVec3,
}

/// One of the ray's four cameras.
struct Neighbour {
    camera: Camera,
    number: usize,
    weight: f64,
}

impl Ray<'_> {
    /// Traces the ray for the cameras of its cell or, if they see an occluder, for those of
    /// neighbouring cells.
    fn trace(&self, layers: &[MergedLayer], blend: Blend, steps: &[Step]) -> RayResult {
        if let Some(color) = self.color(layers, blend, Step::FIRST) {
            return RayResult::Color(color);
        }
        let grid = self.lumigraph.grid();
        let (eye, along) = (
            grid.plane_from_world(self.eye),
            grid.direction_from_world(self.direction),
        );
        let Some(infinity) = layers
            .last()
            .filter(|_| along.z > super::grid::LEAST_FORWARD)
        else {
            return RayResult::Nothing;
        };
        let far = self.eye + self.direction * 1e12;
        let neighbours = self.neighbours(eye - along * (eye.z / along.z), [0, 0]);
        let images = neighbours
            .iter()
            .filter_map(|neighbour| self.project(neighbour, far, infinity.level));
        if images.filter(|image| image.nearest()[3] > 0).count() == 0 {
            return RayResult::Nothing;
        }
        steps
            .iter()
            .find_map(|step| self.color(layers, blend, *step))
            .map_or(RayResult::Hidden, RayResult::Color)
    }

    /// Composites the layers along the ray; `None` if no camera of the cell sees a surface that the
    /// ray hits.
    fn color(&self, layers: &[MergedLayer], blend: Blend, step: Step) -> Option<[f64; 3]> {
        let grid = self.lumigraph.grid();
        let (eye, along) = (
            grid.plane_from_world(self.eye),
            grid.direction_from_world(self.direction),
        );
        if along.z <= super::grid::LEAST_FORWARD {
            return None;
        }
        let neighbours = self.neighbours(eye - along * (eye.z / along.z), step.shift);
        let (mut color, mut open) = ([0.0; 3], 1.0);
        for layer in layers {
            let indices = if step.with_neighbours {
                layer.with_neighbours
            } else {
                layer.indices
            };
            // A point at infinity is a direction, the same for all cameras.
            let point = match layer.drawn {
                drawn if drawn > 0.0 => {
                    self.eye + self.direction * ((1.0 / drawn - eye.z) / along.z)
                }
                _ => self.eye + self.direction * 1e12,
            };
            let mut sum = [0.0; 4];
            let (mut showing, mut through) = (0.0, 0.0);
            for neighbour in &neighbours {
                let Some(image) = self.project(neighbour, point, layer.level) else {
                    continue;
                };
                let index = image.nearest()[3];
                if index < indices[0] {
                    through += neighbour.weight;
                } else if index <= indices[1] {
                    showing += neighbour.weight;
                    image.add_taps(indices, neighbour.weight, &mut sum);
                }
            }
            if showing > 0.0 {
                let share = match blend {
                    Blend::Whole => 1.0,
                    Blend::Shared => showing / (showing + through),
                };
                (0..3).for_each(|c| color[c] += open * share * sum[c] / sum[3]);
                open -= open * share;
            }
            if open < 1.0 / 256.0 {
                break;
            }
        }
        (open < 1.0).then(|| color.map(|c| c / (1.0 - open) / 65535.0))
    }

    /// Returns the four cameras of the cell that contains a crossing of the plane, or of the cell
    /// `shift` columns and rows from it.
    fn neighbours(&self, crossing: DVec3, shift: [i32; 2]) -> Vec<Neighbour> {
        let grid = self.lumigraph.grid();
        let least = f64::from(crate::render::lanes::rays::LEAST_WEIGHT);
        let sides = |places: &[f64], position: f64, shift: i32| {
            let last_cell = places.len() as i32 - 2;
            let cell = places.iter().filter(|place| **place <= position).count() as i32 - 1;
            let low = (cell.clamp(0, last_cell.max(0)) + shift).clamp(0, last_cell.max(0)) as usize;
            let high = (low + 1).min(places.len() - 1);
            let gap = places[high] - places[low];
            let share = if gap > 0.0 {
                ((position - places[low]) / gap).clamp(least, 1.0 - least)
            } else {
                0.5
            };
            [(low, 1.0 - share), (high, share)]
        };
        let (columns, rows) = (
            sides(grid.columns(), crossing.x, shift[0]),
            sides(grid.rows(), crossing.y, shift[1]),
        );
        let all = rows
            .into_iter()
            .flat_map(|row| columns.map(|column| (column, row)));
        let neighbour = |((column, column_weight), (row, row_weight))| Neighbour {
            camera: grid.camera(column, row),
            number: row * grid.columns().len() + column,
            weight: column_weight * row_weight,
        };
        all.map(neighbour).collect()
    }

    /// Projects a point into a camera's image; `None` if it is outside.
    fn project(
        &self,
        neighbour: &Neighbour,
        point: DVec3,
        level: usize,
    ) -> Option<ImagePosition<'_>> {
        let [x, y, _] = neighbour.camera.project(point)?;
        let pyramid = &self.lumigraph.pyramid;
        let size = pyramid.levels[level];
        let coarser = 0.5f64.powi(level as i32);
        let (x, y) = (x * coarser, y * coarser);
        let inside = x >= 0.0 && y >= 0.0 && x < size.width as f64 && y < size.height as f64;
        let texels = &pyramid.texels[neighbour.number * pyramid.stride + size.first..];
        inside.then_some(ImagePosition {
            texels,
            level: size,
            at: [x, y],
        })
    }
}

/// Position in a level of an image.
struct ImagePosition<'a> {
    texels: &'a [Texel],
    level: Level,
    at: [f64; 2],
}

impl ImagePosition<'_> {
    fn texel(&self, column: usize, row: usize) -> Texel {
        self.texels[row * self.level.width + column]
    }

    fn nearest(&self) -> Texel {
        self.texel(self.at[0] as usize, self.at[1] as usize)
    }

    /// Adds the bilinear taps that belong to one of the layers.
    fn add_taps(&self, indices: [u16; 2], weight: f64, sum: &mut [f64; 4]) {
        let sides = |at: f64, count: usize| {
            let at = (at - 0.5).clamp(0.0, (count - 1) as f64);
            let low = (at as usize).min(count - 2);
            [(low, 1.0 - (at - low as f64)), (low + 1, at - low as f64)]
        };
        for (column, column_weight) in sides(self.at[0], self.level.width) {
            for (row, row_weight) in sides(self.at[1], self.level.height) {
                let texel = self.texel(column, row);
                if (indices[0]..=indices[1]).contains(&texel[3]) {
                    let weight = weight * column_weight * row_weight;
                    (0..3).for_each(|c| sum[c] += weight * f64::from(texel[c]));
                    sum[3] += weight;
                }
            }
        }
    }
}
