//! Whole files in, frames out.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::*;

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/capture").join(name)
}

fn frames(name: &str) -> Vec<Frame> {
    let mut source = open(&data(name), &OpenOptions::default()).unwrap();
    let mut frames = Vec::new();
    while let Some(frame) = source.next_frame().unwrap() {
        frames.push(frame);
    }
    frames
}

fn failure(path: &Path, options: &OpenOptions) -> String {
    match open(path, options) {
        Err(error) => error.to_string(),
        Ok(mut source) => loop {
            match source.next_frame() {
                Ok(Some(_)) => {}
                Ok(None) => panic!("{} gave no error", path.display()),
                Err(error) => break error.to_string(),
            }
        },
    }
}

/// Coding noise of the clips at their quality, in code values.
const CODING_NOISE: i32 = 6;

#[track_caller]
fn assert_colour(frame: &Frame, x: u32, y: u32, wanted: [u8; 3]) {
    let got = frame.image.get_pixel(x, y).0;
    for (got, wanted) in got.iter().zip(wanted) {
        assert!((i32::from(*got) - i32::from(wanted)).abs() <= CODING_NOISE, "({x}, {y}): {got} for {wanted}");
    }
}

/// The picture that `make.py` draws.
fn assert_picture(frame: &Frame, index: u64) {
    assert_colour(frame, 16, 30, [40 + 8 * index as u8; 3]);
    assert_colour(frame, 48, 8, [255, 0, 0]);
    assert_colour(frame, 48, 24, [0, 255, 0]);
    assert_colour(frame, 48, 40, [0, 0, 255]);
    assert_colour(frame, 3, 3, [255; 3]);
}

#[test]
fn a_stream_with_reordered_pictures_comes_whole_in_order_and_with_its_times() {
    for name in ["bframes.mp4", "fragmented.mp4"] {
        let frames = frames(name);
        assert_eq!(frames.len(), 24);
        for (index, frame) in (0_u64..).zip(&frames) {
            assert_eq!((frame.sequence, frame.captured), (index, Duration::from_millis(40 * index)));
            assert_picture(frame, index);
        }
    }
}

#[test]
fn full_range_of_another_standard_gives_the_same_colours() {
    let frames = frames("full601.mp4");
    assert_eq!(frames.len(), 4);
    for (index, frame) in (0..).zip(&frames) {
        assert_picture(frame, index);
    }
}

#[test]
fn rotation_is_applied_to_pixels_and_size() {
    for (name, size, mark, red) in [
        ("rotated90.mp4", (48, 64), (3, 60), (8, 16)),
        ("rotated180.mp4", (64, 48), (60, 44), (16, 40)),
        ("rotated270.mp4", (48, 64), (44, 3), (40, 48)),
    ] {
        let source = open(&data(name), &OpenOptions::default()).unwrap();
        assert_eq!((source.info().width, source.info().height), size, "{name}");
        let frame = &frames(name)[0];
        assert_eq!(frame.image.dimensions(), size);
        assert_colour(frame, mark.0, mark.1, [255; 3]);
        assert_colour(frame, red.0, red.1, [255, 0, 0]);
    }
}

#[test]
fn the_source_states_rate_count_and_decoder() {
    let source = open(&data("bframes.mp4"), &OpenOptions::default()).unwrap();
    let info = source.info();
    assert_eq!((info.width, info.height, info.frames), (64, 48, Some(24)));
    assert!((info.rate_hz.unwrap() - 25.0).abs() < 1e-9);
    assert!(!info.live && info.decoder.contains("OpenH264"));
}

#[test]
fn other_codecs_without_ffmpeg_name_the_codec_and_the_remedy() {
    let options = OpenOptions { ffmpeg: Some(PathBuf::from("/nowhere/ffmpeg")), ..OpenOptions::default() };
    for (name, codec) in [("vp9.mp4", "VP9"), ("h264-10bit.mp4", "10-bit 4:2:2 H.264")] {
        let message = failure(&data(name), &options);
        assert!(message.contains(&format!("{name}: {codec} is decoded by an ffmpeg program")), "{message}");
        assert!(message.contains("--ffmpeg names /nowhere/ffmpeg, which is not a file"), "{message}");
    }
}

