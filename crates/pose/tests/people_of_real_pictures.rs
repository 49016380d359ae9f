//! The decoder with real OpenPose weights on real photographs. `OGG_POSE_MODELS` names a folder with
//! `openpose-mobilenet-v2-small.onnx`, `OGG_POSE_PICTURES` one with pictures of COCO's val2014, `ORT_DYLIB_PATH` ONNX
//! Runtime; without them the test says so and passes.
#![expect(clippy::disallowed_methods, reason = "the test data are named by the environment")]
#![expect(clippy::unwrap_used, reason = "tests")]

use std::path::{Path, PathBuf};

use pose::{
    Estimator, ImageView, LibraryCandidate, LibraryChoice, LibraryOrigin, Model, Part, Person, Runtime, RuntimeOptions,
};

/// Picture and how many people a person sees in it who are neither tiny nor mostly covered: at least and at most.
const PICTURES: [(&str, usize, usize); 7] = [
    ("COCO_val2014_000000000192.jpg", 3, 5),
    ("COCO_val2014_000000000241.jpg", 3, 5),
    ("COCO_val2014_000000000257.jpg", 2, 12),
    ("COCO_val2014_000000000294.jpg", 1, 1),
    ("COCO_val2014_000000000328.jpg", 2, 3),
    ("COCO_val2014_000000000338.jpg", 2, 2),
    ("COCO_val2014_000000000357.jpg", 0, 8),
];

fn named(variable: &str) -> Option<PathBuf> {
    let path = std::env::var_os(variable).map(PathBuf::from);
    if path.is_none() {
        eprintln!("skipped: {variable} is not set");
    }
    path
}

#[test]
fn photographs_show_as_many_people_as_there_are_with_heads_above_their_hips() {
    let (Some(models), Some(pictures), Some(library)) =
        (named("OGG_POSE_MODELS"), named("OGG_POSE_PICTURES"), named("ORT_DYLIB_PATH"))
    else {
        return;
    };
    let wish = LibraryCandidate { path: library, origin: LibraryOrigin::Environment };
    let library = LibraryChoice::Search(vec![wish]);
    let runtime = Runtime::load(RuntimeOptions { library, ..Default::default() }).unwrap();
    let model = Model::find(Path::new("openpose-mobilenet-v2-small"), &[models]).unwrap();
    let mut estimator = Estimator::load(&model, &runtime).unwrap();
    for (name, least, most) in PICTURES {
        let image = image::open(pictures.join(name)).unwrap().into_rgb8();
        let (width, height) = (image.width() as usize, image.height() as usize);
        let people = estimator.estimate(ImageView::new(width, height, image.as_raw()).unwrap()).unwrap();
        eprintln!("{name}: {} people", people.len());
        assert!((least..=most).contains(&people.len()), "{name}: {} people, expected {least} to {most}", people.len());
        // Of people who are mostly covered the network sees fragments.
        for person in people.iter().filter(|p| p.score >= 0.2) {
            assert_sensible(person, name);
        }
    }
}

/// Everybody in these pictures is upright: neck above hips above ankles. No limb is longer than the picture's person.
fn assert_sensible(person: &Person, name: &str) {
    let row = |part| person.get(part).map(|k| k.v_px);
    for (hip, ankle) in [(Part::RightHip, Part::RightAnkle), (Part::LeftHip, Part::LeftAnkle)] {
        for (upper, lower) in [(Part::Neck, hip), (hip, ankle)] {
            if let (Some(a), Some(b)) = (row(upper), row(lower)) {
                assert!(a < b, "{name}: {upper} at {a} px is below {lower} at {b} px");
            }
        }
    }
    let bounds = person.bounds(0.0).unwrap();
    for (a, b) in person.skeleton.bones() {
        if let (Some(a), Some(b)) = (person.keypoints[a], person.keypoints[b]) {
            assert!(a.distance_px(&b) < 0.8 * bounds.side_px(), "{name}: a limb of {} px", a.distance_px(&b));
        }
    }
}
