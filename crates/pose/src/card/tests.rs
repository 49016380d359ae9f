use super::*;

fn text(name: &str) -> &'static str {
    BUILTIN_CARDS.iter().find(|(n, _)| *n == name).unwrap().1
}

fn parse(text: &str) -> Result<ModelCard> {
    ModelCard::parse(text, Path::new("x/y.toml"))
}

#[test]
fn every_builtin_card_is_valid_and_carries_its_own_name() {
    for ((name, _), card) in BUILTIN_CARDS.iter().zip(Model::builtin_cards()) {
        assert_eq!(card.name, *name);
    }
    assert_eq!(Model::builtin_cards()[0], Model::default().card);
    let mut digests: Vec<_> = Model::builtin_cards().into_iter().map(|c| c.sha256).collect();
    digests.sort_unstable();
    digests.dedup();
    assert_eq!(digests.len(), BUILTIN_CARDS.len());
}

/// Channels and limbs of the published COCO model, index by index.
#[test]
fn the_openpose_card_has_the_published_limb_and_channel_order() {
    let card = parse(text("openpose-mobilenet-v2-small")).unwrap();
    let spec = card.openpose.as_ref().unwrap();
    let limbs: Vec<_> = spec
        .limbs
        .iter()
        .map(|l| [card.skeleton.index_of(l.from).unwrap(), card.skeleton.index_of(l.to).unwrap()])
        .collect();
    let published = [
        [1, 2],
        [1, 5],
        [2, 3],
        [3, 4],
        [5, 6],
        [6, 7],
        [1, 8],
        [8, 9],
        [9, 10],
        [1, 11],
        [11, 12],
        [12, 13],
        [1, 0],
        [0, 14],
        [14, 16],
        [0, 15],
        [15, 17],
        [2, 16],
        [5, 17],
    ];
    assert_eq!(limbs, published);
    let channels: Vec<_> = spec.limbs.iter().map(|l| l.paf).collect();
    let published = [
        [12, 13],
        [20, 21],
        [14, 15],
        [16, 17],
        [22, 23],
        [24, 25],
        [0, 1],
        [2, 3],
        [4, 5],
        [6, 7],
        [8, 9],
        [10, 11],
        [28, 29],
        [30, 31],
        [34, 35],
        [32, 33],
        [36, 37],
        [18, 19],
        [26, 27],
    ];
    assert_eq!(channels, published);
}

#[test]
fn an_unknown_key_is_refused_by_name_line_and_file() {
    let message = parse(&text("movenet-thunder").replace("layout =", "layuot =")).unwrap_err().to_string();
    assert!(message.contains("x/y.toml") && message.contains("layuot") && message.contains("line"), "{message}");
    let message = parse(&format!("colour = 3\n{}", text("movenet-thunder"))).unwrap_err().to_string();
    assert!(message.contains("colour"), "{message}");
    let openpose = text("openpose-mobilenet-v2-small");
    for (of, key) in [("colour = \"bgr\"", "colur = 1"), ("stride = 8", "strid = 8")] {
        let message = parse(&openpose.replace(of, &format!("{of}\n{key}"))).unwrap_err().to_string();
        assert!(message.contains(&key[..5]), "{message}");
    }
    let cases = [
        (openpose, "paf = [12, 13]", "paf = [12, 13], width = 2"),
        (openpose, "channels = 19", "channels = 19, width = 2"),
        (text("movenet-thunder"), "[movenet]", "[movenet]\nwidth = 2"),
        (text("blazepose-full"), "[blazepose]", "[blazepose]\nwidth = 2"),
        (openpose, "[about]", "[about]\nwidth = 2"),
    ];
    for (card, of, key) in cases {
        assert!(card.contains(of), "{of}");
        let message = parse(&card.replace(of, key)).unwrap_err().to_string();
        assert!(message.contains("unknown field `width`"), "{message}");
    }
}

#[test]
fn a_missing_key_and_a_wrong_word_are_refused_by_name() {
    let missing = text("movenet-thunder").replace("licence = \"Apache-2.0\"", "");
    assert!(parse(&missing).unwrap_err().to_string().contains("licence"));
    let wrong = text("movenet-thunder").replace("\"nhwc\"", "\"nwhc\"");
    let message = parse(&wrong).unwrap_err().to_string();
    assert!(message.contains("nwhc") && message.contains("nhwc"), "{message}");
}

