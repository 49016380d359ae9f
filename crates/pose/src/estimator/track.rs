//! One picture of a network that follows a person: where it looks, and how often.

use super::region::Tracker;
use crate::{CropMap, Person, Result};

/// Width and height of a picture and of the tensor that shows a crop of it, px.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sizes {
    pub(super) picture: (usize, usize),
    pub(super) tensor: (usize, usize),
}

/// One run of the network on one crop.
pub(super) type Look<'a> = dyn FnMut(CropMap) -> Result<Vec<Person>> + 'a;

impl Tracker {
    /// The people of the next picture: where the person was, or else where a search finds somebody, and then again around
    /// that.
    pub(super) fn track(&mut self, sizes: Sizes, look: &mut Look<'_>) -> Result<Vec<Person>> {
        if let Some(crop) = self.next_crop(sizes.tensor) {
            let people = look(crop)?;
            if self.follow(&people) {
                return Ok(people);
            }
        }
        let mut people = self.search(sizes, look)?;
        // Each further look is at a crop that fits the person better.
        for _ in 0..self.refinements() {
            if !self.follow(&people) {
                break;
            }
            let Some(crop) = self.next_crop(sizes.tensor) else { break };
            let again = look(crop)?;
            if self.rank(&again) < self.rank(&people) {
                break;
            }
            people = again;
        }
        if !self.follow(&people) {
            self.forget();
        }
        Ok(people)
    }

    /// The whole picture, or the best of its parts when that shows nobody.
    fn search(&self, Sizes { picture: (width, height), tensor }: Sizes, look: &mut Look<'_>) -> Result<Vec<Person>> {
        let mut best = look(CropMap::letterbox(width, height, tensor.0, tensor.1))?;
        if self.is_somebody(&best) {
            return Ok(best);
        }
        for crop in self.search_crops(width, height, tensor) {
            let people = look(crop)?;
            if self.rank(&people) > self.rank(&best) {
                best = people;
            }
        }
        Ok(best)
    }

    /// Somebody is better than a few strong keypoints that are nobody; then the score counts.
    fn rank(&self, people: &[Person]) -> (bool, f32) {
        (self.is_somebody(people), people.first().map_or(0.0, |p| p.score))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Error, Keypoint, Skeleton, estimator::RegionOptions};

    const SIZES: Sizes = Sizes { picture: (640, 480), tensor: (100, 100) };
    /// Side of everybody, px.
    const SIDE_PX: f32 = 80.0;

    fn person(u_px: f32, v_px: f32, keypoints: usize, score: f32) -> Person {
        let at = |i: usize| (u_px + SIDE_PX * (i % 2) as f32, v_px + SIDE_PX * (i / 2 % 2) as f32);
        let seen = (0..17).map(|i| (i < keypoints).then(|| Keypoint { u_px: at(i).0, v_px: at(i).1, score: 0.9 }));
        Person { skeleton: Skeleton::Coco17, keypoints: seen.collect(), score }
    }

    /// A picture with a person whose left upper corner is at `corner`. The network sees it from `least_px` tensor pixels on,
    /// if the crop holds all of it; `score` is made from that size.
    fn look_at(
        tracker: &mut Tracker,
        corner: Option<(f32, f32)>,
        least_px: f32,
        score: fn(f32) -> f32,
    ) -> (Vec<Person>, Vec<CropMap>) {
        let mut looks = Vec::new();
        let people = tracker.track(SIZES, &mut |crop| {
            looks.push(crop);
            let side_px = SIDE_PX / crop.scale;
            let Some((u_px, v_px)) = corner.filter(|_| side_px >= least_px) else { return Ok(Vec::new()) };
            let (x, y) = crop.to_tensor(u_px, v_px);
            let is_inside = x >= 0.0 && y >= 0.0 && x + side_px <= 100.0 && y + side_px <= 100.0;
            Ok(if is_inside { vec![person(u_px, v_px, 17, score(side_px))] } else { Vec::new() })
        });
        (people.unwrap(), looks)
    }

