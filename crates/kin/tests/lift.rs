//! Triangulation and plane lift: synthetic truth, and whether the errors are as large as the covariance says.
#![allow(
    clippy::unwrap_used,
    clippy::float_cmp,
    clippy::disallowed_methods,
    reason = "tests: a panic is a failure, exact values are meant"
)]

use kin::{
    Camera, DepthImage, DepthPatch, Distortion, Error, Homography, Intrinsics, TriangulateOptions, Triangulated, View,
    triangulate,
};
use nalgebra::{Matrix3, Point2, Point3, Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn ring(count: usize) -> Vec<Camera> {
    let intrinsics = Intrinsics { fx_px: 1400.0, fy_px: 1400.0, cx_px: 960.0, cy_px: 540.0, skew_px: 0.0 };
    let distortion = Distortion { k1: -0.12, k2: 0.05, p1: 0.001, p2: -0.0005, ..Distortion::default() };
    (0..count)
        .map(|i| {
            let angle = 0.4 + std::f64::consts::TAU * i as f64 / count as f64;
            let eye = Point3::new(2.5 * angle.cos(), 2.5 * angle.sin(), 1.2 + 0.2 * i as f64);
            Camera::look_at(intrinsics, distortion, [1920, 1080], eye, Point3::new(0.0, 0.0, 0.8), Vector3::z())
                .unwrap()
        })
        .collect()
}

/// Normal noise by Box and Muller.
fn normal(random: &mut ChaCha8Rng) -> f64 {
    let (a, b): (f64, f64) = (random.random_range(1e-12..1.0), random.random());
    (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

fn some_point(random: &mut ChaCha8Rng) -> Point3<f64> {
    Point3::new(random.random_range(-0.4..0.4), random.random_range(-0.4..0.4), random.random_range(0.4..1.2))
}

fn views<'a>(cameras: &'a [Camera], point: &Point3<f64>, sigma_px: f64, random: &mut ChaCha8Rng) -> Vec<View<'a>> {
    cameras
        .iter()
        .map(|camera| {
            let noise = Vector2::new(normal(random), normal(random)) * sigma_px;
            View { camera, pixel: camera.project(point).unwrap() + noise, sigma_px }
        })
        .collect()
}

fn solve(views: &[View]) -> Result<Triangulated, Error> {
    triangulate(views, &TriangulateOptions::default())
}

/// Mahalanobis distance squared: chi-square with 3 degrees of freedom if the covariance is right.
fn mahalanobis2(error: Vector3<f64>, covariance: &Matrix3<f64>) -> f64 {
    error.dot(&(covariance.try_inverse().unwrap() * error))
}

#[test]
fn without_noise_the_point_comes_back() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    for count in 2..=6 {
        let cameras = ring(count.max(3));
        for _ in 0..50 {
            let point = some_point(&mut random);
            let mut views = views(&cameras[..count], &point, 0.0, &mut random);
            for view in &mut views {
                view.sigma_px = 1.0;
            }
            let found = solve(&views).unwrap();
            assert!((found.point_m - point).norm() < 1e-8);
            assert!(found.views.iter().all(|view| view.used) && found.freedom == 2 * count - 3);
        }
    }
}

#[test]
fn errors_are_as_large_as_the_covariance_predicts() {
    let mut random = ChaCha8Rng::seed_from_u64(2);
    for (count, sigma_px) in [(2, 2.0), (3, 5.0), (4, 8.0)] {
        let cameras = ring(count + usize::from(count == 2));
        let trials = 4000;
        let (mut mean, mut within, mut chi2, mut freedom) = (0.0, 0, 0.0, 0);
        for _ in 0..trials {
            let point = some_point(&mut random);
            let views = views(&cameras[..count], &point, sigma_px, &mut random);
            // The gate is opened, because cutting the tails would change the statistics.
            let found = triangulate(&views, &TriangulateOptions::default().gate_sigma(20.0)).unwrap();
            let d2 = mahalanobis2(found.point_m - point, &found.covariance_m2);
            mean += d2 / f64::from(trials);
            within += i32::from(d2 < 7.815);
            chi2 += found.chi2;
            freedom += found.freedom;
        }
        // Chi-square of 3: mean 3 (deviation of the mean of 4000: 0.039), 95 % below 7.815 (deviation 0.0034).
        assert!((mean - 3.0).abs() < 0.16, "{count} views: mean {mean}");
        let part = f64::from(within) / f64::from(trials);
        assert!((part - 0.95).abs() < 0.015, "{count} views: {part} within");
        // And the residuals say so too.
        assert!((chi2 / freedom as f64 - 1.0).abs() < 0.1, "{count} views: {}", chi2 / freedom as f64);
    }
}

