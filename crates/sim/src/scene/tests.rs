use std::time::Duration;

use image::{Rgb, RgbImage};
use kin::Camera;
use nalgebra::{Point2, Point3};

use super::effects::Effects;
use super::mesh::{Mesh, Part, V3};
use super::shadow::{ShadowMap, openness};
use super::{Scene, SceneVariation, Visibility, default_camera, look::Look};
use crate::worker::{Action, Keypoint, Script, Worker, WorkerParams};

fn worker(action: Action) -> Worker {
    Worker::new(WorkerParams { script: Script::Repeat(action), ..WorkerParams::default() }).unwrap()
}

/// Depth of the nearest triangle along a pixel's ray, over all triangles (Möller and Trumbore, 1997), in f64.
fn cast(camera: &Camera, mesh: &Mesh, pixel: Point2<f64>) -> Option<f64> {
    let ray = camera.ray(&pixel)?;
    let ahead = camera.camera_from_world.rotation * ray.direction.into_inner();
    let mut nearest: Option<f64> = None;
    for t in &mesh.triangles {
        let [a, b, c] = t.corners.map(|k| Point3::from(mesh.vertices[k as usize].at.cast::<f64>()));
        let (e1, e2) = (b - a, c - a);
        let p = ray.direction.cross(&e2);
        let det = e1.dot(&p);
        let s = ray.origin_m - a;
        let u = s.dot(&p) / det;
        let q = s.cross(&e1);
        let v = ray.direction.dot(&q) / det;
        let along = e2.dot(&q) / det;
        if det.abs() > 1e-14 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 && along > 0.0 {
            let depth = along * ahead.z;
            nearest = Some(nearest.map_or(depth, |n| n.min(depth)));
        }
    }
    nearest
}

#[test]
fn depths_agree_with_rays_cast_at_every_triangle() {
    let worker = worker(Action::Flip);
    let mut scene = Scene::new(default_camera([160, 120]).unwrap(), worker.params());
    scene.render(&worker.pose_at(Duration::from_millis(1200)));
    let (mut body, mut worst) = (0, 0.0_f64);
    for row in (3..240).step_by(7) {
        for column in (2..320).step_by(5) {
            let index = row * scene.buffer.width + column;
            if scene.buffer.owner[index] == 0 {
                continue;
            }
            let pixel = Point2::new((column as f64 - 0.5) / 2.0, (row as f64 - 0.5) / 2.0);
            let drawn = 1.0 / f64::from(scene.buffer.near[index]);
            let Some(depth) = cast(scene.camera(), &scene.mesh, pixel) else {
                panic!("a surface was drawn at {pixel} where no ray meets one");
            };
            body += 1;
            worst = worst.max((drawn - depth).abs());
        }
    }
    assert!(body > 200, "{body} samples on the worker");
    // f32 rounding of 1 / depth at 1.5 m is 2e-7 m; grazing triangles of a few samples multiply it.
    assert!(worst < 1e-3, "{worst} m");
}

#[test]
fn a_joint_is_seen_exactly_when_no_foreign_surface_lies_before_it() {
    for (seed, ms) in [(3, 500), (4, 1300), (11, 2100), (23, 700)] {
        let variation = SceneVariation::random(seed, [200, 150]).unwrap();
        let worker = Worker::new(variation.worker.clone()).unwrap();
        let pose = worker.pose_at(Duration::from_millis(ms));
        let mut scene = Scene::varied(&variation);
        let (_, truth) = scene.render(&pose);
        let mut furniture = Mesh::default();
        super::room::add(&mut furniture, &scene.look, nalgebra::Vector3::from(variation.worker.hip_m).cast());
        for keypoint in [Keypoint::RightWrist, Keypoint::LeftWrist, Keypoint::RightKnee, Keypoint::LeftAnkle] {
            let k = keypoint.index();
            if truth.visibility[k] == Visibility::OutOfView {
                continue;
            }
            let pixel = truth.points_px[k].unwrap();
            let depth = (variation.camera.camera_from_world * pose.joint(keypoint)).z;
            let behind_furniture = cast(&variation.camera, &furniture, pixel).is_some_and(|d| d < depth - 0.02);
            if behind_furniture {
                assert_eq!(truth.visibility[k], Visibility::Occluded, "seed {seed} {keypoint:?}");
            }
        }
    }
}

#[test]
fn the_default_view_sees_the_right_arm_through_every_action() {
    for action in Action::ALL {
        let worker = worker(action);
        let mut scene = Scene::new(default_camera([160, 120]).unwrap(), worker.params());
        for k in 0..30 {
            let (_, truth) = scene.render(&worker.pose_at(Duration::from_millis(100 * k)));
            for keypoint in
                [Keypoint::RightShoulder, Keypoint::RightElbow, Keypoint::RightWrist, Keypoint::LeftShoulder]
            {
                assert_eq!(truth.visibility[keypoint.index()], Visibility::Visible, "{action:?} {k} {keypoint:?}");
            }
            let u = |k: Keypoint| truth.pixel(k).unwrap().x;
            assert!(u(Keypoint::RightShoulder) < u(Keypoint::LeftShoulder), "the worker faces the camera");
        }
    }
}

