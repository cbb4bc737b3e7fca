//! Time integration: one method a file, with its order, stability and source as data.

mod esdirk3;
mod generalized_alpha;
mod implicit_euler;
mod newmark;
mod symplectic_euler;

use crate::error::{Error, Result};
use crate::newton::Newton;
use crate::system::{Direction, State, System};

/// All methods; adding one is its file and its line here.
pub static METHODS: &[&Method] = &[
    &implicit_euler::METHOD,
    &newmark::METHOD,
    &generalized_alpha::METHOD,
    &esdirk3::METHOD,
    &symplectic_euler::METHOD,
];

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
    /// True if it estimates the error of its steps, so that a tolerance can choose them.
    pub adaptive: bool,
    /// False if it solves nothing, and so fails where a step does not resolve the fastest mode.
    pub implicit: bool,
    /// The method with values for its parameters, in their order.
    pub build: fn(&[f64]) -> Box<dyn Integrator>,
}

/// How internal steps are chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pace {
    /// As long as this, s, or shorter.
    Fixed(f64),
    /// So that the estimated error of each is at most this: of positions over the length, of velocities over the largest.
    Adaptive(f64),
}

impl From<f64> for Pace {
    fn from(time_step: f64) -> Self {
        Self::Fixed(time_step)
    }
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

    /// Prepares for a run from `state`, whose accelerations fulfil the equation of motion.
    fn begin(&mut self, _state: &mut State) {}

    /// Steps from `from` by `h` (s) to time `to.t`, which is set; the rest of `to` is written. Returns the estimated
    /// error of the step, zero from a method that has no estimate.
    ///
    /// # Errors
    /// Those of [`Newton::solve`] and [`System::check_step`].
    fn step(
        &mut self,
        system: &mut dyn System,
        newton: &mut Newton,
        from: &State,
        h: f64,
        to: &mut State,
    ) -> Result<StepError>;

    /// The rule of its steps of `h` (s), if it is a method of one stage.
    fn rule(&self, _h: f64) -> Option<Rule> {
        None
    }
}

/// The estimated error of a step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct StepError {
    /// Largest error of a position, m.
    pub position: f64,
    /// Largest error of a velocity, m/s.
    pub velocity: f64,
}

/// A method that asks for the equation of motion once, at the new time.
pub trait OneStage: std::fmt::Debug + Send {
    /// Order of convergence in the step size.
    fn order(&self) -> u32;

    /// The rule of its steps of `h` (s).
    fn rule(&self, h: f64) -> Rule;
}

impl<T: OneStage> Integrator for T {
    fn order(&self) -> u32 {
        OneStage::order(self)
    }

    fn begin(&mut self, state: &mut State) {
        if OneStage::rule(self, 1.0).memory.is_some() {
            state.memory.clone_from(&state.a);
        }
    }

    fn step(
        &mut self,
        system: &mut dyn System,
        newton: &mut Newton,
        from: &State,
        h: f64,
        to: &mut State,
    ) -> Result<StepError> {
        OneStage::rule(self, h).step(system, newton, from, h, to).map(|()| StepError::default())
    }

    fn rule(&self, h: f64) -> Option<Rule> {
        Some(OneStage::rule(self, h))
    }
}

/// The step of a method of one stage: q = q* + A a and v = v* + B a with the new acceleration a, where
/// q* = qⁿ + h vⁿ + q_a aⁿ + q_w wⁿ and v* = vⁿ + v_a aⁿ + v_w wⁿ; w is what the method remembers of the accelerations, if
/// it does.
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
    /// The weights of w, if the method remembers it.
    pub memory: Option<Memory>,
}

/// How a method uses and updates w, its memory of the accelerations: wⁿ⁺¹ = `new`·aⁿ⁺¹ + `old`·aⁿ + `kept`·wⁿ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Memory {
    /// Weight q_w of wⁿ in q*, s².
    pub q: f64,
    /// Weight v_w of wⁿ in v*, s.
    pub v: f64,
    /// Weight of the new acceleration in the new w.
    pub new: f64,
    /// Weight of the old acceleration in the new w.
    pub old: f64,
    /// Weight of the old w in the new w.
    pub kept: f64,
}

