//! A synthetic frame source: a checkered room with a ball, ray-cast per pixel. No files, no other
//! crates.

use glam::{DVec3, Vec3, dvec3, vec3};
use headbox_viewer::{
    Entry, EyeBounds, Fact, Figure, FrameReport, FrameRequest, FrameSource, Library, Navigation,
    Pose, Refinement, Room, RoomMap, Setting, Stage, Swatch, Thumbnail,
};
use std::{path::Path, sync::Arc, time::Instant};

/// Half the size of the room, metres.
const HALF: Vec3 = Vec3::new(3.0, 1.5, 4.0);
/// Centre and radius of the ball, metres.
const BALL: (Vec3, f32) = (Vec3::new(0.6, -0.7, -1.8), 0.6);
/// Rounds after which the "refined" picture is done.
const ROUNDS: u32 = 8;

/// Kind of source that the room imitates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// A headbox in the middle of the room.
    Headbox,
    /// The ball, orbited by the eye.
    Orbit,
    /// The whole room with its floor plan.
    Walk,
}

/// The frame source.
pub(crate) struct CheckerRoom {
    kind: Kind,
    rounds: u32,
    last_camera: Option<headbox_core::camera::Camera>,
    hits: Vec<Hit>,
}

/// Surface seen by a pixel: face 0 to 5 of the room or 6 for the ball, and its distance.
#[derive(Clone, Copy, Default)]
struct Hit {
    position: Vec3,
    distance: f32,
    face: u8,
}

impl CheckerRoom {
    pub(crate) fn new(kind: Kind) -> Self {
        Self {
            kind,
            rounds: 0,
            last_camera: None,
            hits: Vec::new(),
        }
    }
}

impl FrameSource for CheckerRoom {
    fn title(&self) -> String {
        match self.kind {
            Kind::Headbox => "Checker room".into(),
            Kind::Orbit => "Checker ball".into(),
            Kind::Walk => "Checker hall".into(),
        }
    }

    fn start_pose(&self) -> Pose {
        match self.kind {
            Kind::Orbit => Pose::looking_at(DVec3::ZERO, BALL.0.as_dvec3(), 50.0),
            _ => Pose::looking_at(DVec3::ZERO, dvec3(0.2, -0.15, -1.0), 60.0),
        }
    }

    fn bounds(&self) -> Option<EyeBounds> {
        let half_size = match self.kind {
            Kind::Headbox => DVec3::splat(0.5),
            Kind::Orbit => return None,
            Kind::Walk => HALF.as_dvec3() * 0.9,
        };
        Some(EyeBounds {
            centre: DVec3::ZERO,
            half_size,
        })
    }

    fn navigation(&self) -> Navigation {
        match self.kind {
            Kind::Headbox => Navigation::Fly,
            Kind::Orbit => Navigation::Orbit {
                pivot: BALL.0.as_dvec3(),
                nearest: 1.2 * f64::from(BALL.1),
            },
            Kind::Walk => Navigation::Walk,
        }
    }

    fn plan(&self) -> Option<RoomMap> {
        let room = |name: &str, z0: f64, z1: f64| Room {
            name: name.into(),
            outline: vec![[-3.0, z0], [3.0, z0], [3.0, z1], [-3.0, z1]],
        };
        let rooms = vec![room("front", -4.0, 0.5), room("back", 0.5, 4.0)];
        (self.kind == Kind::Walk).then(|| RoomMap {
            rooms,
            openings: vec![[[-0.6, 0.5], [0.6, 0.5]]],
        })
    }

    fn settings(&self) -> Vec<Setting> {
        vec![
            Setting::choice(
                "overlay",
                "Overlay",
                "What the colours show.",
                &["None", "Distance", "Face"],
            ),
            Setting::number(
                "exposure",
                "Exposure",
                "Exposure of the frame, stops.",
                0.0,
                -16.0..=16.0,
                "stops",
            ),
            Setting::number(
                "check",
                "Checks",
                "Side of a check in metres.",
                0.5,
                0.1..=2.0,
                "m",
            ),
            Setting::toggle(
                "lamp",
                "Lamp",
                "Light that falls off with the distance from the room's centre.",
                true,
            ),
            Setting::count(
                "block",
                "Block",
                "Side in pixels of the squares that share one ray: fewer rays, less time.",
                1,
                1..=8,
            )
            .under("Tests"),
            Setting::number(
                "delay",
                "Slower by",
                "Extra time per million pixels, in milliseconds.",
                0.0,
                0.0..=200.0,
                "ms",
            )
            .under("Tests"),
            Setting::toggle(
                "refine",
                "Refine",
                "Pretends to need 8 rounds until the picture is done.",
                false,
            )
            .under("Tests"),
            Setting::toggle("fail", "Fail", "Every frame fails.", false).under("Tests"),
            Setting::save(
                "plan",
                "Save plan",
                "Writes the names of the rooms.",
                "rooms",
                "txt",
            )
            .under("Tests"),
        ]
    }

