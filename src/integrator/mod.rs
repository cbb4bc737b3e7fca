//! Time integration: one method a file, with its order, stability and source as data.

mod implicit_euler;
mod newmark;

use crate::error::{Error, Result};
use crate::newton::Newton;
use crate::system::{Direction, State, System};

/// All methods; adding one is its file and its line here.
pub static METHODS: &[&Method] = &[&implicit_euler::METHOD, &newmark::METHOD];

/// What is known of a method, and how to make it.
#[derive(Debug)]
pub struct Method {
    /// Name in a scene.
    pub name: &'static str,
    /// Stability in words.
    pub stability: &'static str,
    /// Where it comes from.
    pub source: &'static str,
    /// Its parameters, each a key of a scene's `[solver]`.
    pub parameters: &'static [Parameter],
    /// The method with values for its parameters, in their order.
    pub build: fn(&[f64]) -> Box<dyn Integrator>,
}

/// A parameter of a method.
#[derive(Debug)]
pub struct Parameter {
    /// Key in a scene.
    pub name: &'static str,
    /// Value where the scene says nothing.
    pub default: f64,
    /// Smallest and largest value allowed.
    pub range: [f64; 2],
    /// The range in words.
    pub allowed: &'static str,
}

impl Method {
    /// The method of this name.
    pub fn named(name: &str) -> Option<&'static Self> {
        METHODS.iter().copied().find(|method| method.name == name)
    }

    /// The values of its parameters where a scene says nothing.
    pub fn defaults(&self) -> Vec<f64> {
        self.parameters.iter().map(|parameter| parameter.default).collect()
    }
}

/// A method with its parameters: makes one step.
pub trait Integrator: std::fmt::Debug + Send {
    /// Order of convergence in the step size.
    fn order(&self) -> u32;

    /// The step's rule for step size `h` (s).
    fn rule(&self, h: f64) -> Rule;

    /// Steps from `from` by `h` (s) to time `to.t`, which is set; the rest of `to` is written.
    ///
    /// # Errors
    /// Those of [`Newton::solve`] and [`System::check_step`].
    fn step(&self, system: &mut dyn System, newton: &mut Newton, from: &State, h: f64, to: &mut State) -> Result<()> {
        self.rule(h).step(system, newton, from, h, to)
    }
}

/// A method that asks for the equation of motion once, at the new time, with
/// q = q* + A a and v = v* + B a, where q* = qⁿ + h vⁿ + q_a aⁿ and v* = vⁿ + v_a aⁿ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rule {
    /// Weight q_a of the old acceleration in q*, s².
    pub q_old: f64,
    /// Weight v_a of the old acceleration in v*, s.
    pub v_old: f64,
    /// Weight A of the new acceleration in q, s².
    pub q_new: f64,
    /// Weight B of the new acceleration in v, s.
    pub v_new: f64,
}

/// Where Newton starts.
#[derive(Debug, Clone, Copy)]
enum Guess {
    /// The accelerations stay.
    Accelerations,
    /// The positions stay.
    Positions,
}

impl Guess {
    /// Which to try first: accelerations that change the velocities by more than this part of them in one step are
    /// not those of the next step. Measured on the scenes of `models/` at steps of 0.1–20 ms: the first guess so
    /// chosen is the better one everywhere (either alone costs up to 33 % more iterations); 0.12–0.2 differ by 1 %.
    const FAST: f64 = 0.15;

    fn order(from: &State, h: f64) -> [Self; 2] {
        let norm = |values: &[f64]| values.iter().map(|x| x * x).sum::<f64>().sqrt();
        if h * norm(&from.a) <= Self::FAST * norm(&from.v) {
            [Self::Accelerations, Self::Positions]
        } else {
            [Self::Positions, Self::Accelerations]
        }
    }
}

impl Rule {
    fn step(self, system: &mut dyn System, newton: &mut Newton, from: &State, h: f64, to: &mut State) -> Result<()> {
        let time = to.t;
        let mut attempt = |guess: Guess| {
            for i in 0..from.q.len() {
                let (v, a) = (from.v[i], from.a[i]);
                let (dq, v_star) = (h * v + self.q_old * a, v + self.v_old * a);
                let a_new = match guess {
                    Guess::Accelerations => a,
                    Guess::Positions => -dq / self.q_new,
                };
                to.q[i] = from.q[i] + dq + self.q_new * a_new;
                to.v[i] = v_star + self.v_new * a_new;
                to.a[i] = a_new;
            }
            system.move_to(time, to);
            let direction = Direction { q: self.q_new, v: self.v_new, a: 1.0 };
            system.better_guess(from, direction, to);
            newton.solve(system, to, direction)?;
            system.check_step(from, to)
        };
        let [first, second] = Guess::order(from, h);
        match attempt(first) {
            Err(error) if error.is_cured_by_smaller_step() => attempt(second).map_err(|e| match e {
                Error::NotConverged { time_s, iterations, increment_m, residual_n, node, .. } => {
                    Error::NotConverged { time_s, step_s: h, iterations, increment_m, residual_n, node }
                }
                other => other,
            }),
            outcome => outcome,
        }
    }
}
