//! The pure-Rust runtime, and the errors of models that are not what they say. One process, one runtime: everything here
//! runs on tract.
#![expect(clippy::unwrap_used, reason = "tests")]

use std::path::{Path, PathBuf};

use pose::{
    Backend, Error, Estimator, ExecutionProvider, ImageView, LibraryCandidate, LibraryChoice, LibraryOrigin, Model,
    Region, RegionOptions, Runtime, RuntimeOptions, Stage,
};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/tiny").join(name)
}

fn tract() -> Runtime {
    Runtime::load(RuntimeOptions { library: LibraryChoice::PureRust, ..Default::default() }).unwrap()
}

fn load(card: &str) -> Result<Estimator, Error> {
    Estimator::load(&Model::find(&fixture(card), &[])?, &tract())
}

/// The good card with one thing changed, beside a copy of a network.
fn changed(network: &str, edit: impl Fn(&str) -> String) -> (tempfile::TempDir, Result<Estimator, Error>) {
    let dir = tempfile::tempdir().unwrap();
    std::fs::copy(fixture(network), dir.path().join("good.onnx")).unwrap();
    let card = dir.path().join("good.toml");
    std::fs::write(&card, edit(&std::fs::read_to_string(fixture("good.toml")).unwrap())).unwrap();
    let loaded = Model::find(&card, &[]).and_then(|m| Estimator::load(&m, &tract()));
    (dir, loaded)
}

#[test]
fn a_network_of_the_right_shape_runs_and_finds_nobody_in_a_blank_picture() {
    let mut estimator = load("good.toml").unwrap();
    assert_eq!(estimator.runtime_info().backend, Backend::Tract);
    assert!(estimator.runtime_info().to_string().contains("tract"));
    let pixels = vec![90; 64 * 48 * 3];
    let people = estimator.estimate(ImageView::new(64, 48, &pixels).unwrap()).unwrap();
    assert!(people.is_empty());
}

#[test]
fn the_own_network_runs_without_any_library() {
    let mut estimator = Estimator::load(&Model::default(), &tract()).unwrap();
    let pixels = vec![90; 320 * 240 * 3];
    assert!(estimator.estimate(ImageView::new(320, 240, &pixels).unwrap()).unwrap().is_empty());
}

#[test]
fn a_card_finds_its_network_and_a_network_its_card() {
    for name in ["good.toml", "good.onnx"] {
        let model = Model::find(&fixture(name), &[]).unwrap();
        assert_eq!(model.card.name, "good");
    }
}

#[test]
fn a_nan_weight_is_found_when_loading_with_tensor_and_place() {
    let error = load("nan.toml").unwrap_err();
    assert!(matches!(&error, Error::NonFinite { tensor, index: 0, .. } if tensor == "pcm"), "{error}");
    assert!(error.to_string().contains("nan.onnx"), "{error}");
}

#[test]
fn an_operation_that_the_runtime_lacks_is_a_clear_error() {
    let error = load("unknown-operation.toml").unwrap_err();
    let text = error.to_string();
    assert!(matches!(error, Error::BadNetwork { .. }), "{text}");
    assert!(text.contains("unknown-operation.onnx") && text.contains("tract"), "{text}");
}

#[test]
fn a_corrupt_network_is_refused_by_hash_and_without_the_hash_by_the_parser() {
    let dir = tempfile::tempdir().unwrap();
    let bytes = std::fs::read(fixture("good.onnx")).unwrap();
    let card = std::fs::read_to_string(fixture("good.toml")).unwrap();
    for (bytes, what) in [(&bytes[..bytes.len() / 2], "truncated"), (&b"not a network at all"[..], "garbage")] {
        std::fs::write(dir.path().join("good.onnx"), bytes).unwrap();
        std::fs::write(dir.path().join("good.toml"), &card).unwrap();
        let model = Model::find(&dir.path().join("good.toml"), &[]).unwrap();
        let error = Estimator::load(&model, &tract()).unwrap_err();
        assert!(matches!(error, Error::WrongHash { .. }), "{what}: {error}");
        // The same bytes under their own hash.
        let mut model = model;
        let Err(Error::WrongHash { got, .. }) = model.read_weights() else { panic!("{what}") };
        model.card.sha256 = got;
        let error = Estimator::load(&model, &tract()).unwrap_err();
        assert!(matches!(error, Error::BadNetwork { .. }), "{what}: {error}");
    }
}

#[test]
fn a_card_of_another_shape_is_refused_with_both_shapes() {
    let cases: [(&str, &str, &str); 7] = [
        ("width = 32", "width = 64", "64"),
        ("name = \"image\"", "name = \"picture\"", "picture"),
        ("dtype = \"float32\"", "dtype = \"int32\"", "Int32"),
        ("output = \"paf\"", "output = \"fields\"", "fields"),
        ("stride = 8", "stride = 4", "at least 9 channels"),
        ("\"paf\", channels = 14", "\"paf\", channels = 16", "at least 16 channels"),
        ("pad = 128", "pad = 128\ndynamic = true", "-1, -1"),
    ];
    for (from, to, said) in cases {
        let (_dir, loaded) = changed("good.onnx", |card| card.replace(from, to));
        let error = loaded.unwrap_err();
        assert!(matches!(error, Error::WrongShape { .. }), "{to}: {error}");
        let i32_or_said = error.to_string().to_lowercase().contains(&said.to_lowercase())
            || (said == "Int32" && error.to_string().contains("i32"));
        assert!(i32_or_said && error.to_string().contains("good.onnx"), "{to}: {error}");
    }
}

