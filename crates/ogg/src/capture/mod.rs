//! Pictures in: files, directories, cameras, each frame with its capture time.
//!
//! | Input | Read by |
//! |---|---|
//! | H.264 in MP4/MOV, 8-bit 4:2:0, progressive | this process (OpenH264) |
//! | any other video file | an `ffmpeg` program, see [`Ffmpeg::find`] |
//! | a directory | its JPEG and PNG files in order of name, at a given rate |
//! | `/dev/video*` | V4L2, `YUYV` or `MJPG` |
//!
//! [`open`] gives a [`Source`], which hands out every frame in order of presentation. [`MultiView`] joins several synchronised
//! sources into frame sets. [`Capture`] runs that in a thread of its own behind a one-slot mailbox ([`Latest`]): the newest set wins,
//! older ones are counted as dropped, and the end of the source, good or bad, is delivered after the last set.
//! [`StuckDetector`] notices a source that repeats one picture.

mod bytes;
mod camera_format;
mod error;
mod ffmpeg;
mod frame;
mod h264;
mod images;
mod live;
mod mailbox;
mod mp4;
mod multi;
mod sps;
mod stuck;
#[cfg(target_os = "linux")]
mod v4l2;
mod yuv;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Instant;

pub use camera_format::{CameraMode, CameraRequest, PixelLayout, choose_mode, rgb_from_mjpeg};
pub use error::Error;
pub use ffmpeg::Ffmpeg;
pub use frame::{Frame, Source, SourceInfo};
pub use images::ImageDirectory;
pub use live::{Capture, CaptureStats, Pace};
pub use mailbox::{End, Latest, Publisher, Wait, mailbox};
pub use multi::{FrameSet, MultiView, ViewCount};
pub use stuck::{StuckDetector, image_hash};
pub use yuv::{ColourMatrix, ColourSpace, rgb_from_yuyv};

/// What a source may need besides its path.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct OpenOptions {
    /// Index of the camera in its rig, copied into every frame.
    pub camera: usize,
    /// Frame rate of a directory of images.
    pub image_rate_hz: Option<f64>,
    /// An `ffmpeg` program to use instead of the one that is found.
    pub ffmpeg: Option<PathBuf>,
    /// Size and rate asked of a camera.
    pub request: CameraRequest,
    /// Zero of a camera's capture times; the moment of opening where absent.
    pub epoch: Option<Instant>,
}

/// Opens a video file, a directory of images or a camera, whichever `path` is.
///
/// # Errors
///
/// A [`Error`] that names the path: it does not exist, is damaged or cut short, needs a decoder that is not there, holds no
/// pictures, or is a camera without a usable format. A video file is checked whole (index and extents) before the first frame.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>, Error> {
    let read = |source| Error::Read { path: path.to_owned(), source };
    let kind = std::fs::metadata(path).map_err(read)?.file_type();
    if kind.is_dir() {
        let rate_hz = options.image_rate_hz.unwrap_or(DEFAULT_IMAGE_RATE_HZ);
        return Ok(Box::new(ImageDirectory::open(path, rate_hz, options.camera)?));
    }
    if !kind.is_file() {
        return open_camera(path, options);
    }
    let mut file = File::open(path).map_err(read)?;
    let length = file.metadata().map_err(read)?.len();
    if !looks_like_mp4(&mut file).map_err(read)? {
        return Ok(Box::new(with_ffmpeg(path, options, "a container other than MP4")?));
    }
    let track = mp4::read(&mut file, length).map_err(|error| match error {
        mp4::ContainerError::Io(source) => read(source),
        mp4::ContainerError::Malformed(place) => Error::Container {
            path: path.to_owned(),
            position: place.position,
            expected: place.expected,
            found: place.found,
        },
        mp4::ContainerError::NoVideo(found) => Error::NoVideo { path: path.to_owned(), found },
    })?;
    match h264::supported(&track) {
        Ok((avc, facts)) => Ok(Box::new(h264::H264File::new(path, file, track, avc, facts, options.camera)?)),
        Err(codec) => {
            let source = with_ffmpeg(path, options, &codec)?;
            Ok(Box::new(source.with_stated(track.rate_hz(), track.samples.len() as u64)))
        }
    }
}

/// Rate of a directory of images for which none is given; what most cameras run at.
const DEFAULT_IMAGE_RATE_HZ: f64 = 30.0;

fn with_ffmpeg(path: &Path, options: &OpenOptions, codec: &str) -> Result<ffmpeg::FfmpegFile, Error> {
    let ffmpeg = Ffmpeg::find(options.ffmpeg.as_deref()).map_err(|searched| Error::NeedsFfmpeg {
        path: path.to_owned(),
        codec: codec.to_owned(),
        searched,
    })?;
    ffmpeg.open(path, options.camera)
}

#[cfg(target_os = "linux")]
fn open_camera(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>, Error> {
    Ok(Box::new(v4l2::Camera::open(
        path,
        &options.request,
        options.camera,
        options.epoch.unwrap_or_else(Instant::now),
    )?))
}

#[cfg(not(target_os = "linux"))]
fn open_camera(path: &Path, _options: &OpenOptions) -> Result<Box<dyn Source>, Error> {
    Err(Error::NoCameraSupport { path: path.to_owned() })
}

/// True unless the first bytes are those of a different container: a damaged MP4 should be reported as one.
fn looks_like_mp4(file: &mut File) -> std::io::Result<bool> {
    use std::io::{Read, Seek, SeekFrom};

    const OTHERS: [&[u8]; 7] =
        [b"\x1a\x45\xdf\xa3", b"RIFF", b"FLV", b"OggS", b"\x00\x00\x01\xba", b"\x00\x00\x01\xb3", b"GIF8"];
    let mut head = Vec::with_capacity(16);
    file.by_ref().take(16).read_to_end(&mut head)?;
    file.seek(SeekFrom::Start(0))?;
    let transport_stream = head.first() == Some(&0x47) && head.get(4..8) != Some(b"ftyp");
    Ok(!transport_stream && !OTHERS.iter().any(|magic| head.starts_with(magic)))
}

/// A sample entry's code in words.
fn codec_name(code: [u8; 4]) -> String {
    match &code {
        b"vp09" => "VP9".to_owned(),
        b"vp08" => "VP8".to_owned(),
        b"av01" => "AV1".to_owned(),
        b"hvc1" | b"hev1" | b"dvh1" | b"dvhe" => "HEVC (H.265)".to_owned(),
        b"mp4v" => "MPEG-4 part 2".to_owned(),
        b"apch" | b"apcn" | b"apcs" | b"apco" | b"ap4h" => "ProRes".to_owned(),
        b"jpeg" | b"mjpa" | b"mjpb" => "Motion JPEG".to_owned(),
        _ => format!("codec '{}'", bytes::fourcc_text(code)),
    }
}

#[cfg(test)]
mod tests;
