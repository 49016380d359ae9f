//! Where the shared library of ONNX Runtime may be.

use std::path::{Path, PathBuf};

/// How a library came to be tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum LibraryOrigin {
    /// Set explicitly.
    Explicit,
    /// Named by an environment value.
    Environment,
    /// Beside the binary.
    BesideBinary,
    /// In a Python installation's `onnxruntime` package.
    Python,
    /// Where the system's loader looks.
    System,
}

impl LibraryOrigin {
    /// Name for messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Explicit => "set explicitly",
            Self::Environment => "set by the environment",
            Self::BesideBinary => "beside the binary",
            Self::Python => "in the Python package onnxruntime",
            Self::System => "in the system",
        }
    }

    /// True where a person named the library, so that failing to load it is an error.
    pub fn is_wish(self) -> bool {
        matches!(self, Self::Explicit | Self::Environment)
    }
}

/// A library that may be loaded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LibraryCandidate {
    /// The library; a bare file name leaves the search to the system's loader.
    pub path: PathBuf,
    /// How it came to be tried.
    pub origin: LibraryOrigin,
}

/// The places to look in. This crate reads no environment: the caller does, and passes what it found.
#[derive(Debug, Clone, Copy, Default)]
pub struct LibrarySearch<'a> {
    /// The library that a configuration or option names.
    pub explicit: Option<&'a Path>,
    /// The library that the environment names.
    pub environment: Option<&'a Path>,
    /// The folder of the binary.
    pub binary_dir: Option<&'a Path>,
    /// `site-packages` folders, in order; see [`python_site_packages`].
    pub python: &'a [PathBuf],
    /// Whether to ask the system's loader.
    pub system: bool,
}

/// The libraries to try, in the documented order. Files are only listed, not opened.
///
/// ```
/// use std::path::Path;
/// let found = pose::onnxruntime_candidates(&pose::LibrarySearch {
///     explicit: Some(Path::new("/opt/ort/libonnxruntime.so")),
///     system: true,
///     ..Default::default()
/// });
/// assert_eq!(found[0].path, Path::new("/opt/ort/libonnxruntime.so"));
/// assert_eq!(found[1].path, Path::new(pose::ONNXRUNTIME_LIBRARY));
/// ```
pub fn onnxruntime_candidates(search: &LibrarySearch<'_>) -> Vec<LibraryCandidate> {
    let mut found = Vec::new();
    let mut add = |path: PathBuf, origin| found.push(LibraryCandidate { path, origin });
    if let Some(path) = search.explicit {
        add(path.to_owned(), LibraryOrigin::Explicit);
    }
    if let Some(path) = search.environment {
        add(path.to_owned(), LibraryOrigin::Environment);
    }
    if let Some(dir) = search.binary_dir {
        for path in libraries_in(dir).into_iter().chain(libraries_in(&dir.join("lib"))) {
            add(path, LibraryOrigin::BesideBinary);
        }
    }
    for site in search.python {
        for path in libraries_in(&site.join("onnxruntime").join("capi")) {
            add(path, LibraryOrigin::Python);
        }
    }
    if search.system {
        add(PathBuf::from(ONNXRUNTIME_LIBRARY), LibraryOrigin::System);
    }
    found
}

/// File name of the library on this platform.
pub const ONNXRUNTIME_LIBRARY: &str = if cfg!(windows) {
    "onnxruntime.dll"
} else if cfg!(target_os = "macos") {
    "libonnxruntime.dylib"
} else {
    "libonnxruntime.so"
};

/// The `site-packages` folders under the prefix of a Python installation or virtual environment.
pub fn python_site_packages(prefix: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for lib in ["lib", "lib64"] {
        let Ok(entries) = std::fs::read_dir(prefix.join(lib)) else { continue };
        for entry in entries.flatten() {
            let is_python = entry.file_name().to_string_lossy().starts_with("python3");
            let site = entry.path().join("site-packages");
            if is_python && site.is_dir() {
                found.push(site);
            }
        }
    }
    let windows = prefix.join("Lib").join("site-packages");
    if cfg!(windows) && windows.is_dir() {
        found.push(windows);
    }
    found.sort_by_key(|path| std::cmp::Reverse(version_key(path)));
    found
}

/// `libonnxruntime.so`, `libonnxruntime.so.1.24.1`, ... in a folder, newest version first.
fn libraries_in(dir: &Path) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(dir) else { return Vec::new() };
    let stem = ONNXRUNTIME_LIBRARY.trim_end_matches(".dylib").trim_end_matches(".so").trim_end_matches(".dll");
    let mut found: Vec<PathBuf> = entries
        .flatten()
        .filter(|e| {
            let name = e.file_name().to_string_lossy().into_owned();
            name == ONNXRUNTIME_LIBRARY
                || name.strip_prefix(ONNXRUNTIME_LIBRARY).is_some_and(is_version)
                || name.strip_prefix(stem).and_then(|n| n.strip_suffix(".dylib")).is_some_and(is_version)
        })
        .map(|e| e.path())
        .collect();
    found.sort_by_key(|path| std::cmp::Reverse(version_key(path)));
    found
}

fn is_version(text: &str) -> bool {
    text.len() > 1 && text.starts_with('.') && text.bytes().all(|b| b == b'.' || b.is_ascii_digit())
}

/// The numbers in a path's last digits-and-dots run, so that 1.31.1 stands above 1.9.0.
fn version_key(path: &Path) -> Vec<u64> {
    path.to_string_lossy().split(|c: char| !c.is_ascii_digit()).filter_map(|n| n.parse().ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_tried_in_the_documented_order_and_newest_first() {
        let dir = tempfile::tempdir().unwrap();
        let binary = dir.path().join("bin");
        let venv = dir.path().join("venv");
        let capi = venv.join("lib/python3.12/site-packages/onnxruntime/capi");
        std::fs::create_dir_all(binary.join("lib")).unwrap();
        std::fs::create_dir_all(&capi).unwrap();
        let others = ["libonnxruntime_providers_shared.so", "libonnxruntime.so.", "libonnxruntime.so.bak"];
        for name in ["libonnxruntime.so.1.9.0", "libonnxruntime.so.1.31.1"].into_iter().chain(others) {
            std::fs::write(capi.join(name), b"").unwrap();
        }
        std::fs::write(binary.join("libonnxruntime.so"), b"").unwrap();
        std::fs::write(binary.join("lib/libonnxruntime.so"), b"").unwrap();
        let python = python_site_packages(&venv);
        let found = onnxruntime_candidates(&LibrarySearch {
            explicit: Some(Path::new("/a")),
            environment: Some(Path::new("/b")),
            binary_dir: Some(&binary),
            python: &python,
            system: true,
        });
        let paths: Vec<_> = found.iter().map(|c| c.path.clone()).collect();
        let expected = [
            PathBuf::from("/a"),
            PathBuf::from("/b"),
            binary.join("libonnxruntime.so"),
            binary.join("lib/libonnxruntime.so"),
            capi.join("libonnxruntime.so.1.31.1"),
            capi.join("libonnxruntime.so.1.9.0"),
            PathBuf::from("libonnxruntime.so"),
        ];
        assert_eq!(paths, expected);
        let wishes: Vec<_> = found.iter().map(|c| c.origin.is_wish()).collect();
        assert_eq!(wishes, [true, true, false, false, false, false, false]);
    }
}
