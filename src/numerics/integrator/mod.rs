//! Time integration: one method per file, with its order, stability and source as data.

pub(crate) mod esdirk3;
mod generalized_alpha;
mod implicit_euler;
mod newmark;
mod symplectic_euler;

use crate::error::{Error, Result};
use crate::linear::{Direction, Number, Real};
use crate::newton::{ConvergencePolicy, ConvergenceRate, Newton};
use crate::system::{State, System};

/// All methods. To add one, write its file and list it here.
pub static METHODS: &[&Method] = &[
    &implicit_euler::METHOD,
    &newmark::METHOD,
    &generalized_alpha::METHOD,
    &esdirk3::METHOD,
    &symplectic_euler::METHOD,
];

/// A method's properties and its constructor.
#[derive(Debug)]
pub struct Method {
    /// Name in a scene.
    pub name: &'static str,
    /// Description of its stability.
    pub stability: &'static str,
    /// Reference in the literature.
    pub source: &'static str,
    /// Its parameters, each a key of a scene's `[solver]`.
    pub parameters: &'static [MethodParameter],
    /// True if it estimates the error of its steps, so that a tolerance can control the step size.
    pub adaptive: bool,
    /// False if it is explicit, and so fails where a step does not resolve the fastest mode.
    pub implicit: bool,
    /// Builds the method with values for its parameters, in their order.
    pub build: fn(&[f64]) -> Box<dyn Integrator>,
}

/// How internal steps are chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StepControl {
    /// At most this long, s.
    Fixed(f64),
    /// The estimated error of each step is at most this: of positions relative to the length, of velocities relative to the largest.
    Adaptive(f64),
}

impl From<f64> for StepControl {
    fn from(time_step: f64) -> Self {
        Self::Fixed(time_step)
    }
}

/// A parameter of a method.
#[derive(Debug)]
pub struct MethodParameter {
    /// Key in a scene.
    pub name: &'static str,
    /// Default value.
    pub default: f64,
    /// Smallest and largest value allowed.
    pub range: [f64; 2],
    /// Description of the range.
    pub allowed: &'static str,
}

impl Method {
    /// The method of this name.
    pub fn named(name: &str) -> Option<&'static Self> {
        METHODS.iter().copied().find(|method| method.name == name)
    }

    /// The default values of its parameters.
    pub fn defaults(&self) -> Vec<f64> {
        self.parameters.iter().map(|parameter| parameter.default).collect()
    }
}

/// A method with its parameters, which advances a state by one step.
pub trait Integrator: std::fmt::Debug + Send + Sync {
    /// Order of convergence in the step size.
    fn order(&self) -> u32;

    /// Theoretical spectral radius of one step on the oscillator q'' = −2ζω q' − ω² q, with `omega` = ωh and the damping ratio
    /// `damping` = ζ: above 1 the step amplifies.
    fn spectral_radius(&self, omega: f64, damping: f64) -> f64;

    /// Prepares for a run from `state`, whose accelerations satisfy the equation of motion.
    fn begin(&mut self, _state: &mut State) {}

    /// Steps from `from` by `h` (s) to time `to.t`, set by the caller; the rest of `to` is written. Returns the estimated error of
    /// the step, or zero from a method without an estimate.
    ///
    /// # Errors
    /// Errors of [`Newton::solve`] and [`System::check_step`].
    fn step(
        &mut self,
        system: &mut dyn System,
        newton: &mut Newton,
        from: &State,
        h: f64,
        to: &mut State,
    ) -> Result<StepError>;

    /// The weights of a step of `h` (s), if this is a one-stage method.
    fn rule(&self, _h: f64) -> Option<StepWeights> {
        None
    }

    /// The implicit stages of a step of `h` (s); `None` if steps of this method cannot be linearised.
    fn stages(&self, _h: f64) -> Option<Stages> {
        None
    }

