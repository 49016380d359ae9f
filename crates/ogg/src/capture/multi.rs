//! Several synchronised sources as one stream of frame sets.
//!
//! Frames belong together when their capture times differ by at most half a frame interval. A source that lags behind is advanced; frames
//! skipped on the way are counted, and so is a difference in the number of frames that the sources state.

use std::collections::VecDeque;
use std::time::Duration;

use super::{Error, Frame, Source, SourceInfo};

/// One frame per camera, taken at the same time.
#[derive(Debug, Clone)]
pub struct FrameSet {
    /// One frame per source, in the order of the sources.
    pub frames: Vec<Frame>,
    /// The earliest capture time among them, so that no frame is older than the set says.
    pub captured: Duration,
    /// Running number of the set, from 0.
    pub sequence: u64,
    /// True if one of the sources is stuck on one picture.
    pub stuck: bool,
}

impl FrameSet {
    /// How old the oldest frame is at `now`.
    pub fn age(&self, now: Duration) -> Duration {
        now.saturating_sub(self.captured)
    }
}

/// What became of one source's frames.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ViewCount {
    /// Name of the source.
    pub name: String,
    /// Frames that the source states.
    pub stated: Option<u64>,
    /// Frames that went into sets.
    pub used: u64,
    /// Frames without partners in the other sources.
    pub skipped: u64,
}

/// Joins sources into frame sets; with one source, every frame is a set.
pub struct MultiView {
    sources: Vec<Box<dyn Source>>,
    waiting: Vec<VecDeque<Frame>>,
    counts: Vec<ViewCount>,
    tolerance: Duration,
    sequence: u64,
    done: bool,
}

impl std::fmt::Debug for MultiView {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MultiView")
            .field("counts", &self.counts)
            .field("tolerance", &self.tolerance)
            .finish_non_exhaustive()
    }
}

/// Frame rate of a source that states none.
const ASSUMED_RATE_HZ: f64 = 60.0;

impl MultiView {
    /// Takes the sources; the fastest one sets the tolerance.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] without a source.
    pub fn new(sources: Vec<Box<dyn Source>>) -> Result<Self, Error> {
        if sources.is_empty() {
            return Err(Error::Parameter { field: "sources", expected: "at least one", got: "none".to_owned() });
        }
        let rate_hz = sources.iter().filter_map(|source| source.info().rate_hz).fold(0.0, f64::max);
        let rate_hz = if rate_hz > 0.0 { rate_hz } else { ASSUMED_RATE_HZ };
        let counts = sources
            .iter()
            .map(|source| ViewCount {
                name: source.info().name.clone(),
                stated: source.info().frames,
                used: 0,
                skipped: 0,
            })
            .collect();
        Ok(Self {
            waiting: sources.iter().map(|_| VecDeque::new()).collect(),
            counts,
            tolerance: Duration::try_from_secs_f64(0.5 / rate_hz).unwrap_or(Duration::ZERO),
            sequence: 0,
            done: false,
            sources,
        })
    }

    /// What is known of each source.
    pub fn infos(&self) -> impl Iterator<Item = &SourceInfo> {
        self.sources.iter().map(Source::info)
    }

    /// Used and skipped frames of each source so far.
    pub fn counts(&self) -> &[ViewCount] {
        &self.counts
    }

    /// Sets that can be expected: the smallest number of frames that a source states, if all state one.
    pub fn expected_sets(&self) -> Option<u64> {
        self.counts.iter().map(|count| count.stated).min().flatten()
    }

    /// A sentence about sources that state different numbers of frames, or that had frames without partners.
    pub fn mismatch(&self) -> Option<String> {
        let stated: Vec<u64> = self.counts.iter().filter_map(|count| count.stated).collect();
        let uneven = stated.windows(2).any(|pair| pair[0] != pair[1]);
        let skipped = self.counts.iter().any(|count| count.skipped > 0);
        (uneven || skipped).then(|| {
            let words: Vec<String> = self
                .counts
                .iter()
                .map(|count| {
                    let stated = count.stated.map_or("an unknown number of".to_owned(), |frames| frames.to_string());
                    format!("{}: {stated} frames, {} used, {} skipped", count.name, count.used, count.skipped)
                })
                .collect();
            format!("the views differ in length or timing: {}", words.join("; "))
        })
    }

