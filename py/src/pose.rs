//! Training targets, decoding, networks and their evaluation.

use std::path::PathBuf;
use std::sync::Mutex;

use numpy::{
    PyArray1, PyArray3, PyArray4, PyReadonlyArray2, PyReadonlyArray3, PyReadonlyArray4, PyUntypedArrayMethods,
};
use pose::{
    DetectedPose, ExecutionProvider, ImageView, LabelledPose, Labels, Layout, LibraryChoice, LibrarySearch, Limb,
    MapSpec, MapView, Maps, Model, OksParams, OpenPoseDecoder, OpenPoseSpec, Part, Person, Runtime, RuntimeOptions,
    Skeleton, Source, Subset, TargetParams, TargetPlan, onnxruntime_candidates,
};
use pyo3::prelude::*;

use crate::array::{borrowed, check_len, moved, moved3, moved4};
use crate::failure::Failure;

/// Confidence maps, fields, and the masks of both.
type MapArrays<'py> =
    (Bound<'py, PyArray4<f32>>, Bound<'py, PyArray4<f32>>, Bound<'py, PyArray4<f32>>, Bound<'py, PyArray4<f32>>);
/// Keypoints `(n, joints, 3)` as u, v, score (NaN, NaN, 0 where there is none), and scores `(n)`.
type People<'py> = (Bound<'py, PyArray3<f32>>, Bound<'py, PyArray1<f32>>);
/// From-part, to-part and the channels of the field.
type LimbTuple = (usize, usize, usize, usize);

fn skeleton_of(name: &str) -> Result<Skeleton, Failure> {
    Skeleton::ALL.iter().copied().find(|s| s.name() == name).ok_or_else(|| Failure::Argument {
        what: "skeleton",
        expected: format!("one of {:?}", Skeleton::ALL.iter().map(|s| s.name()).collect::<Vec<_>>()),
        got: format!("{name:?}"),
    })
}

fn limbs_of(skeleton: Skeleton, limbs: &[LimbTuple]) -> Result<Vec<Limb>, Failure> {
    let part = |index: usize| {
        skeleton.parts().get(index).copied().ok_or_else(|| Failure::Argument {
            what: "limbs",
            expected: format!("indices below {}", skeleton.len()),
            got: index.to_string(),
        })
    };
    limbs.iter().map(|&(from, to, x, y)| Ok(Limb { from: part(from)?, to: part(to)?, paf: [x, y] })).collect()
}

/// Name, part names, mirror and bones of every skeleton.
#[pyfunction]
pub(crate) fn skeletons() -> Vec<(&'static str, Vec<&'static str>, Vec<usize>, Vec<(usize, usize)>)> {
    let parts = |s: &Skeleton| s.parts().iter().map(|p| p.name()).collect();
    Skeleton::ALL.iter().map(|s| (s.name(), parts(s), s.mirror(), s.bones())).collect()
}

/// For every keypoint of `to` the two keypoints of `from` it is the middle of; None where there is none.
#[pyfunction]
pub(crate) fn skeleton_sources(to: &str, from: &str) -> PyResult<Vec<Option<(usize, usize)>>> {
    let sources = skeleton_of(to)?.sources(skeleton_of(from)?);
    Ok(sources
        .into_iter()
        .map(|source| match source {
            Source::Same(i) => Some((i, i)),
            Source::Middle(i, j) => Some((i, j)),
            Source::Absent => None,
        })
        .collect())
}

fn arrays<'py>(py: Python<'py>, maps: Maps, batch: usize, plan: &TargetPlan) -> PyResult<MapArrays<'py>> {
    let ((rows, columns), (pcm, paf)) = (plan.map_size(), plan.channels());
    Ok((
        moved4(py, maps.pcm, [batch, pcm, rows, columns])?,
        moved4(py, maps.paf, [batch, paf, rows, columns])?,
        moved4(py, maps.pcm_mask, [batch, pcm, rows, columns])?,
        moved4(py, maps.paf_mask, [batch, paf, rows, columns])?,
    ))
}

/// Targets of a batch.
#[pyfunction]
#[pyo3(signature = (joints_px, states, boxes_px, *, skeleton, limbs, width, height, stride, sigma_px, half_width_px))]
#[expect(clippy::too_many_arguments, reason = "a keyword-only Python signature")]
pub(crate) fn encode_targets<'py>(
    py: Python<'py>,
    joints_px: PyReadonlyArray4<'py, f32>,
    states: PyReadonlyArray3<'py, u8>,
    boxes_px: PyReadonlyArray3<'py, f32>,
    skeleton: &str,
    limbs: Vec<LimbTuple>,
    width: usize,
    height: usize,
    stride: usize,
    sigma_px: f32,
    half_width_px: f32,
) -> PyResult<MapArrays<'py>> {
    let skeleton = skeleton_of(skeleton)?;
    let limbs = limbs_of(skeleton, &limbs)?;
    let plan = TargetParams { skeleton, limbs, width, height, stride, sigma_px, half_width_px }
        .validate()
        .map_err(Failure::from)?;
    let (batch, people) = (states.shape()[0], states.shape()[1]);
    check_len("joints", skeleton.len(), states.shape()[2])?;
    let labels = Labels {
        batch,
        people,
        joints_px: borrowed("joints_px", &joints_px)?,
        states: borrowed("states", &states)?,
        boxes_px: borrowed("boxes_px", &boxes_px)?,
    };
    let maps = py.detach(|| plan.encode(&labels)).map_err(Failure::from)?;
    arrays(py, maps, batch, &plan)
}

