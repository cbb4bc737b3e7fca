//! Physics knows no place, no direction and no speed: a rod that is moved, turned or mirrored with all that acts on it moves,
//! turned or mirrored, as it did before, and a flow is nothing but a frame that moves. True of every drag law and of the
//! reactive force.

use crate::common;
use std::sync::Arc;

use caudal::fluid::laws::LAWS;
use caudal::head::{HeadMotion, Signal};
use caudal::linear::BandMatrix;
use caudal::linear::Direction;
use caudal::metrics::Measurements;
use caudal::model::Dynamics;
use caudal::newton::Newton;
use caudal::rod::node;
use caudal::scene::{HeadKind, Scene};
use caudal::system::{Linearisation, State, System};
use common::{Dice, SOFT, largest, scene_of, time_step};
use nalgebra::{DMatrix, Matrix2, Vector2};
use proptest::prelude::*;

/// x → turn·x + shift; a mirror where the determinant is −1.
#[derive(Debug, Clone, Copy)]
struct Placement {
    turn: Matrix2<f64>,
    shift: Vector2<f64>,
}

impl Placement {
    /// Mirrored across the x axis where `mirrored`, then turned by `angle`, then moved.
    fn new(angle: f64, mirrored: bool, shift: [f64; 2]) -> Self {
        let (sin, cos) = angle.sin_cos();
        let flip = if mirrored { -1.0 } else { 1.0 };
        Self { turn: Matrix2::new(cos, -sin * flip, sin, cos * flip), shift: Vector2::from(shift) }
    }

    /// −1 for a mirror: turnings, curvatures and angles change sign.
    fn sign(&self) -> f64 {
        self.turn.determinant().signum()
    }

    fn vectors(&self, values: &[f64], shift: Vector2<f64>) -> Vec<f64> {
        (0..values.len() / 2).flat_map(|k| <[f64; 2]>::from(self.turn * node(values, k) + shift)).collect()
    }

    fn state(&self, state: &State) -> State {
        let still = Vector2::zeros();
        State {
            t: state.t,
            q: self.vectors(&state.q, self.shift),
            v: self.vectors(&state.v, still),
            a: self.vectors(&state.a, still),
            ..State::default()
        }
    }

    fn head(&self, motion: &HeadMotion) -> HeadMotion {
        let [x, y, angle] = motion.each_ref().map(|signal| signal.at(0.0).value);
        let at = self.turn * Vector2::new(x, y) + self.shift;
        let along = self.turn * Vector2::new(angle.cos(), angle.sin());
        [at.x, at.y, along.y.atan2(along.x)].map(Signal::Constant)
    }

    /// The scene's model with everything in it moved along, and a host's inputs that `dice` gives.
    fn dynamics(&self, scene: &Scene, mut dice: Dice) -> Dynamics {
        let mut model = scene.model().unwrap();
        let nodes = model.rod.nodes;
        model.head = model.head.as_ref().map(|motion| self.head(motion));
        model.load = model.load.as_ref().map(|load| self.vectors(load, Vector2::zeros()));
        model.buoyancy = model.buoyancy.as_ref().map(|force| self.vectors(force, Vector2::zeros()));
        if let Some(layers) = &mut model.layers {
            layers.normal = self.turn * layers.normal;
            layers.shear *= self.sign();
            let raised = layers.normal.dot(&self.shift);
            for layer in layers.iter_mut() {
                layer.offset += raised;
                layer.fluid.flow = self.turn * layer.fluid.flow;
            }
            // The flow of the sheared layers is what it was where it was.
            model.fluid.flow -= self.turn.transpose() * layers.along() * (layers.shear * raised);
        }
        let mut dynamics = Dynamics::new(Arc::new(model));
        dynamics.inputs.drive.amplitude *= self.sign();
        dynamics.inputs.fluid.flow = self.turn * dynamics.inputs.fluid.flow;
        dynamics.inputs.fluid.acceleration = self.turn * Vector2::new(0.6, -0.3);
        dynamics.inputs.force = Some(self.vectors(&dice.many(2 * nodes, -0.5, 0.5), Vector2::zeros()));
        dynamics.inputs.natural = Some(dice.many(nodes, -1.0, 1.0).iter().map(|x| x * self.sign()).collect());
        dynamics
    }
}