    fn whole() -> CropMap {
        CropMap::letterbox(640, 480, 100, 100)
    }

    fn around(corner: (f32, f32)) -> CropMap {
        CropMap::around(corner.0 + 40.0, corner.1 + 40.0, 1.35 * SIDE_PX, 100, 100)
    }

    #[test]
    fn the_first_picture_is_looked_at_whole_and_around_what_was_found_the_next_only_there() {
        let mut tracker = Tracker::new(RegionOptions::default());
        let corner = (300.0, 200.0);
        let (people, looks) = look_at(&mut tracker, Some(corner), 5.0, |px| px / 100.0);
        assert_eq!(looks, [whole(), around(corner), around(corner)]);
        // The best look's score: 80 px of 108 px in the crop.
        assert!((people[0].score - 1.0 / 1.35).abs() < 1e-5, "{}", people[0].score);
        let moved = (310.0, 195.0);
        assert_eq!(look_at(&mut tracker, Some(moved), 5.0, |px| px / 100.0).1, [around(corner)]);
        assert_eq!(look_at(&mut tracker, Some(moved), 5.0, |px| px / 100.0).1, [around(moved)]);
        tracker.forget();
        assert_eq!(look_at(&mut tracker, Some(moved), 5.0, |px| px / 100.0).1[0], whole());
    }

    #[test]
    fn a_second_look_that_sees_worse_is_not_taken() {
        let mut tracker = Tracker::new(RegionOptions::default());
        let (people, looks) = look_at(&mut tracker, Some((300.0, 200.0)), 5.0, |px| 5.0 / px);
        assert_eq!(looks.len(), 2);
        // 80 px are 12.5 px of the tensor when it shows 640 px.
        assert!((people[0].score - 0.4).abs() < 1e-5, "{}", people[0].score);
    }

    #[test]
    fn a_person_too_small_in_the_whole_picture_is_found_in_a_part_of_it() {
        let mut tracker = Tracker::new(RegionOptions::default());
        // 12.5 px in the whole picture, 16.7 in a square of its height, 33 in one of half.
        let (people, looks) = look_at(&mut tracker, Some((540.0, 30.0)), 25.0, |px| px / 100.0);
        assert_eq!(people.len(), 1);
        assert_eq!((looks[0], *looks.last().unwrap()), (whole(), around((540.0, 30.0))));
    }

    #[test]
    fn where_a_person_was_lost_is_not_looked_at_again() {
        let mut tracker = Tracker::new(RegionOptions::default());
        look_at(&mut tracker, Some((300.0, 200.0)), 5.0, |px| px / 100.0);
        let (people, looks) = look_at(&mut tracker, None, 5.0, |px| px / 100.0);
        assert!(people.is_empty());
        assert_eq!(looks[..2], [around((300.0, 200.0)), whole()]);
        let (people, looks) = look_at(&mut tracker, Some((20.0, 20.0)), 5.0, |px| px / 100.0);
        assert_eq!((people.len(), looks[0]), (1, whole()));
    }

    #[test]
    fn somebody_is_preferred_to_a_few_strong_keypoints() {
        let mut tracker = Tracker::new(RegionOptions::default());
        let mut looks = 0;
        // Nobody of high score in the whole picture and after it; in the third look somebody of low score.
        let people = tracker.track(SIZES, &mut |_| {
            looks += 1;
            Ok(vec![if looks == 3 { person(50.0, 50.0, 8, 0.2) } else { person(50.0, 50.0, 3, 0.5) }])
        });
        assert_eq!(people.unwrap(), [person(50.0, 50.0, 8, 0.2)]);
        assert!(tracker.next_crop(SIZES.tensor).is_some());
    }

    #[test]
    fn a_failure_of_the_network_ends_the_search_and_is_returned() {
        let mut tracker = Tracker::new(RegionOptions::default());
        let error =
            tracker.track(SIZES, &mut |_| Err(Error::Length { what: "output", expected: 51, got: 0 })).unwrap_err();
        assert!(matches!(error, Error::Length { got: 0, .. }), "{error}");
    }
}
