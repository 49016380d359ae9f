//! Capture in a thread of its own.
//!
//! The thread reads frame sets and puts each into a one-slot [`mailbox`]. A camera sets the pace by itself; a recording is played at
//! its own rate, and its capture times are moved to the loop's clock. Where reading cannot keep up with the recording, playback slips (and says by how
//! much) rather than handing out ever older pictures as fresh ones.

use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use super::mailbox::{Latest, Publisher, mailbox};
use super::{Error, FrameSet, MultiView, SourceInfo, StuckDetector, ViewCount};

/// At which rate frames are handed out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pace {
    /// As fast as they can be read; capture times stay those of the source.
    AsFastAsPossible,
    /// A recording at its own rate times `speed`; capture times count from the epoch. Cameras are not affected.
    AsRecorded {
        /// 1 for the recorded rate.
        speed: f64,
    },
}

/// Counts of a running capture.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CaptureStats {
    /// Frame sets that were captured.
    pub published: u64,
    /// Frame sets that were replaced before anybody took them.
    pub dropped: u64,
    /// Frame sets that repeated a picture of a stuck camera.
    pub stuck: u64,
    /// Time by which playback of a recording has fallen behind its own rate.
    pub slipped: Duration,
    /// Frames per source.
    pub views: Vec<ViewCount>,
}

#[derive(Debug, Default)]
struct Progress {
    stuck: u64,
    slipped: Duration,
    views: Vec<ViewCount>,
}

#[derive(Debug, Default)]
struct Stop {
    raised: Mutex<bool>,
    changed: Condvar,
}

impl Stop {
    fn raise(&self) {
        *self.raised.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.changed.notify_all();
    }

    /// Waits for `span` or until the stop; true if stopped.
    fn wait(&self, span: Duration) -> bool {
        let raised = self.raised.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.changed.wait_timeout_while(raised, span, |raised| !*raised);
        *waited.unwrap_or_else(PoisonError::into_inner).0
    }
}

/// A running capture thread. Dropping it tells the thread to stop and does not wait: a camera call may hang.
#[derive(Debug)]
pub struct Capture {
    latest: Latest<FrameSet>,
    stop: Arc<Stop>,
    progress: Arc<Mutex<Progress>>,
    infos: Vec<SourceInfo>,
}

impl Capture {
    /// Starts the thread. `epoch` is zero of the capture times.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for a speed that is not positive, [`Error::Spawn`].
    pub fn spawn(view: MultiView, epoch: Instant, pace: Pace) -> Result<Self, Error> {
        let pacer = Pacer::new(pace, epoch.elapsed(), view.infos().any(|info| info.live), interval(&view))?;
        let infos = view.infos().cloned().collect();
        let (publisher, latest) = mailbox();
        let stop = Arc::new(Stop::default());
        let progress = Arc::new(Mutex::new(Progress { views: view.counts().to_vec(), ..Progress::default() }));
        let (their_stop, their_progress) = (Arc::clone(&stop), Arc::clone(&progress));
        thread::Builder::new()
            .name("capture".to_owned())
            .spawn(move || run(view, epoch, pacer, publisher, &their_stop, &their_progress))
            .map_err(|source| Error::Spawn { what: "the capture thread".to_owned(), source })?;
        Ok(Self { latest, stop, progress, infos })
    }

    /// The mailbox.
    pub fn latest(&self) -> &Latest<FrameSet> {
        &self.latest
    }

    /// What is known of each source.
    pub fn infos(&self) -> &[SourceInfo] {
        &self.infos
    }

    /// Counts so far.
    pub fn stats(&self) -> CaptureStats {
        let progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
        CaptureStats {
            published: self.latest.published(),
            dropped: self.latest.dropped(),
            stuck: progress.stuck,
            slipped: progress.slipped,
            views: progress.views.clone(),
        }
    }

    /// Tells the thread to stop; the mailbox then ends with [`super::End::Finished`].
    pub fn stop(&self) {
        self.stop.raise();
    }
}

impl Drop for Capture {
    fn drop(&mut self) {
        self.stop.raise();
    }
}

fn interval(view: &MultiView) -> Duration {
    let rate_hz = view.infos().filter_map(|info| info.rate_hz).fold(0.0, f64::max);
    Duration::try_from_secs_f64(1.0 / rate_hz).unwrap_or(Duration::ZERO)
}

