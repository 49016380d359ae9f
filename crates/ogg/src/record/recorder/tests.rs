use std::io::{Cursor, SeekFrom};

use image::RgbImage;
use mcap::MessageStream;

use super::super::sample::{
    CameraInfo, FramePose, JointStream, JointValue, KeypointState, Level, Metric, PixelPoint, Skeleton, SpacePoint,
};
use super::*;

/// A memory file that another thread may look at, and that refuses to grow past a size.
#[derive(Debug, Clone)]
struct SharedFile {
    bytes: Arc<Mutex<Cursor<Vec<u8>>>>,
    room: usize,
}

impl SharedFile {
    fn new(room: usize) -> Self {
        Self { bytes: Arc::default(), room }
    }
}

impl Write for SharedFile {
    fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        let mut bytes = self.bytes.lock().unwrap();
        if bytes.position() as usize + data.len() > self.room {
            return Err(io::Error::from(io::ErrorKind::StorageFull));
        }
        bytes.write(data)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for SharedFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.bytes.lock().unwrap().seek(to)
    }
}

fn quiet_disk() -> Disk {
    Disk { sync: Box::new(|| Ok(())), free_bytes: Box::new(|| None) }
}

fn joints(position: f64) -> Sample {
    let joint = JointValue { name: "joint1".to_owned(), position: Some(position), ..JointValue::default() };
    Sample::Joints(JointStream::Measured, vec![joint])
}

/// One sample of every kind, for a rig of two cameras.
fn everything() -> Vec<Sample> {
    let image = Arc::new(RgbImage::from_fn(64, 48, |x, y| image::Rgb([x as u8 * 3, y as u8 * 5, 90])));
    let pixel =
        |name: &str, x_px| PixelPoint { name: name.to_owned(), x_px, y_px: 9.0, state: KeypointState::Measured };
    let info = CameraInfo {
        width_px: 64,
        height_px: 48,
        focal_px: [60.0, 60.0],
        centre_px: [31.5, 23.5],
        distortion: Vec::new(),
    };
    let skeleton = Skeleton {
        points: vec![pixel("right_elbow", 3.0), pixel("right_wrist", 8.0)],
        limbs: vec![(0, 1)],
        followed: true,
    };
    let space = |name: &str, state| SpacePoint {
        name: name.to_owned(),
        position_m: [0.1, 0.2, 0.3],
        covariance_m2: Some([1e-4, 0.0, 0.0, 0.0, 1e-4, 0.0, 0.0, 0.0, 1e-4]),
        state,
    };
    vec![
        Sample::Calibration { camera: 0, info },
        Sample::Image { camera: 0, image: Arc::clone(&image) },
        Sample::Image { camera: 1, image },
        Sample::Annotations { camera: 1, size_px: (64, 48), people: vec![skeleton] },
        Sample::Keypoints {
            frame: "world".to_owned(),
            points: vec![space("right_wrist", KeypointState::Measured), space("right_elbow", KeypointState::Lost)],
        },
        Sample::Transforms(vec![FramePose {
            parent: "world".to_owned(),
            child: "human/right_wrist".to_owned(),
            translation_m: [0.1, 0.2, 0.3],
            rotation_xyzw: [0.0, 0.0, 0.0, 1.0],
        }]),
        joints(0.5),
        Sample::Joints(JointStream::Setpoint, Vec::new()),
        Sample::Joints(JointStream::Target, Vec::new()),
        Sample::Metrics(vec![Metric { name: "age".to_owned(), value: 12.5, unit: "ms".to_owned() }]),
        Sample::Log { level: Level::Info, name: "follow".to_owned(), message: "engaged".to_owned() },
    ]
}

fn run_info() -> RunInfo {
    RunInfo {
        facts: BTreeMap::from([("git".to_owned(), "abc".to_owned())]),
        urdf: Some("<robot name=\"r\"/>".to_owned()),
        config: Some("rate_hz = 250".to_owned()),
    }
}

#[test]
fn every_kind_of_sample_is_read_back_by_the_mcap_library() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let options = RecorderOptions { cameras: 2, start_unix_ns: 1_000, ..RecorderOptions::default() };
    let recorder = Recorder::create(&path, options, &run_info()).unwrap();
    for (index, sample) in (0..).zip(everything()) {
        recorder.sink().put(Duration::from_nanos(index), sample);
    }
    let status = recorder.finish().unwrap();
    assert_eq!((status.messages, status.dropped_images, status.dropped_samples), (13, 0, 0));

    let bytes = std::fs::read(&path).unwrap();
    let mut seen = BTreeMap::new();
    for message in MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let schema = message.channel.schema.clone().unwrap();
        seen.insert(message.channel.topic.clone(), (schema.name.clone(), schema.encoding.clone(), message.log_time));
        if message.channel.topic == "/camera_2" {
            use prost::Message as _;
            let picture = foxglove::messages::CompressedImage::decode(&*message.data).unwrap();
            assert_eq!((picture.format.as_str(), picture.frame_id.as_str()), ("jpeg", "camera_2_color_optical_frame"));
            assert_eq!(image::load_from_memory(&picture.data).unwrap().width(), 64);
        }
    }
    let topics: Vec<(&str, &str)> =
        seen.iter().map(|(topic, (schema, ..))| (topic.as_str(), schema.as_str())).collect();
    assert_eq!(
        topics,
        [
            ("/camera_1", "foxglove.CompressedImage"),
            ("/camera_1/calibration", "foxglove.CameraCalibration"),
            ("/camera_2", "foxglove.CompressedImage"),
            ("/camera_2/annotations", "foxglove.ImageAnnotations"),
            ("/human/keypoints", "ogg.Keypoints"),
            ("/human/keypoints3d", "foxglove.PosesInFrame"),
            ("/joint_states", "foxglove.JointStates"),
            ("/log", "foxglove.Log"),
            ("/metrics", "ogg.Metrics"),
            ("/robot_description", "std_msgs/msg/String"),
            ("/setpoints", "foxglove.JointStates"),
            ("/targets", "foxglove.JointStates"),
            ("/tf", "foxglove.FrameTransforms"),
        ]
    );
    assert_eq!(seen["/robot_description"].1, "ros2msg");
    assert_eq!(seen["/log"].2, 1_010);
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert_eq!((summary.attachment_indexes.len(), summary.metadata_indexes.len()), (2, 1));
    assert_eq!(summary.stats.unwrap().message_count, 13);
}

