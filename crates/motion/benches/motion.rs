//! Tracking against rsruckig.
#[path = "motion/followers.rs"]
mod followers;
#[path = "motion/measure.rs"]
mod measure;
#[path = "motion/signals.rs"]
mod signals;
use followers::{Ask, Follower, Ours, StateToState, Tracking};
fn main() {
    let mut signals = signals::Signal::synthetic();
    if let Ok(p) = std::env::var("OGG_WRIST_CSV") {
        signals.extend(signals::Signal::recorded(&std::fs::read_to_string(p).unwrap()));
    }
    let w: Vec<f64> = std::env::var("W").unwrap_or("25".into()).split(',').map(|s| s.parse().unwrap()).collect();
    for s in &signals {
        for rate in [15.0, 30.0] {
            let p = s.position(0.0);
            let mut f: Vec<(String, Box<dyn Follower>)> = vec![];
            for w in &w {
                f.push((format!("ours{w}"), Box::new(Ours::new(p, *w))));
            }
            f.push(("rest".into(), Box::new(StateToState::new(p, Ask::Rest))));
            f.push(("moving".into(), Box::new(StateToState::new(p, Ask::Moving))));
            f.push(("trackig".into(), Box::new(Tracking::new(p))));
            println!("{} @ {rate}", s.name);
            for (n, f) in &mut f {
                let m = measure::follow(f.as_mut(), s, rate);
                println!(
                    "   {n:9} lag {:7.2} over {:.6} jerk {:7.1} err {:.5} settled {:.0}",
                    m.lag_ms, m.overshoot_rad, m.jerk_rms, m.error_rms_rad, m.settled_ms
                );
            }
        }
    }
}
