//! A card together with its weights: found, and checked byte for byte.

use std::{
    fmt::Write as _,
    fs::File,
    io::Read as _,
    path::{Path, PathBuf},
};

use sha2::{Digest as _, Sha256};

use super::ModelCard;
use crate::{Error, Result};

/// Larger files are refused unread. The largest network of this field that runs in real time has 60 MiB.
const MAX_BYTES: u64 = 512 << 20;

/// Name and text of every card that is compiled in.
pub const BUILTIN_CARDS: &[(&str, &str)] = &[
    ("ogg-lite", OWN.0),
    ("movenet-thunder", include_str!("../../cards/movenet-thunder.toml")),
    ("movenet-thunder-trunk", include_str!("../../cards/movenet-thunder-trunk.toml")),
    ("movenet-lightning", include_str!("../../cards/movenet-lightning.toml")),
    ("movenet-multipose", include_str!("../../cards/movenet-multipose.toml")),
    ("blazepose-full", include_str!("../../cards/blazepose-full.toml")),
    ("openpose-mobilenet-v2-small", include_str!("../../cards/openpose-mobilenet-v2-small.toml")),
];

/// The project's own network, in this program: card and weights.
const OWN: (&str, &[u8]) = (include_str!("../../models/ogg-lite.toml"), include_bytes!("../../models/ogg-lite.onnx"));

/// Where the weights of a model are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Weights {
    /// In a file.
    File(PathBuf),
    /// In this program.
    Embedded(&'static [u8]),
}

/// A card and where its weights are.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// The card.
    pub card: ModelCard,
    /// Its weights.
    pub weights: Weights,
}

impl Default for Model {
    /// `ogg-lite`, the project's own network, whose weights are in this program.
    fn default() -> Self {
        let card = ModelCard::parse(OWN.0, Path::new("ogg-lite.toml"))
            .unwrap_or_else(|e| panic!("compiled-in card is broken: {e}"));
        Self { card, weights: Weights::Embedded(OWN.1) }
    }
}

impl Model {
    /// Finds a model by what a user names it.
    ///
    /// - `x.toml` is a card; its weights lie beside it or in one of `weights_dirs`, in this order.
    /// - `x.onnx` is a network; its card is `x.toml` beside it, or the compiled-in card with its SHA-256.
    /// - anything else, with or without `builtin:` before it, is the name of a compiled-in card; its weights lie in one of
    ///   `weights_dirs`, but those of `ogg-lite` are in this program.
    ///
    /// The weights are only hashed by [`Model::read_weights`] (and here, where the hash is the only way to a card).
    ///
    /// # Errors
    /// [`Error::Read`], [`Error::NotFound`], [`Error::NoCard`], or what is wrong with the card.
    pub fn find(named: &Path, weights_dirs: &[PathBuf]) -> Result<Self> {
        match named.extension().and_then(|e| e.to_str()) {
            Some("toml") => {
                let card = ModelCard::load(named)?;
                let mut dirs = vec![named.parent().unwrap_or(Path::new("")).to_owned()];
                dirs.extend_from_slice(weights_dirs);
                Self::with_weights(card, &dirs)
            }
            Some("onnx") => {
                let beside = named.with_extension("toml");
                if beside.is_file() {
                    let card = ModelCard::load(&beside)?;
                    return Ok(Self { card, weights: Weights::File(named.to_owned()) });
                }
                let sha256 = hex_sha256(&read_network(named)?);
                let card = Self::builtin_cards()
                    .into_iter()
                    .find(|c| c.sha256 == sha256)
                    .ok_or_else(|| Error::NoCard { path: named.to_owned(), card: beside, sha256 })?;
                Ok(Self { card, weights: Weights::File(named.to_owned()) })
            }
            _ => {
                let text = named.to_string_lossy();
                let name = text.strip_prefix("builtin:").unwrap_or(&text);
                let card = Self::builtin_cards().into_iter().find(|c| c.name == name).ok_or_else(|| {
                    let names: Vec<String> = BUILTIN_CARDS.iter().map(|(name, _)| format!("builtin:{name}")).collect();
                    Error::UnknownModel { named: text.clone().into_owned(), known: names.join(", ") }
                })?;
                let own = Self::default();
                if card == own.card { Ok(own) } else { Self::with_weights(card, weights_dirs) }
            }
        }
    }

    /// The cards that are compiled in.
    ///
    /// # Panics
    /// Never: every compiled-in card is parsed by a test.
    pub fn builtin_cards() -> Vec<ModelCard> {
        BUILTIN_CARDS
            .iter()
            .map(|(name, text)| {
                ModelCard::parse(text, Path::new(name)).unwrap_or_else(|e| panic!("compiled-in card is broken: {e}"))
            })
            .collect()
    }

    /// A short name of the weights for messages.
    pub fn path(&self) -> PathBuf {
        match &self.weights {
            Weights::File(path) => path.clone(),
            Weights::Embedded(_) => PathBuf::from(format!("built-in {}", self.card.file)),
        }
    }

    /// The weights, whole, after their SHA-256 was compared with the card. What is hashed is what is returned.
    ///
    /// # Errors
    /// [`Error::Read`], [`Error::RefusedFile`], [`Error::WrongHash`].
    pub fn read_weights(&self) -> Result<Vec<u8>> {
        let bytes = match &self.weights {
            Weights::File(path) => read_network(path)?,
            Weights::Embedded(bytes) => bytes.to_vec(),
        };
        let got = hex_sha256(&bytes);
        if got != self.card.sha256 {
            return Err(Error::WrongHash { path: self.path(), expected: self.card.sha256.clone(), got });
        }
        Ok(bytes)
    }

    fn with_weights(card: ModelCard, dirs: &[PathBuf]) -> Result<Self> {
        match dirs.iter().map(|d| d.join(&card.file)).find(|p| p.is_file()) {
            Some(path) => Ok(Self { card, weights: Weights::File(path) }),
            None => Err(Error::NotFound { what: "network", file: card.file, searched: dirs.to_vec() }),
        }
    }
}

fn read_network(path: &Path) -> Result<Vec<u8>> {
    let read_error = |source| Error::Read { path: path.to_owned(), source };
    let mut file = File::open(path).map_err(read_error)?;
    let meta = file.metadata().map_err(read_error)?;
    if !meta.is_file() {
        return Err(Error::RefusedFile { path: path.to_owned(), reason: "expected a regular file".to_owned() });
    }
    if meta.len() > MAX_BYTES {
        let reason = format!("expected at most {MAX_BYTES} bytes, got {}", meta.len());
        return Err(Error::RefusedFile { path: path.to_owned(), reason });
    }
    let mut bytes = Vec::with_capacity(meta.len() as usize);
    file.read_to_end(&mut bytes).map_err(read_error)?;
    Ok(bytes)
}

fn hex_sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().fold(String::with_capacity(64), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}
