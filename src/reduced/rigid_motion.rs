//! Rigid-body dynamics of a chain with prescribed curvatures.
//!
//! The unknowns are the centre of mass X, its velocity V, the direction φ of the first edge, and the angular momentum Λ about X:
//! X' = V, M V' = F, Λ' = N, with force F and moment N of drag and loads, and φ' = (Λ − Λ_s)/I, where Λ_s is the angular momentum
//! due to the change of shape at φ' = 0 and I the moment of inertia.
//!
//! If the rod accelerates the fluid, V and Λ stand for the momenta of both, P/M and Λ about X. Both are linear in the rigid
//! motion, with the derivatives of the energy with respect to the velocities as momenta of the nodes, so X' and φ' follow from
//! three equations. The energy does not depend on the position and orientation of the rod, so P' = F and Λ' = N − (X' − u) × P_f,
//! with non-inertial forces only, the flow u and the momentum P_f of the fluid; the last term is Munk's moment. Without inertia
//! X' and φ' are those at which F = 0 and N = 0.

use nalgebra::{Matrix3, Vector2, Vector3};

use crate::fluid::force::StateDerivatives;
use crate::fluid::{Fluid, Kinematics};
use crate::head::Pose;
use crate::model::Dynamics;
use crate::rod::{Edge, Rod, bend, node};
use crate::system::State;

/// Number of coordinates of the rigid motion.
pub const RIGID_COORDINATES: usize = 6;

/// X, φ, V, Λ, or their rates.
pub type RigidMotion = [f64; RIGID_COORDINATES];

/// The direction of the start of a chain: unit vector, and first and second derivative of its angle.
type Base = (Vector2<f64>, f64, f64);

/// An inextensible chain, with work arrays for its motion.
#[derive(Debug, Default)]
pub struct RigidChain {
    /// Mass of the rod, kg.
    mass: f64,
    edges: Vec<Edge>,
    /// Positions, two entries per node, m.
    pub x: Vec<f64>,
    /// Velocities, m/s.
    pub v: Vec<f64>,
    /// Accelerations, m/s².
    pub a: Vec<f64>,
    /// Moment of inertia about the centre of mass, kg m².
    pub inertia: f64,
    /// Work arrays for velocities and forces.
    moving: Vec<f64>,
    force: Vec<f64>,
    /// Zero accelerations.
    still: Vec<f64>,
    /// Work arrays for the momenta of the fluid at the nodes, and for unused results.
    momentum: Vec<f64>,
    unused: [Vec<f64>; 2],
}

impl RigidChain {
    /// Allocates for the nodes of `rod`.
    pub fn new(rod: &Rod) -> Self {
        let zeros = || vec![0.0; 2 * rod.nodes];
        Self {
            mass: rod.total_mass(),
            edges: rod.cells.iter().map(|cell| Edge::along(Vector2::x(), cell.rest)).collect(),
            x: zeros(),
            v: zeros(),
            a: zeros(),
            inertia: 0.0,
            moving: zeros(),
            force: zeros(),
            still: zeros(),
            momentum: zeros(),
            unused: [zeros(), zeros()],
        }
    }

    /// Momentum (N s) of the fluid, and its moment about the origin, for the centred chain that moves with `own` times its own
    /// motion plus a rigid `motion` with velocity x, y and spin.
    fn of_fluid(&mut self, dynamics: &Dynamics, own: f64, motion: [f64; 3], flow: Vector2<f64>) -> Vector3<f64> {
        self.move_by(own, motion);
        let fluid = Fluid { flow, ..dynamics.inputs.fluid };
        let rod = Kinematics::within(fluid, &self.edges, [&self.x, &self.moving, &self.still]);
        momenta(dynamics, &rod, &mut self.momentum, &mut self.unused)
    }

    /// The inertia matrix of rod and fluid together for velocity x, y and angular velocity.
    fn inertias(&mut self, dynamics: &Dynamics) -> Matrix3<f64> {
        let units = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let columns = units.map(|unit| self.of_fluid(dynamics, 0.0, unit, Vector2::zeros()));
        Matrix3::from_diagonal(&Vector3::new(self.mass, self.mass, self.inertia)) + Matrix3::from_columns(&columns)
    }

    /// Added mass (kg) of the rod for motion across itself.
    pub fn added_mass(&mut self, dynamics: &Dynamics) -> f64 {
        if !dynamics.model.forces.are_inertial() {
            return 0.0;
        }
        let inertias = self.inertias(dynamics);
        inertias[(0, 0)] + inertias[(1, 1)] - 2.0 * self.mass
    }

