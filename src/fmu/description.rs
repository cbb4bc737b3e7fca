//! `modelDescription.xml`: the FMI variables of a scene with units, start values, causality and dependencies.

use std::collections::HashMap;
use std::io::Result;

use quick_xml::events::{BytesDecl, Event};
use quick_xml::writer::{ElementWriter, Writer};

use super::catalogue::{Catalogue, LOG_CATEGORIES, NODES, Standard, Target};
use super::component::Fmu;
use crate::integrator::StepControl;
use crate::scene;
use crate::scene::parameter::ScalarParameter;
use crate::stepper::Stepper;
use crate::variable::{Causality, Size, VARIABLES, Variable};

pub(super) type Xml = Writer<Vec<u8>>;
type Attributes = Vec<(&'static str, String)>;

/// A unit: name, quantity, exponents of kg, m, s and rad, and a display unit with its factor.
struct Unit(&'static str, &'static str, [i32; 4], Option<(&'static str, f64)>);

/// The units of all variables and parameters.
const UNITS: [Unit; 25] = [
    Unit("s", "Time", [0, 0, 1, 0], Some(("ms", 1e3))),
    Unit("m", "Length", [0, 1, 0, 0], Some(("mm", 1e3))),
    Unit("m/s", "Velocity", [0, 1, -1, 0], Some(("mm/s", 1e3))),
    Unit("m/s^2", "Acceleration", [0, 1, -2, 0], None),
    Unit("1/m", "Curvature", [0, -1, 0, 0], None),
    Unit("rad", "Angle", [0, 0, 0, 1], Some(("deg", 180.0 / std::f64::consts::PI))),
    Unit("rad/s", "AngularVelocity", [0, 0, -1, 1], Some(("deg/s", 180.0 / std::f64::consts::PI))),
    Unit("rad/s^2", "AngularAcceleration", [0, 0, -2, 1], None),
    Unit("Hz", "Frequency", [0, 0, -1, 0], None),
    Unit("kg", "Mass", [1, 0, 0, 0], Some(("g", 1e3))),
    Unit("kg/m^3", "Density", [1, -3, 0, 0], Some(("g/cm^3", 1e-3))),
    Unit("N", "Force", [1, 1, -2, 0], Some(("mN", 1e3))),
    Unit("N m", "Moment", [1, 2, -2, 0], Some(("mN m", 1e3))),
    Unit("N/m", "Stiffness", [1, 0, -2, 0], None),
    Unit("N m/rad", "RotationalStiffness", [1, 2, -2, -1], None),
    Unit("N m s/rad", "RotationalDamping", [1, 2, -1, -1], None),
    Unit("kg m^2", "MomentOfInertia", [1, 2, 0, 0], None),
    Unit("N m^2", "BendingStiffness", [1, 3, -2, 0], None),
    Unit("N s", "Momentum", [1, 1, -1, 0], None),
    Unit("J", "Energy", [1, 2, -2, 0], Some(("mJ", 1e3))),
    Unit("W", "Power", [1, 2, -3, 0], Some(("mW", 1e3))),
    Unit("Pa", "Pressure", [1, -1, -2, 0], Some(("MPa", 1e-6))),
    Unit("Pa s", "Viscosity", [1, -1, -1, 0], Some(("mPa s", 1e3))),
    Unit("N s/m^2", "DragPerLength", [1, -1, -1, 0], None),
    Unit("1/s", "Rate", [0, 0, -1, 0], None),
];

fn unit(name: &str) -> Option<&'static Unit> {
    UNITS.iter().find(|unit| unit.0 == name)
}

/// A number for XML Schema: the shortest text that parses to the same bits.
fn number(x: f64) -> String {
    format!("{x:?}")
}

/// Numbers separated by spaces.
fn numbers(values: impl Iterator<Item = f64>) -> String {
    values.map(number).collect::<Vec<_>>().join(" ")
}

fn list(values: impl Iterator<Item = u32>) -> String {
    values.map(|x| x.to_string()).collect::<Vec<_>>().join(" ")
}

/// Nominal values by unit, from the rod's length, stiffness and mass.
fn nominal(unit: &str, stepper: &Stepper) -> Option<f64> {
    let rod = &stepper.model().rod;
    let (length, force) = (rod.length, rod.ei / rod.length.powi(2));
    let frequency = match &stepper.model().actuation {
        Some((_, drive)) if drive.frequency > 0.0 => drive.frequency,
        _ => 1.0,
    };
    let size = match unit {
        "m" => length,
        "m/s" => length * frequency,
        "1/m" => 1.0 / length,
        "N" => force,
        "N m" | "J" => force * length,
        "W" => force * length * frequency,
        "N m^2" => rod.ei,
        "kg" => rod.total_mass(),
        "Hz" => frequency,
        "Pa s" => stepper.model().fluid.viscosity,
        _ => return None,
    };
    (size > 0.0 && size.is_finite()).then_some(size)
}

/// A variable or a parameter in the description.
struct DescriptionEntry {
    name: String,
    reference: u32,
    description: String,
    /// Element name: Float64 or Real, UInt64, Integer.
    kind: &'static str,
    /// Causality, variability, initial: attributes of the variable itself.
    role: Attributes,
    unit: Option<&'static Unit>,
    /// Range, size, start: attributes of its type.
    value: Attributes,
    /// True for an array whose size is the structural parameter.
    sized: bool,
}

impl DescriptionEntry {
    fn variable(fmu: &Fmu<'_>, standard: Standard, place: usize, variable: &Variable, node: Option<usize>) -> Self {
        let (stepper, model) = (&fmu.stepper, fmu.stepper.model());
        let arrays = fmu.has_arrays(standard);
        let structural = arrays && variable.name == NODES;
        let [causality, variability] =
            if structural { ["structuralParameter", "fixed"] } else { Catalogue::role(variable, stepper) };
        let mut role = vec![("causality", causality.to_string()), ("variability", variability.to_string())];
        if causality == "calculatedParameter" || (standard == Standard::Fmi3 && causality == "output") {
            role.push(("initial", "calculated".to_string()));
        }
        if standard == Standard::Fmi3 && ["input", "output"].contains(&causality) && variability == "continuous" {
            role.push(("intermediateUpdate", "true".to_string()));
        }
        let kind = match variable.name {
            NODES if structural => "UInt64",
            NODES => "Integer",
            _ if standard == Standard::Fmi3 => "Float64",
            _ => "Real",
        };
        let mut value = Vec::new();
        let sized = arrays && variable.size != Size::Scalar;
        if structural {
            let [least, most] = scene::NODES.map(|nodes| (nodes + model.rod.front as u64).to_string());
            value.extend([("min", least), ("max", most)]);
            value.push(("start", model.rod.nodes.to_string()));
        } else {
            value.extend(variable.least().map(|least| ("min", number(least))));
            if variable.causality != Causality::Parameter && standard == Standard::Fmi2 {
                value.extend(nominal(variable.unit, stepper).map(|size| ("nominal", number(size))));
            }
        }
        if variable.is_input() {
            let view = stepper.view();
            let at = |k: usize| variable.at(&view, k).unwrap_or(0.0);
            let start = match node {
                None if sized => numbers((0..model.rod.nodes).map(at)),
                _ => number(at(node.unwrap_or(variable.entries(model).start))),
            };
            value.push(("start", start));
        }
        let target = Target::Variable(place, node.unwrap_or(0));
        Self {
            name: node.map_or(variable.name.to_string(), |node| format!("{}[{node}]", variable.name)),
            // A separate entry has the reference of FMI 2.0, which no array uses.
            reference: Catalogue::reference(if node.is_some() { Standard::Fmi2 } else { standard }, target),
            description: match variable.size {
                Size::Joints if sized => format!("{}; zero at nodes without a joint", variable.description),
                _ => variable.description.to_string(),
            },
            kind,
            role,
            unit: unit(variable.unit),
            value,
            sized,
        }
    }

    fn parameter(fmu: &Fmu<'_>, standard: Standard, place: usize, parameter: &ScalarParameter) -> Self {
        let variability = if fmu.catalogue.is_tunable(place, &fmu.stepper) { "tunable" } else { "fixed" };
        let role = ["parameter", variability, "exact"].map(str::to_string);
        let mut value = Vec::new();
        let (least, most) = (*parameter.range.start(), *parameter.range.end());
        value.extend(least.is_finite().then(|| ("min", number(least))));
        value.extend(most.is_finite().then(|| ("max", number(most))));
        value.push(("start", number(parameter.value)));
        Self {
            name: parameter.name(),
            reference: Catalogue::reference(standard, Target::Parameter(place)),
            description: parameter.description.clone(),
            kind: if standard == Standard::Fmi3 { "Float64" } else { "Real" },
            role: ["causality", "variability", "initial"].into_iter().zip(role).collect(),
            unit: unit(parameter.unit),
            value,
            sized: false,
        }
    }

    fn is(&self, causality: &str) -> bool {
        self.role[0].1 == causality
    }

    fn write(&self, xml: &mut Xml, standard: Standard) -> Result<()> {
        let own = [
            ("name", self.name.clone()),
            ("valueReference", self.reference.to_string()),
            ("description", self.description.clone()),
        ];
        let own = own.into_iter().chain(self.role.iter().cloned());
        match standard {
            Standard::Fmi2 => {
                let value = self.unit.map(units).into_iter().flatten().chain(self.value.iter().cloned()).collect();
                element(xml, "ScalarVariable", own.collect(), |xml| leaf(xml, self.kind, value))
            }
            Standard::Fmi3 => {
                let measured = self.unit.map(|Unit(_, quantity, ..)| ("declaredType", quantity.to_string()));
                let attributes = own.chain(measured).chain(self.value.iter().cloned()).collect();
                match VARIABLES.iter().position(|variable| variable.name == NODES) {
                    Some(nodes) if self.sized => element(xml, self.kind, attributes, |xml| {
                        leaf(xml, "Dimension", vec![("valueReference", nodes.to_string())])
                    }),
                    _ => leaf(xml, self.kind, attributes),
                }
            }
        }
    }
}

/// Quantity, unit and display unit.
fn units(Unit(name, quantity, _, shown): &Unit) -> Attributes {
    let shown = shown.map(|(shown, _)| ("displayUnit", shown.to_string()));
    [("quantity", quantity.to_string()), ("unit", name.to_string())].into_iter().chain(shown).collect()
}

/// Writes an empty element.
pub(super) fn leaf(xml: &mut Xml, name: &str, attributes: Attributes) -> Result<()> {
    with(xml, name, &attributes).write_empty().map(|_| ())
}

/// Writes an element with content.
pub(super) fn element(
    xml: &mut Xml,
    name: &str,
    attributes: Attributes,
    content: impl FnOnce(&mut Xml) -> Result<()>,
) -> Result<()> {
    with(xml, name, &attributes).write_inner_content(content).map(|_| ())
}

fn with<'a>(xml: &'a mut Xml, name: &str, attributes: &Attributes) -> ElementWriter<'a, Vec<u8>> {
    let pairs = attributes.iter().map(|(name, value)| (*name, value.as_str()));
    xml.create_element(name.to_string()).with_attributes(pairs)
}

