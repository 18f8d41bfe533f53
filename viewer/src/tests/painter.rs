//! Software painter of egui's triangles: slow, but deterministic, so that screenshots can be
//! compared without a graphics driver. Equivalent to the shader of `egui_glow`.

use egui::{
    Color32, ColorImage, Context, FullOutput, Rect, TextureFilter, TextureId, TexturesDelta,
    epaint::{ClippedPrimitive, ImageData, Mesh, Primitive, Vertex, textures::TextureOptions},
};
use egui_kittest::TestRenderer;
use image::{Rgb, RgbImage};
use std::{cell::RefCell, collections::HashMap, rc::Rc};

/// Textures of a window, shared with the harness that updates them.
#[derive(Clone, Default)]
pub(super) struct Painter(Rc<RefCell<HashMap<TextureId, Texture>>>);

struct Texture {
    image: ColorImage,
    filter: TextureFilter,
}

impl TestRenderer for Painter {
    fn handle_delta(&mut self, delta: &mut TexturesDelta) {
        let mut textures = self.0.borrow_mut();
        for (id, deltas) in delta.set.drain() {
            for delta in deltas {
                let ImageData::Color(image) = &delta.image;
                let filter = TextureOptions { ..delta.options }.magnification;
                match (delta.pos, textures.get_mut(&id)) {
                    (Some(at), Some(texture)) => texture.patch(image, at),
                    _ => drop(textures.insert(
                        id,
                        Texture {
                            image: (**image).clone(),
                            filter,
                        },
                    )),
                }
            }
        }
        // Freed textures are kept: the last image may still use them, and tests are short.
        delta.clear();
    }
}

impl Texture {
    fn patch(&mut self, patch: &ColorImage, [left, top]: [usize; 2]) {
        for (y, row) in patch.pixels.chunks_exact(patch.size[0].max(1)).enumerate() {
            let start = (top + y) * self.image.size[0] + left;
            self.image.pixels[start..start + row.len()].copy_from_slice(row);
        }
    }

    /// Samples the colour at (u, v), 0 to 1 each.
    fn sample(&self, u: f64, v: f64) -> [f64; 4] {
        let [width, height] = self.image.size;
        let texel = |x: f64, y: f64| {
            let clamp = |at: f64, size: usize| at.clamp(0.0, size as f64 - 1.0) as usize;
            let color = self.image.pixels[clamp(y, height) * width + clamp(x, width)];
            color.to_array().map(|c| f64::from(c) / 255.0)
        };
        let (x, y) = (u * width as f64, v * height as f64);
        if self.filter == TextureFilter::Nearest {
            return texel(x.floor(), y.floor());
        }
        let (x, y) = (x - 0.5, y - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (fx, fy) = (x - left, y - top);
        let [a, b] = [texel(left, top), texel(left + 1.0, top)];
        let [c, d] = [texel(left, top + 1.0), texel(left + 1.0, top + 1.0)];
        std::array::from_fn(|i| {
            (a[i] * (1.0 - fx) + b[i] * fx) * (1.0 - fy) + (c[i] * (1.0 - fx) + d[i] * fx) * fy
        })
    }
}

impl Painter {
    /// Image of a pass over `background`.
    pub(super) fn picture(
        &self,
        ctx: &Context,
        output: &FullOutput,
        background: Color32,
    ) -> RgbImage {
        let scale = f64::from(output.pixels_per_point);
        let size = ctx.content_rect().size() * output.pixels_per_point;
        let [r, g, b, _] = background.to_array().map(|c| f64::from(c) / 255.0);
        let (width, height) = (size.x.round() as usize, size.y.round() as usize);
        let mut canvas = Canvas {
            width,
            height,
            pixels: vec![[r, g, b]; width * height],
        };
        let textures = self.0.borrow();
        for ClippedPrimitive {
            clip_rect,
            primitive,
        } in ctx.tessellate(output.shapes.clone(), output.pixels_per_point)
        {
            let Primitive::Mesh(mesh) = primitive else {
                continue;
            };
            if let Some(texture) = textures.get(&mesh.texture_id) {
                canvas.mesh(&mesh, texture, clip_rect, scale);
            }
        }
        canvas.finish()
    }
}

struct Canvas {
    width: usize,
    height: usize,
    pixels: Vec<[f64; 3]>,
}

impl Canvas {
    fn mesh(&mut self, mesh: &Mesh, texture: &Texture, clip: Rect, scale: f64) {
        let side = |points: f32, most: usize| {
            ((f64::from(points) * scale).round().max(0.0) as usize).min(most)
        };
        let columns = [
            side(clip.left(), self.width),
            side(clip.right(), self.width),
        ];
        let rows = [
            side(clip.top(), self.height),
            side(clip.bottom(), self.height),
        ];
        for corners in mesh.indices.chunks_exact(3) {
            let corners = [0, 1, 2].map(|i| mesh.vertices[corners[i] as usize]);
            self.triangle(corners, texture, [columns, rows], scale);
        }
    }

