//! The ranges of validity of forces: bounds on dimensionless numbers. The same table is printed and used for warnings.
//!
//! The [`Validity`] of each force has its [`Bound`]s. The predictions of `check` and the measurements of a run are
//! compared with the same bounds.

use std::f64::consts::{FRAC_PI_2, PI, SQRT_2, TAU};
use std::fmt;

use nalgebra::Complex;

use super::medium::Fluid;
use crate::number_format::in_sentence;
use crate::rod::Rod;

/// The fraction of the velocity along a rod that counts as velocity across it in its Reynolds numbers, if it is larger
/// than the velocity across. No rod is aligned with a flow exactly.
pub(crate) const MISALIGNED: f64 = 0.1;

/// The motion of a rod across itself relative to the fluid, and that fluid: root mean squares and means over its length
/// and over time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TransverseMotion {
    /// Velocity w across it, m/s.
    pub speed: f64,
    /// ρw/μ with the fluid at each node, 1/m.
    pub per_depth: f64,
    /// ρu/μ with the velocity u along it, 1/m.
    pub along: f64,
    /// ρ|V|/μ of a head body with velocity V, 1/m.
    pub body: f64,
    /// Density and viscosity around the rod.
    pub fluid: Fluid,
}

impl TransverseMotion {
    /// The factor of a size in its Reynolds number, 1/m: ρw/μ, or a tenth of ρu/μ if that is larger; and whether it is.
    pub fn counted(&self) -> (f64, bool) {
        let along = MISALIGNED * self.along;
        (self.per_depth.max(along), along > self.per_depth)
    }
}

/// The quantities from which the dimensionless numbers of a motion are computed.
#[derive(Debug, Clone, Copy)]
pub struct FlowConditions<'a> {
    /// The rod.
    pub rod: &'a Rod,
    /// Its motion across itself, and the fluid.
    pub across: TransverseMotion,
    /// Frequency of the drive, Hz.
    pub frequency: Option<f64>,
    /// The wavelength along the rod, m.
    pub wavelength: Option<f64>,
    /// Height above a wall, m.
    pub height: Option<f64>,
}

/// A dimensionless number that bounds refer to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DimensionlessNumber {
    /// wD/ν with the mean depth D and the velocity w across the rod, or a tenth of that along it if that is larger.
    Reynolds,
    /// wL/ν with the length L.
    LengthReynolds,
    /// fD²/ν.
    Stokes,
    /// Drag of a cylinder in small oscillations over its steady drag at that speed, see [`oscillating`]; only if the
    /// rod moves by less than its depth.
    Unsteady,
    /// ωa²/ν with the largest radius a.
    Swinging,
    /// Length over the largest radius.
    Slenderness,
    /// Length over the largest radius, only if the Reynolds number of the depth is below 1, where the viscous part
    /// dominates a law.
    CreepingSlenderness,
    /// Depth over length.
    Depth,
    /// Wavelength over the largest radius.
    Wave,
    /// Wavelength over the mean depth.
    WaveInDepths,
    /// Height above a wall over the largest radius.
    Height,
    /// Height above a wall over the length.
    HeightInLengths,
    /// Reynolds number of the head body, based on its longest axis.
    BodyReynolds,
    /// fD²/ν of the head body, with its axis across the rod.
    BodyStokes,
    /// Height above a wall over the head body's longest semi-axis.
    BodyHeight,
}

