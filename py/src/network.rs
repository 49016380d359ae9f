//! Networks that find people in pictures.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use numpy::{PyReadonlyArray3, PyUntypedArrayMethods};
use pose::{
    ExecutionProvider, ImageView, LibraryChoice, LibrarySearch, Model, Runtime, RuntimeOptions, Skeleton,
    onnxruntime_candidates,
};
use pyo3::prelude::*;

use crate::array::{borrowed, check_len};
use crate::failure::Failure;
use crate::pose::{People, people_arrays};

fn provider_of(what: &'static str, name: &str) -> Result<ExecutionProvider, Failure> {
    use ExecutionProvider as P;
    [P::Cpu, P::OpenVino, P::Cuda, P::TensorRt].into_iter().find(|p| p.name() == name).ok_or_else(|| {
        let expected = "'cpu', 'openvino', 'cuda' or 'tensorrt'".to_owned();
        Failure::Argument { what, expected, got: format!("{name:?}") }
    })
}

/// A network that looks at the pictures of one camera.
#[pyclass(frozen, module = "ogg_rs._native")]
pub(crate) struct Estimator {
    inner: Mutex<pose::Estimator>,
    name: String,
    skeleton: Skeleton,
    runtime: String,
}

impl Estimator {
    fn lock(&self) -> MutexGuard<'_, pose::Estimator> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl Estimator {
    /// `library` is a path, `"tract"`, or None for the first that is found, `site_packages` included.
    #[new]
    #[pyo3(signature = (card, *, weights_dirs, library, site_packages, provider, fallback, threads, mirror))]
    #[expect(clippy::too_many_arguments, reason = "a keyword-only Python signature")]
    fn new(
        py: Python<'_>,
        card: PathBuf,
        weights_dirs: Vec<PathBuf>,
        library: Option<PathBuf>,
        site_packages: Vec<PathBuf>,
        provider: &str,
        fallback: Option<&str>,
        threads: Option<usize>,
        mirror: bool,
    ) -> PyResult<Self> {
        let library = match library {
            Some(name) if name.as_os_str() == "tract" => LibraryChoice::PureRust,
            explicit => LibraryChoice::Search(onnxruntime_candidates(&LibrarySearch {
                explicit: explicit.as_deref(),
                python: &site_packages,
                system: true,
                ..LibrarySearch::default()
            })),
        };
        let options = RuntimeOptions {
            library,
            provider: provider_of("provider", provider)?,
            fallback: fallback.map(|name| provider_of("fallback", name)).transpose()?,
            threads,
            spin: false,
        };
        let inner = py
            .detach(|| {
                let model = Model::find(&card, &weights_dirs)?;
                let estimator = pose::Estimator::load(&model, &Runtime::load(options)?)?;
                if mirror { estimator.mirrored() } else { Ok(estimator) }
            })
            .map_err(Failure::from)?;
        let (name, skeleton) = (inner.card().name.clone(), inner.card().skeleton);
        let runtime = inner.runtime_info().to_string();
        Ok(Self { inner: Mutex::new(inner), name, skeleton, runtime })
    }

    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    #[getter]
    fn skeleton(&self) -> &'static str {
        self.skeleton.name()
    }

    #[getter]
    fn runtime(&self) -> &str {
        &self.runtime
    }

    /// People in an RGB picture `(height, width, 3)`.
    fn estimate<'py>(&self, py: Python<'py>, image: PyReadonlyArray3<'py, u8>) -> PyResult<People<'py>> {
        check_len("channels of the picture", 3, image.shape()[2])?;
        let view = ImageView::new(image.shape()[1], image.shape()[0], borrowed("image", &image)?);
        let view = view.map_err(Failure::from)?;
        let people = py.detach(|| self.lock().estimate(view)).map_err(Failure::from)?;
        people_arrays(py, &people, self.skeleton.len())
    }

    fn reset(&self, py: Python<'_>) {
        py.detach(|| self.lock().reset());
    }
}

/// Names of the compiled-in cards.
#[pyfunction]
pub(crate) fn builtin_cards() -> Vec<String> {
    Model::builtin_cards().into_iter().map(|card| card.name).collect()
}