    fn render(
        &mut self,
        request: &FrameRequest,
        pixels: &mut [[u8; 4]],
    ) -> Result<FrameReport, String> {
        let settings = &request.settings;
        if settings.toggle("fail")? {
            return Err("The room was asked to fail.".into());
        }
        let (check, lamp) = (settings.number("check")? as f32, settings.toggle("lamp")?);
        let overlay = settings.choice("overlay")?;
        let gain = settings.number("exposure")?.exp2() as f32;
        let noise = if settings.toggle("refine")? {
            self.noise(request)
        } else {
            0
        };
        let block = settings.number("block")? as usize;
        let width = request.camera.width() as usize;
        let [mut cast_ms, mut shade_ms] = [0.0; 2];
        let mut near = f32::INFINITY;
        for (band, pixels) in pixels.chunks_mut(width * block).enumerate() {
            let started = Instant::now();
            self.cast(&request.camera, band * block, block);
            let cast = Instant::now();
            let (row, rest) = pixels.split_at_mut(width);
            for (column, (pixels, hit)) in row.chunks_mut(block).zip(&self.hits).enumerate() {
                near = near.min(hit.distance);
                let color = match overlay {
                    1 => [(255.0 / (1.0 + hit.distance)) as u8; 3],
                    2 => FACE_COLORS[usize::from(hit.face)],
                    _ => shade(hit, check, lamp).map(|c| (f32::from(c) * gain).min(255.0) as u8),
                };
                let dark = noise > 0
                    && ((band * width + column) as u32).wrapping_mul(2_654_435_761) >> 24 < noise;
                pixels.fill(opaque(if dark { [0; 3] } else { color }));
            }
            rest.chunks_exact_mut(width)
                .for_each(|below| below.copy_from_slice(row));
            cast_ms += (cast - started).as_secs_f64() * 1e3;
            shade_ms += cast.elapsed().as_secs_f64() * 1e3;
        }
        let waits = Instant::now();
        let delay_ms = settings.number("delay")? * pixels.len() as f64 / 1e6;
        while waits.elapsed().as_secs_f64() * 1e3 < delay_ms {
            std::hint::spin_loop();
        }
        let wait_ms = waits.elapsed().as_secs_f64() * 1e3;
        Ok(FrameReport {
            stages: vec![
                Stage {
                    name: "cast",
                    ms: cast_ms,
                },
                Stage {
                    name: "shade",
                    ms: shade_ms,
                },
                Stage {
                    name: "wait",
                    ms: wait_ms,
                },
            ],
            figures: vec![
                Figure {
                    name: "rays",
                    value: pixels.len() as f64,
                    unit: "",
                },
                Figure {
                    name: "nearest",
                    value: near.into(),
                    unit: "m",
                },
            ],
            facts: self.place(request.camera.eye()).into_iter().collect(),
            legend: if overlay == 2 {
                face_legend()
            } else {
                Vec::new()
            },
            depth_m: request.depth.then(|| middle_depth(&request.camera)),
            ongoing: None,
            refinement: if noise > 0 {
                Refinement::Next
            } else {
                Refinement::Done
            },
            ..FrameReport::default()
        })
    }

    fn save(&mut self, id: &str, path: &Path) -> Result<String, String> {
        let plan = self.plan().ok_or(format!("There is no {id}."))?;
        let names: Vec<String> = plan.rooms.into_iter().map(|room| room.name).collect();
        std::fs::write(path, names.join("\n")).map_err(|error| error.to_string())?;
        Ok(format!("Saved {} names.", names.len()))
    }
}

impl CheckerRoom {
    /// Room of the plan that contains the eye.
    fn place(&self, eye: DVec3) -> Option<Fact> {
        let plan = self.plan()?;
        let text = plan
            .room_at(eye)
            .map_or_else(|| "outside".into(), |room| plan.rooms[room].name.clone());
        Some(Fact {
            name: "the eye is in",
            text,
        })
    }

    /// Casts a ray through every `step`th pixel of a row.
    fn cast(&mut self, camera: &headbox_core::camera::Camera, row: usize, step: usize) {
        let eye = camera.eye().as_vec3();
        let y = row as f64 + 0.5;
        let first = camera.direction(0.5, y).as_vec3();
        let right = (camera.direction(1.5, y) - camera.direction(0.5, y)).as_vec3();
        self.hits.clear();
        self.hits.extend(
            (0..camera.width())
                .step_by(step)
                .map(|column| hit(eye, first + right * column as f32)),
        );
    }

    /// Share of black pixels, in 256ths: fewer with every round for the same camera.
    fn noise(&mut self, request: &FrameRequest) -> u32 {
        let same = self.last_camera.replace(request.camera) == Some(request.camera);
        self.rounds = if same {
            (self.rounds + 1).min(ROUNDS)
        } else {
            0
        };
        (ROUNDS - self.rounds) * 12
    }
}

const FACE_COLORS: [[u8; 3]; 7] = [
    [214, 96, 77],
    [244, 165, 130],
    [146, 197, 222],
    [67, 147, 195],
    [180, 180, 180],
    [90, 174, 97],
    [153, 112, 171],
];

