//! Winches: tensions of tendons that depend on their lengths, in the forces, the moments and the matrix.

use super::{ActiveMoments, Dynamics, Inputs, Model};
use crate::linear::Direction;
use crate::rod::add;
use crate::system::RankOne;
use crate::tendons::{MAX_TENDONS, rest_length};

/// The winches of tendons: the lengths that they prescribe, and the effects of their tensions.
#[derive(Debug)]
pub(super) struct Winches {
    /// The length (m) that each prescribes for its tendon at the current time, and its rate, m/s.
    lengths: [[f64; MAX_TENDONS]; 2],
    /// Prescribed tensions (N), used between steps: the length is not known there as accurately as a stiff cable
    /// requires.
    given: Option<[f64; MAX_TENDONS]>,
    /// Derivative of each tension with respect to the length of its tendon in the last evaluated state, N/m.
    pub(super) slopes: [f64; MAX_TENDONS],
    /// Natural curvatures and active moments without the winches.
    without: ActiveMoments,
    /// Rank-one terms of the last assembled matrix; only the first `count` are used.
    couplings: Vec<RankOne>,
    /// The tendon of each term.
    coupled: [usize; MAX_TENDONS],
    pub(super) count: usize,
}

impl Winches {
    pub(super) fn of(model: &Model) -> Option<Box<Self>> {
        let there = model.tendons.iter().any(|tendon| tendon.winch().is_some());
        there.then(|| {
            Box::new(Self {
                lengths: Default::default(),
                given: None,
                slopes: Default::default(),
                without: ActiveMoments::zeros(model.rod.nodes),
                couplings: Vec::new(),
                coupled: [0; MAX_TENDONS],
                count: 0,
            })
        })
    }

    /// A zero rank-one term of `tendon`, for this number of `unknowns`.
    pub(super) fn couple(&mut self, tendon: usize, unknowns: usize) -> &mut RankOne {
        let place = self.count;
        (self.coupled[place], self.count) = (tendon, place + 1);
        if self.couplings.len() == place {
            self.couplings.push(RankOne::default());
        }
        let part = &mut self.couplings[place];
        for values in [&mut part.column, &mut part.row] {
            values.clear();
            values.resize(unknowns, 0.0);
        }
        part
    }

    /// The rank-one terms of the last assembled matrix.
    pub(super) fn couplings(&self) -> &[RankOne] {
        &self.couplings[..self.count]
    }

    /// The changes of tensions (N) when the unknowns change by `increment`, each with its tendon.
    pub(super) fn tension_changes(&self, increment: &[f64]) -> impl Iterator<Item = (usize, f64)> {
        let along = move |part: &RankOne| part.row.iter().zip(increment).map(|(row, x)| row * x).sum::<f64>();
        self.coupled.into_iter().zip(self.couplings().iter().map(along))
    }
}

impl Dynamics {
    /// True if a winch pulls a tendon.
    pub(crate) fn has_winches(&self) -> bool {
        self.winches.is_some()
    }

    /// The change of the tension of each tendon (N) when the inputs change by `by`; zero for a slack tendon.
    pub(crate) fn tension_change(&self, by: &Inputs) -> [f64; MAX_TENDONS] {
        std::array::from_fn(|i| match &self.winches {
            Some(winches) if self.model.tendons.get(i).is_some_and(|tendon| tendon.winch().is_some()) => {
                -winches.slopes[i] * by.winch[i]
            }
            _ if self.tensions[0][i] > 0.0 => by.tension[i],
            _ => 0.0,
        })
    }

    /// The derivative of the tension of tendon `i` with respect to its length, N/m; zero without a winch.
    pub(crate) fn tension_slope(&self, i: usize) -> f64 {
        self.winches.as_ref().map_or(0.0, |winches| winches.slopes[i])
    }

    /// Evaluates the winches at time `t` (s), and stores curvatures and moments without them.
    pub(super) fn evaluate_winches(&mut self, t: f64) {
        let (Some(winches), Some(active)) = (&mut self.winches, &self.active) else { return };
        let Model { rod, tendons, start, .. } = &*self.model;
        winches.given = None;
        let [gain, gain_rate] = start.gain(t);
        let rate = self.extrapolation.as_ref().map(|extrapolation| extrapolation.rate().winch);
        for (i, tendon) in tendons.iter().enumerate() {
            let Some(winch) = tendon.winch() else { continue };
            let rest = rest_length(rod, tendon.edges.clone());
            let told = winch.length.at(t);
            winches.lengths[0][i] = rest + gain * (told.value - rest) + self.inputs.winch[i];
            winches.lengths[1][i] =
                gain * told.rate + gain_rate * (told.value - rest) + rate.map_or(0.0, |rate| rate[i]);
        }
        let ActiveMoments { moment, rate, natural, natural_rate } = &mut winches.without;
        moment.copy_from_slice(&active.moment);
        rate.copy_from_slice(&active.rate);
        natural.copy_from_slice(&self.natural);
        natural_rate.copy_from_slice(&self.natural_rate);
    }

