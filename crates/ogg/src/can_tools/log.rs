//! `ogg can log`: the frames of a bus in candump format.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use can_driver::{Bus as _, Event, Filter, SocketCan, write_candump};

use super::{Until, put};
use crate::error::Error;

const WAIT: Duration = Duration::from_millis(100);

pub(super) fn run(bus: &str, out: Option<&Path>, until: &Until) -> Result<(), Error> {
    let mut socket = SocketCan::open(bus, Filter::All, 4096)?;
    let failed = |source| Error::File {
        path: out.unwrap_or(Path::new("standard output")).to_owned(),
        expected: "a place to write to",
        source,
    };
    let mut file = out.map(|path| File::create(path).map(BufWriter::new)).transpose().map_err(failed)?;
    let started = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().saturating_sub(until.now());
    let mut text = String::new();
    let mut faults = 0_u64;
    while !until.over() {
        socket.wait(WAIT)?;
        let now = until.now();
        text.clear();
        while let Some(event) = socket.receive(now)? {
            match event {
                Event::Frame(stamped) => write_candump(&mut text, started + stamped.at, bus, &stamped.frame),
                Event::Fault(fault) => {
                    faults += 1;
                    tracing::warn!(?fault, bus);
                }
            }
            if text.len() > 1 << 16 {
                break;
            }
        }
        match &mut file {
            Some(file) => file.write_all(text.as_bytes()).and_then(|()| file.flush()).map_err(failed)?,
            None => {
                if !put(&text)? {
                    break;
                }
            }
        }
    }
    let counts = socket.counts();
    tracing::info!(faults, passed_over = counts.unsupported + counts.fd_ignored, "log ends");
    Ok(())
}
