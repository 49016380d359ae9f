//! Which of the people is the worker, from picture to picture.
//!
//! A network lists people in any order and remembers nobody. Here everybody gets a track: place, speed, size. Tracks and
//! people are matched together, by the smallest sum of
//!
//! ```text
//! cost = |place - predicted| / size + |ln(size / size before)|
//! ```
//!
//! so that a bystander who is followed too takes the wrong person away from the worker's track. When the second best
//! matching would give the worker another person and costs nearly the same, the answer is [`WorkerUpdate::Ambiguous`]:
//! nobody is reported and the tracks coast, until the picture tells them apart again. What is kept is place, speed and
//! size; appearance is not looked at.

use std::time::Duration;

use crate::{Error, Part, Person, Result};

mod matching;

use matching::best_two;

/// How the worker is chosen at first, and when nobody has been followed for long enough.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum WorkerChoice {
    /// The largest person.
    Largest,
    /// The person nearest to a point of the picture, px.
    Nearest {
        /// Column.
        u_px: f32,
        /// Row.
        v_px: f32,
    },
}

/// Parameters of [`WorkerTracker`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorkerOptions {
    /// How the worker is chosen.
    pub choice: WorkerChoice,
    /// Keypoints below this score do not count, 0 to 1.
    pub min_score: f32,
    /// Largest cost at which a person still is the one of a track.
    pub max_cost: f64,
    /// Smallest difference to the second best matching, in the same unit.
    pub min_margin: f64,
    /// A track without a person ends after this time.
    pub coast: Duration,
}

impl Default for WorkerOptions {
    fn default() -> Self {
        Self {
            choice: WorkerChoice::Largest,
            min_score: 0.2,
            max_cost: 1.0,
            min_margin: 0.15,
            coast: Duration::from_millis(1500),
        }
    }
}

/// Who the worker is in a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WorkerUpdate {
    /// This one of the people.
    Found(usize),
    /// Two people could be; better nobody than the wrong one.
    Ambiguous,
    /// None of them.
    Absent,
}

impl WorkerUpdate {
    /// The worker among the people that the update was made from.
    pub fn person(self, people: &[Person]) -> Option<&Person> {
        match self {
            Self::Found(i) => people.get(i),
            Self::Ambiguous | Self::Absent => None,
        }
    }
}

/// What is compared: the middle of the trunk, and a length that does not change when arms move.
#[derive(Debug, Clone, Copy)]
struct Shape {
    u: f64,
    v: f64,
    size: f64,
}

#[derive(Debug, Clone, Copy)]
struct Track {
    id: u64,
    shape: Shape,
    speed: (f64, f64),
    seen: Duration,
}

/// Follows one person through the pictures of a camera.
///
/// ```
/// use std::time::Duration;
/// use pose::{Keypoint, Person, Skeleton, WorkerOptions, WorkerTracker, WorkerUpdate};
/// let at = |u: f32, size: f32| Person {
///     skeleton: Skeleton::UpperLimb8,
///     keypoints: (0..8).map(|i| Some(Keypoint { u_px: u + i as f32 * size, v_px: 50.0, score: 0.9 })).collect(),
///     score: 0.9,
/// };
/// let mut worker = WorkerTracker::new(WorkerOptions::default()).unwrap();
/// assert_eq!(worker.update(Duration::ZERO, &[at(0.0, 10.0), at(300.0, 20.0)]), WorkerUpdate::Found(1));
/// // In another order, the same person.
/// assert_eq!(worker.update(Duration::from_millis(33), &[at(301.0, 20.0), at(0.0, 10.0)]), WorkerUpdate::Found(0));
/// ```
#[derive(Debug, Clone)]
pub struct WorkerTracker {
    options: WorkerOptions,
    tracks: Vec<Track>,
    worker: Option<u64>,
    next_id: u64,
    now: Option<Duration>,
}

/// Speed follows the newest step by this share: 0.3 averages over about three pictures.
const SPEED_GAIN: f64 = 0.3;
/// Size is nearly constant; a tenth of a new value suppresses a network's jitter.
const SIZE_GAIN: f64 = 0.1;
/// More tracks than this are not kept, and of more people those are looked at who are likeliest to be the worker; the
/// matching is exact and grows fast.
const MAX_TRACKS: usize = 6;

impl WorkerTracker {
    /// Knows nobody yet.
    ///
    /// # Errors
    /// [`Error::Parameter`] with the field.
    pub fn new(options: WorkerOptions) -> Result<Self> {
        let bad = |field, expected, got: f64| Err(Error::Parameter { field, expected, got: got.to_string() });
        if !(0.0..=1.0).contains(&options.min_score) {
            return bad("min_score", "0 to 1", options.min_score.into());
        }
        if !(options.max_cost > 0.0 && options.max_cost.is_finite()) {
            return bad("max_cost", "above 0", options.max_cost);
        }
        if !(options.min_margin >= 0.0 && options.min_margin.is_finite()) {
            return bad("min_margin", "0 or more", options.min_margin);
        }
        Ok(Self { options, tracks: Vec::new(), worker: None, next_id: 0, now: None })
    }

