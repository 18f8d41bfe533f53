//! Which axis of an OBJ points up, and what its unit is: the format says neither.
//!
//! Both are guessed from evidence, each piece a number of natural log odds; what is said by the user is never guessed, and
//! glTF rules both (Y up, metres), so that of one what speaks against it is only told. The evidence for an axis: names of floors and walls (of materials, groups and objects), much area in one level (a floor),
//! things that have their feet at one level, surfaces that lie and open sheets that face along it (ground), lamps that shine down along it, a bottom at zero, a scene that is flat along it,
//! and what the exporter wrote.
//! For a unit: how high and wide what stands in the scene would be, and again what was written. A guess other than Y up and metres, or on thin
//! evidence, is told, with its reasons and how to overrule it.

use super::LoadOptions;
use super::group_names::GroupNames;
use super::lying::{FLOORS, Lying, WALLS, along};
use super::standing::standing;
use crate::scene::Scene;
use glam::DVec3;
use headbox_core::file_frame::{FileFrame, UpAxis};

/// What an OBJ says beside its triangles.
#[derive(Clone, Debug)]
pub(super) struct Hints {
    /// What the user said.
    pub(super) options: LoadOptions,
    /// The comments at the file's beginning, in lower case.
    pub(super) comments: String,
    /// What its groups and objects are called.
    groups: GroupNames,
}

/// Fewer triangles than a box has say nothing.
const FEWEST_TRIANGLES: usize = 12;
/// A scene that is thinner than this share of its extent is a picture or bare ground: of its shape nothing follows for up.
const THINNEST: f64 = 0.01;
/// By so much must the evidence for Z exceed that for Y: OBJ files have Y up unless there is reason to think otherwise.
const PRIOR_FOR_Y: f64 = 2.5;
/// Evidence for Y that is weaker than this is thin: the guess is told.
const THIN: f64 = -1.0;
/// What a file says of itself outweighs what it looks like.
const SAID: f64 = 30.0;
/// A scene that is so much higher or wider than rooms and houses are (as log odds) is told what that makes of its unit.
const ODD_SIZE: f64 = 1.8;
/// Slices of a scene along an axis.
const LEVELS: usize = 400;
/// So many of them at each end are its foot and its top.
const END_LEVELS: usize = LEVELS / 20;
/// What begins within this share of its extent of zero begins there.
const NEAR_ZERO: f64 = 0.02;
/// And what begins beyond this share does not.
const OFF_ZERO: f64 = 0.1;
/// Share of the area at each end of an axis that does not count as standing there.
const OUTLYING: f64 = 0.02;
/// A room whose floor and walls are named is higher than this, metres.
const LOWEST_ROOM_M: f64 = 1.5;

impl Hints {
    /// Of a file that is no text: none.
    pub(super) fn none(options: &LoadOptions) -> Self {
        Self {
            options: *options,
            comments: String::new(),
            groups: GroupNames::default(),
        }
    }

    /// The hints of a file's text.
    pub(super) fn of(text: &str, options: &LoadOptions) -> Self {
        const MOST_BYTES: usize = 4096;
        let comments = text.lines().map_while(|line| match line.trim_start() {
            "" => Some(""),
            line => line
                .strip_prefix('#')
                .or_else(|| line.starts_with("mtllib").then_some("")),
        });
        let mut joined = String::new();
        for line in comments.take_while(|line| line.len() < MOST_BYTES) {
            joined += &line.to_lowercase();
            joined.push('\n');
            if joined.len() > MOST_BYTES {
                break;
            }
        }
        Self {
            options: *options,
            comments: joined,
            groups: GroupNames::of(text),
        }
    }

    /// The frame of a scene whose positions are still those of the file, and a sentence if it is a guess that needs telling.
    pub(super) fn frame(&self, scene: &Scene) -> (FileFrame, Option<String>) {
        let LoadOptions { up, unit_m } = self.options;
        let shape = Shape::of(scene, &self.groups);
        let (up, up_why) = match (up, &shape) {
            (Some(up), _) => (up, None),
            (None, None) => (UpAxis::Y, None),
            (None, Some(shape)) => self.guess_up(shape),
        };
        let (unit_m, unit_why) = match (unit_m, &shape) {
            (Some(unit_m), _) => (unit_m, None),
            (None, None) => (1.0, None),
            (None, Some(shape)) if shape.is_thin => (1.0, None),
            (None, Some(shape)) => self.guess_unit(shape, up, scene),
        };
        let up_told = up_why.map(|why| match up {
            UpAxis::Z => format!("Z is taken as up ({why}); --up y if that is wrong"),
            UpAxis::Y => format!(
                "Y is taken as up, as OBJ files mostly have it ({why}); --up z if that is wrong"
            ),
        });
        let unit_told = unit_why.map(|why| format!("the unit is taken as {why}"));
        let told: Vec<String> = up_told.into_iter().chain(unit_told).collect();
        (
            FileFrame { up, unit_m },
            (!told.is_empty()).then(|| told.join("; ")),
        )
    }