/// Labels corrected by a teacher.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the arrays of two batches")]
pub(crate) fn fuse_labels<'py>(
    py: Python<'py>,
    pcm: PyReadonlyArray4<'py, f32>,
    paf: PyReadonlyArray4<'py, f32>,
    pcm_mask: PyReadonlyArray4<'py, f32>,
    paf_mask: PyReadonlyArray4<'py, f32>,
    teacher_pcm: PyReadonlyArray4<'py, f32>,
    teacher_paf: PyReadonlyArray4<'py, f32>,
    floor: f32,
) -> PyResult<MapArrays<'py>> {
    let [batch, channels, rows, columns] = *pcm.shape() else { unreachable!("the array has four axes") };
    let skeleton = Skeleton::ALL.iter().copied().find(|s| s.len() + 1 == channels).ok_or_else(|| {
        let known: Vec<usize> = Skeleton::ALL.iter().map(|s| s.len() + 1).collect();
        Failure::Argument {
            what: "confidence maps",
            expected: format!("one of {known:?} channels, background included"),
            got: channels.to_string(),
        }
    })?;
    // Fusion asks for the number of fields only, not for what they join.
    let [from, to] = [skeleton.parts()[0], skeleton.parts()[1]];
    let limbs = (0..paf.shape()[1] / 2).map(|l| Limb { from, to, paf: [2 * l, 2 * l + 1] }).collect();
    let plan =
        TargetParams { skeleton, limbs, width: columns, height: rows, stride: 1, sigma_px: 1.0, half_width_px: 1.0 };
    let plan = plan.validate().map_err(Failure::from)?;
    let mut maps = Maps {
        pcm: borrowed("pcm", &pcm)?.to_vec(),
        paf: borrowed("paf", &paf)?.to_vec(),
        pcm_mask: borrowed("pcm_mask", &pcm_mask)?.to_vec(),
        paf_mask: borrowed("paf_mask", &paf_mask)?.to_vec(),
    };
    let (teacher_pcm, teacher_paf) = (borrowed("teacher_pcm", &teacher_pcm)?, borrowed("teacher_paf", &teacher_paf)?);
    py.detach(|| plan.fuse(&mut maps, teacher_pcm, teacher_paf, floor)).map_err(Failure::from)?;
    arrays(py, maps, batch, &plan)
}

fn people_arrays<'py>(py: Python<'py>, people: &[Person], joints: usize) -> PyResult<People<'py>> {
    let mut numbers = Vec::with_capacity(people.len() * joints * 3);
    for keypoint in people.iter().flat_map(|p| &p.keypoints) {
        numbers.extend(keypoint.map_or([f32::NAN, f32::NAN, 0.0], |k| [k.u_px, k.v_px, k.score]));
    }
    let scores = people.iter().map(|p| p.score).collect();
    Ok((moved3(py, numbers, [people.len(), joints, 3])?, moved(py, scores)))
}

/// People in the maps of one picture, `(channels, rows, columns)` each.
#[pyfunction]
#[pyo3(signature = (pcm, paf, *, skeleton, limbs, stride, peak_threshold, paf_threshold, min_score))]
#[expect(clippy::too_many_arguments, reason = "a keyword-only Python signature")]
pub(crate) fn decode<'py>(
    py: Python<'py>,
    pcm: PyReadonlyArray3<'py, f32>,
    paf: PyReadonlyArray3<'py, f32>,
    skeleton: &str,
    limbs: Vec<LimbTuple>,
    stride: usize,
    peak_threshold: f32,
    paf_threshold: f32,
    min_score: f32,
) -> PyResult<People<'py>> {
    let skeleton = skeleton_of(skeleton)?;
    let limbs = limbs_of(skeleton, &limbs)?;
    let (height, width) = (pcm.shape()[1], pcm.shape()[2]);
    if pcm.shape()[0] < skeleton.len() {
        check_len("channels of pcm", skeleton.len(), pcm.shape()[0])?;
    }
    if let Some(channel) = limbs.iter().flat_map(|l| l.paf).find(|c| *c >= paf.shape()[0]) {
        check_len("channels of paf", channel + 1, paf.shape()[0])?;
    }
    check_len("rows of paf", height, paf.shape()[1])?;
    check_len("columns of paf", width, paf.shape()[2])?;
    let map = |channels| MapSpec { output: String::new(), first: 0, channels };
    let spec = OpenPoseSpec {
        stride,
        layout: Layout::Nchw,
        pcm: map(pcm.shape()[0]),
        paf: map(paf.shape()[0]),
        limbs,
        peak_threshold,
        paf_threshold,
    };
    let view = |data, channels| MapView { data, layout: Layout::Nchw, channels, first: 0, width, height };
    let (pcm_view, paf_view) =
        (view(borrowed("pcm", &pcm)?, pcm.shape()[0]), view(borrowed("paf", &paf)?, paf.shape()[0]));
    let people = if width * height == 0 {
        Vec::new()
    } else {
        py.detach(|| OpenPoseDecoder::new(skeleton, &spec, min_score).decode(pcm_view, paf_view))
    };
    people_arrays(py, &people, skeleton.len())
}

