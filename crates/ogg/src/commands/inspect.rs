//! `ogg inspect`: what a motion model or a recording holds.

use std::path::Path;

use super::follow_run::read_model;
use super::say;
use crate::error::Error;
use crate::record;

pub(super) fn run(file: &Path) -> Result<(), Error> {
    if file.extension().is_some_and(|e| e == "mcap") { recording(file) } else { motion_model(file) }
}

fn motion_model(file: &Path) -> Result<(), Error> {
    let model = read_model(file)?;
    let kind = if model.is_cyclic() { "repeating" } else { "one-time" };
    say(format_args!(
        "motion model: {kind} action of {:.3} s, learned from {} demonstration(s)",
        model.duration_s(),
        model.demonstrations()
    ));
    for (index, element) in model.sequence().parts().elements.iter().enumerate() {
        say(format_args!(
            "  element {index}: {:.3} s to {:.3} s, {} components",
            element.element.start_s,
            element.element.end_s,
            element.mixture.components()
        ));
    }
    say("  time_s  wrist x      y      z (m)   elevation flexion inclination (deg)   sigma of the wrist (mm)");
    let rows = 10;
    for i in 0..=rows {
        let t = model.duration_s() * f64::from(i) / f64::from(rows);
        let at = model.at(t);
        let [x, y, z, a, b, c] = <[f64; 6]>::from(at.mean);
        let sigma_mm = (at.covariance.fixed_view::<3, 3>(0, 0).trace() / 3.0).sqrt() * 1e3;
        say(format_args!(
            "  {t:6.2}  {x:8.3} {y:6.3} {z:6.3}      {:8.1} {:7.1} {:8.1}              {sigma_mm:6.1}",
            a.to_degrees(),
            b.to_degrees(),
            c.to_degrees()
        ));
    }
    Ok(())
}

fn recording(file: &Path) -> Result<(), Error> {
    let run = record::open(file)?;
    say(format_args!("recording of {:.2} s", run.duration().as_secs_f64()));
    if let Some(cut) = &run.cut {
        say(format_args!("  cut short: {cut}; everything before is shown"));
    }
    for (name, value) in &run.facts {
        say(format_args!("  {name}: {value}"));
    }
    for (name, bytes) in &run.attachments {
        say(format_args!("  attachment {name}, {} bytes", bytes.len()));
    }
    say(format_args!("  {:<28} {:<36} {:<10} {:>8}", "topic", "schema", "encoding", "messages"));
    for topic in &run.topics {
        say(format_args!("  {:<28} {:<36} {:<10} {:>8}", topic.name, topic.schema, topic.encoding, topic.messages));
    }
    Ok(())
}
