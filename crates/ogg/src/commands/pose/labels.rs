//! Labels from files: COCO keypoint JSON, and tables of arm joints.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use pose::{Part, Side, Skeleton};
use serde::Deserialize;

use crate::error::Error;

/// A labelled person.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Label {
    /// u, v (0 is the centre of the first pixel) and COCO's visibility: 0 not labelled, 1 covered, 2 visible; in the order
    /// of the set's skeleton.
    pub(super) keypoints: Vec<[f64; 3]>,
    /// Area, px^2, and box; `None` where the labels have none.
    pub(super) size: Option<(f64, [f64; 4])>,
    pub(super) is_crowd: bool,
    /// The length that PCK takes its fractions of, px.
    pub(super) torso_px: f64,
}

/// A picture with its people.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Picture {
    /// Group of the report, such as a camera.
    pub(super) group: String,
    /// The file, or the number of the frame in the group's video.
    pub(super) place: Place,
    pub(super) labels: Vec<Label>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Place {
    File(PathBuf),
    Frame(u64),
}

/// All labels of a file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct LabelSet {
    pub(super) skeleton: Skeleton,
    /// In order of group and frame; pictures of files in the order of the file.
    pub(super) pictures: Vec<Picture>,
}

impl LabelSet {
    /// Reads labels of either kind.
    pub(super) fn read(path: &Path, images: &Path) -> Result<Self, Error> {
        let text = std::fs::read_to_string(path).map_err(|source| Error::File {
            path: path.to_owned(),
            expected: "labels: a COCO keypoint file (.json) or a table of arm joints (.csv)",
            source,
        })?;
        let wrong = |message: String| Error::Content { path: path.to_owned(), message };
        if path.extension().is_some_and(|e| e == "csv") {
            return table(&text).map_err(wrong);
        }
        let extras = path.with_file_name("extras.json");
        let places = if extras.is_file() {
            let text = std::fs::read_to_string(&extras).map_err(|source| Error::File {
                path: extras.clone(),
                expected: "true places of joints",
                source,
            })?;
            true_places(&text).map_err(|message| Error::Content { path: extras, message })?
        } else {
            BTreeMap::new()
        };
        coco(&text, &places, images).map_err(wrong)
    }
}

#[derive(Debug, Deserialize)]
struct CocoFile {
    images: Vec<CocoImage>,
    annotations: Vec<CocoAnnotation>,
    #[serde(default)]
    categories: Vec<CocoCategory>,
}

#[derive(Debug, Deserialize)]
struct CocoImage {
    id: u64,
    file_name: PathBuf,
}

#[derive(Debug, Deserialize)]
struct CocoAnnotation {
    #[serde(default)]
    id: u64,
    image_id: u64,
    #[serde(default)]
    keypoints: Vec<f64>,
    area: Option<f64>,
    bbox: [f64; 4],
    #[serde(default)]
    iscrowd: u8,
}

#[derive(Debug, Deserialize)]
struct CocoCategory {
    #[serde(default)]
    keypoints: Vec<String>,
}

#[derive(Debug, Deserialize)]
struct ExtrasFile {
    annotations: Vec<ExtrasAnnotation>,
}

#[derive(Debug, Deserialize)]
struct ExtrasAnnotation {
    annotation_id: u64,
    keypoints18: Vec<Option<Vec<f64>>>,
}

/// Places of joints in the order of OpenPose-18, by annotation.
type TruePlaces = BTreeMap<u64, Vec<Option<[f64; 2]>>>;

fn true_places(text: &str) -> Result<TruePlaces, String> {
    let file: ExtrasFile = serde_json::from_str(text).map_err(|e| e.to_string())?;
    let place = |p: Option<Vec<f64>>| p.and_then(|p| Some([*p.first()?, *p.get(1)?]));
    Ok(file
        .annotations
        .into_iter()
        .map(|a| (a.annotation_id, a.keypoints18.into_iter().map(place).collect()))
        .collect())
}

