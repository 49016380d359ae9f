//! Percentage of correct keypoints: the share within a fraction of a reference length of where they should be.

use crate::{Error, Result};

/// How many keypoints were looked at, and how many were right.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct PckCounts {
    /// Labelled keypoints.
    pub total: usize,
    /// Found within the threshold.
    pub correct: usize,
}

impl PckCounts {
    /// Share that was right, 0 to 1; `None` when nothing was labelled.
    pub fn share(&self) -> Option<f64> {
        (self.total > 0).then(|| self.correct as f64 / self.total as f64)
    }
}

/// Counts for each keypoint over many people; a keypoint that was not found is wrong.
///
/// `truth[n][j]` and `found[n][j]` are u and v, px; `reference_px[n]` is the length, such as the trunk's, that `fraction`
/// is taken of.
///
/// ```
/// let truth = [vec![Some([0.0, 0.0]), Some([10.0, 0.0]), None]];
/// let found = [vec![Some([3.0, 4.0]), None, Some([0.0, 0.0])]];
/// let counts = pose::pck(&truth, &found, &[50.0], 0.1).unwrap();
/// assert_eq!(counts.iter().map(|c| (c.correct, c.total)).collect::<Vec<_>>(), [(1, 1), (0, 1), (0, 0)]);
/// ```
///
/// # Errors
/// [`Error::Length`] when the arrays differ in length.
pub fn pck(
    truth: &[Vec<Option<[f64; 2]>>],
    found: &[Vec<Option<[f64; 2]>>],
    reference_px: &[f64],
    fraction: f64,
) -> Result<Vec<PckCounts>> {
    for (what, got) in [("found", found.len()), ("reference_px", reference_px.len())] {
        if got != truth.len() {
            return Err(Error::Length { what, expected: truth.len(), got });
        }
    }
    let joints = truth.first().map_or(0, Vec::len);
    let mut counts = vec![PckCounts::default(); joints];
    for ((truth, found), reference_px) in truth.iter().zip(found).zip(reference_px) {
        for (what, got) in [("truth row", truth.len()), ("found row", found.len())] {
            if got != joints {
                return Err(Error::Length { what, expected: joints, got });
            }
        }
        for (count, (truth, found)) in counts.iter_mut().zip(truth.iter().zip(found)) {
            let Some(truth) = truth else { continue };
            count.total += 1;
            let near = found.is_some_and(|f| (f[0] - truth[0]).hypot(f[1] - truth[1]) <= fraction * reference_px);
            count.correct += usize::from(near);
        }
    }
    Ok(counts)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn share(truth: Option<[f64; 2]>, found: Option<[f64; 2]>) -> Option<f64> {
        pck(&[vec![truth]], &[vec![found]], &[50.0], 0.1).unwrap()[0].share()
    }

    #[test]
    fn a_keypoint_is_right_within_the_fraction_and_wrong_when_it_is_not_found() {
        let truth = Some([10.0, 20.0]);
        // 3, 4, 5: on the border of a tenth of 50 px.
        assert_eq!(share(truth, Some([13.0, 24.0])), Some(1.0));
        assert_eq!(share(truth, Some([13.0, 24.1])), Some(0.0));
        assert_eq!(share(truth, None), Some(0.0));
        assert_eq!(share(None, Some([10.0, 20.0])), None);
    }

    #[test]
    fn rows_and_tables_of_another_length_are_refused_by_name() {
        let (two, one) = (vec![Some([0.0, 0.0]); 2], vec![Some([0.0, 0.0])]);
        let (twos, ones) = (std::slice::from_ref(&two), std::slice::from_ref(&one));
        let refused = |truth: &[Vec<_>], found: &[Vec<_>], px: &[f64]| match pck(truth, found, px, 0.1) {
            Err(Error::Length { what, .. }) => what,
            other => panic!("{other:?}"),
        };
        assert_eq!(refused(twos, ones, &[1.0]), "found row");
        assert_eq!(refused(&[two.clone(), one.clone()], &[two.clone(), two.clone()], &[1.0; 2]), "truth row");
        assert_eq!(refused(twos, &[], &[1.0]), "found");
        assert_eq!(refused(twos, twos, &[]), "reference_px");
    }
}
