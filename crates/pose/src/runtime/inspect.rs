//! Looks into a library file before the loader does.
//!
//! In `ort` 2.0.0-rc.14 a load that fails leaves its cell of the library marked as filled, and the next load would use
//! what was never written there. So a process may let at most one load fail. Files that cannot serve are therefore
//! recognised by their bytes: the entry point `OrtGetApiBase` must be named, and on Linux the version tag that ONNX Runtime's
//! linker script puts there (`VERS_1.24.1`) must be recent enough.

use std::path::Path;

const ENTRY: &[u8] = b"OrtGetApiBase";
const VERSION_TAG: &[u8] = b"VERS_1.";

/// Why this file cannot be ONNX Runtime of version 1.`min_minor` or later; `None` when it may be.
pub(super) fn defect(path: &Path, min_minor: u32) -> Option<String> {
    if !path.is_file() {
        return Some("no such file".to_owned());
    }
    match std::fs::read(path) {
        Err(e) => Some(e.to_string()),
        Ok(bytes) => defect_of(&bytes, min_minor, cfg!(target_os = "linux")),
    }
}

fn defect_of(bytes: &[u8], min_minor: u32, is_elf: bool) -> Option<String> {
    if is_elf && !bytes.starts_with(b"\x7fELF") {
        return Some("not a shared library".to_owned());
    }
    if find(bytes, ENTRY).is_none() {
        return Some("not ONNX Runtime: it has no OrtGetApiBase".to_owned());
    }
    if !is_elf {
        return None;
    }
    let Some(minor) = version(bytes) else {
        return Some("no version tag; expected an official build of ONNX Runtime".to_owned());
    };
    (minor < min_minor).then(|| format!("expected ONNX Runtime 1.{min_minor} or later, got 1.{minor}"))
}

fn version(bytes: &[u8]) -> Option<u32> {
    let mut rest = bytes;
    while let Some(at) = find(rest, VERSION_TAG) {
        rest = &rest[at + VERSION_TAG.len()..];
        let digits: String = rest.iter().take(4).take_while(|b| b.is_ascii_digit()).map(|b| char::from(*b)).collect();
        if let Ok(minor) = digits.parse() {
            return Some(minor);
        }
    }
    None
}

fn find(bytes: &[u8], what: &[u8]) -> Option<usize> {
    bytes.windows(what.len()).position(|w| w == what)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_recent_library_with_the_entry_point_may_be_loaded() {
        let library = |entry: &str, tag: &str| [b"\x7fELF..", entry.as_bytes(), b"\0", tag.as_bytes(), b"\0"].concat();
        let said = |bytes: &[u8]| defect_of(bytes, 24, true).unwrap_or_default();
        assert_eq!(said(&library("OrtGetApiBase", "VERS_1.31.1")), "");
        assert_eq!(said(&library("OrtGetApiBase", "VERS_1. VERS_1.24.0")), "");
        assert!(said(&library("OrtGetApiBase", "VERS_1.17.3")).contains("1.17"));
        assert!(said(&library("OrtGetApiBase", "")).contains("version tag"));
        assert!(said(&library("OrtGetApiBas", "VERS_1.31.1")).contains("OrtGetApiBase"));
        assert!(said(b"no library").contains("shared library"));
        assert!(defect(Path::new("/nowhere/libonnxruntime.so"), 24).is_some());
    }
}