fn coco(text: &str, places: &TruePlaces, images: &Path) -> Result<LabelSet, String> {
    let file: CocoFile = serde_json::from_str(text).map_err(|e| e.to_string())?;
    let names = file.categories.into_iter().map(|c| c.keypoints).find(|k| !k.is_empty());
    let skeleton = match &names {
        None => Skeleton::Coco17,
        Some(names) => Skeleton::ALL
            .iter()
            .copied()
            .find(|s| s.parts().iter().map(|p| p.name()).eq(names.iter().map(String::as_str)))
            .ok_or_else(|| {
                let known: Vec<&str> = Skeleton::ALL.iter().map(|s| s.name()).collect();
                format!("categories.keypoints: {names:?}, expected the order of one of {}", known.join(", "))
            })?,
    };
    let joints = skeleton.len();
    let mut by_image: BTreeMap<u64, Vec<Label>> = BTreeMap::new();
    for (i, a) in file.annotations.into_iter().enumerate() {
        let mut keypoints = match a.keypoints.len() {
            0 => vec![[0.0; 3]; joints],
            n if n == joints * 3 => a.keypoints.as_chunks::<3>().0.to_vec(),
            n => return Err(format!("annotations[{i}].keypoints: {n} numbers, expected {}", joints * 3)),
        };
        let numbers = keypoints.iter().flatten().chain(&a.bbox).chain(&a.area);
        if let Some(x) = numbers.copied().find(|x| !x.is_finite()) {
            return Err(format!("annotations[{i}]: {x}, expected finite numbers"));
        }
        if let Some(true_places) = places.get(&a.id) {
            uncover(&mut keypoints, skeleton, true_places);
        }
        let [_, _, width, height] = a.bbox;
        let area = a.area.unwrap_or(width * height);
        let torso_px = torso(&keypoints, skeleton, places.get(&a.id)).unwrap_or(TORSO_OF_SIDE * area.sqrt());
        by_image.entry(a.image_id).or_default().push(Label {
            keypoints,
            size: Some((area, a.bbox)),
            is_crowd: a.iscrowd != 0,
            torso_px,
        });
    }
    let pictures = file
        .images
        .into_iter()
        .map(|image| Picture {
            group: "all".to_owned(),
            place: Place::File(images.join(image.file_name)),
            labels: by_image.remove(&image.id).unwrap_or_default(),
        })
        .collect();
    match by_image.keys().next() {
        Some(id) => Err(format!("annotations: image_id {id}, expected the id of one of the images")),
        None => Ok(LabelSet { skeleton, pictures }),
    }
}

/// A covered arm joint whose true place is known is labelled as covered.
fn uncover(keypoints: &mut [[f64; 3]], skeleton: Skeleton, places: &[Option<[f64; 2]>]) {
    let arms: Vec<Part> = [Side::Left, Side::Right].into_iter().flat_map(Part::arm).collect();
    for (part, keypoint) in skeleton.parts().iter().zip(keypoints) {
        let place = Skeleton::OpenPose18.index_of(*part).and_then(|i| places.get(i).copied().flatten());
        if let Some([u, v]) = place.filter(|_| keypoint[2] < 2.0 && arms.contains(part)) {
            *keypoint = [u, v, 1.0];
        }
    }
}

/// Torso over the square root of the area where no hips are labelled: COCO's people have about this ratio.
const TORSO_OF_SIDE: f64 = 0.5;

/// Mean distance of shoulder and hip of the sides that are labelled.
fn torso(keypoints: &[[f64; 3]], skeleton: Skeleton, places: Option<&Vec<Option<[f64; 2]>>>) -> Option<f64> {
    let at = |part: Part| -> Option<[f64; 2]> {
        let known = || places?.get(Skeleton::OpenPose18.index_of(part)?).copied().flatten();
        let labelled = || {
            let [u, v, visible] = *keypoints.get(skeleton.index_of(part)?)?;
            (visible > 0.0).then_some([u, v])
        };
        labelled().or_else(known)
    };
    let sides = [(Part::LeftShoulder, Part::LeftHip), (Part::RightShoulder, Part::RightHip)];
    let lengths: Vec<f64> = sides
        .into_iter()
        .filter_map(|(shoulder, hip)| {
            let (a, b) = (at(shoulder)?, at(hip)?);
            Some((a[0] - b[0]).hypot(a[1] - b[1]))
        })
        .collect();
    (!lengths.is_empty()).then(|| lengths.iter().sum::<f64>() / lengths.len() as f64).filter(|t| *t >= 1.0)
}

