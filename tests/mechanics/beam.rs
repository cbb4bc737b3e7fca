//! The discrete rod is Euler's and Bernoulli's beam: frequencies, cantilevers, and the elastica beyond small deflections.

use crate::common;
use std::f64::consts::PI;

use caudal::modes::Modes;
use caudal::rod::Rod;
use caudal::scene::Scene;
use common::{distance, equilibrium, order, rod, scene};

/// β₁L and β₂L of a free-free beam of even section, ω = (βL)²√(EI/ρAL⁴): roots of cos x cosh x = 1.
const FREE_FREE: [f64; 2] = [4.730040744862704, 7.853204624095838];
/// β₁L of a cantilever: the first root of cos x cosh x = −1.
const CANTILEVER: f64 = 1.8751040687119611;

/// An even rod with a mass lumping and a head.
fn even_rod(nodes: usize, lumping: &str, head: &str) -> Rod {
    let changes = [
        "rod.stiffness_gradient=0",
        &format!("rod.nodes={nodes}"),
        &format!("rod.mass_lumping={lumping}"),
        &format!("head.kind={head}"),
    ];
    rod(&scene(&changes))
}

/// Relative error of a frequency (rad/s) of the continuous beam's (βL)²√(EI/ρAL⁴).
fn deviation(rod: &Rod, frequency: f64, beta_length: f64) -> f64 {
    let line_density = 2700.0 * rod.sections.at(0.0).area();
    let exact = beta_length.powi(2) * (rod.ei / line_density).sqrt() / rod.length.powi(2);
    frequency / exact - 1.0
}

#[test]
fn free_free_frequencies_converge_with_second_order_where_the_ends_carry_half_a_mass() {
    for (mode, beta_length) in FREE_FREE.into_iter().enumerate() {
        let [e9, e33, e65, e129] = [9, 33, 65, 129].map(|nodes| {
            let rod = even_rod(nodes, "tributary", "free");
            deviation(&rod, Modes::of(&rod).unwrap().bending[mode], beta_length)
        });
        // Measured: −5.979 % and −12.342 % at N = 9, −0.401 % and −0.878 % at N = 33.
        assert!((e9 - [-0.05979, -0.12342][mode]).abs() < 1e-5, "{e9}");
        assert!((e33 - [-0.00401, -0.00878][mode]).abs() < 1e-5, "{e33}");
        // Measured: 1.992 and 1.988, 1.998 and 1.997.
        assert!((order(e33, e65) - 2.0).abs() < 0.02, "{}", order(e33, e65));
        assert!((order(e65, e129) - 2.0).abs() < 0.01, "{}", order(e65, e129));
    }
}

#[test]
fn free_free_frequencies_converge_with_first_order_where_every_node_carries_the_same_mass() {
    for (mode, beta_length) in FREE_FREE.into_iter().enumerate() {
        let [e9, e129, e257] = [9, 129, 257].map(|nodes| {
            let rod = even_rod(nodes, "uniform", "free");
            deviation(&rod, Modes::of(&rod).unwrap().bending[mode], beta_length)
        });
        // Measured: −20.537 % and −22.535 % at N = 9.
        assert!((e9 - [-0.20537, -0.22535][mode]).abs() < 1e-5, "{e9}");
        // Measured: 0.989 and 0.994.
        assert!((order(e129, e257) - 1.0).abs() < 0.02, "{}", order(e129, e257));
    }
}

#[test]
fn the_first_frequency_of_a_cantilever_converges_with_second_order() {
    let [e33, e65, e129] = [33, 65, 129].map(|nodes| {
        let rod = even_rod(nodes, "tributary", "clamped");
        deviation(&rod, Modes::of(&rod).unwrap().lowest(), CANTILEVER)
    });
    // Measured: −8.254e-4 at N = 33.
    assert!((e33 + 8.254e-4).abs() < 1e-7, "{e33}");
    // Measured: 1.999 and 2.000.
    assert!((order(e33, e65) - 2.0).abs() < 0.01, "{}", order(e33, e65));
    assert!((order(e65, e129) - 2.0).abs() < 0.01, "{}", order(e65, e129));
}

#[test]
fn the_fastest_stretching_mode_of_even_masses_is_the_chain_s() {
    for nodes in [9, 17, 33] {
        let rod = even_rod(nodes, "uniform", "free");
        let chain = 2.0 / rod.spacing * (70e9_f64 / 2700.0).sqrt() * (PI / (2 * nodes) as f64).cos();
        let highest = Modes::of(&rod).unwrap().highest();
        // Measured: 6e-16.
        assert!((highest / chain - 1.0).abs() < 1e-14, "{:e}", highest / chain - 1.0);
    }
}

#[test]
fn the_study_tail_s_first_frequency_is_149_hz_on_9_even_masses_and_188_hz_on_a_fine_mesh() {
    let hertz = |nodes: usize, lumping: &str| {
        let changes = [&*format!("rod.nodes={nodes}"), &*format!("rod.mass_lumping={lumping}")];
        Modes::of(&rod(&scene(&changes))).unwrap().lowest() / (2.0 * PI)
    };
    // Measured: 149.2073 Hz and 187.9822 Hz.
    assert!((hertz(9, "uniform") - 149.207).abs() < 1e-3);
    assert!((hertz(257, "tributary") - 187.982).abs() < 1e-3);
}

/// A clamped even rod of `nodes` nodes, with further changes.
fn cantilever(nodes: usize, changes: &[&str]) -> Scene {
    let nodes = format!("rod.nodes={nodes}");
    scene(&[&["rod.stiffness_gradient=0", "head.kind=clamped", &nodes], changes].concat())
}

