//! H.264 MP4 files, decoded in this process by OpenH264.
//!
//! The decoder is made without a flush after each picture: with one, streams that reorder pictures (B-frames) fail after a few
//! pictures. It therefore gives pictures in order of presentation with some delay, and the rest when the file ends.
//! Presentation times come from the container: those of the pictures fed so far wait in a heap, and each picture that comes
//! out takes the smallest. 8-bit 4:2:0 progressive streams only; [`super::open`] sends the others to `ffmpeg`.
//!
//! Cost: one decode and one conversion per frame (see `cargo xtask bench capture`); memory: one coded picture, the
//! decoder's reference pictures, and the frames that come out together at the end of the file.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use image::{RgbImage, imageops};
use openh264::OpenH264API;
use openh264::decoder::{DecodedYUV, Decoder, DecoderConfig, Flush};
use openh264::formats::YUVSource;

use super::mp4::{AvcConfig, Codec, Rotation, Sample, VideoTrack};
use super::sps::{self, SequenceFacts};
use super::yuv::{ColourSpace, Planes, rgb_from_yuv420};
use super::{Error, Frame, Source, SourceInfo};

/// A picture that left the decoder: its presentation time in ticks and its pixels.
type Decoded = (i64, RgbImage);

/// Frames of one H.264 MP4 file, in order of presentation.
pub(super) struct H264File {
    path: PathBuf,
    file: File,
    info: SourceInfo,
    camera: usize,
    decoder: Decoder,
    track: VideoTrack,
    avc: AvcConfig,
    colour: ColourSpace,
    next_sample: usize,
    waiting_times: BinaryHeap<Reverse<i64>>,
    ready: VecDeque<Decoded>,
    given: u64,
    done: bool,
    packet: Vec<u8>,
}

/// Whether this process can decode the track; if not, what the stream is, in words.
pub(super) fn supported(track: &VideoTrack) -> Result<(AvcConfig, Option<SequenceFacts>), String> {
    let avc = match &track.codec {
        Codec::Avc(avc) => avc.clone(),
        Codec::Other(code) => return Err(super::codec_name(*code)),
    };
    let facts = avc.sequence_sets.first().and_then(|set| sps::parse(set));
    if let Some(facts) = facts {
        if facts.chroma_format != 1 || facts.bit_depth_luma != 8 || facts.bit_depth_chroma != 8 {
            let chroma = ["grey", "4:2:0", "4:2:2", "4:4:4"].get(facts.chroma_format as usize).unwrap_or(&"?");
            return Err(format!("{}-bit {chroma} H.264", facts.bit_depth_luma));
        }
        if !facts.frames_only {
            return Err("interlaced H.264".to_owned());
        }
    }
    Ok((avc, facts))
}

impl H264File {
    pub(super) fn new(
        path: &Path,
        file: File,
        track: VideoTrack,
        avc: AvcConfig,
        facts: Option<SequenceFacts>,
        camera: usize,
    ) -> Result<Self, Error> {
        let config = DecoderConfig::new().flush_after_decode(Flush::NoFlush);
        let decoder = Decoder::with_api_config(OpenH264API::from_source(), config).map_err(|error| Error::Decode {
            path: path.to_owned(),
            frame: 0,
            position: 0,
            message: error.to_string(),
        })?;
        let nclx = track.colour;
        let colour = ColourSpace::from_codes(
            facts.and_then(|facts| facts.matrix).or_else(|| nclx.and_then(|nclx| u8::try_from(nclx.matrix).ok())),
            facts.and_then(|facts| facts.full_range).or_else(|| nclx.map(|nclx| nclx.full_range)),
            u32::from(track.height),
        );
        let (width, height) = (u32::from(track.width), u32::from(track.height));
        let (width, height) = match track.rotation {
            Rotation::None | Rotation::Half => (width, height),
            Rotation::Quarter | Rotation::ThreeQuarters => (height, width),
        };
        let info = SourceInfo {
            name: path.display().to_string(),
            width,
            height,
            rate_hz: track.rate_hz(),
            frames: Some(track.samples.len() as u64),
            decoder: "OpenH264, in this process".to_owned(),
            live: false,
        };
        Ok(Self {
            path: path.to_owned(),
            file,
            info,
            camera,
            decoder,
            track,
            avc,
            colour,
            next_sample: 0,
            waiting_times: BinaryHeap::new(),
            ready: VecDeque::new(),
            given: 0,
            done: false,
            packet: Vec::new(),
        })
    }

    /// Decodes one more coded picture, or drains the decoder after the last one.
    fn advance(&mut self) -> Result<(), Error> {
        let Some(&sample) = self.track.samples.get(self.next_sample) else {
            return self.drain();
        };
        let index = self.next_sample;
        self.next_sample += 1;
        self.read_packet(sample, index)?;
        self.waiting_times.push(Reverse(sample.time));
        let failed = |message: String| Error::Decode {
            path: self.path.clone(),
            frame: index as u64,
            position: sample.offset,
            message,
        };
        let picture = self.decoder.decode(&self.packet).map_err(|error| failed(decoder_words(&error)))?;
        if let Some(picture) = picture {
            let image = upright(convert(&picture, self.colour)?, self.track.rotation);
            let Some(Reverse(time)) = self.waiting_times.pop() else {
                return Err(failed("more pictures than were fed".to_owned()));
            };
            self.ready.push_back((time, image));
        }
        Ok(())
    }

