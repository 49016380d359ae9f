//! Angles and orientations: the branch that is taken, the centre, the identity, several turns, and what a file may say.
#![expect(clippy::unwrap_used, reason = "tests")]

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use gmr_core::{Chart, Coordinate, CoordinateKind, Error, Trajectory, unwrap_rad, wrap_rad};

fn close(what: &str, a: &[f64], b: &[f64], tolerance: f64) {
    assert!(
        a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance),
        "{what}: {a:?} is not {b:?}"
    );
}

fn trajectory(values: Vec<f64>, dim: usize) -> Trajectory {
    Trajectory::new((0..values.len() / dim).map(|i| i as f64).collect(), values, dim).unwrap()
}

/// `(w, x, y, z)` of a turn about a unit axis.
fn turn(axis: [f64; 3], angle_rad: f64) -> [f64; 4] {
    let (s, c) = (0.5 * angle_rad).sin_cos();
    [c, s * axis[0], s * axis[1], s * axis[2]]
}

/// Rodrigues' formula: the rotation matrix of a rotation vector, no quaternion involved.
fn rodrigues(v: &[f64]) -> [[f64; 3]; 3] {
    let angle = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    let (a, b) = if angle < 1e-9 { (1.0, 0.5) } else { (angle.sin() / angle, (1.0 - angle.cos()) / (angle * angle)) };
    let k = [[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]];
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let square: f64 = (0..3).map(|l| k[i][l] * k[l][j]).sum();
            f64::from(u8::from(i == j)) + a * k[i][j] + b * square
        })
    })
}