    /// The tensions (N) of the winches on a rod that is deformed almost like that of `other`, to first order in the
    /// difference of lengths. With this linearisation, a difference quotient does not cross between taut and slack
    /// cables.
    pub(crate) fn tensions_beside(&self, other: &Self) -> [f64; MAX_TENDONS] {
        let stretch = |dynamics: &Self, i: usize| {
            let given = dynamics.winch_length(i).map_or(0.0, |[length, _]| length);
            dynamics.model.tendons[i].length(&dynamics.edges, &dynamics.kappa) - given
        };
        let mut tensions = [0.0; MAX_TENDONS];
        for (i, (tension, tendon)) in tensions.iter_mut().zip(self.model.tendons.iter()).enumerate() {
            if let Some(winch) = tendon.winch() {
                let of_other = stretch(other, i);
                let [there, _] = winch.tension(of_other);
                *tension = there + other.tension_slope(i) * (stretch(self, i) - of_other);
            }
        }
        tensions
    }

    /// Sets the tensions (N) of the winches, whatever the lengths, until the time changes; false if there are no
    /// winches.
    pub(crate) fn give_tensions(&mut self, tensions: [f64; MAX_TENDONS]) -> bool {
        let Some(winches) = &mut self.winches else { return false };
        winches.given = Some(tensions);
        self.pull_winches();
        true
    }

    /// The length (m) that a winch prescribes for tendon `i` at the current time, and its rate, m/s.
    pub(crate) fn winch_length(&self, i: usize) -> Option<[f64; 2]> {
        let winches = self.winches.as_ref().filter(|_| self.model.tendons[i].winch().is_some())?;
        Some(winches.lengths.map(|of| of[i]))
    }

    /// Applies the tensions of the winches at the present edges and curvatures. Their rates include the motion of the
    /// winches only.
    #[inline(never)] // most rods have none
    pub(super) fn pull_winches(&mut self) {
        let (Some(winches), Some(active)) = (&mut self.winches, &mut self.active) else { return };
        let Model { rod, tendons, .. } = &*self.model;
        let ActiveMoments { moment, rate, natural, natural_rate } = &winches.without;
        active.moment.copy_from_slice(moment);
        active.rate.copy_from_slice(rate);
        self.natural.copy_from_slice(natural);
        self.natural_rate.copy_from_slice(natural_rate);
        for (i, tendon) in tendons.iter().enumerate() {
            let Some(winch) = tendon.winch() else { continue };
            let [by_length, slope] = winch.tension(tendon.length(&self.edges, &self.kappa) - winches.lengths[0][i]);
            let tension = winches.given.map_or(by_length, |given| given[i]);
            let tension_rate = -slope * winches.lengths[1][i];
            winches.slopes[i] = slope;
            (self.tensions[0][i], self.tensions[1][i]) = (tension, tension_rate);
            for k in tendon.joints.clone() {
                let [moment, rate] = [tension, tension_rate].map(|tension| tension * tendon.offset);
                active.moment[k] += moment;
                active.rate[k] += rate;
                self.natural[k] += moment / rod.joint[k];
                self.natural_rate[k] += rate / rod.joint[k];
            }
        }
    }

    /// Computes the rank-one terms of the winches along `direction` in the positions form: each tendon exerts the force
    /// T ∂Λ/∂x, and T depends on Λ.
    pub(crate) fn couple_winches(&mut self, direction: Direction) {
        let Some(winches) = &mut self.winches else { return };
        let Model { rod, tendons, .. } = &*self.model;
        winches.count = 0;
        for (i, tendon) in tendons.iter().enumerate() {
            let slope = winches.slopes[i] * direction.q;
            if slope == 0.0 {
                continue;
            }
            let RankOne { column, row } = winches.couple(i, 2 * rod.nodes);
            tendon.visit_length_slopes(&self.edges, &self.kappa, |k, slope| add(column, k, slope));
            if self.held.is_some() {
                column[..2].fill(0.0);
            }
            row.iter_mut().zip(&*column).for_each(|(row, by)| *row = slope * by);
        }
    }
}
