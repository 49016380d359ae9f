//! What a demonstration says between its samples, beyond its ends, and of columns it does not have.
#![expect(clippy::unwrap_used, reason = "tests")]

use gmr_core::{Error, Trajectory};

fn motion() -> Trajectory {
    Trajectory::new(vec![1.0, 2.0, 4.0], vec![0.0, 5.0, 3.0, 1.0, 7.0, -7.0], 2).unwrap()
}

#[test]
fn between_samples_the_line_between_them_holds_and_beyond_the_ends_the_last_one() {
    let motion = motion();
    for (time_s, expected) in [
        (-10.0, [0.0, 5.0]),
        (1.0, [0.0, 5.0]),
        (1.25, [0.75, 4.0]),
        (2.0, [3.0, 1.0]),
        (2.5, [4.0, -1.0]),
        (4.0, [7.0, -7.0]),
        (1e300, [7.0, -7.0]),
    ] {
        let mut out = [f64::NAN; 2];
        motion.interpolate_into(time_s, &mut out).unwrap();
        assert!(out.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-15), "{time_s}: {out:?}");
    }
}

#[test]
fn no_time_and_no_room_are_errors_and_touch_nothing() {
    let motion = motion();
    let mut out = [1.0; 2];
    for time_s in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert!(matches!(motion.interpolate_into(time_s, &mut out), Err(Error::NotFinite { what: "time_s", .. })));
    }
    for mut short in [vec![1.0], vec![1.0; 3]] {
        // Between samples and beyond them.
        for time_s in [1.5, 9.0] {
            let refused = motion.interpolate_into(time_s, &mut short);
            assert!(matches!(refused, Err(Error::Length { expected: 2, .. })), "{refused:?}");
        }
        assert!(short.iter().all(|v| v.to_bits() == 1f64.to_bits()));
    }
    assert!(out.iter().all(|v| v.to_bits() == 1f64.to_bits()));
}

#[test]
#[should_panic(expected = "index out of bounds")]
fn a_column_that_is_not_there_is_no_other_column() {
    let _ = motion().column(2);
}

#[test]
fn speeds_are_central_differences_over_all_columns_and_one_sided_at_the_ends() {
    // Steps (3, -4) in 1 s and (4, -8) in 2 s; both together (7, -12) in 3 s.
    let expected = [5.0, 193f64.sqrt() / 3.0, 80f64.sqrt() / 2.0];
    for (speed, expected) in motion().speeds().iter().zip(expected) {
        assert!((speed - expected).abs() < 1e-14, "{speed} is not {expected}");
    }
    let single = Trajectory::new(vec![3.0], vec![1.0], 1).unwrap();
    assert_eq!(single.speeds(), [0.0]);
    assert_eq!(single.column(0), [1.0]);
}

#[test]
fn times_must_rise_and_the_first_that_does_not_is_named() {
    for (times, index) in [(vec![0.0, 1.0, 1.0], 2), (vec![0.0, -1.0, 2.0], 1), (vec![0.0, 1.0, 0.5], 2)] {
        let refused = Trajectory::new(times, vec![0.0; 3], 1);
        assert!(matches!(refused, Err(Error::TimeNotIncreasing { index: i, .. }) if i == index), "{refused:?}");
    }
}

#[test]
fn chosen_columns_come_in_the_order_asked_for() {
    let turned = motion().select(&[1, 0]).unwrap();
    assert_eq!((turned.values(), turned.times_s()), (&[5.0, 0.0, 1.0, 3.0, -7.0, 7.0][..], motion().times_s()));
    assert_eq!(turned.column(1), motion().column(0));
    assert_eq!(turned.from_zero().times_s(), [0.0, 1.0, 3.0]);
}