    /// Writes the states at the stages of the last step, from `from` by `h` (s) to `to`, to `states`, one per stage in
    /// [`stages`](Self::stages).
    fn write_stages(&self, _from: &State, _h: f64, to: &State, states: &mut [State]) {
        states.iter_mut().for_each(|state| state.copy_from(to));
    }

    /// Makes a step of `h` (s) of a linear system from `from`; `states` has one state per stage in [`stages`](Self::stages).
    /// `solve` is called in their order: it gets the stage with its explicit part, q = q* and v = v*, and makes positions,
    /// velocities and accelerations satisfy the equation of motion. The last stage is then the end of the step.
    fn step_linear(&self, _from: &State, _h: f64, _states: &mut [State], _solve: &mut dyn FnMut(usize, &mut State)) {}
}

/// The implicit stages of a step: their number, and how new accelerations move the state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stages {
    /// Their number.
    pub count: usize,
    /// q = q* + A a and v = v* + B a.
    pub direction: Direction,
}

/// Largest modulus of the roots of λ² − `trace` λ + `determinant`.
fn largest_root(trace: f64, determinant: f64) -> f64 {
    let discriminant = trace * trace - 4.0 * determinant;
    if discriminant < 0.0 { determinant.sqrt() } else { 0.5 * (trace.abs() + discriminant.sqrt()) }
}

/// The largest ωh up to which `method`, in theory, does not amplify an oscillator of damping ratio `damping`; `None` if unlimited,
/// and 0 if it amplifies at any step.
pub fn stability_limit(method: &dyn Integrator, damping: f64) -> Option<f64> {
    const ROUNDING: f64 = 1e-9;
    let amplifies = |omega: f64| method.spectral_radius(omega, damping) > 1.0 + ROUNDING;
    let grid = |i: i32| 10.0_f64.powf(-3.0 + f64::from(i) / 100.0);
    let first = (0..=900).find(|i| amplifies(grid(*i)))?;
    if first == 0 && damping == 0.0 {
        return Some(0.0); // below the grid, rounding hides the growth
    }
    let (mut low, mut high) = (if first == 0 { 0.0 } else { grid(first - 1) }, grid(first));
    while high - low > 1e-12 * high {
        let middle = 0.5 * (low + high);
        if amplifies(middle) {
            high = middle
        } else {
            low = middle
        }
        if middle <= low && middle >= high {
            break;
        }
    }
    Some(low)
}

/// The estimated error of a step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct StepError {
    /// Largest error of a position, m.
    pub position: f64,
    /// Largest error of a velocity, m/s.
    pub velocity: f64,
}

/// A method that evaluates the equation of motion once per step, at the new time.
pub trait OneStage: std::fmt::Debug + Send + Sync {
    /// Order of convergence in the step size.
    fn order(&self) -> u32;

    /// See [`Integrator::spectral_radius`].
    fn spectral_radius(&self, omega: f64, damping: f64) -> f64;

    /// The weights of a step of `h` (s).
    fn rule(&self, h: f64) -> StepWeights;
}

impl<T: OneStage> Integrator for T {
    fn order(&self) -> u32 {
        OneStage::order(self)
    }

    fn spectral_radius(&self, omega: f64, damping: f64) -> f64 {
        OneStage::spectral_radius(self, omega, damping)
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

    fn rule(&self, h: f64) -> Option<StepWeights> {
        Some(OneStage::rule(self, h))
    }

    fn stages(&self, h: f64) -> Option<Stages> {
        Some(Stages { count: 1, direction: OneStage::rule(self, h).direction() })
    }

    fn step_linear(&self, from: &State, h: f64, states: &mut [State], solve: &mut dyn FnMut(usize, &mut State)) {
        let (rule, [to, ..]) = (OneStage::rule(self, h), states) else { return };
        let explicit = rule.explicit_parts(from, h);
        for (i, (q, v)) in to.q.iter_mut().zip(&mut to.v).enumerate() {
            let part = explicit(i);
            (*q, *v) = (from.q[i] + part.dq, part.v);
        }
        solve(0, to);
        rule.remember(from, to);
    }
}

/// The step of a one-stage method: q = q* + A a and v = v* + B a with the new acceleration a, where q* = qⁿ + h vⁿ + q_a aⁿ + q_w
/// wⁿ and v* = vⁿ + v_a aⁿ + v_w wⁿ; w is the method's memory of earlier accelerations, if it has one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepWeights {
    /// Weight q_a of the old acceleration in q*, s².
    pub q_old: f64,
    /// Weight v_a of the old acceleration in v*, s.
    pub v_old: f64,
    /// Weight A of the new acceleration in q, s².
    pub q_new: f64,
    /// Weight B of the new acceleration in v, s.
    pub v_new: f64,
    /// The weights of w, if the method has a memory.
    pub memory: Option<MemoryWeights>,
}

