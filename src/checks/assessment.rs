//! Assessment of a scene before its run: dimensionless numbers, the models and fluid laws that apply, and warnings if the model
//! or the method is outside its range of validity.

use std::cell::OnceCell;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, TAU};

use nalgebra::Vector2;

use crate::actuation::lag;
use crate::error::{Result, bytes};
use crate::fluid::body;
use crate::fluid::laws::{self, CREEPING, DragLaw, LAWS, LawInputs, MIN_LOG_SLENDERNESS};
use crate::fluid::{Fluid, Force, Forces};
use crate::head::{Hinge, Signal, pose};
use crate::integrator::{Integrator, Method, StepControl};
use crate::metrics::Energy;
use crate::model::{Drive, Mechanics, Model, chain};
use crate::modes::{self, HighestFrequencies, Matrices, Modes, StableSteps};
use crate::number_format::{signed, significant, two_digits};
use crate::reduced::MODELS;
use crate::reduced::fluid_estimates::SAFETY_FACTOR;
use crate::regime::{self, Regime};
use crate::rod::{DampedRate, Damping, Profile, Rod, Shape, bend, node};
use crate::scene::value::{Finite, Positive};
use crate::scene::{HeadKind, NodesTable, Scene, StartKind};
use crate::spectrum::Spectrum;
use crate::stepper::Stepper;
use crate::system::Form;
use crate::tendons::Tendon;
use crate::variable::Variable;
use crate::wording::Phrase;

/// Natural frequencies are computed with at most this many nodes, because the cost of the dense eigenproblem grows as N³. The
/// same limit applies to quantities computed from the prescribed shapes of the drive, which are many complete states.
const MAX_NODES_FOR_MODES: u64 = 201;
/// Drag laws are compared on at most this many nodes, because the cost of a nonlocal law grows as N³.
const MAX_NODES_FOR_LAWS: u64 = 33;
/// Stokes number below which the boundary layer contributes more than a fifth of the added mass.
const MIN_STOKES_NUMBER: f64 = 100.0;
/// Surface tension of water against air, N/m.
const SURFACE_TENSION: f64 = 0.072;
/// Relative difference of mass and displaced mass up to which a swimmer is neutrally buoyant.
const NEUTRAL_BUOYANCY_MARGIN: f64 = 0.05;
/// Largest ratio of the drive frequency to the first natural frequency for which a rod may start in the shape that moments bend
/// it to without load.
const MAX_SHAPED_FREQUENCY_RATIO: f64 = 1.5;
/// Smallest number of steps per period of the drive.
const MIN_STEPS_PER_PERIOD: f64 = 20.0;
/// Largest kΔL of waves along a passive tail.
const MAX_WAVE_PHASE: f64 = 0.5;
/// Young's moduli (Pa) below this are typical of rubbers and gels.
const MAX_SOFT_MODULUS_PA: f64 = 1e8;
/// Only factors above this are reported.
const MIN_REPORTED_FACTOR: f64 = 1.05;
/// Largest ω₁Δt that resolves the oscillations after an abrupt start.
const MAX_RESOLVED_PHASE: f64 = 0.2;
/// Typical length of a number with its separator in a table, bytes.
const BYTES_PER_NUMBER: f64 = 20.0;

/// The columns of trajectory.csv: variables, each with the index of its entry. The variables of every run come first, followed by
/// those of `record.variables`.
///
/// # Errors
/// [`Error::Scene`](crate::Error::Scene) for a variable that the scene does not have.
pub fn recorded_variables(scene: &Scene, stepper: &Stepper) -> Result<Vec<(&'static Variable, usize)>> {
    let of_every_run = stepper.variables().iter().copied().filter(|variable| variable.recorded);
    let mut columns: Vec<_> = of_every_run.map(|variable| (variable, 0)).collect();
    for name in &scene.record.variables {
        let variable = stepper.find(name).map_err(|error| scene.error("record.variables", error.to_string()))?;
        if !columns.iter().any(|(other, _)| other.name == variable.name) {
            columns.extend(variable.entries(stepper.model()).map(|entry| (variable, entry)));
        }
    }
    Ok(columns)
}

/// Number of rows that a run of `scene` records, and approximate size of its tables, bytes; `None` if the number of rows depends
/// on the steps.
pub fn recorded_size(scene: &Scene, stepper: &Stepper) -> Option<(f64, f64)> {
    let rows = match (scene.record.interval_s, scene.steps()) {
        (Some(interval), _) => scene.solver.duration_s.get() / interval.get(),
        (None, Some(steps)) => steps as f64 / scene.record.every.map_or(1.0, |every| every.get() as f64),
        (None, None) => return None,
    };
    let rows = rows.floor() + 1.0;
    let columns = recorded_variables(scene, stepper).map_or(0, |columns| columns.len());
    let positions = match scene.nodes_table() {
        NodesTable::Csv | NodesTable::Parquet => 2 * scene.recorded_nodes().len(),
        NodesTable::None => 0,
    };
    Some((rows, rows * (columns + positions) as f64 * BYTES_PER_NUMBER))
}

/// A line of the assessment.
#[derive(Debug, Clone, PartialEq)]
pub struct AssessmentLine {
    /// Name of the quantity.
    pub name: &'static str,
    /// Value, unit and explanation.
    pub text: String,
}

/// The numbers that characterise a scene's motion; `None` if the scene lacks the corresponding part.
#[derive(Debug, Clone, PartialEq)]
pub struct Assessment {
    /// First non-rigid natural frequency ω₁ of the scene's own discrete rod, with added mass, rad/s.
    pub first_frequency: f64,
    /// Half the tip's range of motion, m; without a fluid, in the prescribed shape.
    pub tip_amplitude: Option<f64>,
    /// Re_d = ρ w D/μ of the motion, see [`Regime`].
    pub reynolds: Option<f64>,
    /// ω/ω₁.
    pub frequency_ratio: Option<f64>,
    /// Sp = L(ξ_⊥ω/EI)^¼.
    pub sperm_number: Option<f64>,
    /// β = ω(ρA + m_a)/ξ_⊥: ratio of inertia, with added mass, to drag.
    pub inertia_ratio: Option<f64>,
    /// All lines.
    pub facts: Vec<AssessmentLine>,
    /// Warnings.
    pub warnings: Vec<String>,
    /// Forces that leave their range of validity in the predicted motion. A run checks its own motion.
    pub ranges: Vec<String>,
}

/// The data that an assessment is based on, in addition to its scene and stepper.
struct AssessmentBasis {
    /// The flow around the rod, or the reason why it is unknown.
    regime: std::result::Result<Regime, String>,
    /// The natural modes, and whether they were computed on a coarser mesh.
    natural: LazyModes,
    is_coarse: bool,
    /// The spectrum of the drives of the rod.
    spectrum: Spectrum,
}

