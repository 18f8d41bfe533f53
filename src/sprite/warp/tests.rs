//! Source addresses of drawn pixels against an f64 oracle: the displacement field (S7), the
//! approximate variants (S6, S8), and displacement maps coarser than the picture (S4).
//!
//! A sprite is drawn twice, with a picture whose colours tell columns and with one whose colours
//! tell rows, so that every pixel of the frame reports the position that was sampled.

use crate::{
    Displacement, DisplacementFormat, PreparedSprite, RenderOptions, Sprite, SpriteLayer,
    SpritePlane, SpriteRenderer, SpriteSampling, SpriteTransfer, SpriteVariant, SpriteWithDepth,
};
use glam::{DMat3, DVec3, dvec3};
use headbox_core::camera::Camera;
use image::{Rgba, RgbaImage};

/// Pixels a side of the pictures.
const SIZE: u32 = 256;
const SIZE_F64: f64 = SIZE as f64;

/// Resolution of a decoded address, pixels: colours are rounded to half a level and their weights
/// to a little more, at 60 levels per pixel.
const DECODING_PX: f64 = 0.012;
/// Error of the first pass, pixels: its cells hold 15 bits of displacement, its slopes 8 bits, and
/// it extrapolates by up to a cell across a surface that bends.
const FIRST_PASS_PX: f64 = 0.02;

/// Distance from the picture's border within which positions are not compared, pixels.
const MARGIN_PX: f64 = 12.0;

/// Colour at a position in pixels from the first pixel's centre. Red and green are triangle waves
/// of 8 px, a quarter of a period apart, and linear between the centres of pixels: bilinear
/// interpolation reproduces them exactly.
fn phase_color(position: u32) -> Rgba<u8> {
    let triangle = |p: u32| (60 * (p % 8).abs_diff(4)) as u8;
    Rgba([triangle(position), triangle(position + 2), 0, 255])
}

/// Inverse of [`phase_color`]: the position in pixels from the picture's border that is nearest to
/// `near`.
fn decoded([red, green, ..]: [u8; 4], near: f64) -> f64 {
    // Both waves together walk along the sides of a square that stands on a corner.
    let (u, v) = (f64::from(red) - 120.0, 120.0 - f64::from(green));
    let along = u / (u.abs() + v.abs());
    let quarters = if v >= 0.0 { 1.0 - along } else { 3.0 + along };
    let position = 2.0 * quarters + 0.5;
    position + 8.0 * ((near - position) / 8.0).round()
}

/// An analytic displacement over the picture, positions in pixels.
#[derive(Clone, Copy)]
enum Surface {
    Constant(f64),
    /// One wave across the picture in either direction; largest value.
    Waves(f64),
}

const RADIANS_PER_PX: f64 = std::f64::consts::TAU / SIZE_F64;

impl Surface {
    fn at(self, [x, y]: [f64; 2]) -> f64 {
        match self {
            Self::Constant(d) => d,
            Self::Waves(d) => {
                d * (RADIANS_PER_PX * x + 0.3).sin() * (RADIANS_PER_PX * y - 0.5).cos()
            }
        }
    }

    /// Samples at the centres of a grid over the picture.
    fn sampled(self, [columns, rows]: [u32; 2]) -> Displacement {
        let at = |i: u32, count: u32| (f64::from(i) + 0.5) * SIZE_F64 / f64::from(count);
        let values: Vec<f32> = (0..columns * rows)
            .map(|i| self.at([at(i % columns, columns), at(i / columns, rows)]) as f32)
            .collect();
        Displacement::new(columns, rows, &values, DisplacementFormat::F32).expect("finite")
    }
}

fn look(eye: DVec3, at: DVec3, size: u32) -> Camera {
    Camera::look_at(eye, at, DVec3::Y, 50.0, [size; 2]).expect("valid camera")
}

/// A sprite on a plane that leans a little, two metres from its camera.
fn sprite(picture: RgbaImage, displacement: Displacement) -> SpriteWithDepth {
    let camera = look(dvec3(0.05, -0.03, 2.0), DVec3::ZERO, SIZE);
    let plane = SpritePlane::through(DVec3::ZERO, dvec3(0.15, -0.1, 1.0));
    let sprite = Sprite::new(picture, camera, plane).expect("valid sprite");
    SpriteWithDepth::new(sprite, displacement).expect("sizes agree")
}

/// A surface, the grid on which it is stored, and the view from which it is drawn.
struct AddressBed {
    surface: Surface,
    grid: [u32; 2],
    transfer: SpriteTransfer,
    frame_px: u32,
}