#[test]
fn a_cloth_over_the_wrist_hides_it() {
    let worker = worker(Action::Move);
    let pose = worker.pose_at(Duration::from_millis(300));
    let look = Look { cover_m: Some([0.12, 0.14]), cover_at: 1.0, ..Look::default() };
    let mut scene = Scene::build(default_camera([160, 120]).unwrap(), look, Effects::default(), worker.params());
    let (_, truth) = scene.render(&pose);
    assert_eq!(truth.visibility[Keypoint::RightWrist.index()], Visibility::Occluded);
    assert_eq!(truth.visibility[Keypoint::RightShoulder.index()], Visibility::Visible);
}

#[test]
fn hidden_parts_of_the_face_are_hidden_from_behind() {
    let worker = worker(Action::Move);
    let mut camera = default_camera([160, 120]).unwrap();
    let eye = Point3::new(-1.6, 0.1, 0.7);
    camera.camera_from_world =
        nalgebra::Isometry3::look_at_rh(&eye, &Point3::new(0.0, 0.0, 0.2), &nalgebra::Vector3::z());
    let flip = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::x_axis(), std::f64::consts::PI);
    camera.camera_from_world = flip * camera.camera_from_world;
    let look = Look { wall_m: 3.0, ..Look::default() };
    let mut scene = Scene::build(camera, look, Effects::default(), worker.params());
    let (_, truth) = scene.render(&worker.pose_at(Duration::ZERO));
    for keypoint in [Keypoint::Nose, Keypoint::LeftEye, Keypoint::RightEye] {
        assert_eq!(truth.visibility[keypoint.index()], Visibility::Occluded, "{keypoint:?}");
    }
    let u = |k: Keypoint| truth.pixel(k).unwrap().x;
    assert!(u(Keypoint::RightShoulder) > u(Keypoint::LeftShoulder));
}

#[test]
fn equal_inputs_give_equal_bytes() {
    let variation = SceneVariation::random(99, [120, 90]).unwrap();
    let worker = Worker::new(variation.worker.clone()).unwrap();
    let draw = || Scene::varied(&variation).render(&worker.pose_at(variation.at));
    assert_eq!(draw(), draw());
    let plain = || {
        let mut scene = Scene::new(default_camera([120, 90]).unwrap(), worker.params());
        scene.render(&worker.pose_at(Duration::from_secs(1)));
        scene.render(&worker.pose_at(Duration::from_secs(2))).0
    };
    assert_eq!(plain(), plain());
}

#[test]
fn variations_show_most_workers_and_hide_some_wrists() {
    let (mut seen, mut hidden) = (0, 0);
    for seed in 0..60 {
        let variation = SceneVariation::random(seed, [80, 60]).unwrap();
        let worker = Worker::new(variation.worker.clone()).unwrap();
        let (_, truth) = Scene::varied(&variation).render(&worker.pose_at(variation.at));
        match truth.visibility[Keypoint::RightWrist.index()] {
            Visibility::Visible => seen += 1,
            Visibility::Occluded => hidden += 1,
            Visibility::OutOfView => {}
        }
    }
    assert!(seen >= 20 && hidden >= 8 && seen + hidden >= 40, "seen {seen}, hidden {hidden} of 60");
}

#[test]
fn a_plate_shades_what_lies_under_it_and_nothing_else() {
    let light = super::look::Light { towards: V3::z(), ..Look::default().light };
    let mut map = ShadowMap::new(&light, V3::zeros(), 1.0, 200);
    let mut mesh = Mesh::default();
    mesh.sheet(Part::Fabric, 0, V3::new(0.0, 0.0, 0.5), V3::x() * 0.2, V3::y() * 0.2, (1, 1), true);
    map.draw(&mesh);
    let lit = |x: f32, z: f32| map.lit(map.place(V3::new(x, 0.0, z)));
    assert!(lit(0.0, 0.0) < 0.01 && lit(0.15, 0.0) < 0.01);
    assert!(lit(0.25, 0.0) > 0.99 && lit(0.0, 0.6) > 0.99);
}

#[test]
fn a_sphere_blocks_the_share_of_the_sky_that_it_covers() {
    // Form factor of a sphere of radius r at height d above a small plate: (r / d)^2; the shader keeps 15 % of it.
    let open = openness(V3::zeros(), V3::z(), &[(V3::new(0.0, 0.0, 0.4), 0.1)]);
    assert!((open - (1.0 - 0.85 / 16.0)).abs() < 1e-6);
    assert!((openness(V3::zeros(), V3::z(), &[(V3::new(0.0, 0.0, -0.4), 0.1)]) - 1.0).abs() < 1e-6);
}

#[test]
fn blur_keeps_the_mean_and_noise_has_its_strength() {
    let mut picture = RgbImage::from_fn(64, 64, |x, _| if x < 32 { Rgb([60; 3]) } else { Rgb([180; 3]) });
    Effects { blur_passes: 2, ..Effects::default() }.apply(&mut picture, 0);
    let mean = |p: &RgbImage| p.pixels().map(|p| f64::from(p.0[1])).sum::<f64>() / 4096.0;
    assert!((mean(&picture) - 120.0).abs() < 1.0, "{}", mean(&picture));
    let mut grey = RgbImage::from_pixel(64, 64, Rgb([120; 3]));
    Effects { noise: 6.0, seed: 3, ..Effects::default() }.apply(&mut grey, 0);
    let average = mean(&grey);
    let spread = (grey.pixels().map(|p| (f64::from(p.0[1]) - average).powi(2)).sum::<f64>() / 4096.0).sqrt();
    // The standard error of a standard deviation from 4096 values is 1.1 %.
    assert!((average - 120.0).abs() < 0.5 && (spread - 6.0).abs() < 0.3, "{average} {spread}");
}