    /// Takes the people of the picture of time `now` (any origin, never backwards; a picture of an earlier time counts as
    /// of the same time).
    pub fn update(&mut self, now: Duration, people: &[Person]) -> WorkerUpdate {
        let now = self.now.map_or(now, |before| now.max(before));
        self.now = Some(now);
        let coast = self.options.coast;
        self.tracks.retain(|t| now.saturating_sub(t.seen) <= coast);
        if self.worker.is_some_and(|id| !self.tracks.iter().any(|t| t.id == id)) {
            self.worker = None;
        }
        let mut shapes: Vec<(usize, Shape)> =
            people.iter().enumerate().filter_map(|(i, p)| Some((i, shape(p, self.options.min_score)?))).collect();
        if shapes.len() > MAX_TRACKS {
            shapes.sort_by(|a, b| self.remoteness(&a.1, now).total_cmp(&self.remoteness(&b.1, now)));
            shapes.truncate(MAX_TRACKS);
        }

        let costs: Vec<Vec<f64>> =
            self.tracks.iter().map(|t| shapes.iter().map(|(_, s)| cost(t, s, now)).collect()).collect();
        let (best, second) = best_two(&costs, self.options.max_cost, self.worker_index());
        let ambiguous = second.is_some_and(|margin| margin < self.options.min_margin);
        let mut answer = if ambiguous { WorkerUpdate::Ambiguous } else { WorkerUpdate::Absent };
        let worker = self.worker_index();
        let mut taken = vec![false; shapes.len()];
        for (t, choice) in best.iter().enumerate() {
            let Some(s) = *choice else { continue };
            taken[s] = true;
            if ambiguous {
                continue;
            }
            self.tracks[t].follow(shapes[s].1, now);
            if worker == Some(t) {
                answer = WorkerUpdate::Found(shapes[s].0);
            }
        }
        if !ambiguous {
            for ((_, shape), _) in shapes.iter().zip(&taken).filter(|(_, taken)| !**taken) {
                if self.tracks.len() < MAX_TRACKS {
                    self.tracks.push(Track { id: self.next_id, shape: *shape, speed: (0.0, 0.0), seen: now });
                    self.next_id += 1;
                }
            }
        }
        if self.worker.is_none() {
            self.worker = self.first_choice(now);
            if let Some(track) = self.worker_index().map(|t| self.tracks[t]) {
                let found = shapes.iter().find(|(_, s)| (s.u, s.v) == (track.shape.u, track.shape.v));
                answer = found.map_or(answer, |(i, _)| WorkerUpdate::Found(*i));
            }
        }
        answer
    }

    /// Forgets everybody.
    pub fn reset(&mut self) {
        self.tracks.clear();
        self.worker = None;
        self.now = None;
    }

    fn worker_index(&self) -> Option<usize> {
        self.tracks.iter().position(|t| Some(t.id) == self.worker)
    }

    fn first_choice(&self, now: Duration) -> Option<u64> {
        let here = self.tracks.iter().filter(|t| t.seen == now);
        let remoteness = |t: &Track| self.options.choice.remoteness(&t.shape);
        here.min_by(|a, b| remoteness(a).total_cmp(&remoteness(b))).map(|t| t.id)
    }

    /// How far a person is from being the worker; without a worker, from being chosen.
    fn remoteness(&self, shape: &Shape, now: Duration) -> f64 {
        match self.worker_index() {
            Some(worker) => cost(&self.tracks[worker], shape, now),
            None => self.options.choice.remoteness(shape),
        }
    }
}

impl WorkerChoice {
    /// The smallest is chosen.
    fn remoteness(self, shape: &Shape) -> f64 {
        match self {
            Self::Largest => -shape.size,
            Self::Nearest { u_px, v_px } => (shape.u - f64::from(u_px)).hypot(shape.v - f64::from(v_px)),
        }
    }
}

impl Track {
    fn follow(&mut self, shape: Shape, now: Duration) {
        let dt = now.saturating_sub(self.seen).as_secs_f64();
        if dt > 0.0 {
            let step = ((shape.u - self.shape.u) / dt, (shape.v - self.shape.v) / dt);
            self.speed.0 += SPEED_GAIN * (step.0 - self.speed.0);
            self.speed.1 += SPEED_GAIN * (step.1 - self.speed.1);
        }
        let size = self.shape.size + SIZE_GAIN * (shape.size - self.shape.size);
        self.shape = Shape { size, ..shape };
        self.seen = now;
    }
}

fn cost(track: &Track, shape: &Shape, now: Duration) -> f64 {
    let dt = now.saturating_sub(track.seen).as_secs_f64();
    let (u, v) = (track.shape.u + track.speed.0 * dt, track.shape.v + track.speed.1 * dt);
    (shape.u - u).hypot(shape.v - v) / track.shape.size + (shape.size / track.shape.size).ln().abs()
}

/// Middle of shoulders, hips, neck and nose; size from shoulder width, trunk and head, or else the whole extent.
fn shape(person: &Person, min_score: f32) -> Option<Shape> {
    let get = |part| person.get(part).filter(|k| k.score >= min_score).map(|k| (f64::from(k.u_px), f64::from(k.v_px)));
    let trunk = [Part::LeftShoulder, Part::RightShoulder, Part::LeftHip, Part::RightHip];
    let points: Vec<_> = trunk.iter().filter_map(|p| get(*p)).collect();
    let points =
        if points.is_empty() { [Part::Neck, Part::Nose].iter().filter_map(|p| get(*p)).collect() } else { points };
    let n = points.len() as f64;
    if points.is_empty() {
        return None;
    }
    let (u, v) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let distance = |a, b| get(a).zip(get(b)).map(|(a, b)| (a.0 - b.0).hypot(a.1 - b.1));
    let lengths = [
        distance(Part::LeftShoulder, Part::RightShoulder),
        distance(Part::LeftShoulder, Part::LeftHip),
        distance(Part::RightShoulder, Part::RightHip),
    ];
    let extent = person.bounds(min_score).map(|b| f64::from(b.side_px()));
    let size = lengths.into_iter().flatten().reduce(f64::max).or(extent)?;
    (size >= 1.0).then_some(Shape { u, v, size })
}

#[cfg(test)]
mod tests;
