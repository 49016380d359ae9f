#![expect(clippy::float_cmp, reason = "these results are exact")]
use super::*;

fn zigzag(n: usize, corners: &[usize]) -> Trajectory {
    let mut slope = 1.0;
    let mut y = 0.0;
    let values = (0..n)
        .map(|i| {
            if corners.contains(&i) {
                slope = -slope;
            }
            y += 0.1 * slope;
            // A deterministic ripple stands in for noise of deviation 0.01.
            y + 0.014 * (i as f64 * 2.4).sin()
        })
        .collect();
    Trajectory::new((0..n).map(|i| i as f64 * 0.1).collect(), values, 1).unwrap()
}

#[test]
fn change_points_equal_the_exhaustive_search() {
    let motion = zigzag(16, &[6, 11]);
    let params = ChangePointParams { sigma: 0.01, penalty: None, shortest: 3 };
    let found = segment_change_points(&motion, &params).unwrap();
    let line = |from: usize, to: usize| {
        // Straight line by the textbook sums, independent of the running ones.
        let t = &motion.times_s()[from..to];
        let y = &motion.values()[from..to];
        let n = t.len() as f64;
        let (mt, my) = (t.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
        let b = t.iter().zip(y).map(|(t, y)| (t - mt) * (y - my)).sum::<f64>()
            / t.iter().map(|t| (t - mt) * (t - mt)).sum::<f64>();
        t.iter().zip(y).map(|(t, y)| (y - my - b * (t - mt)).powi(2)).sum::<f64>()
    };
    let penalty = 3.0 * 16f64.ln();
    let mut best = (f64::INFINITY, vec![]);
    for mask in 0u32..1 << 15 {
        let mut edges = vec![0];
        edges.extend((1..16).filter(|i| mask & (1 << (i - 1)) != 0));
        edges.push(16);
        if edges.windows(2).any(|e| e[1] - e[0] < 3) {
            continue;
        }
        let cost: f64 = edges.windows(2).map(|e| line(e[0], e[1]) / 1e-4 + penalty).sum();
        if cost < best.0 {
            best = (cost, edges);
        }
    }
    let cuts: Vec<f64> = best.1[1..best.1.len() - 1].iter().map(|&i| (i as f64 - 0.5) * 0.1).collect();
    assert_eq!(found.len(), cuts.len() + 1);
    for (element, cut) in found.iter().zip(&cuts) {
        assert!((element.end_s - cut).abs() < 1e-12);
    }
    assert!(found.len() >= 3);
}

#[test]
fn a_straight_motion_has_no_change_point_and_no_rest() {
    let motion = zigzag(50, &[]);
    let params = ChangePointParams { sigma: 0.01, penalty: None, shortest: 5 };
    assert_eq!(segment_change_points(&motion, &params).unwrap().len(), 1);
    assert_eq!(segment_at_rest(&motion, &RestParams { speed: 0.1, shortest_s: 0.5 }).unwrap().len(), 1);
}

#[test]
fn fixed_periods_cover_the_motion_without_gaps() {
    for n in [2, 11, 14, 15, 16, 26, 101] {
        let motion = zigzag(n, &[]);
        let elements = segment_fixed(&motion, 1.0).unwrap();
        assert!(elements[0].start_s == motion.start_s());
        assert!(elements[elements.len() - 1].end_s == motion.end_s());
        assert!(elements.windows(2).all(|e| e[0].end_s == e[1].start_s));
        assert!(elements.len() == 1 || elements.iter().all(|e| e.duration_s() > 0.49 && e.duration_s() < 1.5));
    }
}