/// The natural modes of a model, of which a run needs the lowest and a bound of the highest only.
struct LazyModes {
    matrices: Matrices,
    /// What winches add, see [`Modes::winches`].
    winches: f64,
    /// All of them, once they are needed.
    all: OnceCell<Modes>,
}

impl LazyModes {
    fn all(&self) -> Result<&Modes> {
        if let Some(all) = self.all.get() {
            return Ok(all);
        }
        let all = Modes::of_matrices(&self.matrices, self.winches)?;
        Ok(self.all.get_or_init(|| all))
    }

    /// The largest steps of `method` that amplify none of them, if these are smaller than `step`.
    fn stable_steps_below(
        &self,
        step: f64,
        method: &dyn Integrator,
        damping: Option<&Damping>,
    ) -> Result<Option<StableSteps>> {
        let exceeded =
            |highest: HighestFrequencies| highest.stable_steps(method, damping).filter(|steps| step > steps.largest);
        // Bounds of the frequencies cost far less, and most steps are shorter than they ask.
        match HighestFrequencies::bounds(&self.matrices, self.winches) {
            Some(bounds) if self.all.get().is_none() && exceeded(bounds).is_none() => Ok(None),
            _ => Ok(exceeded(self.all()?.highest_of_each())),
        }
    }
}

impl Assessment {
    /// Assesses `scene`, whose stepper is at its start.
    ///
    /// # Errors
    /// Errors of [`Modes::of`].
    pub fn of(scene: &Scene, stepper: &Stepper) -> Result<Self> {
        let (mut assessment, basis) = Self::begin(scene, stepper)?;
        assessment.describe(scene, stepper, &basis)?;
        Ok(assessment)
    }

    /// The same without [`facts`](Self::facts) and [`ranges`](Self::ranges), which a run does not show.
    ///
    /// # Errors
    /// Errors of [`of`](Self::of).
    pub fn of_run(scene: &Scene, stepper: &Stepper) -> Result<Self> {
        Ok(Self::begin(scene, stepper)?.0)
    }

    /// The numbers and the warnings.
    fn begin(scene: &Scene, stepper: &Stepper) -> Result<(Self, AssessmentBasis)> {
        let is_coarse = scene.rod.nodes.get() as u64 > MAX_NODES_FOR_MODES;
        let coarse = scene.with_nodes_up_to(MAX_NODES_FOR_MODES);
        let model = coarse.model()?;
        let regime = scene.regime();
        let spectrum = Spectrum::of_model(&model);
        let omega = spectrum.strongest().map(|frequency| TAU * frequency);
        let tip_amplitude = match &regime {
            Ok(regime) => Some(regime.tip),
            Err(_) => prescribed_tip(&model),
        };
        // The mean fluid over the position of the rod.
        let fluid = regime.as_ref().map_or(model.fluid, |regime| regime.across.fluid);
        let across = resistance(scene, &model, fluid);
        let drive = DriveShape::of(&model, stepper.model().rod.spacing / model.rod.spacing);
        let (is_inertial, spacing) = (model.forces.are_inertial(), model.rod.spacing);
        let dry = model.rod.sections.line_density(0.5);
        let winches = model.tendons.stiffness_over_inertia(&model.rod);
        let lowest =
            if model.rod.nodes > modes::MAX_DENSE_NODES { modes::first_frequency(coarse.model()?).ok() } else { None };
        let matrices = Matrices::of_natural_modes(model)?;
        let line_density = if is_inertial { matrices.line_density(spacing) } else { dry };
        let natural = LazyModes { matrices, winches, all: OnceCell::new() };
        let first_frequency = match lowest {
            Some(lowest) => lowest,
            None => natural.all()?.lowest(),
        };
        let rod = &stepper.model().rod;
        let mut assessment = Self {
            first_frequency,
            tip_amplitude,
            reynolds: regime.as_ref().ok().map(|regime| regime.reynolds),
            frequency_ratio: omega.map(|omega| omega / first_frequency),
            sperm_number: omega.zip(across).map(|(omega, across)| rod.length * (across * omega / rod.ei).powf(0.25)),
            inertia_ratio: omega.zip(across).map(|(omega, across)| omega * line_density / across),
            facts: Vec::new(),
            warnings: Vec::new(),
            ranges: Vec::new(),
        };
        assessment.warn_of_media(scene, stepper.model());
        // A scene may give stiffness and mass instead of a section.
        if scene.rod.outer_radius_m.is_some() {
            assessment.warn_of_tendons(stepper.model());
        }
        assessment.warn_of_waves(scene, rod);
        // On a coarser mesh the limit would differ.
        if !is_coarse {
            assessment.warn_of_limit(scene, stepper, &natural)?;
        }
        assessment.warn(scene, stepper, &drive, spectrum.fastest().map(|frequency| TAU * frequency));
        Ok((assessment, AssessmentBasis { regime, natural, is_coarse, spectrum }))
    }

    /// All warnings before a run.
    pub fn all_warnings(&self) -> impl Iterator<Item = &String> {
        self.warnings.iter().chain(&self.ranges)
    }

    /// The models that apply to the scene, cheapest first, with their estimated errors, and the model that is used.
    ///
    /// # Errors
    /// Errors of [`Scene::estimates`].
    pub fn models(scene: &Scene, stepper: &Stepper) -> Result<Vec<AssessmentLine>> {
        let known = stepper.choice().and_then(|choice| choice.estimates.clone());
        let estimates = known.map_or_else(|| scene.estimates(), Ok)?;
        let mut facts = Vec::new();
        for kind in MODELS.iter().filter(|kind| scene.drag.is_some() || !kind.needs_drag) {
            let text = match kind.estimate.map(|estimate| estimate(&estimates)) {
                None => "complete; errors of mesh and time steps are not part of these estimates".to_string(),
                Some(Ok(errors)) => format!("estimated errors: {}", errors.in_words()),
                Some(Err(reason)) => format!("no estimate: {reason}"),
            };
            facts.push(AssessmentLine { name: "model", text: format!("{}: {text} ({})", kind.name, kind.meaning) });
        }
        if let Some(choice) = stepper.choice() {
            let reason = choice.reason.as_ref().map_or("as given in the scene".to_string(), Clone::clone);
            facts.push(AssessmentLine { name: "model chosen", text: format!("{}: {reason}", choice.kind.name) });
        }
        Ok(facts)
    }

