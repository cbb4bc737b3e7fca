//! Every method amplifies the linear oscillator as theory says, from steps that resolve it to steps that skip it.

use caudal::error::Result;
use caudal::integrator::{METHODS, Method, stability_limit};
use caudal::linear::BandMatrix;
use caudal::newton::Newton;
use caudal::system::{Linearisation, State, System};
use nalgebra::Matrix4;

/// Nodes without bonds: q'' = −2ζω q' − ω² q in every unknown.
#[derive(Debug)]
struct Oscillators {
    square: f64,
    /// 2ζω.
    lost: f64,
}

const NODES: usize = 3;

impl System for Oscillators {
    fn nodes(&self) -> usize {
        NODES
    }

    fn length(&self) -> f64 {
        1.0
    }

    fn lumped_masses(&self) -> Option<&[f64]> {
        Some(&[1.0; NODES])
    }

    fn move_to(&mut self, t: f64, state: &mut State) {
        state.t = t;
    }

    fn assemble(&mut self, state: &State, residual: &mut [f64], jacobian: Option<Linearisation<'_>>) -> Result<()> {
        for (i, r) in residual.iter_mut().enumerate() {
            *r = state.a[i] + self.lost * state.v[i] + self.square * state.q[i];
        }
        if let Some(Linearisation { matrix, direction }) = jacobian {
            *matrix = BandMatrix::new(NODES);
            let slope = direction.a + self.lost * direction.v + self.square * direction.q;
            let block = nalgebra::Matrix2::from_diagonal_element(slope);
            (0..NODES).for_each(|k| matrix.add_block(k, k, &block));
        }
        Ok(())
    }

    fn check_step(&self, _: &State, _: &State) -> Result<()> {
        Ok(())
    }

    fn residual_floor(&self, _: &State) -> f64 {
        f64::INFINITY
    }
}

/// The spectral radius of one step of 1 s, as a map of q, v, a and what the method remembers.
fn measured(method: &Method, values: &[f64], omega: f64, damping: f64) -> f64 {
    let mut integrator = (method.build)(values);
    let mut newton = Newton::new(NODES, 1e-14).unwrap();
    let mut system = Oscillators { square: omega * omega, lost: 2.0 * damping * omega };
    let scale = [1.0, 1.0 + omega, 1.0 + omega * omega, 1.0 + omega * omega];
    let mut map = Matrix4::zeros();
    for j in 0..4 {
        let mut from = State::zeros(2 * NODES);
        integrator.begin(&mut from);
        let remembers = !from.memory.is_empty();
        match j {
            0 => from.q.fill(scale[0]),
            1 => from.v.fill(scale[1]),
            2 => from.a.fill(scale[2]),
            _ => from.memory.fill(scale[3]),
        }
        let mut to = from.clone();
        to.t = 1.0;
        integrator.step(&mut system, &mut newton, &from, 1.0, &mut to).unwrap();
        let w = if remembers { to.memory[0] } else { 0.0 };
        for (i, x) in [to.q[0], to.v[0], to.a[0], w].into_iter().enumerate() {
            map[(i, j)] = if j == 3 && !remembers { 0.0 } else { x / scale[i] };
        }
    }
    map.complex_eigenvalues().iter().map(|root| root.norm()).fold(0.0, f64::max)
}

/// Every method with its defaults and with parameters at which theory says something else.
fn methods() -> Vec<(&'static Method, Vec<f64>)> {
    let mut all: Vec<_> = METHODS.iter().map(|method| (*method, method.defaults())).collect();
    let more: [(&str, &[f64]); 9] = [
        ("newmark", &[0.5, 0.5]),
        ("newmark", &[1.0 / 12.0, 0.5]),
        ("newmark", &[1.0 / 6.0, 0.5]),
        ("newmark", &[0.25, 0.4]),
        ("newmark", &[0.4, 0.7]),
        ("generalized-alpha", &[0.0]),
        ("generalized-alpha", &[0.5]),
        ("generalized-alpha", &[0.9]),
        ("generalized-alpha", &[1.0]),
    ];
    all.extend(more.map(|(name, values)| (Method::named(name).unwrap(), values.to_vec())));
    all
}

#[test]
fn every_method_amplifies_an_oscillator_as_theory_says() {
    for (method, values) in methods() {
        let integrator = (method.build)(&values);
        let mut worst: f64 = 0.0;
        for damping in [0.0, 0.05, 0.7, 3.0] {
            for i in 0..=90 {
                let omega = 10.0_f64.powf(-3.0 + 0.1 * f64::from(i));
                let found = measured(method, &values, omega, damping);
                let wanted = integrator.spectral_radius(omega, damping);
                worst = worst.max((found - wanted).abs() / wanted.max(1.0));
            }
        }
        println!("{} {values:?}: {worst:e}", method.name);
        // Measured: below 1e-10 but for newmark [0.5, 0.5], 9.5e-7 where its two roots meet, generalized-alpha, 5.3e-8, and
        // esdirk3, 1.0e-7: there a modulus is as uncertain as the root of a rounding.
        // Where three meet, as at rho_inf = 1 for large steps, it is as uncertain as the cube root: 2.2e-5.
        let certain = if (method.name, &values[..]) == ("generalized-alpha", &[1.0]) { 4e-5 } else { 2e-6 };
        assert!(worst < certain, "{} {values:?}: {worst:e}", method.name);
    }
}

#[test]
fn the_limits_of_stability_are_those_of_theory() {
    let damped =
        |name: &str, values: &[f64], damping| stability_limit(&*(Method::named(name).unwrap().build)(values), damping);
    let limit = |name: &str, values: &[f64]| damped(name, values, 0.0);
    for (name, values, wanted) in [
        ("symplectic-euler", &[][..], 2.0),
        ("newmark", &[1.0 / 12.0, 0.5], 6.0_f64.sqrt()),
        ("newmark", &[1.0 / 6.0, 0.5], 12.0_f64.sqrt()),
    ] {
        let found = limit(name, values).unwrap();
        assert!((found / wanted - 1.0).abs() < 1e-6, "{name}: {found}"); // a modulus is 1 to 1e-9, its excess a root
    }
    for damping in [0.01, 0.3, 2.0] {
        let (found, wanted) =
            (damped("symplectic-euler", &[], damping).unwrap(), 2.0 * (1.0_f64.hypot(damping) - damping));
        assert!((found / wanted - 1.0).abs() < 1e-6, "damping ratio {damping}: {found}");
    }
    for name in ["implicit-euler", "newmark", "generalized-alpha", "esdirk3"] {
        assert_eq!(limit(name, &Method::named(name).unwrap().defaults()), None, "{name}");
    }
    for gamma in [0.0, 0.4] {
        assert_eq!(limit("newmark", &[0.25, gamma]), Some(0.0), "it amplifies at every step");
    }
}
