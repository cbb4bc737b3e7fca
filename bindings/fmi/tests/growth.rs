//! Creating many instances does not leak memory. This test is alone in its process, whose memory it measures.
#![allow(clippy::unwrap_used, clippy::undocumented_unsafe_blocks, missing_docs, reason = "the test is the host")]
#![cfg(target_os = "linux")]

mod common;

use std::ptr::null_mut;

use caudal::fmu::Standard;
use common::{Fmi3, Unpacked, document};

/// Resident memory of this process, bytes.
fn memory() -> usize {
    let status = std::fs::read_to_string("/proc/self/statm").unwrap();
    4096 * status.split(' ').nth(1).unwrap().parse::<usize>().unwrap()
}

#[test]
fn ten_thousand_instances_one_after_the_other_leave_nothing() {
    let fmu = Unpacked::of(&document("baseline", &[]), Standard::Fmi3);
    let fmi = Fmi3::of(&fmu);
    let cycle = || {
        let a = fmi.start();
        assert_eq!(fmi.advance(a, 0.0, 5e-3).0, 0);
        let mut state = null_mut();
        unsafe {
            assert_eq!((fmi.save)(a, &mut state), 0);
            assert_eq!((fmi.forget)(a, &mut state), 0);
            (fmi.free)(a);
        }
    };
    (0..1000).for_each(|_| cycle());
    let before = memory();
    (0..10_000).for_each(|_| cycle());
    let growth = memory().saturating_sub(before);
    println!("{growth} bytes more after 10 000 cycles");
    // Leaking the smallest array of an instance, of 9 numbers, in every cycle would add 720 kB. Measured: 0 bytes.
    assert!(growth < 400 << 10, "{growth}");
}