fn scenes() -> Vec<Scene> {
    let with = |more: &[&str]| {
        scene_of(SOFT, &[&["loads.gravity_m_s2=[0.3,-9.8]", "medium.flow_m_s=[0.4,-0.2]"], more].concat())
    };
    let mut scenes = vec![
        with(&[]),
        with(&["head.kind=driven", "head.position_m=[0.2,-0.1]", "head.angle_rad=0.7"]),
        with(&["solver.integrator=newmark", "drag.ratio=1.5", "rod.nodes=6"]),
    ];
    // A body before the rod, in a fluid that it accelerates or not.
    let body = "head_body={ semi_axis_along_m = 0.2, semi_axis_across_m = 0.1, form_drag_along = 0.3, form_drag_across = 1.2 }";
    scenes.push(with(&[body]));
    scenes.push(with(&[body, "reactive.shedding=0.8", "loads.buoyancy=true"]));
    // Across the interfaces of three fluids, with what the rod accelerates, and in a flow that is different in each and sheared.
    let layer = |offset: f64, more: &str| {
        format!("{{ offset_m = {offset}, thickness_m = 0.3, viscosity_pa_s = 0.4, density_kg_m3 = 300.0, {more} }}")
    };
    let [first, second] = ["normal = [1.0, 2.0]", ""].map(|more| layer(if more.is_empty() { 0.5 } else { 0.1 }, more));
    let (moving, layers) = (layer(0.5, "flow_m_s = [0.6, -0.3]"), format!("medium.layers=[{first}, {second}]"));
    let sheared = format!("medium.layers=[{first}, {moving}]");
    let bare = SOFT.replace("ratio = 5.0\n", "");
    scenes.push(scene_of(
        &bare,
        &["medium.flow_m_s=[0.4,-0.2]", &layers, "drag.law=cross-flow", "reactive.shedding=0.8"],
    ));
    scenes.push(scene_of(
        &bare,
        &["medium.flow_m_s=[0.4,-0.2]", &sheared, "medium.shear.rate_per_s=0.5", "head.kind=clamped"],
    ));
    // Every law with all that it needs, in water that the rod accelerates, its head free and held.
    let values = [
        ("ratio", "1.7"),
        ("slender_length_m", "2.5"),
        ("height_m", "0.15"),
        ("along_n_s_m2", "[[0, 3.0], [1, 4.0]]"),
        ("across_n_s_m2", "5.0"),
    ];
    for law in LAWS {
        let taken = values.iter().filter(|(key, _)| law.keys.contains(key));
        let mut changes: Vec<String> = taken.map(|(key, value)| format!("drag.{key}={value}")).collect();
        changes.push(format!("drag.law={}", law.name));
        changes.extend(law.is_nonlocal().then(|| "drag.head_weight=1.0".to_string()));
        let water = ["reactive.shedding=0.8", "rod.depth_m=[[0, 0.05], [1, 0.2]]", "loads.buoyancy=true"];
        let around = ["loads.gravity_m_s2=[0.3,-9.8]", "medium.flow_m_s=[0.4,-0.2]"];
        changes.extend(water.iter().chain(&around).map(ToString::to_string));
        for head in ["free", "clamped"] {
            let held = format!("head.kind={head}");
            let all: Vec<&str> = changes.iter().map(String::as_str).chain([held.as_str()]).collect();
            scenes.push(scene_of(&bare, &all));
        }
    }
    scenes
}

/// A bent, stretched and moving rod: one of the right form for `dynamics`, at time `t`.
fn state(dynamics: &mut Dynamics, dice: &mut Dice, t: f64) -> State {
    let model = Arc::clone(&dynamics.model);
    let rod = &model.rod;
    let nodes = rod.nodes;
    let mut state = State::zeros(2 * nodes);
    dynamics.move_to(t, &mut state);
    let mut angle = dynamics.held.map_or_else(|| dice.between(-3.0, 3.0), |[_, _, angle]| angle.value);
    let mut x = node(&state.q, 0);
    for k in 1..nodes {
        angle += dice.between(-0.4, 0.4);
        let rest = rod.arc_length(k) - rod.arc_length(k - 1);
        x += Vector2::new(angle.cos(), angle.sin()) * (rest * dice.between(0.98, 1.02));
        state.q[2 * k..2 * k + 2].copy_from_slice(x.as_slice());
    }
    state.v = dice.many(2 * nodes, -0.2, 0.2);
    state.a = dice.many(2 * nodes, -1.0, 1.0);
    dynamics.move_to(t, &mut state);
    state
}

