//! `ogg pose`: how well a network sees, and what it sees.

mod eval;
mod labels;
mod mp4;
mod paint;
mod scores;
mod stages;
mod video;

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};
use pose::{Estimator, Region, RegionOptions};

use crate::cell::open_network;
use crate::config;
use crate::error::Error;

/// Score a pose network, or draw what it finds.
#[derive(Debug, Subcommand)]
pub enum PoseCommand {
    /// Score a network against labels: OKS average precision and recall as COCO counts them, PCK, and time per stage.
    Eval(EvalArgs),
    /// Draw what a network finds into a video or into pictures.
    Video(VideoArgs),
}

/// Which network, and what runs it.
#[derive(Debug, Clone, Args)]
pub struct NetworkArgs {
    /// The network: a model card, an .onnx file, or `builtin:NAME`.
    #[arg(long, value_name = "CARD", default_value = "builtin:ogg-lite")]
    pub model: String,
    /// Where the weights a card names are looked for.
    #[arg(long, value_name = "FOLDER")]
    pub weights: Option<PathBuf>,
    /// ONNX Runtime's shared library, or `tract`; looked for where absent.
    #[arg(long, value_name = "FILE")]
    pub onnxruntime: Option<String>,
    /// Who executes the network; one that is not there is an error.
    #[arg(long, default_value = "cpu", value_parser = ["cpu", "openvino", "cuda", "tensorrt"])]
    pub provider: String,
    /// Threads within one operation.
    #[arg(long, value_name = "N", default_value_t = 2)]
    pub threads: usize,
    /// Look at the whole picture, or follow one person from picture to picture; as the card says where absent.
    #[arg(long)]
    pub region: Option<RegionChoice>,
    /// Look at every picture a second time, mirrored, and take the mean of both answers: more exact, and twice the work.
    #[arg(long)]
    pub mirror: bool,
}

/// Where a network looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RegionChoice {
    /// At all of the picture.
    Full,
    /// Around the person of the picture before.
    Track,
}

impl NetworkArgs {
    fn open(&self) -> Result<Estimator, Error> {
        let settings = config::Pose {
            card: self.model.clone(),
            weights_dir: self.weights.clone(),
            onnxruntime: self.onnxruntime.clone(),
            provider: self.provider.clone(),
            threads: self.threads,
            mirror: self.mirror,
        };
        let (model, runtime) = open_network(&settings)?;
        let region = match self.region {
            None => model.card.region(),
            Some(RegionChoice::Full) => Region::Full,
            Some(RegionChoice::Track) => Region::Track,
        };
        let estimator = Estimator::with_region(&model, &runtime, region, RegionOptions::default())?;
        Ok(if self.mirror { estimator.mirrored()? } else { estimator })
    }
}

/// What `ogg pose eval` compares.
#[derive(Debug, Clone, Args)]
pub struct EvalArgs {
    /// Labels: a COCO keypoint file (.json; `extras.json` beside it gives true places of covered joints), or a table (.csv)
    /// with `camera`, `frame` and columns such as `rsho_u_px` and `rsho_v_px`.
    #[arg(long, value_name = "FILE")]
    pub data: PathBuf,
    /// Folder of the pictures; for a table, of one video or one folder of pictures per camera. The folder of the labels where
    /// absent.
    #[arg(long, value_name = "FOLDER")]
    pub images: Option<PathBuf>,
    #[command(flatten)]
    pub network: NetworkArgs,
    /// Standard deviation of each keypoint for OKS, in the order of the labels, separated by commas; COCO's where absent.
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub sigmas: Option<Vec<f64>>,
    /// Only the first pictures.
    #[arg(long, value_name = "N")]
    pub limit: Option<usize>,
    /// Write the report as JSON, too.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// The `ffmpeg` program for codecs other than H.264.
    #[arg(long, value_name = "PROGRAM")]
    pub ffmpeg: Option<PathBuf>,
}

/// What `ogg pose video` draws.
#[derive(Debug, Clone, Args)]
pub struct VideoArgs {
    /// A video file, or a folder of pictures.
    pub input: PathBuf,
    /// Where to draw: a file .mp4 (H.264), or a folder for one PNG per picture.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    #[command(flatten)]
    pub network: NetworkArgs,
    /// Which arm of the worker is drawn with its gates; the right one where absent.
    #[arg(long, default_value = "right")]
    pub side: config::Side,
    /// Frames per second of a folder of pictures.
    #[arg(long, value_name = "HZ")]
    pub fps: Option<f64>,
    /// Write the people of each picture as one line of JSON, too.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Only the first pictures.
    #[arg(long, value_name = "N")]
    pub limit: Option<usize>,
    /// The `ffmpeg` program for codecs other than H.264.
    #[arg(long, value_name = "PROGRAM")]
    pub ffmpeg: Option<PathBuf>,
}

pub(super) fn run(command: &PoseCommand) -> Result<(), Error> {
    match command {
        PoseCommand::Eval(args) => eval::run(args),
        PoseCommand::Video(args) => video::run(args),
    }
}

/// What a file that is to be written could not be.
fn unwritable(path: &std::path::Path) -> impl FnOnce(std::io::Error) -> Error {
    let path = path.to_owned();
    move |source| Error::File { path, expected: "a place that can be written", source }
}
