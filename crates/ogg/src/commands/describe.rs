//! `ogg describe`: the joints, limits and frames of a robot.

use std::path::Path;

use kin::{Robot, UrdfOptions};

use super::say;
use crate::error::Error;

pub(super) fn run(urdf: Option<&Path>, base: Option<&str>, tip: Option<&str>) -> Result<(), Error> {
    let robot = match urdf {
        Some(path) => Robot::from_urdf_file(path, &UrdfOptions::default())?,
        None => Robot::builtin(),
    };
    say(format_args!("robot {}: {} links, {} moving joints", robot.name(), robot.links().len(), robot.dof()));
    say(format_args!(
        "{:<20} {:<10} {:>9} {:>9} {:>9} {:>9}  {:<18} {:<18}",
        "joint", "kind", "lower", "upper", "speed", "effort", "parent", "child"
    ));
    for joint in robot.dof_joints() {
        let l = &joint.limits;
        let kind = format!("{:?}", joint.kind).to_lowercase();
        say(format_args!(
            "{:<20} {:<10} {:>9.4} {:>9.4} {:>9.3} {:>9.1}  {:<18} {:<18}",
            joint.name,
            kind,
            l.lower,
            l.upper,
            l.velocity,
            l.effort,
            robot.links()[joint.parent.index()].name,
            robot.links()[joint.child.index()].name
        ));
    }
    say("positions in rad or m, speeds per second, efforts in N m or N");
    let root = &robot.root_link().name;
    let frames: Vec<&str> = robot.links().iter().map(|link| link.name.as_str()).collect();
    say(format_args!("root {root}; frames {}", frames.join(", ")));
    if base.is_some() || tip.is_some() {
        let base = base.unwrap_or(root);
        let tip = tip.unwrap_or("tool0");
        let chain = robot.chain(base, tip)?;
        say(format_args!("chain {base} -> {tip}: {}", chain.joint_names().join(", ")));
    }
    Ok(())
}
