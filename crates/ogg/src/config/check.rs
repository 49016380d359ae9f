//! Relations between keys that a type cannot hold.

use super::{Bus, Config, Lift, Reengage, Source};

/// Fastest tool that needs no word from the integrator on a real bus (ISO 10218 reduced speed).
const REDUCED_SPEED_M_S: f64 = 0.25;

impl Config {
    /// Says which key is wrong, what it holds and what was expected.
    pub(super) fn check(&self) -> Result<(), String> {
        self.check_source()?;
        self.check_lift()?;
        self.check_limits()?;
        let t = &self.timeouts;
        within("timeouts.frame_soft_ms", f64::from(t.frame_soft_ms), 10.0, 2_000.0)?;
        within("timeouts.frame_hard_ms", f64::from(t.frame_hard_ms), f64::from(t.frame_soft_ms), 5_000.0)?;
        within("timeouts.feedback_ms", f64::from(t.feedback_ms), 5.0, 100.0)?;
        within("retarget.scale", self.retarget.scale, 0.05, 10.0)?;
        within("retarget.work_radius_m", self.retarget.work_radius_m, 0.01, 5.0)?;
        within("teach.duration_s", self.teach.duration_s, 1.0, 600.0)?;
        within("control.rate_hz", self.control.rate_hz, 50.0, 1_000.0)?;
        within("control.offline_latency_ms", self.control.offline_latency_ms, 0.0, 500.0)?;
        within("pose.threads", self.pose.threads as f64, 1.0, 256.0)?;
        Ok(())
    }

    fn check_source(&self) -> Result<(), String> {
        let (fps, count) = match &self.source {
            Source::Worker { fps, size_px, .. } => {
                for side in size_px {
                    within("source.size_px", f64::from(*side), 64.0, 4096.0)?;
                }
                (Some(*fps), 1)
            }
            Source::Video { files, .. } => (None, files.len()),
            Source::Images { folders, fps } => (Some(*fps), folders.len()),
            Source::V4l2 { devices, fps, .. } => (Some(*fps), devices.len()),
        };
        if let Some(fps) = fps {
            within("source.fps", fps, 1.0, 240.0)?;
        }
        let multiview = matches!(self.lift, Lift::Multiview { .. });
        if count == 0 || (multiview != (count > 1)) {
            let mode = if multiview { "multiview needs at least two views" } else { "planes needs exactly one view" };
            return Err(format!("source: {count} views given, but lift.mode = {mode}"));
        }
        Ok(())
    }

    fn check_lift(&self) -> Result<(), String> {
        if let Lift::Planes { shoulder_height_m, elbow_height_m, wrist_height_m, height_sigma_m, .. } = &self.lift {
            within("lift.shoulder_height_m", *shoulder_height_m, -2.0, 3.0)?;
            within("lift.elbow_height_m", *elbow_height_m, -2.0, 3.0)?;
            within("lift.wrist_height_m", *wrist_height_m, -2.0, 3.0)?;
            within("lift.height_sigma_m", *height_sigma_m, 1e-4, 1.0)?;
        }
        Ok(())
    }

    fn check_limits(&self) -> Result<(), String> {
        let l = &self.limits;
        let joints = self.robot.home_rad.len();
        if joints == 0 || joints > 6 {
            return Err(format!("robot.home_rad: {joints} joints given, the bus carries 1 to 6"));
        }
        for (name, values, high) in [
            ("limits.velocity_rad_s", &l.velocity_rad_s, 20.0),
            ("limits.acceleration_rad_s2", &l.acceleration_rad_s2, 500.0),
            ("limits.jerk_rad_s3", &l.jerk_rad_s3, 50_000.0),
        ] {
            if values.len() != joints {
                return Err(format!(
                    "{name}: {} numbers given, expected one for each of {joints} joints",
                    values.len()
                ));
            }
            for value in values {
                if !(*value > 0.0 && *value <= high) {
                    return Err(format!("{name}: {value} given, expected in (0, {high}]"));
                }
            }
        }
        within("limits.position_margin_rad", l.position_margin_rad, 0.0, 0.5)?;
        within("limits.tool_speed_m_s", l.tool_speed_m_s, 0.01, 5.0)?;
        within("limits.tracking_error_rad", l.tracking_error_rad, 0.001, 1.0)?;
        within("limits.tracking_error_ms", f64::from(l.tracking_error_ms), 5.0, 1_000.0)?;
        if matches!(self.bus, Bus::Socketcan { .. }) {
            if l.tool_speed_m_s > REDUCED_SPEED_M_S && !l.fast_tool {
                return Err(format!(
                    "limits.tool_speed_m_s: {} m/s given; on a real bus more than {REDUCED_SPEED_M_S} m/s needs limits.fast_tool = true",
                    l.tool_speed_m_s
                ));
            }
            if self.timeouts.reengage == Reengage::Automatic {
                return Err(
                    "timeouts.reengage: \"automatic\" is for simulated cells; a real bus needs \"operator\"".into()
                );
            }
        }
        Ok(())
    }
}

fn within(name: &str, value: f64, low: f64, high: f64) -> Result<(), String> {
    if value >= low && value <= high {
        Ok(())
    } else {
        Err(format!("{name}: {value} given, expected in [{low}, {high}]"))
    }
}