impl Rule {
    fn step(self, system: &mut dyn System, newton: &mut Newton, from: &State, h: f64, to: &mut State) -> Result<()> {
        let memory = self.memory.map(|memory| (memory, &from.memory[..]));
        let stage = Stage { q_new: self.q_new, v_new: self.v_new, h };
        stage.solve(system, newton, from, to, |i| {
            let (v, a) = (from.v[i], from.a[i]);
            let (q_w, v_w) = memory.map_or((0.0, 0.0), |(memory, w)| (memory.q * w[i], memory.v * w[i]));
            Foot { dq: h * v + self.q_old * a + q_w, v: v + self.v_old * a + v_w, a }
        })?;
        if let Some(Memory { new, old, kept, .. }) = self.memory {
            for (i, w) in to.memory.iter_mut().enumerate() {
                *w = new * to.a[i] + old * from.a[i] + kept * from.memory[i];
            }
        }
        Ok(())
    }
}

/// One implicit stage: the equation of motion at `to.t` with q = q* + A a and v = v* + B a.
#[derive(Debug, Clone, Copy)]
struct Stage {
    /// A, s².
    q_new: f64,
    /// B, s.
    v_new: f64,
    /// The step that the stage belongs to, s.
    h: f64,
}

/// What a stage stands on, one unknown of it.
#[derive(Debug, Clone, Copy)]
struct Foot {
    /// q* less the old position, m.
    dq: f64,
    /// v*, m/s.
    v: f64,
    /// A guess of the acceleration, m/s².
    a: f64,
}

/// Where Newton starts.
#[derive(Debug, Clone, Copy)]
enum Guess {
    /// At the accelerations guessed by the method.
    Accelerations,
    /// At the old positions.
    Positions,
}

impl Guess {
    /// Which to try first: accelerations that change the velocities by more than this part of them in one step are
    /// not those of the next step. Measured on the scenes of `models/` at steps of 1–20 ms with three methods: 0.5–3 differ by
    /// 2 %, 0.15 costs up to twice the iterations on smooth motions, accelerations always up to three times on ringing ones.
    const FAST: f64 = 1.0;

    fn order(from: &State, h: f64) -> [Self; 2] {
        let norm = |values: &[f64]| values.iter().map(|x| x * x).sum::<f64>().sqrt();
        if h * norm(&from.a) <= Self::FAST * norm(&from.v) {
            [Self::Accelerations, Self::Positions]
        } else {
            [Self::Positions, Self::Accelerations]
        }
    }
}

impl Stage {
    /// Solves for the state at `to.t`, from the better guess first and then from the other.
    #[inline]
    fn solve(
        self,
        system: &mut dyn System,
        newton: &mut Newton,
        from: &State,
        to: &mut State,
        foot: impl Fn(usize) -> Foot,
    ) -> Result<()> {
        let time = to.t;
        let mut attempt = |guess: Guess| {
            for i in 0..from.q.len() {
                let Foot { dq, v, a } = foot(i);
                let a = match guess {
                    Guess::Accelerations => a,
                    Guess::Positions => -dq / self.q_new,
                };
                to.q[i] = from.q[i] + dq + self.q_new * a;
                to.v[i] = v + self.v_new * a;
                to.a[i] = a;
            }
            system.move_to(time, to);
            let direction = Direction { q: self.q_new, v: self.v_new, a: 1.0 };
            system.better_guess(from, direction, to);
            newton.solve(system, to, direction)?;
            system.check_step(from, to)
        };
        let [first, second] = Guess::order(from, self.h);
        match attempt(first) {
            Err(error) if error.is_cured_by_smaller_step() => attempt(second).map_err(|e| match e {
                Error::NotConverged { time_s, iterations, increment_m, residual_n, node, .. } => {
                    Error::NotConverged { time_s, step_s: self.h, iterations, increment_m, residual_n, node }
                }
                other => other,
            }),
            outcome => outcome,
        }
    }
}