    /// The prediction of each fluid law for the scene's motion, the law that an automatic choice uses, and the effect of the
    /// reactive force. Empty without medium and drag.
    pub fn fluid_models(scene: &Scene, stepper: &Stepper) -> Vec<AssessmentLine> {
        let rod = &stepper.model().rod;
        let Ok(regime) = scene.regime() else { return Vec::new() };
        let mut facts = Vec::new();
        let mut fact = |name, text: String| facts.push(AssessmentLine { name, text });
        let estimates = match &scene.drag {
            Some(_) => scene.check_run_length().and_then(|()| scene.fluid_estimates()),
            None => return vec![AssessmentLine { name: "reactive force", text: describe_added_mass(&regime, rod) }],
        };
        match &estimates {
            Ok(estimates) => {
                for law in &estimates.laws {
                    let below = regime.stokes.filter(|stokes| law.reactive && *stokes < MIN_STOKES_NUMBER);
                    let below = below.map_or(String::new(), |stokes| {
                        format!("; added mass is outside its range: β = {stokes:.1e} (allowed: at least {MIN_STOKES_NUMBER})")
                    });
                    let text = if law.errors == [0.0; 2] {
                        let known = estimates.in_words(estimates.uncertainty);
                        format!("the most accurate of these; published uncertainty {known}")
                    } else {
                        format!(
                            "estimated errors relative to the most accurate law: {}",
                            estimates.in_words(law.errors)
                        )
                    };
                    fact("fluid law", format!("{}: {text}{below}", law.name()));
                }
                if let Some((law, changes)) = scene.nonlocal_drag() {
                    fact(
                        "fluid law",
                        format!(
                            "{}: is valid here and more accurate than these, but is not used: with it {}",
                            law.name,
                            estimates.changes_in_words(changes)
                        ),
                    );
                }
            }
            Err(reason) => fact("fluid law", format!("no estimates: {reason}")),
        }
        let (law, reactive) = scene.fluid_model(rod);
        if let Some(choice) = scene.fluid_choice() {
            fact("fluid chosen", format!("{}: {}", choice.name(), choice.reason));
        }
        let both = estimates.as_ref().ok().zip(law);
        let both =
            both.and_then(|(estimates, law)| Some((estimates, estimates.get(law, true)?, estimates.get(law, false)?)));
        fact(
            "reactive force",
            match both {
                Some((estimates, with, without)) => {
                    let [other, own] = if reactive { [without, with] } else { [with, without] };
                    let changes = estimates.changes_in_words(other.means.differences(&own.means));
                    let which = if reactive { "without it" } else { "with it" };
                    format!(
                        "{which} {changes} (estimated errors are {SAFETY_FACTOR} times such differences); {}",
                        describe_added_mass(&regime, rod)
                    )
                }
                None => describe_added_mass(&regime, rod),
            },
        );
        facts
    }

    fn describe(&mut self, scene: &Scene, stepper: &Stepper, basis: &AssessmentBasis) -> Result<()> {
        let AssessmentBasis { regime, natural, is_coarse, spectrum } = basis;
        let regime = regime.as_ref();
        let rod = &stepper.model().rod;
        let (step, duration) = (scene.typical_step(), scene.solver.duration_s.get());
        let mut fact = |name, text| self.facts.push(AssessmentLine { name, text });
        fact("scene", scene.name.clone());
        fact(
            "rod",
            format!(
                "{} nodes, {} unknowns, spacing {:.4e} m, {:.4e} kg",
                rod.nodes,
                stepper.model().unknowns(),
                rod.spacing,
                rod.total_mass()
            ),
        );
        fact("section", describe_section(rod));
        // The stiffness of the joints, with the profile along the rod.
        let joints = rod.joints();
        let [head, middle, tip] = [joints.start, rod.nodes / 2, joints.end - 1].map(|k| rod.joint_stiffness(k));
        fact(
            "stiffness",
            format!(
                "EI = {head:.4e} N m^2 at the head, {middle:.4e} in the middle, {tip:.4e} at the tip; EA = {:.4e} N",
                rod.ea
            ),
        );
        if let Some(medium) = &scene.medium {
            let density = regime.map_or(medium.density_kg_m3.get(), |regime| regime.across.fluid.density);
            fact("mass over displaced mass", describe_weight(rod, density, scene.head.kind));
        }
        let steps = match stepper.step_control() {
            StepControl::Fixed(step) => {
                let last = scene.spans().last().filter(|last| *last < step);
                let shorter = last.map_or(String::new(), |last| format!(", the last one of {last:e} s"));
                format!("{} steps of {step:e} s{shorter}", scene.steps().unwrap_or_default())
            }
            StepControl::Adaptive(tolerance) => format!("adaptive steps with tolerance {tolerance:e}"),
        };
        fact("solver", format!("{}, {steps}, t = 0 … {duration} s", stepper.method(scene)));
        let rounding = chain::rounding(rod, step);
        fact(
            "form",
            match stepper.form() {
                Form::Positions => format!(
                    "positions: relative rounding error of a linear solve at most about {rounding:.1e}, reduced by Newton's iterations"
                ),
                Form::Chain => format!(
                    "chain: its rounding error does not grow with the number of nodes; relative rounding error of a linear solve for positions up to {rounding:.1e}"
                ),
            },
        );
        let rows = match recorded_size(scene, stepper) {
            Some((rows, size)) => format!("about {rows} rows, {}", bytes(size)),
            None => "one row per time step".to_string(),
        };
        let nodes = match scene.nodes_table() {
            NodesTable::Csv => " and nodes.csv",
            NodesTable::Parquet => " and nodes.parquet",
            NodesTable::None => "; no table of positions",
        };
        fact("output", format!("{rows}, in trajectory.csv{nodes}"));
        let Energy { stretching, bending, kinetic, fluid } = stepper.metrics().now.energy;
        fact(
            "energy at the start",
            format!(
                "{:.4e} J: bending {bending:.4e}, kinetic {kinetic:.4e}, stretching {stretching:.4e}, fluid {fluid:.4e}",
                stretching + bending + kinetic + fluid
            ),
        );
        let on = if *is_coarse { format!(" (on {MAX_NODES_FOR_MODES} nodes)") } else { String::new() };
        let model = stepper.model();
        let with = if model.forces.are_inertial() { "with added mass" } else { "in vacuum" };
        let slack = if scene.has_winches() { ", as if the winches were slack" } else { "" };
        fact("first natural frequency", format!("{} Hz {with}{on}{slack}", significant(self.first_frequency / TAU, 5)));
        let drive = self.frequency_ratio.map(|ratio| ratio * self.first_frequency);
        match &rod.damping {
            Some(damping) => {
                let given = scene.actuation.is_some() && damping.rate == DampedRate::Elastic;
                fact(
                    "damping of the material",
                    describe_damping(damping, rod, natural.all()?, drive.map(|omega| (omega, given))),
                )
            }
            None if scene.rod.youngs_modulus_pa.is_some_and(|modulus| modulus.get() < MAX_SOFT_MODULUS_PA) => fact(
                "damping of the material",
                "none; rubber and silicone as soft as this usually have a loss factor of 0.05 to 0.3 (rod.loss_factor)"
                    .to_string(),
            ),
            None => {}
        }
        if let (Some(tau), Some((_, drive))) = (model.lag, &model.actuation) {
            let part = lag::steady(tau, TAU * drive.frequency)(1.0);
            let text = format!(
                "{} s: at {} Hz it reaches {:.1} % of the command, {:.1}° late",
                significant(tau, 5),
                significant(drive.frequency, 5),
                100.0 * part.norm(),
                -part.arg().to_degrees()
            );
            fact("lag of the drive", text);
        }
        if let Some(hinge) = &model.hinge {
            fact("hinge", describe_hinge(hinge, rod));
        }
        for tendon in model.tendons.iter() {
            fact("tendon", describe_tendon(tendon, rod));
        }
        let tip = match regime {
            Ok(_) if model.head.is_none() => " m, half of the tip's range of motion about the centre of mass",
            Ok(_) => " m, half of the tip's range of motion",
            Err(_) => " m, half of the tip's range of motion in the prescribed shape",
        };
        let resists = rod.damping.as_ref().is_some_and(|damping| damping.rate == DampedRate::Whole);
        let drives = scene.drives();
        let followed = if stepper.model().active_moments && resists {
            ": far below 1 the moments bend the rod quasi-statically, reduced and delayed according to tan δ at the drive frequency"
        } else if stepper.model().active_moments {
            ": far below 1 the moments bend the rod quasi-statically"
        } else if resists && drives.actuation {
            ": far below 1 the rod follows its natural curvature, reduced and delayed according to tan δ at the drive frequency"
        } else if drives.tendons && !drives.actuation {
            ": far below 1 the tendons bend the rod quasi-statically"
        } else if let (false, Some(hinge)) = (drives.actuation, &model.hinge) {
            if hinge.stiffness > 0.0 {
                ": far below 1 the head follows the command of its servo, and the rod does not bend"
            } else {
                ": far below 1 the rod turns with its head without bending"
            }
        } else if !drives.actuation {
            ": far below 1 the rod follows its head without bending"
        } else {
            ": far below 1 the rod follows its natural curvature"
        };
        let is_along = regime.is_ok_and(|regime| regime.across.counted().1);
        let reynolds = if is_along {
            ", ρwD/μ with a tenth of the speed along the rod as w"
        } else {
            ", ρwD/μ with the speed w across the rod"
        };
        let numbers = [
            ("tip amplitude", self.tip_amplitude, tip),
            ("Reynolds number", self.reynolds, reynolds),
            ("frequency ratio ω/ω₁", self.frequency_ratio, followed),
            ("sperm number", self.sperm_number, ", L(ξ⊥ω/EI)^¼: below about 1 the fluid does not bend the rod"),
            ("inertia against drag", self.inertia_ratio, ", ω(ρA + m_a)/ξ⊥ with the added mass m_a"),
        ];
        for (name, value, meaning) in numbers {
            if let Some(value) = value {
                fact(name, format!("{value:.4e}{meaning}"));
            }
        }
        if let (Err(reason), true) = (regime, scene.medium.is_some()) {
            fact("flow around the rod", format!("not known: {reason}"));
        }
        self.describe_fluid(scene, stepper.model(), regime.ok(), spectrum)
    }

