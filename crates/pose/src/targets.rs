//! Training targets: part confidence maps, part affinity fields, the mask W, and label fusion.
//!
//! Confidence maps (Cao et al. 2017, eq. 6), with `x_j` the place of joint j and p the centre of a cell:
//!
//! ```text
//! S_j(p) = max over people of exp(-|p - x_j|^2 / (2 sigma^2)),   background = 1 - max_j S_j
//! ```
//!
//! Affinity fields (eqs. 8 to 10): the unit vector from a limb's first joint to its second for every p between the ends
//! and within `half_width` of the line, averaged over the people there.
//!
//! The mask `W` (OGG eq. 1) is false where a label is missing, for each map and cell. [`JointState`] says what is known of a
//! joint:
//!
//! - a hidden joint (its place is known, and nobody is asked to see it) is left out within `3 sigma` of where it is;
//!   elsewhere the map must still be empty;
//! - an unknown joint leaves its map out all over the person's box;
//! - a joint outside the picture leaves nothing out;
//! - a limb is labelled when both ends are; with a hidden end it is left out along its line, with an unknown end all over
//!   the box, unless the other end is outside;
//! - the background is left out near hidden joints, and in the box of a person with an unknown joint where it would be
//!   above one half.
//!
//! Label fusion (OGG eq. 3): see [`TargetPlan::fuse`], and [`TargetPlan::encode_fused_into`] for both in one pass.
//!
//! Arrays are row-major. Joints are in picture coordinates (0 is the centre of the first pixel), maps are
//! `(batch, channel, row, column)`. A batch is spread over the threads of rayon. Gaussians are cut off where they fall
//! below 1e-7, which is what makes this fast; everything else is exact.

use pulp::Arch;
use rayon::prelude::*;

use crate::{Error, Result};

mod draw;
mod fuse;
mod params;
mod shape;

use draw::Sample;
pub use params::TargetParams;
use shape::Axis;

/// What is known of a joint of a person. The numbers are those of the arrays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum JointState {
    /// Nobody knows where it is, or whether it is in the picture.
    Unknown = 0,
    /// Its place is known, but the network is not asked for it.
    Hidden = 1,
    /// Not in the picture, or there is no such person.
    Outside = 2,
    /// Its place is known and is to be learnt, covered or not.
    Labelled = 3,
}

/// The labels of a batch, borrowed.
#[derive(Debug, Clone, Copy)]
pub struct Labels<'a> {
    /// Pictures.
    pub batch: usize,
    /// Slots for people in each picture.
    pub people: usize,
    /// `(batch, people, joints, 2)`: u and v, px. Not read where the state is unknown or outside.
    pub joints_px: &'a [f32],
    /// `(batch, people, joints)` of [`JointState`].
    pub states: &'a [u8],
    /// `(batch, people, 4)`: left, top, right, bottom, px.
    pub boxes_px: &'a [f32],
}

/// Targets and masks of a batch, `(batch, channels, rows, columns)` each.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Maps {
    /// Joints and background.
    pub pcm: Vec<f32>,
    /// Two channels for each limb.
    pub paf: Vec<f32>,
    /// Where `pcm` counts.
    pub pcm_mask: Vec<bool>,
    /// Where `paf` counts.
    pub paf_mask: Vec<bool>,
}

/// Checked parameters; makes targets.
///
/// ```
/// use pose::{Labels, Limb, Part, Skeleton, TargetParams};
/// let limb = Limb { from: Part::RightElbow, to: Part::RightWrist, paf: [0, 1] };
/// let plan = TargetParams::openpose(Skeleton::UpperLimb8, vec![limb], 64, 64).validate().unwrap();
/// let mut joints_px = [0.0; 16];
/// joints_px[6..10].copy_from_slice(&[11.5, 11.5, 43.5, 11.5]); // elbow and wrist on cell centres 1 and 5
/// let mut states = [2; 8];
/// states[3..5].fill(3);
/// let maps = plan.encode(&Labels {
///     batch: 1, people: 1, joints_px: &joints_px, states: &states, boxes_px: &[0.0, 0.0, 63.0, 63.0],
/// }).unwrap();
/// assert_eq!(maps.pcm[4 * 64 + 8 + 5], 1.0); // wrist map, row 1, column 5
/// assert_eq!((maps.paf[8 + 3], maps.paf[64 + 8 + 3]), (1.0, 0.0)); // half way: pointing right
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct TargetPlan {
    params: TargetParams,
    /// From and to of each limb, in channel order.
    ends: Vec<[usize; 2]>,
}

