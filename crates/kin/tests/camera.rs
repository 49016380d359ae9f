//! Camera geometry against finite differences and round trips.
#![allow(
    clippy::unwrap_used,
    clippy::float_cmp,
    clippy::disallowed_methods,
    reason = "tests: a panic is a failure, exact values are meant"
)]

use kin::{Camera, Distortion, Intrinsics};
use nalgebra::{Isometry3, Matrix2x3, Point2, Point3, Translation3, UnitQuaternion, Vector2, Vector3};
use proptest::prelude::*;

fn camera(distortion: Distortion, rotation: Vector3<f64>) -> Camera {
    Camera {
        name: "test".to_owned(),
        size_px: [1280, 720],
        intrinsics: Intrinsics { fx_px: 900.0, fy_px: 910.0, cx_px: 645.0, cy_px: 355.0, skew_px: 0.3 },
        distortion,
        camera_from_world: Isometry3::from_parts(
            Translation3::new(0.1, -0.2, 2.5),
            UnitQuaternion::from_scaled_axis(rotation),
        ),
    }
}

fn lens() -> impl Strategy<Value = Distortion> {
    prop::array::uniform8(-1.0..1.0f64).prop_map(|v| Distortion {
        k1: 0.3 * v[0],
        k2: 0.1 * v[1],
        p1: 0.005 * v[2],
        p2: 0.005 * v[3],
        k3: 0.02 * v[4],
        k4: 0.1 * v[5],
        k5: 0.02 * v[6],
        k6: 0.005 * v[7],
    })
}

proptest! {
    #[test]
    fn undistort_inverts_distort(d in lens(), x in -0.6..0.6f64, y in -0.4..0.4f64) {
        let point = Vector2::new(x, y);
        let back = d.undistort(d.distort(point));
        prop_assert!(back.is_some_and(|back| (back - point).norm() < 1e-10), "{back:?}");
    }

    #[test]
    fn the_ray_of_a_projected_point_passes_through_it(
        d in lens(), rotation in prop::array::uniform3(-0.2..0.2f64), p in prop::array::uniform3(-0.5..0.5f64)
    ) {
        let camera = camera(d, Vector3::from(rotation));
        let point = Point3::from(p);
        let ray = camera.ray(&camera.project(&point).unwrap()).unwrap();
        let to_point = point - ray.origin_m;
        prop_assert!(to_point.dot(&ray.direction) > 0.0);
        prop_assert!(to_point.cross(&ray.direction).norm() < 1e-9);
    }

    #[test]
    fn the_projection_jacobian_equals_central_differences(
        d in lens(), rotation in prop::array::uniform3(-0.2..0.2f64), p in prop::array::uniform3(-0.5..0.5f64)
    ) {
        let camera = camera(d, Vector3::from(rotation));
        let point = Point3::from(p);
        let (pixel, jacobian) = camera.project_with_jacobian(&point).unwrap();
        prop_assert!((pixel - camera.project(&point).unwrap()).norm() < 1e-12);
        let h = 1e-6;
        let mut numeric = Matrix2x3::zeros();
        for axis in 0..3 {
            let mut step = Vector3::zeros();
            step[axis] = h;
            let difference = camera.project(&(point + step)).unwrap() - camera.project(&(point - step)).unwrap();
            numeric.set_column(axis, &(difference / (2.0 * h)));
        }
        // Rounding of pixels (1e-13) over h, and h^2 curvature.
        prop_assert!((numeric - jacobian).norm() < 1e-5, "{numeric} {jacobian}");
    }
}

#[test]
fn distortion_agrees_with_the_equations_worked_by_hand() {
    // k1 = 0.1 only, at (0.5, 0): r2 = 0.25, radial = 1.025.
    let d = Distortion { k1: 0.1, ..Distortion::default() };
    assert!((d.distort(Vector2::new(0.5, 0.0)) - Vector2::new(0.5125, 0.0)).norm() < 1e-15);
    // p1 = 0.01 only, at (0.2, 0.3): r2 = 0.13; x + 2 p1 x y = 0.2012, y + p1 (r2 + 2 y^2) = 0.3031.
    let d = Distortion { p1: 0.01, ..Distortion::default() };
    assert!((d.distort(Vector2::new(0.2, 0.3)) - Vector2::new(0.2012, 0.3031)).norm() < 1e-15);
}

#[test]
fn a_point_behind_the_camera_has_no_pixel() {
    let camera = camera(Distortion::default(), Vector3::zeros());
    assert!(camera.project(&Point3::new(0.0, 0.0, -2.6)).is_none());
    assert!(camera.project(&Point3::new(f64::NAN, 0.0, 0.0)).is_none());
}

#[test]
fn a_point_where_the_lens_folds_back_has_no_pixel() {
    // k1 = -0.3: r (1 - 0.3 r^2) peaks at r = 1.054.
    let camera = camera(Distortion { k1: -0.3, ..Distortion::default() }, Vector3::zeros());
    let at = |r: f64| Point3::new(-0.1 + r, 0.2, -1.5);
    assert!(camera.project(&at(1.0)).is_some());
    assert!(camera.project(&at(1.1)).is_none());
    // A pixel beyond the fold belongs to no point.
    assert!(camera.ray(&Point2::new(645.0 + 900.0 * 0.75, 355.0)).is_none());
}

#[test]
fn look_at_puts_the_target_in_the_centre_and_up_upwards() {
    let intrinsics = Intrinsics { fx_px: 500.0, fy_px: 500.0, cx_px: 320.0, cy_px: 240.0, skew_px: 0.0 };
    let look = |eye: Point3<f64>, up: Vector3<f64>| {
        Camera::look_at(intrinsics, Distortion::default(), [640, 480], eye, Point3::new(0.4, 0.0, 0.3), up)
    };
    let camera = look(Point3::new(2.0, 0.5, 1.5), Vector3::z()).unwrap();
    let centre = camera.project(&Point3::new(0.4, 0.0, 0.3)).unwrap();
    assert!((centre - Point2::new(320.0, 240.0)).norm() < 1e-9);
    assert!(camera.project(&Point3::new(0.4, 0.0, 0.4)).unwrap().y < 240.0);
    assert!((camera.centre_m() - Point3::new(2.0, 0.5, 1.5)).norm() < 1e-12);
    assert!(camera.camera_from_world.rotation.to_rotation_matrix().matrix().determinant() > 0.99);
    assert!(look(Point3::new(0.4, 0.0, 2.0), Vector3::z()).is_err());
    assert!(look(Point3::new(0.4, 0.0, 0.3), Vector3::z()).is_err());
}