/// The matrix of a unit quaternion by its columns.
fn matrix(q: &[f64]) -> [[f64; 3]; 3] {
    let (w, x, y, z) = (q[0], q[1], q[2], q[3]);
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

fn about_identity() -> Chart {
    Chart::new(vec![Coordinate::Rotation { centre: [1.0, 0.0, 0.0, 0.0] }]).unwrap()
}

#[test]
fn an_angle_lies_above_minus_pi_and_up_to_pi() {
    for (angle, expected) in
        [(PI, PI), (-PI, PI), (3.0 * PI, PI), (-3.0 * PI, PI), (0.5, 0.5), (TAU + 0.5, 0.5), (-0.5, -0.5)]
    {
        close("wrapped", &[wrap_rad(angle)], &[expected], 1e-15);
    }
    let mut angles = [0.0, 2.0, 4.0 - TAU, 6.0 - TAU, 8.0 - TAU, 4.0];
    unwrap_rad(&mut angles);
    close("unwrapped", &angles, &[0.0, 2.0, 4.0, 6.0, 8.0, 4.0 + TAU], 1e-14);
}

#[test]
fn a_motion_lies_on_the_turn_nearest_to_the_centre_and_stays_continuous() {
    let chart = Chart::new(vec![Coordinate::Angle { centre_rad: 3.0 }, Coordinate::Linear]).unwrap();
    // Begins at -3 rad (3.28 on the centre's turn) and goes on for more than a whole turn upwards.
    let angles: Vec<f64> = (0..40).map(|i| 3.28 + 0.25 * f64::from(i)).collect();
    let rows = angles.iter().flat_map(|a| [wrap_rad(*a), 2.0 * a]).collect();
    let flat = chart.encode(&trajectory(rows, 2)).unwrap();
    // Mean 3.28 + 4.875 = 8.155 is nearer to 3 + 2 pi than to 3: one turn down.
    let expected: Vec<f64> = angles.iter().map(|a| a - TAU).collect();
    close("angles", &flat.column(0), &expected, 1e-12);
    close("linear", &flat.column(1), &angles.iter().map(|a| 2.0 * a).collect::<Vec<_>>(), 1e-12);
    let mut back = [0.0; 2];
    for (i, angle) in angles.iter().enumerate() {
        chart.decode_into(flat.row(i), &mut back).unwrap();
        close("back", &back, &[wrap_rad(*angle), 2.0 * angle], 1e-12);
        assert!(back[0] > -PI && back[0] <= PI);
    }
    // A single row lies near the centre, or near the row before it.
    let mut row = [0.0; 2];
    chart.encode_row(&[-3.0, 1.0], None, &mut row).unwrap();
    close("centre", &row, &[TAU - 3.0, 1.0], 1e-15);
    chart.encode_row(&[-3.0, 1.0], Some(&[-9.0, 0.0]), &mut row).unwrap();
    close("previous", &row, &[-3.0 - TAU, 1.0], 1e-15);
}

#[test]
fn a_fitted_centre_is_the_mean_of_all_demonstrations_on_the_circle_and_on_the_sphere() {
    let demonstrations = [trajectory(vec![3.0, 3.1], 1), trajectory(vec![-3.1, -2.9], 1)];
    let chart = Chart::fit(&[CoordinateKind::Angle], &demonstrations).unwrap();
    let Coordinate::Angle { centre_rad } = chart.coordinates()[0] else { panic!() };
    let mean = (3.0 + 3.1 + (TAU - 3.1) + (TAU - 2.9)) / 4.0;
    // The circular mean and the mean of the unwrapped angles agree to the third order of the spread.
    close("circular", &[wrap_rad(centre_rad - mean)], &[0.0], 1e-3);

    // Turns about two axes that lie around a far centre: the logarithms about the mean sum to zero.
    let centre = turn([0.0, 0.6, 0.8], 2.5);
    let product = |a: [f64; 4], b: [f64; 4]| {
        let (ma, mb) = (matrix(&a), matrix(&b));
        let dot = |i: usize, j: usize| (0..3).map(|l| ma[i][l] * mb[l][j]).sum::<f64>();
        std::array::from_fn::<[f64; 3], 3, _>(|i| std::array::from_fn(|j| dot(i, j)))
    };
    let offsets = [[0.9, 0.1, 0.0], [-0.2, 0.8, 0.3], [0.1, -0.3, -0.7], [-0.5, -0.4, 0.6], [0.2, 0.1, 0.5]];
    let mut values = Vec::new();
    let about = Chart::new(vec![Coordinate::Rotation { centre }]).unwrap();
    for v in offsets {
        let mut q = [0.0; 4];
        about.decode_into(&v, &mut q).unwrap();
        // Decoding is c exp(v): judged by matrices and Rodrigues' formula.
        let expected = {
            let (c, r) = (matrix(&centre), rodrigues(&v));
            std::array::from_fn::<[f64; 3], 3, _>(|i| {
                std::array::from_fn(|j| (0..3).map(|l| c[i][l] * r[l][j]).sum::<f64>())
            })
        };
        close("decode", matrix(&q).as_flattened(), expected.as_flattened(), 1e-14);
        values.extend(q);
    }
    let motion = trajectory(values, 4);
    let chart = Chart::fit(&[CoordinateKind::Rotation], std::slice::from_ref(&motion)).unwrap();
    let Coordinate::Rotation { centre: mean } = chart.coordinates()[0] else { panic!() };
    close("length", &[mean.iter().map(|v| v * v).sum::<f64>()], &[1.0], 1e-15);
    let mut sum = [0.0; 3];
    let mut flat = [0.0; 3];
    for i in 0..motion.len() {
        chart.encode_row(motion.row(i), None, &mut flat).unwrap();
        // mean exp(flat) is the orientation itself.
        let mut q = [0.0; 4];
        chart.decode_into(&flat, &mut q).unwrap();
        close("round trip", matrix(&q).as_flattened(), matrix(motion.row(i)).as_flattened(), 1e-14);
        sum = std::array::from_fn(|l| sum[l] + flat[l]);
    }
    close("karcher", &sum, &[0.0; 3], 1e-12);
    close(
        "identity",
        product(mean, [mean[0], -mean[1], -mean[2], -mean[3]]).as_flattened(),
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].as_flattened(),
        1e-14,
    );
}

#[test]
fn either_sign_of_a_quaternion_is_the_same_short_turn() {
    let chart = about_identity();
    // Near a half turn an arc sine would keep only half of the digits.
    for angle in [0.0, 1e-200, 1e-12, 0.3, FRAC_PI_2, 3.0, PI - 1e-4, PI - 1e-6] {
        let q = turn([0.0, 0.6, -0.8], angle);
        for sign in [1.0, -1.0] {
            let mut v = [f64::NAN; 3];
            chart.encode_row(&q.map(|x| sign * x), None, &mut v).unwrap();
            close("logarithm", &v, &[0.0, 0.6 * angle, -0.8 * angle], 1e-14 * angle);
        }
    }
}

