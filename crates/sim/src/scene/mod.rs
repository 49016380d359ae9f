//! The picture of the worker at the bench, and what is true in it.
//!
//! A software rasteriser with 2 x 2 samples per pixel and deferred shading: one lamp with shadow map, soft light from
//! above and below, analytic ambient occlusion by spheres that stand for the body. Furniture is drawn and lit
//! once; a frame costs the worker, the fabric and the shadows they throw.

mod body;
mod effects;
mod fabric;
mod look;
mod material;
mod mesh;
mod raster;
mod room;
mod shadow;
#[cfg(test)]
mod tests;
mod truth;
mod variation;

use image::RgbImage;
use kin::{Camera, Distortion, Intrinsics};
use nalgebra::{Point3, Vector3};

pub use truth::{GroundTruth, Visibility};
pub use variation::SceneVariation;

use crate::error::{Error, within};
use crate::worker::{WorkerParams, WorkerPose};
use effects::Effects;
use look::{Look, slot};
use material::Encoder;
use mesh::{Mesh, Part, V3, unit};
use raster::{Buffer, Screen, View, Window, weights};
use shadow::{ShadowMap, openness};

/// Grid on the bench on which the worker's soft shadow is computed: cells, lower corner and size in metres.
const BENCH_GRID: [usize; 2] = [24, 36];
const BENCH_LOW_M: [f32; 2] = [-0.12, -0.68];
const BENCH_SIZE_M: [f32; 2] = [0.84, 1.44];

/// A pixel of the furniture: its light with and without the lamp, and where to look up the worker's shadow.
#[derive(Debug, Clone, Copy)]
struct StillPixel {
    soft: V3,
    lamp: V3,
    in_shadow_map: V3,
    /// Place on the bench grid in cells, or negative off the bench.
    bench: [f32; 2],
}

/// A camera's view of the worker, the bench and the room.
///
/// ```
/// use sim::{Keypoint, Scene, Visibility, Worker, WorkerParams, default_camera};
/// use std::time::Duration;
///
/// let worker = Worker::new(WorkerParams::default())?;
/// let mut scene = Scene::new(default_camera([320, 240])?, worker.params());
/// let (picture, truth) = scene.render(&worker.pose_at(Duration::ZERO));
/// assert_eq!(picture.dimensions(), (320, 240));
/// assert_eq!(truth.visibility[Keypoint::RightWrist.index()], Visibility::Visible);
/// # Ok::<(), sim::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Scene {
    camera: Camera,
    eye: V3,
    look: Look,
    effects: Effects,
    encoder: Encoder,
    still_shadow: ShadowMap,
    moving_shadow: ShadowMap,
    still_near: Vec<f32>,
    still: Vec<StillPixel>,
    /// The furniture's colour where the worker takes no light away.
    still_colour: Vec<[u8; 3]>,
    /// Where the last worker was drawn.
    drawn: Window,
    mesh: Mesh,
    corners: Vec<Screen>,
    buffer: Buffer,
    blockers: Vec<(V3, f32)>,
    bench_open: Vec<f32>,
    frames: u64,
}

/// The usual view: in front of the worker, to the side of the right arm, above the bench; the whole upper body
/// and the bench are in the picture. 52 degrees of horizontal view, no distortion.
///
/// # Errors
/// [`Error::OutOfRange`] for a side below 16 or above 8192 pixels.
pub fn default_camera(size_px: [u32; 2]) -> Result<Camera, Error> {
    camera_at(size_px, 52.0, Point3::new(1.18, -0.62, 0.66), Point3::new(-0.02, 0.02, 0.17))
}

/// A pinhole camera with the horizontal angle of view in degrees, z upwards in the picture.
fn camera_at(size_px: [u32; 2], view_deg: f64, eye: Point3<f64>, target: Point3<f64>) -> Result<Camera, Error> {
    for side in size_px {
        within("picture side (px)", f64::from(side), 16.0, 8192.0)?;
    }
    let [width, height] = size_px.map(f64::from);
    let focal = 0.5 * width / (0.5 * view_deg.to_radians()).tan();
    let intrinsics = Intrinsics {
        fx_px: focal,
        fy_px: focal,
        cx_px: 0.5 * (width - 1.0),
        cy_px: 0.5 * (height - 1.0),
        skew_px: 0.0,
    };
    // A camera that looks straight down has no "up" along z: take the worker's forward direction instead.
    let line = target - eye;
    let up = if line.xy().norm() < 0.05 * line.norm() { -Vector3::x() } else { Vector3::z() };
    Ok(Camera::look_at(intrinsics, Distortion::default(), size_px, eye, target, up)?)
}