    /// The forces of the fluid, the flow around the rod, and alternative laws.
    fn describe_fluid(
        &mut self,
        scene: &Scene,
        model: &Model,
        regime: Option<&Regime>,
        spectrum: &Spectrum,
    ) -> Result<()> {
        let Model { rod, forces, .. } = model;
        let height = scene.drag.as_ref().and_then(|drag| drag.height_m).map(Positive::get);
        self.describe_body(model, regime, height);
        let Some(regime) = regime else { return Ok(()) };
        let motion = scene.motion(rod, regime.across);
        self.ranges = scene.range_notes(forces, rod, regime.across);
        let mut fact = |name, text| self.facts.push(AssessmentLine { name, text });
        for force in forces.iter() {
            let validity = force.validity();
            let takes = match DragLaw::named(force.name()) {
                Some(law) if rod.sections.is_flat() => format!("; it uses {}", law.takes.in_words()),
                _ => String::new(),
            };
            fact("force", format!("{}: valid for {} ({}){takes}", force.name(), validity.in_words(), validity.source));
        }
        if regime.reynolds > 0.0 {
            let across = format!("{:.3e} m/s across the rod", regime.across.speed);
            let speed = match regime.across.counted() {
                (_, true) => format!(
                    "a tenth of {:.3e} m/s along the rod, because no rod is aligned exactly with a flow ({across})",
                    regime.along
                ),
                _ => across,
            };
            fact(
                "flow around the rod",
                format!(
                    "Re_d = {:.3e} with the depth of {:.3e} m and {speed}; length over radius {:.1}",
                    regime.reynolds, regime.depth, regime.slenderness
                ),
            );
        }
        if let (Some(stokes), Some(carpenter)) = (regime.stokes, regime.keulegan_carpenter) {
            let sea = if stokes < MIN_STOKES_NUMBER { "; added mass is larger by 4/√(πβ)" } else { "" };
            fact(
                "oscillation",
                format!(
                    "β = fD²/ν = {stokes:.3e}{sea}, KC = {carpenter:.3e}, added mass over the rod's mass {:.3e}",
                    regime.mass_ratio
                ),
            );
        }
        self.describe_media(scene, model, regime);
        let mut fact = |name, text| self.facts.push(AssessmentLine { name, text });
        // Along and across the rod, at the speed of the motion.
        let speed = if regime.reynolds > 0.0 { regime.counted_speed() } else { 1e-9 * rod.length };
        let coefficients = |forces: &Forces, rod: &Rod| forces.coefficients(rod, regime.across.fluid, speed);
        let Some([along, across]) = coefficients(forces, rod) else { return Ok(()) };
        fact(
            "drag per length and speed",
            format!("{along:.4e} N s/m^2 along, {across:.4e} across, at {speed:.3e} m/s"),
        );
        let Model { rod, forces, .. } = &scene.with_nodes_up_to(MAX_NODES_FOR_LAWS).model()?;
        let Some([along, across]) = coefficients(forces, rod).filter(|[along, _]| *along > 0.0) else { return Ok(()) };
        let own: Vec<&str> = forces.iter().map(Force::name).collect();
        let law_inputs = LawInputs {
            wavelength: scene.wavelength(),
            frequency: spectrum.strongest(),
            height: motion.height.unwrap_or(f64::INFINITY),
            ..LawInputs::plain(rod)
        };
        let radius = rod.sections.largest_radius();
        let slender = |law: &DragLaw| {
            law.slender.is_some_and(|slender| (slender(&law_inputs) / radius).ln() >= MIN_LOG_SLENDERNESS)
        };
        let offered = |law: &DragLaw| law.is_offered(motion.height.is_some()) && !own.contains(&law.name);
        let others = LAWS
            .iter()
            .filter(|law| offered(law) && slender(law) && law.validity.holds(&motion) && law.reach.allows(&law_inputs));
        let says = |law: &&DragLaw| {
            let [t, n] = coefficients(&Forces(vec![(law.build)(&law_inputs)]), rod)?;
            let percent = |x: f64, own: f64| signed(100.0 * (x / own - 1.0), 0);
            Some(format!("{} {} % along, {} % across", law.name, percent(t, along), percent(n, across)))
        };
        let texts: Vec<String> = others.filter_map(says).collect();
        if !texts.is_empty() {
            fact("other valid laws", texts.join("; "));
        }
        Ok(())
    }

