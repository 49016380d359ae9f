use std::io::Cursor;
use std::sync::LazyLock;

use proptest::prelude::*;

use super::super::encode::Encoder;
use super::super::sample::Sample;
use super::super::writer::{Compression, McapFile};
use super::*;

const FLUSHES: usize = 6;
const PER_FLUSH: usize = 40;

fn setpoint(tick: u64) -> Sample {
    let joint = JointValue {
        name: "joint2".to_owned(),
        position: Some(tick as f64 * 0.01),
        velocity: Some(1.0),
        ..JointValue::default()
    };
    Sample::Joints(JointStream::Setpoint, vec![joint])
}

fn keypoints() -> Sample {
    let point = |name: &str, state| SpacePoint {
        name: name.to_owned(),
        position_m: [0.25, -0.5, 1.0],
        covariance_m2: (state == KeypointState::Measured).then_some([1e-4, 0.0, 0.0, 0.0, 2e-4, 0.0, 0.0, 0.0, 3e-4]),
        state,
    };
    let points = vec![point("right_wrist", KeypointState::Measured), point("right_elbow", KeypointState::Inferred)];
    Sample::Keypoints { frame: "world".to_owned(), points }
}

/// A recording with known flush points: its bytes, and the size of the file after each flush.
fn recording(compression: Compression) -> (Vec<u8>, Vec<usize>) {
    let encoder = Encoder { cameras: 1, max_image_side_px: 64, jpeg_quality: 80, start_unix_ns: 100 };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut file = McapFile::new(File::create(&path).unwrap(), compression).unwrap();
    file.metadata("ogg", BTreeMap::from([("provider".to_owned(), "CPU".to_owned())])).unwrap();
    file.attach(100, "config.toml", "application/toml", b"rate_hz = 250").unwrap();
    let mut sizes = Vec::new();
    let mut tick = 0;
    for _ in 0..FLUSHES {
        for _ in 0..PER_FLUSH {
            let at = Duration::from_millis(tick);
            for message in encoder.encode(at, &setpoint(tick)).unwrap() {
                file.write(encoder.log_time_ns(at), &message).unwrap();
            }
            tick += 1;
        }
        file.flush().unwrap();
        sizes.push(std::fs::metadata(&path).unwrap().len() as usize);
    }
    file.finish().unwrap();
    (std::fs::read(&path).unwrap(), sizes)
}

static ZSTD: LazyLock<(Vec<u8>, Vec<usize>)> = LazyLock::new(|| recording(Compression::Zstd));

fn read(bytes: &[u8]) -> Result<Recording, Error> {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    open(file.path())
}

#[test]
fn values_come_back_as_they_were_recorded() {
    for compression in [Compression::Zstd, Compression::Lz4, Compression::Off] {
        let (bytes, _) = recording(compression);
        let recording = read(&bytes).unwrap();
        assert_eq!(recording.cut, None);
        assert_eq!(recording.facts["provider"], "CPU");
        assert_eq!(recording.attachments["config.toml"], b"rate_hz = 250");
        assert_eq!(recording.setpoints.len(), FLUSHES * PER_FLUSH);
        let tenth = &recording.setpoints[10];
        assert_eq!((tenth.time_ns, tenth.joints[0].name.as_str()), (10_000_100, "joint2"));
        assert_eq!((tenth.joints[0].position, tenth.joints[0].effort), (Some(0.1), None));
        assert_eq!(recording.duration(), Duration::from_millis(239));
        assert_eq!(
            recording.topics,
            [Topic {
                name: "/setpoints".to_owned(),
                schema: "foxglove.JointStates".to_owned(),
                encoding: "protobuf".to_owned(),
                messages: 240,
            }]
        );
    }
}

#[test]
fn keypoints_keep_their_state_and_covariance() {
    let encoder = Encoder { cameras: 1, max_image_side_px: 64, jpeg_quality: 80, start_unix_ns: 0 };
    let mut buffer = Cursor::new(Vec::new());
    let mut file = McapFile::new(&mut buffer, Compression::Off).unwrap();
    for message in encoder.encode(Duration::ZERO, &keypoints()).unwrap() {
        file.write(0, &message).unwrap();
    }
    file.finish().unwrap();
    let recording = read(buffer.get_ref()).unwrap();
    let Sample::Keypoints { frame, points } = keypoints() else { unreachable!() };
    assert_eq!(recording.keypoints, [KeypointRecord { time_ns: 0, frame, points }]);
}

#[test]
fn a_file_that_is_no_recording_is_refused() {
    for bytes in [b"".as_slice(), b"not a recording at all", &ZSTD.0[..6]] {
        let message = read(bytes).unwrap_err().to_string();
        assert!(message.contains("expected an MCAP file"), "{message}");
    }
    let message = open(Path::new("/nowhere/run.mcap")).unwrap_err().to_string();
    assert!(message.starts_with("/nowhere/run.mcap: cannot read the recording"), "{message}");
}

#[test]
fn a_chunk_that_damage_hides_ends_the_reading_before_it() {
    let (mut bytes, sizes) = ZSTD.clone();
    // The second chunk begins where the first flush ended; 0x10 is an opcode of no version yet.
    assert_eq!(bytes[sizes[1]], op::CHUNK);
    bytes[sizes[1]] = 0x10;
    let recording = read(&bytes).unwrap();
    assert_eq!(recording.setpoints.len(), 2 * PER_FLUSH);
    let cut = recording.cut.unwrap();
    assert!(cut.contains("/setpoints: message 80 is missing, 120 follows"), "{cut}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn a_file_cut_anywhere_gives_everything_up_to_the_last_flush(cut in 100_usize..100_000) {
        let (bytes, sizes) = &*ZSTD;
        let cut = 100 + cut % (bytes.len() - 100);
        let flushed = sizes.iter().filter(|&&size| size <= cut).count();
        match read(&bytes[..cut]) {
            Ok(recording) => {
                prop_assert!(recording.cut.is_some());
                prop_assert!(recording.setpoints.len() >= flushed * PER_FLUSH, "{cut}: {}", recording.setpoints.len());
                prop_assert_eq!(recording.setpoints.len() % PER_FLUSH, 0);
            }
            Err(error) => prop_assert!(flushed == 0, "{cut}: {error}"),
        }
    }

    #[test]
    fn damage_never_panics_and_never_gives_wrong_values(
        edits in proptest::collection::vec((0_usize..100_000, any::<u8>()), 1..5),
    ) {
        let mut bytes = ZSTD.0.clone();
        for (at, value) in edits {
            let at = at % bytes.len();
            bytes[at] = value;
        }
        if let Ok(recording) = read(&bytes) {
            for (tick, record) in recording.setpoints.iter().enumerate() {
                prop_assert_eq!(record.joints[0].position, Some(tick as f64 * 0.01));
            }
        }
    }
}
