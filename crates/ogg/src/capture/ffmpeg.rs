//! Any other video file, decoded by an `ffmpeg` program.
//!
//! The program writes raw RGB pictures to its standard output, upright and without dropping or doubling any; its `showinfo`
//! filter tells size and presentation time of each on standard error. Nothing of ffmpeg is linked. The program is killed when the source is dropped.

use std::collections::VecDeque;
use std::env;
use std::ffi::OsStr;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use image::RgbImage;

use super::{Error, Frame, Source, SourceInfo};

/// Picture descriptions that may wait for their pixels; ffmpeg is at most a few pictures ahead of its output pipe.
const MAX_AHEAD: usize = 1024;

/// An `ffmpeg` program on this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ffmpeg {
    program: PathBuf,
}

impl Ffmpeg {
    /// Finds the program, in this order: `explicit`, the environment variable `OGG_FFMPEG`, `ffmpeg` on the `PATH`, and the one inside
    /// the `imageio-ffmpeg` package of the active Python environment (`VIRTUAL_ENV`). A place that is named but
    /// does not hold a file ends the search.
    ///
    /// # Errors
    ///
    /// The places that were searched, in words.
    pub fn find(explicit: Option<&Path>) -> Result<Self, String> {
        Self::find_in(
            explicit,
            env::var_os("OGG_FFMPEG").as_deref(),
            env::var_os("PATH").as_deref(),
            env::var_os("VIRTUAL_ENV").as_deref(),
        )
    }

    fn find_in(
        explicit: Option<&Path>,
        variable: Option<&OsStr>,
        search_path: Option<&OsStr>,
        python: Option<&OsStr>,
    ) -> Result<Self, String> {
        let named = explicit.map(|path| ("--ffmpeg", path.to_owned()));
        let named = named.or_else(|| variable.map(|path| ("OGG_FFMPEG", PathBuf::from(path))));
        if let Some((origin, program)) = named {
            return if program.is_file() {
                Ok(Self { program })
            } else {
                Err(format!("{origin} names {}, which is not a file", program.display()))
            };
        }
        let on_path = search_path.into_iter().flat_map(env::split_paths).map(|folder| folder.join("ffmpeg"));
        if let Some(program) = on_path.into_iter().find(|program| program.is_file()) {
            return Ok(Self { program });
        }
        if let Some(program) = python.and_then(|root| in_python_environment(Path::new(root))) {
            return Ok(Self { program });
        }
        Err("OGG_FFMPEG (not set), the PATH, imageio-ffmpeg of the active Python environment".to_owned())
    }

    /// Where the program is.
    pub fn program(&self) -> &Path {
        &self.program
    }

    /// Starts decoding `path`.
    ///
    /// # Errors
    ///
    /// [`Error::Spawn`] if the program does not start, [`Error::Ffmpeg`] if it gives no picture.
    pub fn open(&self, path: &Path, camera: usize) -> Result<FfmpegFile, Error> {
        let spawn = |source| Error::Spawn { what: self.program.display().to_string(), source };
        // A leading dash or a scheme in a file name must not become an option or an address.
        let absolute = std::path::absolute(path).map_err(spawn)?;
        let mut child = Command::new(&self.program)
            .args(["-hide_banner", "-nostdin", "-nostats", "-loglevel", "info", "-i"])
            .arg(absolute)
            .args(["-map", "0:v:0", "-an", "-sn", "-dn", "-vf", "showinfo=checksum=0", "-fps_mode", "passthrough"])
            .args(["-f", "rawvideo", "-pix_fmt", "rgb24", "pipe:1"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(spawn)?;
        let (Some(pixels), Some(messages)) = (child.stdout.take(), child.stderr.take()) else {
            unreachable!("both pipes were asked for above");
        };
        let (send, pictures) = sync_channel(MAX_AHEAD);
        let last_words = Arc::new(Mutex::new(VecDeque::new()));
        let words = Arc::clone(&last_words);
        thread::Builder::new()
            .name("ffmpeg-messages".to_owned())
            .spawn(move || {
                for line in BufReader::new(messages).lines().map_while(Result::ok) {
                    if let Some(picture) = Picture::parse(&line) {
                        if send.send(picture).is_err() {
                            return;
                        }
                    } else if !line.contains("showinfo") {
                        let mut words = words.lock().unwrap_or_else(PoisonError::into_inner);
                        words.push_back(line);
                        if words.len() > 8 {
                            words.pop_front();
                        }
                    }
                }
            })
            .map_err(|source| Error::Spawn { what: "a thread for ffmpeg's messages".to_owned(), source })?;
        let mut source = FfmpegFile {
            path: path.to_owned(),
            program: self.program.clone(),
            info: SourceInfo {
                name: path.display().to_string(),
                width: 0,
                height: 0,
                rate_hz: None,
                frames: None,
                decoder: self.program.display().to_string(),
                live: false,
            },
            camera,
            child,
            pixels,
            pictures,
            first: None,
            start: None,
            last_words,
            given: 0,
            done: false,
        };
        let Ok(first) = source.pictures.recv() else {
            return Err(source.failure());
        };
        source.info.width = first.width;
        source.info.height = first.height;
        source.first = Some(first);
        Ok(source)
    }
}

fn in_python_environment(root: &Path) -> Option<PathBuf> {
    let entries = |folder: PathBuf| std::fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok);
    entries(root.join("lib"))
        .map(|python| python.path().join("site-packages/imageio_ffmpeg/binaries"))
        .flat_map(entries)
        .map(|entry| entry.path())
        .filter(|path| path.file_name().and_then(OsStr::to_str).is_some_and(|name| name.starts_with("ffmpeg-")))
        .min()
}

/// What `showinfo` says about one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Picture {
    time_s: f64,
    width: u32,
    height: u32,
}

