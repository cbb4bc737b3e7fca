//! Convex quadratic programs with named constraints, solved by Clarabel.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, ZeroConeT};

use nalgebra::{DMatrix, DVector};

use crate::error::{Error, Result};

/// A constraint Σ c x ≤ b, or = b.
#[derive(Debug, Clone)]
pub struct Constraint {
    /// Its description.
    pub name: String,
    /// Unknowns and their coefficients.
    pub row: Vec<(usize, f64)>,
    /// b.
    pub bound: f64,
    /// True for =.
    pub equal: bool,
}

impl Constraint {
    /// Σ c x ≤ b.
    pub fn at_most(name: impl Into<String>, row: Vec<(usize, f64)>, bound: f64) -> Self {
        Self { name: name.into(), row, bound, equal: false }
    }

    /// Σ c x = b.
    pub fn equal(name: impl Into<String>, row: Vec<(usize, f64)>, bound: f64) -> Self {
        Self { name: name.into(), row, bound, equal: true }
    }
}

/// min ½xᵀHx + gᵀx under constraints; H is symmetric and positive semidefinite, stored by rows.
#[derive(Debug, Clone)]
pub struct QuadraticProgram {
    /// H.
    pub hessian: Vec<f64>,
    /// g.
    pub gradient: Vec<f64>,
    /// Constraints.
    pub constraints: Vec<Constraint>,
}

/// A solution, with one dual per constraint; duals of inequalities are non-negative.
#[derive(Debug, Clone)]
pub struct QpSolution {
    /// x.
    pub x: Vec<f64>,
    /// Duals, in units of the objective.
    pub duals: Vec<f64>,
    /// Iterations.
    pub iterations: u32,
}

/// Constraints with a dual above this fraction of the largest belong to a conflict.
const CONFLICT_DUAL: f64 = 1e-3;

/// The largest magnitude of `values`.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |max, x| max.max(x.abs()))
}

impl QuadraticProgram {
    /// A problem of `n` unknowns without objective.
    pub fn new(n: usize) -> Self {
        Self { hessian: vec![0.0; n * n], gradient: vec![0.0; n], constraints: Vec::new() }
    }

    /// Adds `weight`·½(Σ c x − b)².
    pub fn add_square(&mut self, row: &[(usize, f64)], b: f64, weight: f64) {
        let n = self.gradient.len();
        for (i, a) in row {
            for (j, c) in row {
                self.hessian[i * n + j] += weight * a * c;
            }
            self.gradient[*i] -= weight * a * b;
        }
    }

    /// The active constraints, with their duals.
    pub fn active(&self, solution: &QpSolution) -> Vec<(String, f64)> {
        let binds = |(constraint, dual): &(&Constraint, &f64)| {
            let slack = constraint.bound - constraint.row.iter().map(|(i, c)| c * solution.x[*i]).sum::<f64>();
            constraint.equal || (slack.abs() < 1e-6 && **dual > 0.0)
        };
        let found = self.constraints.iter().zip(&solution.duals).filter(binds);
        found.map(|(constraint, dual)| (constraint.name.clone(), *dual)).collect()
    }