#[test]
fn an_existing_file_is_not_overwritten() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let error = Recorder::create(file.path(), RecorderOptions::default(), &RunInfo::default()).unwrap_err();
    assert!(error.to_string().contains("cannot create the recording"), "{error}");
}

#[test]
fn a_full_disk_is_an_error_of_finish_and_stops_nobody() {
    let file = SharedFile::new(20_000);
    let options =
        RecorderOptions { compression: Compression::Off, queue_samples: 100_000, ..RecorderOptions::default() };
    let recorder =
        Recorder::on_disk(file.clone(), quiet_disk(), Path::new("full.mcap"), options, &RunInfo::default()).unwrap();
    let sink = recorder.sink();
    for tick in 0..50_000 {
        sink.put(Duration::from_millis(tick), joints(0.1));
    }
    let error = recorder.finish().unwrap_err();
    assert!(error.to_string().starts_with("full.mcap: cannot write the recording"), "{error}");
    let status = sink.status();
    assert!(status.failed);
    assert!(status.lost_after_failure > 0);
}

#[test]
fn recording_stops_with_a_whole_file_before_the_disk_is_full() {
    let file = SharedFile::new(usize::MAX);
    let disk = Disk { sync: Box::new(|| Ok(())), free_bytes: Box::new(|| Some(999)) };
    let options =
        RecorderOptions { sync_every: Duration::ZERO, reserve_bytes: Some(1_000), ..RecorderOptions::default() };
    let recorder = Recorder::on_disk(file.clone(), disk, Path::new("run.mcap"), options, &RunInfo::default()).unwrap();
    let sink = recorder.sink();
    sink.put(Duration::ZERO, joints(0.1));
    while !sink.status().failed {
        thread::yield_now();
    }
    let message = recorder.finish().unwrap_err().to_string();
    assert_eq!(message, "run.mcap: recording stopped: expected at least 1000 bytes free on the disk, got 999");
    let bytes = file.bytes.lock().unwrap().get_ref().clone();
    assert!(mcap::Summary::read(&bytes).unwrap().is_some());
}

#[test]
fn a_picture_without_pixels_is_counted_as_dropped() {
    let file = SharedFile::new(usize::MAX);
    let recorder =
        Recorder::on_disk(file, quiet_disk(), Path::new("x"), RecorderOptions::default(), &RunInfo::default()).unwrap();
    recorder.sink().put(Duration::ZERO, Sample::Image { camera: 0, image: Arc::default() });
    assert_eq!(recorder.finish().unwrap().dropped_images, 1);
}

#[test]
fn a_dropped_recorder_still_ends_its_file() {
    let file = SharedFile::new(usize::MAX);
    let recorder =
        Recorder::on_disk(file.clone(), quiet_disk(), Path::new("x"), RecorderOptions::default(), &RunInfo::default())
            .unwrap();
    recorder.sink().put(Duration::ZERO, joints(0.1));
    drop(recorder);
    let bytes = file.bytes.lock().unwrap().get_ref().clone();
    assert_eq!(mcap::Summary::read(&bytes).unwrap().unwrap().stats.unwrap().message_count, 1);
}

#[test]
fn samples_reach_the_file_without_an_end_within_the_flush_interval() {
    let file = SharedFile::new(usize::MAX);
    let options = RecorderOptions { flush_every: Duration::from_millis(1), ..RecorderOptions::default() };
    let recorder = Recorder::on_disk(file.clone(), quiet_disk(), Path::new("x"), options, &RunInfo::default()).unwrap();
    let sink = recorder.sink();
    let readable = || {
        let bytes = file.bytes.lock().unwrap().get_ref().clone();
        MessageStream::new_with_options(&bytes, mcap::read::Options::IgnoreEndMagic.into())
            .unwrap()
            .map_while(Result::ok)
            .count()
    };
    let started = Instant::now();
    while readable() == 0 {
        sink.put(Duration::ZERO, joints(0.1));
        thread::yield_now();
        assert!(started.elapsed() < Duration::from_mins(1), "nothing reaches the file");
    }
    recorder.finish().unwrap();
}
