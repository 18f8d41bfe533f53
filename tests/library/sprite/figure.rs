//! Figure 3 of Shade et al. rebuilt as a contact sheet, and how far each variant carries: FLIP
//! against truth over the displacement of the eye, on `builtin:bump` and on a real house. They are
//! written to the test folder of the target directory (`sprite_figure3.html`, `sprite_range_*.csv`
//! and `.svg`); the order of the variants is asserted.

use glam::{DMat3, DVec3, dvec3};
use headbox_core::camera::Camera;
use headbox_core::drawing::contact_sheet::{SheetRow, contact_sheet};
use headbox_core::metrics::compare;
use headbox_core::progress::Silent;
use headbox_lab::sprite_range::SpriteRange;
use headbox_scene::material::Material;
use headbox_scene::scene::{Scene, Triangle};
use headbox_sprite::{
    DisplacementFormat, PreparedSprite, RenderOptions, SlabCapture, Sprite, SpriteLayer,
    SpriteRenderer, SpriteSampling, SpriteSet, SpriteTransfer, SpriteVariant, SpriteWithDepth,
    capture_slabs, slabs_at_gaps,
};
use headbox_trace::bvh::Tracer;
use headbox_trace::light::Lighting;
use headbox_trace::truth;
use image::{Rgb, RgbImage, Rgba, RgbaImage};
use std::path::Path;
use std::sync::Arc;

const SIZE: u32 = 256;

/// Size of the frames by which ranges are measured: enough to distinguish variants.
const RANGE_SIZE: u32 = 144;

/// Half of the plane's edge, metres: all of it is in the image.
const HALF: f64 = 1.65;

/// A square in the plane z = 0 with a relief, chequered in warm colours on the relief and cold ones
/// on the plane.
fn relief(height: impl Fn(f64, f64) -> f64) -> Tracer {
    const CELLS: u32 = 256;
    let mut scene = Scene::default();
    for albedo in [
        [0.80, 0.82, 0.85],
        [0.20, 0.30, 0.50],
        [0.95, 0.80, 0.45],
        [0.75, 0.25, 0.10],
    ] {
        scene.materials.push(Material {
            albedo,
            ..Material::default()
        });
    }
    let at = |i: u32| (f64::from(i) / f64::from(CELLS) * 2.0 - 1.0) * HALF;
    for j in 0..=CELLS {
        scene
            .positions
            .extend((0..=CELLS).map(|i| dvec3(at(i), at(j), height(at(i), at(j)))));
    }
    for (i, j) in (0..CELLS).flat_map(|j| (0..CELLS).map(move |i| (i, j))) {
        let corner = j * (CELLS + 1) + i;
        let risen = height(at(i) + 0.01, at(j) + 0.01) > 0.02;
        let material = u32::from(risen) * 2 + (i / 16 + j / 16) % 2;
        let quad = [corner, corner + 1, corner + CELLS + 2, corner + CELLS + 1];
        for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
            scene.triangles.push(Triangle {
                vertices: [quad[a], quad[b], quad[c]],
                material,
            });
        }
    }
    Tracer::new(Arc::new(scene), DVec3::ZERO)
}

fn hemisphere(x: f64, y: f64) -> f64 {
    (0.49 - x * x - y * y).max(0.0).sqrt()
}

fn pyramid(x: f64, y: f64) -> f64 {
    (0.7 - x.abs().max(y.abs())).max(0.0)
}

fn camera(eye: DVec3) -> Camera {
    Camera::look_at(eye, DVec3::ZERO, DVec3::Y, 60.0, [SIZE, SIZE]).expect("valid")
}

fn capture(tracer: &Tracer) -> SpriteWithDepth {
    let lighting = Lighting::unmetered(tracer, 0);
    let capture = SlabCapture {
        tracer,
        lighting: &lighting,
        lit: false,
        samples: 16,
        format: DisplacementFormat::I8,
    };
    let sprites = capture_slabs(
        &capture,
        &camera(dvec3(0.0, 0.0, 3.0)),
        &[[0.1, 10.0]],
        &Silent,
    )
    .expect("captured");
    sprites.into_iter().next().expect("one slab")
}