#[test]
fn one_wild_view_is_left_out() {
    let cameras = ring(4);
    let mut random = ChaCha8Rng::seed_from_u64(3);
    for bad in 0..4 {
        for _ in 0..200 {
            let point = some_point(&mut random);
            let mut views = views(&cameras, &point, 2.0, &mut random);
            let angle: f64 = random.random_range(0.0..std::f64::consts::TAU);
            views[bad].pixel += Vector2::new(angle.cos(), angle.sin()) * random.random_range(100.0..400.0);
            let found = solve(&views).unwrap();
            assert!(!found.views[bad].used, "view {bad}");
            assert!(found.views[bad].residual_px.unwrap() > 20.0);
            assert!(mahalanobis2(found.point_m - point, &found.covariance_m2) < 40.0);
        }
    }
}

#[test]
fn views_that_do_not_meet_are_an_error_and_not_a_point() {
    let cameras = ring(3);
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let mut two = views(&cameras[..2], &Point3::new(0.0, 0.0, 0.8), 1.0, &mut random);
    two[1].pixel.y += 200.0;
    assert!(matches!(solve(&two), Err(Error::InconsistentViews { .. })));
    assert!(matches!(solve(&two[..1]), Err(Error::TooFewViews { usable: 1 })));
    let same = [two[0], two[0]];
    assert!(matches!(solve(&same), Err(Error::ParallelRays { .. })));
    two[0].sigma_px = f64::NAN;
    assert!(matches!(solve(&two), Err(Error::Domain { .. })));
    two[0].sigma_px = 1.0;
    two[0].pixel.x = f64::NAN;
    assert!(matches!(solve(&two), Err(Error::TooFewViews { usable: 1 })));
}

#[test]
fn the_plane_lift_is_as_uncertain_as_its_covariance_says() {
    let camera = &ring(3)[0];
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let (sigma_px, sigma_height_m, height_m) = (3.0, 0.015, 0.1);
    let trials = 4000;
    let mut mean = 0.0;
    for _ in 0..trials {
        let x = random.random_range(-0.4..0.4);
        let y = random.random_range(-0.4..0.4);
        let truth = Point3::new(x, y, height_m + sigma_height_m * normal(&mut random));
        let pixel = camera.project(&truth).unwrap() + Vector2::new(normal(&mut random), normal(&mut random)) * sigma_px;
        let lifted = camera.lift_to_plane(&pixel, sigma_px, height_m, sigma_height_m).unwrap();
        assert!((lifted.point_m.z - height_m).abs() < 1e-12);
        mean += mahalanobis2(lifted.point_m - truth, &lifted.covariance_m2) / f64::from(trials);
    }
    assert!((mean - 3.0).abs() < 0.16, "{mean}");
}

#[test]
fn a_pixel_above_the_horizon_does_not_look_at_the_bench() {
    let camera = &ring(3)[0];
    assert!(matches!(
        camera.lift_to_plane(&Point2::new(960.0, -4000.0), 1.0, 0.0, 0.0),
        Err(Error::PlaneMissed { .. })
    ));
    let below = camera.lift_to_plane(&Point2::new(960.0, 540.0), 1.0, 5.0, 0.0);
    assert!(matches!(below, Err(Error::PlaneMissed { .. })));
    assert!(camera.lift_to_plane(&Point2::new(960.0, 540.0), -1.0, 0.0, 0.0).is_err());
    // On the bench 60 m away a ray falls by 0.02 rad and is lifted; 200 m away, by 0.006 rad, it says nothing.
    let eye = camera.camera_from_world.inverse().translation.vector;
    let inwards = Vector3::new(-eye.x, -eye.y, 0.0).normalize();
    let on_bench = |away_m: f64| Point3::from(Vector3::new(eye.x, eye.y, 0.0) + inwards * away_m);
    let lift = |point: &Point3<f64>| camera.lift_to_plane(&camera.project(point).unwrap(), 1.0, 0.0, 0.0);
    assert!((lift(&on_bench(60.0)).unwrap().point_m - on_bench(60.0)).norm() < 1e-6);
    assert!(matches!(lift(&on_bench(200.0)), Err(Error::PlaneMissed { .. })));
}

