//! Steps allocate nothing, nor do inputs that a host sets before each.
#![allow(clippy::unwrap_used, missing_docs, reason = "a failure ends the test")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use caudal::scene::Document;
use caudal::stepper::{Change, Stepper};

/// The system's allocator, counted.
struct Counted;

static COUNT: AtomicUsize = AtomicUsize::new(0);

// SAFETY: everything is passed on to the system's allocator.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counted = Counted;

#[test]
fn steps_and_inputs_allocate_nothing() {
    let models = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    for integrator in ["implicit-euler", "newmark", "generalized-alpha", "esdirk3"] {
        for model in ["glycerol", "driven-head"] {
            let mut document = Document::read(&models.join(format!("{model}.toml"))).unwrap();
            document.set(&format!("solver.integrator={integrator}")).unwrap();
            document.set("start.kind=shaped").unwrap();
            let mut stepper = Stepper::of(&document.scene().unwrap()).unwrap();
            let find = |name| stepper.variables().iter().copied().find(|variable| variable.name == name).unwrap();
            let (natural, force) = (find("natural_curvature_1_m"), find("force_x_n"));
            let values = vec![0.01; natural.len(stepper.model()).max(force.len(stepper.model()))];
            let changes = [natural, force].map(|variable| Change {
                variable,
                order: 0,
                values: &values[..variable.len(stepper.model())],
            });
            let mut step = || {
                stepper.set_all(changes.iter().copied()).unwrap();
                stepper.do_step(4e-3).unwrap();
            };
            (0..5).for_each(|_| step());
            let before = COUNT.load(Ordering::Relaxed);
            (0..20).for_each(|_| step());
            assert_eq!(COUNT.load(Ordering::Relaxed), before, "{integrator} {model}");
        }
    }
}
