//! What targets are made of, and the check of it.

use super::TargetPlan;
use crate::{Error, Result, Skeleton, card::Limb};

/// Size and width of the targets.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetParams {
    /// Order of the joints.
    pub skeleton: Skeleton,
    /// Limbs; `paf` of each says where its two channels go.
    pub limbs: Vec<Limb>,
    /// Width of the picture, px; a multiple of the stride.
    pub width: usize,
    /// Height of the picture, px; a multiple of the stride.
    pub height: usize,
    /// Pixels per cell.
    pub stride: usize,
    /// Width of the Gaussians, px.
    pub sigma_px: f32,
    /// Half the width of a limb, px.
    pub half_width_px: f32,
}

impl TargetParams {
    /// The published OpenPose widths for stride 8: sigma 7 px, limbs one cell to each side.
    pub fn openpose(skeleton: Skeleton, limbs: Vec<Limb>, width: usize, height: usize) -> Self {
        Self { skeleton, limbs, width, height, stride: 8, sigma_px: 7.0, half_width_px: 8.0 }
    }

    /// Checks everything and fixes the order of the channels.
    ///
    /// # Errors
    /// [`Error::Parameter`] with the field.
    pub fn validate(self) -> Result<TargetPlan> {
        let bad = |field, expected, got: String| Err(Error::Parameter { field, expected, got });
        if self.stride == 0 || self.width == 0 || !self.width.is_multiple_of(self.stride) {
            return bad("width", "a multiple of the stride", self.width.to_string());
        }
        if self.height == 0 || !self.height.is_multiple_of(self.stride) {
            return bad("height", "a multiple of the stride", self.height.to_string());
        }
        for (field, x) in [("sigma_px", self.sigma_px), ("half_width_px", self.half_width_px)] {
            if !(x > 0.0 && x.is_finite()) {
                return bad(field, "above 0 px", x.to_string());
            }
        }
        if self.limbs.is_empty() {
            return bad("limbs", "at least one", "none".to_owned());
        }
        let mut ends = vec![None; self.limbs.len()];
        for limb in &self.limbs {
            let (Some(from), Some(to)) = (self.skeleton.index_of(limb.from), self.skeleton.index_of(limb.to)) else {
                return bad("limbs", "parts of the skeleton", format!("{} to {}", limb.from, limb.to));
            };
            let slot = limb.paf[0] / 2;
            if limb.paf[0] % 2 != 0 || limb.paf[1] != limb.paf[0] + 1 || slot >= ends.len() || ends[slot].is_some() {
                return bad("limbs.paf", "channels 2 l and 2 l + 1, each l once", format!("{:?}", limb.paf));
            }
            ends[slot] = Some([from, to]);
        }
        let ends = ends.into_iter().flatten().collect();
        Ok(TargetPlan { params: self, ends })
    }
}