impl Fmu<'_> {
    /// The content of `modelDescription.xml`.
    ///
    /// # Errors
    /// [`Error::Fmu`](crate::Error::Fmu).
    pub fn description(&self, standard: Standard) -> crate::Result<String> {
        write(self, standard).map_err(|error| crate::Error::Fmu(format!("its description: {error}")))
    }
}

/// Writes the description.
fn write(fmu: &Fmu<'_>, standard: Standard) -> Result<String> {
    let mut xml = Writer::new_with_indent(Vec::new(), b' ', 2);
    xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    let version = if standard == Standard::Fmi2 { "2.0" } else { "3.0" };
    let (token, license) = (fmu.token(), env!("CARGO_PKG_LICENSE").to_string());
    let attributes = vec![
        ("fmiVersion", version.to_string()),
        ("modelName", fmu.scene.name.clone()),
        (if standard == Standard::Fmi2 { "guid" } else { "instantiationToken" }, token),
        ("description", env!("CARGO_PKG_DESCRIPTION").to_string()),
        ("version", env!("CARGO_PKG_VERSION").to_string()),
        ("license", license),
        ("generationTool", concat!("caudal ", env!("CARGO_PKG_VERSION")).to_string()),
        ("variableNamingConvention", "structured".to_string()),
    ];
    let entries = entries(fmu, standard);
    element(&mut xml, "fmiModelDescription", attributes, |xml| {
        leaf(xml, "CoSimulation", capabilities(fmu, standard))?;
        let used = |unit: &&Unit| entries.iter().any(|entry| entry.unit.is_some_and(|other| other.0 == unit.0));
        element(xml, "UnitDefinitions", Vec::new(), |xml| {
            UNITS.iter().filter(used).try_for_each(|unit| write_unit(xml, unit))
        })?;
        if standard == Standard::Fmi3 {
            // Units are not given at every variable, because some readers only evaluate units of types.
            element(xml, "TypeDefinitions", Vec::new(), |xml| {
                UNITS.iter().filter(used).try_for_each(|unit| {
                    let mut attributes = vec![("name", unit.1.to_string())];
                    attributes.extend(units(unit));
                    attributes.extend(nominal(unit.0, &fmu.stepper).map(|size| ("nominal", number(size))));
                    leaf(xml, "Float64Type", attributes)
                })
            })?;
        }
        element(xml, "LogCategories", Vec::new(), |xml| {
            LOG_CATEGORIES.iter().try_for_each(|(name, description)| {
                let attributes = vec![("name", name.to_string()), ("description", description.to_string())];
                leaf(xml, "Category", attributes)
            })
        })?;
        leaf(xml, "DefaultExperiment", experiment(fmu))?;
        element(xml, "ModelVariables", Vec::new(), |xml| {
            entries.iter().try_for_each(|entry| entry.write(xml, standard))
        })?;
        element(xml, "ModelStructure", Vec::new(), |xml| structure(xml, fmu, standard, &entries))
    })?;
    let mut text = String::from_utf8(xml.into_inner()).map_err(std::io::Error::other)?;
    text.push('\n');
    Ok(text)
}

