//! Pictures that differ in everything a network should not depend on.

use std::time::Duration;

use kin::{Camera, Distortion};
use nalgebra::Point3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::camera_at;
use super::effects::Effects;
use super::look::{Clutter, HairCut, Look, slot};
use super::material::{Material, Pattern, srgb};
use super::mesh::{V3, unit};
use crate::error::Error;
use crate::worker::{Action, BodyShape, Script, WorkerParams};

/// A worker, an instant, a camera and a look, all drawn from one seed.
///
/// ```
/// use sim::{Scene, SceneVariation, Worker};
/// let variation = SceneVariation::random(7, [160, 120])?;
/// let worker = Worker::new(variation.worker.clone())?;
/// let (picture, truth) = Scene::varied(&variation).render(&worker.pose_at(variation.at));
/// assert!(truth.area_px > 0.02 * f64::from(picture.width() * picture.height()));
/// # Ok::<(), sim::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct SceneVariation {
    /// The worker to draw.
    pub worker: WorkerParams,
    /// The instant to draw.
    pub at: Duration,
    /// Where from.
    pub camera: Camera,
    pub(super) look: Look,
    pub(super) effects: Effects,
}

impl SceneVariation {
    /// Draws body, action, instant, clothes, colours, furniture, light, camera and picture faults from `seed`.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a picture side below 16 or above 8192 pixels.
    pub fn random(seed: u64, size_px: [u32; 2]) -> Result<Self, Error> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let worker = worker(&mut rng);
        let camera = camera(&mut rng, size_px)?;
        let look = look(&mut rng);
        let effects = effects(&mut rng);
        let at = Duration::from_millis(rng.random_range(0..60_000));
        Ok(Self { worker, at, camera, look, effects })
    }
}

fn worker(rng: &mut ChaCha8Rng) -> WorkerParams {
    let body = BodyShape::random(rng);
    let size = body.arm_m() / BodyShape::default().arm_m();
    let base = WorkerParams::default();
    let mut spread = |mean: f64, by: f64| mean + rng.random_range(-by..by);
    let right_home_m =
        [spread(base.right_home_m[0], 0.09) * size, spread(base.right_home_m[1], 0.08) * size, spread(0.07, 0.03)];
    let left_home_m =
        [spread(base.left_home_m[0] + 0.02, 0.10) * size, spread(base.left_home_m[1], 0.08) * size, spread(0.07, 0.03)];
    let hip_m = [
        spread(base.hip_m[0], 0.05),
        spread(0.0, 0.04),
        spread(base.hip_m[2], 0.05) - (body.spine_m - base.body.spine_m),
    ];
    let lean_rad = spread(0.2, 0.15);
    WorkerParams {
        seed: rng.random(),
        body,
        script: Script::Repeat(Action::ALL[rng.random_range(0..3)]),
        variation: rng.random_range(1.0..3.0),
        amplitude: rng.random_range(0.7..1.3),
        right_home_m,
        left_home_m,
        hip_m,
        lean_rad,
        ..base
    }
}

fn camera(rng: &mut ChaCha8Rng, size_px: [u32; 2]) -> Result<Camera, Error> {
    // A share of views close to straight down, a share from behind a shoulder, most from the front half.
    let (bearing, height) = match rng.random_range(0..10) {
        0 | 1 => (rng.random_range(-3.1..3.1), rng.random_range(1.15..1.45_f64)),
        2 => (rng.random_range(1.7..4.6), rng.random_range(0.3..0.9)),
        _ => (rng.random_range(-1.7..1.7), rng.random_range(0.05..1.0)),
    };
    let distance = rng.random_range(0.95..1.75);
    let target =
        Point3::new(rng.random_range(-0.22..0.06), rng.random_range(-0.14..0.14), rng.random_range(0.06..0.28));
    let (s, c) = f64::sin_cos(height);
    let eye = target + nalgebra::Vector3::new(c * f64::cos(bearing), c * f64::sin(bearing), s) * distance;
    let mut camera = camera_at(size_px, rng.random_range(45.0..68.0), eye, target)?;
    if rng.random_bool(0.4) {
        let k1 = rng.random_range(-0.18..0.06);
        camera.distortion = Distortion { k1, k2: -0.2 * k1, ..Distortion::default() };
    }
    let roll = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::z_axis(), rng.random_range(-0.15..0.15));
    camera.camera_from_world = roll * camera.camera_from_world;
    Ok(camera)
}

