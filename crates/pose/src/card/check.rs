//! What a card may say.

use std::path::{Path, PathBuf};

use super::{ModelCard, OpenPoseSpec, OutputKind};
use crate::{Error, Result, Skeleton};

impl ModelCard {
    pub(super) fn check(&self, path: &Path) -> Result<()> {
        let bad = |field, expected: &str, got: String| {
            Err(Error::CardValue { path: path.to_owned(), field, expected: expected.to_owned(), got })
        };
        if self.file.is_empty() || PathBuf::from(&self.file).file_name().is_none_or(|n| n != self.file.as_str()) {
            return bad("file", "a file name without a folder", format!("{:?}", self.file));
        }
        if self.sha256.len() != 64 || !self.sha256.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b)) {
            return bad("sha256", "64 lower-case hexadecimal digits", format!("{:?}", self.sha256));
        }
        if !(0.0..=1.0).contains(&self.min_score) {
            return bad("min_score", "0 to 1", self.min_score.to_string());
        }
        let input = &self.input;
        for (field, side) in [("input.width", input.width), ("input.height", input.height)] {
            if !(16..=4096).contains(&side) {
                return bad(field, "16 to 4096 px", side.to_string());
            }
        }
        if !input.mean.iter().chain(&input.scale).all(|x| x.is_finite()) || input.scale.contains(&0.0) {
            return bad("input.scale", "finite and not zero", format!("{:?}", input.scale));
        }
        let sections = [
            ("openpose", self.openpose.is_some(), self.output == OutputKind::OpenPose),
            ("movenet", self.movenet.is_some(), matches!(self.output, OutputKind::MoveNet | OutputKind::MoveNetMulti)),
            ("blazepose", self.blazepose.is_some(), self.output == OutputKind::BlazePose),
        ];
        for (field, given, wanted) in sections {
            if given != wanted {
                let expected =
                    if wanted { "a section for this output kind" } else { "no section for this output kind" };
                return bad(field, expected, if given { "a section" } else { "none" }.to_owned());
            }
        }
        match self.output {
            OutputKind::MoveNet | OutputKind::MoveNetMulti if self.skeleton != Skeleton::Coco17 => {
                return bad("skeleton", "coco-17, the only order that MoveNet has", self.skeleton.to_string());
            }
            OutputKind::BlazePose if self.skeleton != Skeleton::MediaPipe33 => {
                return bad("skeleton", "mediapipe-33, the only order that BlazePose has", self.skeleton.to_string());
            }
            _ => {}
        }
        self.openpose.as_ref().map_or(Ok(()), |spec| self.check_openpose(spec, path))
    }

    fn check_openpose(&self, spec: &OpenPoseSpec, path: &Path) -> Result<()> {
        let bad = |field, expected: String, got: String| {
            Err(Error::CardValue { path: path.to_owned(), field, expected, got })
        };
        let sides = [self.input.width, self.input.height];
        if spec.stride == 0 || sides.iter().any(|side| side % spec.stride != 0) {
            return bad("openpose.stride", format!("a divisor of {sides:?}"), spec.stride.to_string());
        }
        let joints = self.skeleton.len();
        if spec.pcm.channels != joints && spec.pcm.channels != joints + 1 {
            let expected = format!("{joints}, or {} with background, for {}", joints + 1, self.skeleton);
            return bad("openpose.pcm.channels", expected, spec.pcm.channels.to_string());
        }
        for (field, t) in
            [("openpose.peak_threshold", spec.peak_threshold), ("openpose.paf_threshold", spec.paf_threshold)]
        {
            if !(t > 0.0 && t < 1.0) {
                return bad(field, "between 0 and 1".to_owned(), t.to_string());
            }
        }
        if spec.limbs.is_empty() {
            return bad("openpose.limbs", "at least one limb".to_owned(), "none".to_owned());
        }
        for limb in &spec.limbs {
            for part in [limb.from, limb.to] {
                if self.skeleton.index_of(part).is_none() {
                    return bad("openpose.limbs", format!("parts of {}", self.skeleton), part.to_string());
                }
            }
            if limb.from == limb.to {
                return bad("openpose.limbs", "two different parts".to_owned(), format!("{} twice", limb.from));
            }
            if limb.paf.iter().any(|c| *c >= spec.paf.channels) || limb.paf[0] == limb.paf[1] {
                let expected = format!("two different channels below {}", spec.paf.channels);
                return bad("openpose.limbs.paf", expected, format!("{:?}", limb.paf));
            }
        }
        Ok(())
    }
}