#[test]
fn a_homography_agrees_with_the_camera_that_made_its_points() {
    let mut camera = ring(3)[1].clone();
    camera.distortion = Distortion::default();
    let corners = [(-0.3, -0.2), (0.3, -0.2), (0.3, 0.2), (-0.3, 0.2), (0.0, 0.05)];
    let pixel = |x: f64, y: f64| camera.project(&Point3::new(x, y, 0.0)).unwrap();
    for count in [4, 5] {
        let pairs: Vec<_> = corners[..count].iter().map(|&(x, y)| (pixel(x, y), Point2::new(x, y))).collect();
        let homography = Homography::from_correspondences(&pairs).unwrap();
        assert!(homography.rms_m() < 1e-9);
        let (point, covariance) = homography.map(&pixel(0.11, -0.07), 2.0).unwrap();
        assert!((point - Point2::new(0.11, -0.07)).norm() < 1e-9);
        assert!((homography.unmap(&point).unwrap() - pixel(0.11, -0.07)).norm() < 1e-6);
        // The same covariance as the plane lift of the real camera.
        let lifted = camera.lift_to_plane(&pixel(0.11, -0.07), 2.0, 0.0, 0.0).unwrap();
        assert!((covariance - lifted.covariance_m2.fixed_view::<2, 2>(0, 0)).norm() < 1e-9 * covariance.norm() + 1e-12);
        // Beyond the horizon there is no bench.
        assert!(homography.map(&Point2::new(960.0, -9000.0), 1.0).is_none());
    }
}

#[test]
fn more_points_average_the_noise_of_a_homography() {
    let mut camera = ring(3)[1].clone();
    camera.distortion = Distortion::default();
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let mut pairs = Vec::new();
    for i in 0..10 {
        for j in 0..10 {
            let plane = Point2::new(-0.3 + 0.06 * f64::from(i), -0.3 + 0.06 * f64::from(j));
            let noise = Vector2::new(normal(&mut random), normal(&mut random));
            pairs.push((camera.project(&Point3::new(plane.x, plane.y, 0.0)).unwrap() + noise, plane));
        }
    }
    let homography = Homography::from_correspondences(&pairs).unwrap();
    let pixel = camera.project(&Point3::new(0.1, 0.1, 0.0)).unwrap();
    let (point, _) = homography.map(&pixel, 1.0).unwrap();
    // One pixel is about 2 mm here; a hundred of them leave a few tenths.
    assert!((point - Point2::new(0.1, 0.1)).norm() < 0.001);
    assert!(homography.rms_m() > 0.001 && homography.rms_m() < 0.006);
}

#[test]
fn degenerate_homographies_are_refused() {
    let at = |x: f64, y: f64| (Point2::new(x, y), Point2::new(x, y));
    let line = [at(0.0, 0.0), at(1.0, 1.0), at(2.0, 2.0), at(3.0, 3.0)];
    assert!(matches!(Homography::from_correspondences(&line), Err(Error::Homography { .. })));
    let three = [at(0.0, 0.0), at(1.0, 1.0), at(2.0, 2.0), at(3.0, 0.0)];
    assert!(matches!(Homography::from_correspondences(&three), Err(Error::Homography { .. })));
    assert!(Homography::from_correspondences(&three[..3]).is_err());
    let nan = [at(0.0, 0.0), at(1.0, 0.0), at(1.0, f64::NAN), at(0.0, 1.0)];
    assert!(Homography::from_correspondences(&nan).is_err());
}

fn depth_scene(far_m: f32) -> Vec<f32> {
    // An arm 13 px wide at 0.9 m before a bench, with holes.
    (0..64 * 48)
        .map(|i| match (i % 64, i / 64) {
            (x, y) if (x + y) % 5 == 0 => 0.0,
            (x, y) if (x * y) % 7 == 3 => f32::NAN,
            (x, _) if (26..39).contains(&x) => 0.9 + 0.002 * ((i % 3) as f32 - 1.0),
            _ => far_m,
        })
        .collect()
}