    /// Solves the program. The objective is scaled so that the largest diagonal entry of H (of g, without H) is one, since Clarabel
    /// would otherwise accept unsolved programs with small coefficients.
    ///
    /// # Errors
    /// [`Error::Design`] if no solution was found, with the constraints that are in conflict.
    pub fn solve(&self) -> Result<QpSolution> {
        let n = self.gradient.len();
        let mut scale = largest((0..n).map(|i| self.hessian[i * n + i]));
        if scale == 0.0 {
            scale = largest(self.gradient.iter().copied());
        }
        if scale == 0.0 {
            scale = 1.0;
        }
        if !scale.is_finite() {
            return Err(Error::Design { reason: "the objective is not finite".to_string() });
        }
        // Clarabel expects the upper triangle, by columns.
        let (mut starts, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
        for j in 0..n {
            for i in (0..=j).filter(|i| self.hessian[i * n + j] != 0.0) {
                rows.push(i);
                values.push(self.hessian[i * n + j] / scale);
            }
            starts.push(rows.len());
        }
        let hessian = CscMatrix::new(n, n, starts, rows, values);
        let gradient: Vec<f64> = self.gradient.iter().map(|g| g / scale).collect();
        let order: Vec<usize> = {
            let of = |equal: bool| (0..self.constraints.len()).filter(move |k| self.constraints[*k].equal == equal);
            of(true).chain(of(false)).collect()
        };
        let equalities = self.constraints.iter().filter(|c| c.equal).count();
        let (mut entries, mut bounds) = (Vec::new(), Vec::new());
        for (row, k) in order.iter().enumerate() {
            let constraint = &self.constraints[*k];
            entries.extend(constraint.row.iter().map(|(j, c)| (*j, row, *c)));
            bounds.push(constraint.bound);
        }
        entries.sort_by_key(|(j, row, _)| (*j, *row));
        let starts = (0..=n).map(|j| entries.partition_point(|entry| entry.0 < j)).collect();
        let matrix = CscMatrix::new(
            order.len(),
            n,
            starts,
            entries.iter().map(|entry| entry.1).collect(),
            entries.iter().map(|entry| entry.2).collect(),
        );
        let cones = [ZeroConeT(equalities), NonnegativeConeT(order.len() - equalities)];
        let settings = DefaultSettings {
            verbose: false,
            max_iter: 200,
            tol_gap_abs: 1e-10,
            tol_gap_rel: 1e-10,
            tol_feas: 1e-10,
            ..DefaultSettings::default()
        };
        let mut solver = DefaultSolver::new(&hessian, &gradient, &matrix, &bounds, &cones, settings)
            .map_err(|e| Error::Design { reason: format!("the quadratic program cannot be set up: {e}") })?;
        solver.solve();
        let found = &solver.solution;
        let mut duals = vec![0.0; order.len()];
        for (k, z) in order.iter().zip(&found.z) {
            duals[*k] = z * scale;
        }
        let infeasible = matches!(found.status, SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible);
        if !infeasible {
            let rough = QpSolution { x: found.x.clone(), duals: duals.clone(), iterations: found.iterations };
            let polished = self.polished(&rough, scale);
            // An almost solved program counts as solved if its active constraints confirm the solution to rounding.
            match polished {
                Some(solution) => return Ok(solution),
                None if found.status == SolverStatus::Solved => return Ok(rough),
                None => {}
            }
        }
        let conflict = if infeasible { self.conflict(duals) } else { Vec::new() };
        let reason = if conflict.is_empty() {
            format!("the quadratic program of {n} unknowns and {} constraints ended as {:?}", order.len(), found.status)
        } else {
            format!("these constraints contradict each other: {}", conflict.join("; "))
        };
        Err(Error::Design { reason })
    }

    /// The constraints that exclude each other, from the `duals` of a certificate of infeasibility: Aᵀz = 0, bᵀz < 0, z ≥ 0. If
    /// both sides of one number occur, only the one that the certificate needs is named; of many constraints that differ in a
    /// number, only the first few.
    fn conflict(&self, mut duals: Vec<f64>) -> Vec<String> {
        let are_opposite = |a: &Constraint, b: &Constraint| {
            a.row.len() == b.row.len() && a.row.iter().zip(&b.row).all(|((i, a), (j, b))| i == j && *a == -b)
        };
        for i in 0..duals.len() {
            for j in i + 1..duals.len() {
                let [a, b] = [&self.constraints[i], &self.constraints[j]];
                if !a.equal && !b.equal && are_opposite(a, b) {
                    // The certificate stays valid if both sides are reduced by the same amount.
                    let both = duals[i].min(duals[j]);
                    duals[i] -= both;
                    duals[j] -= both;
                }
            }
        }
        let size = largest(duals.iter().copied());
        let named = self.constraints.iter().zip(&duals).filter(|(_, dual)| dual.abs() > CONFLICT_DUAL * size);
        let kind = |name: &str| name.replace(|c: char| c.is_ascii_digit(), "");
        let mut kinds: Vec<(String, Vec<&str>)> = Vec::new();
        for name in named.map(|(constraint, _)| constraint.name.as_str()) {
            match kinds.iter_mut().find(|(of, _)| *of == kind(name)) {
                Some((_, names)) => names.push(name),
                None => kinds.push((kind(name), vec![name])),
            }
        }
        let in_words = |(_, names): (String, Vec<&str>)| match &names[..] {
            [first, second, third, _, rest @ ..] => {
                format!("{first}; {second}; {third} and {} more like these", rest.len() + 1)
            }
            few => few.join("; "),
        };
        kinds.into_iter().map(in_words).collect()
    }

    /// Refines a rough solution to rounding, for its active constraints; `None` if these change.
    fn polished(&self, rough: &QpSolution, scale: f64) -> Option<QpSolution> {
        let n = self.gradient.len();
        let value = |constraint: &Constraint, x: &[f64]| -> f64 { constraint.row.iter().map(|(j, c)| c * x[*j]).sum() };
        let slack = |k: usize| self.constraints[k].bound - value(&self.constraints[k], &rough.x);
        let binding: Vec<usize> = (0..self.constraints.len())
            .filter(|k| self.constraints[*k].equal || rough.duals[*k] / scale > slack(*k))
            .collect();
        let size = n + binding.len();
        let mut matrix = DMatrix::zeros(size, size);
        let mut rhs = DVector::zeros(size);
        for i in 0..n {
            rhs[i] = -self.gradient[i] / scale;
            for j in 0..n {
                matrix[(i, j)] = self.hessian[i * n + j] / scale;
            }
        }
        for (row, k) in binding.iter().enumerate() {
            for (j, c) in &self.constraints[*k].row {
                matrix[(n + row, *j)] += c;
                matrix[(*j, n + row)] += c;
            }
            rhs[n + row] = self.constraints[*k].bound;
        }
        let solved = matrix.lu().solve(&rhs).filter(|x| x.iter().all(|x| x.is_finite()))?;
        let x: Vec<f64> = solved.iter().take(n).copied().collect();
        let mut duals = vec![0.0; self.constraints.len()];
        for (row, k) in binding.iter().enumerate() {
            duals[*k] = solved[n + row] * scale;
        }
        let feasible = self.constraints.iter().zip(&duals).all(|(constraint, dual)| {
            let slack = constraint.bound - value(constraint, &x);
            let tolerance = 1e-9 * (1.0 + constraint.bound.abs());
            if constraint.equal { slack.abs() <= tolerance } else { slack >= -tolerance && *dual >= -1e-9 * scale }
        });
        feasible.then_some(QpSolution { x, duals, iterations: rough.iterations })
    }
}
