//! Exact matching of a handful of tracks and people.

/// The matching of least cost (for each track a person or none), and how much more the best matching costs in which track
/// `watched` has another choice, nobody being one. A track without a person costs `absent`; `None` where `watched` is
/// nobody.
///
/// With at most six tracks and six people there are 13,327 matchings; all are tried.
pub(super) fn best_two(costs: &[Vec<f64>], absent: f64, watched: Option<usize>) -> (Vec<Option<usize>>, Option<f64>) {
    let people = costs.first().map_or(0, Vec::len);
    let mut search = Search {
        costs,
        absent,
        watched,
        taken: vec![false; people],
        choice: vec![None; costs.len()],
        by_watched: vec![(f64::INFINITY, Vec::new()); people + 1],
    };
    search.step(0, 0.0);
    let mut order: Vec<usize> = (0..search.by_watched.len()).collect();
    order.sort_by(|a, b| search.by_watched[*a].0.total_cmp(&search.by_watched[*b].0));
    let (best, matching) = search.by_watched[order[0]].clone();
    let rival = search.by_watched[order.get(1).copied().unwrap_or(order[0])].0;
    let margin = (watched.is_some() && order.len() > 1 && rival.is_finite()).then_some(rival - best);
    (matching, margin)
}

struct Search<'a> {
    costs: &'a [Vec<f64>],
    absent: f64,
    watched: Option<usize>,
    taken: Vec<bool>,
    choice: Vec<Option<usize>>,
    /// Best total and matching for each choice of the watched track; the last entry is "none".
    by_watched: Vec<(f64, Vec<Option<usize>>)>,
}

impl Search<'_> {
    fn step(&mut self, track: usize, total: f64) {
        if track == self.costs.len() {
            let slot = self.watched.and_then(|w| self.choice[w]).unwrap_or(self.taken.len());
            if total < self.by_watched[slot].0 {
                self.by_watched[slot] = (total, self.choice.clone());
            }
            return;
        }
        for person in 0..self.taken.len() {
            let cost = self.costs[track][person];
            if !self.taken[person] && cost < self.absent {
                self.taken[person] = true;
                self.choice[track] = Some(person);
                self.step(track + 1, total + cost);
                self.choice[track] = None;
                self.taken[person] = false;
            }
        }
        self.step(track + 1, total + self.absent);
    }
}
