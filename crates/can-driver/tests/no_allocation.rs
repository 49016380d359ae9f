//! No tick of either session allocates, enabled or stopped, on a good bus or a bad one.

#![expect(clippy::unwrap_used, reason = "tests")]

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use can_driver::{Command, Controller, ControllerParams, Event, HostParams, HostSession, HostState, JointState};

struct Counting;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

#[expect(unsafe_code, reason = "counting allocations needs an allocator")]
// SAFETY: every call is handed to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps the contract of `dealloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn ticks_do_not_allocate() {
    let mut host = HostSession::new(HostParams::standard(0, vec![common::LIMITS; 6], common::CYCLE)).unwrap();
    let mut controller = Controller::new(ControllerParams::standard(0, vec![common::LIMITS; 6])).unwrap();
    let mut joints = [JointState { position_rad: 0.25, velocity_rad_s: 0.0 }; 6];
    let mut to_host: Vec<Event> = Vec::with_capacity(256);
    let mut to_controller: Vec<Event> = Vec::with_capacity(256);
    let mut wanted = [0.25; 6];
    let mut states = std::collections::HashSet::with_capacity(64);
    let before = COUNT.with(Cell::get);
    for k in 1_u32..20_000 {
        let now = common::TICK * k;
        if k.is_multiple_of(5) {
            let out = host.tick(now, &to_host, Command::Follow { position_rad: &wanted, speed_scale: 1.0 });
            to_host.clear();
            states.insert(out.state);
            if out.state == HostState::Active {
                for w in &mut wanted {
                    *w += 1e-3 * (f64::from(k) * 1e-3).sin();
                }
            } else if let [q, ..] = out.commanded_rad[..] {
                wanted = [q; 6];
            }
            to_controller.extend(out.tx.iter().map(|f| Event::frame(now, *f)));
            // A damaged frame now and then; a silence that latches; an operator.
            if k % 35 == 0 {
                to_controller.extend(out.tx.first().map(|f| Event::frame(now, f.with_flipped_bit((k % 64) as u8))));
            }
            if (9000..9200).contains(&k) {
                to_controller.clear();
            }
            if k == 12_000 {
                host.reset().unwrap();
            }
        }
        let out = controller.tick(now, &to_controller, &joints);
        to_controller.clear();
        to_host.extend(out.tx.iter().map(|f| Event::frame(now, *f)));
        for (joint, s) in joints.iter_mut().zip(&out.setpoints) {
            *joint = JointState { position_rad: s.position_rad, velocity_rad_s: s.velocity_rad_s };
        }
    }
    assert_eq!(COUNT.with(Cell::get) - before, 0);
    for state in [HostState::Configuring, HostState::Ready, HostState::Active, HostState::Stopped, HostState::Resetting]
    {
        assert!(states.contains(&state), "{state:?} is never reached");
    }
}