    /// The body at the head, and its drag.
    fn describe_body(&mut self, model: &Model, regime: Option<&Regime>, height: Option<f64>) {
        let Model { rod, forces, fluid, .. } = model;
        let Some(body) = rod.body else { return };
        let mut fact = |text| self.facts.push(AssessmentLine { name: "head body", text });
        let form = if body.along > body.across {
            "prolate spheroid"
        } else if body.along < body.across {
            "oblate spheroid"
        } else {
            "sphere"
        };
        fact(format!(
            "{form} of semi-axes {:.4e} m along and {:.4e} m across, {:.4e} kg; its centre is node 0, the rod begins at node 1",
            body.along, body.across, rod.mass[0]
        ));
        if forces.iter().any(|force| force.name() == body::DRAG) {
            let reynolds = regime.map_or(0.0, |regime| regime.across.body * 2.0 * body.along.max(body.across));
            let drag = height.map_or_else(|| body.drag(), |height| body.drag_beside(height));
            let [along, across, turning] = drag.map(|drag| drag * fluid.viscosity);
            fact(format!(
                "Stokes drag {along:.4e} N s/m along, {across:.4e} N s/m across, {turning:.4e} N m s for rotation; Re = {reynolds:.3e} with its longest axis and its speed"
            ));
        }
        if forces.iter().any(|force| force.name() == body::INERTIA) {
            let [along, across, turning] = body.added().map(|added| added * fluid.density);
            fact(format!(
                "added mass {along:.4e} kg along, {across:.4e} kg across, added moment of inertia {turning:.4e} kg m^2"
            ));
        }
    }

    /// The layers of the medium, and the speed at which the rod crosses their interfaces.
    fn describe_media(&mut self, scene: &Scene, model: &Model, regime: &Regime) {
        let Some(layers) = model.layers else { return };
        let rod = &model.rod;
        let mut fact = |name, text| self.facts.push(AssessmentLine { name, text });
        if layers.shear != 0.0 {
            let [x, y]: [f64; 2] = layers.normal.into();
            let [x, y] = [x, y].map(|part| significant(part, 4));
            fact("shear flow", format!("shear rate {:.4e} 1/s along [{x}, {y}]; it affects only drag", layers.shear));
        }
        let Some(medium) = scene.medium.as_ref().filter(|_| layers.iter().len() > 0) else { return };
        let (radius, spacing) = (rod.sections.outer.largest(), rod.spacing);
        let gravity = scene.loads.as_ref().and_then(|loads| loads.gravity_m_s2);
        let gravity = gravity.map_or(0.0, |gravity| regime::size(gravity.map(Finite::get)));
        let mut before = [medium.density_kg_m3.get(), medium.viscosity_pa_s.get()];
        for (i, layer) in layers.iter().enumerate() {
            let here = [layer.fluid.density, layer.fluid.viscosity];
            fact(
                "interface",
                format!(
                    "{} at {:.4e} m along [{}, {}], {:.3e} m thick: {:.2} radii, {:.2} node spacings; from {:.4e} kg/m^3, {:.4e} Pa s to {:.4e}, {:.4e} (Re_d {:.3e} there)",
                    i + 1,
                    layer.offset,
                    significant(layers.normal.x, 4),
                    significant(layers.normal.y, 4),
                    layer.thickness,
                    layer.thickness / radius,
                    layer.thickness / spacing,
                    before[0],
                    before[1],
                    here[0],
                    here[1],
                    here[0] * regime.counted_speed() * regime.depth / here[1]
                ),
            );
            before = here;
        }
        let speed = regime.counted_speed();
        if speed > 0.0 {
            // For waves on the interface of two liquids, gravity is reduced by the relative difference of their densities.
            let densities =
                std::iter::once(medium.density_kg_m3.get()).chain(layers.iter().map(|layer| layer.fluid.density));
            let densities: Vec<f64> = densities.collect();
            let reduced = densities.windows(2).map(|pair| gravity * (pair[1] - pair[0]).abs() / pair[0].max(pair[1]));
            let least = reduced.filter(|reduced| *reduced > 0.0).fold(f64::INFINITY, f64::min);
            let froude = least.is_finite().then(|| {
                let froude = speed / (least * regime.depth).sqrt();
                format!("Froude number w/√(g′D) = {froude:.3e} with g′ = gΔρ/ρ = {least:.3e} m/s^2, ")
            });
            let heaviest = layers.iter().map(|layer| layer.fluid.density).fold(medium.density_kg_m3.get(), f64::max);
            fact(
                "crossing",
                format!(
                    "{}Weber number ρw²D/σ = {:.3e} with the surface tension of water against air; not modelled: waves (Froude numbers around 1), cavities (well above 1), surface tension (Weber numbers around 1 and below), air cushions",
                    froude.unwrap_or_default(),
                    heaviest * speed.powi(2) * regime.depth / SURFACE_TENSION
                ),
            );
        }
    }

    /// Warns of interfaces that nodes cross abruptly, and of a medium that would not stay at rest.
    fn warn_of_media(&mut self, scene: &Scene, model: &Model) {
        let Some((layers, medium)) = model.layers.zip(scene.medium.as_ref()) else { return };
        let rod = &model.rod;
        let (radius, spacing) = (rod.sections.outer.largest(), rod.spacing);
        let thin = 2.0 * radius.max(spacing);
        for (i, layer) in layers.iter().enumerate().filter(|(_, layer)| layer.thickness < thin) {
            let nodes = (2.0 * rod.length / layer.thickness).ceil() + 1.0;
            // More nodes do not help if the rod itself is thicker than the interface.
            let finer =
                if layer.thickness >= 2.0 * radius { format!(", or at least {nodes} nodes") } else { String::new() };
            self.warnings.push(format!(
                "interface {} is {:.2e} m thick, below twice the rod's radius ({radius:.2e} m) or the node spacing ({spacing:.2e} m): nodes cross it abruptly; use a thickness of at least {:.1e} m{finer}",
                i + 1, layer.thickness, rounded_up(thin)
            ));
        }
        let gravity = scene.loads.as_ref().and_then(|loads| loads.gravity_m_s2);
        let up = layers.normal.dot(&gravity.map_or(Vector2::zeros(), |gravity| gravity.map(Finite::get).into()));
        let densities: Vec<f64> =
            std::iter::once(medium.density_kg_m3.get()).chain(layers.iter().map(|layer| layer.fluid.density)).collect();
        if densities.windows(2).any(|pair| (pair[1] - pair[0]) * up < 0.0) {
            self.warnings
                .push("a denser fluid lies above a lighter one: this layering is unstable at rest".to_string());
        }
    }