    /// What speaks against Y up and metres, which a glTF has by its format's rule, of a scene that stands with Y up;
    /// `None` unless much does. Nothing is taken otherwise for that.
    pub(super) fn doubts(&self, scene: &Scene) -> Option<String> {
        let shape = Shape::of(scene, &self.groups).filter(|shape| !shape.is_thin)?;
        let mut doubts = Vec::new();
        if self.options.up.is_none()
            && let (UpAxis::Z, Some(why)) = self.guess_up(&shape)
        {
            doubts.push(format!(
                "Y is up, as glTF has it, though Z seems to be ({why}); --up z if so"
            ));
        }
        // The scene has Y up by now, whatever the file has.
        let up = UpAxis::Y;
        let (unit_m, _) = self.guess_unit(&shape, up, scene);
        if self.options.unit_m.is_none() && unit_m != 1.0 {
            let [height, width] = shape.height_and_width(scene, up);
            doubts.push(format!(
                "its unit is the metre, as glTF has it, which makes what stands in it {height:.0} m high and {width:.0} m wide; \
                 --unit cm or another if that is wrong"
            ));
        }
        (!doubts.is_empty()).then(|| doubts.join("; "))
    }

    fn says(&self, words: &[&str]) -> bool {
        words.iter().any(|word| self.comments.contains(word))
    }

    /// The axis, and why where it is not the usual one or there is little reason for it.
    fn guess_up(&self, shape: &Shape) -> (UpAxis, Option<String>) {
        let mut evidence = shape.evidence_for_z();
        if self.says(&["z up", "z-up", "z_up", "up axis: z", "up=z", "up: z"]) {
            evidence.push((SAID, "its comments say so".into()));
        }
        if self.says(&["y up", "y-up", "y_up", "up axis: y", "up=y", "up: y"]) {
            evidence.push((-SAID, "its comments say so".into()));
        }
        if self.says(&["gazebo", "freecad", "openscad", "urdf", "autocad", "revit"]) {
            evidence.push((3.0, "its exporter has Z up".into()));
        }
        if self.says(&["sweet home 3d", "blender", "sketchup", "maya"]) {
            evidence.push((-3.0, "its exporter has Y up".into()));
        }
        let odds: f64 = evidence.iter().map(|(odds, _)| odds).sum();
        let is_picture = shape.is_thin && evidence.is_empty();
        if odds <= THIN || is_picture {
            return (UpAxis::Y, None);
        }
        evidence.retain(|(odds, _)| *odds > 0.0);
        evidence.sort_by(|a, b| b.0.total_cmp(&a.0));
        let reasons: Vec<String> = evidence.into_iter().take(2).map(|(_, why)| why).collect();
        let reasons = reasons.join(", ");
        match (odds > PRIOR_FOR_Y, reasons.is_empty()) {
            (true, _) => (UpAxis::Z, Some(reasons)),
            (false, true) => (UpAxis::Y, Some("nothing tells".into())),
            (false, false) => (
                UpAxis::Y,
                Some(format!("there is too little for Z: {reasons}")),
            ),
        }
    }