    fn triangle(
        &mut self,
        mut corners: [Vertex; 3],
        texture: &Texture,
        [columns, rows]: [[usize; 2]; 2],
        scale: f64,
    ) {
        let at = |vertex: &Vertex| {
            [
                f64::from(vertex.pos.x) * scale,
                f64::from(vertex.pos.y) * scale,
            ]
        };
        // Twice the area of the triangle a, b, p.
        let area = |a: [f64; 2], b: [f64; 2], p: [f64; 2]| {
            (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
        };
        let mut whole = area(at(&corners[0]), at(&corners[1]), at(&corners[2]));
        if whole < 0.0 {
            corners.swap(1, 2);
            whole = -whole;
        }
        if whole == 0.0 {
            return;
        }
        let p = [0, 1, 2].map(|i| at(&corners[i]));
        let bounds = |axis: usize, [start, end]: [usize; 2]| {
            let low = p.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
            let high = p.iter().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
            (low.floor().max(start as f64) as usize)..(high.ceil().clamp(0.0, end as f64) as usize)
        };
        // A centre on an edge shared by two triangles belongs to the one of which it is a top or
        // left edge.
        let owns = [0, 1, 2].map(|i| {
            let [a, b] = [p[(i + 1) % 3], p[(i + 2) % 3]];
            b[1] < a[1] || b[1] == a[1] && b[0] > a[0]
        });
        for (y, x) in bounds(1, rows).flat_map(|y| bounds(0, columns).map(move |x| (y, x))) {
            let centre = [x as f64 + 0.5, y as f64 + 0.5];
            let shares = [0, 1, 2].map(|i| area(p[(i + 1) % 3], p[(i + 2) % 3], centre) / whole);
            if shares
                .iter()
                .zip(owns)
                .all(|(share, owns)| *share > 0.0 || *share == 0.0 && owns)
            {
                self.blend(y * self.width + x, &corners, shares, texture);
            }
        }
    }

    fn blend(&mut self, pixel: usize, corners: &[Vertex; 3], shares: [f64; 3], texture: &Texture) {
        let mean = |value: &dyn Fn(&Vertex) -> f64| {
            corners
                .iter()
                .zip(shares)
                .map(|(c, share)| value(c) * share)
                .sum()
        };
        let texel = texture.sample(mean(&|v| v.uv.x.into()), mean(&|v| v.uv.y.into()));
        let color: [f64; 4] = std::array::from_fn(|i| {
            mean(&|v: &Vertex| f64::from(v.color.to_array()[i]) / 255.0) * texel[i]
        });
        let below = &mut self.pixels[pixel];
        *below = std::array::from_fn(|i| color[i] + below[i] * (1.0 - color[3]));
    }

    fn finish(self) -> RgbImage {
        RgbImage::from_fn(self.width as u32, self.height as u32, |x, y| {
            Rgb(self.pixels[y as usize * self.width + x as usize]
                .map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8))
        })
    }
}