    /// Places the nodes of a chain with curvatures κ, their rates and, optionally, second rates, from node 0 at rest at the
    /// origin. Returns the means of positions, velocities and accelerations.
    fn place_nodes<const ACCELERATIONS: bool>(
        &mut self,
        rod: &Rod,
        [kappa, rate, second]: [&[f64]; 3],
        base: Base,
    ) -> [Vector2<f64>; 3] {
        let (mut t, mut spin, mut twist) = base;
        let mut here = [Vector2::zeros(); 3];
        let mut mean = [Vector2::zeros(); 3];
        let nodes = rod.nodes;
        let (kappa, rate) = (&kappa[..nodes], &rate[..nodes]);
        let [x, v, a] = [&mut self.x, &mut self.v, &mut self.a].map(|values| values.as_chunks_mut::<2>().0);
        (x[0], v[0], a[0]) = ([0.0; 2], [0.0; 2], [0.0; 2]);
        let rows = x[1..].iter_mut().zip(&mut v[1..]).zip(&mut a[1..]).zip(&mut self.edges).zip(&rod.mass[1..]);
        for (e, ((((x, v), a), edge), mass)) in rows.enumerate() {
            if e >= rod.first_joint {
                let (kappa, rate) = (kappa[e], rate[e]);
                // cos θ = (1 − κ²/4)/s, sin θ = κ/s, θ' = κ'/s with s = 1 + κ²/4.
                let s = bend::curvature_per_turning(kappa);
                let per_s = 1.0 / s;
                let (cos, sin) = ((2.0 - s) * per_s, kappa * per_s);
                t = Vector2::new(t.x * cos - t.y * sin, t.x * sin + t.y * cos);
                spin += rate * per_s;
                if ACCELERATIONS {
                    twist += (second[e] - 0.5 * kappa * rate * rate * per_s) * per_s;
                }
            }
            let n = perpendicular(t);
            here[0] += t * edge.length;
            here[1] += n * (edge.length * spin);
            (*x, *v) = (here[0].into(), here[1].into());
            mean[0] += here[0] * *mass;
            mean[1] += here[1] * *mass;
            if ACCELERATIONS {
                here[2] += (n * twist - t * (spin * spin)) * edge.length;
                *a = here[2].into();
                mean[2] += here[2] * *mass;
            }
            edge.t = t;
        }
        mean.map(|sum| sum / self.mass)
    }

    /// Subtracts the means `x` and `v` from positions and velocities; returns the angular momentum about the centre, and stores
    /// the moment of inertia.
    fn centre(&mut self, rod: &Rod, [x, v, _]: [Vector2<f64>; 3]) -> f64 {
        let (mut inertia, mut momentum) = (0.0, 0.0);
        let rows = self.x.as_chunks_mut::<2>().0.iter_mut().zip(self.v.as_chunks_mut::<2>().0).zip(&rod.mass);
        for ((here, moving), m) in rows {
            let (r, w) = (Vector2::from(*here) - x, Vector2::from(*moving) - v);
            (*here, *moving) = (r.into(), w.into());
            inertia += m * r.norm_squared();
            momentum += m * r.perp(&w);
        }
        self.inertia = inertia;
        momentum
    }

    /// The rates of the rigid motion `rigid` with curvatures κ and their rates; inputs are taken from `dynamics`.
    pub fn rates(&mut self, dynamics: &Dynamics, [kappa, rate]: [&[f64]; 2], rigid: &RigidMotion) -> RigidMotion {
        let &[_, _, angle, vx, vy, momentum] = rigid;
        let rod = &dynamics.model.rod;
        let means = self.place_nodes::<false>(rod, [kappa, rate, &[]], (direction(angle), 0.0, 0.0));
        let of_shape = self.centre(rod, means);
        if dynamics.model.forces.are_inertial() {
            let flow = dynamics.inputs.fluid.flow;
            let of_fluid = self.of_fluid(dynamics, 1.0, [0.0; 3], flow);
            let inertias = self.inertias(dynamics);
            let left = Vector3::new(self.mass * vx, self.mass * vy, momentum - of_shape) - of_fluid;
            let Some(motion) = inertias.lu().solve(&left) else { return [f64::NAN; RIGID_COORDINATES] };
            let [fx, fy, moment] = self.applied(dynamics, motion.into());
            let velocity = motion.xy();
            let munk = (velocity - flow).perp(&(Vector2::new(vx, vy) * self.mass - velocity * self.mass));
            return [motion.x, motion.y, motion.z, fx / self.mass, fy / self.mass, moment - munk];
        }
        let spin = (momentum - of_shape) / self.inertia;
        let [fx, fy, moment] = self.applied(dynamics, [vx, vy, spin]);
        [vx, vy, spin, fx / self.mass, fy / self.mass, moment]
    }

