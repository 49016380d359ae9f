//! Training targets, decoding, and orders of keypoints.

use numpy::{PyArray1, PyArray3, PyArray4, PyReadonlyArray3, PyReadonlyArray4, PyUntypedArrayMethods};
use pose::{
    Labels, Layout, Limb, MapSpec, MapView, Maps, Model, OpenPoseDecoder, OpenPoseSpec, Part, Person, Skeleton, Source,
    TargetParams, TargetPlan,
};
use pyo3::prelude::*;

use crate::array::{borrowed, check_len, moved, moved3, moved4};
use crate::failure::Failure;

/// Confidence maps, fields, and the masks of both.
type MapArrays<'py> =
    (Bound<'py, PyArray4<f32>>, Bound<'py, PyArray4<f32>>, Bound<'py, PyArray4<bool>>, Bound<'py, PyArray4<bool>>);
/// Keypoints `(n, joints, 3)` as u, v, score (NaN, NaN, 0 where there is none), and scores `(n)`.
pub(crate) type People<'py> = (Bound<'py, PyArray3<f32>>, Bound<'py, PyArray1<f32>>);
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
    pcm_mask: PyReadonlyArray4<'py, bool>,
    paf_mask: PyReadonlyArray4<'py, bool>,
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

pub(crate) fn people_arrays<'py>(py: Python<'py>, people: &[Person], joints: usize) -> PyResult<People<'py>> {
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
