//! The recording of a run: a handle for the loops, and three threads behind it.
//!
//! The writer encodes and writes, and ends a chunk on time; pictures are compressed in a second thread and the disk is asked to keep its promise in a
//! third, for either may take longer than a chunk may wait.

use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use mcap::McapError;

use super::Error;
use super::encode::Encoder;
use super::queue::{Queue, Taken, Work};
use super::sample::{Sample, Stamped};
use super::writer::{Compression, McapFile};

/// Settings of a recording.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct RecorderOptions {
    /// Number of cameras in the rig; decides the topics of their pictures.
    pub cameras: usize,
    /// Start of the run, nanoseconds since 1970; the times of samples count from it.
    pub start_unix_ns: u64,
    /// Chunk compression.
    pub compression: Compression,
    /// Longest side of a recorded picture; larger ones are reduced by a whole factor.
    pub max_image_side_px: u32,
    /// JPEG quality, 1 to 100.
    pub jpeg_quality: u8,
    /// A chunk ends at least this often: what a killed process can lose.
    pub flush_every: Duration,
    /// The file is brought to the disk at least this often: what a power cut can lose.
    pub sync_every: Duration,
    /// Recording stops when less than this is free; `None` does not look.
    pub reserve_bytes: Option<u64>,
    /// Samples other than pictures that may wait: a second of a 500 Hz loop with eight samples per tick.
    pub queue_samples: usize,
    /// Pictures that may wait.
    pub queue_images: usize,
}

impl Default for RecorderOptions {
    fn default() -> Self {
        Self {
            cameras: 1,
            start_unix_ns: 0,
            compression: Compression::default(),
            max_image_side_px: 960,
            jpeg_quality: 80,
            flush_every: Duration::from_millis(200),
            sync_every: Duration::from_secs(1),
            reserve_bytes: Some(1_000_000_000),
            queue_samples: 4096,
            queue_images: 8,
        }
    }
}

/// What is known of a run when it starts. It stands at the front of the file, so a cut file has it too.
#[derive(Debug, Clone, Default)]
pub struct RunInfo {
    /// Facts by name, written as metadata record `ogg`: git revision, execution provider, model hash, versions …
    pub facts: BTreeMap<String, String>,
    /// URDF of the robot: `/robot_description` and attachment `robot.urdf`.
    pub urdf: Option<String>,
    /// Configuration in force: attachment `config.toml`.
    pub config: Option<String>,
}

/// Counts of a recording.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecorderStatus {
    /// Messages in the file.
    pub messages: u64,
    /// Pictures that were given up because the disk or the processor could not keep up.
    pub dropped_images: u64,
    /// Other samples that were given up.
    pub dropped_samples: u64,
    /// Samples that came after a failed write.
    pub lost_after_failure: u64,
    /// True once a write has failed.
    pub failed: bool,
}

#[derive(Debug)]
struct Shared {
    queue: Queue,
    messages: AtomicU64,
    lost: AtomicU64,
    failed: AtomicBool,
    /// What the disk thread found, for the writer to act on.
    disk_failure: Mutex<Option<Failure>>,
    outcome: Mutex<Option<Result<u64, Failure>>>,
}

#[derive(Debug)]
enum Failure {
    Write(McapError),
    DiskFull { reserve_bytes: u64, free_bytes: u64 },
}

impl From<McapError> for Failure {
    fn from(source: McapError) -> Self {
        Self::Write(source)
    }
}

/// Where loops put what should be recorded. Cheap to clone; never waits for the disk.
#[derive(Debug, Clone)]
pub struct RecordSink {
    shared: Arc<Shared>,
}

impl RecordSink {
    /// Records a sample taken `at` this time since the start of the run.
    pub fn put(&self, at: Duration, sample: Sample) {
        self.shared.queue.put(Stamped { at, sample });
    }