impl AddressBed {
    /// A view that magnifies, so that no coarser level of the picture is sampled.
    fn seen_from(eye: DVec3, surface: Surface, grid: [u32; 2]) -> Self {
        let frame_px = 384;
        let target = look(eye, dvec3(0.02, 0.0, 0.0), frame_px);
        let any = sprite(RgbaImage::new(SIZE, SIZE), Displacement::zero(1, 1));
        let transfer = SpriteTransfer::new(any.sprite(), &target).expect("in front");
        Self {
            surface,
            grid,
            transfer,
            frame_px,
        }
    }

    /// A view in which every pixel shows the place on the plane at the centre of a picture's pixel.
    fn pixel_by_pixel(epipole: DVec3, surface: Surface, grid: [u32; 2]) -> Self {
        Self {
            surface,
            grid,
            transfer: SpriteTransfer::from_parts(DMat3::IDENTITY, epipole, 1.0).expect("regular"),
            frame_px: SIZE,
        }
    }

    fn draw(&self, picture: RgbaImage, options: &RenderOptions) -> SpriteLayer {
        let prepared = PreparedSprite::new(sprite(picture, self.surface.sampled(self.grid)));
        let mut frame = SpriteLayer::new(self.frame_px, self.frame_px);
        SpriteRenderer::new().render_transfer(&prepared, &self.transfer, options, &mut frame);
        frame
    }

    /// Position on the plane seen at the centre of a pixel of the frame.
    fn on_plane(&self, index: usize) -> [f64; 2] {
        let [x, y] = [index as u32 % self.frame_px, index as u32 / self.frame_px];
        let seen = dvec3(f64::from(x) + 0.5, f64::from(y) + 0.5, 1.0);
        let plane = self.transfer.sprite_from_target * seen;
        [plane.x / plane.z, plane.y / plane.z]
    }

    /// The exact source of a position on the plane, as a fixed point of Eq. 6:
    /// `x1 = x3 (1 + d e_z) - d e` with `d = d(x1)`.
    fn exact(&self, on_plane: [f64; 2]) -> [f64; 2] {
        let e = self.transfer.epipole_in_sprite;
        let step = |source: [f64; 2]| {
            let d = self.surface.at(source);
            let w = 1.0 + d * e.z;
            [on_plane[0] * w - d * e.x, on_plane[1] * w - d * e.y]
        };
        (0..60).fold(on_plane, |source, _| step(source))
    }

    /// Largest distance between where a variant samples and `expected`, pixels, and the largest
    /// distance between `expected` and the exact source. A transparent pixel counts as an error of
    /// a whole period.
    fn error(&self, variant: SpriteVariant, expected: impl Fn([f64; 2]) -> [f64; 2]) -> [f64; 2] {
        let options = RenderOptions {
            variant,
            sampling: SpriteSampling::Bilinear,
            ..RenderOptions::default()
        };
        let columns = RgbaImage::from_fn(SIZE, SIZE, |x, _| phase_color(x));
        let rows = RgbaImage::from_fn(SIZE, SIZE, |_, y| phase_color(y));
        let frames = [columns, rows].map(|picture| self.draw(picture, &options));
        let inside = |p: [f64; 2]| {
            p.iter()
                .all(|v| *v > MARGIN_PX && *v < SIZE_F64 - MARGIN_PX)
        };
        let (mut worst, mut off_exact, mut count) = (0.0f64, 0.0f64, 0);
        for i in (0..frames[0].pixels().len()).step_by(7) {
            let on_plane = self.on_plane(i);
            let (source, exact) = (expected(on_plane), self.exact(on_plane));
            if ![on_plane, source, exact].into_iter().all(inside) {
                continue;
            }
            count += 1;
            let pixels = [0, 1].map(|axis| frames[axis].pixels()[i]);
            let found = [0, 1].map(|axis| decoded(pixels[axis], source[axis]));
            let opaque = pixels.iter().all(|pixel| pixel[3] == 255);
            let distance = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
            worst = worst.max(if opaque { distance(found, source) } else { 8.0 });
            off_exact = off_exact.max(distance(source, exact));
        }
        assert!(count > 2000, "{count} pixels compared");
        println!(
            "{}: off by {worst:.4} px, the exact source is {off_exact:.2} px away",
            variant.name()
        );
        [worst, off_exact]
    }

    fn error_of_exact(&self, variant: SpriteVariant) -> f64 {
        self.error(variant, |on_plane| self.exact(on_plane))[0]
    }