struct Assembly {
    residual: Vec<f64>,
    jacobian: DMatrix<f64>,
    reading: Measurements,
}

fn assemble(dynamics: &mut Dynamics, state: &State) -> Assembly {
    let n = state.q.len();
    let mut residual = vec![0.0; n];
    let mut matrix = BandMatrix::new(n / 2);
    let linearisation = Linearisation { matrix: &mut matrix, direction: Direction { q: 1e-4, v: 1e-2, a: 1.0 } };
    dynamics.unconstrained(state, &mut residual, Some(linearisation)).unwrap();
    let mut reading = Measurements::new(n / 2);
    reading.measure(dynamics, state).unwrap();
    Assembly { residual, jacobian: DMatrix::from_fn(n, n, |i, j| matrix.entry(i, j)), reading }
}

fn steps(dynamics: &mut Dynamics, scene: &Scene, mut from: State, count: usize) -> State {
    let mut integrator = scene.integrator().unwrap();
    integrator.begin(&mut from);
    let mut newton = Newton::new(dynamics.nodes(), 1e-13).unwrap();
    let h = time_step(scene);
    let start = from.t;
    let mut to = from.clone();
    for k in 1..=count {
        to.t = start + k as f64 * h;
        integrator.step(dynamics, &mut newton, &from, h, &mut to).unwrap();
        std::mem::swap(&mut from, &mut to);
    }
    from
}

fn difference(a: &[f64], b: &[f64]) -> f64 {
    largest(a.iter().zip(b).map(|(a, b)| a - b))
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(100) })]

    #[test]
    fn forces_matrix_energies_and_powers_move_turn_and_mirror_with_the_rod(
        seed in any::<u64>(), angle in -3.1..3.1, mirrored in any::<bool>(), shift in [-3.0..3.0, -3.0..3.0], t in 0.0..2.0,
    ) {
        let placement = Placement::new(angle, mirrored, shift);
        let here = Placement::new(0.0, false, [0.0; 2]);
        for scene in scenes() {
            let mut one = here.dynamics(&scene, Dice(seed));
            let mut other = placement.dynamics(&scene, Dice(seed));
            let state = state(&mut one, &mut Dice(!seed), t);
            let mut moved = placement.state(&state);
            other.move_to(t, &mut moved);
            let (a, b) = (assemble(&mut one, &state), assemble(&mut other, &moved));
            // Forces are of some 1e3 N: EA strain. Rounding of positions of some metres is 4e-16 · EA/ΔL = 1e-11 N.
            let forces = difference(&placement.vectors(&a.residual, Vector2::zeros()), &b.residual);
            // Measured: at most 1.7e-11 N.
            prop_assert!(forces < 1e-10, "forces: {forces:e}");
            let n = state.q.len();
            let turn = DMatrix::from_fn(n, n, |i, j| if i / 2 == j / 2 { placement.turn[(i % 2, j % 2)] } else { 0.0 });
            let matrix = largest((&turn * &a.jacobian * turn.transpose() - &b.jacobian).iter().copied()) / a.jacobian.amax();
            // Measured: at most 4.2e-15.
            prop_assert!(matrix < 1e-14, "matrix: {matrix:e}");
            let numbers = |r: &Measurements| {
                let (e, p) = (r.energy, r.power);
                [e.stretching, e.bending, e.kinetic, p.actuation, p.viscous, p.load, p.head, p.flow]
            };
            let worst = difference(&numbers(&a.reading), &numbers(&b.reading));
            // Measured: at most 7.2e-13 J or W, of up to 1e2.
            prop_assert!(worst < 1e-11, "energies and powers: {worst:e}");
            let com = (placement.turn * a.reading.com + placement.shift - b.reading.com).norm();
            let force = (placement.turn * a.reading.head_force - b.reading.head_force).norm();
            // Measured: at most 1.5e-15 m and 8.2e-12 N.
            prop_assert!(com < 1e-14 && force < 1e-10, "{com:e} {force:e}");
            let moment = a.reading.head_moment * placement.sign() - b.reading.head_moment;
            let kappa = largest(a.reading.kappa.iter().zip(&b.reading.kappa).map(|(a, b)| a * placement.sign() - b));
            // Measured: at most 9.2e-15 and 3.5e-13 N m.
            prop_assert!(kappa < 1e-13 && moment.abs() < 5e-12, "curvature: {kappa:e}, moment: {moment:e}");
        }
    }

    #[test]
    fn steps_move_turn_and_mirror_with_the_rod(
        seed in any::<u64>(), angle in -3.1..3.1, mirrored in any::<bool>(), shift in [-3.0..3.0, -3.0..3.0], t in 0.0..2.0,
    ) {
        let placement = Placement::new(angle, mirrored, shift);
        let here = Placement::new(0.0, false, [0.0; 2]);
        for scene in scenes() {
            let mut one = here.dynamics(&scene, Dice(seed));
            let mut other = placement.dynamics(&scene, Dice(seed));
            let state = state(&mut one, &mut Dice(!seed), t);
            let moved = placement.state(&state);
            let a = placement.state(&steps(&mut one, &scene, state, 10));
            let b = steps(&mut other, &scene, moved, 10);
            let (positions, velocities) = (difference(&a.q, &b.q), difference(&a.v, &b.v));
            // Measured: at most 3.6e-15 m and 2.5e-13 m/s.
            prop_assert!(positions < 1e-13, "positions: {positions:e}");
            prop_assert!(velocities < 1e-11, "velocities: {velocities:e}");
        }
    }
}

