//! What calls of a host cost beyond the stepper's own work, in turns with it: `cargo bench -p caudal-fmi`.
#![allow(clippy::unwrap_used, clippy::undocumented_unsafe_blocks, missing_docs, reason = "the bench is the host")]

#[path = "../tests/common/mod.rs"]
mod common;

use std::ptr::null_mut;
use std::time::Instant;

use caudal::fmu::Standard;
use caudal::stepper::Stepper;
use common::{Fmi3, Unpacked, document, reference};

/// The shortest time of many short samples of `count` calls, ns a call.
fn shortest(count: u32, mut call: impl FnMut()) -> f64 {
    let sample = |_| {
        let start = Instant::now();
        (0..count).for_each(|_| call());
        start.elapsed().as_nanos() as f64 / f64::from(count)
    };
    (0..400).map(sample).fold(f64::INFINITY, f64::min)
}

fn main() {
    let document = document("baseline-smooth", &["rod.nodes=3"]);
    let fmu = Unpacked::of(&document, Standard::Fmi3);
    let fmi = Fmi3::of(&fmu);
    let a = fmi.start();
    let mut stepper = Stepper::of(&document.scene().unwrap()).unwrap();
    let start = stepper.save();
    let mut state = null_mut();
    unsafe { assert_eq!((fmi.save)(a, &mut state), 0) };
    let (mut t, h) = (0.0, 5e-3);
    let reference = reference("tip_y_m");
    // The same steps again and again, in turns, so that both see the same machine.
    let (mut own, mut through) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..400 {
        stepper.restore(&start).unwrap();
        let begin = Instant::now();
        (0..20).for_each(|_| stepper.do_step(h).unwrap());
        own = own.min(begin.elapsed().as_nanos() as f64 / 20.0);
        unsafe { assert_eq!((fmi.restore)(a, state), 0) };
        t = 0.0;
        let (mut event, mut end, mut early, mut last) = (0, 0, 0, 0.0);
        let begin = Instant::now();
        for _ in 0..20 {
            let status = unsafe { (fmi.step)(a, t, h, 1, &mut event, &mut end, &mut early, &mut last) };
            assert_eq!(status, 0);
            t = last;
        }
        through = through.min(begin.elapsed().as_nanos() as f64 / 20.0);
    }
    let mut value = 0.0;
    let get = shortest(1000, || assert_eq!(unsafe { (fmi.get)(a, &reference, 1, &mut value, 1) }, 0));
    let many = [reference; 50];
    let mut values = [0.0; 50];
    let get_many =
        shortest(100, || assert_eq!(unsafe { (fmi.get)(a, many.as_ptr(), 50, values.as_mut_ptr(), 50) }, 0)) / 50.0;
    println!(
        "step: {own:.0} ns of the stepper, {through:.0} ns through FMI 3.0; get {get:.1} ns, {get_many:.1} ns each of 50 (t = {t})"
    );
}