fn truth_at(tracer: &Tracer, target: &Camera) -> RgbImage {
    let frame = truth::render(
        tracer,
        &Lighting::unmetered(tracer, 0),
        false,
        target,
        16,
        &Silent,
    )
    .frame;
    // On white, like the sprites.
    RgbImage::from_fn(target.width(), target.height(), |x, y| {
        let at = (y * target.width() + x) as usize;
        let share = f32::from(frame.coverage[at].splat_share()) / 255.0;
        let mixed = |c: u8| (f32::from(c) * share + 255.0 * (1.0 - share)) as u8;
        let [r, g, b, _] = frame.color[at].map(mixed);
        Rgb([r, g, b])
    })
}

fn draw(
    sprite: &PreparedSprite,
    target: &Camera,
    variant: SpriteVariant,
    fill_steps: u32,
) -> RgbImage {
    let options = RenderOptions {
        variant,
        sampling: SpriteSampling::Bilinear,
        fill_steps,
    };
    let mut frame = SpriteLayer::default();
    SpriteRenderer::new().render(sprite, target, &options, &mut frame);
    frame.to_rgb(WHITE)
}

const WHITE: [u8; 3] = [255; 3];

/// The same sprite coloured by its displacement, like the depth maps in the paper.
fn colored_by_depth(sprite: &SpriteWithDepth) -> PreparedSprite {
    let values = sprite.displacement().to_f32();
    let largest = values.iter().fold(1e-6f32, |max, v| max.max(*v));
    let color = RgbaImage::from_fn(SIZE, SIZE, |x, y| {
        let grey = (values[(y * SIZE + x) as usize] / largest * 215.0).max(0.0) as u8 + 40;
        Rgba([grey, grey, grey, 255])
    });
    let flat =
        Sprite::new(color, *sprite.sprite().camera(), *sprite.sprite().plane()).expect("valid");
    PreparedSprite::new(
        SpriteWithDepth::new(flat, sprite.displacement().clone()).expect("sizes agree"),
    )
}

/// Depth moved by parallax alone: no homography.
fn pure_parallax(depth: &PreparedSprite, target: &Camera) -> RgbImage {
    let full = SpriteTransfer::new(depth.sprite().sprite(), target).expect("in front");
    let pure = SpriteTransfer::from_parts(DMat3::IDENTITY, full.epipole_in_sprite, full.side)
        .expect("regular");
    let mut frame = SpriteLayer::new(SIZE, SIZE);
    SpriteRenderer::new().render_transfer(depth, &pure, &RenderOptions::default(), &mut frame);
    frame.to_rgb(WHITE)
}

fn opaque(picture: &RgbaImage) -> RgbImage {
    RgbImage::from_fn(picture.width(), picture.height(), |x, y| {
        let [r, g, b, a] = picture.get_pixel(x, y).0;
        // On white, like all images here.
        Rgb([r, g, b]
            .map(|c| ((u32::from(c) * u32::from(a) + 255 * (255 - u32::from(a))) / 255) as u8))
    })
}

/// Writes a contact sheet and its pictures to the test folder of the target directory.
fn save_sheet(name: &str, title: &str, rows: &[(&str, Vec<(RgbImage, String)>)]) {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let mut sheet = Vec::new();
    for (row, (label, cells)) in rows.iter().enumerate() {
        let mut pictures = Vec::new();
        for (column, (image, caption)) in cells.iter().enumerate() {
            let file = format!("{name}_{row}_{column}.png");
            image.save(folder.join(&file)).expect("written");
            pictures.push((file, caption.clone()));
        }
        sheet.push(SheetRow {
            label: (*label).into(),
            pictures,
        });
    }
    let page = folder.join(format!("{name}.html"));
    std::fs::write(&page, contact_sheet(title, &sheet)).expect("written");
    println!("{}", page.display());
}

