//! Every derivative in the program is that of the force or energy beside it, to 1e-6 against differences.

use crate::common;
use std::sync::Arc;

use caudal::linear::BandMatrix;
use caudal::linear::Direction;
use caudal::metrics::Measurements;
use caudal::model::{Dynamics, Model};
use caudal::rod::bend::{self, Joint};
use caudal::rod::elastic;
use caudal::rod::{Cell, Edge, node};
use caudal::scene::Scene;
use caudal::system::{Linearisation, State, System};
use common::{Dice, SOFT, largest, scene_of};
use nalgebra::{DMatrix, DVector, Vector2};

/// Largest difference allowed between a derivative and its central difference, over the largest entry. Measured:
/// stretching 9.2e-11, bending 2.7e-10 (rounding of the differences),
/// the whole Jacobian 4.4e-11, the energies' gradient 3.6e-12.
const TOLERANCE: f64 = 1e-6;

/// Derivative of `f` at `x`, one column an argument: central differences with steps `h` and `h`/2, extrapolated.
fn differences(f: impl Fn(&[f64]) -> Vec<f64>, x: &[f64], h: f64) -> DMatrix<f64> {
    let along = |j: usize, h: f64| {
        let moved = |by: f64| {
            let mut x = x.to_vec();
            x[j] += by;
            DVector::from(f(&x))
        };
        (moved(h) - moved(-h)) / (2.0 * h)
    };
    let columns: Vec<_> = (0..x.len()).map(|j| (along(j, 0.5 * h) * 4.0 - along(j, h)) / 3.0).collect();
    DMatrix::from_columns(&columns)
}

/// Largest difference over the largest entry.
fn deviation(exact: &DMatrix<f64>, differences: &DMatrix<f64>) -> f64 {
    assert!(exact.amax() > 0.0);
    largest((exact - differences).iter().copied()) / exact.amax()
}

/// Runs `check` on many random inputs and prints and bounds the largest of the deviations that it gives.
fn assert_derivatives(name: &str, times: u64, check: impl Fn(&mut Dice) -> f64) {
    let worst = largest((0..times).map(|seed| check(&mut Dice(seed))));
    println!("{name}: {worst:e}");
    assert!(worst <= TOLERANCE, "{name}: {worst:e}");
}

fn vector(dice: &mut Dice, low: f64, high: f64) -> Vector2<f64> {
    let (length, angle) = (dice.between(low, high), dice.between(-3.0, 3.0));
    Vector2::new(length * angle.cos(), length * angle.sin())
}

const NO_JOINT: Joint = Joint { couple: 0.0, stiffness: 0.0 };
const EA: f64 = 3.0;
const SPACING: f64 = 0.7;
const CELL: Cell = Cell { rest: SPACING, axial: EA / SPACING };

fn stretching(x: Vector2<f64>) -> Vector2<f64> {
    let edge = Edge::new(x);
    elastic::force(&edge, CELL.tension(&edge), &NO_JOINT, &NO_JOINT)
}

#[test]
fn stretching_gradient_and_hessian_are_those_of_its_energy() {
    assert_derivatives("stretching gradient", 200, |dice| {
        let x = vector(dice, 0.2, 2.0);
        let energy = |x: &[f64]| vec![CELL.energy(&Edge::new(node(x, 0)))];
        let gradient = stretching(x);
        // Over EA: the gradient itself may be near zero.
        largest(
            (DMatrix::from_row_slice(1, 2, gradient.as_slice()) - differences(energy, x.as_slice(), 1e-3))
                .iter()
                .copied(),
        ) / EA
    });
    assert_derivatives("stretching Hessian", 200, |dice| {
        let x = vector(dice, 0.2, 2.0);
        let gradient = |x: &[f64]| stretching(node(x, 0)).as_slice().to_vec();
        let edge = Edge::new(x);
        let tension = CELL.tension(&edge);
        let hessian = elastic::stiffness(&edge, EA / SPACING, tension, [&NO_JOINT; 2], 1.0);
        deviation(
            &DMatrix::from_row_slice(2, 2, &<[f64; 4]>::from(hessian)),
            &differences(gradient, x.as_slice(), 1e-3),
        )
    });
}

/// Two edges e and f as [e_x, e_y, f_x, f_y], turning by up to 2.8 rad.
fn joint(dice: &mut Dice) -> Vec<f64> {
    let e = vector(dice, 0.5, 1.5);
    let turn = dice.between(-2.8, 2.8);
    let f = nalgebra::Rotation2::new(turn) * e.normalize() * dice.between(0.5, 1.5);
    vec![e.x, e.y, f.x, f.y]
}

const BENDING: f64 = 2.0;
const NATURAL: f64 = 0.9;

fn kappa(x: &[f64]) -> f64 {
    bend::curvature(Edge::new(node(x, 0)).t, Edge::new(node(x, 1)).t)
}