impl Scene {
    /// The default look. `worker` tells where the chair stands.
    pub fn new(camera: Camera, worker: &WorkerParams) -> Self {
        Self::build(camera, Look::default(), Effects::default(), worker)
    }

    /// The look, camera and picture faults of a variation.
    pub fn varied(variation: &SceneVariation) -> Self {
        Self::build(variation.camera.clone(), variation.look.clone(), variation.effects, &variation.worker)
    }

    fn build(camera: Camera, look: Look, effects: Effects, worker: &WorkerParams) -> Self {
        let [width, height] = camera.size_px.map(|n| n as usize);
        let light = look.light;
        let mut scene = Self {
            eye: camera.centre_m().coords.cast(),
            still_shadow: ShadowMap::new(&light, V3::new(0.1, 0.0, 0.0), 1.5, 512),
            moving_shadow: ShadowMap::new(&light, V3::new(0.05, 0.0, 0.1), 0.85, 320),
            look,
            effects,
            encoder: Encoder::new(),
            still_near: Vec::new(),
            still: Vec::new(),
            still_colour: Vec::new(),
            drawn: Window { left: 0, top: 0, right: 2 * width, bottom: 2 * height },
            mesh: Mesh::default(),
            corners: Vec::new(),
            buffer: Buffer::new(2 * width, 2 * height),
            blockers: Vec::new(),
            bench_open: vec![1.0; (BENCH_GRID[0] + 1) * (BENCH_GRID[1] + 1)],
            frames: 0,
            camera,
        };
        scene.draw_furniture(Vector3::from(worker.hip_m).cast());
        scene
    }

    /// The camera the scene is seen through.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Draws the worker; returns the picture and what is true in it.
    pub fn render(&mut self, pose: &WorkerPose) -> (RgbImage, GroundTruth) {
        let [width, height] = self.camera.size_px;
        let mut picture = RgbImage::new(width, height);
        let truth = self.render_into(pose, &mut picture);
        (picture, truth)
    }

    /// As [`Scene::render`], into a picture that already exists.
    ///
    /// # Panics
    /// If the picture's size is not that of the camera.
    pub fn render_into(&mut self, pose: &WorkerPose, picture: &mut RgbImage) -> GroundTruth {
        assert_eq!(<[u32; 2]>::from(picture.dimensions()), self.camera.size_px, "the picture has the camera's size");
        self.mesh.clear();
        body::add(&mut self.mesh, pose, &self.look);
        fabric::add(&mut self.mesh, pose, &self.look);
        self.moving_shadow.draw(&self.mesh);
        body::blockers(pose, &mut self.blockers);
        self.shade_openness();
        project(&self.camera, &self.mesh, &mut self.corners);
        let window = Window::about(&self.corners, self.buffer.width, self.buffer.height);
        self.buffer.restore(&self.still_near, window.join(self.drawn));
        self.drawn = window;
        self.buffer.draw(&self.mesh.triangles, &self.corners, View::Picture);
        self.resolve(picture);
        self.effects.apply(picture, self.frames);
        self.frames += 1;
        truth::examine(&self.camera, pose, &self.buffer, self.drawn, &self.mesh.triangles)
    }

    fn draw_furniture(&mut self, seat: V3) {
        let mut mesh = Mesh::default();
        room::add(&mut mesh, &self.look, seat);
        self.still_shadow.draw(&mesh);
        self.buffer.clear();
        project(&self.camera, &mesh, &mut self.corners);
        self.buffer.draw(&mesh.triangles, &self.corners, View::Picture);
        let width = self.buffer.width / 2;
        let height = self.buffer.height / 2;
        self.still = (0..width * height).map(|i| self.still_pixel(&mesh, i % width, i / width)).collect();
        self.still_colour = self.still.iter().map(|p| self.encoder.encode(p.soft + p.lamp)).collect();
        self.still_near.clone_from(&self.buffer.near);
    }

