//! The queue between the loops and the writing thread.
//!
//! Two bounded lanes, pictures and everything else. Putting something in never waits: a full picture lane gives up its oldest picture, a full data
//! lane refuses the newcomer, and both are counted. The writer empties the data lane first, so pictures are what suffers first.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::sample::{Sample, Stamped};

#[derive(Debug, Default)]
struct Lanes {
    data: VecDeque<Stamped>,
    images: VecDeque<Stamped>,
    dropped_data: u64,
    dropped_images: u64,
    closed: bool,
}

/// What the writer finds.
#[derive(Debug)]
pub(super) enum Taken {
    /// Something to write.
    Sample(Box<Stamped>),
    /// Nothing within the time given.
    Nothing,
    /// The queue is closed and empty.
    Closed,
}

#[derive(Debug)]
pub(super) struct Queue {
    lanes: Mutex<Lanes>,
    changed: Condvar,
    data_capacity: usize,
    image_capacity: usize,
}

impl Queue {
    pub(super) fn new(data_capacity: usize, image_capacity: usize) -> Self {
        Self { lanes: Mutex::default(), changed: Condvar::new(), data_capacity, image_capacity }
    }

    fn lock(&self) -> MutexGuard<'_, Lanes> {
        // Every change is a single push or pop, so a panic elsewhere leaves nothing half done.
        self.lanes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn put(&self, stamped: Stamped) {
        let mut lanes = self.lock();
        if lanes.closed {
            lanes.dropped_data += 1;
            return;
        }
        if matches!(stamped.sample, Sample::Image { .. }) {
            if lanes.images.len() >= self.image_capacity {
                lanes.images.pop_front();
                lanes.dropped_images += 1;
            }
            lanes.images.push_back(stamped);
        } else if lanes.data.len() >= self.data_capacity {
            lanes.dropped_data += 1;
        } else {
            lanes.data.push_back(stamped);
        }
        drop(lanes);
        self.changed.notify_one();
    }

    pub(super) fn take(&self, timeout: Duration) -> Taken {
        let nothing = |lanes: &mut Lanes| lanes.data.is_empty() && lanes.images.is_empty() && !lanes.closed;
        let (mut lanes, _) =
            self.changed.wait_timeout_while(self.lock(), timeout, nothing).unwrap_or_else(PoisonError::into_inner);
        let sample = lanes.data.pop_front();
        match sample.or_else(|| lanes.images.pop_front()) {
            Some(sample) => Taken::Sample(Box::new(sample)),
            None if lanes.closed => Taken::Closed,
            None => Taken::Nothing,
        }
    }

    /// Closes the queue; what is in it can still be taken.
    pub(super) fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }

    /// Counts a picture that was taken and could not be written.
    pub(super) fn count_lost_image(&self) {
        self.lock().dropped_images += 1;
    }

    /// Dropped data and pictures so far.
    pub(super) fn dropped(&self) -> (u64, u64) {
        let lanes = self.lock();
        (lanes.dropped_data, lanes.dropped_images)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use image::RgbImage;

    use super::*;

    fn image(ms: u64) -> Stamped {
        let sample = Sample::Image { camera: 0, image: Arc::new(RgbImage::new(1, 1)) };
        Stamped { at: Duration::from_millis(ms), sample }
    }

    fn data(ms: u64) -> Stamped {
        Stamped { at: Duration::from_millis(ms), sample: Sample::Metrics(Vec::new()) }
    }

    fn drain(queue: &Queue) -> Vec<u128> {
        let mut out = Vec::new();
        while let Taken::Sample(stamped) = queue.take(Duration::ZERO) {
            out.push(stamped.at.as_millis());
        }
        out
    }

    #[test]
    fn data_comes_before_pictures_and_the_oldest_picture_goes_first() {
        let queue = Queue::new(4, 2);
        for ms in [1, 2, 3] {
            queue.put(image(ms));
        }
        queue.put(data(4));
        assert_eq!(drain(&queue), [4, 2, 3]);
        assert_eq!(queue.dropped(), (0, 1));
    }

    #[test]
    fn a_full_data_lane_refuses_and_counts() {
        let queue = Queue::new(2, 1);
        for ms in 0..5 {
            queue.put(data(ms));
        }
        assert_eq!(drain(&queue), [0, 1]);
        assert_eq!(queue.dropped(), (3, 0));
    }

    #[test]
    fn a_closed_queue_is_emptied_before_it_ends() {
        let queue = Queue::new(2, 1);
        queue.put(data(1));
        queue.close();
        queue.put(data(2));
        assert!(matches!(queue.take(Duration::ZERO), Taken::Sample(_)));
        assert!(matches!(queue.take(Duration::ZERO), Taken::Closed));
        assert_eq!(queue.dropped().0, 1);
    }
}