/// The edges of a joint, and the joint.
fn bending(x: &[f64]) -> (Edge, Edge, Joint) {
    (Edge::new(node(x, 0)), Edge::new(node(x, 1)), Joint::new(BENDING, kappa(x), NATURAL))
}

fn bending_gradient(x: &[f64]) -> Vec<f64> {
    let (e, f, joint) = bending(x);
    let (e, f) = (elastic::force(&e, 0.0, &NO_JOINT, &joint), elastic::force(&f, 0.0, &joint, &NO_JOINT));
    vec![e.x, e.y, f.x, f.y]
}

#[test]
fn bending_gradient_and_every_block_of_its_hessian_are_those_of_its_energy() {
    assert_derivatives("bending gradient", 500, |dice| {
        let x = joint(dice);
        let energy = |x: &[f64]| vec![0.5 * BENDING * (kappa(x) - NATURAL).powi(2)];
        let scale = BENDING * bend::curvature_per_turning(kappa(&x));
        largest((DMatrix::from_row_slice(1, 4, &bending_gradient(&x)) - differences(energy, &x, 1e-4)).iter().copied())
            / scale
    });
    for (name, row, column) in [("ee", 0, 0), ("ef", 0, 2), ("ff", 2, 2)] {
        assert_derivatives(&format!("bending Hessian {name}"), 500, |dice| {
            let x = joint(dice);
            let (e, f, joint) = bending(&x);
            let block = match name {
                "ee" => elastic::stiffness(&e, 0.0, 0.0, [&NO_JOINT, &joint], 1.0),
                "ef" => elastic::coupling(&e, &f, &joint, 1.0),
                _ => elastic::stiffness(&f, 0.0, 0.0, [&joint, &NO_JOINT], 1.0),
            };
            let exact = DMatrix::from_row_slice(2, 2, &<[f64; 4]>::from(block));
            let found = differences(bending_gradient, &x, 1e-4);
            deviation(&exact, &found.view((row, column), (2, 2)).into_owned())
        });
    }
}

#[test]
fn turning_is_the_inverse_of_curvature() {
    for i in -300..=300 {
        let theta = f64::from(i) * 0.01;
        let e = Vector2::x();
        let kappa = bend::curvature(e, Vector2::new(theta.cos(), theta.sin()));
        // Measured: 4.5e-16, and 3.5e-12 for the slope.
        assert!((bend::turning(kappa) - theta).abs() < 1e-13, "{theta}");
        let slope =
            differences(|x| vec![2.0 * (0.5 * x[0]).tan()], &[theta], 1e-3 * (std::f64::consts::PI - theta.abs()));
        assert!((slope[0] / bend::curvature_per_turning(kappa) - 1.0).abs() < TOLERANCE, "{theta}");
    }
}

/// Scenes with a free, a clamped and a driven head, loads, flow and host inputs.
fn whole_scenes() -> Vec<(&'static str, Scene)> {
    let loads = ["loads.gravity_m_s2=[0.3,-9.8]", "medium.flow_m_s=[0.4,-0.2]"];
    let with = |more: &[&str]| scene_of(SOFT, &[&loads, more].concat());
    vec![
        ("free", with(&[])),
        ("clamped", with(&["head.kind=clamped"])),
        (
            "driven",
            with(&["head.kind=driven", "head.position_m=[0.2,{amplitude=0.3,frequency_hz=1.0}]", "head.angle_rad=0.7"]),
        ),
    ]
}

const TURNING: &str = "head.angle_rad={amplitude=0.5,frequency_hz=1.0}";

/// Damped materials.
fn damped_scenes() -> Vec<(&'static str, Scene)> {
    vec![
        ("damped, free", scene_of(SOFT, &["rod.damping_time_s={stretch=1e-3,bending=0.02}"])),
        ("damped, turning", scene_of(SOFT, &["rod.damping_time_s=0.02", "head.kind=driven", TURNING])),
        (
            "elastically damped, clamped",
            scene_of(SOFT, &["rod.damping_time_s=0.02", "rod.damping_of=elastic", "head.kind=clamped"]),
        ),
    ]
}