    /// The unit in metres, and what to say of it where it is not the metre.
    fn guess_unit(&self, shape: &Shape, up: UpAxis, scene: &Scene) -> (f64, Option<String>) {
        const UNITS: [(f64, &str, &str, f64); 6] = [
            (1.0, "metres", "m", 5.0),
            (0.01, "centimetres", "cm", 0.5),
            (0.001, "millimetres", "mm", 0.0),
            // Too near to metres and centimetres to be told from them by size: only where the file says so.
            (0.0254, "inches", "in", -8.0),
            (0.1, "decimetres", "dm", -8.0),
            (0.3048, "feet", "ft", -8.0),
        ];
        let [height, width] = shape.height_and_width(scene, up);
        let is_room = shape.floors.is_some() && shape.walls.is_some();
        let outdoors = named(
            scene,
            &["city", "street", "road", "terrain", "mountain", "landscape"],
        )
        .next()
        .is_some();
        let off =
            |length: f64, usual: f64, spread: f64| ((length / usual).ln() / spread).powi(2) / 2.0;
        // Rooms, houses and trees: some metres high and wide, give or take a factor of three or four.
        let odd = |metres: f64| off(height * metres, 4.0, 1.1) + off(width * metres, 15.0, 1.4);
        let odds = |&(metres, name, short, prior): &(f64, &str, &str, f64)| {
            let singular = &name[..name.len() - 1];
            let spellings = [
                name,
                singular,
                short,
                &name.replace("metre", "meter"),
                &singular.replace("metre", "meter"),
            ];
            let written = spellings.iter().any(|word| self.says_unit(word));
            let exporter = match short {
                "cm" => self.says(&["sweet home 3d"]),
                "mm" => self.says(&["freecad", "openscad"]),
                _ => false,
            };
            let too_low = if is_room && height * metres < LOWEST_ROOM_M {
                8.0
            } else {
                0.0
            };
            let outdoors = if outdoors && metres == 1.0 { 8.0 } else { 0.0 };
            prior - odd(metres) - too_low
                + if written { SAID } else { 0.0 }
                + if exporter { 8.0 } else { 0.0 }
                + outdoors
        };
        let best = UNITS
            .iter()
            .rev()
            .max_by(|a, b| odds(a).total_cmp(&odds(b)))
            .unwrap_or(&UNITS[0]);
        let (metres, name, _, _) = *best;
        let is_said = outdoors || self.comments.contains("unit");
        let otherwise = if metres == 1.0 {
            "dm, cm or another"
        } else {
            "m"
        };
        let told = format!(
            "{name}, which makes what stands in it {:.1} m high and {:.1} m wide; --unit {otherwise} if that is wrong",
            height * metres,
            width * metres
        );
        (
            metres,
            (metres != 1.0 || (!is_said && odd(metres) > ODD_SIZE)).then_some(told),
        )
    }

    /// Whether the comments say that this is the unit, as in `# File units = meters`.
    fn says_unit(&self, word: &str) -> bool {
        let mut words = self
            .comments
            .split(|c: char| !c.is_ascii_alphanumeric())
            .filter(|word| !word.is_empty());
        let mut after_unit = false;
        words.any(|found| {
            let says = after_unit && found == word;
            after_unit = found == "unit" || found == "units" || (after_unit && found == "is");
            says
        })
    }
}

/// The indices of the triangles whose material's name contains one of `words`.
fn named<'a>(scene: &'a Scene, words: &'a [&str]) -> impl Iterator<Item = usize> + 'a {
    let is_named = |name: &str| {
        let name = name.to_lowercase();
        words.iter().any(|word| name.contains(word))
    };
    let materials: Vec<bool> = scene
        .materials
        .iter()
        .map(|material| is_named(&material.name))
        .collect();
    (0..scene.triangles.len()).filter(move |&t| {
        materials
            .get(scene.triangles[t].material as usize)
            .copied()
            .unwrap_or(false)
    })
}

/// What the triangles say, in the file's axes and unit.
struct Shape {
    low: DVec3,
    extent: DVec3,
    /// Whether all of it lies in one plane, or nearly.
    is_thin: bool,
    /// The largest share of the scene's area that lies flat in one level, of the lower half of each axis.
    level: DVec3,
    /// Share of the area that lies flat at the foot of each axis, beyond what lies flat at its top: a floor, where no ceiling or
    /// opposite wall is like it.
    foot: DVec3,
    /// Share of the area that lies flat along each axis.
    along: DVec3,
    /// Sum of the triangles' areas as vectors, over the sum of their lengths: 0 of what is closed, up of a ground that has no
    /// underside.
    facing: DVec3,
    /// Share of the area of what is called a floor that lies flat along each axis; none if there is too little of it.
    floors: Option<DVec3>,
    /// The same for walls.
    walls: Option<DVec3>,
    /// As `facing`, of what shines alone; 0 where nothing does.
    shining: DVec3,
    /// By how much more things begin at one level of each axis than end at one.
    standing: DVec3,
}

