//! Where to look next.

use crate::{CropMap, Error, Person, Result};

/// How the region of interest follows a person.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegionOptions {
    /// Keypoints from this score on shape the region, 0 to 1.
    pub min_keypoint_score: f32,
    /// Fewer such keypoints are nobody.
    pub min_keypoints: usize,
    /// Side of the region over the larger side of the box around the keypoints. The networks are trained on crops with
    /// room around the person; with 1.0 hands at the border are lost, and with 2 a quarter of the pixels are the person.
    pub margin: f32,
    /// The region is never smaller than this, px.
    pub min_side_px: f32,
    /// Looks at the whole picture are followed by up to this many at the person.
    pub refinements: usize,
}

impl Default for RegionOptions {
    fn default() -> Self {
        Self { min_keypoint_score: 0.2, min_keypoints: 4, margin: 1.35, min_side_px: 64.0, refinements: 2 }
    }
}

impl RegionOptions {
    /// Checks every interval.
    ///
    /// # Errors
    /// [`Error::Parameter`] with the field.
    pub fn validate(&self) -> Result<()> {
        let bad = |field, expected, got: f32| Err(Error::Parameter { field, expected, got: got.to_string() });
        if !(0.0..=1.0).contains(&self.min_keypoint_score) {
            return bad("min_keypoint_score", "0 to 1", self.min_keypoint_score);
        }
        if !(1.0..=4.0).contains(&self.margin) {
            return bad("margin", "1 to 4", self.margin);
        }
        if !(self.min_side_px >= 8.0 && self.min_side_px.is_finite()) {
            return bad("min_side_px", "at least 8 px", self.min_side_px);
        }
        Ok(())
    }
}

/// The square that the next look is at.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::struct_field_names, reason = "the unit belongs to every name")]
struct Square {
    u_px: f32,
    v_px: f32,
    side_px: f32,
}

#[derive(Debug, Clone)]
pub(super) struct Tracker {
    options: RegionOptions,
    square: Option<Square>,
}

impl Tracker {
    pub(super) fn new(options: RegionOptions) -> Self {
        Self { options, square: None }
    }

    pub(super) fn forget(&mut self) {
        self.square = None;
    }

    pub(super) fn refinements(&self) -> usize {
        self.options.refinements
    }

    pub(super) fn next_crop(&self, (width, height): (usize, usize)) -> Option<CropMap> {
        self.square.map(|s| CropMap::around(s.u_px, s.v_px, s.side_px, width, height))
    }

    pub(super) fn is_somebody(&self, people: &[Person]) -> bool {
        self.choose(people).is_some()
    }

    /// Moves the region to the person that it was on. False when nobody is there; the region stays.
    pub(super) fn follow(&mut self, people: &[Person]) -> bool {
        let square = self.choose(people);
        if square.is_some() {
            self.square = square;
        }
        square.is_some()
    }

    /// Squares that cover the picture in its shorter side and in half of it, overlapping by half.
    pub(super) fn search_crops(&self, width: usize, height: usize, (tw, th): (usize, usize)) -> Vec<CropMap> {
        let (w, h) = (width as f32, height as f32);
        let mut crops = Vec::new();
        for side in [w.min(h), w.min(h) * 0.5] {
            if side < self.options.min_side_px {
                continue;
            }
            let steps = |length: f32| ((length - side) / (side * 0.5)).ceil().max(0.0) as usize;
            let place = |i: usize, n: usize, length: f32| {
                if n == 0 { length / 2.0 } else { side / 2.0 + (length - side) * i as f32 / n as f32 }
            };
            let (nx, ny) = (steps(w), steps(h));
            for iy in 0..=ny {
                for ix in 0..=nx {
                    crops.push(CropMap::around(place(ix, nx, w) - 0.5, place(iy, ny, h) - 0.5, side, tw, th));
                }
            }
        }
        crops
    }

    /// The person nearest to the region's middle; without a region, the best one.
    fn choose(&self, people: &[Person]) -> Option<Square> {
        let squares = people.iter().filter_map(|p| self.square_of(p));
        match self.square {
            None => squares.into_iter().next(),
            Some(now) => {
                let distance = |s: &Square| (s.u_px - now.u_px).hypot(s.v_px - now.v_px);
                squares.min_by(|a, b| distance(a).total_cmp(&distance(b)))
            }
        }
    }