    /// Warns of tendons that run outside the body.
    fn warn_of_tendons(&mut self, model: &Model) {
        let rod = &model.rod;
        for (i, tendon) in model.tendons.iter().enumerate() {
            let nodes = tendon.edges.start..=tendon.edges.end;
            let widths = nodes.map(|k| (rod.xi(k), rod.sections.outer.at(rod.xi(k))));
            let Some((xi, half)) = widths.min_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
            if tendon.offset.abs() > half * (1.0 + 1e-9) {
                self.warnings.push(format!(
                    "tendon {} runs outside of the body: its distance from the centreline is {} m, and at xi = {} the body reaches {} m to either side; it needs guides there, or a smaller offset_m",
                    i + 1,
                    significant(tendon.offset.abs(), 3),
                    significant(xi, 3),
                    significant(half, 3)
                ));
            }
        }
    }

    /// Warns if a passive tail, without internal drive, has too few nodes for the waves that its head or the flow sends along it.
    /// With their wavenumber k⁴ = ω√(ξ⊥² + ω²(ρA + m_a)²)/EI the relative error of its thrust is 0.4 (kΔL)² (measured, in oil and
    /// in water, for kL of 0.4 to 21).
    fn warn_of_waves(&mut self, scene: &Scene, rod: &Rod) {
        let numbers = self.sperm_number.zip(self.inertia_ratio).filter(|_| !scene.drives().bend());
        let Some(waves) = numbers.map(|(sperm, inertia)| sperm * (1.0 + inertia * inertia).powf(0.125)) else { return };
        let turning = waves * rod.spacing / rod.length;
        if turning > MAX_WAVE_PHASE {
            self.warnings.push(format!(
                "the mesh is coarse for the bending waves along this passive tail: kΔL = {turning:.2} with their wavenumber k (allowed: up to {MAX_WAVE_PHASE}, where the error of the thrust is 10 %); use at least {:.0} nodes for an error of 2.5 %",
                (2.0 * waves / MAX_WAVE_PHASE).ceil() + 1.0
            ));
        }
    }

    /// Warns of steps with which the scene's method amplifies a natural mode.
    fn warn_of_limit(&mut self, scene: &Scene, stepper: &Stepper, natural: &LazyModes) -> Result<()> {
        if stepper.view().dynamics.mechanics == Mechanics::Full
            && let StepControl::Fixed(step) = stepper.step_control()
            && let Some(StableSteps { largest, frequency, limit }) =
                natural.stable_steps_below(step, &*scene.integrator()?, stepper.model().rod.damping.as_ref())?
        {
            let named = Method::named(scene.integrator_name()).filter(|method| method.implicit);
            let other = named.map_or("an implicit method".to_string(), |method| {
                format!("other parameters of {}, which is {}", method.name, method.stability)
            });
            let hertz = significant(frequency / TAU, 4);
            let whose = if natural.winches > 0.0 {
                "the highest frequency of rod and taut winches, at most"
            } else {
                "the rod's natural frequency of"
            };
            self.warnings.push(if largest > 0.0 {
                format!(
                    "the time step exceeds the stability limit of the method: ωΔt = {:.3} at {whose} {hertz} Hz (allowed: up to {}); use solver.time_step_s = {:e} or less, or {other}",
                    step * frequency,
                    significant(limit, 4),
                    rounded_down(largest)
                )
            } else {
                format!("the method amplifies {whose} {hertz} Hz at any time step; use {other}")
            });
        }
        Ok(())
    }