impl TargetPlan {
    /// Rows and columns of a map.
    pub fn map_size(&self) -> (usize, usize) {
        (self.params.height / self.params.stride, self.params.width / self.params.stride)
    }

    /// Channels of the confidence maps, background included, and of the fields.
    pub fn channels(&self) -> (usize, usize) {
        (self.params.skeleton.len() + 1, self.ends.len() * 2)
    }

    /// Targets of a batch.
    ///
    /// # Errors
    /// [`Error::Length`] when an array does not fit, [`Error::Parameter`] when a state is unknown or a labelled place is
    /// not finite.
    pub fn encode(&self, labels: &Labels<'_>) -> Result<Maps> {
        let mut maps = Maps::default();
        self.encode_into(labels, &mut maps)?;
        Ok(maps)
    }

    /// As [`TargetPlan::encode`], into maps whose memory is used again.
    ///
    /// # Errors
    /// As [`TargetPlan::encode`].
    pub fn encode_into(&self, labels: &Labels<'_>, maps: &mut Maps) -> Result<()> {
        self.check_labels(labels)?;
        self.draw(labels, None, maps);
        Ok(())
    }

    /// [`TargetPlan::encode_into`] and then [`TargetPlan::fuse`], with the same numbers. Every map is corrected while it is
    /// in the cache.
    ///
    /// # Errors
    /// As [`TargetPlan::encode`] and [`TargetPlan::fuse`].
    pub fn encode_fused_into(
        &self,
        labels: &Labels<'_>,
        teacher_pcm: &[f32],
        teacher_paf: &[f32],
        floor: f32,
        maps: &mut Maps,
    ) -> Result<()> {
        check_floor(floor)?;
        self.check_labels(labels)?;
        let (pcm, paf) = self.lengths();
        check_length("teacher_pcm", labels.batch * pcm, teacher_pcm.len())?;
        check_length("teacher_paf", labels.batch * paf, teacher_paf.len())?;
        self.draw(labels, Some((teacher_pcm, teacher_paf, floor)), maps);
        Ok(())
    }

    fn check_labels(&self, labels: &Labels<'_>) -> Result<()> {
        let joints = self.params.skeleton.len();
        check_length("joints_px", labels.batch * labels.people * joints * 2, labels.joints_px.len())?;
        check_length("states", labels.batch * labels.people * joints, labels.states.len())?;
        check_length("boxes_px", labels.batch * labels.people * 4, labels.boxes_px.len())?;
        for (state, place) in labels.states.iter().zip(labels.joints_px.chunks_exact(2)) {
            if *state > JointState::Labelled as u8 {
                return Err(Error::Parameter { field: "states", expected: "0 to 3", got: state.to_string() });
            }
            let placed = *state == JointState::Labelled as u8 || *state == JointState::Hidden as u8;
            if placed && !(place[0].is_finite() && place[1].is_finite()) {
                return Err(Error::Parameter { field: "joints_px", expected: "finite", got: format!("{place:?}") });
            }
        }
        Ok(())
    }

    /// Numbers of one picture's confidence maps, and of its fields.
    fn lengths(&self) -> (usize, usize) {
        let (rows, columns) = self.map_size();
        let (pcm, paf) = self.channels();
        (pcm * rows * columns, paf * rows * columns)
    }

