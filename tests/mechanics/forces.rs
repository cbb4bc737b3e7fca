//! Every force's derivatives are those of the force or energy beside it: by positions, velocities and accelerations, by
//! the flow and by each of its parameters, in one fluid and in several layers.

use crate::common;
use caudal::fluid::audit::audit;
use caudal::fluid::body::{self, BodyDrag, BodyInertia};
use caudal::fluid::force::{self, Force, StateDerivatives};
use caudal::fluid::laws::{LAWS, LawInputs};
use caudal::fluid::medium::{LAYER_KEYS, Layer, Property};
use caudal::fluid::reactive::Wake;
use caudal::fluid::{Buoyancy, DENSITY, Fluid, HeadWeight, Kinematics, Layers, PowerKind, Reactive, Spray, VISCOSITY};
use caudal::loads::FollowerLoads;
use caudal::rod::{Edge, MassLumping, Material, Profile, Rod, Section, Sections, Spheroid, Stiffness, node};
use common::{Dice, largest};
use nalgebra::Vector2;

const NODES: usize = 7;

/// A tapered rod with a fin.
fn rod() -> Rod {
    let points = |points: &[[f64; 2]]| Profile::through(points.to_vec()).unwrap();
    let sections = Sections {
        outer: points(&[[0.0, 0.012], [0.6, 0.01], [1.0, 0.004]]),
        depth: Some(points(&[[0.0, 0.03], [0.7, 0.02], [1.0, 0.08]])),
        ..Sections::even(Section::round(0.01, 0.0), 1000.0)
    };
    let material = Material { sections, youngs: 1e6, stiffness: Stiffness::Gradient(0.0), damping: None };
    Rod::new(NODES, 0.6, &material, MassLumping::Tributary, false)
}

/// All laws and forces of the program on that rod.
fn all(rod: &Rod) -> Vec<Box<dyn Force>> {
    let law_inputs = LawInputs {
        wavelength: Some(0.5),
        frequency: Some(1.5),
        head: HeadWeight { weight: 3.0, length: 0.13 },
        ratio: 2.5,
        along: 0.7.into(),
        across: Profile::through(vec![[0.0, 1.0], [1.0, 2.0]]).unwrap(),
        height: 0.05,
        turbulent_friction: Some(0.004),
        ..LawInputs::plain(rod)
    };
    let mut forces: Vec<Box<dyn Force>> = LAWS.iter().map(|law| (law.build)(&law_inputs)).collect();
    forces.push(Box::new(Reactive::new(rod)));
    forces.push(Box::new(Wake::new(rod, 0.8)));
    let body = Spheroid { along: 0.1, across: 0.04 };
    let half_area = body.areas().map(|area| 0.5 * area);
    forces.push(Box::new(BodyDrag { viscous: body.drag(), half_area, form: [0.3, 1.1] }));
    forces.push(Box::new(BodyInertia { added: body.added(), own: 1e-3 }));
    forces.push(Box::new(Spray::new(rod)));
    forces.push(Box::new(Buoyancy::new(rod, Vector2::new(0.3, -9.8))));
    for node in [0, 2, NODES - 1] {
        forces.push(Box::new(FollowerLoads::new([(node, Vector2::new(-0.7, 0.4))])));
    }
    let loads = [NODES - 1, 0, 2, 1, 2].map(|node| (node, Vector2::new(0.3, node as f64)));
    forces.push(Box::new(FollowerLoads::new(loads)));
    forces
}

/// Positions, velocities and accelerations of a random chain, in a random fluid, or across the interfaces of three.
#[derive(Clone)]
struct Case {
    parts: [Vec<f64>; 3],
    fluid: Fluid,
    layers: Option<Layers>,
}

impl Case {
    fn random(rod: &Rod, dice: &mut Dice) -> Self {
        // Velocities at which inertia, boundary layer and viscosity all count.
        let parts = [dice.chain(NODES, rod.spacing), dice.many(2 * NODES, -0.2, 0.2), dice.many(2 * NODES, -3.0, 3.0)];
        let flow = Vector2::new(dice.between(-0.1, 0.1), dice.between(-0.1, 0.1));
        let (viscosity, density) = (dice.between(0.01, 1.0), dice.between(500.0, 2000.0));
        let acceleration = node(&parts[2], 0) * 0.7;
        let fluid = Fluid { viscosity, density, flow, acceleration };
        Self { parts, fluid, layers: None }
    }