/// How a method uses and updates w, its memory of the accelerations: wⁿ⁺¹ = `new`·aⁿ⁺¹ + `old`·aⁿ + `kept`·wⁿ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MemoryWeights {
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

impl StepWeights {
    fn step(self, system: &mut dyn System, newton: &mut Newton, from: &State, h: f64, to: &mut State) -> Result<()> {
        let stage = Stage { new: self.direction(), h };
        stage.solve(system, newton, &mut ConvergenceRate::default(), from, to, self.explicit_parts(from, h))?;
        self.remember(from, to);
        Ok(())
    }

    /// The direction in which the new acceleration moves the state.
    pub fn direction(self) -> Direction {
        Direction { q: self.q_new, v: self.v_new, a: 1.0 }
    }

    #[inline(always)]
    fn explicit_parts(self, from: &State, h: f64) -> impl Fn(usize) -> ExplicitPart {
        let unknowns = from.q.len();
        let (v, a) = (&from.v[..unknowns], &from.a[..unknowns]);
        let memory = self.memory.map(|_| &from.memory[..unknowns]);
        move |i| self.explicit_part(h, v[i], a[i], memory.map(|w| w[i]))
    }

    /// The explicit part of a step of `h` (s) for one unknown, from the old velocity, acceleration and memory.
    #[inline(always)]
    pub(crate) fn explicit_part<T: Number>(self, h: f64, v: T, a: T, w: Option<T>) -> ExplicitPart<T> {
        let (q_w, v_w) = match (self.memory, w) {
            (Some(memory), Some(w)) => (w.like(memory.q) * w, w.like(memory.v) * w),
            _ => (v.like(0.0), v.like(0.0)),
        };
        let dq = v.like(h) * v + v.like(self.q_old) * a + q_w;
        ExplicitPart { dq, v: v + v.like(self.v_old) * a + v_w, guess: a }
    }

    /// Updates the memory of the accelerations in `to`, after the step from `from` to `to`.
    pub fn remember(self, from: &State, to: &mut State) {
        if let Some(MemoryWeights { new, old, kept, .. }) = self.memory {
            for (i, w) in to.memory.iter_mut().enumerate() {
                *w = new * to.a[i] + old * from.a[i] + kept * from.memory[i];
            }
        }
    }
}

/// One implicit stage: the equation of motion at `to.t` with q = q* + A u, v = v* + B u and a = C u. The method solves for u: the
/// acceleration (C = 1), or the velocity of a motion without inertia (B = 1, C = 0).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stage {
    /// A, B and C.
    pub new: Direction,
    /// The step that the stage belongs to, s.
    pub h: f64,
}

/// The explicit part of a stage for one unknown.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ExplicitPart<T = f64> {
    /// q* minus the old position, m.
    pub dq: T,
    /// v*, m/s.
    pub v: T,
    /// A guess of u.
    pub guess: T,
}

impl<T: Number> ExplicitPart<T> {
    /// The u that leaves positions unchanged.
    #[inline(always)]
    pub fn staying(&self, new: Direction) -> T {
        -self.dq / self.dq.like(new.q)
    }

