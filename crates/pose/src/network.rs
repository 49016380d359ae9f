//! A network in the runtime: loaded, compared with its card, and run.

use std::path::PathBuf;

use ort::{
    session::{Session, builder::GraphOptimizationLevel},
    value::{TensorElementType, TensorRef},
};

use crate::{
    Error, Result,
    card::{ElementType, Layout, Model},
    preprocess::{Preprocessor, TensorData},
    runtime::{Backend, ExecutionProvider, Runtime, RuntimeInfo},
};

/// A network that is ready to run.
#[derive(Debug)]
pub(crate) struct Network {
    session: Session,
    input: String,
    path: PathBuf,
    info: RuntimeInfo,
}

/// An output tensor by name.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Output<'a> {
    pub(crate) shape: &'a [i64],
    pub(crate) data: &'a [f32],
}

impl Network {
    pub(crate) fn load(model: &Model, runtime: &Runtime) -> Result<Self> {
        let bytes = model.read_weights()?;
        let path = model.path();
        let mut info = runtime.info().clone();
        let session = match commit(&bytes, runtime, info.active) {
            Ok(session) => session,
            Err(detail) if info.active == ExecutionProvider::Cpu => {
                return Err(Error::BadNetwork { path, backend: info.backend.to_string(), detail });
            }
            Err(detail) => match runtime.options.fallback {
                Some(fallback) if fallback != info.active => {
                    tracing::warn!(provider = %info.active, %fallback, detail, "execution provider falls back as configured");
                    info.active = fallback;
                    commit(&bytes, runtime, fallback).map_err(|detail| Error::BadNetwork {
                        path: path.clone(),
                        backend: info.backend.to_string(),
                        detail,
                    })?
                }
                _ => {
                    let provider = info.active.name();
                    return Err(Error::Provider { provider, backend: info.backend.to_string(), detail });
                }
            },
        };
        let network = Self { session, input: model.card.input.name.clone(), path, info };
        network.check_input(model)?;
        network.check_outputs(model)?;
        Ok(network)
    }

    pub(crate) fn info(&self) -> &RuntimeInfo {
        &self.info
    }

