//! A library that was asked for by path and cannot be loaded is an error; one that was only found is passed over. One
//! process, one runtime, hence a file of its own.

use pose::{Backend, Error, LibraryCandidate, LibraryChoice, LibraryOrigin, Runtime, RuntimeOptions};

#[test]
fn a_wish_fails_and_a_find_is_passed_over_with_its_reason() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("libonnxruntime.so");
    std::fs::write(&path, b"no library").unwrap();
    let gone = dir.path().join("gone.so");
    let load = |path: &std::path::Path, origin| {
        let library = LibraryChoice::Search(vec![LibraryCandidate { path: path.to_owned(), origin }]);
        Runtime::load(RuntimeOptions { library, ..Default::default() })
    };
    for (path, origin) in [(&path, LibraryOrigin::Explicit), (&gone, LibraryOrigin::Environment)] {
        let error = load(path, origin).unwrap_err();
        assert!(matches!(error, Error::Library { .. }), "{error}");
        assert!(error.to_string().contains(&path.display().to_string()), "{error}");
    }
    // What the inspection of the file cannot see: the loader refuses it, once, and nothing is loaded after it.
    let forged = dir.path().join("forged.so");
    std::fs::write(&forged, b"\x7fELF OrtGetApiBase\0VERS_1.99.0\0").unwrap();
    for said in ["ELF", "not tried"] {
        let error = load(&forged, LibraryOrigin::Explicit).unwrap_err();
        assert!(matches!(error, Error::Library { .. }), "{error}");
        let text = error.to_string();
        assert!(said == "ELF" && !text.contains("not tried") || text.contains(said), "{text}");
    }
    let runtime = load(&path, LibraryOrigin::Python).unwrap();
    assert_eq!(runtime.info().backend, Backend::Tract);
    assert_eq!(runtime.info().tried.len(), 1);
    assert!(!runtime.info().tried[0].reason.is_empty());
}