impl Shape {
    /// `None` where there is too little to judge by.
    fn of(scene: &Scene, groups: &GroupNames) -> Option<Self> {
        let [low, high] = scene.bounds();
        let extent = high - low;
        if scene.triangles.len() < FEWEST_TRIANGLES {
            return None;
        }
        let is_thin = extent.min_element() < THINNEST * extent.max_element();
        let (mut all, mut all_along, mut facing) = (0.0, DVec3::ZERO, DVec3::ZERO);
        let mut levels = vec![DVec3::ZERO; LEVELS + 1];
        for triangle in 0..scene.triangles.len() {
            let Flatness {
                along,
                normal,
                area,
                middle,
            } = flatness(scene, triangle);
            all += area;
            all_along += along * area;
            facing += normal * area;
            for axis in 0..3 {
                let level = ((middle - low) / extent)[axis] * LEVELS as f64;
                levels[level.clamp(0.0, LEVELS as f64) as usize][axis] += along[axis] * area;
            }
        }
        let level = levels[..LEVELS / 2]
            .iter()
            .copied()
            .fold(DVec3::ZERO, DVec3::max)
            / all;
        let flat_in = |levels: &[DVec3]| levels.iter().copied().sum::<DVec3>() / all;
        let foot = (flat_in(&levels[..END_LEVELS]) - flat_in(&levels[LEVELS - END_LEVELS..]))
            .max(DVec3::ZERO);
        let (along, facing) = (all_along / all, facing / all);
        let share = |words: &[&str], of_groups: Lying| {
            let mut lying = of_groups;
            named(scene, words)
                .map(|t| flatness(scene, t))
                .for_each(|flat| lying.add(flat.normal * flat.area));
            (lying.area > 0.01 * all).then(|| lying.along / lying.area)
        };
        let floors = share(&FLOORS, groups.floors);
        let shines = |t: &usize| {
            let material = scene.materials.get(scene.triangles[*t].material as usize);
            material.is_some_and(|material| material.emission.iter().any(|c| *c > 0.0))
        };
        let lamps = (0..scene.triangles.len())
            .filter(shines)
            .map(|t| flatness(scene, t));
        let (sum, area) = lamps.fold((DVec3::ZERO, 0.0), |(sum, area), lamp| {
            (sum + lamp.normal * lamp.area, area + lamp.area)
        });
        let shining = if area > 0.0 { sum / area } else { DVec3::ZERO };
        let walls = share(&WALLS, groups.walls);
        let standing = standing(scene, low, extent);
        Some(Self {
            low,
            extent,
            is_thin,
            level,
            foot,
            along,
            facing,
            floors,
            walls,
            shining,
            standing,
        })
    }

    /// Pieces of evidence that Z is up rather than Y: log odds and a reason.
    fn evidence_for_z(&self) -> Vec<(f64, String)> {
        let mut evidence = Vec::new();
        let mut add = |odds: f64, why: &str| {
            if odds != 0.0 {
                evidence.push((odds, why.to_owned()));
            }
        };
        if let Some(floors) = self.floors {
            add(5.0 * (floors.z - floors.y), "its floors lie flat along it");
        }
        if let Some(walls) = self.walls {
            add(2.0 * (walls.y - walls.z), "its walls stand along it");
        }
        if self.is_thin {
            return evidence;
        }
        add(
            (20.0 * (self.level.z - self.level.y)).clamp(-3.0, 3.0),
            "a floor lies across it",
        );
        add(
            (8.0 * (self.foot.z - self.foot.y)).clamp(-3.0, 3.0),
            "more lies at its foot than at its top",
        );
        add(
            (8.0 * (self.standing.z - self.standing.y)).clamp(-2.5, 2.5),
            "things stand on one level of it",
        );
        add(
            3.0 * (self.along.z - self.along.y),
            "more lies flat along it",
        );
        add(
            6.0 * (self.facing.z.max(0.0) - self.facing.y.max(0.0)),
            "the ground faces along it",
        );
        add(
            1.5 * ((-self.shining.z).max(0.0) - (-self.shining.y).max(0.0)),
            "its lamps shine down along it",
        );
        let starts_at_zero = |low: f64, extent: f64| low.abs() < NEAR_ZERO * extent;
        let starts_elsewhere = |low: f64, extent: f64| low.abs() > OFF_ZERO * extent;
        let (
            DVec3 {
                y: low_y, z: low_z, ..
            },
            DVec3 { x, y, z },
        ) = (self.low, self.extent);
        // What is modelled about the origin stands on it: more so where the origin is in the middle both ways.
        let is_about_zero = |axis: usize| (self.low[axis] / self.extent[axis] + 0.5).abs() < 0.25;
        if starts_at_zero(low_z, z) && starts_elsewhere(low_y, y) {
            add(
                if is_about_zero(0) && is_about_zero(1) {
                    3.0
                } else {
                    2.0
                },
                "it begins at zero",
            );
        } else if starts_at_zero(low_y, y) && starts_elsewhere(low_z, z) {
            add(
                if is_about_zero(0) && is_about_zero(2) {
                    -3.0
                } else {
                    -2.0
                },
                "Y begins at zero",
            );
        }
        if z < 0.5 * x.min(y) {
            add(1.5, "the scene is flat along it");
        } else if y < 0.5 * x.min(z) {
            add(-1.5, "the scene is flat along Y");
        }
        evidence
    }