fn face_legend() -> Vec<Swatch> {
    let names = ["left", "right", "floor", "ceiling", "front", "back", "ball"];
    FACE_COLORS
        .iter()
        .zip(names)
        .map(|(&color, name)| Swatch {
            color,
            label: name.into(),
        })
        .collect()
}

/// Eye depth in the middle of a camera's image, metres.
fn middle_depth(camera: &headbox_core::camera::Camera) -> f64 {
    let [x, y] = [camera.width(), camera.height()].map(|side| f64::from(side) / 2.0);
    let ray = camera.direction(x, y).as_vec3();
    f64::from(hit(camera.eye().as_vec3(), ray).distance / ray.length())
}

/// The nearest surface along a ray (of any length) from inside the room.
fn hit(eye: Vec3, ray: Vec3) -> Hit {
    let toward = |axis: usize| {
        if ray[axis] > 0.0 {
            HALF[axis]
        } else {
            -HALF[axis]
        }
    };
    let walls = (vec3(toward(0), toward(1), toward(2)) - eye) / ray;
    let (t_wall, axis) = if walls.x < walls.y && walls.x < walls.z {
        (walls.x, 0)
    } else if walls.y < walls.z {
        (walls.y, 1)
    } else {
        (walls.z, 2)
    };
    let to_ball = BALL.0 - eye;
    let (a, b) = (ray.length_squared(), ray.dot(to_ball));
    let disc = b * b - a * (to_ball.length_squared() - BALL.1 * BALL.1);
    let t_ball = if disc > 0.0 && b > 0.0 {
        (b - disc.sqrt()) / a
    } else {
        f32::INFINITY
    };
    let (t, face) = if t_ball > 0.0 && t_ball < t_wall {
        (t_ball, 6)
    } else {
        (t_wall, axis * 2 + u8::from(ray[usize::from(axis)] > 0.0))
    };
    Hit {
        position: eye + ray * t,
        distance: t * a.sqrt(),
        face,
    }
}

fn shade(hit: &Hit, check: f32, lamp: bool) -> [u8; 3] {
    let ball = hit.face == 6;
    let p = if ball {
        (hit.position - BALL.0) * 2.0
    } else {
        hit.position
    };
    // A wall's own coordinate lies on a boundary between checks, so it is offset. Positive values
    // are rounded down by a cast, which is faster than `floor`.
    let cell = (p + vec3(0.01, 0.01, 0.01)) * (1.0 / check) + Vec3::splat(1000.0);
    let odd = (cell.x as i32 + cell.y as i32 + cell.z as i32) & 1 == 1;
    let base = FACE_COLORS[usize::from(hit.face)];
    let lit = if lamp {
        1.15 / (1.0 + 0.06 * (hit.position - vec3(0.0, 1.2, -1.0)).length_squared())
    } else {
        1.0
    };
    let lit = if ball {
        lit * (0.65 + 0.35 * (hit.position.y - BALL.0.y) / BALL.1)
    } else {
        lit
    };
    let tone = lit * if odd { 0.45 } else { 1.0 };
    base.map(|c| (f32::from(c) * tone).min(255.0) as u8)
}

fn opaque([r, g, b]: [u8; 3]) -> [u8; 4] {
    [r, g, b, 255]
}

/// The start page of the example.
pub(crate) struct Rooms;

impl Library for Rooms {
    fn entries(&self) -> Vec<Entry> {
        let entry = |id: &str, name: &str, description: &str| Entry {
            id: id.into(),
            name: name.into(),
            description: description.into(),
        };
        vec![
            entry(
                "room",
                "Checker room",
                "A headbox of 1 m in the middle of a room.",
            ),
            entry("ball", "Checker ball", "An object to circle."),
            entry("hall", "Checker hall", "A walk with a plan."),
        ]
    }

    fn thumbnail(&mut self, entry: &Entry) -> Option<Thumbnail> {
        let (width, height) = (200, 150);
        let mut room = self.open_entry(&entry.id).ok()?;
        let camera = room.start_pose().camera(width, height).ok()?;
        let settings = Arc::new(headbox_viewer::SettingValues::initial(&room.settings()));
        let mut pixels = vec![[0; 4]; (width * height) as usize];
        room.render(
            &FrameRequest {
                camera,
                settings,
                moving: false,
                complete: false,
                depth: false,
            },
            &mut pixels,
        )
        .ok()?;
        Some(Thumbnail {
            width,
            height,
            pixels,
        })
    }

    fn extensions(&self) -> Vec<String> {
        vec!["room".into()]
    }

    fn open_entry(&mut self, id: &str) -> Result<Box<dyn FrameSource>, String> {
        let kind = match id {
            "room" => Kind::Headbox,
            "ball" => Kind::Orbit,
            "hall" => Kind::Walk,
            _ => return Err(format!("There is no room named \"{id}\".")),
        };
        Ok(Box::new(CheckerRoom::new(kind)))
    }

    fn open_file(&mut self, path: &Path) -> Result<Box<dyn FrameSource>, String> {
        let text = std::fs::read_to_string(path)
            .map_err(|e| format!("Cannot read {}: {e}.", path.display()))?;
        self.open_entry(text.trim())
    }
}
