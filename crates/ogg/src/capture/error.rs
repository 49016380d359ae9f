//! Why a picture could not be had: one variant per kind of failure, each naming the source and the place.

use std::io;
use std::path::PathBuf;

/// A failure of a picture source. Every message names the source, the place and what was expected there.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused a read.
    #[error("{}: cannot read: {source}; expected a video file, a directory of images or a camera", path.display())]
    Read {
        /// File, directory or device.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A container is damaged or cut short.
    #[error("{}: byte {position}: expected {expected}, got {found}", path.display())]
    Container {
        /// The file.
        path: PathBuf,
        /// Offset from the start of the file, in bytes.
        position: u64,
        /// What the format asks for at this place.
        expected: String,
        /// What stands there.
        found: String,
    },
    /// The file has no picture track.
    #[error("{}: expected a video track, got {found}", path.display())]
    NoVideo {
        /// The file.
        path: PathBuf,
        /// What the file does hold.
        found: String,
    },
    /// A coded picture could not be decoded.
    #[error("{}: frame {frame} at byte {position}: expected a decodable picture, got {message}", path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// Index of the coded picture in file order, from 0.
        frame: u64,
        /// Offset of the coded picture, in bytes.
        position: u64,
        /// The decoder's words.
        message: String,
    },
    /// The decoder gave fewer or more pictures than the file holds.
    #[error("{}: expected {expected} frames, got {got}", path.display())]
    FrameCount {
        /// The file.
        path: PathBuf,
        /// Coded pictures in the file.
        expected: u64,
        /// Decoded pictures.
        got: u64,
    },
    /// The codec needs an `ffmpeg` program and none was found.
    #[error(
        "{}: {codec} is decoded by an ffmpeg program and none was found (searched: {searched}); \
         install ffmpeg, name one with --ffmpeg or OGG_FFMPEG, or convert the file to 8-bit 4:2:0 H.264 in MP4",
        path.display()
    )]
    NeedsFfmpeg {
        /// The file.
        path: PathBuf,
        /// Codec or container that asked for it.
        codec: String,
        /// Places that were looked at, in order.
        searched: String,
    },
    /// The `ffmpeg` program failed.
    #[error("{}: {} ended with {status} after {frames} frames: {message}", path.display(), program.display())]
    Ffmpeg {
        /// The file.
        path: PathBuf,
        /// The program that ran.
        program: PathBuf,
        /// Its exit status in words.
        status: String,
        /// Frames received before.
        frames: u64,
        /// The last line it wrote.
        message: String,
    },
    /// A directory holds no picture.
    #[error("{}: expected at least one .jpg, .jpeg or .png file, got {entries} other entries", path.display())]
    NoImages {
        /// The directory.
        path: PathBuf,
        /// How many entries it has.
        entries: usize,
    },
    /// A single picture file could not be decoded.
    #[error("{}: expected a JPEG or PNG picture, got {source}", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// The decoder's reason.
        source: image::ImageError,
    },
    /// A picture differs in size from the ones before it.
    #[error(
        "{}: frame {frame}: expected {} x {} pixels as before, got {} x {}",
        path.display(), expected.0, expected.1, got.0, got.1
    )]
    SizeChanged {
        /// The source.
        path: PathBuf,
        /// Index of the frame, from 0.
        frame: u64,
        /// Width and height of the frames before, in pixels.
        expected: (u32, u32),
        /// Width and height of this frame, in pixels.
        got: (u32, u32),
    },
    /// A buffer of raw pixels is too short for its declared size.
    #[error("{format} picture of {width} x {height}: expected {expected} bytes, got {got}")]
    ShortBuffer {
        /// Four-character code.
        format: &'static str,
        /// Pixels per row.
        width: u32,
        /// Rows.
        height: u32,
        /// Bytes that the size asks for.
        expected: usize,
        /// Bytes that came.
        got: usize,
    },
    /// A compressed camera picture could not be decoded.
    #[error("MJPG picture: expected a JPEG of {width} x {height}, got {message}")]
    CameraJpeg {
        /// Negotiated pixels per row.
        width: u32,
        /// Negotiated rows.
        height: u32,
        /// The decoder's words.
        message: String,
    },
    /// A camera offers no format that can be converted.
    #[error("{}: expected a camera with MJPG or YUYV at {wanted}, got {offered}", path.display())]
    NoCameraMode {
        /// The device.
        path: PathBuf,
        /// What was asked for.
        wanted: String,
        /// What the device offers.
        offered: String,
    },
    /// Cameras are not supported on this system.
    #[error("{}: cameras are read through V4L2, which this operating system does not have", path.display())]
    NoCameraSupport {
        /// The device.
        path: PathBuf,
    },
    /// A number given by the caller lies outside its interval.
    #[error("{field}: expected {expected}, got {got}")]
    Parameter {
        /// Name of the parameter.
        field: &'static str,
        /// Allowed interval.
        expected: &'static str,
        /// The value.
        got: String,
    },
    /// The system could not start a thread or a program.
    #[error("cannot start {what}: {source}")]
    Spawn {
        /// Thread or program.
        what: String,
        /// The system's reason.
        source: io::Error,
    },
}