    fn warn(&mut self, scene: &Scene, stepper: &Stepper, drive: &DriveShape, omega: Option<f64>) {
        let rod = &stepper.model().rod;
        let step = scene.typical_step();
        let warnings = &mut self.warnings;
        warnings.extend(scene.fluid_note());
        if stepper.model().forces.iter().any(|force| force.name() == laws::stokes_like::LAW.name) {
            let range = laws::stokes_like::LAW.validity.range;
            let creeping = self.reynolds.is_none_or(|reynolds| reynolds <= CREEPING);
            let fitting = if creeping { &laws::cox::LAW } else { &laws::cross_flow::LAW };
            let holds = |without: String| format!("; drag.law = \"{}\"{without} is valid here", fitting.name);
            let advice = scene.without(fitting).map_or(String::new(), holds);
            warnings.push(format!("drag.law = \"stokes-like\" is intended for {range}{advice}"));
        }
        let asked = stepper.choice().is_some_and(|choice| choice.reason.is_none());
        if asked && stepper.view().dynamics.mechanics == Mechanics::Shape && !scene.drives().bend() {
            warnings.push(
                "solver.model = \"shape\" prescribes the natural shape of the rod, which is constant without [actuation]: a passive tail does not bend; use model = \"full\" or \"overdamped\"".to_string(),
            );
        }
        if scene.head.kind == HeadKind::Driven
            && scene.head.position_m.is_none()
            && scene.head.angle_rad.is_none()
            && scene.head.input.is_none()
        {
            warnings.push(
                "head.kind = \"driven\" has neither head.position_m nor head.angle_rad: the head stands still unless a host moves it".to_string(),
            );
        }
        let keys = ["head.position_m.0", "head.position_m.1", "head.angle_rad"];
        let signals = || keys.into_iter().zip(stepper.model().head.iter().flatten());
        let is_zero = |signal: &Signal| matches!(signal, Signal::Sinusoid { amplitude: 0.0, .. });
        // If one function of time moves two coordinates, one of them may stay constant.
        let moves = signals().any(|(_, signal)| !is_zero(signal) && !matches!(signal, Signal::Constant(_)));
        if let Some((key, _)) = signals().find(|(_, signal)| is_zero(signal)).filter(|_| !moves) {
            warnings.push(format!("{key} has an amplitude of 0: the head stands still unless a host moves it"));
        }
        if drive.sharpest_turning == 0.0
            && let Some(actuation) = &scene.actuation
        {
            let key = actuation.amplitude_key();
            warnings.push(match actuation.amplitude() {
                0.0 => format!("{key} = 0: the actuation does nothing unless a host changes it"),
                _ => "actuation.envelope or actuation.amplitude_profile is 0 along the whole rod: the actuation does nothing".to_string(),
            });
        }
        if drive.rests_straight {
            warnings.push(
                "actuation.frequency_hz = 0 holds this wave at a phase at which it does not bend the rod; actuation.phase_profile_rad = [[0.0, -1.5708], [1.0, -1.5708]] holds it at its crest".to_string(),
            );
        }
        // With a tolerance, the steps are checked against the tolerance.
        let fixed = match stepper.step_control() {
            StepControl::Fixed(step) => Some(step),
            StepControl::Adaptive(_) => None,
        };
        let coarse = omega.zip(fixed).map(|(omega, step)| (TAU / (omega * step), TAU / omega));
        // Rounding must not cause a warning.
        if let Some((steps, period)) = coarse.filter(|(steps, _)| *steps < MIN_STEPS_PER_PERIOD * (1.0 - 1e-9)) {
            warnings.push(format!(
                "the time step is too large: {steps:.3} steps per period of the drive; use at least {MIN_STEPS_PER_PERIOD}, solver.time_step_s = {:e}",
                rounded_down(period / MIN_STEPS_PER_PERIOD)
            ));
        }
        let now = &stepper.metrics().now;
        let strained = stepper.metrics().first_energy.max(now.imbalance(rod)) > 0.0;
        let bent = stepper.model().initial_curvature.iter().flatten().any(|kappa| *kappa != 0.0);
        let jumps = scene.is_released();
        if strained && (jumps || bent) {
            let [start, advice] = if bent {
                let longest = rounded_down(MAX_RESOLVED_PHASE / self.first_frequency);
                [
                    "the release from the initial curvature".to_string(),
                    format!("a step of at most {longest:e} s resolves the slowest of them"),
                ]
            } else {
                let jump = scene.start.kind == StartKind::Jump;
                let shaped = jump && scene.actuation.is_some() && !stepper.model().active_moments;
                let smooth = if shaped { "shaped" } else { "ramp" };
                let start = if jump { "the jump start" } else { "the shaped start with winches that are taut at once" };
                [start.to_string(), format!("start.kind = \"{smooth}\" avoids them")]
            };
            let rings =
                format!("{start} excites vibrations at {} Hz and above", significant(self.first_frequency / TAU, 4));
            match fixed.map(|step| self.first_frequency * step) {
                Some(ringing) if ringing > MAX_RESOLVED_PHASE => warnings.push(format!(
                    "{rings}, which the time step does not resolve (ω₁Δt = {ringing:.3}): the result depends on the time step and the method; {advice}"
                )),
                Some(_) => {}
                None if bent => {}
                None => warnings.push(format!(
                    "{rings}: adaptive steps resolve them only as far as the tolerance requires, and the result may depend on it; {advice}"
                )),
            }
        }
        let ratio = self.frequency_ratio.filter(|ratio| *ratio > MAX_SHAPED_FREQUENCY_RATIO);
        if let Some(ratio) = ratio.filter(|_| scene.start.kind == StartKind::Shaped && stepper.model().active_moments) {
            warnings.push(format!(
                "the shaped start sets the shape and velocity of quasi-static bending, which the rod does not reach at {ratio:.1} times its first natural frequency: the excess energy decays slowly; use start.kind = \"ramp\""
            ));
        }
        if drive.sharpest_turning > FRAC_PI_4 {
            let degrees = drive.sharpest_turning.to_degrees();
            warnings.push(if stepper.model().active_moments {
                format!(
                    "without fluid these moments would bend a joint by up to {degrees:.0}°: if the run comes close to that, as in resonance, use more nodes, or smaller moments where the body is thin (actuation.amplitude_profile)"
                )
            } else {
                format!(
                    "the mesh is coarse for this actuation: it bends a joint by up to {degrees:.0}°; use more nodes to stay below 45°"
                )
            });
        }
        // The chain form's rounding error does not grow with the mesh, and the shape model does not solve for positions.
        if stepper.form() == Form::Positions && stepper.view().dynamics.mechanics != Mechanics::Shape {
            let rounding = chain::rounding(rod, step);
            if let Some(problem) = chain::too_fine(rod, step) {
                warnings.push(format!("rod.nodes: {problem}"));
            } else if rounding > chain::ACCURACY {
                warnings.push(format!("the mesh is so fine that a linear solve for positions has a relative error of up to {rounding:.1e}: Newton's method needs more iterations, and moments lose digits"));
            }
        }
        if rod.spacing < rod.sections.outer.largest() {
            warnings.push(format!(
                "the node spacing ({:.2e} m) is below the rod's radius: finer meshes still converge to beam theory, which describes no details of the body smaller than its radius",
                rod.spacing
            ));
        }
    }
}

/// A positive number, rounded up to two digits.
fn rounded_up(x: f64) -> f64 {
    let exponent = x.log10().floor() as i32 - 1;
    let digits = (x / 10.0_f64.powi(exponent) * (1.0 - 1e-12)).ceil();
    format!("{digits}e{exponent}").parse().unwrap_or(x)
}

/// A description of the section in the middle of `rod`.
fn describe_section(rod: &Rod) -> String {
    let (sections, section) = (&rod.sections, rod.sections.at(0.5));
    let (thickness, depth) = (2.0 * section.outer, section.depth);
    let shape = sections.shape.name();
    let outline = match sections.shape {
        Shape::Round if sections.is_flat() => format!(
            "{shape}, a core {thickness:.4e} m thick with a membrane {depth:.4e} m deep that only affects the fluid forces"
        ),
        Shape::Round => format!("{shape}, {thickness:.4e} m thick"),
        Shape::Ellipse | Shape::Rectangle => {
            format!("{shape}, {thickness:.4e} m thick in the plane of motion, {depth:.4e} m deep across it")
        }
    };
    let hole = if section.inner > 0.0 { format!(", the hole {:.4e} m", 2.0 * section.inner) } else { String::new() };
    let at = if sections.profiles().all(Profile::is_even) { "" } else { ", in the middle" };
    format!("{outline}{hole}{at}")
}

/// The inertia that turns with a hinge, and the oscillation of its servo with the straight rod.
fn describe_hinge(hinge: &Hinge, rod: &Rod) -> String {
    let tail = rod.inertia_about_head();
    let whole = hinge.inertia + tail;
    let mut text = format!(
        "{} kg m^2; straight rod about its head {} kg m^2",
        significant(hinge.inertia, 3),
        significant(tail, 3)
    );
    if hinge.stiffness > 0.0 {
        let omega = (hinge.stiffness / whole).sqrt();
        text += &format!(
            "; on its servo the rigid rod oscillates at {} Hz in vacuum, damping ratio {}",
            significant(omega / TAU, 3),
            significant(0.5 * hinge.damping / (whole * omega), 3)
        );
    }
    text
}

