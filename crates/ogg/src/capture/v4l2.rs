//! Cameras of Video4Linux2.
//!
//! Asks for the format that [`choose_mode`] picks and reads pictures as they come. The capture time is the moment at which the driver hands
//! the picture over, before conversion. Reading waits for the next picture, so it belongs in a thread of its own.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use linuxvideo::format::{FrameIntervals, FrameSizes, PixFormat, PixelFormat};
use linuxvideo::stream::ReadStream;
use linuxvideo::{BufType, Device, Fract};

use super::camera_format::{CameraMode, CameraRequest, PixelLayout, choose_mode, rgb_from_mjpeg};
use super::yuv::{ColourMatrix, ColourSpace, rgb_from_yuyv};
use super::{Error, Frame, Source, SourceInfo};

/// UVC cameras send BT.601 limited range unless their descriptors say otherwise (UVC 1.5, 3.9.2.6).
const CAMERA_COLOUR: ColourSpace = ColourSpace { matrix: ColourMatrix::Bt601, full_range: false };

/// A running camera.
pub(super) struct Camera {
    path: PathBuf,
    info: SourceInfo,
    layout: PixelLayout,
    stride_bytes: u32,
    stream: ReadStream,
    epoch: Instant,
    index: usize,
    given: u64,
}

impl Camera {
    pub(super) fn open(path: &Path, request: &CameraRequest, camera: usize, epoch: Instant) -> Result<Self, Error> {
        let read = |source| Error::Read { path: path.to_owned(), source };
        let device = Device::open(path).map_err(read)?;
        let modes = modes(&device).map_err(read)?;
        let Some(mode) = choose_mode(&modes, request) else {
            return Err(Error::NoCameraMode {
                path: path.to_owned(),
                wanted: in_words(request),
                offered: if modes.is_empty() { "neither".to_owned() } else { list(&modes) },
            });
        };
        let asked = PixFormat::new(mode.width, mode.height, code(mode.layout));
        let capture = device.video_capture(asked).map_err(read)?;
        let granted = capture.format();
        if (granted.width(), granted.height()) != (mode.width, mode.height)
            || granted.pixel_format() != code(mode.layout)
        {
            return Err(Error::NoCameraMode {
                path: path.to_owned(),
                wanted: list(&[mode]),
                offered: format!("{} x {} {:?}", granted.width(), granted.height(), granted.pixel_format()),
            });
        }
        let stride_bytes = granted.bytes_per_line();
        let interval = Fract::new(1000, (mode.rate_hz * 1000.0).round().max(1.0) as u32);
        // A driver without rate control keeps its own rate; what it says is what is reported.
        let rate_hz = match capture.set_frame_interval(interval) {
            Ok(granted) if granted.numerator() > 0 => f64::from(granted.denominator()) / f64::from(granted.numerator()),
            _ => mode.rate_hz,
        };
        let stream = capture.into_stream().map_err(read)?;
        let packing = if mode.layout == PixelLayout::Yuyv { "YUYV" } else { "MJPG" };
        Ok(Self {
            path: path.to_owned(),
            info: SourceInfo {
                name: path.display().to_string(),
                width: mode.width,
                height: mode.height,
                rate_hz: Some(rate_hz),
                frames: None,
                decoder: format!("V4L2 {packing}"),
                live: true,
            },
            layout: mode.layout,
            stride_bytes,
            stream,
            epoch,
            index: camera,
            given: 0,
        })
    }
}

impl Source for Camera {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn next_frame(&mut self) -> Result<Option<Frame>, Error> {
        let epoch = self.epoch;
        let (bytes, captured) = loop {
            let taken = self.stream.dequeue(|buffer| {
                let captured = epoch.elapsed();
                // The driver marks a picture whose transfer went wrong; the next one is waited for.
                Ok((!buffer.is_error()).then(|| (buffer.to_vec(), captured)))
            });
            match taken {
                Ok(Some(picture)) => break picture,
                Ok(None) => {}
                Err(source) => return Err(Error::Read { path: self.path.clone(), source }),
            }
        };
        let (width, height) = (self.info.width, self.info.height);
        let image = match self.layout {
            PixelLayout::Yuyv => rgb_from_yuyv(&bytes, width, height, self.stride_bytes, CAMERA_COLOUR)?,
            PixelLayout::Mjpeg => rgb_from_mjpeg(&bytes, width, height)?,
        };
        let sequence = self.given;
        self.given += 1;
        Ok(Some(Frame { image: Arc::new(image), captured, media_time: captured, sequence, camera: self.index }))
    }
}

fn code(layout: PixelLayout) -> PixelFormat {
    match layout {
        PixelLayout::Yuyv => PixelFormat::from_fourcc(*b"YUYV"),
        PixelLayout::Mjpeg => PixelFormat::from_fourcc(*b"MJPG"),
    }
}

fn modes(device: &Device) -> io::Result<Vec<CameraMode>> {
    let mut modes = Vec::new();
    for format in device.formats(BufType::VIDEO_CAPTURE) {
        let format = format?.pixel_format();
        let Some(layout) = [PixelLayout::Yuyv, PixelLayout::Mjpeg].into_iter().find(|&layout| code(layout) == format)
        else {
            continue;
        };
        let sizes: Vec<(u32, u32)> = match device.frame_sizes(format)? {
            FrameSizes::Discrete(sizes) => sizes.iter().map(|size| (size.width(), size.height())).collect(),
            FrameSizes::Stepwise(range) | FrameSizes::Continuous(range) => {
                vec![(range.min_width(), range.min_height()), (range.max_width(), range.max_height())]
            }
        };
        for (width, height) in sizes {
            // Drivers that do not list intervals run at the usual rate.
            let rate_hz =
                device.frame_intervals(format, width, height).map_or(30.0, |intervals| fastest_hz(&intervals));
            modes.push(CameraMode { layout, width, height, rate_hz });
        }
    }
    Ok(modes)
}

fn fastest_hz(intervals: &FrameIntervals) -> f64 {
    let hz = |interval: &Fract| f64::from(interval.denominator()) / f64::from(interval.numerator().max(1));
    match intervals {
        FrameIntervals::Discrete(list) => list.iter().map(|interval| hz(interval.fract())).fold(0.0, f64::max),
        FrameIntervals::Stepwise(range) | FrameIntervals::Continuous(range) => hz(range.min()),
    }
}

fn in_words(request: &CameraRequest) -> String {
    let size = request.size.map_or("any size".to_owned(), |(width, height)| format!("{width} x {height}"));
    let rate = request.rate_hz.map_or("any rate".to_owned(), |rate_hz| format!("{rate_hz} Hz"));
    format!("{size}, {rate}")
}

fn list(modes: &[CameraMode]) -> String {
    let words: Vec<String> = modes
        .iter()
        .map(|mode| {
            let packing = if mode.layout == PixelLayout::Yuyv { "YUYV" } else { "MJPG" };
            format!("{packing} {} x {} at {:.1} Hz", mode.width, mode.height, mode.rate_hz)
        })
        .collect();
    words.join(", ")
}
