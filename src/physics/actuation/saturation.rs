//! Smooth limit of a drive: its output for the demand x is y = m tanh(x/m).

/// m tanh(x/m) and tanh(x/m) for the demand x `asked` and the limit m `most`.
pub fn limited(asked: f64, most: f64) -> [f64; 2] {
    let part = (asked / most).tanh();
    [most * part, part]
}

/// The limited demand at the joints, at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct Saturation {
    /// Limit m, in the unit of the drive.
    pub most: f64,
    /// tanh(x/m), one entry per node.
    part: Vec<f64>,
    /// dx/dt, per s.
    rate: Vec<f64>,
}

impl Saturation {
    /// Limits a drive with `nodes` nodes to `most`.
    pub fn new(most: f64, nodes: usize) -> Self {
        Self { most, part: vec![0.0; nodes], rate: vec![0.0; nodes] }
    }

    /// dy/dx at node `k`.
    fn slope(&self, k: usize) -> f64 {
        1.0 - self.part[k] * self.part[k]
    }

    /// Limits the demand `asked` and its `rate` (per s).
    pub fn limit(&mut self, asked: &mut [f64], rate: &mut [f64]) {
        self.rate.copy_from_slice(rate);
        for (k, (asked, rate)) in asked.iter_mut().zip(rate).enumerate() {
            [*asked, self.part[k]] = limited(*asked, self.most);
            *rate *= self.slope(k);
        }
    }

    /// Converts first-order changes of x and dx/dt to those of y and dy/dt.
    pub fn change(&self, asked: &mut [f64], rate: &mut [f64]) {
        for (k, (asked, rate)) in asked.iter_mut().zip(rate).enumerate() {
            let curve = -2.0 * self.part[k] * self.slope(k) / self.most;
            *rate = self.slope(k) * *rate + curve * self.rate[k] * *asked;
            *asked *= self.slope(k);
        }
    }

    /// Converts d²x/dt² to d²y/dt².
    pub fn second(&self, acceleration: &mut [f64]) {
        for (k, second) in acceleration.iter_mut().enumerate() {
            let curve = -2.0 * self.part[k] * self.slope(k) / self.most;
            *second = self.slope(k) * *second + curve * self.rate[k] * self.rate[k];
        }
    }
}