    /// Waits until half of the queue is free: for work without a clock, which would otherwise outrun the disk. Returns at
    /// once when the recording has ended.
    pub fn wait_for_room(&self) {
        while !self.shared.queue.has_room() {
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Counts so far.
    pub fn status(&self) -> RecorderStatus {
        let (dropped_samples, dropped_images) = self.shared.queue.dropped();
        RecorderStatus {
            messages: self.shared.messages.load(Ordering::Relaxed),
            dropped_images,
            dropped_samples,
            lost_after_failure: self.shared.lost.load(Ordering::Relaxed),
            failed: self.shared.failed.load(Ordering::Relaxed),
        }
    }
}

/// A recording that is being written.
///
/// [`finish`](Self::finish) ends it and returns what went wrong; a recorder that is only dropped ends the file too, and logs the error.
///
/// ```
/// use std::time::Duration;
/// use ogg::record::{JointStream, JointValue, Recorder, RecorderOptions, RunInfo, Sample};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let path = tempfile::tempdir()?.keep().join("run.mcap");
/// let recorder = Recorder::create(&path, RecorderOptions::default(), &RunInfo::default())?;
/// let joint = JointValue { name: "joint1".into(), position: Some(0.25), ..JointValue::default() };
/// recorder.sink().put(Duration::from_millis(4), Sample::Joints(JointStream::Measured, vec![joint]));
/// assert_eq!(recorder.finish()?.messages, 1);
///
/// let recording = ogg::record::open(&path)?;
/// assert_eq!(recording.joint_states[0].joints[0].position, Some(0.25));
/// # std::fs::remove_dir_all(path.parent().unwrap())?;
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Recorder {
    path: PathBuf,
    sink: RecordSink,
    threads: Vec<JoinHandle<()>>,
}

impl Recorder {
    /// Makes the file (an existing one is not overwritten), writes facts, attachments and robot description, and starts the threads.
    ///
    /// # Errors
    ///
    /// [`Error::Create`], [`Error::Write`], [`Error::Spawn`].
    pub fn create(path: &Path, options: RecorderOptions, info: &RunInfo) -> Result<Self, Error> {
        let file = OpenOptions::new()
            .write(true)
            .create_new(true)
            .open(path)
            .map_err(|source| Error::Create { path: path.to_owned(), source })?;
        let same = file.try_clone().map_err(|source| Error::Create { path: path.to_owned(), source })?;
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_owned();
        let disk = Disk { sync: Box::new(move || same.sync_data()), free_bytes: Box::new(move || free_bytes(&folder)) };
        Self::on_disk(BufWriter::new(file), disk, path, options, info)
    }

    fn on_disk<W: Write + Seek + Send + 'static>(
        file: W,
        disk: Disk,
        path: &Path,
        options: RecorderOptions,
        info: &RunInfo,
    ) -> Result<Self, Error> {
        let write = |source| Error::Write { path: path.to_owned(), source };
        let file = begin(file, &options, info).map_err(write)?;
        let shared = Arc::new(Shared {
            queue: Queue::new(options.queue_samples.max(1), options.queue_images.max(1)),
            messages: AtomicU64::new(file.messages()),
            lost: AtomicU64::new(0),
            failed: AtomicBool::new(false),
            disk_failure: Mutex::new(None),
            outcome: Mutex::new(None),
        });
        let mut recorder =
            Self { path: path.to_owned(), sink: RecordSink { shared: Arc::clone(&shared) }, threads: Vec::new() };
        let encoder = Encoder {
            cameras: options.cameras,
            max_image_side_px: options.max_image_side_px,
            jpeg_quality: options.jpeg_quality.clamp(1, 100),
            start_unix_ns: options.start_unix_ns,
        };
        let (theirs, compressor) = (Arc::clone(&shared), encoder.clone());
        recorder.start("recorder-images", move || compress(&compressor, &theirs.queue))?;
        let (theirs, every, reserve) = (Arc::clone(&shared), options.sync_every, options.reserve_bytes);
        let sync = Arc::new(disk);
        let disk = Arc::clone(&sync);
        recorder.start("recorder-disk", move || watch(&disk, &theirs, every, reserve))?;
        recorder.start("recorder", move || {
            let outcome = write_all(file, &encoder, &shared, options.flush_every)
                .and_then(|messages| (sync.sync)().map(|()| messages).map_err(|error| McapError::from(error).into()));
            if outcome.is_err() {
                shared.failed.store(true, Ordering::Relaxed);
                discard(&shared);
            }
            *shared.outcome.lock().unwrap_or_else(PoisonError::into_inner) = Some(outcome);
        })?;
        Ok(recorder)
    }

    fn start(&mut self, name: &str, work: impl FnOnce() + Send + 'static) -> Result<(), Error> {
        let thread =
            thread::Builder::new().name(name.to_owned()).spawn(work).map_err(|source| Error::Spawn { source })?;
        self.threads.push(thread);
        Ok(())
    }

    /// The handle to record with.
    pub fn sink(&self) -> RecordSink {
        self.sink.clone()
    }

    /// Where the file is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes what is still waiting, ends the file and brings it to the disk.
    ///
    /// # Errors
    ///
    /// [`Error::Write`] or [`Error::DiskFull`] if the recording stopped early: it then holds everything before; [`Error::Panicked`].
    pub fn finish(mut self) -> Result<RecorderStatus, Error> {
        self.end()?;
        Ok(self.sink.status())
    }

    fn end(&mut self) -> Result<(), Error> {
        if self.threads.is_empty() {
            return Ok(());
        }
        self.sink.shared.queue.close();
        let panicked = self.threads.drain(..).map(JoinHandle::join).filter(Result::is_err).count() > 0;
        let outcome = self.sink.shared.outcome.lock().unwrap_or_else(PoisonError::into_inner).take();
        match outcome {
            Some(Err(Failure::Write(source))) => Err(Error::Write { path: self.path.clone(), source }),
            Some(Err(Failure::DiskFull { reserve_bytes, free_bytes })) => {
                Err(Error::DiskFull { path: self.path.clone(), reserve_bytes, free_bytes })
            }
            Some(Ok(_)) if !panicked => Ok(()),
            _ => Err(Error::Panicked { path: self.path.clone() }),
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        if let Err(error) = self.end() {
            tracing::error!("{error}");
        }
    }
}

fn begin<W: Write + Seek>(disk: W, options: &RecorderOptions, info: &RunInfo) -> Result<McapFile<W>, McapError> {
    let mut file = McapFile::new(disk, options.compression)?;
    let start = options.start_unix_ns;
    if !info.facts.is_empty() {
        file.metadata("ogg", info.facts.clone())?;
    }
    if let Some(config) = &info.config {
        file.attach(start, "config.toml", "application/toml", config.as_bytes())?;
    }
    if let Some(urdf) = &info.urdf {
        file.attach(start, "robot.urdf", "application/xml", urdf.as_bytes())?;
        file.robot_description(start, urdf)?;
    }
    file.flush()?;
    Ok(file)
}

/// The writer: ends when the queue is closed and empty, or at the first failure.
fn write_all<W: Write + Seek>(
    mut file: McapFile<W>,
    encoder: &Encoder,
    shared: &Shared,
    flush_every: Duration,
) -> Result<u64, Failure> {
    let mut flushed = Instant::now();
    let mut waiting = false;
    loop {
        let (at, messages) = match shared.queue.take(flush_every) {
            Taken::Work(Work::Picture(at, messages)) => (at, messages),
            // Only pictures can fail to encode.
            Taken::Work(Work::Sample(stamped)) => {
                let Ok(messages) = encoder.encode(stamped.at, &stamped.sample) else {
                    unreachable!("it is no picture")
                };
                (stamped.at, messages)
            }
            Taken::Nothing => (Duration::ZERO, Vec::new()),
            Taken::Closed => return Ok(file.finish()?),
        };
        for message in &messages {
            file.write(encoder.log_time_ns(at), message)?;
            waiting = true;
        }
        shared.messages.store(file.messages(), Ordering::Relaxed);
        if waiting && flushed.elapsed() >= flush_every {
            file.flush()?;
            (flushed, waiting) = (Instant::now(), false);
        }
        if let Some(failure) = shared.disk_failure.lock().unwrap_or_else(PoisonError::into_inner).take() {
            file.finish()?;
            return Err(failure);
        }
    }
}

/// Compresses pictures until the queue is closed.
fn compress(encoder: &Encoder, queue: &Queue) {
    while let Some(stamped) = queue.take_image() {
        // A picture of zero or absurd size cannot be encoded and counts as dropped.
        queue.give_back(stamped.at, encoder.encode(stamped.at, &stamped.sample).ok());
    }
}

/// Synchronises the file and looks at the free space, until the queue is closed or something is wrong.
fn watch(disk: &Disk, shared: &Shared, every: Duration, reserve_bytes: Option<u64>) {
    // A period of nothing would keep a core busy.
    while !shared.queue.wait_closed(every.max(Duration::from_millis(1))) {
        let failure = match ((disk.sync)(), reserve_bytes, (disk.free_bytes)()) {
            (Err(error), ..) => Failure::Write(McapError::from(error)),
            (Ok(()), Some(reserve_bytes), Some(free_bytes)) if free_bytes < reserve_bytes => {
                Failure::DiskFull { reserve_bytes, free_bytes }
            }
            _ => continue,
        };
        *shared.disk_failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(failure);
        return;
    }
}

/// After a failure: empties the queue until it is closed, so that memory stays bounded and the loops see the count.
fn discard(shared: &Shared) {
    loop {
        match shared.queue.take(Duration::from_secs(1)) {
            Taken::Work(_) => {
                shared.lost.fetch_add(1, Ordering::Relaxed);
            }
            Taken::Nothing => {}
            Taken::Closed => return,
        }
    }
}

/// What the recording asks of the disk besides writing.
struct Disk {
    /// Brings what was written to the disk.
    sync: Box<dyn Fn() -> io::Result<()> + Send + Sync>,
    /// Bytes free to this user, where the system tells.
    free_bytes: Box<dyn Fn() -> Option<u64> + Send + Sync>,
}

#[cfg(unix)]
fn free_bytes(folder: &Path) -> Option<u64> {
    let facts = rustix::fs::statvfs(folder).ok()?;
    Some(facts.f_bavail.saturating_mul(facts.f_frsize))
}

#[cfg(not(unix))]
fn free_bytes(_folder: &Path) -> Option<u64> {
    None
}

#[cfg(test)]
mod tests;
