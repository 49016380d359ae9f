//! Robot kinematics, camera geometry and retargeting.