    /// Largest change of the parallax from pixel to pixel.
    fn steepest(&self, amplitude: f64) -> f64 {
        let e = self.transfer.epipole_in_sprite;
        let reach = [0.0, SIZE_F64].map(|x| [0.0, SIZE_F64].map(|y| [x, y]));
        let arms = reach.as_flattened().iter();
        let arm = arms.map(|[x, y]| (e.x - x * e.z).hypot(e.y - y * e.z));
        amplitude * RADIANS_PER_PX * arm.fold(0.0, f64::max)
    }
}

#[test]
fn phase_colors_decode_to_their_positions() {
    for position in 0..64 {
        let found = decoded(phase_color(position).0, f64::from(position) + 2.0);
        assert!((found - f64::from(position) - 0.5).abs() < 1e-9, "{found}");
    }
}

#[test]
fn shift_field_is_exact_at_cell_centres() {
    // Toward the plane and to the side: all three components of the epipole count.
    let epipole = dvec3(70.0, -35.0, 0.4);
    let bed = AddressBed::pixel_by_pixel(epipole, Surface::Waves(0.05), [SIZE; 2]);
    let error = bed.error_of_exact(SpriteVariant::ShiftField);
    assert!(error <= DECODING_PX + FIRST_PASS_PX, "{error} px");
}

#[test]
fn shift_field_errs_by_half_a_cell_of_slope() {
    // A cell holds one shift (Eq. 9). Off its centre by half a diagonal at most, the shift is off
    // by what parallax changes on the way; the surface that changes by `steepest` per pixel of the
    // picture may arrive squeezed by as much.
    let amplitude = 0.039;
    let bed = AddressBed::seen_from(dvec3(0.55, 0.25, 1.8), Surface::Waves(amplitude), [SIZE; 2]);
    let steepest = bed.steepest(amplitude);
    let cell = std::f64::consts::FRAC_1_SQRT_2 * steepest / (1.0 - steepest);
    let error = bed.error_of_exact(SpriteVariant::ShiftField);
    assert!(
        error <= cell + DECODING_PX + FIRST_PASS_PX,
        "{error} px of {cell}"
    );
}

#[test]
fn affine_parallax_errs_in_proportion_to_position() {
    // At a constant displacement Eq. 6 without its third component is x1 = x3 - d e, and the exact
    // source is x3 (1 + d e_z) - d e: what is missing is d e_z x3 (S8).
    for d in [0.03, -0.03] {
        let epipole = dvec3(70.0, -35.0, 0.4);
        let bed = AddressBed::pixel_by_pixel(epipole, Surface::Constant(d), [SIZE; 2]);
        let theory = |on_plane: [f64; 2]| {
            let exact = bed.exact(on_plane);
            [0, 1].map(|axis| exact[axis] - d * epipole.z * on_plane[axis])
        };
        let [error, off_exact] = bed.error(SpriteVariant::AffineParallax, theory);
        assert!(error <= DECODING_PX + FIRST_PASS_PX, "{error} px");
        assert!(off_exact > 3.0, "the variant has an error: {off_exact} px");
        let exact = bed.error_of_exact(SpriteVariant::TwoPass);
        assert!(exact <= DECODING_PX + FIRST_PASS_PX, "two passes have none");
    }
}

#[test]
fn one_pass_samples_by_the_displacement_on_the_plane() {
    // Eq. 8 with d1 looked up where the plane is seen, not where the surface is (S6).
    let bed = AddressBed::seen_from(dvec3(0.9, 0.4, 1.6), Surface::Waves(0.05), [SIZE; 2]);
    let e = bed.transfer.epipole_in_sprite;
    let theory = |on_plane: [f64; 2]| {
        let d = bed.surface.at(on_plane);
        let w = 1.0 - d * e.z;
        [(on_plane[0] - d * e.x) / w, (on_plane[1] - d * e.y) / w]
    };
    let [error, off_exact] = bed.error(SpriteVariant::OnePass, theory);
    assert!(error <= DECODING_PX + FIRST_PASS_PX, "{error} px");
    assert!(off_exact > 0.5, "the variant has an error: {off_exact} px");
}

/// Grids of cells of 4 px, of 1 x 4 px, of 4 x 1 px, and of no whole number of pixels. In yet
/// coarser ones the waves are steeper than cells can hold, a sixteenth of the range per cell.
const COARSE_GRIDS: [[u32; 2]; 4] = [[64, 64], [256, 64], [64, 256], [51, 77]];

/// Eyes to the right of the sprite's camera and above it.
const ASIDE: [DVec3; 2] = [dvec3(0.55, 0.25, 1.8), dvec3(-0.2, 0.6, 1.8)];