    /// The same across two interfaces that the chain lies in, along gravity where the force is buoyancy. Drag is in a sheared
    /// flow too, which is different beyond.
    fn in_layers(mut self, force: &dyn Force, dice: &mut Dice) -> Self {
        let angle = dice.between(-3.0, 3.0);
        let down = Vector2::new(0.3, -9.8).normalize();
        let normal =
            if force.power_kind() == Some(PowerKind::Load) { down } else { Vector2::new(angle.cos(), angle.sin()) };
        let along = Vector2::new(normal.y, -normal.x);
        let sheared = if force.power_kind() == Some(PowerKind::Drag) { 1.0 } else { 0.0 };
        let heights: Vec<f64> = (0..NODES).map(|k| normal.dot(&node(&self.parts[0], k))).collect();
        let low = heights.iter().copied().fold(f64::INFINITY, f64::min);
        let size = heights.iter().fold(0.2, |most: f64, h| most.max(h - low));
        // No node is near the ends of an interface: there the third derivative of the blend jumps, which differences see.
        let ends = |share: f64| [0.25, 0.75].map(|at| [at - 0.5 * share, at + 0.5 * share].map(|at| low + at * size));
        let gap = |share: &f64| {
            let distances =
                ends(*share).into_iter().flatten().flat_map(|end| heights.iter().map(move |h| (h - end).abs()));
            distances.fold(f64::INFINITY, f64::min)
        };
        let shares = (0..20).map(|i| 0.3 + 0.005 * f64::from(i));
        let share = shares.max_by(|a, b| gap(a).total_cmp(&gap(b))).unwrap();
        let layer = |[from, to]: [f64; 2], dice: &mut Dice| Layer {
            offset: 0.5 * (from + to),
            thickness: to - from,
            fluid: Fluid {
                viscosity: dice.between(0.01, 1.0),
                density: dice.between(1.0, 2000.0),
                flow: along * (sheared * dice.between(-0.1, 0.1)),
                ..Fluid::NONE
            },
        };
        let [first, second] = ends(share).map(|ends| layer(ends, dice));
        let shear = sheared * dice.between(-0.3, 0.3);
        self.layers = Some(Layers::new(normal, shear, [first, second]));
        self.fluid.flow = along * dice.between(-0.1, 0.1);
        self.fluid.acceleration = Vector2::zeros();
        self
    }

    /// The least speed (m/s) of an end across its edge, against the fluid.
    fn least_across(&self) -> f64 {
        self.with(|rod| {
            let across = |e: usize, k: usize| rod.against_fluid(k).dot(&rod.edges[e].n()).abs();
            (0..NODES - 1).map(|e| across(e, e).min(across(e, e + 1))).fold(f64::INFINITY, f64::min)
        })
    }

    /// A property of the medium.
    fn property(&mut self, key: &str) -> &mut f64 {
        let property =
            [VISCOSITY, DENSITY].into_iter().chain(LAYER_KEYS.concat()).find(|own| *own == key).and_then(Property::of);
        let Self { fluid, layers, .. } = self;
        match property.unwrap() {
            Property::Viscosity(0) => &mut fluid.viscosity,
            Property::Density(0) => &mut fluid.density,
            Property::Viscosity(j) => &mut layers.as_mut().unwrap().get_mut(j - 1).unwrap().fluid.viscosity,
            Property::Density(j) => &mut layers.as_mut().unwrap().get_mut(j - 1).unwrap().fluid.density,
            Property::Offset(j) => &mut layers.as_mut().unwrap().get_mut(j).unwrap().offset,
        }
    }

    fn edges(&self) -> Vec<Edge> {
        (0..NODES - 1).map(|k| Edge::new(node(&self.parts[0], k + 1) - node(&self.parts[0], k))).collect()
    }

