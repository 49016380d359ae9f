//! The control path allocates nothing after construction.
#![expect(unsafe_code, reason = "a counting allocator implements an unsafe trait")]

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::time::Duration;

use common::{LIMITS, TICK, params};
use motion::{Sample, State, Synchronisation, Target};

struct Counting;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: every call goes on to the system allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the pointer came from `System.alloc` with this layout.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn offering_updating_stopping_and_engaging_allocate_nothing() {
    for synchronisation in [Synchronisation::None, Synchronisation::Straight] {
        let mut params = params(&[LIMITS; 6], 40.0);
        params.synchronisation = synchronisation;
        let mut tracker = params.validate().unwrap().start(&[State::at_rest(0.0); 6]).unwrap();
        let horizon = [Sample::new(0.5, 0.1); 60];
        let before = COUNT.with(Cell::get);
        tracker.engage(&[0.0; 6]).unwrap();
        for k in 0..1_000 {
            if k % 7 == 0 {
                let samples = [Sample::new(f64::from(k) * 1e-3, 0.2); 6];
                let target =
                    Target { horizon: &horizon, horizon_step: Duration::from_millis(20), ..Target::new(0.0, &samples) };
                tracker.offer(&target).unwrap();
            }
            tracker.update(TICK).unwrap();
        }
        tracker.stop();
        for _ in 0..100 {
            tracker.update(TICK).unwrap();
        }
        assert_eq!(COUNT.with(Cell::get) - before, 0);
    }
}
