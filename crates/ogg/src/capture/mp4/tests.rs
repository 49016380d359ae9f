use std::io::Cursor;

use proptest::prelude::*;

use super::*;

const BFRAMES: &[u8] = include_bytes!("../../../tests/data/capture/bframes.mp4");
const FRAGMENTED: &[u8] = include_bytes!("../../../tests/data/capture/fragmented.mp4");
const VP9: &[u8] = include_bytes!("../../../tests/data/capture/vp9.mp4");

fn parse(bytes: &[u8]) -> Result<VideoTrack, ContainerError> {
    read(&mut Cursor::new(bytes), bytes.len() as u64)
}

fn malformed(bytes: &[u8]) -> Malformed {
    match parse(bytes) {
        Err(ContainerError::Malformed(place)) => place,
        other => panic!("{other:?}"),
    }
}

/// Offset of a box's header, found by its four letters.
fn position_of(bytes: &[u8], kind: [u8; 4]) -> usize {
    bytes.windows(4).position(|window| *window == kind).unwrap() - 4
}

#[test]
fn samples_agree_with_another_reader() {
    for bytes in [BFRAMES, FRAGMENTED, VP9] {
        let ours = parse(bytes).unwrap();
        let theirs = re_mp4::Mp4::read_bytes(bytes).unwrap();
        let track = theirs.tracks().values().next().unwrap();
        assert_eq!(u64::from(ours.ticks_per_second), track.timescale);
        let ours: Vec<_> = ours.samples.iter().map(|s| (s.offset, u64::from(s.size), s.time)).collect();
        let first = track.samples.iter().map(|s| s.composition_timestamp).min().unwrap();
        let theirs: Vec<_> =
            track.samples.iter().map(|s| (s.offset, s.size, s.composition_timestamp - first)).collect();
        assert_eq!(ours, theirs);
    }
}

#[test]
fn presentation_times_of_reordered_pictures_are_even_and_out_of_file_order() {
    let track = parse(BFRAMES).unwrap();
    let mut times: Vec<i64> = track.samples.iter().map(|sample| sample.time).collect();
    assert!(!times.is_sorted());
    times.sort_unstable();
    assert_eq!(times, (0..24).map(|i| i * 512).collect::<Vec<_>>());
}

#[test]
fn the_display_matrix_gives_a_clockwise_turn() {
    // ffmpeg counts counter-clockwise.
    for (bytes, rotation) in [
        (include_bytes!("../../../tests/data/capture/rotated90.mp4").as_slice(), Rotation::ThreeQuarters),
        (include_bytes!("../../../tests/data/capture/rotated180.mp4"), Rotation::Half),
        (include_bytes!("../../../tests/data/capture/rotated270.mp4"), Rotation::Quarter),
        (BFRAMES, Rotation::None),
    ] {
        assert_eq!(parse(bytes).unwrap().rotation, rotation);
    }
}

#[test]
fn a_file_cut_anywhere_is_an_error_at_a_place_inside_it() {
    for bytes in [BFRAMES, FRAGMENTED] {
        for cut in 0..bytes.len() {
            match parse(&bytes[..cut]) {
                Err(ContainerError::Malformed(place)) => assert!(place.position <= cut as u64, "{cut}: {place:?}"),
                // A fragmented file that ends between two of its top-level boxes is a whole, shorter file.
                Ok(track) => {
                    assert_eq!(bytes, FRAGMENTED);
                    assert!(track.samples.iter().all(|s| s.offset + u64::from(s.size) <= cut as u64), "{cut}");
                }
                Err(other) => panic!("{cut}: {other:?}"),
            }
        }
    }
}

#[test]
fn a_cut_file_says_how_much_is_missing() {
    let index = position_of(BFRAMES, *b"moov");
    let place = malformed(&BFRAMES[..index + 100]);
    assert_eq!(place.position, index as u64);
    assert_eq!(place.expected, format!("box 'moov' of {} bytes", BFRAMES.len() - index));
    assert_eq!(place.found, "a file that ends after 100 of them");
    let place = malformed(&BFRAMES[..index]);
    assert_eq!(place.expected, "a 'moov' box (the index) before the end of the file");
}

#[test]
fn something_else_entirely_is_not_an_mp4() {
    let place = malformed(b"\x00\x00\x00\x20what is this, a text file?????");
    assert_eq!((place.position, place.expected.as_str()), (0, "an MP4 file ('ftyp' box)"));
    assert_eq!(malformed(b"").found, "an empty file");
}

/// Overwrites a big-endian number `at` bytes after a box's header.
fn with_u32(kind: [u8; 4], at: usize, value: u32) -> Vec<u8> {
    let mut bytes = BFRAMES.to_vec();
    let start = position_of(&bytes, kind) + 8 + at;
    bytes[start..start + 4].copy_from_slice(&value.to_be_bytes());
    bytes
}

#[test]
fn each_damaged_table_is_named() {
    let cases = [
        (with_u32(*b"stsz", 8, u32::MAX), "sample sizes: at most 24 entries of 4 bytes"),
        (with_u32(*b"stco", 4, 0), "chunks for 24 samples"),
        (with_u32(*b"stco", 8, 0xffff_0000), "video sample 0 of"),
        (with_u32(*b"stts", 8, 3), "decoding times for 24 samples"),
        (with_u32(*b"stsc", 8, 0), "a first chunk of 1"),
        (with_u32(*b"stsc", 16, 7), "sample description 1"),
        (with_u32(*b"mdhd", 12, 0), "a time scale of at least 1 tick per second"),
        (with_u32(*b"tkhd", 40, 0x8000), "a display matrix that turns by 0, 90, 180 or 270 degrees"),
    ];
    for (bytes, expected) in cases {
        let place = malformed(&bytes);
        assert!(place.expected.starts_with(expected), "{place:?} for {expected}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn damaged_bytes_never_panic(
        fragmented in any::<bool>(),
        edits in proptest::collection::vec((0_usize..2700, any::<u8>()), 1..6),
    ) {
        let mut bytes = if fragmented { FRAGMENTED } else { BFRAMES }.to_vec();
        // The index lies at the end of the plain file and around the pictures of the fragmented one.
        let index = if fragmented { 0 } else { position_of(&bytes, *b"moov") };
        let room = bytes.len() - index;
        for (at, value) in edits {
            bytes[index + at % room] = value;
        }
        if let Ok(track) = parse(&bytes) {
            prop_assert!(track.samples.iter().all(|s| s.offset + u64::from(s.size) <= bytes.len() as u64));
        }
    }
}