/// A random state of `model` at a random time, of a joint less than 2 rad; a held head is where it must be.
fn whole_case(model: &Arc<Model>, dice: &mut Dice) -> (Dynamics, State) {
    let nodes = model.rod.nodes;
    let mut dynamics = Dynamics::new(Arc::clone(model));
    dynamics.inputs.natural = Some(dice.many(nodes, -5.0, 5.0));
    dynamics.inputs.force = Some(dice.many(2 * nodes, -3.0, 3.0));
    let mut state = State {
        t: 0.0,
        q: dice.chain(nodes, model.rod.spacing),
        v: dice.many(2 * nodes, -1.0, 1.0),
        a: dice.many(2 * nodes, -10.0, 10.0),
        ..State::default()
    };
    dynamics.move_to(dice.between(0.0, 2.0), &mut state);
    // A held head moves node 0; the rest goes with it, turned so that the first joint is no fold.
    if let Some([x, y, angle]) = dynamics.held {
        let first = node(&state.q, 2) - node(&state.q, 1);
        let turn = nalgebra::Rotation2::new(angle.value - first.y.atan2(first.x) + dice.between(-1.0, 1.0));
        let (old, new) = (node(&state.q, 1), Vector2::new(x.value, y.value) + turn * first);
        for k in (1..nodes).rev() {
            let moved = new + turn * (node(&state.q, k) - old);
            state.q[2 * k..2 * k + 2].copy_from_slice(moved.as_slice());
        }
    }
    (dynamics, state)
}

fn residual(dynamics: &mut Dynamics, state: &State) -> Vec<f64> {
    let mut residual = vec![0.0; state.q.len()];
    dynamics.assemble(state, &mut residual, None).unwrap();
    residual
}

#[test]
fn the_assembled_jacobian_is_that_of_the_residual_along_every_direction_for_every_head() {
    for (name, scene) in whole_scenes().into_iter().chain(damped_scenes()) {
        let model = Arc::new(scene.model().unwrap());
        let unknowns = 2 * model.rod.nodes;
        assert_derivatives(&format!("assembled, {name} head"), 60, |dice| {
            let (mut dynamics, state) = whole_case(&model, dice);
            // Each part alone in turn, then a mixture in which all are of like size.
            let direction = match dice.between(0.0, 4.0) as u32 {
                0 => Direction { q: 1.0, v: 0.0, a: 0.0 },
                1 => Direction { q: 0.0, v: 1.0, a: 0.0 },
                2 => Direction { q: 0.0, v: 0.0, a: 1.0 },
                _ => {
                    let mut around = |size: f64| size * dice.between(0.5, 2.0);
                    Direction { q: around(1e-5), v: around(1e-2), a: around(1.0) }
                }
            };
            let mut matrix = BandMatrix::new(model.rod.nodes);
            let mut scratch = vec![0.0; unknowns];
            let linearisation = Linearisation { matrix: &mut matrix, direction };
            dynamics.assemble(&state, &mut scratch, Some(linearisation)).unwrap();
            let exact = DMatrix::from_fn(unknowns, unknowns, |i, j| matrix.entry(i, j));
            let dynamics = std::cell::RefCell::new(dynamics);
            let along = |delta: &[f64]| {
                let mut moved = state.clone();
                for (i, d) in delta.iter().enumerate() {
                    moved.q[i] += direction.q * d;
                    moved.v[i] += direction.v * d;
                    moved.a[i] += direction.a * d;
                }
                residual(&mut dynamics.borrow_mut(), &moved)
            };
            // One step in δ moves positions by 1e-4 m, or whatever else is moved by 1e-2.
            let step = if direction.q > 0.0 { 1e-4 / direction.q } else { 1e-2 };
            let found = differences(along, &vec![0.0; unknowns], step);
            let fixed = if model.head.is_some() { 2 } else { 0 };
            for i in 0..fixed {
                for j in 0..unknowns {
                    let identity = f64::from(i == j);
                    assert_eq!((exact[(i, j)], exact[(j, i)]), (identity, identity), "a held node is prescribed");
                }
            }
            let rest = (unknowns - fixed, unknowns - fixed);
            deviation(&exact.view((fixed, fixed), rest).into_owned(), &found.view((fixed, fixed), rest).into_owned())
        });
    }
}

#[test]
fn the_elastic_forces_are_the_gradient_of_the_energies_that_are_reported() {
    for (name, scene) in whole_scenes() {
        let mut model = scene.model().unwrap();
        (model.forces, model.load) = (Default::default(), None);
        let model = Arc::new(model);
        assert_derivatives(&format!("energy, {name} head"), 40, |dice| {
            let (mut dynamics, mut state) = whole_case(&model, dice);
            dynamics.inputs.force = None;
            state.v.fill(0.0);
            state.a.fill(0.0);
            let mut exact = vec![0.0; state.q.len()];
            dynamics.unconstrained(&state, &mut exact, None).unwrap();
            let dynamics = std::cell::RefCell::new(dynamics);
            let energy = |q: &[f64]| {
                let moved = State { q: q.to_vec(), ..state.clone() };
                let mut reading = Measurements::new(model.rod.nodes);
                reading.measure(&mut dynamics.borrow_mut(), &moved).unwrap();
                vec![reading.energy.total()]
            };
            deviation(&DMatrix::from_row_slice(1, exact.len(), &exact), &differences(energy, &state.q, 1e-4))
        });
    }
}