impl DimensionlessNumber {
    /// Its name in a sentence.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Reynolds => "Reynolds number of the depth",
            Self::LengthReynolds => "Reynolds number of the length",
            Self::Stokes => "fD²/ν",
            Self::Unsteady => "ratio of the drag of an oscillating cylinder to that in steady flow",
            Self::Swinging => "ωa²/ν",
            Self::Slenderness => "length over radius",
            Self::CreepingSlenderness => "length over radius, where the Reynolds number of the depth is below 1,",
            Self::Depth => "depth over length",
            Self::Wave => "wavelength over radius",
            Self::WaveInDepths => "wavelength over depth",
            Self::Height => "height over radius",
            Self::HeightInLengths => "height over length",
            Self::BodyReynolds => "Reynolds number of the head body",
            Self::BodyStokes => "fD²/ν of the head body",
            Self::BodyHeight => "height over the head body's longest semi-axis",
        }
    }

    /// The value for a motion; `None` if a quantity that it needs is missing, or if there is no motion.
    pub fn of(self, motion: &FlowConditions<'_>) -> Option<f64> {
        let FlowConditions { rod, across: TransverseMotion { fluid, .. }, frequency, wavelength, height } = *motion;
        let (length, radius) = (rod.length, rod.sections.largest_radius());
        let depth = || rod.sections.mean(0.0, 1.0, |xi| rod.sections.depth_at(xi));
        let per_nu = fluid.density / fluid.viscosity;
        let longest = rod.body.map(|body| body.along.max(body.across));
        let moving = |size: f64| Some(motion.across.counted().0 * size).filter(|number| *number > 0.0);
        match self {
            Self::Unsteady => {
                let (reynolds, stokes) = (moving(depth())?, Self::Stokes.of(motion)?);
                let slender = wavelength.map_or(length, |wave| wave.min(length)) / (0.5 * depth());
                let stroke = SQRT_2 * reynolds / stokes;
                (stroke < 1.0).then(|| oscillating(stokes) / steady(reynolds, slender))
            }
            Self::Reynolds => moving(depth()),
            Self::LengthReynolds => moving(length),
            Self::Stokes => frequency.map(|frequency| frequency * depth().powi(2) * per_nu),
            Self::Swinging => frequency.map(|frequency| TAU * frequency * radius * radius * per_nu),
            Self::Slenderness => Some(length / radius),
            Self::CreepingSlenderness => moving(depth()).filter(|reynolds| *reynolds < 1.0).map(|_| length / radius),
            Self::Depth => Some(depth() / length),
            Self::Wave => wavelength.map(|wave| wave / radius),
            Self::WaveInDepths => wavelength.map(|wave| wave / depth()),
            Self::Height => height.map(|height| height / radius),
            Self::HeightInLengths => height.map(|height| height / length),
            Self::BodyReynolds => {
                longest.map(|longest| 2.0 * longest * motion.across.body).filter(|number| *number > 0.0)
            }
            Self::BodyStokes => {
                let size = rod.body.map(|body| 2.0 * body.across);
                frequency.zip(size).map(|(frequency, size)| frequency * size * size * per_nu)
            }
            Self::BodyHeight => height.zip(longest).map(|(height, longest)| height / longest),
        }
    }
}

/// Drag per length, speed and viscosity of a cylinder that oscillates across itself by much less than its depth, at a
/// Stokes number fD²/ν: the part of πΩi(1 + 4K₁(k)/(kK₀(k))) in phase with the velocity, with k² = iΩ and Ω = ωa²/ν. G.
/// G. Stokes, Trans. Camb. Phil. Soc. 9 (1851); at large Stokes numbers that of C.-Y. Wang, J. Fluid Mech. 32 (1968).
pub fn oscillating(stokes: f64) -> f64 {
    let omega = FRAC_PI_2 * stokes;
    let k = (Complex::i() * omega).sqrt();
    // K_ν(k) e^k = ∫₀^∞ e^(k(1 − cosh t)) cosh νt dt, by the trapezoidal rule, whose error decreases exponentially. The
    // integrand is negligible where (cosh t − 1) Re k is 40.
    let end = (1.0 + 40.0 * SQRT_2 / k.norm()).acosh();
    let part = end / f64::from(PARTS);
    let [mut zeroth, mut first] = [Complex::new(0.5, 0.0); 2];
    for i in 1..=PARTS {
        let cosh = (f64::from(i) * part).cosh();
        let decay = (k * (1.0 - cosh)).exp();
        zeroth += decay;
        first += decay * cosh;
    }
    PI * omega * (Complex::i() * 4.0 * first / (k * zeroth)).re
}