    /// Runs the network and hands the named outputs to `read`.
    pub(crate) fn run<T>(
        &mut self,
        tensor: &Preprocessor,
        outputs: &[&str],
        read: impl FnOnce(&[Output<'_>]) -> Result<T>,
    ) -> Result<T> {
        let Self { session, input, path, info } = self;
        let failed = |e: ort::Error| Error::Inference {
            path: path.clone(),
            backend: info.backend.to_string(),
            detail: e.to_string(),
        };
        let shape = tensor.shape();
        let values = match tensor.data() {
            TensorData::F32(v) => {
                session.run(ort::inputs![&**input => TensorRef::from_array_view((shape, &**v)).map_err(failed)?])
            }
            TensorData::I32(v) => {
                session.run(ort::inputs![&**input => TensorRef::from_array_view((shape, &**v)).map_err(failed)?])
            }
            TensorData::U8(v) => {
                session.run(ort::inputs![&**input => TensorRef::from_array_view((shape, &**v)).map_err(failed)?])
            }
        }
        .map_err(failed)?;
        let mut found = Vec::with_capacity(outputs.len());
        for name in outputs {
            let value = values.get(name).unwrap_or_else(|| unreachable!("output {name} was checked when loading"));
            let (shape, data) = value.try_extract_tensor::<f32>().map_err(failed)?;
            if let Some((index, &value)) = data.iter().enumerate().find(|(_, x)| !x.is_finite()) {
                return Err(Error::NonFinite { path: path.clone(), tensor: (*name).to_owned(), index, value });
            }
            found.push(Output { shape, data });
        }
        read(&found)
    }

    /// An output of a shape that the decoder cannot read.
    pub(crate) fn wrong_shape(path: PathBuf, tensor: &str, expected: String, got: &[i64]) -> Error {
        Error::WrongShape { path, tensor: tensor.to_owned(), expected, got: format!("{got:?}") }
    }

    pub(crate) fn path(&self) -> PathBuf {
        self.path.clone()
    }

    fn check_input(&self, model: &Model) -> Result<()> {
        let spec = &model.card.input;
        let (width, height) = if spec.dynamic { (-1, -1) } else { (spec.width as i64, spec.height as i64) };
        let shape = match spec.layout {
            Layout::Nchw => [1, 3, height, width],
            Layout::Nhwc => [1, height, width, 3],
        };
        let element = match spec.dtype {
            ElementType::Float32 => TensorElementType::Float32,
            ElementType::Int32 => TensorElementType::Int32,
            ElementType::Uint8 => TensorElementType::Uint8,
        };
        let expected = format!("{element} {shape:?} (-1 is any)");
        let wrong = |tensor: &str, got: String| {
            Err(Error::WrongShape {
                path: self.path(),
                tensor: format!("input {tensor}"),
                expected: expected.clone(),
                got,
            })
        };
        let Some(outlet) = self.session.inputs().iter().find(|i| i.name() == spec.name) else {
            let names: Vec<_> = self.session.inputs().iter().map(ort::value::Outlet::name).collect();
            return wrong(&spec.name, format!("inputs {names:?}"));
        };
        let (Some(got_shape), Some(got_type)) = (outlet.dtype().tensor_shape(), outlet.dtype().tensor_type()) else {
            return wrong(&spec.name, "no tensor".to_owned());
        };
        // A size that the file leaves open fits any; a size that the card leaves open must be open in the file.
        let fits = got_shape.len() == 4 && got_shape.iter().zip(&shape).all(|(&got, &want)| got == want || got < 0);
        if !fits || got_type != element {
            return wrong(&spec.name, format!("{got_type} {:?}", &got_shape[..]));
        }
        Ok(())
    }

    fn check_outputs(&self, model: &Model) -> Result<()> {
        let names: Vec<_> = self.session.outputs().iter().map(ort::value::Outlet::name).collect();
        for name in model.card.output_names() {
            if !names.contains(&name) {
                return Err(Error::WrongShape {
                    path: self.path(),
                    tensor: format!("output {name}"),
                    expected: "an output of this name".to_owned(),
                    got: format!("outputs {names:?}"),
                });
            }
        }
        Ok(())
    }
}

fn commit(bytes: &[u8], runtime: &Runtime, provider: ExecutionProvider) -> Result<Session, String> {
    let text = |e: ort::Error| e.to_string();
    let mut builder = Session::builder(&runtime.environment).map_err(text)?;
    builder = builder.with_optimization_level(GraphOptimizationLevel::All).map_err(|e| e.to_string())?;
    if matches!(runtime.info().backend, Backend::OnnxRuntime { .. }) {
        if let Some(threads) = runtime.options.threads {
            builder = builder.with_intra_threads(threads).map_err(|e| e.to_string())?;
        }
        builder = builder.with_intra_op_spinning(runtime.options.spin).map_err(|e| e.to_string())?;
        let dispatch = match provider {
            // Without its arena ONNX Runtime asks malloc for every run's buffers, aligned; before glibc 2.38 the heap then grows for ever.
            ExecutionProvider::Cpu => ort::ep::CPU::default().with_arena_allocator(true).build(),
            ExecutionProvider::OpenVino => {
                let mut openvino = ort::ep::OpenVINO::default().with_device_type("CPU");
                if let Some(threads) = runtime.options.threads {
                    openvino = openvino.with_num_threads(threads);
                }
                openvino.build()
            }
            ExecutionProvider::Cuda => ort::ep::CUDA::default().build(),
            ExecutionProvider::TensorRt => ort::ep::TensorRT::default().build(),
        };
        builder = builder.with_execution_providers([dispatch.error_on_failure()]).map_err(|e| e.to_string())?;
    }
    builder.commit_from_memory(bytes).map_err(text)
}
