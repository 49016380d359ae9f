//! Paths through shoulder, elbow and wrist singularities: are the joints ever too fast, and does the arm ever change to another
//! branch?
//!
//! A path is straight in joint space from a random pose to a singular one, in twelve steps of 20 ms, and straight on to
//! another random pose in twelve more. Its ends are up to 0.05 to 0.8 rad per joint away, so that some paths ask for more than the
//! joint speeds allow. The follower sees the poses of the tool alone. Half of the paths are followed with the usual ladder,
//! which stops before the singularity; the other half without one, through it.
//!
//! Which branch the arm is on is told by the signs of three functions, one per singularity, computed here from the joint values.
//! A jump is a step that changes a sign and both of whose ends are outside the zone where the ladder stops: a real passage
//! would need steps inside.

use std::time::Instant;

use kin::{Chain, FollowOptions, Robot, SingularityLadder};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

use crate::{Spread, single, within};

const STEPS: usize = 24;
const DT_S: f64 = 0.02;

pub(crate) fn rows(full: bool) -> Vec<Value> {
    let chain = Robot::builtin().chain("base_link", "tool0").unwrap();
    let count = if full { 1_000_000 } else { 10_000 };
    let mut random = ChaCha8Rng::seed_from_u64(17);
    let (mut fastest, mut outside, mut singular, mut jumps, mut passages) = (0.0f64, 0, 0, 0, 0);
    let usual = FollowOptions::default();
    let without = usual.ladder(SingularityLadder { slow: 1e300, stop: 2e300 });
    let mut times = Vec::new();
    for path in 0..count {
        let middle = singular_pose(&chain, path % 3, &mut random);
        let reach = random.random_range(0.05..0.8);
        let mut near = || -> Vec<f64> {
            let mut q = middle.clone();
            for value in &mut q {
                *value += random.random_range(-reach..reach);
            }
            chain.clamp(&mut q);
            q
        };
        let (from, to) = (near(), near());
        let options = if path / 3 % 2 == 0 { &usual } else { &without };
        let mut q = from.clone();
        let (mut side, mut clear) = (sides(&q), chain.dexterity(&q).condition < usual.ladder.stop);
        for step in 1..=STEPS {
            let part = 2.0 * step as f64 / STEPS as f64;
            // Straight to the singular pose, and on to the other side.
            let (a, b, t) = if part <= 1.0 { (&from, &middle, part) } else { (&middle, &to, part - 1.0) };
            let wanted: Vec<f64> = a.iter().zip(b).map(|(a, b)| a + t * (b - a)).collect();
            let target = chain.fk(&wanted);
            let before = q.clone();
            let start = Instant::now();
            let report = chain.follow_pose(&target, DT_S, options, &mut q).unwrap();
            if step == STEPS / 2 {
                times.push(start.elapsed().as_secs_f64() * 1e6);
            }
            singular += usize::from(report.singularity_scale < 1.0);
            for ((now, before), limits) in q.iter().zip(&before).zip(chain.limits()) {
                fastest = fastest.max((now - before).abs() / (limits.velocity * DT_S));
                outside += usize::from(*now < limits.lower || *now > limits.upper);
            }
            let (side_now, clear_now) = (sides(&q), report.condition < usual.ladder.stop);
            passages += usize::from(side != side_now);
            jumps += usize::from(side != side_now && clear && clear_now);
            (side, clear) = (side_now, clear_now);
        }
    }
    let steps = count * STEPS;
    vec![
        single("singular_paths_fastest_joint", "of its limit", fastest, None, count, "target: at most 1"),
        single("singular_paths_outside_limits", "joint values", outside as f64, None, steps, "target: 0"),
        single("singular_paths_branch_jumps", "steps", jumps as f64, None, steps, "target: 0"),
        single("singular_paths_passages", "steps", passages as f64, None, steps, "the arm went through a singularity"),
        single("singular_paths_slowed_steps", "steps", singular as f64, None, steps, "the ladder acted"),
        Spread::of(times).row("follow_pose_6dof", "us", None, "one step in the singularity"),
    ]
}

/// A random pose of the built-in arm in an elbow, wrist or shoulder singularity.
fn singular_pose(chain: &Chain, kind: usize, random: &mut ChaCha8Rng) -> Vec<f64> {
    let mut q = within(chain, random);
    match kind {
        0 => q[2] = 0.0,
        1 => q[4] = std::f64::consts::FRAC_PI_2 * if random.random() { 1.0 } else { -1.0 },
        _ => {
            // Wrist above joint 1: the in-plane distance of the crossing of axes 5 and 6 vanishes.
            let (mut low, mut high) = (chain.limits()[1].lower, chain.limits()[1].upper);
            q[1] = low;
            let sign = ahead(&q).signum();
            for _ in 0..60 {
                q[1] = f64::midpoint(low, high);
                if ahead(&q) * sign > 0.0 { low = q[1] } else { high = q[1] }
            }
        }
    }
    q
}

/// Distance of the wrist of the built-in arm from the axis of joint 1, ahead of it (m).
fn ahead(q: &[f64]) -> f64 {
    0.450 * q[1].cos() + 0.400 * (q[1] + q[2]).cos() - 0.090 * (q[1] + q[2] + q[3]).sin()
}

/// On which side of its shoulder, elbow and wrist singularities the built-in arm is.
fn sides(q: &[f64]) -> [bool; 3] {
    [ahead(q) > 0.0, q[2].sin() > 0.0, q[4].cos() > 0.0]
}