    /// The level of each axis in which a point lies.
    fn level(&self, p: DVec3) -> [usize; 3] {
        let level = (p - self.low) / self.extent * LEVELS as f64;
        level
            .to_array()
            .map(|level| level.clamp(0.0, LEVELS as f64) as usize)
    }

    /// Height and larger horizontal extent of what stands, in the file's unit: of all but the outermost [`OUTLYING`] of the area
    /// that is steeper than 45 degrees. Ground, however far it reaches, has no part in it; where nothing stands, it is all of the
    /// scene.
    fn height_and_width(&self, scene: &Scene, up: UpAxis) -> [f64; 2] {
        let mut levels = vec![DVec3::ZERO; LEVELS + 1];
        let mut standing = 0.0;
        for triangle in 0..scene.triangles.len() {
            let Flatness { normal, area, .. } = flatness(scene, triangle);
            let rise = if up == UpAxis::Y { normal.y } else { normal.z };
            if rise.abs() < std::f64::consts::FRAC_1_SQRT_2 {
                standing += area;
                let corners = scene.corners(triangle as u32);
                let [low, high] = [
                    corners.into_iter().reduce(DVec3::min),
                    corners.into_iter().reduce(DVec3::max),
                ]
                .map(|corner| self.level(corner.unwrap_or_default()));
                for axis in 0..3 {
                    // Evenly over the levels that it reaches through: a wall of two triangles is as high as one of a thousand.
                    let reached = low[axis]..=high[axis];
                    let share = area / reached.clone().count() as f64;
                    levels[reached]
                        .iter_mut()
                        .for_each(|level| level[axis] += share);
                }
            }
        }
        let between = |axis: usize| {
            let areas = || levels.iter().map(|level| level[axis]);
            let outside = outlying(areas(), standing) + outlying(areas().rev(), standing);
            self.extent[axis] * (levels.len() - outside.min(levels.len() - 1)) as f64
                / levels.len() as f64
        };
        let [x, y, z] = if standing > 0.0 {
            [0, 1, 2].map(between)
        } else {
            self.extent.to_array()
        };
        match up {
            UpAxis::Y => [y, x.max(z)],
            UpAxis::Z => [z, x.max(y)],
        }
    }
}

/// How many of the first areas together are still less than [`OUTLYING`] of all.
fn outlying(areas: impl Iterator<Item = f64>, all: f64) -> usize {
    let mut sum = 0.0;
    let is_outside = |area: &f64| {
        sum += area;
        sum < OUTLYING * all
    };
    areas.take_while(is_outside).count()
}

/// How a triangle lies.
struct Flatness {
    /// Along which axes it lies flat: 1 or 0 each.
    along: DVec3,
    /// Unit normal; 0 if it has no area.
    normal: DVec3,
    area: f64,
    middle: DVec3,
}

fn flatness(scene: &Scene, triangle: usize) -> Flatness {
    let [a, b, c] = scene.corners(triangle as u32);
    let doubled = (b - a).cross(c - a);
    let normal = doubled.normalize_or_zero();
    Flatness {
        along: along(normal),
        normal,
        area: doubled.length() / 2.0,
        middle: (a + b + c) / 3.0,
    }
}