    fn drain(&mut self) -> Result<(), Error> {
        self.done = true;
        let position = self.track.samples.last().map_or(0, |sample| sample.offset);
        let failed = |message: String| Error::Decode {
            path: self.path.clone(),
            frame: self.track.samples.len() as u64,
            position,
            message,
        };
        let rest = self.decoder.flush_remaining().map_err(|error| failed(decoder_words(&error)))?;
        for picture in &rest {
            let image = upright(convert(picture, self.colour)?, self.track.rotation);
            let Some(Reverse(time)) = self.waiting_times.pop() else {
                return Err(failed("more pictures than were fed".to_owned()));
            };
            self.ready.push_back((time, image));
        }
        let (expected, got) = (self.track.samples.len() as u64, self.given + self.ready.len() as u64);
        if expected != got {
            return Err(Error::FrameCount { path: self.path.clone(), expected, got });
        }
        Ok(())
    }

    /// Reads a sample and replaces its length fields by start codes; the first one is preceded by the parameter sets.
    fn read_packet(&mut self, sample: Sample, index: usize) -> Result<(), Error> {
        const START_CODE: [u8; 4] = [0, 0, 0, 1];
        let mut raw = vec![0; sample.size as usize];
        self.file
            .seek(SeekFrom::Start(sample.offset))
            .and_then(|_| self.file.read_exact(&mut raw))
            .map_err(|source| Error::Read { path: self.path.clone(), source })?;
        self.packet.clear();
        if index == 0 {
            for set in self.avc.sequence_sets.iter().chain(&self.avc.picture_sets) {
                self.packet.extend_from_slice(&START_CODE);
                self.packet.extend_from_slice(set);
            }
        }
        let width = self.avc.length_bytes;
        let mut rest = raw.as_slice();
        while !rest.is_empty() {
            let unit = rest.split_at_checked(width).and_then(|(length, tail)| {
                let length = length.iter().fold(0_usize, |value, &byte| value << 8 | usize::from(byte));
                tail.split_at_checked(length)
            });
            let Some((unit, tail)) = unit else {
                let position = sample.offset + (raw.len() - rest.len()) as u64;
                return Err(Error::Container {
                    path: self.path.clone(),
                    position,
                    expected: format!("a NAL unit within frame {index} ({} bytes left)", rest.len()),
                    found: "a longer length field".to_owned(),
                });
            };
            self.packet.extend_from_slice(&START_CODE);
            self.packet.extend_from_slice(unit);
            rest = tail;
        }
        Ok(())
    }
}

impl Source for H264File {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn next_frame(&mut self) -> Result<Option<Frame>, Error> {
        while self.ready.is_empty() && !self.done {
            if let Err(error) = self.advance() {
                self.done = true;
                self.ready.clear();
                return Err(error);
            }
        }
        let Some((ticks, image)) = self.ready.pop_front() else { return Ok(None) };
        let sequence = self.given;
        self.given += 1;
        let expected = (self.info.width, self.info.height);
        if image.dimensions() != expected {
            self.done = true;
            self.ready.clear();
            return Err(Error::SizeChanged {
                path: self.path.clone(),
                frame: sequence,
                expected,
                got: image.dimensions(),
            });
        }
        let captured = ticks_to_time(ticks, self.track.ticks_per_second);
        Ok(Some(Frame { image: Arc::new(image), captured, media_time: captured, sequence, camera: self.camera }))
    }
}

fn convert(picture: &DecodedYUV<'_>, colour: ColourSpace) -> Result<RgbImage, Error> {
    let (width, height) = picture.dimensions();
    let (y_stride, uv_stride, _) = picture.strides();
    let planes = Planes {
        y: picture.y(),
        u: picture.u(),
        v: picture.v(),
        y_stride: y_stride as u32,
        uv_stride: uv_stride as u32,
        width: width as u32,
        height: height as u32,
    };
    rgb_from_yuv420(planes, colour)
}

fn upright(image: RgbImage, rotation: Rotation) -> RgbImage {
    match rotation {
        Rotation::None => image,
        Rotation::Quarter => imageops::rotate90(&image),
        Rotation::Half => imageops::rotate180(&image),
        Rotation::ThreeQuarters => imageops::rotate270(&image),
    }
}

/// The decoder's error without its empty fields: `DECODING_STATE` bits say what is missing.
fn decoder_words(error: &openh264::Error) -> String {
    const STATES: [(i64, &str); 6] = [
        (0x01, "a picture that is not complete"),
        (0x02, "a missing reference picture"),
        (0x04, "a damaged bit stream"),
        (0x08, "a damaged dependency layer"),
        (0x10, "no parameter sets before the picture"),
        (0x40, "a reference list with holes"),
    ];
    let code = error.native_code();
    let words: Vec<&str> = STATES.iter().filter(|(bit, _)| code & bit != 0).map(|&(_, words)| words).collect();
    if words.is_empty() { format!("decoder error {code:#x}") } else { words.join(", ") }
}

/// Ticks of a track as a span, rounded down to a nanosecond; negative ticks count as zero.
fn ticks_to_time(ticks: i64, per_second: u32) -> Duration {
    let ticks = u64::try_from(ticks).unwrap_or(0);
    let per_second = u64::from(per_second.max(1));
    let nanos = (ticks % per_second) * 1_000_000_000 / per_second;
    Duration::new(ticks / per_second, nanos as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_become_seconds_without_drift() {
        assert_eq!(ticks_to_time(15_360 * 7 + 256, 15_360), Duration::new(7, 16_666_666));
        assert_eq!(ticks_to_time(-5, 15_360), Duration::ZERO);
    }
}
