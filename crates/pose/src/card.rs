//! Model cards: small TOML files that say what a network eats, what it answers, and whose it is.
//!
//! A card names the weights file and its SHA-256, so a card and another file of the same name never meet unnoticed. Every
//! key is known: a typing error is an error that names the key, the line and the file. The folder `cards/` holds one card
//! for each network that the project knows; they are also compiled in.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::{Error, Part, Result, Skeleton};

mod check;
mod model;

pub use model::{BUILTIN_CARDS, Model, Weights};

/// Everything about a network that its file does not say.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct ModelCard {
    /// Short name, such as `movenet-thunder`.
    pub name: String,
    /// File name of the weights, without a folder.
    pub file: String,
    /// SHA-256 of the weights file, 64 hexadecimal digits.
    pub sha256: String,
    /// Licence of the weights, as an SPDX expression where there is one.
    pub licence: String,
    /// Where the weights come from.
    pub source: String,
    /// What the network answers with.
    pub output: OutputKind,
    /// Order of the keypoints.
    pub skeleton: Skeleton,
    /// Keypoints below this score are left out of the answer, 0 to 1.
    #[serde(default = "default_min_score")]
    pub min_score: f32,
    /// Where the next picture is looked at; by default single-person networks follow the person, the others look at
    /// the whole picture.
    pub region: Option<Region>,
    /// The input tensor.
    pub input: InputSpec,
    /// Only for `output = "openpose"`: the maps.
    pub openpose: Option<OpenPoseSpec>,
    /// Only for `output = "movenet"` and `"movenet-multi"`: the table of keypoints.
    pub movenet: Option<MoveNetSpec>,
    /// Only for `output = "blazepose"`: the landmarks.
    pub blazepose: Option<BlazePoseSpec>,
    /// Free text for people: data, training, scores, limits.
    pub about: Option<About>,
}

/// What a network answers with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum OutputKind {
    /// Part confidence maps and part affinity fields: any number of people.
    #[serde(rename = "openpose")]
    OpenPose,
    /// One person, `1 x 1 x J x 3` of (y, x, score), y and x as fractions of the input.
    #[serde(rename = "movenet")]
    MoveNet,
    /// Up to P people, `1 x P x (3 J + 5)`: J times (y, x, score), then box and score.
    #[serde(rename = "movenet-multi")]
    MoveNetMulti,
    /// One person, 39 landmarks of (x, y, z, visibility logit, presence logit) in input pixels.
    #[serde(rename = "blazepose")]
    BlazePose,
}

/// Which part of the next picture a network sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Region {
    /// All of it, letterboxed.
    Full,
    /// A square around the person of the picture before; all of it until there is one.
    Track,
}

/// Memory order of an image tensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// Batch, channel, row, column.
    Nchw,
    /// Batch, row, column, channel.
    Nhwc,
}

/// Element type of the input tensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ElementType {
    /// 32-bit float.
    Float32,
    /// 32-bit integer; the normalised value is rounded.
    Int32,
    /// 8-bit unsigned integer; the normalised value is rounded and saturates.
    Uint8,
}

/// Order of the colour channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ColourOrder {
    /// Red, green, blue.
    Rgb,
    /// Blue, green, red.
    Bgr,
}

/// The input tensor: `value = (pixel - mean) * scale` per channel, pixels 0 to 255.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputSpec {
    /// Name of the tensor.
    pub name: String,
    /// Width, px.
    pub width: usize,
    /// Height, px.
    pub height: usize,
    /// True when the network takes any size divisible by the stride: then `width * height` is an area, and the shape
    /// follows the picture.
    #[serde(default)]
    pub dynamic: bool,
    /// Memory order.
    pub layout: Layout,
    /// Element type.
    pub dtype: ElementType,
    /// Order of the channels.
    pub colour: ColourOrder,
    /// Subtracted from each channel, in the order of `colour`.
    #[serde(default)]
    pub mean: [f32; 3],
    /// Multiplies each channel afterwards.
    #[serde(default = "ones")]
    pub scale: [f32; 3],
    /// Pixel value outside the picture, 0 to 255.
    #[serde(default)]
    pub pad: u8,
}