#[test]
fn the_depth_patch_reads_the_arm_and_not_the_bench_behind_it() {
    let depth_m = depth_scene(1.6);
    let image = DepthImage { depth_m: &depth_m, width_px: 64 };
    // Near the edge of the arm, where most of the patch sees the bench.
    for u in [25.0, 28.0, 32.0, 37.0, 38.0, 40.0] {
        let (depth, sigma) = DepthPatch::default().read(&image, &Point2::new(u, 24.0)).unwrap();
        assert!((depth - 0.9).abs() < 0.003, "{u}: {depth}");
        assert!((0.005..0.01).contains(&sigma));
    }
    let off = DepthPatch::default().read(&image, &Point2::new(-3.0, 24.0));
    assert!(matches!(off, Err(Error::NoDepth { .. })));
    let nothing = vec![0.0; 64 * 48];
    let empty = DepthImage { depth_m: &nothing, width_px: 64 };
    assert!(matches!(
        DepthPatch::default().read(&empty, &Point2::new(9.0, 9.0)),
        Err(Error::NoDepth { usable: 0, .. })
    ));
}

#[test]
fn the_depth_lift_is_as_uncertain_as_its_covariance_says() {
    let camera = &ring(3)[1];
    let mut random = ChaCha8Rng::seed_from_u64(8);
    let (sigma_px, sigma_depth_m) = (3.0, 0.01);
    let trials = 4000;
    let mut mean = 0.0;
    for _ in 0..trials {
        let truth = some_point(&mut random);
        let pixel = camera.project(&truth).unwrap() + Vector2::new(normal(&mut random), normal(&mut random)) * sigma_px;
        let depth_m = (camera.camera_from_world * truth).z + sigma_depth_m * normal(&mut random);
        let lifted = camera.lift_with_depth(&pixel, sigma_px, depth_m, sigma_depth_m).unwrap();
        mean += mahalanobis2(lifted.point_m - truth, &lifted.covariance_m2) / f64::from(trials);
    }
    assert!((mean - 3.0).abs() < 0.16, "{mean}");
    assert!(camera.lift_with_depth(&Point2::new(9.0, 9.0), 1.0, 0.0, 0.1).is_err());
    for (sigma_px, sigma_depth_m) in [(-1.0, 0.1), (f64::NAN, 0.1), (1.0, -0.1), (1.0, f64::INFINITY)] {
        let refused = camera.lift_with_depth(&Point2::new(900.0, 500.0), sigma_px, 1.0, sigma_depth_m);
        assert!(matches!(refused, Err(Error::Domain { .. })));
    }
}

#[test]
fn a_patch_with_too_few_readings_has_no_depth() {
    // 17 of the 81 pixels of a patch are a fifth, rounded up.
    for (readings, enough) in [(16, false), (17, true)] {
        let mut depth_m = vec![0.0; 64 * 48];
        for i in 0..readings {
            depth_m[(20 + i / 9) * 64 + 28 + i % 9] = 0.8;
        }
        let read =
            DepthPatch::default().read(&DepthImage { depth_m: &depth_m, width_px: 64 }, &Point2::new(32.0, 24.0));
        match read {
            Ok((depth, _)) => assert!(enough && (depth - 0.8).abs() < 1e-6),
            Err(error) => assert!(!enough && matches!(error, Error::NoDepth { usable: 16, needed: 17, .. })),
        }
    }
}

#[test]
fn the_depth_of_a_noisy_surface_is_as_uncertain_as_its_readings_say() {
    let mut random = ChaCha8Rng::seed_from_u64(9);
    let patch = {
        let mut patch = DepthPatch::default();
        patch.sigma_floor_m = 0.001;
        patch
    };
    let (mut squares, mut told) = (0.0, 0.0);
    for _ in 0..200 {
        let depth_m: Vec<f32> = (0..81).map(|_| (1.2 + 0.02 * normal(&mut random)) as f32).collect();
        let (depth, sigma) =
            patch.read(&DepthImage { depth_m: &depth_m, width_px: 9 }, &Point2::new(4.0, 4.0)).unwrap();
        squares += (depth - 1.2) * (depth - 1.2) / 200.0;
        told += sigma * sigma / 200.0;
    }
    // A median is 1.25 times as uncertain as a mean; 200 trials tell a deviation to 5 %.
    let ratio = f64::sqrt(squares / told);
    assert!((0.85..1.4).contains(&ratio), "{ratio}");
}