impl Picture {
    /// Reads a line such as `[Parsed_showinfo_0 @ 0x5] n:   3 pts:   1536 pts_time:0.1 duration: 512 … s:64x48 i:P …`.
    fn parse(line: &str) -> Option<Self> {
        if !line.contains("showinfo") {
            return None;
        }
        let value = |key: &str| {
            let (_, rest) = line.split_once(key)?;
            rest.split_whitespace().next()
        };
        let (width, height) = value(" s:")?.split_once('x')?;
        Some(Self {
            time_s: value("pts_time:")?.parse().ok().filter(|time: &f64| time.is_finite())?,
            width: width.parse().ok().filter(|&width| width > 0)?,
            height: height.parse().ok().filter(|&height| height > 0)?,
        })
    }
}

/// Frames of one file, decoded by [`Ffmpeg`].
pub struct FfmpegFile {
    path: PathBuf,
    program: PathBuf,
    info: SourceInfo,
    camera: usize,
    child: Child,
    pixels: ChildStdout,
    pictures: Receiver<Picture>,
    first: Option<Picture>,
    start: Option<f64>,
    last_words: Arc<Mutex<VecDeque<String>>>,
    given: u64,
    done: bool,
}

impl std::fmt::Debug for FfmpegFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FfmpegFile").field("info", &self.info).field("given", &self.given).finish_non_exhaustive()
    }
}

impl FfmpegFile {
    /// Adds what the container states, where it could be read.
    pub(super) fn with_stated(mut self, rate_hz: Option<f64>, frames: u64) -> Self {
        self.info.rate_hz = rate_hz;
        self.info.frames = Some(frames);
        self
    }

    fn failure(&mut self) -> Error {
        self.done = true;
        let status = match self.child.wait() {
            Ok(status) => status.to_string(),
            Err(error) => error.to_string(),
        };
        let words = self.last_words.lock().unwrap_or_else(PoisonError::into_inner);
        Error::Ffmpeg {
            path: self.path.clone(),
            program: self.program.clone(),
            status,
            frames: self.given,
            message: words.back().cloned().unwrap_or_else(|| "no message".to_owned()),
        }
    }
}

impl Source for FfmpegFile {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn next_frame(&mut self) -> Result<Option<Frame>, Error> {
        if self.done {
            return Ok(None);
        }
        let Some(picture) = self.first.take().or_else(|| self.pictures.recv().ok()) else {
            return match self.child.wait() {
                Ok(status) if status.success() => {
                    self.done = true;
                    Ok(None)
                }
                _ => Err(self.failure()),
            };
        };
        let (got, expected) = ((picture.width, picture.height), (self.info.width, self.info.height));
        if got != expected {
            self.done = true;
            return Err(Error::SizeChanged { path: self.path.clone(), frame: self.given, expected, got });
        }
        let mut image = RgbImage::new(picture.width, picture.height);
        if let Err(source) = self.pixels.read_exact(&mut image) {
            return Err(if source.kind() == ErrorKind::UnexpectedEof {
                self.failure()
            } else {
                Error::Read { path: self.path.clone(), source }
            });
        }
        let start = *self.start.get_or_insert(picture.time_s);
        let captured = Duration::try_from_secs_f64((picture.time_s - start).max(0.0)).unwrap_or(Duration::MAX);
        let sequence = self.given;
        self.given += 1;
        Ok(Some(Frame { image: Arc::new(image), captured, media_time: captured, sequence, camera: self.camera }))
    }
}

impl Drop for FfmpegFile {
    fn drop(&mut self) {
        // Both calls fail only if the program has already ended and been waited for.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_showinfo_line_gives_time_and_size() {
        let line = "[Parsed_showinfo_0 @ 0x5f] n:   3 pts:   1536 pts_time:0.1     duration:    512 \
                    duration_time:0.0333333 fmt:yuv420p cl:left sar:1/1 s:64x48 i:P iskey:0 type:B";
        assert_eq!(Picture::parse(line), Some(Picture { time_s: 0.1, width: 64, height: 48 }));
    }

    #[test]
    fn other_lines_are_not_pictures() {
        for line in ["", "Stream #0:0: Video: vp9, 64x48", "[Parsed_showinfo_0 @ 0x5f] color_range:tv"] {
            assert_eq!(Picture::parse(line), None);
        }
    }

    #[test]
    fn a_program_that_is_named_but_absent_ends_the_search() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("ffmpeg"), b"").unwrap();
        let searched = Ffmpeg::find_in(Some(Path::new("/nowhere/ffmpeg")), None, Some(folder.path().as_os_str()), None);
        assert_eq!(searched.unwrap_err(), "--ffmpeg names /nowhere/ffmpeg, which is not a file");
    }

    #[test]
    fn the_path_comes_before_the_python_environment() {
        let folder = tempfile::tempdir().unwrap();
        let binaries = folder.path().join("lib/python3.12/site-packages/imageio_ffmpeg/binaries");
        std::fs::create_dir_all(&binaries).unwrap();
        std::fs::write(binaries.join("ffmpeg-linux-x86_64-v7"), b"").unwrap();
        let python = Some(folder.path().as_os_str());
        let found = Ffmpeg::find_in(None, None, Some(OsStr::new("/nowhere")), python).unwrap();
        assert_eq!(found.program(), binaries.join("ffmpeg-linux-x86_64-v7"));
        std::fs::write(folder.path().join("ffmpeg"), b"").unwrap();
        let found = Ffmpeg::find_in(None, None, Some(folder.path().as_os_str()), python).unwrap();
        assert_eq!(found.program(), folder.path().join("ffmpeg"));
    }
}