    /// The next set, `None` as soon as one source has ended.
    ///
    /// # Errors
    ///
    /// The first error of a source; the set stream ends with it.
    pub fn next_set(&mut self) -> Result<Option<FrameSet>, Error> {
        if self.done {
            return Ok(None);
        }
        loop {
            for index in 0..self.sources.len() {
                if !self.waiting[index].is_empty() {
                    continue;
                }
                match self.sources[index].next_frame() {
                    Ok(Some(frame)) => self.waiting[index].push_back(frame),
                    Ok(None) => {
                        self.finish();
                        return Ok(None);
                    }
                    Err(error) => {
                        self.finish();
                        return Err(error);
                    }
                }
            }
            let times = || self.waiting.iter().filter_map(VecDeque::front).map(|frame| frame.captured);
            let (Some(earliest), Some(latest)) = (times().min(), times().max()) else { return Ok(None) };
            if latest.saturating_sub(earliest) <= self.tolerance {
                let frames: Vec<Frame> = self.waiting.iter_mut().filter_map(VecDeque::pop_front).collect();
                for count in &mut self.counts {
                    count.used += 1;
                }
                let sequence = self.sequence;
                self.sequence += 1;
                return Ok(Some(FrameSet { frames, captured: earliest, sequence, stuck: false }));
            }
            for (queue, count) in self.waiting.iter_mut().zip(&mut self.counts) {
                if queue.front().is_some_and(|frame| latest.saturating_sub(frame.captured) > self.tolerance) {
                    queue.pop_front();
                    count.skipped += 1;
                }
            }
        }
    }

    /// Frames that were read and never found partners count as skipped.
    fn finish(&mut self) {
        self.done = true;
        for (queue, count) in self.waiting.iter_mut().zip(&mut self.counts) {
            count.skipped += queue.len() as u64;
            queue.clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use image::RgbImage;

    use super::*;

    struct Listed {
        info: SourceInfo,
        times_ms: VecDeque<u64>,
        camera: usize,
    }

    fn listed(camera: usize, times_ms: &[u64]) -> Box<dyn Source> {
        let info = SourceInfo {
            name: format!("view{camera}"),
            width: 1,
            height: 1,
            rate_hz: Some(50.0),
            frames: Some(times_ms.len() as u64),
            decoder: "list".to_owned(),
            live: false,
        };
        Box::new(Listed { info, times_ms: times_ms.iter().copied().collect(), camera })
    }

    impl Source for Listed {
        fn info(&self) -> &SourceInfo {
            &self.info
        }

        fn next_frame(&mut self) -> Result<Option<Frame>, Error> {
            let Some(time) = self.times_ms.pop_front() else { return Ok(None) };
            let captured = Duration::from_millis(time);
            let image = Arc::new(RgbImage::new(1, 1));
            Ok(Some(Frame { image, captured, media_time: captured, sequence: time, camera: self.camera }))
        }
    }

    fn sets(mut view: MultiView) -> (Vec<Vec<u64>>, MultiView) {
        let mut out = Vec::new();
        while let Some(set) = view.next_set().unwrap() {
            out.push(set.frames.iter().map(|frame| frame.sequence).collect());
        }
        (out, view)
    }

    #[test]
    fn frames_of_the_same_time_form_sets() {
        let view = MultiView::new(vec![listed(0, &[0, 20, 40]), listed(1, &[3, 22, 39])]).unwrap();
        assert_eq!(view.expected_sets(), Some(3));
        let (sets, view) = sets(view);
        assert_eq!(sets, [[0, 3], [20, 22], [40, 39]]);
        assert_eq!(view.mismatch(), None);
    }

    #[test]
    fn a_gap_in_one_view_skips_the_partners_and_is_reported() {
        let view = MultiView::new(vec![listed(0, &[0, 20, 40, 60]), listed(1, &[0, 40, 60])]).unwrap();
        let (sets, view) = sets(view);
        assert_eq!(sets, [[0, 0], [40, 40], [60, 60]]);
        assert_eq!(
            view.mismatch().unwrap(),
            "the views differ in length or timing: view0: 4 frames, 3 used, 1 skipped; \
             view1: 3 frames, 3 used, 0 skipped"
        );
    }

    #[test]
    fn the_stream_ends_with_the_shortest_view() {
        let view = MultiView::new(vec![listed(0, &[0, 20, 40]), listed(1, &[0, 20])]).unwrap();
        assert_eq!(view.expected_sets(), Some(2));
        let (sets, view) = sets(view);
        assert_eq!(sets, [[0, 0], [20, 20]]);
        assert_eq!(view.counts()[0].skipped, 1);
    }

    #[test]
    fn the_age_of_a_set_is_that_of_its_oldest_frame() {
        let mut view = MultiView::new(vec![listed(0, &[8]), listed(1, &[2])]).unwrap();
        let set = view.next_set().unwrap().unwrap();
        assert_eq!(set.age(Duration::from_millis(10)), Duration::from_millis(8));
    }

    #[test]
    fn no_source_at_all_is_refused() {
        assert_eq!(MultiView::new(Vec::new()).unwrap_err().to_string(), "sources: expected at least one, got none");
    }
}
