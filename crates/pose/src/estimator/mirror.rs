//! A second look at the mirrored picture.
//!
//! The maps of the mirrored picture are mirrored back, right and left are exchanged, and the mean of both looks is decoded. Pose
//! networks are commonly scored so (Newell et al. 2016; "flip test"): what a network says of one side only loses half its
//! weight.

use crate::{
    Error, Part, Result,
    card::{Layout, ModelCard, OpenPoseSpec},
    decode::MapView,
};

/// Where a channel lies in the maps of the mirrored picture.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Channel {
    from: usize,
    sign: f32,
}

/// The mirrored maps of one output, and the mean.
#[derive(Debug)]
struct Maps {
    channels: Vec<Channel>,
    mirrored: Vec<f32>,
    mean: Vec<f32>,
}

/// Confidence maps and fields of two looks.
#[derive(Debug)]
pub(super) struct Mirror {
    pcm: Maps,
    paf: Maps,
}

impl Mirror {
    /// # Errors
    /// [`Error::Parameter`] when the network gives no maps, or fields of one side only.
    pub(super) fn new(card: &ModelCard) -> Result<Self> {
        let bad = |expected, got| Err(Error::Parameter { field: "mirror", expected, got });
        let Some(spec) = &card.openpose else {
            return bad("a network that answers with confidence maps and fields", card.name.clone());
        };
        let joints = card.skeleton.mirror();
        let from = |channel: usize| joints.get(channel).copied().unwrap_or(channel);
        let pcm = (0..spec.pcm.channels).map(|channel| Channel { from: from(channel), sign: 1.0 }).collect();
        let mut paf: Vec<_> = (0..spec.paf.channels).map(|from| Channel { from, sign: 1.0 }).collect();
        for limb in &spec.limbs {
            let Some(([u, v], [sign_u, sign_v])) = field(spec, limb.from.mirrored(), limb.to.mirrored()) else {
                return bad("fields of both sides", format!("{} to {} of one side", limb.from, limb.to));
            };
            paf[limb.paf[0]] = Channel { from: u, sign: sign_u };
            paf[limb.paf[1]] = Channel { from: v, sign: sign_v };
        }
        Ok(Self { pcm: Maps::new(pcm), paf: Maps::new(paf) })
    }

    /// Keeps what the network says of the mirrored picture.
    pub(super) fn keep(&mut self, pcm: MapView<'_>, paf: MapView<'_>) {
        self.pcm.keep(pcm);
        self.paf.keep(paf);
    }

    /// The mean of what it says of the picture and of what was kept.
    pub(super) fn mean(&mut self, pcm: MapView<'_>, paf: MapView<'_>) -> (MapView<'_>, MapView<'_>) {
        (self.pcm.mean(pcm), self.paf.mean(paf))
    }
}

/// The channels of a limb's field, and what mirroring does to u and v: u turns round, and both do where the limb is listed from its
/// other end.
fn field(spec: &OpenPoseSpec, from: Part, to: Part) -> Option<([usize; 2], [f32; 2])> {
    let listed = |from, to| spec.limbs.iter().find(|limb| (limb.from, limb.to) == (from, to)).map(|limb| limb.paf);
    let same = listed(from, to).map(|paf| (paf, [-1.0, 1.0]));
    same.or_else(|| listed(to, from).map(|paf| (paf, [1.0, -1.0])))
}

impl Maps {
    fn new(channels: Vec<Channel>) -> Self {
        Self { channels, mirrored: Vec::new(), mean: Vec::new() }
    }

    fn keep(&mut self, maps: MapView<'_>) {
        let cells = maps.width * maps.height;
        self.mirrored.resize(self.channels.len() * cells, 0.0);
        for (channel, plane) in self.mirrored.chunks_exact_mut(cells).enumerate() {
            maps.copy_plane(channel, plane);
        }
    }