    /// The same without inertia; V and Λ are unused.
    pub fn rates_without_inertia(
        &mut self,
        dynamics: &Dynamics,
        [kappa, rate]: [&[f64]; 2],
        rigid: &RigidMotion,
    ) -> RigidMotion {
        /// The largest number of Newton iterations. One is exact for drag linear in velocity.
        const ITERATIONS: u32 = 30;
        /// Increments below this fraction of a typical speed are rounding, because derivatives are finite differences.
        const CONVERGED: f64 = 1e-13;
        let rod = &dynamics.model.rod;
        let means = self.place_nodes::<false>(rod, [kappa, rate, &[]], (direction(rigid[2]), 0.0, 0.0));
        self.centre(rod, means);
        let mut motion = Vector3::zeros();
        let speed = self.typical_speed(dynamics);
        // Finite differences over speeds of that size.
        let scale = [speed, speed, speed / rod.length];
        for _ in 0..ITERATIONS {
            let here = Vector3::from(self.applied(dynamics, motion.into()));
            let columns = [0, 1, 2].map(|i| {
                let mut moved = motion;
                moved[i] += scale[i];
                (Vector3::from(self.applied(dynamics, moved.into())) - here) / scale[i]
            });
            let Some(inverse) = Matrix3::from_columns(&columns).try_inverse() else {
                return [f64::NAN; RIGID_COORDINATES];
            };
            let increment = inverse * here;
            motion -= increment;
            if increment.component_div(&Vector3::from(scale)).amax() < CONVERGED {
                break;
            }
        }
        [motion.x, motion.y, motion.z, 0.0, 0.0, 0.0]
    }

    /// The larger of the speed of the shape change (m/s) and the speed at which drag balances the applied forces; if both are
    /// zero, a speed of the rod.
    fn typical_speed(&mut self, dynamics: &Dynamics) -> f64 {
        let rod = &dynamics.model.rod;
        let own = self.v.iter().fold(0.0_f64, |max, v| max.max(v.abs()));
        if own > 0.0 && !dynamics.is_loaded() {
            return own;
        }
        let probe = rod.length / rod.bending_time();
        let [here, moved] = [0.0, probe].map(|speed| Vector3::from(self.applied(dynamics, [speed, 0.0, 0.0])));
        let pull = here.xy().norm().max(here.z.abs() / rod.length);
        let drift = pull * probe / (moved - here).xy().norm();
        if drift.is_finite() && own.max(drift) > 0.0 { own.max(drift) } else { own.max(probe) }
    }

    /// Writes the velocities of the centred chain that moves with `own` times its own motion plus a rigid motion with velocity x,
    /// y and spin.
    fn move_by(&mut self, own: f64, [vx, vy, spin]: [f64; 3]) {
        let rows = self.moving.as_chunks_mut::<2>().0.iter_mut().zip(self.x.as_chunks::<2>().0);
        for ((moving, x), v) in rows.zip(self.v.as_chunks::<2>().0) {
            *moving = [own * v[0] + vx - spin * x[1], own * v[1] + vy + spin * x[0]];
        }
    }

    /// Force (N) and moment about the centre of mass (N m) of drag and loads on the centred chain that moves with its own motion
    /// plus a rigid `motion` with velocity x, y and spin.
    fn applied(&mut self, dynamics: &Dynamics, motion: [f64; 3]) -> [f64; 3] {
        if dynamics.model.forces.is_empty() && !dynamics.is_loaded() {
            return [0.0; 3];
        }
        self.move_by(1.0, motion);
        // The forces of a reduced model do not depend on the position; inertial forces are contained in the momenta.
        let rod = Kinematics::within(dynamics.inputs.fluid, &self.edges, [&self.x, &self.moving, &self.still]);
        dynamics.write_applied_without_inertia(&rod, &mut self.force);
        let (mut force, mut moment) = (Vector2::zeros(), 0.0);
        for (f, x) in self.force.as_chunks::<2>().0.iter().zip(self.x.as_chunks::<2>().0) {
            let f = Vector2::from(*f);
            force -= f;
            moment -= Vector2::from(*x).perp(&f);
        }
        [force.x, force.y, moment]
    }

