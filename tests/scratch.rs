mod common;
use common::{scene_of, STUDY};
const SMOOTH: &str = include_str!("../models/baseline-smooth.toml");

#[test]
fn references() {
    for (start, t) in [("start={ kind = \"ramp\", ramp_s = 0.5 }", 2.0), ("start={ kind = \"shaped\" }", 2.0)] {
        for pace in ["time_step_s=0.005", "tolerance=1e-4", "tolerance=1e-8"] {
            let scene = scene_of(STUDY, &[start, "solver.model=shape", &format!("solver.duration_s={t}"), &format!("solver.{pace}")]);
            let s = common::run(&scene);
            let m = s.meter();
            println!("{pace} dx {:.9e} y {:.6e} steps {} work {:?} dEk {:e} defect {:e}", m.net_displacement(), m.now.com.y, m.totals.steps, m.totals.work, m.now.energy.kinetic - m.first_energy, m.numerical_dissipation());
        }
    }
    for (model, pace) in [("shape", "tolerance=1e-4"), ("shape", "tolerance=1e-6"),("shape", "time_step_s=5e-3"), ("full", "tolerance=1e-6"), ("full", "tolerance=1e-7"), ("full", "time_step_s=5e-3")] {
        let integrator = if pace.starts_with("tol") { "esdirk3" } else { "implicit-euler" };
        let scene = scene_of(SMOOTH, &[&format!("solver.model={model}"), &format!("solver.{pace}"), &format!("solver.integrator={integrator}")]);
        let t0 = std::time::Instant::now();
        let s = common::run(&scene);
        println!("{model} {pace} dx {:.9e} steps {} rej {} in {:?}", s.meter().net_displacement(), s.meter().totals.steps, s.meter().totals.rejections, t0.elapsed());
    }
}

#[test]
fn sweep() {
    let moduli: Vec<f64> = (0..8).map(|i| 70e9_f64 * (1e6_f64 / 70e9).powf(i as f64 / 7.0)).collect();
    for i in 0..8 { for j in 0..8 {
        let (e, mu) = (moduli[i], 1e-3 * 10f64.powf(4.0 * j as f64 / 7.0));
        let base = [format!("rod.youngs_modulus_pa={e:e}"), format!("medium.viscosity_pa_s={mu:e}"), "solver.duration_s=2".to_string(), "solver.integrator=esdirk3".into(), "solver.tolerance=1e-5".into()];
        let base: Vec<&str> = base.iter().map(|s| s.as_str()).collect();
        let run = |extra: &[&str]| { let scene = scene_of(SMOOTH, &[&base[..], extra].concat()); let t0 = std::time::Instant::now(); let mut s = caudal::stepper::Stepper::of(&scene).unwrap(); let r = s.do_step(2.0); (r.is_ok(), s.meter().net_displacement(), s.meter().totals.path, t0.elapsed().as_secs_f64()*1e3) };
        let t0 = std::time::Instant::now();
        let est = scene_of(SMOOTH, &base).estimates();
        let te = t0.elapsed().as_secs_f64()*1e3;
        let full = run(&[]);
        let fine = run(&["solver.tolerance=1e-6"]);
        let shape = run(&["solver.model=shape", "solver.tolerance=1e-6"]);
        let over = run(&["solver.model=overdamped"]);
        let size = fine.1.abs().max(0.01 * fine.2);
        println!("E {e:8.1e} mu {mu:8.1e} | full {:?} {:+.4e} ({:.0e}, {:.1} ms) path {:.2e} | shape true {:.2e} est {:.2e} ({:.1} ms) | over {:?} true {:.2e} est {:.2e} ({:.1} ms) dev {:.1e} te {te:.1}", fine.0, fine.1, (full.1-fine.1).abs()/size, fine.3, fine.2, (shape.1-fine.1).abs()/size, est.as_ref().map_or(f64::NAN, |e| e.shape), shape.3, over.0, (over.1-fine.1).abs()/size, est.as_ref().map_or(f64::NAN, |e| e.overdamped), over.3, est.as_ref().map_or(f64::NAN, |e| e.deviation));
    } }
}
