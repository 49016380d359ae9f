//! Every sequence of good and bad deliveries up to a length, judged by rules that are written
//! down here once more, from the outside.

use super::*;

const CYCLE_MS: u64 = 5;
const LATE_CYCLES: usize = 3; // 15 ms, more than the 10 ms that are allowed

#[derive(Clone, Copy, Debug, PartialEq)]
enum Fate {
    Ok,
    Lost,
    Duplicate,
    Reordered,
    Corrupt,
    Late,
}

const FATES: [Fate; 6] = [Fate::Ok, Fate::Lost, Fate::Duplicate, Fate::Reordered, Fate::Corrupt, Fate::Late];

/// What is known from the outside: numbers of sets, counted from 0, and delivery times.
#[derive(Clone)]
struct World {
    receiver: Receiver,
    number: u64,
    /// Held back until after the next set.
    swapped: Option<u64>,
    /// Delivered `LATE_CYCLES` cycles later.
    late: [Option<u64>; LATE_CYCLES + 1],
    accepted: Option<u64>,
    /// On-time sets delivered directly after one another, without anything between.
    run: u64,
    delivered: Option<u64>,
    /// The last accepted set was accepted on a known clock.
    trusted: bool,
    /// A set has been delivered on time, so that ages can be known.
    clock_known: bool,
}

impl World {
    fn new() -> Self {
        Self {
            receiver: Receiver::new(Duration::from_millis(10), Duration::from_millis(100)),
            number: 0,
            swapped: None,
            late: [None; LATE_CYCLES + 1],
            accepted: None,
            run: 0,
            delivered: None,
            trusted: false,
            clock_known: false,
        }
    }

    fn deliver(&mut self, set: u64) {
        let copy = self.delivered == Some(set);
        self.delivered = Some(set);
        let at = Duration::from_millis(1000 + self.number * CYCLE_MS);
        let age = (self.number - set) * CYCLE_MS;
        let host_time = (60_000 + set * CYCLE_MS * 10) as u16; // wraps inside the sequences
        let judgement = self.receiver.judge(at, (250 + set) as u8, host_time);
        let accepted = matches!(judgement, Judgement::Accept { .. });
        self.clock_known |= age == 0;
        let last = self.accepted;
        if accepted {
            assert!(age <= 10 || !self.clock_known, "set {set}, {age} ms old, accepted");
            assert!(last.is_none_or(|last| set > last), "set {set} accepted after {last:?}");
            self.accepted = Some(set);
            self.trusted = self.clock_known;
        } else if let Some(last) = last {
            // On a link that was established with on-time sets, a fresh set that moves the counter by 1 to 5 has to be taken.
            let bridged = self.trusted && age == 0 && set > last && set - last <= 5;
            assert!(!bridged, "set {set} refused as {judgement:?} after {last}");
        }
        if !copy {
            self.run = if age == 0 { self.run + 1 } else { 0 };
        }
        if self.run >= 3 {
            assert_eq!(self.accepted, Some(set), "three good sets in a row establish the sequence");
        }
        if last.is_none() && accepted {
            assert!(self.number >= 2, "the first two sets never act");
        }
    }

    fn step(&mut self, fate: Fate) {
        let set = self.number;
        let before = self.swapped.take();
        match fate {
            Fate::Ok => self.deliver(set),
            Fate::Duplicate => {
                self.deliver(set);
                let accepted = self.accepted;
                self.deliver(set);
                assert_eq!(self.accepted, accepted, "the second copy changes nothing");
            }
            Fate::Lost | Fate::Corrupt => self.run = 0,
            Fate::Reordered => {
                self.swapped = Some(set);
                self.run = 0;
            }
            Fate::Late => {
                self.late[(set as usize + LATE_CYCLES) % (LATE_CYCLES + 1)] = Some(set);
                self.run = 0;
            }
        }
        if let Some(set) = before {
            self.deliver(set);
        }
        let slot = set as usize % (LATE_CYCLES + 1);
        if self.late[slot].is_some_and(|late| late != set)
            && let Some(late) = self.late[slot].take()
        {
            self.deliver(late);
        }
        self.number += 1;
    }
}

fn explore(world: &World, left: u32) -> u64 {
    if left == 0 {
        return 1;
    }
    let mut sequences = 0;
    for fate in FATES {
        let mut next = world.clone();
        next.step(fate);
        sequences += explore(&next, left - 1);
    }
    sequences
}

#[test]
fn every_sequence_to_length_10_of_an_established_link_keeps_the_rules() {
    let mut world = World::new();
    for _ in 0..3 {
        world.step(Fate::Ok);
    }
    assert_eq!(world.accepted, Some(2));
    // Both halves of the tree at once.
    let halves = std::thread::scope(|scope| {
        let halves: Vec<_> = FATES
            .chunks(3)
            .map(|fates| {
                let world = &world;
                scope.spawn(move || {
                    fates
                        .iter()
                        .map(|fate| {
                            let mut next = world.clone();
                            next.step(*fate);
                            explore(&next, 9)
                        })
                        .sum::<u64>()
                })
            })
            .collect();
        halves.into_iter().map(|h| h.join().expect("the half holds")).sum::<u64>()
    });
    assert_eq!(halves, 6_u64.pow(10));
}

#[test]
fn every_sequence_to_length_8_from_the_start_keeps_the_rules() {
    assert_eq!(explore(&World::new(), 8), 6_u64.pow(8));
}

#[test]
fn a_queue_that_empties_after_any_stall_delivers_nothing_old() {
    // Stalls up to 7 s, longer than the 6.55 s after which the host time wraps.
    for stall_ms in (11..7000).step_by(7) {
        let mut receiver = Receiver::new(Duration::from_millis(10), Duration::from_millis(100));
        let judge = |r: &mut Receiver, sent_ms: u64, at_ms: u64| {
            r.judge(Duration::from_millis(at_ms), (sent_ms / CYCLE_MS) as u8, (sent_ms * 10) as u16)
        };
        for k in 0..2000 {
            judge(&mut receiver, k * CYCLE_MS, k * CYCLE_MS);
        }
        let stalled = 2000 * CYCLE_MS;
        let freed = stalled + stall_ms;
        for k in 0..16 {
            let sent = stalled + k * CYCLE_MS;
            let old = freed.saturating_sub(sent) > 10;
            if old && sent < freed {
                let judgement = judge(&mut receiver, sent, freed);
                assert!(!matches!(judgement, Judgement::Accept { .. }), "{} ms old: {judgement:?}", freed - sent);
            }
        }
    }
}

#[test]
fn drifting_crystals_do_not_make_good_sets_stale() {
    // 100 ppm fast and slow, a minute long, arrival jitter of 2 ms.
    for ppm in [-100_i64, 100] {
        let mut receiver = Receiver::new(Duration::from_millis(10), Duration::from_millis(100));
        for k in 0_u64..12_000 {
            let at_us = k * 5000 + (k * 7919) % 2000;
            let host_us = (k as i64 * 5000 * (1_000_000 + ppm) / 1_000_000) as u64;
            let judgement = receiver.judge(Duration::from_micros(at_us), k as u8, (host_us / 100) as u16);
            assert!(k < 2 || matches!(judgement, Judgement::Accept { .. }), "{ppm} ppm, set {k}: {judgement:?}");
        }
    }
}
