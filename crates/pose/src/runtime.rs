//! ONNX Runtime, loaded at run time; or tract, in pure Rust, when there is none.
//!
//! The library is looked for in this order, and the first one that loads serves:
//!
//! 1. the path that was set explicitly,
//! 2. the path of the environment value that the caller passes in,
//! 3. beside the binary,
//! 4. in the `onnxruntime` package of the Python installations that the caller names,
//! 5. where the system's loader finds `libonnxruntime.so`.
//!
//! The first two are wishes: when such a library does not load, that is an error. The others are chances: what was tried
//! and why it did not serve is kept in [`RuntimeInfo::tried`]. When none loads, tract serves, and [`RuntimeInfo`] says so.
//!
//! A process holds one runtime. Loading again with the same wish gives the same one; another wish is an error.

use std::{
    fmt,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

use ort::environment::Environment;

use crate::{Error, Result};

mod inspect;
mod provider;
mod search;

pub use provider::ExecutionProvider;
pub use search::{
    LibraryCandidate, LibraryOrigin, LibrarySearch, ONNXRUNTIME_LIBRARY, onnxruntime_candidates, python_site_packages,
};

/// What computes the network.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Backend {
    /// ONNX Runtime from a shared library.
    OnnxRuntime {
        /// The library.
        library: PathBuf,
        /// How it was found.
        origin: LibraryOrigin,
        /// What the library says of its build.
        build: String,
    },
    /// tract, compiled in.
    Tract,
}

impl fmt::Display for Backend {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OnnxRuntime { library, origin, .. } => {
                write!(f, "ONNX Runtime {} ({})", library.display(), origin.name())
            }
            Self::Tract => f.write_str("tract (pure Rust)"),
        }
    }
}

/// Which library may serve.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum LibraryChoice {
    /// The first of these that loads, else tract. See [`onnxruntime_candidates`].
    Search(Vec<LibraryCandidate>),
    /// tract, whatever else is installed.
    PureRust,
}

/// What a runtime is asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RuntimeOptions {
    /// Which library may serve.
    pub library: LibraryChoice,
    /// Who executes the network.
    pub provider: ExecutionProvider,
    /// Who executes it when `provider` is not there; `None` makes that an error.
    pub fallback: Option<ExecutionProvider>,
    /// Threads for one operation; `None` leaves it to the backend. Ignored by tract, which uses one.
    pub threads: Option<usize>,
    /// Let waiting threads spin between operations: a little faster, and a core is busy all the time.
    pub spin: bool,
}

impl Default for RuntimeOptions {
    /// The system's library if there is one, on the CPU, without spinning.
    fn default() -> Self {
        Self {
            library: LibraryChoice::Search(onnxruntime_candidates(&LibrarySearch {
                system: true,
                ..Default::default()
            })),
            provider: ExecutionProvider::Cpu,
            fallback: None,
            threads: None,
            spin: false,
        }
    }
}

/// A library that was tried and did not serve.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Attempt {
    /// The library.
    pub candidate: LibraryCandidate,
    /// Why not.
    pub reason: String,
}

/// What runs, for logs, recordings and people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RuntimeInfo {
    /// What computes the network.
    pub backend: Backend,
    /// The execution provider that was asked for.
    pub requested: ExecutionProvider,
    /// The one that serves; differs from `requested` only when a fallback was named.
    pub active: ExecutionProvider,
    /// Libraries that were tried before this one and did not serve.
    pub tried: Vec<Attempt>,
}

impl fmt::Display for RuntimeInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, provider {}", self.backend, self.active)?;
        if self.active != self.requested {
            write!(f, " instead of {}", self.requested)?;
        }
        Ok(())
    }
}

/// A loaded runtime; cheap to clone.
#[derive(Debug, Clone)]
pub struct Runtime {
    pub(crate) environment: Environment,
    pub(crate) options: RuntimeOptions,
    info: RuntimeInfo,
}

struct Loaded {
    environment: Environment,
    backend: Backend,
    tried: Vec<Attempt>,
}

static LOADED: Mutex<Option<Loaded>> = Mutex::new(None);
/// The library whose load failed, if one did.
static FAILED: Mutex<Option<String>> = Mutex::new(None);

