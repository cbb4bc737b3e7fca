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
    for (model, pace) in [("shape", "tolerance=1e-4"), ("shape", "tolerance=1e-6"),("shape", "time_step_s=5e-3"), ("full", "tolerance=1e-6"), ("full", "time_step_s=5e-3"), ("full", "time_step_s=1.4e-4")] {
        let integrator = if pace.starts_with("tol") { "esdirk3" } else { "implicit-euler" };
        let scene = scene_of(SMOOTH, &[&format!("solver.model={model}"), &format!("solver.{pace}"), &format!("solver.integrator={integrator}")]);
        let mut best = f64::INFINITY;
        let mut out = (0.0, 0);
        for _ in 0..if model == "shape" {20} else {1} {
        let t0 = std::time::Instant::now();
        let s = common::run(&scene);
        best = best.min(t0.elapsed().as_secs_f64()*1e3);
        out = (s.meter().net_displacement(), s.meter().totals.steps);
        }
        println!("{model} {pace} dx {:.9e} steps {} in {best} ms", out.0, out.1);
    }
}
fn table(name: &str, text: &str, key: &str, cases: &[(f64, f64)], more: &[&str]) {
    let mut tally = [[0u32; 3]; 2];
    for &(e, mu) in cases {
        let base = [format!("rod.youngs_modulus_pa={e:e}"), format!("medium.viscosity_pa_s={mu:e}"), "solver.integrator=esdirk3".into(), "solver.tolerance=1e-5".into()];
        let base: Vec<&str> = base.iter().map(|s| s.as_str()).chain(more.iter().copied()).collect();
        let run = |extra: &[&str]| { let scene = scene_of(text, &[&base[..], extra].concat()); let t0 = std::time::Instant::now(); let mut s = caudal::stepper::Stepper::of(&scene).unwrap(); let r = s.do_step(scene.solver.duration_s.get()); if let Err(e) = &r { println!("{e}") } (r.is_ok(), s.meter().net_displacement(), s.meter().totals.path, t0.elapsed().as_secs_f64()*1e3) };
        let t0 = std::time::Instant::now();
        let est = scene_of(text, &base).estimates().unwrap();
        let te = t0.elapsed().as_secs_f64()*1e3;
        let fine = run(&[]);
        let size = fine.1.abs().max(0.01 * fine.2);
        let mut line = format!("{name} {key} E {e:8.1e} mu {mu:8.1e} | full {:+.3e} ({:.0} ms) ", fine.1, fine.3);
        for (i, (m, est)) in [("shape", est.shape), ("overdamped", est.overdamped)].into_iter().enumerate() {
            let got = run(&[&format!("solver.model={m}")]);
            let truth = (got.1 - fine.1).abs() / size;
            tally[i][0] += 1;
            tally[i][1] += u32::from(truth <= est);
            tally[i][2] += u32::from(est <= 30.0 * truth);
            line += &format!("| {m} true {truth:.2e} est {est:.2e} ({:.2}) {:.1} ms ", est / truth, got.3);
        }
        println!("{line} dev {:.1e} te {te:.1}", est.deviation);
    }
    println!("TALLY {name} {tally:?}");
}
#[test]
fn sweep() {
    let grid = |e: [f64; 2], mu: [f64; 2], n: usize| -> Vec<(f64, f64)> { (0..n*n).map(|k| { let f = |r: [f64; 2], i: usize| r[0] * (r[1]/r[0]).powf(i as f64 / (n-1) as f64); (f(e, k / n), f(mu, k % n)) }).collect() };
    table("tail", SMOOTH, "", &grid([70e9, 1e6], [1e-3, 10.0], 8), &["solver.duration_s=2"]);
    const SMALL: &str = r#"
[rod]
nodes = 17
length_m = 0.1
outer_radius_m = 5e-4
youngs_modulus_pa = 1e8
density_kg_m3 = 1100.0
[actuation]
kind = "travelling-wave"
kappa_amp = 30.0
frequency_hz = 1.0
wavelength_m = 0.1
[medium]
viscosity_pa_s = 1.0
density_kg_m3 = 1260.0
[drag]
ratio = 2.0
[solver]
duration_s = 3.0
"#;
    table("small", SMALL, "", &grid([1e10, 1e5], [0.01, 100.0], 6), &[]);
    table("driven", include_str!("../models/driven-head.toml"), "", &grid([1e10, 1e5], [0.01, 10.0], 5), &["solver.duration_s=2.3"]);
}