/// Deflection of the tip of a cantilever (m, positive in the load's direction −y) under a force there (N).
fn tip_load_deflection(nodes: usize, force: f64) -> f64 {
    let mut forces = vec![0.0; 2 * nodes];
    forces[2 * nodes - 1] = -force;
    let (_, state) = equilibrium(&cantilever(nodes, &[]), &forces, 1);
    -state.q[2 * nodes - 1]
}

#[test]
fn a_cantilever_under_a_small_tip_load_deflects_by_its_discrete_formula() {
    for nodes in [3, 9, 33, 129] {
        let rod = rod(&cantilever(nodes, &[]));
        // A deflection of 1e-6 L, whose square is the part that the linear formula leaves out.
        let force = 3.0 * rod.ei * 1e-6;
        let inner: f64 = (1..nodes - 1).map(|k| rod.spacing * (rod.length - rod.arc_length(k)).powi(2)).sum();
        let formula = force / rod.ei * (0.5 * rod.spacing * rod.length.powi(2) + inner);
        let error = tip_load_deflection(nodes, force) / formula - 1.0;
        // Measured: at most 1.3e-12, the square of the slope.
        assert!(error.abs() < 1e-10, "N = {nodes}: {error:e}");
    }
}

#[test]
fn a_cantilever_under_tip_load_and_own_weight_is_off_by_its_spacing_squared_and_no_more() {
    let of_load = |nodes| {
        let rod = rod(&cantilever(nodes, &[]));
        tip_load_deflection(nodes, 3.0 * rod.ei * 1e-6) / 1e-6 - 1.0
    };
    let of_weight = |nodes: usize| {
        let rod = rod(&cantilever(nodes, &[]));
        let gravity = 8.0 * rod.ei * 1e-6 / (2700.0 * rod.sections.at(0.0).area());
        let scene = cantilever(nodes, &[&format!("loads.gravity_m_s2=[0, -{gravity:e}]")]);
        let (_, state) = equilibrium(&scene, &vec![0.0; 2 * nodes], 1);
        -state.q[2 * nodes - 1] / 1e-6 - 1.0
    };
    for nodes in [9, 17, 33, 65] {
        // Both sums are trapezoidal rules of integrals whose error has one term: ½(ΔL/L)² and (ΔL/L)².
        let square = 1.0 / ((nodes - 1) as f64).powi(2);
        let (load, weight) = (of_load(nodes) - 0.5 * square, of_weight(nodes) - square);
        // Measured: at most 1.1e-12 and 8.6e-13, the square of the slope.
        assert!(load.abs() < 1e-11, "N = {nodes}: {load:e}");
        assert!(weight.abs() < 1e-11, "N = {nodes}: {weight:e}");
    }
}

/// PL²/EI with the tip's deflection across and towards the clamp, over L: K. E. Bisshopp & D. C. Drucker, Q. Appl. Math.
/// 3 (1945) 272–275; digits from K. Mattiasson, Int. J. Numer. Methods Eng. 17 (1981) 145–153.
const ELASTICA: [[f64; 3]; 4] =
    [[1.0, 0.30172, 0.05643], [2.0, 0.49346, 0.16064], [5.0, 0.71379, 0.38763], [10.0, 0.81061, 0.55500]];

/// Positions (m) of a solid cantilever of length 1 m under PL²/EI = `load`; one of 1 mm hardly stretches.
fn elastica(nodes: usize, radius: f64, load: f64) -> Vec<f64> {
    let scene = cantilever(nodes, &[&format!("rod.outer_radius_m={radius}"), "rod.inner_radius_m=0"]);
    let mut forces = vec![0.0; 2 * nodes];
    forces[2 * nodes - 1] = -load * rod(&scene).ei;
    equilibrium(&scene, &forces, 10).1.q
}

#[test]
fn a_cantilever_bends_as_the_elastica_far_beyond_small_deflections() {
    // Measured: at most 4.5e-4 and 3.6e-5, both of the deflection towards the clamp at PL²/EI = 10.
    for (nodes, tolerance) in [(33, 1.5e-3), (129, 1e-4)] {
        for [load, across, along] in ELASTICA {
            let q = elastica(nodes, 0.001, load);
            let [tip_x, tip_y] = [q[2 * nodes - 2], q[2 * nodes - 1]];
            assert!((-tip_y - across).abs() < tolerance, "N = {nodes}, PL²/EI = {load}: {tip_y}");
            assert!((1.0 - tip_x - along).abs() < tolerance, "N = {nodes}, PL²/EI = {load}: {tip_x}");
        }
    }
}

#[test]
fn the_elastica_s_shape_converges_with_second_order() {
    for [load, ..] in ELASTICA {
        // At the sixteenths of the rod; the tip's own error nearly cancels at some loads.
        let [a, b, c] = [257, 513, 1025].map(|nodes: usize| {
            let q = elastica(nodes, 0.01, load);
            (0..=16).flat_map(|i| [0, 1].map(|axis| q[i * (nodes - 1) / 8 + axis])).collect::<Vec<_>>()
        });
        let observed = order(distance(&a, &b), distance(&b, &c));
        // Measured: 2.003, 2.010, 1.989, 1.984; on coarser meshes a term of third order still shows (1.88 from 65 to 257).
        assert!((observed - 2.0).abs() < 0.02, "PL²/EI = {load}: {observed}");
    }
}