/// Where the maps of an OpenPose network are, and which limbs the fields describe.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OpenPoseSpec {
    /// Input pixels per map cell.
    pub stride: usize,
    /// Memory order of the maps.
    pub layout: Layout,
    /// Part confidence maps, one channel for each keypoint of the skeleton; a background map may follow.
    pub pcm: MapSpec,
    /// Part affinity fields.
    pub paf: MapSpec,
    /// Limbs in the order in which they are assembled.
    pub limbs: Vec<Limb>,
    /// A maximum of a confidence map below this is no keypoint, 0 to 1.
    #[serde(default = "default_peak_threshold")]
    pub peak_threshold: f32,
    /// A field sample below this does not support a limb, 0 to 1.
    #[serde(default = "default_paf_threshold")]
    pub paf_threshold: f32,
}

/// A run of channels in an output tensor.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapSpec {
    /// Name of the tensor.
    pub output: String,
    /// First channel.
    #[serde(default)]
    pub first: usize,
    /// Number of channels.
    pub channels: usize,
}

/// A limb: two parts, and the channels of its affinity field.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limb {
    /// The part where the field starts.
    pub from: Part,
    /// The part where the field ends.
    pub to: Part,
    /// Channels of the x and y component, counted from the first affinity channel.
    pub paf: [usize; 2],
}

/// Where the keypoints of a MoveNet are.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MoveNetSpec {
    /// Name of the tensor.
    pub output: String,
}

/// Where the answers of a BlazePose are.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlazePoseSpec {
    /// Tensor of 39 landmarks of five numbers.
    pub landmarks: String,
    /// Tensor of one number: the probability that a person is there.
    pub presence: String,
}

/// Free text for people.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct About {
    /// One paragraph.
    #[serde(default)]
    pub description: String,
    /// What it was trained on.
    #[serde(default)]
    pub data: String,
    /// Commands and seeds that made it.
    #[serde(default)]
    pub training: String,
    /// Measured quality, with the set it was measured on.
    #[serde(default)]
    pub scores: String,
    /// What it does not do.
    #[serde(default)]
    pub limits: String,
}

fn default_min_score() -> f32 {
    0.1
}

fn default_peak_threshold() -> f32 {
    0.1
}

fn default_paf_threshold() -> f32 {
    0.05
}

fn ones() -> [f32; 3] {
    [1.0; 3]
}

impl ModelCard {
    /// Reads and checks a card file.
    ///
    /// # Errors
    /// [`Error::Read`], [`Error::CardSyntax`] with line and key, or [`Error::CardValue`].
    pub fn load(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|source| Error::Read { path: path.to_owned(), source })?;
        Self::parse(&text, path)
    }

    /// Checks the text of a card; `path` only names it in errors.
    ///
    /// # Errors
    /// [`Error::CardSyntax`] with line and key, or [`Error::CardValue`].
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let card: Self = toml::from_str(text)
            .map_err(|e| Error::CardSyntax { path: path.to_owned(), detail: e.to_string().trim_end().to_owned() })?;
        card.check(path)?;
        Ok(card)
    }

    /// Where the next picture is looked at.
    pub fn region(&self) -> Region {
        self.region.unwrap_or(match self.output {
            OutputKind::MoveNet | OutputKind::BlazePose => Region::Track,
            OutputKind::OpenPose | OutputKind::MoveNetMulti => Region::Full,
        })
    }

    /// The output tensors that are read, in the order in which the decoder gets them.
    pub(crate) fn output_names(&self) -> Vec<&str> {
        if let Some(spec) = &self.openpose {
            return vec![&spec.pcm.output, &spec.paf.output];
        }
        if let Some(spec) = &self.movenet {
            return vec![&spec.output];
        }
        self.blazepose.iter().flat_map(|spec| [spec.landmarks.as_str(), spec.presence.as_str()]).collect()
    }
}

#[cfg(test)]
mod tests;
