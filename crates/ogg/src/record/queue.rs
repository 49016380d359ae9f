//! The queue between the loops and the recording threads.
//!
//! Two bounded lanes, pictures and everything else. Putting something in never waits: a full picture lane gives up its oldest picture, a full data
//! lane refuses the newcomer, and both are counted. Pictures leave their lane to be compressed and come back as messages, so
//! that compressing one never holds up the writer.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::encode::Encoded;
use super::sample::{Sample, Stamped};

/// Work for the writer.
#[derive(Debug)]
pub(super) enum Work {
    /// To be encoded and written.
    Sample(Stamped),
    /// A compressed picture, to be written.
    Picture(Duration, Vec<Encoded>),
}

/// What the writer finds.
#[derive(Debug)]
pub(super) enum Taken {
    /// Something to write.
    Work(Work),
    /// Nothing within the time given.
    Nothing,
    /// The queue is closed and empty, and no picture is being compressed.
    Closed,
}

#[derive(Debug, Default)]
struct Lanes {
    data: VecDeque<Work>,
    images: VecDeque<Stamped>,
    pictures: VecDeque<(Duration, Vec<Encoded>)>,
    compressing: bool,
    dropped_data: u64,
    dropped_images: u64,
    closed: bool,
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
        if matches!(stamped.sample, Sample::Image { .. }) {
            if lanes.closed || lanes.images.len() >= self.image_capacity {
                lanes.images.pop_front();
                lanes.dropped_images += 1;
            }
            if !lanes.closed {
                lanes.images.push_back(stamped);
            }
        } else if lanes.closed || lanes.data.len() >= self.data_capacity {
            lanes.dropped_data += 1;
        } else {
            lanes.data.push_back(Work::Sample(stamped));
        }
        drop(lanes);
        self.changed.notify_all();
    }

    /// Work for the writer: data before pictures.
    /// True while less than half of each lane is taken, or nobody reads any more.
    pub(super) fn has_room(&self) -> bool {
        let lanes = self.lock();
        lanes.closed || (lanes.images.len() * 2 < self.image_capacity && lanes.data.len() * 2 < self.data_capacity)
    }

    pub(super) fn take(&self, timeout: Duration) -> Taken {
        let nothing = |lanes: &mut Lanes| {
            lanes.data.is_empty()
                && lanes.pictures.is_empty()
                && (!lanes.closed || lanes.compressing || !lanes.images.is_empty())
        };
        let (mut lanes, _) =
            self.changed.wait_timeout_while(self.lock(), timeout, nothing).unwrap_or_else(PoisonError::into_inner);
        if let Some(work) = lanes.data.pop_front() {
            return Taken::Work(work);
        }
        match lanes.pictures.pop_front() {
            Some((at, messages)) => Taken::Work(Work::Picture(at, messages)),
            None if lanes.closed && !lanes.compressing && lanes.images.is_empty() => Taken::Closed,
            None => Taken::Nothing,
        }
    }

    /// A picture to compress; waits for one, and gives `None` once the queue is closed and its picture lane empty. Each picture must
    /// come back through [`give_back`](Self::give_back).
    pub(super) fn take_image(&self) -> Option<Stamped> {
        let nothing = |lanes: &mut Lanes| lanes.images.is_empty() && !lanes.closed;
        let mut lanes = self.changed.wait_while(self.lock(), nothing).unwrap_or_else(PoisonError::into_inner);
        let image = lanes.images.pop_front();
        lanes.compressing = image.is_some();
        image
    }

    /// Returns a picture as messages, or `None` if it could not be compressed.
    pub(super) fn give_back(&self, at: Duration, messages: Option<Vec<Encoded>>) {
        let mut lanes = self.lock();
        lanes.compressing = false;
        match messages {
            Some(messages) => {
                if lanes.pictures.len() >= self.image_capacity {
                    lanes.pictures.pop_front();
                    lanes.dropped_images += 1;
                }
                lanes.pictures.push_back((at, messages));
            }
            None => lanes.dropped_images += 1,
        }
        drop(lanes);
        self.changed.notify_all();
    }

    /// Closes the queue; what is in it can still be taken.
    pub(super) fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }

    /// Waits until the queue is closed, at most `timeout`; true if it is.
    pub(super) fn wait_closed(&self, timeout: Duration) -> bool {
        let open = |lanes: &mut Lanes| !lanes.closed;
        let waited = self.changed.wait_timeout_while(self.lock(), timeout, open);
        waited.unwrap_or_else(PoisonError::into_inner).0.closed
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
        while let Taken::Work(work) = queue.take(Duration::ZERO) {
            let (Work::Sample(Stamped { at, .. }) | Work::Picture(at, _)) = work;
            out.push(at.as_millis());
        }
        out
    }

    fn compress(queue: &Queue) {
        let image = queue.take_image().unwrap();
        queue.give_back(image.at, Some(Vec::new()));
    }

    #[test]
    fn the_oldest_picture_is_given_up_and_data_comes_before_pictures() {
        let queue = Queue::new(4, 2);
        for ms in [1, 2, 3] {
            queue.put(image(ms));
        }
        compress(&queue);
        compress(&queue);
        queue.put(data(4));
        assert_eq!(drain(&queue), [4, 2, 3]);
        assert_eq!(queue.dropped(), (0, 1));
    }

    #[test]
    fn compressed_pictures_that_nobody_writes_are_given_up_too() {
        let queue = Queue::new(4, 2);
        for ms in [1, 2, 3] {
            queue.put(image(ms));
            compress(&queue);
        }
        assert_eq!(drain(&queue), [2, 3]);
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
        queue.put(image(2));
        queue.close();
        queue.put(data(3));
        assert!(matches!(queue.take(Duration::ZERO), Taken::Work(_)));
        assert!(matches!(queue.take(Duration::ZERO), Taken::Nothing));
        let picture = queue.take_image().unwrap();
        assert!(matches!(queue.take(Duration::ZERO), Taken::Nothing));
        queue.give_back(picture.at, None);
        assert!(queue.take_image().is_none());
        assert!(matches!(queue.take(Duration::ZERO), Taken::Closed));
        assert_eq!(queue.dropped(), (1, 1));
    }
}
