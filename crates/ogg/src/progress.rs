//! Progress of long offline work, on standard error.
//!
//! On a terminal a bar with rate and time left; elsewhere (a log file, a CI job) a plain line at every tenth of the way, so that
//! nothing rewrites itself where it cannot.

use std::io::{IsTerminal, Write, stderr};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// A running display. Dropping it without [`finish`](Self::finish) removes the bar and writes nothing.
#[derive(Debug)]
pub struct Progress {
    display: Display,
}

#[derive(Debug)]
enum Display {
    Bar(ProgressBar),
    Lines(Lines),
}

impl Progress {
    /// Starts a display of `what`, such as `reading cam01.mp4`, over `total` steps where their number is known.
    pub fn new(what: &str, total: Option<u64>) -> Self {
        let display = if stderr().is_terminal() {
            let bar = ProgressBar::with_draw_target(total, ProgressDrawTarget::stderr());
            let template = if total.is_some() {
                "{msg} [{bar:40}] {pos}/{len} ({per_sec}, {eta} left)"
            } else {
                "{msg} {spinner} {pos} ({per_sec})"
            };
            if let Ok(style) = ProgressStyle::with_template(template) {
                bar.set_style(style.progress_chars("=> "));
            }
            bar.set_message(what.to_owned());
            Display::Bar(bar)
        } else {
            Display::Lines(Lines::new(what, total))
        };
        Self { display }
    }

    /// Sets the number of steps done.
    pub fn set(&mut self, done: u64) {
        match &mut self.display {
            Display::Bar(bar) => bar.set_position(done),
            Display::Lines(lines) => show(lines.step(done)),
        }
    }

    /// Ends the display with a last line.
    pub fn finish(self, message: &str) {
        match &self.display {
            Display::Bar(bar) => {
                bar.finish_and_clear();
                show(Some(message.to_owned()));
            }
            Display::Lines(lines) => show(Some(format!("{}: {message}", lines.what))),
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Display::Bar(bar) = &self.display {
            bar.finish_and_clear();
        }
    }
}

fn show(line: Option<String>) {
    if let Some(line) = line {
        // A closed standard error must not stop the work.
        let _ = writeln!(stderr(), "{line}");
    }
}

/// Decides when a plain line is due.
#[derive(Debug)]
struct Lines {
    what: String,
    total: Option<u64>,
    next: u64,
}

impl Lines {
    /// Steps between lines where the total is not known.
    const UNKNOWN_STRIDE: u64 = 500;

    fn new(what: &str, total: Option<u64>) -> Self {
        let next = Self::stride(total);
        Self { what: what.to_owned(), total, next }
    }

    fn stride(total: Option<u64>) -> u64 {
        total.map_or(Self::UNKNOWN_STRIDE, |total| total.div_ceil(10).max(1))
    }

    fn step(&mut self, done: u64) -> Option<String> {
        if done < self.next {
            return None;
        }
        let stride = Self::stride(self.total);
        self.next = (done / stride + 1).saturating_mul(stride);
        Some(match self.total {
            Some(total) => format!("{}: {done} of {total}", self.what),
            None => format!("{}: {done}", self.what),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_lines_come_at_every_tenth() {
        let mut lines = Lines::new("reading", Some(205));
        let written: Vec<String> = (1..=205).filter_map(|done| lines.step(done)).collect();
        assert_eq!(written.len(), 9);
        assert_eq!((written[0].as_str(), written[8].as_str()), ("reading: 21 of 205", "reading: 189 of 205"));
    }

    #[test]
    fn a_jump_gives_one_line() {
        let mut lines = Lines::new("reading", Some(100));
        assert_eq!(lines.step(57).as_deref(), Some("reading: 57 of 100"));
        assert_eq!(lines.step(59), None);
        assert_eq!(lines.step(60).as_deref(), Some("reading: 60 of 100"));
    }

    #[test]
    fn without_a_total_lines_come_at_a_fixed_stride() {
        let mut lines = Lines::new("reading", None);
        let written: Vec<String> = (1..=1100).filter_map(|done| lines.step(done)).collect();
        assert_eq!(written, ["reading: 500", "reading: 1000"]);
    }
}