#[test]
fn figure_3() {
    let tracer = relief(hemisphere);
    let sprite = capture(&tracer);
    let depth = colored_by_depth(&sprite);
    let prepared = PreparedSprite::new(sprite);
    let target = camera(dvec3(1.1, 0.35, 2.6));
    let truth = truth_at(&tracer, &target);
    let shown = |variant, steps| draw(&prepared, &target, variant, steps);
    let cell = |image: RgbImage, caption: &str| (image, caption.to_owned());
    let rendered = |variant, steps, caption: &str| {
        let image = shown(variant, steps);
        let flip = compare(&truth, &image).expect("sizes agree").flip;
        (cell(image, &format!("{caption}; FLIP {flip:.3}")), flip)
    };
    let (b, flip_b) = rendered(SpriteVariant::Homography, 0, "(b) homography only");
    let (c, flip_c) = rendered(SpriteVariant::OnePass, 0, "(c) crude parallax, d1");
    let (d, flip_d) = rendered(SpriteVariant::TwoPass, 1, "(d) two passes, filling 1");
    let (e, flip_e) = rendered(SpriteVariant::TwoPass, 3, "(e) two passes, filling 3");
    let (baseline, flip_forward) =
        rendered(SpriteVariant::ForwardColor, 0, "colours mapped forward");
    let (printed, _) = rendered(SpriteVariant::AsPrinted, 3, "equations 7, 8 as printed");
    let (shift, _) = rendered(SpriteVariant::ShiftField, 3, "2-D displacement field");
    let (affine, _) = rendered(SpriteVariant::AffineParallax, 3, "affine parallax");
    let pyramid_sprite = PreparedSprite::new(capture(&relief(pyramid)));
    let color = vec![
        cell(
            opaque(prepared.sprite().sprite().color()),
            "(a) input colour",
        ),
        b,
        c,
        d,
        e,
    ];
    let displacement = vec![
        cell(
            opaque(depth.sprite().sprite().color()),
            "(f) input displacement d1",
        ),
        cell(
            pure_parallax(&depth, &target),
            "(g) moved by pure parallax, d3",
        ),
        cell(
            draw(&depth, &target, SpriteVariant::TwoPass, 3),
            "(h) parallax and homography, d2",
        ),
        cell(
            draw(&depth, &target, SpriteVariant::Homography, 3),
            "(i) homography only",
        ),
        cell(
            draw(&pyramid_sprite, &target, SpriteVariant::TwoPass, 1),
            "(j) a pyramid, gap filling 1",
        ),
    ];
    let others = vec![
        cell(truth.clone(), "truth"),
        baseline,
        printed,
        shift,
        affine,
    ];
    let rows = [
        ("colour", color),
        ("displacement", displacement),
        ("others", others),
    ];
    save_sheet(
        "sprite_figure3",
        "Shade et al. 1998, figure 3: plane with bump",
        &rows,
    );
    assert!(
        flip_e <= flip_d && flip_d < flip_c && flip_c < flip_b,
        "{flip_e} {flip_d} {flip_c} {flip_b}"
    );
    assert!(flip_e < flip_forward, "{flip_e} {flip_forward}");
}

/// Captures one sprite from `reference` and measures every variant for a moving eye. Writes a table
/// and a chart; returns FLIP by displacement and variant.
fn range_chart(
    name: &str,
    tracer: &Tracer,
    reference: &Camera,
) -> Vec<[f64; SpriteVariant::ALL.len()]> {
    let mut lighting = Lighting::unmetered(tracer, 0);
    lighting.sky = None;
    let capture = SlabCapture {
        tracer,
        lighting: &lighting,
        lit: false,
        samples: 16,
        format: DisplacementFormat::I8,
    };
    let sprites = capture_slabs(&capture, reference, &[[0.01, 1e6]], &Silent).expect("captured");
    let range =
        SpriteRange::measure(&capture, reference, SpriteSet::new(sprites)).expect("measured");
    let range = range.expect("something is ahead");
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    std::fs::write(
        folder.join(format!("sprite_range_{name}.csv")),
        range.to_csv(),
    )
    .expect("written");
    std::fs::write(
        folder.join(format!("sprite_range_{name}.svg")),
        range.chart(name).to_svg(),
    )
    .expect("written");
    println!("{name}\n{}{}", range.to_csv(), range.sentences().join("\n"));
    range.places.iter().map(|place| place.flips).collect()
}

#[test]
fn flip_over_eye_displacement_on_bump() {
    let scene = Arc::new(headbox_scenes::build("bump", 0).expect("built in"));
    let reference = Camera::look_at(
        dvec3(0.0, 0.0, 3.0),
        DVec3::ZERO,
        DVec3::Y,
        60.0,
        [RANGE_SIZE, RANGE_SIZE],
    );
    let reference = reference.expect("valid");
    let tracer = Tracer::new(scene, reference.eye());
    let rows = range_chart("bump", &tracer, &reference);
    // Farther away, most of the frame is not in the sprite, for any variant.
    for [homography, one_pass, two_pass, ..] in &rows[1..7] {
        assert!(
            two_pass < one_pass && one_pass < homography,
            "{two_pass} {one_pass} {homography}"
        );
    }
}