    fn square_of(&self, person: &Person) -> Option<Square> {
        let o = &self.options;
        let seen = person.iter().filter(|(_, k)| k.score >= o.min_keypoint_score).count();
        if seen < o.min_keypoints {
            return None;
        }
        let bounds = person.bounds(o.min_keypoint_score)?;
        let (u_px, v_px) = bounds.centre_px();
        Some(Square { u_px, v_px, side_px: (bounds.side_px() * o.margin).max(o.min_side_px) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Keypoint, Skeleton};

    fn person_at(u: f32, v: f32) -> Person {
        let keypoints = (0..17).map(|i| Some(Keypoint { u_px: u + i as f32, v_px: v + 2.0 * i as f32, score: 0.9 }));
        Person { skeleton: Skeleton::Coco17, keypoints: keypoints.collect(), score: 0.9 }
    }

    #[test]
    fn the_region_stays_on_its_person_when_a_better_one_appears() {
        let mut tracker = Tracker::new(RegionOptions::default());
        assert!(tracker.follow(&[person_at(100.0, 100.0)]));
        assert!(tracker.follow(&[person_at(600.0, 100.0), person_at(104.0, 101.0)]));
        let crop = tracker.next_crop((256, 256)).map(|c| c.to_picture(127.5, 127.5));
        assert_eq!(crop, Some((112.0, 117.0)));
    }

    #[test]
    fn search_crops_reach_every_corner() {
        let tracker = Tracker::new(RegionOptions::default());
        let crops = tracker.search_crops(1080, 1920, (256, 256));
        for corner in [(0.0, 0.0), (1079.0, 0.0), (0.0, 1919.0), (1079.0, 1919.0)] {
            let inside = crops.iter().any(|c| {
                let (x, y) = c.to_tensor(corner.0, corner.1);
                (-0.5..255.5).contains(&x) && (-0.5..255.5).contains(&y)
            });
            assert!(inside, "{corner:?}");
        }
        assert!(crops.len() < 30, "{}", crops.len());
    }

    #[test]
    fn nan_and_out_of_range_options_are_refused() {
        for margin in [f32::NAN, 0.5, f32::INFINITY] {
            assert!(RegionOptions { margin, ..Default::default() }.validate().is_err());
        }
        for min_side_px in [f32::NAN, 7.0, f32::INFINITY] {
            assert!(RegionOptions { min_side_px, ..Default::default() }.validate().is_err());
        }
        for min_keypoint_score in [f32::NAN, -0.1, 1.1] {
            assert!(RegionOptions { min_keypoint_score, ..Default::default() }.validate().is_err());
        }
        assert!(RegionOptions::default().validate().is_ok());
    }

    /// A person of these keypoints, u, v and score.
    fn person_of(points: &[(f32, f32, f32)]) -> Person {
        let mut person = person_at(0.0, 0.0);
        person.keypoints = vec![None; 17];
        for (slot, (u_px, v_px, score)) in person.keypoints.iter_mut().zip(points) {
            *slot = Some(Keypoint { u_px: *u_px, v_px: *v_px, score: *score });
        }
        person
    }

    /// Picture pixels per tensor pixel of the next crop.
    fn scale(tracker: &Tracker) -> f32 {
        tracker.next_crop((100, 100)).unwrap().scale
    }

    #[test]
    fn the_region_has_room_around_the_believed_keypoints_and_a_least_side() {
        let corners = [(0.0, 0.0, 0.9), (200.0, 0.0, 0.9), (0.0, 100.0, 0.9), (200.0, 100.0, 0.9), (900.0, 900.0, 0.1)];
        let mut tracker = Tracker::new(RegionOptions::default());
        assert!(tracker.follow(&[person_of(&corners)]));
        // 200 px and a third, in 100 tensor pixels; the weak keypoint far away does not count.
        assert!((scale(&tracker) - 2.7).abs() < 1e-5, "{}", scale(&tracker));
        assert!(tracker.follow(&[person_of(&corners.map(|(u, v, s)| (u / 10.0, v / 10.0, s)))]));
        assert!((scale(&tracker) - 0.64).abs() < 1e-5, "{}", scale(&tracker));
        tracker.forget();
        assert!(tracker.next_crop((100, 100)).is_none());
    }

    #[test]
    fn few_or_weak_keypoints_are_nobody_and_the_region_stays() {
        let mut tracker = Tracker::new(RegionOptions::default());
        assert!(tracker.follow(&[person_at(100.0, 100.0)]));
        let before = tracker.next_crop((256, 256));
        let three = [(0.0, 0.0, 0.9), (50.0, 0.0, 0.9), (0.0, 90.0, 0.9)];
        let weak = [(0.0, 0.0, 0.9), (50.0, 0.0, 0.9), (0.0, 90.0, 0.9), (9.0, 9.0, 0.1), (9.0, 8.0, 0.1)];
        assert!(!tracker.follow(&[person_of(&three), person_of(&weak)]) && !tracker.is_somebody(&[person_of(&weak)]));
        assert_eq!(tracker.next_crop((256, 256)), before);
    }

    /// Judge: how large a person at any place appears in the best crop.
    #[test]
    fn a_small_person_fills_enough_of_some_search_crop() {
        let tracker = Tracker::new(RegionOptions::default());
        let crops = tracker.search_crops(1920, 1080, (256, 256));
        let best = crops.iter().map(|c| 256.0 * c.scale).fold(f32::MAX, f32::min);
        assert!((best - 540.0).abs() < 1e-3, "{best} px");
    }
    #[test]
    fn no_search_crop_is_smaller_than_the_least_side() {
        let tracker = Tracker::new(RegionOptions::default());
        // Of 100 px and half of it only the whole side is searched; of 60 px nothing.
        let sides: Vec<f32> = tracker.search_crops(150, 100, (50, 50)).iter().map(|c| c.scale).collect();
        assert_eq!(sides, [2.0, 2.0]);
        assert!(tracker.search_crops(80, 60, (50, 50)).is_empty());
    }
}