/// Error of extrapolating a cell by `reach` cells along both axes, over the amplitude of the waves.
/// With cells of `c` radians of a wave, the surface leaves its tangent by half the square of the
/// way, `reach (c_x + c_y)`; and a slope, which does not reach across edges and extrema, errs by
/// `c / 2`.
fn bending([columns, rows]: [u32; 2], reach: f64) -> f64 {
    let [x, y] = [columns, rows].map(|count| std::f64::consts::TAU / f64::from(count));
    (reach * (x + y)).powi(2) / 2.0 + reach * (x * x + y * y) / 2.0
}

#[test]
fn coarse_displacement_finds_the_exact_source() {
    for (grid, eye) in COARSE_GRIDS
        .into_iter()
        .flat_map(|grid| ASIDE.map(|eye| (grid, eye)))
    {
        let amplitude = 0.039;
        let bed = AddressBed::seen_from(eye, Surface::Waves(amplitude), grid);
        let steepest = bed.steepest(amplitude);
        let parallax_px = steepest / RADIANS_PER_PX;
        // The first pass extrapolates by half a cell, and the second by another; the displacement
        // that is off is looked up elsewhere, where it is off by as much again as it is steep.
        let bent_px = parallax_px * bending(grid, 1.0) / (1.0 - steepest);
        let bound = bent_px + DECODING_PX + FIRST_PASS_PX;
        let error = bed.error_of_exact(SpriteVariant::TwoPass);
        println!("{grid:?}: {error:.4} of {bound:.4} px");
        assert!(error <= bound, "{grid:?}: {error} px of {bound}");
        assert!(parallax_px > 6.0 * bound, "{parallax_px} px of parallax");
    }
}

/// The forward mapping is in f64; displacements have 15 bits.
const ROUNDING_PX: f64 = 0.002;

#[test]
fn coarse_displacement_moves_colors_forward_by_equation_4() {
    let picture = RgbaImage::from_fn(SIZE, SIZE, |x, y| Rgba([x as u8, y as u8, 0, 255]));
    for (grid, eye) in COARSE_GRIDS
        .into_iter()
        .flat_map(|grid| ASIDE.map(|eye| (grid, eye)))
    {
        let amplitude = 0.039;
        let bed = AddressBed::seen_from(eye, Surface::Waves(amplitude), grid);
        let options = RenderOptions {
            variant: SpriteVariant::ForwardColor,
            sampling: SpriteSampling::Nearest,
            ..RenderOptions::default()
        };
        let frame = bed.draw(picture.clone(), &options);
        // Largest distance of a colour from where Eq. 4 has it, over what `bending` allows there.
        let d_off = amplitude * bending(grid, 0.5);
        let (mut count, mut worst) = (0, 0.0f64);
        for (i, &[red, green, _, alpha]) in frame.pixels().iter().enumerate() {
            if alpha == 0 {
                continue;
            }
            count += 1;
            let [x, y] = [red, green].map(|v| f64::from(v) + 0.5);
            let d = bed.surface.at([x, y]);
            let [expected, off] =
                [d, d + d_off].map(|d| bed.transfer.forward(x, y, d).expect("in front"));
            let pixel = [i as u32 % bed.frame_px, i as u32 / bed.frame_px].map(f64::from);
            for axis in [0, 1] {
                let from_left = expected[axis] - pixel[axis];
                let outside = (-from_left).max(from_left - 1.0);
                let allowed = (off[axis] - expected[axis]).abs() + ROUNDING_PX;
                worst = worst.max(outside / allowed);
            }
        }
        println!("{grid:?}: {worst:.3} of what is allowed");
        assert!(count > 20_000, "{count} pixels drawn");
        assert!(worst <= 1.0, "{grid:?}: {worst} of what is allowed");
    }
}

#[test]
fn coarse_displacement_tells_eye_depths_at_cell_centres() {
    let grid = [33, 47];
    let surface = Surface::Waves(0.2);
    let sprite = sprite(RgbaImage::new(SIZE, SIZE), surface.sampled(grid));
    let (camera, plane) = (sprite.sprite().camera(), sprite.sprite().plane());
    for (x, y) in (0..grid[1]).flat_map(|y| (0..grid[0]).map(move |x| (x, y))) {
        let centre =
            [0, 1].map(|axis| (f64::from([x, y][axis]) + 0.5) * SIZE_F64 / f64::from(grid[axis]));
        let depth = sprite.eye_depth(x, y).expect("in front");
        let point = camera.eye() + camera.direction(centre[0], centre[1]) * depth;
        // S2: the distance off the plane over the eye depth, in units of the eye's distance.
        let off_plane = plane.signed_distance(point);
        let expected = surface.at(centre) * depth;
        assert!(
            (off_plane - expected).abs() < 1e-6,
            "{x} {y}: {off_plane} {expected} (rounding of f32)"
        );
    }
}