#[test]
fn an_answer_that_is_no_table_of_keypoints_is_refused_with_the_shape_of_one() {
    let cases = [
        ("movenet", "coco-17", "[movenet]\noutput = \"pcm\"", "[1, 1, 17, 3]"),
        ("movenet-multi", "coco-17", "[movenet]\noutput = \"pcm\"", "[1, people, 56]"),
        ("blazepose", "mediapipe-33", "[blazepose]\nlandmarks = \"pcm\"\npresence = \"paf\"", "[1, 195]"),
    ];
    for (kind, skeleton, section, shape) in cases {
        let (_dir, loaded) = changed("good.onnx", |card| {
            let input = card.split_once("[openpose]").unwrap().0;
            let input = input.replace("\"openpose\"", &format!("\"{kind}\"")).replace("upper-limb-8", skeleton);
            format!("{input}{section}\n")
        });
        let error = loaded.unwrap_err();
        assert!(matches!(error, Error::WrongShape { .. }) && error.to_string().contains(shape), "{kind}: {error}");
    }
}

/// A wide picture keeps the area of 32 x 32 px in 7 x 2 cells of 8 px, of which there are at least four; a square one is 32 px.
#[test]
fn a_network_for_any_size_gets_the_shape_of_the_picture() {
    let mut estimator = load("open.toml").unwrap();
    assert_eq!(estimator.last_crop(), None);
    for (width, height, scale) in [(96, 32, 96.0 / 56.0), (64, 64, 2.0), (96, 32, 96.0 / 56.0)] {
        let pixels = vec![90; width * height * 3];
        assert!(estimator.estimate(ImageView::new(width, height, &pixels).unwrap()).unwrap().is_empty());
        let crop = estimator.last_crop().unwrap();
        assert!((crop.scale - scale).abs() < 1e-5, "{crop:?}");
    }
}

/// Judge: the letterbox by hand. The tensor of 32 px shows 64 x 32 px in its middle half, two for one, so that the edges at 24
/// and 16 px lie at 48 and 16 px; the centres of pixels are half a pixel before.
#[test]
fn keypoints_come_back_in_picture_coordinates() {
    let model = Model::find(&fixture("bright.toml"), &[]).unwrap();
    let mut estimator = Estimator::with_region(&model, &tract(), Region::Full, RegionOptions::default()).unwrap();
    let pixels = vec![255; 64 * 32 * 3];
    let people = estimator.estimate(ImageView::new(64, 32, &pixels).unwrap()).unwrap();
    let last = people[0].keypoints[16].unwrap();
    assert!((last.u_px - 47.5).abs() < 1e-4 && (last.v_px - 15.5).abs() < 1e-4, "{last:?}");
    assert!((last.score - 0.5).abs() < 1e-4, "{last:?}");
}

#[test]
fn a_person_is_followed_with_one_look_a_picture_until_a_reset() {
    let mut estimator = load("bright.toml").unwrap();
    let pixels = vec![255; 200 * 200 * 3];
    let image = ImageView::new(200, 200, &pixels).unwrap();
    for (picture, expected) in [3, 1, 1, 3].into_iter().enumerate() {
        if picture == 3 {
            estimator.reset();
        }
        let mut looks = 0;
        estimator.estimate_observed(image, &mut |stage| looks += usize::from(stage == Stage::Network)).unwrap();
        assert_eq!(looks, expected, "picture {picture}");
    }
}

#[test]
fn a_second_wish_conflicts_and_a_missing_provider_is_named() {
    tract();
    let wish = LibraryCandidate { path: PathBuf::from("/opt/libonnxruntime.so"), origin: LibraryOrigin::Explicit };
    let library = LibraryChoice::Search(vec![wish]);
    let error = Runtime::load(RuntimeOptions { library, ..Default::default() }).unwrap_err();
    assert!(matches!(error, Error::RuntimeConflict { .. }), "{error}");

    let cuda =
        RuntimeOptions { library: LibraryChoice::PureRust, provider: ExecutionProvider::Cuda, ..Default::default() };
    let error = Runtime::load(cuda.clone()).unwrap_err();
    assert!(error.to_string().contains("cuda") && error.to_string().contains("tract"), "{error}");
    // A fallback that is not there either is no fallback.
    let both = RuntimeOptions { fallback: Some(ExecutionProvider::OpenVino), ..cuda.clone() };
    let error = Runtime::load(both).unwrap_err();
    assert!(matches!(error, Error::Provider { provider: "cuda", .. }), "{error}");
    assert!(error.to_string().contains("openvino"), "{error}");
    let runtime = Runtime::load(RuntimeOptions { fallback: Some(ExecutionProvider::Cpu), ..cuda }).unwrap();
    assert_eq!(runtime.info().active, ExecutionProvider::Cpu);
    assert!(runtime.info().to_string().contains("cpu instead of cuda"), "{}", runtime.info());
}