    /// Position, velocity and acceleration for a given u; `q` is the old position.
    #[inline(always)]
    pub fn with(&self, new: Direction, q: T, u: T) -> [T; 3] {
        [q + self.dq + u.like(new.q) * u, self.v + u.like(new.v) * u, u.like(new.a) * u]
    }
}

/// The initial guess of Newton's method.
#[derive(Debug, Clone, Copy)]
enum Guess {
    /// At the method's guess of u.
    Method,
    /// At the old positions.
    Positions,
}

impl Guess {
    /// Chooses the first guess: accelerations that change the velocities by more than this fraction in one step do not predict
    /// those of the next step. Measured on the scenes of `models/` at steps of 1–20 ms with three methods: values of 0.5–3 differ
    /// by 2 %, 0.15 costs up to twice the iterations on smooth motions, and always using accelerations up to three times on ringing
    /// ones.
    const FAST: f64 = 1.0;

    fn order(from: &State, h: f64) -> [Self; 2] {
        let [change, most] = changes(h, from.v.as_chunks().0, from.a.as_chunks().0, 0.0);
        if change <= most { [Self::Method, Self::Positions] } else { [Self::Positions, Self::Method] }
    }
}

/// How much the accelerations `a` change the velocities `v` in a step of `h` (s), and the limit up to which they predict the next
/// step, see [`Guess::FAST`]. `zero` selects the number type.
#[inline(always)]
pub(crate) fn changes<T: Real>(h: f64, v: &[[T; 2]], a: &[[T; 2]], zero: T) -> [T; 2] {
    let (mut of_v, mut of_a) = (zero, zero);
    for ([v_x, v_y], [a_x, a_y]) in v.iter().zip(a) {
        of_v = of_v + *v_x * *v_x + *v_y * *v_y;
        of_a = of_a + *a_x * *a_x + *a_y * *a_y;
    }
    [zero.like(h) * of_a.sqrt(), zero.like(Guess::FAST) * of_v.sqrt()]
}

impl Stage {
    /// Solves for the state at `to.t`, from the better guess first and then from the other; the stages of a step share `known`,
    /// their measured convergence.
    #[inline]
    pub fn solve(
        self,
        system: &mut dyn System,
        newton: &mut Newton,
        known: &mut ConvergenceRate,
        from: &State,
        to: &mut State,
        foot: impl Fn(usize) -> ExplicitPart,
    ) -> Result<()> {
        let mut from_guess = |guess: Guess, patience: ConvergencePolicy| {
            self.guess(guess, system, from, to, &foot);
            newton.solve_with(patience, known, system, to, self.new)?;
            system.check_step(from, to)
        };
        let [first, second] = Guess::order(from, self.h);
        match from_guess(first, ConvergencePolicy::WhileShrinking) {
            Err(error) if error.is_cured_by_smaller_step() => from_guess(second, ConvergencePolicy::AllIterations)
                .map_err(|e| match e {
                    Error::NotConverged { time_s, iterations, increment_m, residual_n, node, .. } => {
                        Error::NotConverged { time_s, step_s: self.h, iterations, increment_m, residual_n, node }
                    }
                    other => other,
                }),
            outcome => outcome,
        }
    }

    /// Writes the `guess` of the state at `to.t`.
    #[inline]
    fn guess(
        self,
        guess: Guess,
        system: &mut dyn System,
        from: &State,
        to: &mut State,
        foot: &impl Fn(usize) -> ExplicitPart,
    ) {
        let guessed = to.q.iter_mut().zip(&mut to.v).zip(&mut to.a);
        for (i, (((to_q, to_v), to_a), q)) in guessed.zip(&from.q).enumerate() {
            let foot = foot(i);
            let u = match guess {
                Guess::Method => foot.guess,
                Guess::Positions => foot.staying(self.new),
            };
            [*to_q, *to_v, *to_a] = foot.with(self.new, *q, u);
        }
        system.move_to(to.t, to);
        system.better_guess(from, self.new, to);
    }
}
