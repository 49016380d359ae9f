//! A picture with its time, and the sources that give pictures.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use image::RgbImage;

use super::Error;

/// One picture of one camera.
///
/// Pixels are 8-bit RGB in sRGB-like encoding, row by row from the top left corner; a clone shares them.
#[derive(Clone)]
pub struct Frame {
    /// Pixels, shared.
    pub image: Arc<RgbImage>,
    /// When the light fell on the sensor, on the clock of whoever runs the source: the presentation time for
    /// a recording read directly, the time since the loop's epoch for a live or paced source.
    pub captured: Duration,
    /// Presentation time inside the recording; equal to `captured` for a camera.
    pub media_time: Duration,
    /// Running number of the frame in its source, from 0, without gaps at the source.
    pub sequence: u64,
    /// Index of the camera in its rig, from 0.
    pub camera: usize,
}

impl Frame {
    /// How old the picture is at `now`; zero if `now` lies before the capture.
    ///
    /// ```
    /// use std::{sync::Arc, time::Duration};
    /// let frame = ogg::capture::Frame {
    ///     image: Arc::new(image::RgbImage::new(2, 2)),
    ///     captured: Duration::from_millis(100),
    ///     media_time: Duration::ZERO,
    ///     sequence: 0,
    ///     camera: 0,
    /// };
    /// assert_eq!(frame.age(Duration::from_millis(130)), Duration::from_millis(30));
    /// ```
    pub fn age(&self, now: Duration) -> Duration {
        now.saturating_sub(self.captured)
    }
}

impl fmt::Debug for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Frame")
            .field("size", &self.image.dimensions())
            .field("captured", &self.captured)
            .field("media_time", &self.media_time)
            .field("sequence", &self.sequence)
            .field("camera", &self.camera)
            .finish()
    }
}

/// What is known of a source before its first frame.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceInfo {
    /// File, directory or device, as given.
    pub name: String,
    /// Width of the delivered pictures, in pixels (after rotation).
    pub width: u32,
    /// Height of the delivered pictures, in pixels (after rotation).
    pub height: u32,
    /// Nominal frame rate, where the source states one.
    pub rate_hz: Option<f64>,
    /// Number of frames, where the source states one.
    pub frames: Option<u64>,
    /// What turns the source's bytes into pixels, for the log and the recording.
    pub decoder: String,
    /// True for a camera: frames come by themselves and cannot be waited for.
    pub live: bool,
}

/// Anything that gives pictures one after the other.
pub trait Source: Send {
    /// What is known of the source.
    fn info(&self) -> &SourceInfo;

    /// The next picture in order of presentation, `None` at the end.
    ///
    /// # Errors
    ///
    /// Any [`Error`]; after an error the source gives nothing more.
    fn next_frame(&mut self) -> Result<Option<Frame>, Error>;
}

impl Source for Box<dyn Source> {
    fn info(&self) -> &SourceInfo {
        (**self).info()
    }

    fn next_frame(&mut self) -> Result<Option<Frame>, Error> {
        (**self).next_frame()
    }
}