/// Short names of the table's columns.
const COLUMNS: [(&str, Part); 6] = [
    ("rsho", Part::RightShoulder),
    ("relb", Part::RightElbow),
    ("rwri", Part::RightWrist),
    ("lsho", Part::LeftShoulder),
    ("lelb", Part::LeftElbow),
    ("lwri", Part::LeftWrist),
];

/// Shoulder to hip over upper arm and forearm together: 0.288 and 0.332 of stature (Drillis and Contini, 1966). Both arms
/// point at the camera at once in few pictures, so the longest arm of a camera's pictures stands for its true length.
const TORSO_OF_ARM: f64 = 0.288 / 0.332;

fn table(text: &str) -> Result<LabelSet, String> {
    let skeleton = Skeleton::UpperLimb8;
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').map(str::trim).collect();
    let column = |name: &str| {
        header.iter().position(|h| *h == name).ok_or_else(|| format!("line 1: no column {name:?}; it has {header:?}"))
    };
    let (camera, frame) = (column("camera")?, column("frame")?);
    let mut joints = Vec::new();
    for (short, part) in COLUMNS {
        let index = skeleton.index_of(part).ok_or("a part of the skeleton")?;
        joints.push((index, column(&format!("{short}_u_px"))?, column(&format!("{short}_v_px"))?));
    }
    let mut rows: BTreeMap<(String, u64), Vec<[f64; 3]>> = BTreeMap::new();
    for (i, line) in lines.enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let number = i + 2;
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        if fields.len() != header.len() {
            return Err(format!("line {number}: {} fields, expected {}", fields.len(), header.len()));
        }
        let frame: u64 = fields[frame]
            .parse()
            .map_err(|_| format!("line {number}, frame: {:?}, expected a whole number from 0", fields[frame]))?;
        let mut keypoints = vec![[0.0; 3]; skeleton.len()];
        for &(joint, u, v) in &joints {
            let value = |c: usize| match fields[c] {
                "" | "nan" | "NaN" => Ok(None),
                text => match text.parse::<f64>() {
                    Ok(x) if x.is_finite() => Ok(Some(x)),
                    _ => Err(format!("line {number}, {}: {text:?}, expected a number", header[c])),
                },
            };
            if let (Some(u), Some(v)) = (value(u)?, value(v)?) {
                keypoints[joint] = [u, v, 2.0];
            }
        }
        rows.insert((fields[camera].to_owned(), frame), keypoints);
    }
    if rows.is_empty() {
        return Err("line 2: the end, expected a row of labels".to_owned());
    }
    let mut arm_px: BTreeMap<String, f64> = BTreeMap::new();
    for ((camera, _), keypoints) in &rows {
        for side in [Side::Left, Side::Right] {
            let at = Part::arm(side).map(|p| skeleton.index_of(p).map(|i| keypoints[i]));
            let [Some(a), Some(b), Some(c)] = at else { continue };
            if [a, b, c].iter().all(|k| k[2] > 0.0) {
                let length = (a[0] - b[0]).hypot(a[1] - b[1]) + (b[0] - c[0]).hypot(b[1] - c[1]);
                let longest = arm_px.entry(camera.clone()).or_insert(length);
                *longest = longest.max(length);
            }
        }
    }
    let mut pictures = Vec::new();
    for ((camera, frame), keypoints) in rows {
        let arm_px = arm_px.get(&camera).ok_or_else(|| format!("{camera}: no picture with a whole arm"))?;
        let torso_px = TORSO_OF_ARM * arm_px;
        let label = Label { keypoints, size: None, is_crowd: false, torso_px };
        pictures.push(Picture { group: camera, place: Place::Frame(frame), labels: vec![label] });
    }
    Ok(LabelSet { skeleton, pictures })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_coco_file_gives_people_by_picture_with_torso_and_visibility() {
        let mut keypoints = vec![0.0; 51];
        for (i, u, v, seen) in [(5, 30.0, 10.0, 2.0), (11, 30.0, 60.0, 1.0), (10, 5.0, 6.0, 1.0)] {
            keypoints[3 * i..3 * i + 3].copy_from_slice(&[u, v, seen]);
        }
        let text = serde_json::json!({
            "images": [{ "id": 7, "file_name": "a.png" }, { "id": 8, "file_name": "b.png" }],
            "annotations": [{ "id": 3, "image_id": 8, "keypoints": keypoints, "area": 900.0, "bbox": [0, 0, 60, 90] }],
        })
        .to_string();
        let set = coco(&text, &BTreeMap::new(), Path::new("pictures")).unwrap();
        assert_eq!((set.skeleton, set.pictures.len()), (Skeleton::Coco17, 2));
        assert!(set.pictures[0].labels.is_empty());
        assert_eq!(set.pictures[1].place, Place::File("pictures/b.png".into()));
        let label = &set.pictures[1].labels[0];
        assert_eq!(label.keypoints[10].map(|x| x as i32), [5, 6, 1]);
        assert!((label.torso_px - 50.0).abs() < 1e-12);
        // The true place of a covered arm joint is a label; that of a leg is none.
        let mut places = vec![None; 18];
        places[4] = Some([90.0, 91.0]);
        places[9] = Some([1.0, 2.0]);
        let set = coco(&text, &BTreeMap::from([(3, places)]), Path::new("")).unwrap();
        let label = &set.pictures[1].labels[0];
        assert_eq!((label.keypoints[10], label.keypoints[14]), ([90.0, 91.0, 1.0], [0.0; 3]));
    }

    #[test]
    fn a_wrong_label_file_says_where() {
        let annotation = |keypoints: &str, image: u64| {
            format!(
                "{{\"images\": [{{\"id\": 1, \"file_name\": \"a\"}}], \"annotations\": [{{\"image_id\": {image}, \
                 \"bbox\": [0,0,1,1], \"keypoints\": {keypoints}}}]}}"
            )
        };
        let said = |text: &str| coco(text, &BTreeMap::new(), Path::new("")).unwrap_err();
        assert!(said(&annotation("[1, 2]", 1)).contains("annotations[0].keypoints: 2 numbers, expected 51"));
        assert!(said(&annotation("[]", 9)).contains("image_id 9"));
        assert!(said("{}").contains("images"));
    }

    #[test]
    fn a_table_gives_frames_by_camera_and_a_torso_from_the_longest_arm() {
        let text = "camera,frame,rsho_u_px,rsho_v_px,relb_u_px,relb_v_px,rwri_u_px,rwri_v_px,lsho_u_px,lsho_v_px,\
                    lelb_u_px,lelb_v_px,lwri_u_px,lwri_v_px\ncam2,10,0,0,0,100,0,166,50,0,50,40,,\ncam2,9,0,0,0,10,0,20,1,1,1,2,1,3\n";
        let set = table(text).unwrap();
        assert_eq!(
            set.pictures.iter().map(|p| p.place.clone()).collect::<Vec<_>>(),
            [Place::Frame(9), Place::Frame(10)]
        );
        let label = &set.pictures[1].labels[0];
        let at = |part| label.keypoints[set.skeleton.index_of(part).unwrap()];
        assert_eq!((at(Part::RightWrist), at(Part::LeftWrist)[2]), ([0.0, 166.0, 2.0], 0.0));
        assert!((label.torso_px - 144.0).abs() < 1e-9);
        let said = |text: &str| table(text).unwrap_err();
        assert!(said("camera,frame\n").contains("rsho_u_px"));
        assert!(said(&text.replace("cam2,9,0", "cam2,9,x")).contains("line 3, rsho_u_px: \"x\""));
        assert!(said(text.lines().next().unwrap()).contains("line 2"));
    }
}