/// The ten numbers of COCO.
#[pyfunction]
#[pyo3(signature = (gt_images, gt_keypoints, gt_boxes, gt_crowd, dt_images, dt_keypoints, dt_scores, *, sigmas, keypoints, visibility, max_detections))]
#[expect(clippy::too_many_arguments, reason = "a keyword-only Python signature")]
pub(crate) fn evaluate_keypoints(
    py: Python<'_>,
    gt_images: Vec<u64>,
    gt_keypoints: PyReadonlyArray3<'_, f64>,
    gt_boxes: PyReadonlyArray2<'_, f64>,
    gt_crowd: Vec<bool>,
    dt_images: Vec<u64>,
    dt_keypoints: PyReadonlyArray3<'_, f64>,
    dt_scores: Vec<f64>,
    sigmas: Vec<f64>,
    keypoints: Option<Vec<usize>>,
    visibility: Option<u8>,
    max_detections: usize,
) -> PyResult<[Option<f64>; 10]> {
    check_len("numbers per label keypoint", 3, gt_keypoints.shape()[2])?;
    check_len("numbers per label box and area", 5, gt_boxes.shape()[1])?;
    check_len("numbers per detection keypoint", 2, dt_keypoints.shape()[2])?;
    let joints = sigmas.len();
    for (what, got) in
        [("keypoints of a label", gt_keypoints.shape()[1]), ("keypoints of a detection", dt_keypoints.shape()[1])]
    {
        check_len(what, joints, got)?;
    }
    let labels: Vec<LabelledPose> = borrowed("gt_keypoints", &gt_keypoints)?
        .chunks_exact(3 * joints.max(1))
        .zip(borrowed("gt_boxes", &gt_boxes)?.chunks_exact(5))
        .zip(gt_images.iter().zip(&gt_crowd))
        .map(|((points, place), (&image_id, &is_crowd))| LabelledPose {
            image_id,
            keypoints: points.chunks_exact(3).map(|k| [k[0], k[1], k[2]]).collect(),
            area_px2: place[4],
            box_px: [place[0], place[1], place[2], place[3]],
            is_crowd,
        })
        .collect();
    let detections: Vec<DetectedPose> = borrowed("dt_keypoints", &dt_keypoints)?
        .chunks_exact(2 * joints.max(1))
        .zip(dt_images.iter().zip(&dt_scores))
        .map(|(points, (&image_id, &score))| DetectedPose {
            image_id,
            keypoints: points.chunks_exact(2).map(|k| [k[0], k[1]]).collect(),
            score,
        })
        .collect();
    let params = OksParams { sigmas, max_detections, subset: Subset { keypoints, visibility } };
    let s = py.detach(|| params.evaluate(&labels, &detections)).map_err(Failure::from)?;
    Ok([s.ap, s.ap_50, s.ap_75, s.ap_medium, s.ap_large, s.ar, s.ar_50, s.ar_75, s.ar_medium, s.ar_large])
}

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
    fn lock(&self) -> std::sync::MutexGuard<'_, pose::Estimator> {
        self.inner.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

#[pymethods]
impl Estimator {
    /// `library` is a path, `"tract"`, or None for the first that is found, `site_packages` included.
    #[new]
    #[pyo3(signature = (card, *, weights_dirs, library, site_packages, provider, fallback, threads))]
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
                pose::Estimator::load(&model, &Runtime::load(options)?)
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

/// COCO's standard deviations.
#[pyfunction]
pub(crate) fn coco_sigmas() -> Vec<f64> {
    pose::COCO_17_SIGMAS.to_vec()
}

/// Names of the compiled-in cards.
#[pyfunction]
pub(crate) fn builtin_cards() -> Vec<String> {
    Model::builtin_cards().into_iter().map(|card| card.name).collect()
}

/// Limbs of the built-in network in the order of assembly.
#[pyfunction]
pub(crate) fn published_limbs() -> PyResult<Vec<LimbTuple>> {
    let card = Model::default().card;
    let index = |part: Part| {
        card.skeleton.index_of(part).ok_or_else(|| Failure::Argument {
            what: "limbs of the built-in card",
            expected: card.skeleton.to_string(),
            got: part.to_string(),
        })
    };
    let limbs = card.openpose.iter().flat_map(|spec| &spec.limbs);
    Ok(limbs.map(|l| Ok((index(l.from)?, index(l.to)?, l.paf[0], l.paf[1]))).collect::<Result<_, Failure>>()?)
}