#[test]
fn contradictions_are_refused_with_field_expectation_and_value() {
    let thunder = text("movenet-thunder");
    let openpose = text("openpose-mobilenet-v2-small");
    let cases = [
        (thunder.replace("4fa7fb2b", "4FA7FB2B"), "sha256"),
        (thunder.replace("file = \"", "file = \"../"), "file"),
        (thunder.replace("width = 256", "width = 0"), "input.width"),
        (thunder.replace("coco-17", "body-25"), "skeleton"),
        (thunder.replace("output = \"movenet\"", "output = \"blazepose\""), "section"),
        (openpose.replace("stride = 8", "stride = 7"), "openpose.stride"),
        (openpose.replace("first = 0, channels = 19", "first = 0, channels = 25"), "openpose.pcm.channels"),
        (openpose.replace("paf = [12, 13]", "paf = [12, 38]"), "openpose.limbs.paf"),
        (openpose.replace("to = \"right_wrist\"", "to = \"right_heel\""), "openpose.limbs"),
        (openpose.replace("peak_threshold = 0.05", "peak_threshold = nan"), "openpose.peak_threshold"),
        (openpose.replace("peak_threshold = 0.05", "peak_threshold = 1.0"), "openpose.peak_threshold"),
        (thunder.replace("4fa7fb2b", "4fa7fb2"), "sha256"),
        (thunder.replace("4fa7fb2b", "gfa7fb2b"), "sha256"),
        (thunder.replace("\n[input]", "min_score = 1.5\n[input]"), "min_score"),
        (thunder.replace("width = 256", "width = 5000"), "input.width"),
        (thunder.replace("[movenet]", "scale = [1.0, 0.0, 1.0]\n[movenet]"), "input.scale"),
        (thunder.replace("[movenet]", "mean = [nan, 0.0, 0.0]\n[movenet]"), "input.scale"),
        (thunder.replace("[movenet]\noutput = \"Identity:0\"\n", ""), "movenet: expected a section"),
        (text("blazepose-full").replace("mediapipe-33", "coco-17"), "skeleton"),
        (openpose.replace("stride = 8", "stride = 0"), "openpose.stride"),
        (format!("{}limbs = []", openpose.split_once("limbs = [").unwrap().0), "openpose.limbs"),
        (openpose.replace("to = \"right_wrist\"", "to = \"right_elbow\""), "openpose.limbs"),
        (openpose.replace("paf = [12, 13]", "paf = [12, 12]"), "openpose.limbs.paf"),
    ];
    for (card, field) in cases {
        let error = parse(&card).unwrap_err();
        assert!(matches!(error, Error::CardValue { .. }), "{field}: {error}");
        assert!(error.to_string().contains(field), "{field}: {error}");
    }
}

#[test]
fn weights_are_found_beside_the_card_or_in_a_named_folder_and_checked() {
    let dir = tempfile::tempdir().unwrap();
    let elsewhere = tempfile::tempdir().unwrap();
    let card_path = dir.path().join("mine.toml");
    let digest = "2cf24dba5fb0a30e26e83b2ac5b9e29e1b161e5c1fa7425e73043362938b9824"; // of "hello"
    let card = text("movenet-thunder")
        .replace("4fa7fb2b61e8df09d9c125e74d2c81151610491db0696c4c7e7a50158cd89e18", digest)
        .replace("file = \"movenet-thunder.onnx\"", "file = \"w.onnx\"");
    std::fs::write(&card_path, card).unwrap();

    let error = Model::find(&card_path, &[elsewhere.path().to_owned()]).unwrap_err();
    assert!(matches!(error, Error::NotFound { .. }) && error.to_string().contains("w.onnx"), "{error}");

    std::fs::write(elsewhere.path().join("w.onnx"), b"hello").unwrap();
    let model = Model::find(&card_path, &[elsewhere.path().to_owned()]).unwrap();
    assert_eq!(model.read_weights().unwrap(), b"hello");

    std::fs::write(dir.path().join("w.onnx"), b"hellO").unwrap();
    let model = Model::find(&card_path, &[elsewhere.path().to_owned()]).unwrap();
    assert_eq!(model.weights, Weights::File(dir.path().join("w.onnx")));
    let error = model.read_weights().unwrap_err();
    assert!(matches!(error, Error::WrongHash { .. }) && error.to_string().contains(digest), "{error}");
}

#[test]
fn a_network_without_a_card_is_known_by_its_digest_or_refused() {
    let dir = tempfile::tempdir().unwrap();
    let network = dir.path().join("n.onnx");
    std::fs::write(&network, b"hello").unwrap();
    let error = Model::find(&network, &[]).unwrap_err();
    assert!(matches!(error, Error::NoCard { .. }), "{error}");
    assert!(error.to_string().contains("n.toml") && error.to_string().contains("2cf24dba"), "{error}");
    std::fs::create_dir(dir.path().join("d.onnx")).unwrap();
    assert!(Model::find(&dir.path().join("d.onnx"), &[]).is_err());
    assert!(matches!(Model::find(Path::new("nonsense"), &[]), Err(Error::UnknownModel { .. })));
    assert!(matches!(Model::find(Path::new("gone.toml"), &[]), Err(Error::Read { .. })));
}

#[test]
fn the_own_network_needs_no_file_and_matches_its_card() {
    let own = Model::find(Path::new("ogg-lite"), &[]).unwrap();
    assert_eq!(own, Model::default());
    assert!(matches!(own.weights, Weights::Embedded(_)));
    assert!(own.read_weights().unwrap().len() > 100_000);
    assert_eq!(Model::find(Path::new("builtin:ogg-lite"), &[]).unwrap(), own);
    let mut other = own;
    other.card.sha256 = "0".repeat(64);
    assert!(matches!(other.read_weights(), Err(Error::WrongHash { .. })));
}

#[test]
fn networks_for_one_person_follow_the_person_and_others_look_at_the_whole_picture() {
    for card in Model::builtin_cards() {
        let one = matches!(card.output, OutputKind::MoveNet | OutputKind::BlazePose);
        assert_eq!(ModelCard { region: None, ..card }.region(), if one { Region::Track } else { Region::Full });
    }
}

#[test]
fn a_folder_and_a_file_too_large_to_be_a_network_are_refused_unread() {
    let dir = tempfile::tempdir().unwrap();
    let model = |path: &Path| Model { weights: Weights::File(path.to_owned()), ..Model::default() };
    let error = model(dir.path()).read_weights().unwrap_err();
    assert!(matches!(error, Error::RefusedFile { .. }), "{error}");
    let large = dir.path().join("large.onnx");
    // Sparse: it takes no room.
    std::fs::File::create(&large).unwrap().set_len((512 << 20) + 1).unwrap();
    let error = model(&large).read_weights().unwrap_err();
    assert!(matches!(error, Error::RefusedFile { .. }) && error.to_string().contains("536870913"), "{error}");
}