#[test]
fn other_codecs_are_decoded_where_there_is_an_ffmpeg_program() {
    let Ok(ffmpeg) = Ffmpeg::find(None) else {
        // Nothing to decode with; the test above covers this machine.
        return;
    };
    let mut source = ffmpeg.open(&data("vp9.mp4"), 1).unwrap();
    assert_eq!((source.info().width, source.info().height), (64, 48));
    for index in 0..10 {
        let frame = source.next_frame().unwrap().unwrap();
        assert_eq!((frame.sequence, frame.camera), (index, 1));
        assert!(frame.captured.abs_diff(Duration::from_millis(40 * index)) < Duration::from_micros(10));
        assert_picture(&frame, index);
    }
    assert!(source.next_frame().unwrap().is_none());
    let text = tempfile::NamedTempFile::with_suffix(".mkv").unwrap();
    let message = ffmpeg.open(text.path(), 0).unwrap_err().to_string();
    assert!(message.contains("after 0 frames"), "{message}");
}

#[test]
fn a_missing_file_is_named() {
    let message = failure(Path::new("/nowhere/film.mp4"), &OpenOptions::default());
    assert!(message.starts_with("/nowhere/film.mp4: cannot read: "), "{message}");
}

#[test]
fn a_cut_file_is_refused_before_its_first_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.mp4");
    let whole = std::fs::read(data("bframes.mp4")).unwrap();
    std::fs::write(&path, &whole[..900]).unwrap();
    let message = open(&path, &OpenOptions::default()).err().unwrap().to_string();
    assert!(message.contains("cut.mp4: byte "), "{message}");
    assert!(message.contains("expected box 'mdat' of "), "{message}");
}

#[test]
fn a_damaged_picture_ends_the_source_with_its_frame_and_place() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.mp4");
    let mut bytes = std::fs::read(data("bframes.mp4")).unwrap();
    let pictures = bytes.windows(4).position(|window| window == b"mdat").unwrap() + 4;
    // Noise over the middle of the pictures; the index stays whole.
    for (at, byte) in bytes[pictures + 500..pictures + 700].iter_mut().enumerate() {
        *byte = (at * 97 + 13) as u8;
    }
    std::fs::write(&path, &bytes).unwrap();
    let message = failure(&path, &OpenOptions::default());
    assert!(message.contains("damaged.mp4: ") && message.contains("expected "), "{message}");
}

#[test]
fn a_file_that_is_no_video_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("notes.mp4");
    std::fs::write(&path, "these are notes, not a film").unwrap();
    let message = failure(&path, &OpenOptions::default());
    assert!(message.contains("notes.mp4: byte 0: expected "), "{message}");
}

#[test]
fn a_capture_thread_delivers_the_last_set_and_then_the_end() {
    let source = open(&data("bframes.mp4"), &OpenOptions::default()).unwrap();
    let view = MultiView::new(vec![source]).unwrap();
    let capture = Capture::spawn(view, Instant::now(), Pace::AsFastAsPossible).unwrap();
    let mut taken = 0;
    let mut last = None;
    loop {
        match capture.latest().take(Duration::from_mins(1)) {
            Wait::Item(set) => {
                taken += 1;
                last = Some(set.sequence);
            }
            Wait::Ended(End::Finished) => break,
            other => panic!("{other:?}"),
        }
    }
    let stats = capture.stats();
    assert_eq!((stats.published, stats.views[0].used, last), (24, 24, Some(23)));
    assert_eq!(taken + stats.dropped, 24);
}

#[test]
fn a_capture_thread_delivers_the_error_of_its_source() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.png"), std::fs::read(data("origin.toml")).unwrap()).unwrap();
    let picture = image::RgbImage::new(2, 2);
    picture.save(folder.path().join("a.png")).unwrap();
    std::fs::write(folder.path().join("b.png"), b"not a picture").unwrap();
    let source = open(folder.path(), &OpenOptions::default()).unwrap();
    let view = MultiView::new(vec![source]).unwrap();
    let capture = Capture::spawn(view, Instant::now(), Pace::AsFastAsPossible).unwrap();
    let end = loop {
        match capture.latest().take(Duration::from_mins(1)) {
            Wait::Item(set) => assert_eq!(set.sequence, 0),
            Wait::Ended(end) => break end,
            Wait::Empty => panic!("the thread hangs"),
        }
    };
    let End::Failed(error) = end else { panic!("{end:?}") };
    assert!(error.to_string().contains("b.png: expected a JPEG or PNG picture"), "{error}");
}
