//! The three sewing actions as one-cycle profiles.
//!
//! A profile maps the phase `u` in `[0, 1)` of a cycle to displacements from the home pose. Every profile and its
//! first three derivatives vanish at both ends of the cycle, so any two actions may follow one another.
//! Amplitudes follow Sect. 5.2 of the paper (Fig. 6): moving travels far over the bench with little height,
//! aligning raises the wrist, flipping raises wrist, elbow and shoulder.

use nalgebra::Vector3;

use crate::smooth::{pulse, step};

/// One of the sewing actions of the paper's Sect. 5.1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// Moves the fabric over the bench: a long way forward and sideways, little height.
    Move,
    /// Aligns the fabric: the wrist goes up and down, shoulder and elbow stay almost still.
    Align,
    /// Turns the fabric: wrist, elbow and shoulder all rise.
    Flip,
}

impl Action {
    /// All actions, in the paper's order.
    pub const ALL: [Self; 3] = [Self::Move, Self::Align, Self::Flip];

    /// Lower-case English name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Move => "move",
            Self::Align => "align",
            Self::Flip => "flip",
        }
    }
}

/// Displacements from the home pose at one phase of a cycle. Vectors are in `world`, metres; angles in radians.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Displacement {
    pub(crate) right_wrist: Vector3<f64>,
    pub(crate) left_wrist: Vector3<f64>,
    /// Trunk leaning forward.
    pub(crate) lean: f64,
    /// Trunk leaning to the left (raises the right shoulder).
    pub(crate) tilt: f64,
    /// Trunk turning to the left (brings the right shoulder forward).
    pub(crate) twist: f64,
    /// Right collarbone raised.
    pub(crate) shrug: f64,
    /// Right elbow swung outwards and up about the line from shoulder to wrist.
    pub(crate) swivel: f64,
    /// Right hand pitched up.
    pub(crate) hand_pitch: f64,
    /// Share of a half turn the fabric has made.
    pub(crate) fabric_turn: f64,
}

/// Displacement of `action` at phase `u`, with `size` scaling all lengths.
pub(crate) fn displacement(action: Action, u: f64, size: f64) -> Displacement {
    let mut d = match action {
        Action::Move => {
            let out = step(0.06, 0.47, u) - step(0.56, 0.96, u);
            let ahead = step(0.04, 0.42, u) - step(0.58, 0.97, u);
            let bow = pulse(0.08, 0.52, u) - pulse(0.5, 0.98, u);
            Displacement {
                right_wrist: Vector3::new(0.165 * ahead, 0.13 * out - 0.02 * bow, 0.018 * pulse(0.46, 1.0, u)),
                left_wrist: Vector3::new(0.12 * ahead, 0.09 * out, 0.006 * pulse(0.46, 1.0, u)),
                lean: 0.13 * ahead,
                tilt: 0.03 * out,
                twist: 0.2 * out,
                shrug: 0.0,
                swivel: -0.08 * out,
                hand_pitch: 0.06 * ahead,
                fabric_turn: 0.0,
            }
        }
        Action::Align => {
            let lift = pulse(0.03, 0.52, u) + 0.72 * pulse(0.46, 0.97, u);
            let shift = pulse(0.05, 0.55, u) - pulse(0.45, 0.95, u);
            Displacement {
                right_wrist: Vector3::new(0.03 * pulse(0.1, 0.9, u), 0.03 * shift, 0.12 * lift),
                left_wrist: Vector3::new(0.01 * shift, -0.012 * shift, 0.01 * lift),
                lean: -0.02 * pulse(0.1, 0.9, u),
                tilt: 0.015 * lift,
                twist: 0.03 * shift,
                shrug: 0.04 * lift,
                swivel: 0.12 * lift,
                hand_pitch: -0.3 * lift,
                fabric_turn: 0.0,
            }
        }
        Action::Flip => {
            let lift = pulse(0.02, 0.94, u);
            let sweep = step(0.14, 0.52, u) - step(0.62, 0.97, u);
            Displacement {
                right_wrist: Vector3::new(0.06 * lift, 0.13 * sweep, 0.27 * lift),
                left_wrist: Vector3::new(-0.01 * lift, 0.02 * sweep, 0.03 * lift),
                lean: -0.05 * lift,
                tilt: 0.12 * lift,
                twist: 0.09 * sweep,
                shrug: 0.28 * lift,
                swivel: 0.55 * lift,
                hand_pitch: -0.35 * lift,
                fabric_turn: step(0.22, 0.66, u),
            }
        }
    };
    d.right_wrist *= size;
    d.left_wrist *= size;
    d
}
