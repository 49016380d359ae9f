//! Execution providers: who computes inside ONNX Runtime.

use std::fmt;

use ort::ep::ExecutionProvider as _;

/// Who executes the operations of the network inside the backend.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum ExecutionProvider {
    /// The backend's own CPU kernels.
    #[default]
    Cpu,
    /// Intel OpenVINO, on the CPU.
    OpenVino,
    /// NVIDIA CUDA.
    Cuda,
    /// NVIDIA TensorRT.
    TensorRt,
}

impl ExecutionProvider {
    /// Name as configurations write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::OpenVino => "openvino",
            Self::Cuda => "cuda",
            Self::TensorRt => "tensorrt",
        }
    }

    pub(super) fn is_available(self) -> bool {
        let asked = match self {
            Self::Cpu => return true,
            Self::OpenVino => ort::ep::OpenVINO::is_available(),
            Self::Cuda => ort::ep::CUDA::is_available(),
            Self::TensorRt => ort::ep::TensorRT::is_available(),
        };
        asked.unwrap_or(false)
    }
}

impl fmt::Display for ExecutionProvider {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
