//! How fast bodies swim that others have measured and computed: an eel, and swimmers of every size.

use crate::common;
use std::f64::consts::TAU;

use caudal::scene::Scene;
use common::{run, scene_of};

/// Carling's eel as Kern & Koumoutsakos computed it (J. Exp. Biol. 209, 2006), of length 1 m and with period 1 s, in a fluid of
/// kinematic viscosity `nu` (m²/s), for `duration` s: y = 0.125 (s + 0.03125)/1.03125 sin 2π(s − t) across the body, as its
/// curvature y″; half widths and heights of its ellipses.
fn eel(nu: f64, duration: f64, changes: &[&str]) -> Scene {
    let points = |of: &dyn Fn(f64) -> f64| {
        let all: Vec<String> =
            (0..=40).map(|i| format!("[{}, {}]", f64::from(i) / 40.0, of(f64::from(i) / 40.0))).collect();
        format!("[{}]", all.join(", "))
    };
    let width = |s: f64| {
        let w: f64 = if s < 0.04 {
            (0.08 * s - s * s).sqrt()
        } else if s < 0.95 {
            0.04 - 0.03 * (s - 0.04) / 0.91
        } else {
            0.01 * (1.0 - s) / 0.05
        };
        w.max(0.004)
    };
    let depth = |s: f64| 2.0 * 0.08 * (1.0 - ((s - 0.51) / 0.51).powi(2)).max(0.01).sqrt();
    let (across, rise) = (|s: f64| 0.125 * (s + 0.03125) / 1.03125, 0.125 / 1.03125);
    let size = |s: f64| (TAU * TAU * across(s)).hypot(2.0 * rise * TAU);
    // κ = 2 A′ k cos(ks − ωt) − A k² sin(ks − ωt) = size·sin(ωt − ks + phase).
    let phase = |s: f64| -(2.0 * rise * TAU).atan2(TAU * TAU * across(s));
    let text = format!(
        r#"name = "eel"
[rod]
nodes = 33
length_m = 1.0
outer_radius_m = {}
depth_m = {}
youngs_modulus_pa = 1e9
density_kg_m3 = 1000.0
[actuation]
kind = "travelling-wave"
kappa_amp = 1.0
frequency_hz = 1.0
wavelength_m = 1.0
amplitude_profile = {}
phase_profile_rad = {}
[medium]
viscosity_pa_s = {:e}
density_kg_m3 = 1000.0
[drag]
law = "cross-flow"
[reactive]
[solver]
model = "shape"
tolerance = 1e-5
duration_s = {duration}
"#,
        points(&width),
        points(&depth),
        points(&size),
        points(&phase),
        1000.0 * nu
    );
    scene_of(&text, changes)
}

/// Speed in lengths per period, and peak-to-peak excursion of the tip in lengths, over the last whole cycles.
fn swims(scene: &Scene) -> [f64; 2] {
    let stepper = run(scene);
    let of = |name: &str| stepper.get_scalar(name).unwrap();
    let (speed, strouhal) = (of("cycle_speed_m_s"), of("cycle_strouhal_number"));
    [speed, strouhal * speed]
}

#[test]
fn an_eel_swims_as_fast_as_it_was_computed_to() {
    // Kern & Koumoutsakos find 0.40 lengths a period, others 0.26 to 0.5: 30 % is the error of such models.
    let of = |changes: &[&str]| swims(&eel(1.4e-4, 12.0, changes))[0];
    let [plain, blunt, rough] = [
        of(&[]),
        of(&["drag.form_drag=2.0", "drag.thinning=0.0"]),
        of(&["drag.skin_friction=5.4", "drag.thinning=1.0"]),
    ];
    // Measured: 0.412, 0.435 with a form drag of 2 and no thinning, 0.318 with Taylor's friction. An independent program of the
    // same equations says 0.361, 0.403, 0.281 of a body whose ends and recoil may differ: ratios 1.055 and 0.772 here, 1.116 and
    // 0.778 there.
    assert!((plain / 0.40 - 1.0).abs() < 0.3, "{plain}");
    assert!((blunt / plain - 1.116).abs() < 0.1 && (rough / plain - 0.778).abs() < 0.05, "{plain} {blunt} {rough}");
}

#[test]
fn swimmers_of_every_size_are_as_fast_as_gazzola_s() {
    // Gazzola, Argentina & Mahadevan (Nature Physics 10, 2014): Re = 0.03 Sw^1.31 and 0.4 Sw^1.02, the lower.
    let mut points: Vec<[f64; 2]> = Vec::new();
    // Slopes by an independent program of the same equations.
    let slopes = [1.29, 1.34, 1.33, 1.26, 1.16, 1.08, 1.04];
    for (i, wanted) in [15.0, 160.0, 545.0, 1.6e3, 1.2e4, 8e4, 5e5, 1.6e6].into_iter().enumerate() {
        // By the excursion that the wave means; the true one follows.
        let nu = TAU * 0.25 / wanted;
        let [speed, excursion] = swims(&eel(nu, if wanted < 1e3 { 6.0 } else { 24.0 }, &[]));
        let (swimming, reynolds) = (TAU * excursion / nu, speed / nu);
        let fit = (0.03 * swimming.powf(1.31)).min(0.4 * swimming.powf(1.02));
        // Measured: 0.48, 0.50, 0.52, 0.52, 0.52, 0.68, 0.79, 0.84.
        assert!((0.4..2.5).contains(&(reynolds / fit)), "{swimming}: {}", reynolds / fit);
        if let Some([s, r]) = points.last() {
            let slope = (reynolds / r).ln() / (swimming / s).ln();
            // Measured: 1.323, 1.348, 1.308, 1.236, 1.160, 1.107, 1.071.
            assert!((slope - slopes[i - 1]).abs() < 0.1, "{swimming}: {slope}");
        }
        points.push([swimming, reynolds]);
    }
}