#[test]
fn a_flow_is_a_frame_that_moves() {
    let here = Placement::new(0.0, false, [0.0; 2]);
    for (i, scene) in scenes().iter().enumerate().filter(|(_, scene)| scene.head.kind == HeadKind::Free) {
        let mut one = here.dynamics(scene, Dice(7));
        let mut other = here.dynamics(scene, Dice(7));
        let flow = std::mem::take(&mut other.inputs.fluid.flow);
        let state = state(&mut one, &mut Dice(i as u64), 0.3);
        let mut still = state.clone();
        still.v.as_chunks_mut().0.iter_mut().for_each(|v| *v = (Vector2::from(*v) - flow).into());
        let a = steps(&mut one, scene, state, 10);
        let b = steps(&mut other, scene, still, 10);
        let moved = |values: &[f64], by: Vector2<f64>| here.vectors(values, by);
        let positions = difference(&moved(&b.q, flow * (b.t - 0.3)), &a.q);
        let velocities = difference(&moved(&b.v, flow), &a.v);
        // Measured: at most 4.4e-16 m and 2.7e-14 m/s.
        assert!(positions < 1e-13, "positions: {positions:e}");
        assert!(velocities < 1e-11, "velocities: {velocities:e}");
        // Measured without the flow that the frame moves with: at least 2e-3 m.
        assert!(difference(&b.q, &a.q) > 1e-3);
    }
}

#[test]
fn a_mirror_that_leaves_the_actuation_as_it_is_would_be_noticed() {
    let scene = &scenes()[0];
    let placement = Placement::new(0.4, true, [1.0, 2.0]);
    let mut one = Placement::new(0.0, false, [0.0; 2]).dynamics(scene, Dice(1));
    let mut other = placement.dynamics(scene, Dice(1));
    other.inputs.drive.amplitude *= -1.0;
    let state = state(&mut one, &mut Dice(2), 0.3);
    let moved = placement.state(&state);
    let a = placement.state(&steps(&mut one, scene, state, 10));
    let b = steps(&mut other, scene, moved, 10);
    // Measured: 1.8e-2 m.
    assert!(difference(&a.q, &b.q) > 1e-4, "{:e}", difference(&a.q, &b.q));
}
