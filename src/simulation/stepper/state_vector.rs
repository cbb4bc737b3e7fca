//! The state as one vector, for estimators, controllers and the derivatives of a step.

use super::Stepper;
use crate::error::{Error, Result};
use crate::metrics::WorkSource;
use crate::system::{State, System};

/// The coordinates of the state with respect to which a step is differentiated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StateCoordinates {
    /// Positions and velocities. Accelerations follow from them by the equation of motion, and a method's memory of earlier
    /// accelerations changes with them.
    #[default]
    Motion,
    /// All quantities of the motion in a snapshot: also accelerations, and a method's memory of earlier ones.
    Full,
}

/// One number of a state, an input or an output: an entry of a variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// Name of the variable.
    pub variable: &'static str,
    /// Which of its entries, if it has several: the number of a node, for most.
    pub index: Option<usize>,
    /// Unit.
    pub unit: &'static str,
}

impl Entry {
    /// Name of the variable, with the number of the entry in brackets if it has several.
    pub fn name(&self) -> String {
        self.index.map_or_else(|| self.variable.to_string(), |k| format!("{}[{k}]", self.variable))
    }
}

/// One number of a state: which of its vectors, and the index in that vector.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Coordinate {
    part: usize,
    index: usize,
    /// Scale factor: the length of the rod for the angle of a hinge, whose unknown is an arc length.
    scale: f64,
}

/// For each vector of a state: the names of a node's entries, their unit, and the names of the entries of a hinge.
const PARTS: [([&str; 2], &str, [&str; 2]); 4] = [
    (["x_m", "y_m"], "m", ["hinge_angle_rad", "rad"]),
    (["vx_m_s", "vy_m_s"], "m/s", ["hinge_spin_rad_s", "rad/s"]),
    (["ax_m_s2", "ay_m_s2"], "m/s2", ["hinge_angular_acceleration_rad_s2", "rad/s2"]),
    (["remembered_ax_m_s2", "remembered_ay_m_s2"], "m/s2", ["remembered_hinge_acceleration_rad_s2", "rad/s2"]),
];

impl Coordinate {
    pub(crate) fn of(self, state: &State) -> f64 {
        let State { q, v, a, memory, .. } = state;
        [q, v, a, memory][self.part][self.index] / self.scale
    }

    /// The row of this number in `width` states stored side by side, and what its entries are divided by.
    pub(crate) fn row_of_many(self, states: &State, width: usize) -> (&[f64], f64) {
        let State { q, v, a, memory, .. } = states;
        (&[q, v, a, memory][self.part][self.index * width..][..width], self.scale)
    }

    /// Sets it in column `j` of `width` states stored side by side.
    pub(crate) fn set_of_many(self, states: &mut State, j: usize, width: usize, value: f64) {
        Self { index: self.index * width + j, ..self }.set(states, value);
    }

    fn set(self, state: &mut State, value: f64) {
        let State { q, v, a, memory, .. } = state;
        [q, v, a, memory][self.part][self.index] = value * self.scale;
    }
}

impl Stepper {
    /// The coordinates of a state, without those of a held node.
    pub(crate) fn coordinates(&self, coordinates: StateCoordinates) -> Vec<Coordinate> {
        let State { q, memory, .. } = self.state();
        let (rod, first) = (&self.model().rod, if self.model().head.is_some() { 2 } else { 0 });
        let parts = match coordinates {
            StateCoordinates::Motion => 2,
            StateCoordinates::Full if memory.is_empty() => 3,
            StateCoordinates::Full => 4,
        };
        let scale = |index: usize| if index < 2 * rod.nodes { 1.0 } else { rod.length };
        let part = |part: usize| (first..q.len()).map(move |index| Coordinate { part, index, scale: scale(index) });
        (0..parts).flat_map(part).collect()
    }

    /// The names of the numbers in the state, in the order of [`motion`](Self::motion): first all positions, node by node, then
    /// all velocities.
    pub fn state_entries(&self, coordinates: StateCoordinates) -> Vec<Entry> {
        let nodes = self.model().rod.nodes;
        let entry = |Coordinate { part, index, .. }: Coordinate| {
            let (names, unit, [hinge, hinge_unit]) = PARTS[part];
            match (index / 2, index % 2) {
                (node, axis) if node < nodes => Entry { variable: names[axis], index: Some(node), unit },
                _ => Entry { variable: hinge, index: None, unit: hinge_unit },
            }
        };
        self.coordinates(coordinates).into_iter().map(entry).collect()
    }

    /// Positions and velocities of the nodes that are not held, and of a hinge, in the order of
    /// [`state_entries`](Self::state_entries).
    pub fn motion(&self) -> Vec<f64> {
        self.coordinates(StateCoordinates::Motion).into_iter().map(|coordinate| coordinate.of(self.state())).collect()
    }

    /// Sets positions and velocities in the order of [`motion`](Self::motion), for example from an estimator or as the start of a
    /// prediction. A held head continues its motion. Accelerations follow from the equation of motion, as after a jump of inputs;
    /// the change of energy and momentum counts as work and impulse of loads. A jump of the flow that was set before acts with
    /// the next step, on this motion.
    ///
    /// # Errors
    /// [`Error::Derivative`] for a reduced model; [`Error::WrongLength`], [`Error::BadValue`]; errors of an invalid shape, such
    /// as an edge of zero length. On error nothing is changed.
    pub fn set_motion(&mut self, motion: &[f64]) -> Result<()> {
        if self.model_stepper.integrator().is_none() {
            let problem = "a reduced model finds its own motion; allowed: solver.model = \"full\"".to_string();
            return Err(Error::Derivative { problem });
        }
        let coordinates = self.coordinates(StateCoordinates::Motion);
        if motion.len() != coordinates.len() {
            return Err(Error::WrongLength { name: "motion", expected: coordinates.len(), found: motion.len() });
        }
        if let Some(value) = motion.iter().find(|x| !x.is_finite()) {
            return Err(Error::BadValue { name: "motion", value: *value, allowed: "finite numbers" });
        }
        self.forget_step();
        self.forget_last_step();
        let outcome = self.place_motion(&coordinates, motion);
        if outcome.is_err() {
            self.move_to_now()?;
        }
        outcome
    }

    fn place_motion(&mut self, coordinates: &[Coordinate], motion: &[f64]) -> Result<()> {
        let Self { dynamics, model_stepper, newton, now, next, measurements, .. } = self;
        let t = now.state.t;
        dynamics.move_to(t, &mut now.state);
        next.copy_from(&now.state);
        coordinates.iter().zip(motion).for_each(|(coordinate, value)| coordinate.set(next, *value));
        dynamics.move_to(t, next);
        dynamics.carry_links(&now.state, next);
        let work = newton.work;
        let consistent = model_stepper.reinitialise(dynamics, newton, next);
        newton.work = work;
        consistent?;
        measurements.measure(dynamics, next)?;
        std::mem::swap(&mut now.state, next);
        now.metrics.count_jump(measurements, WorkSource::Load);
        now.cycles.follow(dynamics, &now.state, &now.metrics, None);
        Ok(())
    }
}