/// The same for a cylinder in a steady flow at a Reynolds number of its depth, with its length over its radius:
/// slender-body theory, boundary layer and form drag, as in `cross-flow`.
fn steady(reynolds: f64, slender: f64) -> f64 {
    4.0 * PI / (slender.ln() + COX).max(1.0) + 2.0 * reynolds.sqrt() + 0.5 * FORM * reynolds
}

/// Number of intervals for a smooth integral.
const PARTS: u32 = 200;
/// R. G. Cox's constant across a rod.
const COX: f64 = 0.1931;
/// Form drag coefficient of a cylinder.
const FORM: f64 = 1.1;

/// The bound on [`DimensionlessNumber::Unsteady`] up to which laws of steady drag hold.
pub const STEADY: Bound = Bound::at_most(DimensionlessNumber::Unsteady, 2.0);

/// The interval of a dimensionless number in which a force is valid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bound {
    /// The number.
    pub number: DimensionlessNumber,
    /// Its minimum; 0 for none.
    pub least: f64,
    /// Its maximum; infinite for none.
    pub most: f64,
}

impl Bound {
    /// Up to `most`.
    pub const fn at_most(number: DimensionlessNumber, most: f64) -> Self {
        Self { number, least: 0.0, most }
    }

    /// From `least` on.
    pub const fn at_least(number: DimensionlessNumber, least: f64) -> Self {
        Self { number, least, most: f64::INFINITY }
    }

    /// From `least` to `most`.
    pub const fn between(number: DimensionlessNumber, least: f64, most: f64) -> Self {
        Self { number, least, most }
    }

    /// A description of the interval.
    pub fn limits(&self) -> String {
        let Self { least, most, .. } = *self;
        match (least > 0.0, most < f64::INFINITY) {
            (true, true) => format!("from {} to {}", short(least), short(most)),
            (true, false) => format!("at least {}", short(least)),
            _ => format!("up to {}", short(most)),
        }
    }

    /// The value for a motion, if it is outside the interval.
    pub fn value_outside(&self, motion: &FlowConditions<'_>) -> Option<f64> {
        // Values at the bound itself have rounding errors.
        let most = self.most * (1.0 + 1e-9);
        self.number.of(motion).filter(|number| !(self.least * (1.0 - 1e-9)..=most).contains(number))
    }
}

impl fmt::Display for Bound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.number.words(), self.limits())
    }
}

/// A number in its shortest form.
fn short(x: f64) -> String {
    if (1e-2..1e4).contains(&x) {
        format!("{:.3}", x).trim_end_matches('0').trim_end_matches('.').into()
    } else {
        format!("{x:e}")
    }
}

/// The range of validity of a force, with its source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Validity {
    /// A description of the range, as far as the bounds do not express it.
    pub range: &'static str,
    /// The bounds on dimensionless numbers.
    pub bounds: &'static [Bound],
    /// The publications that state it.
    pub source: &'static str,
}

impl Validity {
    /// A description of the range and its bounds.
    pub fn in_words(&self) -> String {
        let bounds = self.bounds.iter().map(Bound::to_string);
        [self.range.to_string()]
            .into_iter()
            .filter(|range| !range.is_empty())
            .chain(bounds)
            .collect::<Vec<_>>()
            .join("; ")
    }

    /// True if a motion is within all bounds.
    pub fn holds(&self, motion: &FlowConditions<'_>) -> bool {
        self.bounds.iter().all(|bound| bound.value_outside(motion).is_none())
    }

    /// A description of the bounds that a motion exceeds; `None` if it exceeds none.
    pub fn beyond(&self, motion: &FlowConditions<'_>) -> Option<String> {
        let left = self.bounds.iter().filter_map(|bound| Some((bound, bound.value_outside(motion)?)));
        let in_words = left.map(|(bound, number)| {
            format!("{} is {} (allowed: {})", bound.number.words(), in_sentence(number, 4), bound.limits())
        });
        let all: Vec<String> = in_words.collect();
        (!all.is_empty()).then(|| all.join("; "))
    }
}