    fn with<T>(&self, look: impl FnOnce(&Kinematics<'_>) -> T) -> T {
        let ([q, v, a], edges) = (&self.parts, self.edges());
        let uniform = Kinematics::within(self.fluid, &edges, [q, v, a]);
        look(&Kinematics { t: 0.3, layers: self.layers.as_ref(), ..uniform })
    }

    /// What a force opposes every node with.
    fn force(&self, force: &dyn Force) -> Vec<f64> {
        let mut sum = vec![0.0; 2 * NODES];
        self.with(|rod| force::visit_alone(force, rod, |k, f| (0..2).for_each(|i| sum[2 * k + i] += f[i])));
        sum
    }

    fn moved(&self, change: &[Vec<f64>; 3], flow: Vector2<f64>, by: f64) -> Self {
        let mut moved = self.clone();
        for (part, change) in moved.parts.iter_mut().zip(change) {
            part.iter_mut().zip(change).for_each(|(x, d)| *x += by * d);
        }
        moved.fluid.flow += flow * by;
        moved
    }
}

/// Extrapolated central difference of `f` at 0.
fn difference(f: impl Fn(f64) -> Vec<f64>, h: f64) -> Vec<f64> {
    let central = |h: f64| -> Vec<f64> { f(h).iter().zip(f(-h)).map(|(a, b)| (a - b) / (2.0 * h)).collect() };
    central(h).iter().zip(central(0.5 * h)).map(|(coarse, fine)| (4.0 * fine - coarse) / 3.0).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The worst of `f` over random cases for every force; it must be below `tolerance`.
fn worst(what: &str, tolerance: f64, f: impl Fn(&dyn Force, &Case, &mut Dice) -> f64) {
    let rod = rod();
    for force in all(&rod) {
        let worst = (0..60).map(|seed| {
            let mut dice = Dice(seed);
            let case = Case::random(&rod, &mut dice);
            let one = f(&*force, &case, &mut dice);
            if [body::DRAG, body::INERTIA].contains(&force.name()) || force.global().is_some() {
                return one; // of one fluid
            }
            // Where the velocity across vanishes, square roots bend sharply, which differences see.
            let mut layered = (0..20).map(|_| case.clone().in_layers(&*force, &mut dice));
            let layered = layered.find(|case| case.least_across() > 2e-3).unwrap_or_else(|| case.clone());
            one.max(f(&*force, &layered, &mut dice))
        });
        let worst = largest(worst);
        println!("{what}: {} {worst:.1e}", force.name());
        assert!(worst < tolerance, "{what}: {} {worst:e}", force.name());
    }
}

/// A random change of positions, velocities and accelerations.
fn change(rod: &Rod, dice: &mut Dice) -> [Vec<f64>; 3] {
    let size = rod.spacing;
    [size, 0.1, 1.0].map(|size| dice.many(2 * NODES, -size, size))
}

#[test]
fn a_force_changes_as_its_derivatives_say() {
    // Measured: at most 3.7e-10; 5.7e-8 of a wake that is all but switched off.
    worst("change", 1e-7, |force, case, dice| {
        let change = change(&rod(), dice);
        let flow = Vector2::new(dice.between(-0.1, 0.1), dice.between(-0.1, 0.1));
        let mut exact = vec![0.0; 2 * NODES];
        case.with(|rod| force::add_change(force, rod, [&change[0], &change[1], &change[2]], flow, &mut exact));
        let found = difference(|by| case.moved(&change, flow, by).force(force), 2e-5);
        // A wake that is all but switched off has no digits.
        let scale = largest(found.iter().copied()).max(largest(case.force(force))).max(1e-6);
        largest(exact.iter().zip(&found).map(|(a, b)| a - b)) / scale
    });
}

#[test]
fn every_force_is_what_its_audit_says() {
    let rod = rod();
    for force in all(&rod) {
        let fluid = Fluid { viscosity: 0.1, density: 1000.0, ..Fluid::NONE };
        let found = audit(&*force, &rod, fluid);
        assert!(found.is_empty(), "{}: {found:?}", force.name());
    }
}

#[test]
fn slopes_are_the_transpose_of_changes() {
    // Measured: at most 2.2e-15.
    worst("transpose", 1e-13, |force, case, dice| {
        if force.global().is_some() {
            return 0.0; // sensitivities refuse it
        }
        let change = change(&rod(), dice);
        let cotangent = dice.many(2 * NODES, -1.0, 1.0);
        let mut exact = vec![0.0; 2 * NODES];
        let mut by = [vec![0.0; 2 * NODES], vec![0.0; 2 * NODES], vec![0.0; 2 * NODES]];
        case.with(|rod| {
            force::add_change(force, rod, [&change[0], &change[1], &change[2]], Vector2::zeros(), &mut exact);
            let [q, v, a] = &mut by;
            force::add_slopes(force, rod, 0..NODES - 1, |k| node(&cotangent, k), &mut StateDerivatives { q, v, a });
        });
        let forwards = dot(&exact, &cotangent);
        let backwards: f64 = by.iter().zip(&change).map(|(by, d)| dot(by, d)).sum();
        let scale: f64 = exact.iter().map(|x| x.abs()).sum();
        (forwards - backwards) / scale.max(f64::MIN_POSITIVE)
    });
}

#[test]
fn a_force_changes_with_its_parameters_as_it_says() {
    // Measured: at most 4.0e-11.
    worst("parameters", 1e-9, |force, case, _| {
        let mut worst: f64 = 0.0;
        let beyond = LAYER_KEYS.iter().take(case.layers.map_or(0, |layers| layers.iter().len())).flatten();
        let own = force.parameters().iter().filter(|key| [VISCOSITY, DENSITY].contains(key));
        for key in own.chain(beyond) {
            let mut exact = vec![0.0; 2 * NODES];
            let [energy, _] = case.with(|rod| force.add_by_parameter(key, rod, &mut exact));
            let size = if key.ends_with("offset_m") { 0.01 } else { *case.clone().property(key) };
            let at = |by: f64| {
                let mut case = case.clone();
                *case.property(key) += by;
                case
            };
            let found = difference(|by| at(by).force(force), 1e-3 * size);
            // What hardly depends on the parameter changes by rounding.
            let scale =
                largest(found.iter().copied()).max(1e-3 * largest(case.force(force)) / size).max(f64::MIN_POSITIVE);
            worst = worst.max(largest(exact.iter().zip(&found).map(|(a, b)| a - b)) / scale);
            let stored = difference(|by| vec![at(by).with(|rod| force.energy(rod, 0.0, None))], 1e-3 * size)[0];
            worst = worst.max((energy - stored).abs() / stored.abs().max(1.0));
        }
        worst
    });
}

#[test]
fn energies_have_the_slopes_that_they_say_and_their_rate_is_the_power_against_the_fluid() {
    // Measured: slopes 5.9e-12 (reactive), rate 6.0e-10.
    worst("energy", 1e-8, |force, case, dice| {
        if !matches!(force.power_kind(), None | Some(PowerKind::Load)) {
            return 0.0;
        }
        let change = change(&rod(), dice);
        let mut by = [vec![0.0; 2 * NODES], vec![0.0; 2 * NODES], vec![0.0; 2 * NODES]];
        case.with(|rod| {
            let [q, v, a] = &mut by;
            force.energy(rod, 1.0, Some(StateDerivatives { q, v, a }));
        });
        let energy = |case: &Case| vec![case.with(|rod| force.energy(rod, 0.0, None))];
        let still = Vector2::zeros();
        let found = difference(|h| energy(&case.moved(&change, still, h)), 1e-3)[0];
        let exact: f64 = by.iter().zip(&change).map(|(by, d)| dot(by, d)).sum();
        // Along the motion itself the energy grows by the power against the fluid.
        let motion = [case.parts[1].clone(), case.parts[2].clone(), vec![0.0; 2 * NODES]];
        // In the frame of the fluid, as the energy is the same wherever the rod lies.
        let rate = difference(|h| energy(&case.moved(&motion, case.fluid.acceleration, h)), 1e-3)[0];
        let power = case.with(|rod| force::powers(force, rod).against_fluid);
        ((exact - found) / found).abs().max(((rate - power) / rate).abs())
    });
}

#[test]
fn the_momentum_of_the_fluid_gains_what_opposes_the_rod_and_the_pull_and_its_energy_the_power() {
    // By their exact slopes. Measured: 3.1e-15 (reactive), 6.0e-15 (inertia of a head body).
    worst("momentum and energy", 1e-12, |force, case, _| {
        if force.power_kind().is_some() {
            return 0.0;
        }
        case.with(|rod| {
            let rate = |of: &dyn Fn(StateDerivatives<'_>) -> f64| {
                let [mut q, mut v, mut a] = [(); 3].map(|()| vec![0.0; 2 * NODES]);
                of(StateDerivatives { q: &mut q, v: &mut v, a: &mut a });
                // In the frame of the fluid: the motion against it, and no slope by accelerations.
                assert!(largest(a) == 0.0, "{}", force.name());
                (0..NODES)
                    .map(|k| node(&q, k).dot(&node(rod.v, k)) + node(&v, k).dot(&rod.accelerating_against_fluid(k)))
                    .sum::<f64>()
            };
            let sum = force::resultant(force, rod) + force.pull(rod);
            let found = [Vector2::x(), Vector2::y()].map(|axis| rate(&|by| force.momentum(rod, axis, 1.0, Some(by))));
            let momentum = (Vector2::from(found) - sum).norm() / sum.norm();
            let power = force::powers(force, rod).against_fluid;
            let energy = (rate(&|by| force.energy(rod, 1.0, Some(by))) - power).abs() / power.abs();
            momentum.max(energy)
        })
    });
}

#[test]
fn drag_takes_energy_whatever_the_motion_and_vanishes_with_it() {
    let rod = rod();
    // What acts on the whole rod at once takes energy from motions that the mesh resolves: tests/fluid/nonlocal.rs.
    let takes = |kind: Option<PowerKind>| !matches!(kind, Some(PowerKind::Load | PowerKind::Other));
    for force in all(&rod).into_iter().filter(|force| takes(force.power_kind()) && force.global().is_none()) {
        for seed in 0..120 {
            let mut dice = Dice(seed);
            let mut case = Case::random(&rod, &mut dice);
            if seed % 2 == 1 && ![body::DRAG, body::INERTIA].contains(&force.name()) && force.global().is_none() {
                case = case.in_layers(&*force, &mut dice);
            }
            let power = case.with(|rod| force::powers(&*force, rod).against_fluid);
            let reactive = ["reactive", "wake", body::INERTIA].contains(&force.name());
            assert!(power >= 0.0 || reactive, "{} {power}", force.name());
            case.parts[1] = case.with(|rod| (0..NODES).flat_map(|k| <[f64; 2]>::from(rod.flow(k))).collect());
            case.parts[2] = (0..NODES).flat_map(|_| <[f64; 2]>::from(case.fluid.acceleration)).collect();
            let still = largest(case.force(&*force));
            assert!(still == 0.0, "{}: {still}", force.name());
            let [q, v, a] = &case.parts;
            let mut change = vec![0.0; 2 * NODES];
            case.with(|rod| force::add_change(&*force, rod, [q, v, a], Vector2::zeros(), &mut change));
            assert!(change.iter().all(|x| x.is_finite()), "{}", force.name());
        }
    }
}

#[test]
fn the_wake_takes_lighthills_power_where_the_tip_leads() {
    let rod = rod();
    for seed in 0..60 {
        let case = Case::random(&rod, &mut Dice(seed));
        let (power, expected) = case.with(|kinematics| {
            let [.., before, last] = kinematics.edges else { unreachable!() };
            let d = (last.t * 3.0 - before.t).normalize();
            let v = kinematics.against_fluid(NODES - 1);
            let (u, w) = (v.dot(&d), v.perp(&-d).abs());
            let mass = std::f64::consts::FRAC_PI_4 * case.fluid.density * rod.sections.depth_at(1.0).powi(2);
            (
                force::powers(&Wake::new(&rod, 1.0), kinematics).against_fluid,
                (u <= 0.0).then(|| -0.5 * mass * w * w * u),
            )
        });
        let Some(expected) = expected else { continue };
        assert!((power - expected).abs() <= 1e-13 * expected.abs(), "{power} {expected}"); // measured: 4e-16
    }
}