fn capabilities(fmu: &Fmu<'_>, standard: Standard) -> Attributes {
    let yes = |name: &'static str| (name, "true".to_string());
    let mut attributes = vec![
        ("modelIdentifier", fmu.identifier()),
        yes("canHandleVariableCommunicationStepSize"),
        ("maxOutputDerivativeOrder", "1".to_string()),
    ];
    match standard {
        Standard::Fmi2 => attributes.extend([
            yes("canInterpolateInputs"),
            yes("canNotUseMemoryManagementFunctions"),
            yes("canGetAndSetFMUstate"),
            yes("canSerializeFMUstate"),
            yes("providesDirectionalDerivative"),
        ]),
        Standard::Fmi3 => {
            attributes.extend([
                yes("canGetAndSetFMUState"),
                yes("canSerializeFMUState"),
                yes("providesDirectionalDerivatives"),
                yes("providesAdjointDerivatives"),
                yes("providesIntermediateUpdate"),
                yes("canReturnEarlyAfterIntermediateUpdate"),
            ]);
            if fmu.has_arrays(standard) {
                attributes.push(yes("providesPerElementDependencies"));
            }
            // Not if the step is an exposed parameter.
            if let (StepControl::Fixed(step), false) = (fmu.scene.step_control(), fmu.shows("solver.time_step_s")) {
                attributes.push(("fixedInternalStepSize", number(step)));
            }
        }
    }
    attributes
}