/// The course of a tendon, its length at rest, and the bending and strain that it causes in the unloaded rod per newton.
fn describe_tendon(tendon: &Tendon, rod: &Rod) -> String {
    let side = if tendon.offset < 0.0 { "right" } else { "left" };
    let length = rod.spacing * tendon.edges.len() as f64;
    let middle = (tendon.joints.start + tendon.joints.end) / 2;
    let pull = tendon.winch().map_or(String::new(), |winch| {
        let [least, most] = winch.length.range();
        let given = if least == most {
            significant(least, 4)
        } else {
            format!("{} to {}", significant(least, 4), significant(most, 4))
        };
        let slack = if least >= length { ", slack along the straight rod" } else { "" };
        format!(
            "; a winch sets its length to {given} m through a cable of {} N/m, with a take-up of {} m{slack}",
            significant(winch.stiffness, 3),
            significant(winch.take_up, 3)
        )
    });
    format!(
        "{} m to the {side}, along nodes {} to {}, {} m long at rest; in its middle a tension of 1 N bends the rod at rest by {} 1/m{pull}",
        significant(tendon.offset.abs(), 3),
        tendon.edges.start,
        tendon.edges.end,
        significant(length, 4),
        significant(tendon.offset / rod.joint_stiffness(middle), 3)
    )
}

/// Describes the `damping` of a `rod` with these natural `modes`, driven at a frequency (rad/s), if any; `given` is true if a
/// natural curvature whose rate is not resisted drives it. Kelvin–Voigt: C = τK, so ζ = τω/2 for every mode, and tan δ = τω at
/// any frequency.
fn describe_damping(damping: &Damping, rod: &Rod, modes: &Modes, drive: Option<(f64, bool)>) -> String {
    let Some(time) = damping.uniform(rod) else {
        let [least, most] = damping.range(rod).map(|time| significant(time, 3));
        return format!(
            "τ = {least} to {most} s in bending along the rod; {} the damping ratios of its modes",
            Phrase::TellsModes
        );
    };
    let ratios: Vec<String> = modes.bending.iter().take(3).map(|omega| significant(0.5 * time * omega, 3)).collect();
    let mut text =
        format!("τ = {} s in bending, damping ratios of the first modes {}", significant(time, 3), ratios.join(", "));
    let critical = modes.bending.iter().position(|omega| time * omega >= 2.0);
    if let Some(mode) = critical {
        text += &format!("; overdamped from mode {} on", mode + 1);
    }
    let Some(((omega, given), first)) = drive.zip(modes.bending.first()) else { return text };
    text += &format!(
        "; loss factor {} at the {} Hz of the drive",
        significant(time * omega, 3),
        significant(omega / TAU, 3)
    );
    // The response of the first mode at this frequency, with and without damping.
    let square = 1.0 - (omega / first).powi(2);
    let driven = if given { 1.0_f64.hypot(time * omega) } else { 1.0 };
    let without = square.hypot(time * omega) / (square.abs() * driven);
    if without > MIN_REPORTED_FACTOR {
        text += &format!(
            "; in vacuum the first mode would respond {} times as strongly without damping",
            significant(without, 2)
        );
    }
    text
}

/// The mass of `rod`, with its body, relative to the mass of a fluid of this `density` (kg/m³) that it displaces, and the
/// consequences.
fn describe_weight(rod: &Rod, density: f64, head: HeadKind) -> String {
    let ratio = rod.total_mass() / (density * rod.displaced_volume());
    match head {
        HeadKind::Free if ratio > 1.0 + NEUTRAL_BUOYANCY_MARGIN => {
            format!("{ratio:.3}: heavier than the fluid, it sinks if nothing holds it")
        }
        HeadKind::Free if ratio < 1.0 - NEUTRAL_BUOYANCY_MARGIN => {
            format!("{ratio:.3}: lighter than the fluid, it floats up if nothing holds it")
        }
        _ => format!("{ratio:.3}"),
    }
}

/// A positive number, rounded down to two digits.
fn rounded_down(x: f64) -> f64 {
    let exponent = x.log10().floor() as i32 - 1;
    let digits = (x / 10.0_f64.powi(exponent) * (1.0 + 1e-12)).floor();
    format!("{digits}e{exponent}").parse().unwrap_or(x)
}

/// The effect of added mass on the frequencies of `rod`, and whether the rod is slender enough for the theory.
fn describe_added_mass(regime: &Regime, rod: &Rod) -> String {
    let slows = 100.0 * (1.0 - 1.0 / (1.0 + regime.mass_ratio).sqrt());
    let slender = regime.depth / rod.length;
    let decides = if regime.water_decides_stability() {
        format!(
            "; it may decide whether the rod is stable, which a motion from rest need not show (¼πρD²U²L²/EI = {}; a clamped rod under a follower force at its tip flutters at {})",
            two_digits(regime.flow_velocity.powi(2)),
            regime::BECK
        )
    } else {
        String::new()
    };
    format!("it lowers the natural frequencies by {slows:.1} %; depth over length {slender:.3}{decides}")
}

/// Half the tip's range of motion (m) in the shape that the actuation prescribes.
fn prescribed_tip(model: &Model) -> Option<f64> {
    let head = model.head.as_ref().map(|motion| pose(motion, 0.0));
    let (_, drive) = model.actuation.as_ref()?;
    if drive.frequency == 0.0 {
        return Some(0.0);
    }
    let shapes = regime::shapes(model, head.as_ref());
    let tips: Vec<_> = shapes.map(|shape| node(&shape.q, model.rod.nodes - 1)).collect();
    Some(regime::half_width(&tips))
}

/// Drag across the rod per length and speed in `fluid`, N s/m²; for a nonlocal law, that of the default law.
fn resistance(scene: &Scene, model: &Model, fluid: Fluid) -> Option<f64> {
    let Model { rod, forces, .. } = model;
    let own = || forces.resistance(rod, fluid);
    let local = || {
        let law_inputs = LawInputs { wavelength: scene.wavelength(), ..LawInputs::plain(rod) };
        Forces(vec![(laws::DEFAULT.build)(&law_inputs)]).resistance(rod, fluid)
    };
    let [_, across] = if scene.has_nonlocal_drag() { local() } else { own() }?;
    Some(across)
}

/// Properties of the shape that the actuation prescribes.
struct DriveShape {
    /// Largest rotation of a joint, rad.
    sharpest_turning: f64,
    /// True if its frequency is zero and it bends nothing at its constant phase.
    rests_straight: bool,
}

impl DriveShape {
    /// Properties for `model`, evaluated for a rod whose node spacing is `finer` times that of the model.
    fn of(model: &Model, finer: f64) -> Self {
        let largest = |values: &[f64]| values.iter().fold(0.0, |max: f64, k| max.max(k.abs()));
        let sharpest = |phase: f64| largest(&model.natural_curvature(phase)[model.rod.joints()]);
        let rests = |drive: Drive| drive.frequency == 0.0 && drive.amplitude != 0.0;
        let straight = |phase: f64| largest(&model.natural_curvature(phase));
        Self {
            sharpest_turning: (0..16)
                .map(|i| bend::turning(finer * sharpest(TAU * f64::from(i) / 16.0)))
                .fold(0.0, f64::max),
            rests_straight: model.actuation.as_ref().is_some_and(|(_, drive)| rests(*drive))
                && straight(0.0) < 1e-6 * straight(FRAC_PI_2),
        }
    }
}