#[test]
fn a_turning_tool_stays_continuous_through_the_identity_and_over_several_turns() {
    // Three turns about one axis and back, in steps that land on the identity exactly.
    let axis = [0.48, -0.6, 0.64];
    let angles: Vec<f64> = (0..=96).map(|i| f64::from(48 - (i - 48i32).abs()) * TAU / 16.0).collect();
    let values = angles.iter().flat_map(|a| turn(axis, *a)).collect();
    let flat = about_identity().encode(&trajectory(values, 4)).unwrap();
    for (i, angle) in angles.iter().enumerate() {
        close("turns", flat.row(i), &axis.map(|a| a * angle), 1e-9);
    }
    // The row after a whole number of turns, alone: the identity continued is that many turns about the same axis.
    let mut v = [0.0; 3];
    let previous = axis.map(|a| a * (TAU - 0.1));
    about_identity().encode_row(&[1.0, 0.0, 0.0, 0.0], Some(&previous), &mut v).unwrap();
    close("identity", &v, &axis.map(|a| a * TAU), 1e-12);
    about_identity().encode_row(&[1.0, 0.0, 0.0, 0.0], Some(&[0.2, 0.0, 0.0]), &mut v).unwrap();
    close("still", &v, &[0.0; 3], 1e-15);
    about_identity().encode_row(&[1.0, 0.0, 0.0, 0.0], Some(&[0.0; 3]), &mut v).unwrap();
    close("at rest", &v, &[0.0; 3], 1e-15);
}

#[test]
fn a_quaternion_may_be_off_one_by_a_thousandth_and_is_used_with_length_one() {
    let chart = about_identity();
    let (q, mut v) = (turn([1.0, 0.0, 0.0], 1.0), [0.0; 3]);
    for length in [0.9991, 1.0009, 1.0 - 1e-9] {
        chart.encode_row(&q.map(|x| length * x), None, &mut v).unwrap();
        close("normalised", &v, &[1.0, 0.0, 0.0], 1e-12);
    }
    for length in [0.998, 1.002, 0.6, 1.4, 0.0] {
        let refused = chart.encode_row(&q.map(|x| length * x), None, &mut v);
        assert!(matches!(refused, Err(Error::InvalidParameter { name: "quaternion length", .. })), "{length}");
    }
    let refused = chart.encode_row(&[f64::NAN, 0.0, 0.0, 0.0], None, &mut v);
    assert!(matches!(refused, Err(Error::InvalidParameter { name: "quaternion length", .. })));
}

#[test]
fn a_centre_of_nearly_length_one_leaves_the_way_back_on_the_manifold() {
    let centre = turn([0.0, 0.6, 0.8], 2.0).map(|x| 1.0008 * x);
    let chart = Chart::new(vec![Coordinate::Rotation { centre }]).unwrap();
    let (mut q, mut v) = ([0.0; 4], [0.0; 3]);
    chart.decode_into(&[0.3, -0.2, 0.9], &mut q).unwrap();
    close("length", &[q.iter().map(|x| x * x).sum::<f64>()], &[1.0], 1e-15);
    chart.encode_row(&q, None, &mut v).unwrap();
    close("round trip", &v, &[0.3, -0.2, 0.9], 1e-14);
    // A centre made so is kept bit for bit when it is stored and read.
    let again = Chart::new(chart.coordinates().to_vec()).unwrap();
    assert_eq!(again, chart);
}

#[test]
fn a_chart_read_from_a_file_is_checked_as_a_new_one() {
    let chart = Chart::new(vec![Coordinate::Linear, Coordinate::Rotation { centre: [0.6, 0.0, 0.8, 0.0] }]).unwrap();
    let text = serde_json::to_string(&chart).unwrap();
    assert_eq!(serde_json::from_str::<Chart>(&text).unwrap(), chart);
    for broken in [
        text.replace("0.6", "0.7"),
        text.replace("\"linear\"", "{\"angle\":{\"centre_rad\":1e999}}"),
        "{\"coordinates\":[]}".to_owned(),
        text.replace("{\"coordinates\"", "{\"more\":1,\"coordinates\""),
    ] {
        assert_ne!(broken, text);
        assert!(serde_json::from_str::<Chart>(&broken).is_err(), "{broken}");
    }
}