    fn still_pixel(&self, mesh: &Mesh, column: usize, row: usize) -> StillPixel {
        let empty = self.look.materials[usize::from(slot::WALL)].colour * 0.6;
        let mut pixel =
            StillPixel { soft: V3::zeros(), lamp: V3::zeros(), in_shadow_map: V3::repeat(-1.0), bench: [-1.0, -1.0] };
        for sample in 0..4 {
            let (x, y) = (2 * column + sample % 2, 2 * row + sample / 2);
            let owner = self.buffer.owner[y * self.buffer.width + x];
            if owner == 0 {
                pixel.soft += empty * 0.25;
                continue;
            }
            let s = self.surface(mesh, owner, x as f32, y as f32);
            let shade = self.shade(&s);
            let lit = self.still_shadow.lit(self.still_shadow.place(s.at + s.normal * 0.006));
            pixel.soft += shade.soft * 0.25;
            pixel.lamp += shade.lamp * (0.25 * lit);
            if sample == 0 {
                pixel.in_shadow_map = self.moving_shadow.place(s.at + s.normal * 0.004);
                if s.material == slot::BENCH {
                    let cell = |k: usize| (s.at[k] - BENCH_LOW_M[k]) / BENCH_SIZE_M[k] * BENCH_GRID[k] as f32;
                    pixel.bench = [cell(0), cell(1)].map(|c| c.max(0.0));
                }
            }
        }
        pixel
    }

    /// Ambient occlusion at the worker's corners and on the bench.
    fn shade_openness(&mut self) {
        for v in &mut self.mesh.vertices {
            let near_bench = 0.45 * (1.0 - v.normal.z) * 0.5 * (-(v.at.z.max(0.0)) / 0.07).exp();
            v.open = openness(v.at, v.normal, &self.blockers) * (1.0 - near_bench);
        }
        let columns = BENCH_GRID[0] + 1;
        for (i, open) in self.bench_open.iter_mut().enumerate() {
            let cell = [i % columns, i / columns];
            let at = |k: usize| BENCH_LOW_M[k] + BENCH_SIZE_M[k] * cell[k] as f32 / BENCH_GRID[k] as f32;
            *open = openness(V3::new(at(0), at(1), 0.0), V3::z(), &self.blockers);
        }
    }

    fn bench_openness(&self, [x, y]: [f32; 2]) -> f32 {
        let columns = BENCH_GRID[0] + 1;
        let column = (x as usize).min(BENCH_GRID[0] - 1);
        let row = (y as usize).min(BENCH_GRID[1] - 1);
        let (fx, fy) = (x - column as f32, y - row as f32);
        let line = |row: usize| {
            let i = row * columns + column;
            self.bench_open[i] * (1.0 - fx) + self.bench_open[i + 1] * fx
        };
        line(row) * (1.0 - fy) + line(row + 1) * fy
    }

    /// Gives every pixel its colour.
    fn resolve(&self, picture: &mut RgbImage) {
        let across = self.buffer.width;
        let pixels: &mut [u8] = picture;
        let rows = pixels.chunks_exact_mut(3 * across / 2).zip(self.buffer.owner.chunks_exact(2 * across));
        for (row, (line, owners)) in rows.enumerate() {
            let (upper, lower) = owners.split_at(across);
            let samples = upper.chunks_exact(2).zip(lower.chunks_exact(2));
            for (column, (out, (u, l))) in line.chunks_exact_mut(3).zip(samples).enumerate() {
                let pixel = row * across / 2 + column;
                let colour = if u[0] | u[1] | l[0] | l[1] == 0 {
                    let (p, open, lit) = self.still_light(pixel);
                    // Less than half a code of 8 bits is lost at 0.996.
                    if open > 0.996 && lit >= 1.0 {
                        self.still_colour[pixel]
                    } else {
                        self.encoder.encode(p.soft * open + p.lamp * lit)
                    }
                } else {
                    self.encoder.encode(self.mixed_light([u[0], u[1], l[0], l[1]], column, row))
                };
                out.copy_from_slice(&colour);
            }
        }
    }

    /// A pixel of the furniture with its open share of the sky and of the lamp.
    fn still_light(&self, pixel: usize) -> (&StillPixel, f32, f32) {
        let p = &self.still[pixel];
        let open = if p.bench[0] >= 0.0 { self.bench_openness(p.bench) } else { 1.0 };
        (p, open, self.moving_shadow.lit(p.in_shadow_map))
    }

    /// Light of a pixel on which the worker is seen. Samples of one part and material are shaded once.
    fn mixed_light(&self, owners: [u32; 4], column: usize, row: usize) -> V3 {
        let kind = |owner: u32| match owner {
            0 => (Part::Background, 0),
            n => {
                let t = &self.mesh.triangles[n as usize - 1];
                (t.part, t.material)
            }
        };
        let kinds = [kind(owners[0]), kind(owners[1]), kind(owners[2]), kind(owners[3])];
        let mut light = V3::zeros();
        let mut done = [false; 4];
        for k in 0..4 {
            if done[k] {
                continue;
            }
            let mut share = 0.0;
            for m in k..4 {
                if kinds[m] == kinds[k] {
                    done[m] = true;
                    share += 0.25;
                }
            }
            let colour = if owners[k] == 0 {
                let (p, open, lit) = self.still_light(row * self.buffer.width / 2 + column);
                p.soft * open + p.lamp * lit
            } else {
                let (x, y) = (2 * column + k % 2, 2 * row + k / 2);
                self.moving_colour(owners[k], x as f32, y as f32)
            };
            light += colour * share;
        }
        light
    }

