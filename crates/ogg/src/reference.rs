//! Wrist positions made by other means, to compare the recovered ones with.

use std::path::{Path, PathBuf};

use follow::ArmSample;
use nalgebra::Point3;

use crate::config::Side;
use crate::error::Error;

/// A track of wrist positions.
#[derive(Debug, Clone)]
pub struct Reference {
    path: PathBuf,
    /// Time (s) and position (m), in order of time.
    rows: Vec<(f64, Point3<f64>)>,
}

impl Reference {
    /// Reads a CSV file with a header; the columns `t_s` and `rwri_x`, `rwri_y`, `rwri_z` (`lwri_…` for a left arm) are used.
    ///
    /// # Errors
    /// [`Error::File`], or [`Error::Content`] with the line and the column.
    pub fn read(path: &Path, side: Side) -> Result<Self, Error> {
        let text = std::fs::read_to_string(path).map_err(|source| Error::File {
            path: path.to_path_buf(),
            expected: "a CSV file with wrist positions",
            source,
        })?;
        Self::parse(&text, path, side)
    }

    fn parse(text: &str, path: &Path, side: Side) -> Result<Self, Error> {
        let wrong = |message: String| Error::Content { path: path.to_path_buf(), message };
        let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
        let (_, header) = lines.next().ok_or_else(|| wrong("empty, expected a header line".into()))?;
        let names: Vec<&str> = header.split(',').map(str::trim).collect();
        let letter = if side == Side::Left { 'l' } else { 'r' };
        let wanted = ["t_s".to_owned(), format!("{letter}wri_x"), format!("{letter}wri_y"), format!("{letter}wri_z")];
        let mut columns = [0; 4];
        for (column, name) in columns.iter_mut().zip(&wanted) {
            *column = names
                .iter()
                .position(|n| n == name)
                .ok_or_else(|| wrong(format!("line 1: no column {name}, expected {}", wanted.join(", "))))?;
        }
        let mut rows: Vec<(f64, Point3<f64>)> = Vec::new();
        for (index, line) in lines {
            let cells: Vec<&str> = line.split(',').map(str::trim).collect();
            let mut values = [0.0; 4];
            for ((value, column), name) in values.iter_mut().zip(columns).zip(&wanted) {
                let cell = cells.get(column).copied().unwrap_or("");
                *value = cell.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| {
                    wrong(format!("line {}: {name} is {cell:?}, expected a finite number", index + 1))
                })?;
            }
            if rows.last().is_some_and(|(t, _)| !(values[0] > *t)) {
                return Err(wrong(format!("line {}: t_s is {}, expected it to increase", index + 1, values[0])));
            }
            rows.push((values[0], Point3::new(values[1], values[2], values[3])));
        }
        Ok(Self { path: path.to_path_buf(), rows })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Distance of each seen wrist from the reference at its capture time, metres.
    pub fn distances_m(&self, samples: &[ArmSample]) -> Vec<f64> {
        samples
            .iter()
            .filter_map(|sample| {
                let at = self.at(sample.captured.as_secs_f64())?;
                Some((sample.wrist?.position_m - at).norm())
            })
            .collect()
    }

    /// On the straight line between two rows. Times of both files are rounded: a tenth of a millisecond past an end counts
    /// as the end.
    fn at(&self, t_s: f64) -> Option<Point3<f64>> {
        const SLACK_S: f64 = 1e-4;
        let (first, last) = (self.rows.first()?, self.rows.last()?);
        if t_s < first.0 - SLACK_S || t_s > last.0 + SLACK_S {
            return None;
        }
        let after = self.rows.partition_point(|(t, _)| *t < t_s);
        let (Some(right), Some(left)) = (self.rows.get(after), after.checked_sub(1).and_then(|i| self.rows.get(i)))
        else {
            return Some(if after == 0 { first.1 } else { last.1 });
        };
        let share = (t_s - left.0) / (right.0 - left.0);
        Some(left.1 + (right.1 - left.1) * share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: &str = "frame,t_s,rwri_x,rwri_y,rwri_z\n0,0.0,0,0,1\n1,0.1,0.2,0,1\n";

    #[test]
    fn positions_between_rows_lie_on_their_line() {
        let track = Reference::parse(TABLE, Path::new("r.csv"), Side::Right).unwrap();
        let mid = track.at(0.025).unwrap();
        assert!((mid - Point3::new(0.05, 0.0, 1.0)).norm() < 1e-12);
        assert!(track.at(0.2).is_none() && track.at(0.10005).is_some());
    }

    #[test]
    fn a_missing_column_and_a_bad_number_name_line_and_column() {
        let message = |text| Reference::parse(text, Path::new("r.csv"), Side::Right).unwrap_err().to_string();
        assert!(message("t_s,rwri_x\n").contains("rwri_y"));
        let bad = message("t_s,rwri_x,rwri_y,rwri_z\n0,0,nan,1\n");
        assert!(bad.contains("line 2") && bad.contains("rwri_y") && bad.contains("r.csv"), "{bad}");
    }
}