impl Runtime {
    /// Loads the runtime of this process, or joins the one that is loaded.
    ///
    /// # Errors
    /// [`Error::Library`] when a library that was asked for by path does not load, [`Error::RuntimeConflict`] when
    /// another one already serves, [`Error::Provider`] when the execution provider is not there.
    pub fn load(options: RuntimeOptions) -> Result<Self> {
        let mut slot = LOADED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(loaded) = &*slot {
            check_same_wish(&loaded.backend, &options.library)?;
            return Self::with_provider(loaded, options);
        }
        let loaded = load_backend(&options.library)?;
        tracing::info!(backend = %loaded.backend, "network runtime");
        let runtime = Self::with_provider(&loaded, options);
        *slot = Some(loaded);
        runtime
    }

    /// What runs.
    pub fn info(&self) -> &RuntimeInfo {
        &self.info
    }

    fn with_provider(loaded: &Loaded, options: RuntimeOptions) -> Result<Self> {
        let requested = options.provider;
        let is_there = |p: ExecutionProvider| match loaded.backend {
            Backend::OnnxRuntime { .. } => p.is_available(),
            Backend::Tract => p == ExecutionProvider::Cpu,
        };
        let active = match (is_there(requested), options.fallback) {
            (true, _) => requested,
            (false, Some(fallback)) if is_there(fallback) => fallback,
            (false, fallback) => {
                return Err(Error::Provider {
                    provider: requested.name(),
                    backend: loaded.backend.to_string(),
                    detail: match fallback {
                        Some(fallback) => format!("this library has neither it nor the fallback {fallback}"),
                        None => "this library was built without it, and no fallback is named".to_owned(),
                    },
                });
            }
        };
        let info = RuntimeInfo { backend: loaded.backend.clone(), requested, active, tried: loaded.tried.clone() };
        Ok(Self { environment: loaded.environment.clone(), options, info })
    }
}

fn check_same_wish(active: &Backend, asked: &LibraryChoice) -> Result<()> {
    let conflict = |asked: String| Err(Error::RuntimeConflict { active: active.to_string(), asked });
    match (active, asked) {
        (Backend::OnnxRuntime { .. }, LibraryChoice::PureRust) => conflict(Backend::Tract.to_string()),
        (_, LibraryChoice::PureRust) => Ok(()),
        (backend, LibraryChoice::Search(candidates)) => {
            match (candidates.iter().find(|c| c.origin.is_wish()), backend) {
                (Some(wish), Backend::OnnxRuntime { library, .. }) if *library == wish.path => Ok(()),
                (Some(wish), _) => conflict(format!("ONNX Runtime {}", wish.path.display())),
                (None, _) => Ok(()),
            }
        }
    }
}

fn load_backend(choice: &LibraryChoice) -> Result<Loaded> {
    let mut tried = Vec::new();
    if let LibraryChoice::Search(candidates) = choice {
        for candidate in candidates {
            match load_library(&candidate.path) {
                Ok(environment) => {
                    let backend = Backend::OnnxRuntime {
                        library: candidate.path.clone(),
                        origin: candidate.origin,
                        build: ort::info().to_owned(),
                    };
                    return Ok(Loaded { environment, backend, tried });
                }
                Err(reason) if candidate.origin.is_wish() => {
                    return Err(Error::Library {
                        path: candidate.path.clone(),
                        origin: candidate.origin.name(),
                        detail: reason,
                    });
                }
                Err(reason) => {
                    tracing::debug!(library = %candidate.path.display(), reason, "not usable");
                    tried.push(Attempt { candidate: candidate.clone(), reason });
                }
            }
        }
    }
    ort::set_api(ort_tract::api());
    let environment = ort::init().with_telemetry(false).build().map_err(|e| Error::Provider {
        provider: ExecutionProvider::Cpu.name(),
        backend: Backend::Tract.to_string(),
        detail: e.to_string(),
    })?;
    Ok(Loaded { environment, backend: Backend::Tract, tried })
}

/// Loads a library that passed inspection. `FAILED` keeps a second load away after one that failed; see [`inspect`].
fn load_library(path: &Path) -> Result<Environment, String> {
    let bare = path.parent().is_none_or(|p| p.as_os_str().is_empty());
    if !bare && let Some(defect) = inspect::defect(path, ort::MINOR_VERSION) {
        return Err(defect);
    }
    let mut failed = FAILED.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(earlier) = &*failed {
        return Err(format!("not tried, because {earlier} failed to load in this process"));
    }
    let builder = ort::init_from(path).map_err(|e| {
        *failed = Some(path.display().to_string());
        e.to_string()
    })?;
    builder.with_name("ogg").with_telemetry(false).build().map_err(|e| e.to_string())
}
