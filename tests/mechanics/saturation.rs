//! A drive with a limit gives m tanh(x/m) of the x that is asked for it.

use caudal::scene::Document;
use caudal::stepper::Stepper;

use crate::common::{SOFT, largest, soft_moments, stepper_of};

/// The natural curvature and the active moment of each joint at its time.
fn given(stepper: &Stepper) -> [Vec<f64>; 2] {
    let dynamics = stepper.view().dynamics;
    let moments = dynamics.active.as_ref().map_or(Vec::new(), |active| active.moment.clone());
    [dynamics.natural.clone(), moments]
}

#[test]
fn a_joint_is_given_what_the_limit_leaves_of_wave_and_host_together() {
    let (curvatures, moments) = (SOFT.to_string(), soft_moments());
    for (text, key, input, most) in [
        (&curvatures, "actuation.largest_1_m", "natural_curvature_1_m", 2.0),
        (&moments, "actuation.largest_moment_n_m", "active_moment_n_m", 4.0),
    ] {
        for head in ["free", "clamped"] {
            let head = format!("head.kind={head}");
            let mut free = stepper_of(text, &[&head]);
            let mut limited = stepper_of(text, &[&head, &format!("{key}={most:e}")]);
            let rod = &free.model().rod;
            let (joints, spacing) = (rod.joints(), rod.spacing);
            let part: Vec<f64> = joints.clone().map(|k| rod.joint_part(k)).collect();
            let own: Vec<f64> = joints.clone().map(|k| 0.3 * k as f64).collect();
            for stepper in [&mut free, &mut limited] {
                stepper.set(input, &own).unwrap();
                stepper.do_step(0.013).unwrap();
            }
            let ([asked, asked_moment], [natural, moment]) = (given(&free), given(&limited));
            for (i, k) in joints.enumerate() {
                let (asked, found, most) = if moment.is_empty() {
                    (asked[k] / part[i], natural[k] / part[i], most * spacing)
                } else {
                    (asked_moment[k], moment[k], most)
                };
                let expected = most * (asked / most).tanh();
                assert!((found - expected).abs() <= 1e-13 * most, "{key}, {head}, joint {k}: {found} for {expected}");
            }
            assert!(largest(free.state().q.iter().zip(&limited.state().q).map(|(a, b)| a - b)) > 1e-9);
        }
    }
}

#[test]
fn a_limit_out_of_reach_changes_nothing_and_the_balance_closes_within_one() {
    let run = |changes: &[&str]| {
        let mut stepper = stepper_of(
            SOFT,
            &[
                changes,
                &["start.kind=ramp", "start.ramp_s=0.1", "solver.integrator=newmark", "solver.time_step_s=5e-4"],
            ]
            .concat(),
        );
        stepper.do_step(0.3).unwrap();
        stepper
    };
    let [free, far, near] = [&[][..], &["actuation.largest_1_m=1e7"], &["actuation.largest_1_m=1.0"]].map(run);
    let apart = |other: &Stepper| largest(free.state().q.iter().zip(&other.state().q).map(|(a, b)| a - b));
    assert!(apart(&far) < 1e-10 && apart(&near) > 1e-4, "{:e} {:e}", apart(&far), apart(&near));
    let work = near.get_scalar("actuation_work_j").unwrap();
    let defect = near.metrics().numerical_dissipation();
    println!("{work:e} J, {defect:e} J of defect");
    assert!(defect.abs() < 1e-3 * work.abs(), "{defect:e} of {work:e}");
}

#[test]
fn limits_of_another_drive_are_refused() {
    for (text, change, words) in [
        (SOFT.to_string(), "actuation.largest_moment_n_m=1.0", "found without moment_amp_n_m"),
        (soft_moments(), "actuation.largest_1_m=1.0", "found without kappa_amp or slope"),
        (SOFT.to_string(), "actuation.largest_1_m=0.0", "a positive number"),
    ] {
        let mut document = Document::new("limited.toml", text);
        let error = document.set(change).and_then(|()| document.scene().map(|_| ())).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
}