    fn draw(&self, labels: &Labels<'_>, teacher: Option<(&[f32], &[f32], f32)>, maps: &mut Maps) {
        let (rows, columns) = self.map_size();
        let (pcm, paf) = self.lengths();
        for (map, mask, length) in [(&mut maps.pcm, &mut maps.pcm_mask, pcm), (&mut maps.paf, &mut maps.paf_mask, paf)]
        {
            map.resize(labels.batch * length, 0.0);
            mask.resize(labels.batch * length, true);
        }
        let arch = Arch::new();
        maps.pcm
            .par_chunks_exact_mut(pcm)
            .zip(maps.pcm_mask.par_chunks_exact_mut(pcm))
            .zip(maps.paf.par_chunks_exact_mut(paf))
            .zip(maps.paf_mask.par_chunks_exact_mut(paf))
            .enumerate()
            .for_each(|(i, (((pcm, pcm_mask), paf), paf_mask))| {
                let n = labels.people * self.params.skeleton.len();
                let sample = Sample {
                    params: &self.params,
                    ends: &self.ends,
                    rows: Axis::new(rows, self.params.stride),
                    columns: Axis::new(columns, self.params.stride),
                    joints_px: &labels.joints_px[i * n * 2..(i + 1) * n * 2],
                    states: &labels.states[i * n..(i + 1) * n],
                    boxes_px: &labels.boxes_px[i * labels.people * 4..(i + 1) * labels.people * 4],
                    teacher: teacher.map(|(t_pcm, t_paf, floor)| {
                        (&t_pcm[i * pcm.len()..(i + 1) * pcm.len()], &t_paf[i * paf.len()..(i + 1) * paf.len()], floor)
                    }),
                };
                arch.dispatch(draw::Picture { sample, pcm, pcm_mask, paf, paf_mask });
            });
    }

    /// Corrects labels by a teacher's maps, in place (OGG eq. 3; Kato et al. 2018):
    ///
    /// ```text
    /// S_LC = max(S*, S_T)                                    per cell; S_T is cut to 0..1
    /// L_LC = L* if |L*| > |L_T| else L_T                     per cell and limb
    /// ```
    ///
    /// The background follows from the fused joints. A cell that W leaves out counts again where the teacher answers with
    /// at least `floor`: otherwise W would hide exactly the covered joints that fusion restores.
    ///
    /// # Errors
    /// [`Error::Length`] when the teacher's maps have another size, [`Error::Parameter`] when `floor` is not above 0.
    pub fn fuse(&self, labels: &mut Maps, teacher_pcm: &[f32], teacher_paf: &[f32], floor: f32) -> Result<()> {
        check_floor(floor)?;
        let (pcm, paf) = self.lengths();
        let batch = labels.pcm.len() / pcm;
        for (what, expected, got) in [
            ("labels.pcm", batch * pcm, labels.pcm.len()),
            ("labels.pcm_mask", batch * pcm, labels.pcm_mask.len()),
            ("labels.paf", batch * paf, labels.paf.len()),
            ("labels.paf_mask", batch * paf, labels.paf_mask.len()),
            ("teacher_pcm", batch * pcm, teacher_pcm.len()),
            ("teacher_paf", batch * paf, teacher_paf.len()),
        ] {
            check_length(what, expected, got)?;
        }
        let (rows, columns) = self.map_size();
        let cells = rows * columns;
        let arch = Arch::new();
        let own = labels.pcm.par_chunks_exact_mut(pcm).zip(labels.pcm_mask.par_chunks_exact_mut(pcm));
        let fields = labels.paf.par_chunks_exact_mut(paf).zip(labels.paf_mask.par_chunks_exact_mut(paf));
        let teacher = teacher_pcm.par_chunks_exact(pcm).zip(teacher_paf.par_chunks_exact(paf));
        own.zip(fields).zip(teacher).for_each(|(((pcm, pcm_mask), (paf, paf_mask)), (t_pcm, t_paf))| {
            arch.dispatch(fuse::Picture { pcm, pcm_mask, paf, paf_mask, teacher: (t_pcm, t_paf), cells, floor });
        });
        Ok(())
    }
}

fn check_floor(floor: f32) -> Result<()> {
    if floor > 0.0 && floor.is_finite() {
        return Ok(());
    }
    Err(Error::Parameter { field: "floor", expected: "above 0", got: floor.to_string() })
}

fn check_length(what: &'static str, expected: usize, got: usize) -> Result<()> {
    if expected == got { Ok(()) } else { Err(Error::Length { what, expected, got }) }
}

#[cfg(test)]
mod tests;
