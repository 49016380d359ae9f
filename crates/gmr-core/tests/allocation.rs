//! Queries allocate nothing.
#![expect(clippy::unwrap_used, reason = "tests")]
#![expect(unsafe_code, reason = "a global allocator that counts cannot be written without")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use gmr_core::{
    Chart, Coordinate, CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Mixture, MixtureParts,
    MotionElement, Regressor,
};

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call goes to the system allocator unchanged; the counter itself never allocates.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|c| c.set(c.get() + 1));
        // SAFETY: same contract as ours.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: same contract as ours.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn mixture(dim: usize, k: usize) -> Mixture {
    let covariance = (0..k).flat_map(|_| (0..dim * dim).map(move |i| if i % (dim + 1) == 0 { 1.0 } else { 0.2 }));
    Mixture::new(MixtureParts {
        kind: CovarianceKind::Full,
        dim,
        weights: vec![1.0 / k as f64; k],
        means: (0..k * dim).map(|i| (i as f64 * 0.7).sin()).collect(),
        covariances: covariance.collect(),
    })
    .unwrap()
}

#[test]
fn queries_allocate_nothing() {
    let regressor = Regressor::new(&mixture(7, 8), &[0], &[1, 2, 3, 4, 5, 6]).unwrap();
    let mut out = regressor.prediction();
    let element = |i: usize| ElementModel {
        element: MotionElement { start_s: i as f64, end_s: i as f64 + 1.0 },
        mixture: mixture(4, 3 + i),
    };
    let parts = ElementSequenceParts { elements: (0..3).map(element).collect(), blend_s: 0.4 };
    let sequence = ElementSequence::new(parts).unwrap().regressor().unwrap();
    let mut joined = sequence.prediction();
    let chart = Chart::new(vec![
        Coordinate::Linear,
        Coordinate::Angle { centre_rad: 1.0 },
        Coordinate::Rotation { centre: [1.0, 0.0, 0.0, 0.0] },
    ])
    .unwrap();
    let mut point = [0.0; 6];
    let before = COUNT.with(Cell::get);
    for i in 0..1000 {
        let t = f64::from(i) * 0.003;
        regressor.predict_into(&[t], &mut out).unwrap();
        regressor.predict_with_jacobian_into(&[t], &mut out).unwrap();
        regressor.predict_mean_into(&[t], &mut out).unwrap();
        sequence.predict_into(t, &mut joined).unwrap();
        chart.decode_into(&[t, t, 0.1, t, 0.2], &mut point).unwrap();
    }
    assert_eq!(COUNT.with(Cell::get) - before, 0);
    // The counter counts.
    drop(regressor.prediction());
    assert!(COUNT.with(Cell::get) > before);
}
