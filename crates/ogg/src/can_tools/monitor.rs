//! `ogg can monitor`: what is on the bus, decoded.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::IsTerminal as _;
use std::path::Path;
use std::time::Duration;

use can_driver::{Bus as _, DBC, Dbc, DbcMessage, Event, Filter, Frame, Protocol, SocketCan};

use super::{Until, put};
use crate::error::Error;

/// How often the table is drawn.
const REDRAW: Duration = Duration::from_millis(100);
/// Frames a second are averaged over about this time.
const RATE_WINDOW_S: f64 = 1.0;

#[derive(Debug, Default)]
struct Row {
    frames: u64,
    damaged: u64,
    rate_hz: f64,
    in_window: u32,
    text: String,
    at: Duration,
}

/// The bus as seen so far.
#[derive(Debug)]
struct View {
    dbc: Dbc,
    /// Judges checksums; absent for other DBC files.
    protocol: Option<Protocol>,
    rows: BTreeMap<u16, Row>,
    faults: BTreeMap<String, u64>,
}

impl View {
    fn take(&mut self, at: Duration, frame: &Frame) -> &Row {
        let row = self.rows.entry(frame.id().raw()).or_default();
        row.frames += 1;
        row.in_window += 1;
        row.at = at;
        row.damaged += u64::from(self.protocol.is_some_and(|p| p.decode(frame).is_err()));
        row.text.clear();
        match self.dbc.message(frame.id().raw()) {
            Some(message) => describe(&mut row.text, message, frame),
            None => row.text.push_str("not in the DBC file"),
        }
        row
    }

    fn roll(&mut self, window_s: f64) {
        for row in self.rows.values_mut() {
            row.rate_hz = f64::from(row.in_window) / window_s;
            row.in_window = 0;
        }
    }

    fn table(&self, bus: &str, now: Duration) -> String {
        let mut out = format!("{bus}   {:.1} s\n\n", now.as_secs_f64());
        out.push_str("  id  message               frames  damaged   rate Hz   age ms  signals\n");
        for (id, row) in &self.rows {
            let name = self.dbc.message(*id).map_or("?", |m| m.name.as_str());
            let age_ms = now.saturating_sub(row.at).as_millis();
            let _ = writeln!(
                out,
                " {id:03X}  {name:<20} {:>7} {:>8} {:>9.1} {age_ms:>8}  {}",
                row.frames, row.damaged, row.rate_hz, row.text
            );
        }
        for (fault, count) in &self.faults {
            let _ = writeln!(out, "\n bus: {fault} x {count}");
        }
        out
    }
}

/// `Joint1 0.25000 rad, ...`, with names for the values that have one.
fn describe(out: &mut String, message: &DbcMessage, frame: &Frame) {
    let mut first = true;
    for signal in &message.signals {
        if matches!(signal.name.as_str(), "Crc" | "Zero") {
            continue;
        }
        if !std::mem::take(&mut first) {
            out.push_str(", ");
        }
        let raw = signal.raw(frame.data());
        let value = signal.physical(frame.data());
        // Writing to a String cannot fail.
        let _ = match signal.names.iter().find(|(code, _)| *code == raw) {
            Some((_, name)) => write!(out, "{} {name}", signal.name),
            None if signal.signed && signal.length == 20 && raw == -524_288 => write!(out, "{} no value", signal.name),
            None if signal.factor.abs() < 1e-3 => write!(out, "{} {value:.5} {}", signal.name, signal.unit),
            None if signal.unit.is_empty() => write!(out, "{} {value}", signal.name),
            None => write!(out, "{} {value} {}", signal.name, signal.unit),
        };
    }
}

pub(super) fn run(bus: &str, dbc: Option<&Path>, lines: bool, until: &Until) -> Result<(), Error> {
    let text = match dbc {
        None => DBC.to_owned(),
        Some(path) => std::fs::read_to_string(path).map_err(|source| Error::File {
            path: path.to_owned(),
            expected: "a DBC file",
            source,
        })?,
    };
    let dbc_given = dbc.is_some();
    let dbc = Dbc::parse(&text).map_err(can_driver::Error::from)?;
    let protocol = if dbc_given { None } else { Some(Protocol::new(0)?) };
    let mut view = View { dbc, protocol, rows: BTreeMap::new(), faults: BTreeMap::new() };
    let mut socket = SocketCan::open(bus, Filter::All, 4096)?;
    let as_lines = lines || !std::io::stdout().is_terminal();
    let (mut drawn, mut rolled) = (Duration::ZERO, Duration::ZERO);
    let mut out = String::new();
    while !until.over() {
        socket.wait(REDRAW)?;
        let now = until.now();
        out.clear();
        while let Some(event) = socket.receive(now)? {
            match event {
                Event::Frame(stamped) => {
                    let row = view.take(stamped.at, &stamped.frame);
                    if as_lines {
                        let _ = writeln!(out, "{:.6} {} {}", stamped.at.as_secs_f64(), stamped.frame, row.text);
                    }
                }
                Event::Fault(fault) => *view.faults.entry(format!("{fault:?}")).or_default() += 1,
            }
            if out.len() > 1 << 16 {
                break;
            }
        }
        let window_s = now.saturating_sub(rolled).as_secs_f64();
        if window_s >= RATE_WINDOW_S {
            view.roll(window_s);
            rolled = now;
        }
        if !as_lines && now.saturating_sub(drawn) >= REDRAW {
            drawn = now;
            // Home, the table, and the rest of the screen cleared: no flicker.
            let _ = write!(out, "\x1b[H{}\x1b[J", view.table(bus, now).replace('\n', "\x1b[K\n"));
        }
        if !out.is_empty() && !put(&out)? {
            break;
        }
    }
    if as_lines { Ok(()) } else { put("\n").map(drop) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use can_driver::{Angle, Counted, Message};

    fn view() -> View {
        View {
            dbc: Dbc::parse(DBC).unwrap(),
            protocol: Some(Protocol::new(0).unwrap()),
            rows: BTreeMap::new(),
            faults: BTreeMap::new(),
        }
    }

    #[test]
    fn a_row_names_values_and_counts_damage() {
        let mut view = view();
        let angles = [Angle::from_rad(0.5).unwrap(), Angle::NO_VALUE];
        let frame =
            Protocol::new(0).unwrap().encode(&Counted { message: Message::Set { slot: 0, angles }, counter: 3 });
        let row = view.take(Duration::ZERO, &frame);
        // The nearest step of 4 pi / 2^20 rad to 0.5 rad is 0.500006 rad.
        assert_eq!(row.text, "Joint1 0.50001 rad, Joint2 no value, Counter 3");
        view.take(Duration::ZERO, &frame.with_flipped_bit(4));
        view.roll(0.5);
        let row = &view.rows[&0x100];
        assert_eq!((row.frames, row.damaged), (2, 1));
        assert!((row.rate_hz - 4.0).abs() < 1e-12);
        let table = view.table("vcan0", Duration::from_secs(1));
        assert!(table.contains("100  SET_12"), "{table}");
    }
}
