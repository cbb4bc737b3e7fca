//! Cost of a host's calls in addition to the stepper's own work, measured alternately with it: `cargo bench -p caudal-fmi`.
#![allow(clippy::unwrap_used, clippy::undocumented_unsafe_blocks, missing_docs, reason = "the bench is the host")]

#[path = "../tests/common/mod.rs"]
mod common;

use std::ptr::null_mut;
use std::time::{Duration, Instant};

use caudal::fmu::Standard;
use caudal::stepper::{InputChange, Stepper};
use common::{Fmi3, Unpacked, document, reference};

/// The shortest time of many short samples of `count` calls, ns per call.
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
    let begun = stepper.save();
    let mut state = null_mut();
    unsafe { assert_eq!((fmi.save)(a, &mut state), 0) };
    let (mut t, h) = (0.0, 5e-3);
    let tip = reference("tip_y_m");
    // The same steps repeatedly and alternately, so that both run under the same conditions.
    let (mut own, mut through) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..400 {
        stepper.restore(&begun).unwrap();
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
    let get = shortest(1000, || assert_eq!(unsafe { (fmi.get)(a, &tip, 1, &mut value, 1) }, 0));
    let many = [tip; 50];
    let mut values = [0.0; 50];
    let get_many =
        shortest(100, || assert_eq!(unsafe { (fmi.get)(a, many.as_ptr(), 50, values.as_mut_ptr(), 50) }, 0)) / 50.0;
    println!(
        "step: {own:.0} ns of the stepper, {through:.0} ns through FMI 3.0; get {get:.1} ns, {get_many:.1} ns each of 50 (t = {t})"
    );
    let scalars = ["viscosity_pa_s", "flow_x_m_s", "flow_y_m_s", "actuation_phase_rad"];
    let phase = reference(scalars[3]);
    let set = shortest(1000, || assert_eq!(unsafe { (fmi.set)(a, &phase, 1, &0.0, 1) }, 0));
    // Forces on three nodes and four scalars in, ten scalars out.
    let inputs =
        [("force_x_n", 3), ("force_y_n", 3), (scalars[0], 1), (scalars[1], 1), (scalars[2], 1), (scalars[3], 1)];
    let start = stepper.get(scalars[0]).unwrap()[0];
    let given = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, start, 0.0, 0.0, 0.0];
    let (mut places, mut next) = (Vec::new(), 0);
    for (name, length) in inputs {
        places.push((stepper.find(name).unwrap(), next..next + length));
        next += length;
    }
    let outputs = [
        "tip_x_m",
        "tip_y_m",
        "tip_vx_m_s",
        "tip_vy_m_s",
        "x_com_m",
        "y_com_m",
        "kinetic_energy_j",
        "bending_energy_j",
        "actuation_power_w",
        "viscous_power_w",
    ];
    let read = outputs.map(|name| stepper.find(name).unwrap());
    let (set_by, get_by) = (inputs.map(|(name, _)| reference(name)), outputs.map(reference));
    // Passing inputs and stepping, without the calls that set and read values.
    let (mut own, mut through, mut found) = ([f64::INFINITY; 2], [f64::INFINITY; 2], [0.0; 10]);
    for _ in 0..400 {
        stepper.restore(&begun).unwrap();
        let (begin, mut stepping) = (Instant::now(), Duration::ZERO);
        for _ in 0..20 {
            let begin = Instant::now();
            let changes = places.iter().map(|(variable, place)| InputChange {
                variable,
                order: 0,
                values: &given[place.clone()],
            });
            stepper.set_all(changes).unwrap();
            stepper.do_step(h).unwrap();
            stepping += begin.elapsed();
            let view = stepper.view();
            found.iter_mut().zip(read).for_each(|(value, variable)| *value = variable.first(&view));
        }
        own = least(own, [begin.elapsed(), stepping]);
        unsafe { assert_eq!((fmi.restore)(a, state), 0) };
        t = 0.0;
        let (mut event, mut end, mut early, mut last) = (0, 0, 0, 0.0);
        let mut values = [0.0; 10];
        let (begin, mut stepping) = (Instant::now(), Duration::ZERO);
        for _ in 0..20 {
            unsafe {
                assert_eq!((fmi.set)(a, set_by.as_ptr(), set_by.len(), given.as_ptr(), given.len()), 0);
                let begin = Instant::now();
                assert_eq!((fmi.step)(a, t, h, 1, &mut event, &mut end, &mut early, &mut last), 0);
                stepping += begin.elapsed();
                assert_eq!((fmi.get)(a, get_by.as_ptr(), get_by.len(), values.as_mut_ptr(), values.len()), 0);
            }
            t = last;
        }
        through = least(through, [begin.elapsed(), stepping]);
        assert_eq!(values, found);
    }
    println!(
        "ten inputs, step, ten outputs: {:.0} ns of the stepper, {:.0} ns through FMI 3.0, of which do_step {:.0} and {:.0}; set {set:.1} ns",
        own[0], through[0], own[1], through[1]
    );
}

/// The smaller of the times of 20 calls, ns per call.
fn least(known: [f64; 2], times: [Duration; 2]) -> [f64; 2] {
    [0, 1].map(|i| known[i].min(times[i].as_nanos() as f64 / 20.0))
}