#[test]
fn flip_over_eye_displacement_in_a_real_house() {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/small_house/small_house.obj");
    if !path.exists() {
        println!("skipped: {} is absent", path.display());
        return;
    }
    let scene = Arc::new(
        headbox_ldi::scene_source::SceneSource::new(path.to_string_lossy())
            .open()
            .expect("loads"),
    );
    let [low, high] = scene.bounds();
    let headbox = headbox_trace::viewpoint::suggest_headbox(&Tracer::new(
        Arc::clone(&scene),
        (low + high) / 2.0,
    ));
    let tracer = Tracer::new(scene, headbox.centre);
    // Toward the side with the most space.
    let sides = [DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z];
    let room = |side: DVec3| {
        let camera = Camera::look_at(
            headbox.centre,
            headbox.centre + side,
            DVec3::Y,
            60.0,
            [1, 1],
        )
        .expect("valid");
        let ray = headbox_trace::bvh::Ray {
            origin: (camera.eye() - tracer.origin()).as_vec3(),
            direction: camera.forward().as_vec3(),
            t_min: 0.0,
            t_max: f32::INFINITY,
        };
        tracer.closest(&ray).map_or(0.0, |hit| f64::from(hit.t))
    };
    let ahead = sides
        .into_iter()
        .max_by(|&a, &b| room(a).total_cmp(&room(b)))
        .expect("four sides");
    let look_at = headbox.centre + ahead * room(ahead);
    let reference = Camera::look_at(
        headbox.centre,
        look_at,
        DVec3::Y,
        60.0,
        [RANGE_SIZE, RANGE_SIZE],
    )
    .expect("valid");
    let rows = range_chart("house", &tracer, &reference);
    for [homography, _, two_pass, ..] in &rows[1..5] {
        assert!(two_pass < homography, "{two_pass} {homography}");
    }
}

#[test]
fn four_layers_approximate_scene() {
    let scene = headbox_scenes::build("sprites", 0).expect("built in");
    let tracer = Tracer::new(Arc::new(scene), DVec3::ZERO);
    let mut lighting = Lighting::unmetered(&tracer, 0);
    lighting.sky = None; // black, as a frame of sprites is where there is none
    let reference =
        Camera::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 60.0, [SIZE, SIZE]).expect("valid");
    let slabs = slabs_at_gaps(&tracer, &reference, 4);
    let capture = SlabCapture {
        tracer: &tracer,
        lighting: &lighting,
        lit: false,
        samples: 16,
        format: DisplacementFormat::I8,
    };
    let set =
        SpriteSet::new(capture_slabs(&capture, &reference, &slabs, &Silent).expect("captured"));
    assert_eq!(set.sprites().len(), 4);
    assert_eq!(
        set.back_to_front(DVec3::ZERO),
        [0, 1, 2, 3],
        "slabs come from far to near"
    );
    let target = reference.with_eye(dvec3(0.25, 0.1, -0.2));
    let truth = truth::render(&tracer, &lighting, false, &target, 16, &Silent).rgb();
    let mut cells = vec![(truth.clone(), "truth".to_owned())];
    let mut frame = SpriteLayer::default();
    let mut flip = |variant: SpriteVariant| {
        let options = RenderOptions {
            variant,
            ..RenderOptions::default()
        };
        set.render(&mut SpriteRenderer::new(), &target, &options, &mut frame);
        let image = frame.to_rgb([0; 3]);
        let flip = compare(&truth, &image).expect("sizes agree").flip;
        cells.push((image, format!("{}; FLIP {flip:.3}", variant.name())));
        flip
    };
    let [homography, two_pass] = [SpriteVariant::Homography, SpriteVariant::TwoPass].map(&mut flip);
    save_sheet("sprite_layers", "four sprites with depth", &[("", cells)]);
    assert!(two_pass < 0.7 * homography, "{two_pass} {homography}");
}