    fn moving_colour(&self, owner: u32, x: f32, y: f32) -> V3 {
        let s = self.surface(&self.mesh, owner, x, y);
        let shade = self.shade(&s);
        let lifted = s.at + s.normal * 0.006;
        let lit = self.moving_shadow.lit(self.moving_shadow.place(lifted));
        let lit = if lit > 0.0 { lit * self.still_shadow.lit(self.still_shadow.place(lifted)) } else { 0.0 };
        shade.soft + shade.lamp * lit
    }

    fn surface(&self, mesh: &Mesh, owner: u32, x: f32, y: f32) -> Surface {
        let t = &mesh.triangles[owner as usize - 1];
        let [i, j, k] = [t.corners[0] as usize, t.corners[1] as usize, t.corners[2] as usize];
        let w = weights([self.corners[i], self.corners[j], self.corners[k]], x, y);
        let v = [&mesh.vertices[i], &mesh.vertices[j], &mesh.vertices[k]];
        let at = v[0].at * w[0] + v[1].at * w[1] + v[2].at * w[2];
        let mut normal = unit(v[0].normal * w[0] + v[1].normal * w[1] + v[2].normal * w[2]);
        let to_eye = unit(self.eye - at);
        let mut material = t.material;
        if t.two_sided && normal.dot(&to_eye) < 0.0 {
            normal = -normal;
            if material == slot::FABRIC {
                material = slot::FABRIC_BACK;
            }
        }
        Surface {
            at,
            normal,
            to_eye,
            tex: v[0].tex * w[0] + v[1].tex * w[1] + v[2].tex * w[2],
            open: v[0].open * w[0] + v[1].open * w[1] + v[2].open * w[2],
            material,
        }
    }

    fn shade(&self, s: &Surface) -> Shade {
        let light = &self.look.light;
        let material = &self.look.materials[usize::from(s.material)];
        let albedo = material.at(s.tex);
        let up = 0.5 + 0.5 * s.normal.z;
        let ambient = light.sky * up + light.ground * (1.0 - up);
        let facing = s.normal.dot(&light.towards);
        let wrapped = ((facing + material.wrap) / (1.0 + material.wrap)).max(0.0);
        let fill = 0.10 * s.normal.dot(&s.to_eye).max(0.0);
        let soft = albedo.component_mul(&(ambient * s.open + V3::repeat(fill)));
        let mut lamp = albedo.component_mul(&light.key) * wrapped;
        if material.shine > 0.0 && facing > 0.0 {
            let half = unit(light.towards + s.to_eye);
            let gloss = s.normal.dot(&half).max(0.0).powi(32);
            lamp += light.key * (material.shine * gloss);
        }
        Shade { soft, lamp }
    }
}

/// A shaded point.
struct Surface {
    at: V3,
    normal: V3,
    to_eye: V3,
    tex: V3,
    open: f32,
    material: u8,
}

/// Light sent to the eye without and by the lamp.
struct Shade {
    soft: V3,
    lamp: V3,
}

/// Nearest depth that is drawn, metres.
const NEAR_M: f32 = 0.05;

fn project(camera: &Camera, mesh: &Mesh, corners: &mut Vec<Screen>) {
    let pose = &camera.camera_from_world;
    let ahead = pose.rotation.to_rotation_matrix().matrix().row(2).transpose();
    let (ahead, offset) = (ahead.cast::<f32>(), pose.translation.z as f32);
    corners.clear();
    corners.extend(mesh.vertices.iter().map(|v| {
        let depth = ahead.dot(&v.at) + offset;
        if depth < NEAR_M {
            return Screen::NOWHERE;
        }
        // Sample centres lie at integers; pixel centres at integers lie between two samples.
        camera.project(&Point3::from(v.at.cast::<f64>())).map_or(Screen::NOWHERE, |p| Screen {
            x: (2.0 * p.x + 0.5) as f32,
            y: (2.0 * p.y + 0.5) as f32,
            near: 1.0 / depth,
        })
    }));
}
