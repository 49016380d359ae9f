use super::*;
use crate::{Keypoint, Skeleton};

/// A person of shoulder width `size` with the middle at `u`, `v`.
fn person(u: f64, v: f64, size: f64) -> Person {
    let mut keypoints = vec![None; 17];
    let mut put = |part, du: f64, dv: f64| {
        let i = Skeleton::Coco17.index_of(part).unwrap();
        let (u_px, v_px) = ((u + du * size) as f32, (v + dv * size) as f32);
        keypoints[i] = Some(Keypoint { u_px, v_px, score: 0.9 });
    };
    put(Part::LeftShoulder, 0.5, -0.6);
    put(Part::RightShoulder, -0.5, -0.6);
    put(Part::LeftHip, 0.35, 0.6);
    put(Part::RightHip, -0.35, 0.6);
    Person { skeleton: Skeleton::Coco17, keypoints, score: 0.9 }
}

struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn gauss(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

const fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

/// Two people walk through each other. While they overlap the rear one is hidden from the network. The worker may be
/// reported as ambiguous or absent there; never as the other one, and must be back afterwards.
#[test]
fn crossing_people_never_exchange_the_worker() {
    let (mut found, mut late) = (0, 0);
    for seed in 0..500 {
        let mut noise = Noise(seed * 7919 + 1);
        let mut tracker = WorkerTracker::new(WorkerOptions {
            choice: WorkerChoice::Nearest { u_px: 100.0, v_px: 200.0 },
            ..Default::default()
        })
        .unwrap();
        let size = (70.0 + 20.0 * noise.uniform(), 70.0 + 20.0 * noise.uniform());
        let speed = (120.0 + 200.0 * noise.uniform(), 120.0 + 200.0 * noise.uniform());
        let worker_in_front = noise.uniform() < 0.5;
        let frames = 150;
        let (mut wrong, mut last_found) = (0, 0);
        for i in 0..frames {
            let t = i as f64 / 30.0;
            let (a, b) = (100.0 + speed.0 * t, 100.0 + 600.0 - speed.1 * t);
            let mut jitter = |x: f64, size: f64| x + 0.03 * size * noise.gauss();
            let worker = person(jitter(a, size.0), jitter(200.0, size.0), size.0);
            let other = person(jitter(b, size.1), jitter(210.0, size.1), size.1);
            let hidden = (a - b).abs() < 0.5 * size.0;
            let mut people = Vec::new();
            if !hidden || !worker_in_front {
                people.push((false, other));
            }
            if !hidden || worker_in_front {
                people.push((true, worker));
            }
            if noise.uniform() < 0.5 {
                people.reverse();
            }
            let only: Vec<Person> = people.iter().map(|p| p.1.clone()).collect();
            if let WorkerUpdate::Found(k) = tracker.update(ms(i * 1000 / 30), &only) {
                wrong += usize::from(!people[k].0);
                last_found = i;
                found += 1;
            }
        }
        assert_eq!(wrong, 0, "seed {seed}");
        late += usize::from(last_found + 5 < frames);
    }
    assert!(found > 500 * 120, "{found} of {}", 500 * 150);
    assert_eq!(late, 0);
}

#[test]
fn the_order_of_the_list_does_not_matter() {
    let mut tracker = WorkerTracker::new(WorkerOptions::default()).unwrap();
    let (big, small) = (person(100.0, 100.0, 60.0), person(400.0, 100.0, 40.0));
    assert_eq!(tracker.update(ms(0), &[small.clone(), big.clone()]), WorkerUpdate::Found(1));
    assert_eq!(tracker.update(ms(33), &[big.clone(), small.clone()]), WorkerUpdate::Found(0));
    assert_eq!(tracker.update(ms(66), &[small]), WorkerUpdate::Absent);
    assert_eq!(tracker.update(ms(99), &[big]), WorkerUpdate::Found(0));
}

#[test]
fn two_equal_candidates_hold_and_nobody_is_no_error() {
    let mut tracker = WorkerTracker::new(WorkerOptions::default()).unwrap();
    assert_eq!(tracker.update(ms(0), &[]), WorkerUpdate::Absent);
    assert_eq!(tracker.update(ms(33), &[person(100.0, 100.0, 60.0)]), WorkerUpdate::Found(0));
    let twins = [person(120.0, 100.0, 60.0), person(80.0, 100.0, 60.0)];
    assert_eq!(tracker.update(ms(66), &twins), WorkerUpdate::Ambiguous);
    assert_eq!(tracker.update(ms(99), &[person(101.0, 100.0, 60.0)]), WorkerUpdate::Found(0));
}

#[test]
fn a_worker_who_left_is_replaced_only_after_the_coasting_time() {
    let mut tracker = WorkerTracker::new(WorkerOptions::default()).unwrap();
    tracker.update(ms(0), &[person(100.0, 100.0, 60.0)]);
    let stranger = [person(500.0, 100.0, 60.0)];
    assert_eq!(tracker.update(ms(500), &stranger), WorkerUpdate::Absent);
    assert_eq!(tracker.update(ms(1500), &stranger), WorkerUpdate::Absent);
    assert_eq!(tracker.update(ms(1600), &stranger), WorkerUpdate::Found(0));
    // After a reset the next person is the worker, wherever it is.
    tracker.reset();
    assert_eq!(tracker.update(ms(0), &[person(900.0, 100.0, 60.0)]), WorkerUpdate::Found(0));
}

/// A seated worker behind a bench may show no more than head and arms.
#[test]
fn a_person_without_a_trunk_is_followed_by_neck_nose_and_extent() {
    let only = |points: &[(Part, f32, f32)]| {
        let mut person = Person { skeleton: Skeleton::OpenPose18, keypoints: vec![None; 18], score: 0.9 };
        for (part, u_px, v_px) in points {
            let i = Skeleton::OpenPose18.index_of(*part).unwrap();
            person.keypoints[i] = Some(Keypoint { u_px: *u_px, v_px: *v_px, score: 0.9 });
        }
        person
    };
    let seated = only(&[(Part::Nose, 100.0, 40.0), (Part::Neck, 100.0, 60.0), (Part::RightWrist, 70.0, 120.0)]);
    let choice = WorkerChoice::Nearest { u_px: 300.0, v_px: 40.0 };
    let mut tracker = WorkerTracker::new(WorkerOptions { choice, ..Default::default() }).unwrap();
    // A wrist alone has no middle of a trunk, a head in one point no size.
    let wrist = only(&[(Part::RightWrist, 10.0, 10.0), (Part::RightElbow, 50.0, 10.0)]);
    let dot = only(&[(Part::Nose, 300.0, 40.0), (Part::Neck, 300.0, 40.4)]);
    assert_eq!(tracker.update(ms(0), &[wrist, dot, seated.clone()]), WorkerUpdate::Found(2));
    assert_eq!(tracker.update(ms(33), &[seated]), WorkerUpdate::Found(0));
}

/// 20 px to either side of where the worker stood: only the size tells them apart, and one picture does not change the size.
#[test]
fn the_worker_is_the_one_of_the_same_size() {
    let mut tracker = WorkerTracker::new(WorkerOptions::default()).unwrap();
    tracker.update(ms(0), &[person(100.0, 100.0, 60.0)]);
    // Seen once with arms that look like hips: 1.8 times as large.
    assert_eq!(tracker.update(ms(33), &[person(100.0, 100.0, 108.0)]), WorkerUpdate::Found(0));
    let two = [person(120.0, 100.0, 108.0), person(80.0, 100.0, 60.0)];
    assert_eq!(tracker.update(ms(66), &two), WorkerUpdate::Found(1));
}

/// The trunk of `person` is 1.2093 shoulder widths long, 72.6 px, and the largest cost is that of one such length.
#[test]
fn a_person_too_far_away_is_a_stranger_and_one_hardly_near_enough_leaves_it_open() {
    for (cost, expected) in
        [(0.7, WorkerUpdate::Found(0)), (0.95, WorkerUpdate::Ambiguous), (1.1, WorkerUpdate::Absent)]
    {
        let mut tracker = WorkerTracker::new(WorkerOptions::default()).unwrap();
        tracker.update(ms(0), &[person(100.0, 100.0, 60.0)]);
        assert_eq!(tracker.update(ms(33), &[person(100.0 + 72.56 * cost, 100.0, 60.0)]), expected, "{cost}");
    }
}

#[test]
fn a_person_of_weak_keypoints_is_nobody() {
    let mut tracker = WorkerTracker::new(WorkerOptions::default()).unwrap();
    let mut weak = person(100.0, 100.0, 60.0);
    weak.keypoints.iter_mut().flatten().for_each(|k| k.score = 0.1);
    assert_eq!(tracker.update(ms(0), &[weak]), WorkerUpdate::Absent);
}

#[test]
fn a_picture_of_an_earlier_time_does_not_age_the_worker() {
    let mut tracker = WorkerTracker::new(WorkerOptions::default()).unwrap();
    let (worker, stranger) = ([person(100.0, 100.0, 60.0)], [person(500.0, 100.0, 60.0)]);
    tracker.update(ms(1000), &worker);
    // Twice the same time: no speed.
    tracker.update(ms(1000), &worker);
    assert_eq!(tracker.update(ms(1033), &worker), WorkerUpdate::Found(0));
    assert_eq!(tracker.update(ms(0), &worker), WorkerUpdate::Found(0));
    assert_eq!(tracker.update(ms(1600), &stranger), WorkerUpdate::Absent);
}

/// Nobody is followed from an ambiguous picture, or the same two people would be told apart in the next one.
#[test]
fn what_is_ambiguous_stays_ambiguous() {
    let mut tracker = WorkerTracker::new(WorkerOptions::default()).unwrap();
    tracker.update(ms(0), &[person(100.0, 100.0, 60.0)]);
    let twins = [person(120.0, 100.0, 60.0), person(80.0, 100.0, 60.0)];
    for i in 1..4 {
        assert_eq!(tracker.update(ms(33 * i), &twins), WorkerUpdate::Ambiguous);
    }
}

#[test]
fn options_outside_their_interval_are_refused() {
    let o = WorkerOptions::default();
    assert!(WorkerTracker::new(WorkerOptions { max_cost: f64::NAN, ..o }).is_err());
    assert!(WorkerTracker::new(WorkerOptions { min_margin: -1.0, ..o }).is_err());
    assert!(WorkerTracker::new(WorkerOptions { min_score: 2.0, ..o }).is_err());
}

/// Forty people on one spot have 40^6 matchings with six tracks; only those of six people are tried.
#[test]
fn a_dense_crowd_is_answered_as_six_people_are() {
    let mut tracker = WorkerTracker::new(WorkerOptions::default()).unwrap();
    let mut crowd: Vec<Person> = (1..40).map(|i| person(130.0 + f64::from(i), 100.0, 60.0)).collect();
    crowd.push(person(100.0, 100.0, 70.0));
    assert_eq!(tracker.update(ms(0), &crowd), WorkerUpdate::Found(39));
    assert_eq!(tracker.update(ms(33), &crowd), WorkerUpdate::Found(39));
}

#[test]
fn in_a_crowd_too_the_order_of_the_list_does_not_matter() {
    let bystanders: Vec<Person> = (0..9).map(|i| person(200.0 * f64::from(i), 100.0, 60.0)).collect();
    let worker = person(900.0, 300.0, 50.0);
    let choice = WorkerChoice::Nearest { u_px: 900.0, v_px: 310.0 };
    let mut tracker = WorkerTracker::new(WorkerOptions { choice, ..Default::default() }).unwrap();
    for (picture, place) in [9, 0, 9, 4].into_iter().enumerate() {
        let mut people = bystanders.clone();
        people.insert(place, worker.clone());
        assert_eq!(tracker.update(ms(33 * picture as u64), &people), WorkerUpdate::Found(place));
    }
    // Nor do nine larger people, once the worker is known.
    let mut tracker = WorkerTracker::new(WorkerOptions::default()).unwrap();
    assert_eq!(tracker.update(ms(0), std::slice::from_ref(&worker)), WorkerUpdate::Found(0));
    let people: Vec<Person> = bystanders.into_iter().chain([worker]).collect();
    assert_eq!(tracker.update(ms(33), &people), WorkerUpdate::Found(9));
}