    /// Writes the motion of the chain with curvatures κ, their rates and second rates, whose rigid motion is `rigid` with the
    /// rates `rates`.
    pub fn place(&mut self, dynamics: &Dynamics, natural: [&[f64]; 3], rigid: &RigidMotion, rates: &RigidMotion) {
        let rod = &dynamics.model.rod;
        let &[x, y, angle, ..] = rigid;
        let &[vx, vy, spin, mut ax, mut ay, moment] = rates;
        let means = self.place_nodes::<true>(rod, natural, (direction(angle), spin, 0.0));
        self.centre(rod, means);
        let [_, _, mean] = means;
        let mut change = 0.0;
        for (k, m) in rod.mass.iter().enumerate() {
            let a = node(&self.a, k) - mean;
            put(&mut self.a, k, a);
            change += m * node(&self.x, k).perp(&a);
        }
        let mut twist = (moment - change) / self.inertia;
        if dynamics.model.forces.are_inertial() {
            // M a + F(a) = 0 in total, linear in the rigid part of a with the same inertias.
            self.move_by(1.0, [vx, vy, 0.0]);
            let moving = Kinematics::within(dynamics.inputs.fluid, &self.edges, [&self.x, &self.moving, &self.a]);
            dynamics.write_applied(&moving, &mut self.force);
            let mut left = Vector3::new(0.0, 0.0, change);
            for k in 0..rod.nodes {
                let force = node(&self.force, k);
                left += Vector3::new(force.x, force.y, node(&self.x, k).perp(&force));
            }
            let inertias = self.inertias(dynamics);
            let rigid = inertias.lu().solve(&-left).unwrap_or(Vector3::repeat(f64::NAN));
            (ax, ay, twist) = (rigid.x, rigid.y, rigid.z);
        }
        for k in 0..rod.nodes {
            let r = node(&self.x, k);
            let a = node(&self.a, k) + Vector2::new(ax, ay) + perpendicular(r) * twist;
            let v = node(&self.v, k) + Vector2::new(vx, vy);
            put(&mut self.x, k, r + Vector2::new(x, y));
            put(&mut self.v, k, v);
            put(&mut self.a, k, a);
        }
    }

    /// Writes the motion of the chain on a held head.
    pub fn place_on_head(&mut self, rod: &Rod, natural: [&[f64]; 3], [x, y, angle]: &Pose) {
        self.place_nodes::<true>(rod, natural, (direction(angle.value), angle.rate, angle.acceleration));
        for (of_head, values) in [
            (Vector2::new(x.value, y.value), &mut self.x),
            (Vector2::new(x.rate, y.rate), &mut self.v),
            (Vector2::new(x.acceleration, y.acceleration), &mut self.a),
        ] {
            for k in 0..rod.nodes {
                let value = node(values, k) + of_head;
                put(values, k, value);
            }
        }
    }

    /// The rigid motion for which the chain with curvatures κ fits `state` best, with the centre of mass and the momenta of
    /// `state`.
    pub fn fit_state(&mut self, dynamics: &Dynamics, [kappa, rate]: [&[f64]; 2], state: &State) -> RigidMotion {
        let rod = &dynamics.model.rod;
        let means = self.place_nodes::<false>(rod, [kappa, rate, &[]], (Vector2::x(), 0.0, 0.0));
        self.centre(rod, means);
        let (x, v) = (rod.mean(&state.q), rod.mean(&state.v));
        let (mut cross, mut dot, mut momentum) = (0.0, 0.0, 0.0);
        for (k, m) in rod.mass.iter().enumerate() {
            let (p, r, w) = (node(&self.x, k), node(&state.q, k) - x, node(&state.v, k) - v);
            cross += m * p.perp(&r);
            dot += m * p.dot(&r);
            momentum += m * r.perp(&w);
        }
        let mut given = v;
        if dynamics.model.forces.are_inertial() {
            let edges: Vec<Edge> =
                (0..rod.nodes - 1).map(|k| Edge::new(node(&state.q, k + 1) - node(&state.q, k))).collect();
            let of_motion = [&state.q[..], &state.v, &self.still];
            let moving = Kinematics { t: state.t, ..Kinematics::within(dynamics.inputs.fluid, &edges, of_motion) };
            let of_fluid = momenta(dynamics, &moving, &mut self.momentum, &mut self.unused);
            given += of_fluid.xy() / self.mass;
            momentum += of_fluid.z - x.perp(&of_fluid.xy());
        }
        [x.x, x.y, cross.atan2(dot), given.x, given.y, momentum]
    }
}

/// Momentum (N s) of the fluid that `rod` accelerates, and its moment about the origin.
fn momenta(dynamics: &Dynamics, rod: &Kinematics<'_>, v: &mut [f64], [q, a]: &mut [Vec<f64>; 2]) -> Vector3<f64> {
    v.fill(0.0);
    for force in dynamics.model.forces.iter().filter(|force| force.is_inertial()) {
        force.energy(rod, 1.0, Some(StateDerivatives { q, v, a }));
    }
    let mut sum = Vector3::zeros();
    for k in 0..rod.edges.len() + 1 {
        let own = node(v, k);
        sum += Vector3::new(own.x, own.y, node(rod.q, k).perp(&own));
    }
    sum
}

fn direction(angle: f64) -> Vector2<f64> {
    let (sin, cos) = angle.sin_cos();
    Vector2::new(cos, sin)
}

/// The vector rotated by +90°.
fn perpendicular(v: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-v.y, v.x)
}

fn put(values: &mut [f64], k: usize, vector: Vector2<f64>) {
    values[2 * k..2 * k + 2].copy_from_slice(vector.as_slice());
}