fn write_unit(xml: &mut Xml, Unit(name, _, exponents, shown): &Unit) -> Result<()> {
    element(xml, "Unit", vec![("name", name.to_string())], |xml| {
        let base = ["kg", "m", "s", "rad"].into_iter().zip(exponents).filter(|(_, exponent)| **exponent != 0);
        leaf(xml, "BaseUnit", base.map(|(name, exponent)| (name, exponent.to_string())).collect())?;
        shown.iter().try_for_each(|(name, factor)| {
            let attributes = vec![("name", name.to_string()), ("factor", number(*factor))];
            leaf(xml, "DisplayUnit", attributes)
        })
    })
}

/// The default experiment: the scene's duration, with its step or a thousandth of the duration.
fn experiment(fmu: &Fmu<'_>) -> Attributes {
    let duration = fmu.scene.solver.duration_s.get();
    let step = match fmu.scene.step_control() {
        StepControl::Fixed(step) => step.min(duration),
        StepControl::Adaptive(_) => duration / 1000.0,
    };
    vec![("startTime", number(0.0)), ("stopTime", number(duration)), ("stepSize", number(step))]
}

/// The variables of a description. FMI 2.0 does not require the time variable, and some of its hosts reject it.
fn variables<'a>(fmu: &'a Fmu<'_>, standard: Standard) -> impl Iterator<Item = (usize, &'static Variable)> + 'a {
    fmu.catalogue.variables().filter(move |(_, variable)| match variable.causality {
        Causality::Independent => standard == Standard::Fmi3,
        // Arrays have the number of nodes as their size; a host without arrays cannot change it.
        _ if variable.name == NODES => fmu.has_arrays(standard) || standard == Standard::Fmi2 && fmu.shows(NODES),
        _ => fmu.shows(variable.name),
    })
}

