//! The one error type of this crate.

use std::path::PathBuf;

/// What can go wrong between a picture and its keypoints.
///
/// Four families: a model or card that is not what it says, an environment without the asked library or provider, input
/// that cannot be processed, and parameters outside their interval. "Nobody in the picture" is no error.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The reason given by the operating system.
        source: std::io::Error,
    },
    /// A file that was looked for in several places is in none of them.
    #[error("{what} {file:?} not found; looked in {}", list(searched))]
    NotFound {
        /// What the file is, such as "network".
        what: &'static str,
        /// Its name.
        file: String,
        /// The folders that were searched.
        searched: Vec<PathBuf>,
    },
    /// A model card is not valid TOML, has an unknown key, or lacks one.
    #[error("{}: {detail}", path.display())]
    CardSyntax {
        /// The card.
        path: PathBuf,
        /// Parser message with line, column and key.
        detail: String,
    },
    /// A model card is well formed but contradicts itself.
    #[error("{}: {field}: expected {expected}, got {got}", path.display())]
    CardValue {
        /// The card.
        path: PathBuf,
        /// Dotted name of the field.
        field: &'static str,
        /// What is allowed.
        expected: String,
        /// What the card says.
        got: String,
    },
    /// No card is known for a network file.
    #[error(
        "{}: no card: expected a file {}, or one of the networks known by SHA-256; this one is {sha256}",
        path.display(), card.display()
    )]
    NoCard {
        /// The network.
        path: PathBuf,
        /// Where its card was expected.
        card: PathBuf,
        /// Digest of the file.
        sha256: String,
    },
    /// The network file is not the one that its card describes.
    #[error("{}: SHA-256 expected {expected}, got {got}", path.display())]
    WrongHash {
        /// The network.
        path: PathBuf,
        /// Digest in the card.
        expected: String,
        /// Digest of the file.
        got: String,
    },
    /// The network file is refused before it is parsed.
    #[error("{}: {reason}", path.display())]
    RefusedFile {
        /// The network.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The runtime cannot load the network: corrupt, or with an operation that it lacks.
    #[error("{}: {backend} cannot load the network: {detail}", path.display())]
    BadNetwork {
        /// The network.
        path: PathBuf,
        /// The runtime that was asked.
        backend: String,
        /// Its message.
        detail: String,
    },
    /// An input or output of the network differs from the card.
    #[error("{}: {tensor}: expected {expected}, got {got}", path.display())]
    WrongShape {
        /// The network.
        path: PathBuf,
        /// Name of the tensor.
        tensor: String,
        /// Shape and type by the card.
        expected: String,
        /// Shape and type of the network.
        got: String,
    },
    /// The network ran and failed.
    #[error("{}: {backend} failed in the network: {detail}", path.display())]
    Inference {
        /// The network.
        path: PathBuf,
        /// The runtime.
        backend: String,
        /// Its message.
        detail: String,
    },
    /// The network answered with NaN or an infinity.
    #[error("{}: {tensor}: element {index} is {value}", path.display())]
    NonFinite {
        /// The network.
        path: PathBuf,
        /// Name of the tensor.
        tensor: String,
        /// Where in the tensor.
        index: usize,
        /// The value.
        value: f32,
    },
    /// An ONNX Runtime library that was asked for by name cannot be used.
    #[error("onnx runtime {} ({origin}): {detail}", path.display())]
    Library {
        /// The library.
        path: PathBuf,
        /// Who asked for it.
        origin: &'static str,
        /// Why it cannot be used.
        detail: String,
    },
    /// A process holds one runtime; another one was asked for later.
    #[error("this process already runs {active}, and {asked} was asked for")]
    RuntimeConflict {
        /// What runs.
        active: String,
        /// What was asked for.
        asked: String,
    },
    /// An execution provider that was asked for is not there.
    #[error("execution provider {provider} is not available in {backend}: {detail}")]
    Provider {
        /// The asked provider.
        provider: &'static str,
        /// The runtime.
        backend: String,
        /// Why not.
        detail: String,
    },
    /// A picture is empty, or its buffer has another length than its size says.
    #[error("image {width}x{height}: expected {expected} bytes, got {got}")]
    Image {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// Bytes that the size asks for.
        expected: usize,
        /// Bytes that were given.
        got: usize,
    },
    /// A parameter is outside its interval.
    #[error("{field}: expected {expected}, got {got}")]
    Parameter {
        /// Name with unit.
        field: &'static str,
        /// Allowed interval.
        expected: &'static str,
        /// Given value.
        got: String,
    },
    /// Arrays that belong together have different lengths.
    #[error("{what}: expected {expected}, got {got}")]
    Length {
        /// Which array.
        what: &'static str,
        /// Length that was expected.
        expected: usize,
        /// Length that was given.
        got: usize,
    },
    /// A model is named that is neither a file nor compiled in.
    #[error("{named}: expected a card (.toml), a network (.onnx), or one of {known}")]
    UnknownModel {
        /// The name.
        named: String,
        /// The compiled-in cards.
        known: String,
    },
}

/// Result with this crate's [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

fn list(paths: &[PathBuf]) -> String {
    if paths.is_empty() {
        return "no folder at all".to_owned();
    }
    paths.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", ")
}