    fn mean(&mut self, maps: MapView<'_>) -> MapView<'_> {
        let (width, height) = (maps.width, maps.height);
        self.mean.resize(self.mirrored.len(), 0.0);
        for (number, plane) in self.mean.chunks_exact_mut(width * height).enumerate() {
            maps.copy_plane(number, plane);
            let Channel { from, sign } = self.channels[number];
            let other = self.mirrored[from * width * height..].chunks_exact(width);
            for (row, other) in plane.chunks_exact_mut(width).zip(other) {
                for (own, other) in row.iter_mut().zip(other.iter().rev()) {
                    *own = 0.5 * (*own + sign * other);
                }
            }
        }
        MapView { data: &self.mean, layout: Layout::Nchw, channels: self.channels.len(), first: 0, width, height }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{JointState, Labels, Limb, Model, Skeleton, TargetParams};

    fn card() -> ModelCard {
        Model::default().card
    }

    /// Judge: the target encoder. What is said of a person and of the mirrored person with right and left exchanged is the same.
    #[test]
    fn the_mean_of_two_equal_answers_is_either() {
        let card = card();
        let limbs = card.openpose.as_ref().unwrap().limbs.clone();
        let plan = TargetParams::openpose(card.skeleton, limbs, 128, 96).validate().unwrap();
        let joints: Vec<[f32; 2]> =
            (0..18).map(|i| [10.0 + (i * 31 % 100) as f32, 8.0 + (i * 17 % 80) as f32]).collect();
        let mirrored: Vec<[f32; 2]> =
            card.skeleton.mirror().iter().map(|&from| [127.0 - joints[from][0], joints[from][1]]).collect();
        let encode = |joints_px: &[[f32; 2]]| {
            let states = [JointState::Labelled as u8; 18];
            let boxes_px = &[0.0, 0.0, 127.0, 95.0];
            let joints_px = joints_px.as_flattened();
            plan.encode(&Labels { batch: 1, people: 1, joints_px, states: &states, boxes_px }).unwrap()
        };
        let (straight, mirrored) = (encode(&joints), encode(&mirrored));
        let view = |data, channels| MapView { data, layout: Layout::Nchw, channels, first: 0, width: 16, height: 12 };
        let mut mirror = Mirror::new(&card).unwrap();
        mirror.keep(view(&mirrored.pcm, 19), view(&mirrored.paf, 38));
        let (pcm, paf) = mirror.mean(view(&straight.pcm, 19), view(&straight.paf, 38));
        for (mean, expected) in pcm.data.iter().chain(paf.data).zip(straight.pcm.iter().chain(&straight.paf)) {
            assert!((mean - expected).abs() < 1e-5, "{mean} {expected}");
        }
        assert!(straight.paf.iter().any(|x| *x < -0.5), "no field that points to the left");
    }

    #[test]
    fn a_limb_listed_from_its_other_end_turns_round() {
        let mut card = card();
        let limbs = &mut card.openpose.as_mut().unwrap().limbs;
        let arm = limbs.iter_mut().find(|l| l.from == Part::LeftElbow && l.to == Part::LeftWrist).unwrap();
        (arm.from, arm.to) = (arm.to, arm.from);
        let channel = arm.paf[0];
        let right = limbs.iter().find(|l| l.to == Part::RightWrist).unwrap().paf[0];
        let mirror = Mirror::new(&card).unwrap();
        assert_eq!(mirror.paf.channels[channel], Channel { from: right, sign: 1.0 });
        assert_eq!(mirror.paf.channels[channel + 1], Channel { from: right + 1, sign: -1.0 });
    }

    #[test]
    fn networks_without_maps_and_fields_of_one_side_are_refused() {
        let refused = |card: &ModelCard| Mirror::new(card).unwrap_err().to_string();
        let cards = Model::builtin_cards();
        let thunder = cards.iter().find(|c| c.name == "movenet-thunder").unwrap();
        assert_eq!(
            refused(thunder),
            "mirror: expected a network that answers with confidence maps and fields, got movenet-thunder"
        );
        let mut one_side = card();
        let arm = Limb { from: Part::RightElbow, to: Part::RightWrist, paf: [0, 1] };
        one_side.openpose.as_mut().unwrap().limbs = vec![arm];
        assert_eq!(one_side.skeleton, Skeleton::OpenPose18);
        assert_eq!(
            refused(&one_side),
            "mirror: expected fields of both sides, got right_elbow to right_wrist of one side"
        );
    }
}