fn run(
    mut view: MultiView,
    epoch: Instant,
    mut pacer: Pacer,
    publisher: Publisher<FrameSet>,
    stop: &Stop,
    progress: &Mutex<Progress>,
) {
    // Only a camera can be stuck: a recording may well show a still scene.
    let mut watch: Vec<Option<StuckDetector>> =
        view.infos().map(|info| info.live.then(StuckDetector::default)).collect();
    loop {
        if stop.wait(Duration::ZERO) {
            return publisher.finish();
        }
        let mut set = match view.next_set() {
            Ok(Some(set)) => set,
            Ok(None) => return publisher.finish(),
            Err(error) => return publisher.fail(error),
        };
        if let Some(due) = pacer.due(set.captured, epoch.elapsed()) {
            if stop.wait(due.saturating_sub(epoch.elapsed())) {
                return publisher.finish();
            }
            let media = set.captured;
            for frame in &mut set.frames {
                frame.captured = due + frame.media_time.saturating_sub(media);
            }
            set.captured = due;
        }
        for (watch, frame) in watch.iter_mut().zip(&set.frames) {
            set.stuck |= watch.as_mut().is_some_and(|watch| watch.observe(&frame.image));
        }
        {
            let mut progress = progress.lock().unwrap_or_else(PoisonError::into_inner);
            progress.stuck += u64::from(set.stuck);
            progress.slipped = pacer.slipped;
            progress.views.clone_from_slice(view.counts());
        }
        if !publisher.publish(set) {
            return;
        }
    }
}

/// When each set of a recording is due, on the loop's clock.
#[derive(Debug)]
struct Pacer {
    speed: Option<f64>,
    start: Duration,
    /// Lateness up to which a set keeps its own time.
    patience: Duration,
    slipped: Duration,
}

impl Pacer {
    fn new(pace: Pace, start: Duration, live: bool, patience: Duration) -> Result<Self, Error> {
        let speed = match pace {
            Pace::AsRecorded { speed } if !(speed > 0.0 && speed.is_finite()) => {
                return Err(Error::Parameter { field: "speed", expected: "a positive factor", got: speed.to_string() });
            }
            Pace::AsRecorded { speed } if !live => Some(speed),
            _ => None,
        };
        Ok(Self { speed, start, patience, slipped: Duration::ZERO })
    }

    /// When the set with presentation time `media` is due, if the source is paced. `now` is the loop's clock.
    fn due(&mut self, media: Duration, now: Duration) -> Option<Duration> {
        let speed = self.speed?;
        let offset = Duration::try_from_secs_f64(media.as_secs_f64() / speed).unwrap_or(Duration::MAX);
        let due = self.start.saturating_add(self.slipped).saturating_add(offset);
        let late = now.saturating_sub(due);
        if late > self.patience {
            self.slipped += late;
            return Some(now);
        }
        Some(due)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn pacer(speed: f64) -> Pacer {
        Pacer::new(Pace::AsRecorded { speed }, ms(1000), false, ms(20)).unwrap()
    }

    #[test]
    fn a_recording_is_due_at_its_own_times_after_the_start() {
        let mut pacer = pacer(1.0);
        assert_eq!(pacer.due(ms(0), ms(1000)), Some(ms(1000)));
        assert_eq!(pacer.due(ms(40), ms(1001)), Some(ms(1040)));
    }

    #[test]
    fn speed_divides_the_times() {
        assert_eq!(pacer(4.0).due(ms(40), ms(1000)), Some(ms(1010)));
    }

    #[test]
    fn a_set_late_by_less_than_a_frame_keeps_its_own_time() {
        let mut pacer = pacer(1.0);
        assert_eq!(pacer.due(ms(20), ms(1035)), Some(ms(1020)));
        assert_eq!(pacer.slipped, ms(0));
    }

    #[test]
    fn playback_slips_when_reading_cannot_keep_up() {
        let mut pacer = pacer(1.0);
        assert_eq!(pacer.due(ms(20), ms(1100)), Some(ms(1100)));
        assert_eq!(pacer.slipped, ms(80));
        assert_eq!(pacer.due(ms(40), ms(1101)), Some(ms(1120)));
    }

    #[test]
    fn cameras_are_not_paced() {
        let mut pacer = Pacer::new(Pace::AsRecorded { speed: 1.0 }, ms(0), true, ms(20)).unwrap();
        assert_eq!(pacer.due(ms(0), ms(10)), None);
    }

    #[test]
    fn a_speed_that_is_not_positive_is_refused() {
        for speed in [0.0, -1.0, f64::NAN] {
            assert!(Pacer::new(Pace::AsRecorded { speed }, ms(0), false, ms(20)).is_err());
        }
    }
}
