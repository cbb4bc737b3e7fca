//! Published uncertainties of results, by Reynolds number.

/// The published uncertainty of results under a law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Published {
    /// Entries at increasing Reynolds numbers; empty if the uncertainty is unknown.
    pub table: &'static [Uncertainty],
    /// The publication or comparison from which it comes.
    pub source: &'static str,
}

impl Published {
    /// No published uncertainty.
    pub const NOTHING: Self = Self { table: &[], source: "" };

    /// The uncertainty at a Reynolds number: linear in its logarithm, and constant beyond the ends of the table.
    pub fn at(&self, reynolds: f64) -> Option<Uncertainty> {
        let after = self.table.partition_point(|entry| entry.reynolds <= reynolds);
        let (before, next) = (self.table.get(after.wrapping_sub(1)), self.table.get(after));
        let (Some(from), Some(to)) = (before, next) else { return before.or(next).copied() };
        let part = (reynolds / from.reynolds).ln() / (to.reynolds / from.reynolds).ln();
        let between = |a: f64, b: f64| a + part * (b - a);
        Some(Uncertainty {
            reynolds,
            speed: between(from.speed, to.speed),
            thrust: between(from.thrust, to.thrust),
            power: between(from.power, to.power),
        })
    }
}

/// Relative uncertainty of results at a Reynolds number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Uncertainty {
    /// Reynolds number based on the depth.
    pub reynolds: f64,
    /// Uncertainty of the speed of a free swimmer.
    pub speed: f64,
    /// Uncertainty of the thrust on a held head.
    pub thrust: f64,
    /// Uncertainty of the power transferred to the fluid.
    pub power: f64,
}

impl Uncertainty {
    /// An entry of a table.
    pub const fn at(reynolds: f64, [speed, thrust, power]: [f64; 3]) -> Self {
        Self { reynolds, speed, thrust, power }
    }

    /// The combined uncertainty of two independent causes.
    pub fn with(self, other: Self) -> Self {
        Self {
            speed: self.speed.hypot(other.speed),
            thrust: self.thrust.hypot(other.thrust),
            power: self.power.hypot(other.power),
            ..self
        }
    }

    /// Uncertainties of the speed (of the thrust if the head is held), and of the power.
    pub fn measured(&self, held: bool) -> [f64; 2] {
        [if held { self.thrust } else { self.speed }, self.power]
    }
}
