//! `ogg can replay`: the frames of a candump log, with the times between them.

use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::time::Duration;

use can_driver::{Bus as _, CandumpLine, DBC, Dbc, Filter, SendOutcome, SocketCan};

use super::{Sender, Until};
use crate::commands::say;
use crate::error::Error;

pub(super) fn run(path: &Path, bus: &str, speed: f64, sender: Sender, until: &Until) -> Result<(), Error> {
    if !(speed > 0.0 && speed.is_finite()) {
        return Err(Error::Usage(format!("--speed {speed}: expected a number above 0")));
    }
    let failed = |source| Error::File { path: path.to_owned(), expected: "a candump log", source };
    let lines = BufReader::new(File::open(path).map_err(failed)?).lines();
    let mut socket = SocketCan::open(bus, Filter::Only(&[]), 65_536)?;
    let dbc = Dbc::parse(DBC).map_err(can_driver::Error::from)?;
    let wanted = |line: &CandumpLine| match sender {
        Sender::All => true,
        Sender::Host => dbc.message(line.frame.id().raw()).is_some_and(|m| m.sender == "HOST"),
        Sender::Controller => dbc.message(line.frame.id().raw()).is_some_and(|m| m.sender == "CONTROLLER"),
    };
    let mut origin: Option<(Duration, Duration)> = None;
    let (mut sent, mut refused) = (0_u64, 0_u64);
    for (index, line) in lines.enumerate() {
        let Some(line) = CandumpLine::parse(&line.map_err(failed)?, index + 1)? else { continue };
        if !wanted(&line) {
            continue;
        }
        let (logged, began) = *origin.get_or_insert((line.time, until.now()));
        let due = began + line.time.saturating_sub(logged).div_f64(speed);
        // In pieces, so that a signal ends a long pause.
        while until.now() < due && !until.over() {
            std::thread::sleep(due.saturating_sub(until.now()).min(Duration::from_millis(100)));
        }
        if until.over() {
            break;
        }
        match socket.send(until.now(), &line.frame)? {
            SendOutcome::Sent => sent += 1,
            SendOutcome::Full => refused += 1,
        }
    }
    say(format_args!("{sent} frames sent, {refused} not taken by the bus"));
    Ok(())
}