fn colour(rng: &mut ChaCha8Rng) -> V3 {
    // Uniform in a hue-value sense: bright and dark, dull and vivid equally likely.
    let value = rng.random_range(0.02_f32..0.85);
    let vivid = rng.random_range(0.0_f32..0.9);
    let tint = V3::new(rng.random(), rng.random(), rng.random());
    (V3::repeat(1.0 - vivid) + tint * vivid) * value
}

fn pattern(rng: &mut ChaCha8Rng) -> Pattern {
    let second = colour(rng);
    match rng.random_range(0..8) {
        0 | 1 => Pattern::Stripes {
            axis: rng.random_range(0..3),
            period_m: rng.random_range(0.015..0.12),
            duty: rng.random_range(0.1..0.6),
            second,
        },
        2 => Pattern::Check { period_m: rng.random_range(0.02..0.12), second },
        3 | 4 => Pattern::Mottle { grain_m: rng.random_range(0.01..0.15), second },
        5 => Pattern::Gradient { from_m: rng.random_range(-0.2..0.3), to_m: rng.random_range(0.31..0.8), second },
        _ => Pattern::Plain,
    }
}

fn room_pattern(rng: &mut ChaCha8Rng) -> Pattern {
    let second = colour(rng);
    match rng.random_range(0..6) {
        0 => Pattern::Gradient { from_m: rng.random_range(-0.7..0.5), to_m: rng.random_range(0.6..2.0), second },
        1 => Pattern::Mottle { grain_m: rng.random_range(0.02..0.8), second },
        2 => Pattern::Grain { grain_m: rng.random_range(0.02..0.1), second },
        3 => Pattern::Stripes {
            axis: rng.random_range(0..3),
            period_m: rng.random_range(0.05..0.6),
            duty: rng.random_range(0.05..0.6),
            second,
        },
        _ => Pattern::Plain,
    }
}

/// From very light to very dark skin, and a few real hair colours.
const SKINS: [u32; 8] =
    [0x00F3_D3BD, 0x00E8_BC9D, 0x00D9_A17E, 0x00C6_8A62, 0x00A8_6E48, 0x0084_5434, 0x0062_3D26, 0x0042_2A1C];
const HAIRS: [u32; 7] = [0x0015_1210, 0x0033_2620, 0x0054_3A28, 0x0083_5F3A, 0x00B8_9558, 0x009A_9894, 0x0070_3020];

