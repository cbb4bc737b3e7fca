//! The rule for the next adaptive step.

/// Bounds of the factor between successive adaptive steps.
pub(super) const STEP_FACTORS: [f64; 2] = [0.2, 5.0];
const SAFETY: f64 = 0.9;

/// The factor of the next step size after a step whose error was `size` times the tolerance, for errors proportional to the step to
/// the power `order`. The expected error is [`SAFETY`] to that power times the tolerance (E. Hairer, S. P. Nørsett & G. Wanner, Solving Ordinary Differential Equations I,
/// section II.4).
pub(super) fn step_factor(size: f64, order: u32) -> f64 {
    SAFETY * size.powf(-1.0 / f64::from(order))
}

#[cfg(test)]
mod tests {
    use super::{SAFETY, step_factor};

    #[test]
    fn the_next_step_has_the_error_that_is_aimed_at() {
        for order in 1..=4 {
            for size in [1e-3_f64, 0.5, 1.0, 8.0, 1e4] {
                let next = size * step_factor(size, order).powi(order as i32);
                let aim = SAFETY.powi(order as i32);
                assert!((next / aim - 1.0).abs() < 1e-14, "order {order}: {next} of the tolerance, aimed at {aim}");
            }
        }
    }
}
