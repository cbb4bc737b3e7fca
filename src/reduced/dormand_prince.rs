//! Dormand and Prince's explicit Runge–Kutta method of order 5 with an embedded method of order 4 and dense output.
//!
//! Source: J. R. Dormand & P. J. Prince, J. Comp. Appl. Math. 6 (1980) 19–26; dense output: E. Hairer, S. P. Nørsett & G.
//! Wanner, Solving Ordinary Differential Equations I (1993), section II.6.

/// Order of convergence.
pub const ORDER: u32 = 5;

const STAGES: usize = 7;

/// Times of the stages in steps.
const TIMES: [f64; STAGES] = [0.0, 1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0];

/// Weights a_ij, j < i; the last stage is the end of the step.
const WEIGHTS: [[f64; STAGES - 1]; STAGES] = [
    [0.0; 6],
    [1.0 / 5.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0, 0.0],
    [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0, 0.0],
    [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0, 0.0],
    [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0, 0.0],
    [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
];

/// Weights of the step minus those of the embedded method.
const ERROR: [f64; STAGES] =
    [71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0];

/// Weights of the dense output's highest term.
const DENSE: [f64; STAGES] = [
    -12715105075.0 / 11282082432.0,
    0.0,
    87487479700.0 / 32700410799.0,
    -10690763975.0 / 1880347072.0,
    701980252875.0 / 199316789632.0,
    -1453857185.0 / 822651844.0,
    69997945.0 / 29380423.0,
];

/// A step of y' = f(t, y), N numbers.
#[derive(Debug, Clone, Copy)]
pub struct DormandPrinceStep<const N: usize> {
    from: (f64, [f64; N]),
    h: f64,
    stages: [[f64; N]; STAGES],
    /// y at its end.
    pub end: [f64; N],
}

impl<const N: usize> DormandPrinceStep<N> {
    /// Steps from `y` with the rates `rate` at `t` over `h`.
    pub fn new(t: f64, y: [f64; N], rate: [f64; N], h: f64, mut rates: impl FnMut(f64, &[f64; N]) -> [f64; N]) -> Self {
        let mut step = Self { from: (t, y), h, stages: [rate; STAGES], end: y };
        for i in 1..STAGES {
            step.end = step.sum(y, i, &WEIGHTS[i]);
            step.stages[i] = rates(t + TIMES[i] * h, &step.end);
        }
        step
    }

    /// An empty step.
    pub fn none() -> Self {
        Self { from: (0.0, [0.0; N]), h: 1.0, stages: [[0.0; N]; STAGES], end: [0.0; N] }
    }

    /// y + h Σ w_j k_j over the first `count` stages.
    fn sum(&self, mut y: [f64; N], count: usize, weights: &[f64]) -> [f64; N] {
        for (stage, weight) in self.stages.iter().zip(weights).take(count) {
            for (y, k) in y.iter_mut().zip(stage) {
                *y += self.h * weight * k;
            }
        }
        y
    }

    /// The rates at its end.
    pub fn rate(&self) -> [f64; N] {
        self.stages[STAGES - 1]
    }

    /// The estimated error of its end.
    pub fn error(&self) -> [f64; N] {
        self.sum([0.0; N], STAGES, &ERROR)
    }

    /// y at time `t` within the step, with an error of fifth order in h.
    pub fn at(&self, t: f64) -> [f64; N] {
        let part = (t - self.from.0) / self.h;
        let rest = 1.0 - part;
        let highest = self.sum([0.0; N], STAGES, &DENSE);
        std::array::from_fn(|i| {
            let (start, [first, last]) = (self.from.1[i], [self.stages[0][i], self.rate()[i]].map(|k| self.h * k));
            let change = self.end[i] - start;
            let bend = first - change;
            let twist = change - last - bend;
            start + part * (change + rest * (bend + part * (twist + rest * highest[i])))
        })
    }
}