fn look(rng: &mut ChaCha8Rng) -> Look {
    let mut look = Look::default();
    let mut put = |index: u8, material: Material| look.materials[usize::from(index)] = material;
    let skin = srgb(SKINS[rng.random_range(0..SKINS.len())]) * rng.random_range(0.85..1.15);
    put(slot::SKIN, Material::skin(skin));
    put(slot::LIPS, Material::skin(skin.component_mul(&V3::new(0.75, 0.45, 0.45))));
    put(slot::HAIR, Material::matt(srgb(HAIRS[rng.random_range(0..HAIRS.len())])));
    for index in [slot::SHIRT, slot::TROUSERS, slot::FABRIC, slot::FABRIC_BACK] {
        put(index, Material::cloth(colour(rng), pattern(rng)));
    }
    for index in [slot::BENCH, slot::WALL, slot::FLOOR] {
        put(index, Material { pattern: room_pattern(rng), ..Material::matt(colour(rng)) });
    }
    for index in [slot::BENCH_EDGE, slot::CHAIR, slot::ACCENT, slot::SHOE] {
        put(index, Material::matt(colour(rng)));
    }
    if rng.random_bool(0.5) {
        put(slot::MACHINE, Material { shine: rng.random_range(0.0..0.4), ..Material::matt(colour(rng)) });
    }
    for k in 0..slot::SMALLS {
        put(slot::SMALL + k, Material { pattern: pattern(rng), ..Material::matt(colour(rng)) });
    }
    look.hair = [HairCut::Bald, HairCut::Short, HairCut::Short, HairCut::Long, HairCut::Bun, HairCut::Cap]
        [rng.random_range(0..6)];
    if look.hair == HairCut::Cap {
        look.materials[usize::from(slot::HAIR)] = Material::cloth(colour(rng), Pattern::Plain);
    }
    look.sleeve = [0.0, rng.random_range(0.15..0.45), rng.random_range(0.5..0.97), 0.96][rng.random_range(0..4)];
    look.loose_m = rng.random_range(0.002..0.022);
    look.fabric_m = [rng.random_range(0.2..0.5), rng.random_range(0.12..0.35)];
    if rng.random_bool(0.3) {
        look.cover_m = Some([rng.random_range(0.05..0.16), rng.random_range(0.06..0.18)]);
        look.cover_at = rng.random_range(0.5..1.6);
    }
    look.machine = rng.random_bool(0.8);
    look.machine_at = [rng.random_range(0.22..0.42), rng.random_range(0.36..0.55)];
    look.shelf = rng.random_bool(0.4);
    look.wall_m = rng.random_range(0.75..2.2);
    for _ in 0..rng.random_range(0..9) {
        look.clutter.push(clutter(rng, look.wall_m));
    }
    light(rng, &mut look);
    look
}

/// A thing on the bench, against the wall, or on the floor behind the worker.
fn clutter(rng: &mut ChaCha8Rng, wall_m: f32) -> Clutter {
    let half = V3::new(rng.random_range(0.015..0.12), rng.random_range(0.015..0.12), rng.random_range(0.01..0.10));
    let centre = match rng.random_range(0..3) {
        0 => V3::new(rng.random_range(0.28..0.66), rng.random_range(-0.6..0.6), half.z),
        1 => V3::new(-wall_m + 0.02, rng.random_range(-1.2..1.2), rng.random_range(-0.2..1.2)),
        _ => V3::new(-wall_m + 0.3, rng.random_range(-1.2..1.2), rng.random_range(-0.6..0.4)),
    };
    let half = if centre.x < 0.0 { half * rng.random_range(1.0..5.0) } else { half };
    let half = if centre.x < -wall_m + 0.1 { V3::new(0.015, half.y, half.z) } else { half };
    Clutter {
        centre,
        half,
        material: slot::SMALL + rng.random_range(0..slot::SMALLS),
        round: centre.x > -wall_m + 0.1 && rng.random_bool(0.4),
    }
}

fn light(rng: &mut ChaCha8Rng, look: &mut Look) {
    let bearing = rng.random_range(-2.6_f32..2.6);
    let height = rng.random_range(0.5_f32..1.45);
    let (s, c) = height.sin_cos();
    look.light.towards = unit(V3::new(c * bearing.cos(), c * bearing.sin(), s));
    let cast = |rng: &mut ChaCha8Rng, by: f32| {
        V3::new(1.0 + rng.random_range(-by..by), 1.0 + rng.random_range(-by..by) * 0.5, 1.0 + rng.random_range(-by..by))
    };
    look.light.key = cast(rng, 0.2) * rng.random_range(0.1..1.2);
    look.light.sky = cast(rng, 0.15) * rng.random_range(0.2..0.75);
    look.light.ground = cast(rng, 0.2) * rng.random_range(0.05..0.4);
}

fn effects(rng: &mut ChaCha8Rng) -> Effects {
    let gain = rng.random_range(0.75..1.25_f32);
    Effects {
        seed: rng.random(),
        noise: if rng.random_bool(0.7) { rng.random_range(0.5..9.0) } else { 0.0 },
        blur_passes: [0, 0, 0, 1, 1, 2, 3][rng.random_range(0..7)],
        gain: std::array::from_fn(|_| gain * rng.random_range(0.93..1.07)),
        blotch: if rng.random_bool(0.4) { rng.random_range(0.0..18.0) } else { 0.0 },
    }
}