/// The nodes whose entries of a variable are scalar variables.
fn nodes<'a>(fmu: &'a Fmu<'_>, variable: &Variable) -> impl Iterator<Item = usize> + 'a {
    variable.entries(fmu.stepper.model()).filter(|node| fmu.shows_node(*node))
}

/// All variables in order, one per entry if there are no arrays; then the parameters.
fn entries(fmu: &Fmu<'_>, standard: Standard) -> Vec<DescriptionEntry> {
    let mut entries = Vec::new();
    for (place, variable) in variables(fmu, standard) {
        if fmu.has_arrays(standard) || variable.size == Size::Scalar {
            entries.push(DescriptionEntry::variable(fmu, standard, place, variable, None));
        } else {
            entries.extend(
                nodes(fmu, variable).map(|node| DescriptionEntry::variable(fmu, standard, place, variable, Some(node))),
            );
        }
    }
    let parameters = fmu.catalogue.parameters.iter().enumerate().filter(|(_, parameter)| fmu.shows(&parameter.name()));
    entries.extend(parameters.map(|(place, parameter)| DescriptionEntry::parameter(fmu, standard, place, parameter)));
    entries
}

/// The model structure: outputs with the inputs on which they depend directly, and initial unknowns.
fn structure(xml: &mut Xml, fmu: &Fmu<'_>, standard: Standard, entries: &[DescriptionEntry]) -> Result<()> {
    let (model, dynamics, form) = (fmu.stepper.model(), fmu.stepper.view().dynamics, fmu.stepper.form());
    let arrays = fmu.has_arrays(standard);
    let scalar = |variable: &Variable| variable.size == Size::Scalar;
    // The name of an entry: its index in FMI 2.0, which counts from 1, its value reference in FMI 3.0.
    let mut name = HashMap::new();
    let mut count = 0;
    for (place, variable) in variables(fmu, standard) {
        let own: Vec<usize> = if arrays { vec![0] } else { nodes_or_one(fmu, variable) };
        for node in own {
            count += 1;
            let coded = if arrays || scalar(variable) { Standard::Fmi3 } else { Standard::Fmi2 };
            let reference = Catalogue::reference(coded, Target::Variable(place, node));
            name.insert((place, node), if standard == Standard::Fmi2 { count } else { reference });
        }
    }
    let inputs: Vec<_> = variables(fmu, standard).filter(|(_, variable)| variable.is_input()).collect();
    // Only FMI 3.0 allows parameters and the time here.
    let others = |variable: &Variable| {
        let time = VARIABLES.iter().position(|variable| variable.causality == Causality::Independent);
        let time = time.filter(|_| variable.follows_time(dynamics, form)).map(|place| Target::Variable(place, 0));
        let shown = |place: &usize| fmu.shows(&fmu.catalogue.parameters[*place].name());
        let parameters = fmu.catalogue.followed_parameters(variable, &fmu.stepper).filter(shown);
        let targets = time.into_iter().chain(parameters.map(Target::Parameter));
        let targets = targets.filter(|_| standard == Standard::Fmi3);
        targets.map(|target| Catalogue::reference(standard, target)).collect::<Vec<_>>()
    };
    let dependencies = |variable: &Variable, node: usize| {
        let mut known: Vec<u32> = if arrays {
            let any = |input: &Variable| {
                variable.entries(model).any(|k| !variable.follows(k, input, dynamics, form).is_empty())
            };
            inputs.iter().filter(|(_, input)| any(input)).map(|(place, _)| *place as u32).collect()
        } else {
            let followed = inputs.iter().flat_map(|(place, input)| {
                variable.follows(node, input, dynamics, form).filter_map(|k| name.get(&(*place, k)).copied())
            });
            followed.collect()
        };
        known.extend(others(variable));
        list(known.into_iter())
    };
    let key = if standard == Standard::Fmi2 { "index" } else { "valueReference" };
    let kind = if standard == Standard::Fmi2 { "Unknown" } else { "Output" };
    let outputs = |xml: &mut Xml| {
        let is_output = |variable: &Variable| Catalogue::role(variable, &fmu.stepper)[0] == "output";
        variables(fmu, standard).filter(|(_, variable)| is_output(variable)).try_for_each(|(place, variable)| {
            let own: Vec<usize> = if arrays { vec![0] } else { nodes_or_one(fmu, variable) };
            own.into_iter().try_for_each(|node| {
                let own = name.get(&(place, node)).copied().unwrap_or_default().to_string();
                leaf(xml, kind, vec![(key, own), ("dependencies", dependencies(variable, node))])
            })
        })
    };
    let unknowns: Vec<_> = entries
        .iter()
        .enumerate()
        .filter(|(_, entry)| entry.is("output") || entry.is("calculatedParameter"))
        .map(|(i, entry)| (i + 1, entry.reference))
        .collect();
    match standard {
        Standard::Fmi2 => {
            element(xml, "Outputs", Vec::new(), outputs)?;
            element(xml, "InitialUnknowns", Vec::new(), |xml| {
                let index = |index: usize| vec![("index", index.to_string())];
                unknowns.iter().try_for_each(|(i, _)| leaf(xml, "Unknown", index(*i)))
            })
        }
        Standard::Fmi3 => {
            outputs(xml)?;
            let reference = |reference: u32| vec![("valueReference", reference.to_string())];
            unknowns.iter().try_for_each(|(_, r)| leaf(xml, "InitialUnknown", reference(*r)))
        }
    }
}

/// The same as [`nodes`]; one entry for a scalar.
fn nodes_or_one(fmu: &Fmu<'_>, variable: &Variable) -> Vec<usize> {
    if variable.size == Size::Scalar { vec![0] } else { nodes(fmu, variable).collect() }
}
