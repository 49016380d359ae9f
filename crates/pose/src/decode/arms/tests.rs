use proptest::prelude::*;

use super::*;

/// Neck 0, shoulder 1, elbow 2, wrist 3, and an ear 4 that is no part of the arm.
const ARM: Arm = Arm { parts: [0, 1, 2, 3], limbs: [0, 1, 2] };
const EAR: usize = 3;

fn link(from: usize, to: usize, rank: f32) -> Connection {
    Connection { from, to, score: 0.5 * rank, rank }
}

fn peaks(counts: [usize; 5]) -> Vec<Vec<Peak>> {
    counts.map(|n| vec![Peak { x: 0.0, y: 0.0, score: 0.5 }; n]).to_vec()
}

fn body(parts: [Option<usize>; 5], limbs: &[(usize, Connection)]) -> Body {
    Body { parts: parts.to_vec(), limbs: limbs.to_vec() }
}

/// The largest sum of ranks over all paths from neck 0, tried one by one.
fn by_force(links: &[Vec<Connection>], depth: usize, at: usize) -> f32 {
    let Some(layer) = links.get(depth) else { return 0.0 };
    let ways = layer.iter().filter(|c| c.from == at).map(|c| c.rank + by_force(links, depth + 1, c.to));
    ways.fold(0.0, f32::max)
}

proptest! {
    /// Judge: every path.
    #[test]
    fn the_arm_is_the_best_of_all_paths(
        ranks in proptest::collection::vec(proptest::option::weighted(0.6, 0.01..2.0_f32), 4 + 16 + 16),
    ) {
        let layer = |first: usize, from: usize| -> Vec<Connection> {
            let all = (0..from).flat_map(|a| (0..4).map(move |b| (a, b)));
            all.zip(&ranks[first..]).filter_map(|((a, b), rank)| Some(link(a, b, (*rank)?))).collect()
        };
        let links = [layer(0, 1), layer(4, 4), layer(20, 4)];
        let mut chosen = body([Some(0), None, None, None, None], &[]);
        ARM.choose(&mut chosen, &links, &peaks([1, 4, 4, 4, 0]), |_, _| true);
        let sum: f32 = chosen.limbs.iter().map(|(_, c)| c.rank).sum();
        prop_assert!((sum - by_force(&links, 0, 0)).abs() < 1e-5);
        prop_assert!((chosen.limb_sum() - 0.5 * sum).abs() < 1e-5);
        for (limb, c) in &chosen.limbs {
            prop_assert_eq!(chosen.parts[*limb], Some(c.from));
            prop_assert_eq!(chosen.parts[*limb + 1], Some(c.to));
        }
    }
}

/// Limb by limb the nearer elbow wins, from which no forearm goes on.
#[test]
fn an_elbow_with_a_forearm_beats_a_better_one_without() {
    let links = [vec![link(0, 0, 1.0)], vec![link(0, 0, 1.0), link(0, 1, 0.8)], vec![link(1, 0, 0.9)]];
    let greedy = [(0, links[0][0]), (1, links[1][0])];
    let mut chosen = body([Some(0), Some(0), Some(0), None, None], &greedy);
    ARM.choose(&mut chosen, &links, &peaks([1, 1, 2, 1, 0]), |_, _| true);
    assert_eq!(chosen.parts, [Some(0), Some(0), Some(1), Some(0), None]);
    assert_eq!(chosen.limbs.len(), 3);
    assert!((chosen.limb_sum() - 1.35).abs() < 1e-6);
}

#[test]
fn what_another_person_has_is_not_taken() {
    let links = [vec![link(0, 0, 1.0)], vec![link(0, 0, 1.0)], vec![link(0, 0, 0.9), link(0, 1, 0.4)]];
    let mut chosen = body([Some(0), None, None, None, None], &[]);
    ARM.choose(&mut chosen, &links, &peaks([1, 1, 1, 2, 0]), |part, candidate| (part, candidate) != (3, 0));
    assert_eq!(chosen.parts, [Some(0), Some(0), Some(0), Some(1), None]);
}

/// A shoulder known from the ear carries its arm where no field joins it to the neck, and that limb stays.
#[test]
fn a_shoulder_that_the_body_has_begins_an_arm() {
    let links = [vec![], vec![link(1, 0, 0.7)], vec![]];
    let ear = (EAR, link(1, 0, 0.6));
    let mut chosen = body([Some(0), Some(1), None, None, Some(0)], &[ear]);
    ARM.choose(&mut chosen, &links, &peaks([1, 2, 1, 0, 1]), |_, _| true);
    assert_eq!(chosen.parts, [Some(0), Some(1), Some(0), None, Some(0)]);
    assert_eq!(chosen.limbs, [ear, (1, links[1][0])]);
    // A shoulder that it has not does not.
    let mut chosen = body([Some(0), None, None, None, None], &[]);
    ARM.choose(&mut chosen, &links, &peaks([1, 2, 1, 0, 1]), |_, _| true);
    assert_eq!(chosen.parts, [Some(0), None, None, None, None]);
}

#[test]
fn a_wrist_does_not_stay_with_an_elbow_that_was_given_up() {
    let links = [vec![link(0, 0, 0.2)], vec![link(0, 0, 0.2), link(0, 1, 1.5)], vec![link(0, 0, 0.1)]];
    let greedy = [(0, links[0][0]), (1, links[1][0]), (2, links[2][0])];
    let mut chosen = body([Some(0), Some(0), Some(0), Some(0), None], &greedy);
    ARM.choose(&mut chosen, &links, &peaks([1, 1, 2, 1, 0]), |_, _| true);
    assert_eq!(chosen.parts, [Some(0), Some(0), Some(1), None, None]);
    assert_eq!(chosen.limbs, [(0, links[0][0]), (1, links[1][1])]);
}

#[test]
fn without_a_supported_limb_the_body_stays_as_it_is() {
    let before = body([Some(0), Some(0), None, None, Some(0)], &[(EAR, link(0, 0, 0.6))]);
    let mut chosen = before.clone();
    ARM.choose(&mut chosen, &[vec![], vec![], vec![]], &peaks([1, 1, 1, 1, 1]), |_, _| true);
    assert_eq!(chosen, before);
}

#[test]
fn arms_are_those_whose_limbs_the_card_has() {
    let right = [[1, 2], [2, 3], [3, 4]];
    let arms = Arm::of(Skeleton::OpenPose18, &right);
    assert_eq!(arms, [Arm { parts: [1, 2, 3, 4], limbs: [0, 1, 2] }]);
    assert_eq!(Arm::of(Skeleton::OpenPose18, &right[..2]), []);
    let both = [[1, 5], [1, 2], [2, 3], [3, 4], [5, 6], [6, 7]];
    assert_eq!(Arm::of(Skeleton::OpenPose18, &both)[1], Arm { parts: [1, 5, 6, 7], limbs: [0, 4, 5] });
}
