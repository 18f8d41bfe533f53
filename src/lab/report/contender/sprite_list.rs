//! Contenders that draw sprites, in the variants of the paper.

use super::contender_list::{ContenderList, NEAREST_SPRITES};
use super::wall::WALL;
use super::{Contender, Role, SpriteDraw};
use crate::plan::{EyeSet, Place};
use crate::report::subject::{ReportError, Subject};
use headbox_core::camera::Camera;
use headbox_core::progress::Silent;
use headbox_cube::pack::CubeLdi;
use headbox_sprite::compose::Composition;
use headbox_sprite::{
    Displacement, DisplacementFormat, PreparedSprite, RenderOptions, SlabCapture, SpriteSampling,
    SpriteSet, SpriteVariant, SpriteWithDepth, capture_slabs, slabs_at_gaps,
};
use std::sync::Arc;
use std::time::Instant;

impl ContenderList<'_> {
    /// Adds sprites with depth in the paper's variants.
    pub(super) fn add_sprites(&mut self, cube: &Arc<CubeLdi>) -> Result<(), ReportError> {
        let start = Instant::now();
        let given = self.subject.sprites.as_ref();
        let Some(sprites) = (match given {
            Some(set) => Some(set.clone()),
            None => self.capture_sprites()?,
        }) else {
            return Ok(());
        };
        let capture_s = given.is_none().then(|| start.elapsed().as_secs_f64());
        if sprites.sprites().is_empty() {
            return Ok(());
        }
        let layers = |set: SpriteSet| (set.bytes(), Arc::new(Composition::new(set, Vec::new())));
        // Given sprites keep their format.
        let default = layers(if given.is_some() {
            sprites.clone()
        } else {
            converted(&sprites, DisplacementFormat::I8)?
        });
        let contender = |roles: Vec<Role>,
                         (bytes, layers): &(u64, Arc<Composition>),
                         options: RenderOptions| Contender {
            roles,
            eyes: EyeSet::Ahead,
            traces: false,
            pool: Arc::clone(&self.all),
            bytes: *bytes,
            depth_pixels: 0,
            capture_s,
            rays: None,
            draw: Box::new(SpriteDraw::new(Arc::clone(layers), options)),
        };
        let options = RenderOptions::default();
        let mut contenders = Vec::new();
        if self.wall.is_some() {
            let role = Role::other(WALL, format!("sprites, {}", SpriteVariant::TwoPass.name()));
            contenders.push(Contender {
                eyes: EyeSet::Wall,
                ..contender(vec![role], &default, options)
            });
        }
        let mut add = |roles, options| contenders.push(contender(roles, &default, options));
        for variant in [
            SpriteVariant::TwoPass,
            SpriteVariant::OnePass,
            SpriteVariant::Homography,
            SpriteVariant::ShiftField,
            SpriteVariant::AsPrinted,
        ] {
            let mut roles = vec![Role::other("sprites", variant.name())];
            if variant == SpriteVariant::TwoPass {
                roles.push(Role::baseline("sprite displacement", "8 bits"));
                roles.push(Role::baseline("sprite gap filling", "3 steps"));
                roles.push(Role::baseline("sprite sampling", "bilinear"));
            }
            add(roles, RenderOptions { variant, ..options });
        }
        for variant in [
            SpriteVariant::Homography,
            SpriteVariant::OnePass,
            SpriteVariant::TwoPass,
        ] {
            let is_baseline = variant == SpriteVariant::Homography;
            let mut roles = vec![Role::new(NEAREST_SPRITES, variant.name(), is_baseline)];
            if variant == SpriteVariant::TwoPass {
                roles.push(Role::other("sprite sampling", "nearest"));
            }
            let options = RenderOptions {
                variant,
                sampling: SpriteSampling::Nearest,
                ..options
            };
            add(roles, options);
        }
        for (fill_steps, name) in [(0, "0 steps"), (1, "1 step"), (8, "8 steps")] {
            let options = RenderOptions {
                fill_steps,
                ..options
            };
            add(vec![Role::other("sprite gap filling", name)], options);
        }
        if given.is_none() {
            for (format, name) in [
                (DisplacementFormat::I16, "16 bits"),
                (DisplacementFormat::F32, "32-bit float"),
            ] {
                let role = Role::other("sprite displacement", name);
                let layers = layers(converted(&sprites, format)?);
                contenders.push(contender(vec![role], &layers, options));
            }
        }
        self.add_ldi(vec![Role::baseline("sprites", "LDI")], cube, None);
        self.contenders.extend(contenders);
        Ok(())
    }

    /// Captures sprites from the centre, looking ahead, with a wider view than the frames.
    fn capture_sprites(&self) -> Result<Option<SpriteSet>, ReportError> {
        const MARGIN: f64 = 1.5;
        const LAYERS: usize = 4;
        let Some(first) = self
            .plan
            .eyes
            .iter()
            .find(|eye| eye.place == Place::Line(0.0))
        else {
            return Ok(None);
        };
        let camera = &first.camera;
        let [width, height] =
            [camera.width(), camera.height()].map(|side| (f64::from(side) * MARGIN) as u32);
        let wider = Camera::from_parts(
            camera.eye(),
            camera.world_from_eye(),
            camera.focal_px(),
            width,
            height,
        )?;
        let Subject {
            tracer,
            lighting,
            lit,
            ..
        } = self.subject;
        let capture = SlabCapture {
            tracer,
            lighting,
            lit: *lit,
            samples: self.plan.quality.baked_samples,
            format: DisplacementFormat::F32,
        };
        let slabs = slabs_at_gaps(tracer, &wider, LAYERS);
        let mut set = SpriteSet::new(capture_slabs(&capture, &wider, &slabs, &Silent)?);
        if lighting.sky.is_some() {
            set.environment = lighting.environment_where(128, |_| true);
        }
        Ok(Some(set))
    }
}

/// Returns the sprites with their displacements in another format.
fn converted(set: &SpriteSet, format: DisplacementFormat) -> Result<SpriteSet, ReportError> {
    let convert = |prepared: &PreparedSprite| {
        let (sprite, d) = (prepared.sprite().sprite(), prepared.sprite().displacement());
        let (width, height) = d.size();
        let values: Vec<f32> = (0..height)
            .flat_map(|y| (0..width).map(move |x| d.at(x, y)))
            .collect();
        SpriteWithDepth::new(
            sprite.clone(),
            Displacement::new(width, height, &values, format)?,
        )
    };
    let mut converted = SpriteSet::new(
        set.sprites()
            .iter()
            .map(convert)
            .collect::<Result<_, _>>()?,
    );
    converted.environment = set.environment.clone();
    Ok(converted)
}
