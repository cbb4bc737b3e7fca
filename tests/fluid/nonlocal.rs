//! Nonlocal drag is what slender bodies have in creeping flow: towed, beside a wall, falling, swimming; and what it costs.

#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test may panic")]

use crate::common;
use std::f64::consts::{PI, TAU};

use caudal::fluid::force::{self, Force};
use caudal::fluid::laws::{DragLaw, LawInputs, coefficients, cox, gray_hancock, lighthill, nonlocal, wall};
use caudal::fluid::nonlocal::Segment;
use caudal::fluid::validity::DimensionlessNumber;
use caudal::fluid::{Fluid, Forces, Kinematics};
use caudal::rod::{Edge, MassLumping, Material, Rod, Section, Sections, Stiffness, node};
use caudal::scene::Document;
use caudal::sensitivity::Problem;
use caudal::stepper::Stepper;
use common::{Dice, run, run_with, scene_of};
use nalgebra::{Matrix3, Vector2, Vector3};

/// A rod of length 1 and that radius.
fn rod(nodes: usize, radius: f64) -> Rod {
    let sections = Sections::even(Section::round(radius, 0.0), 1000.0);
    let material = Material { sections, youngs: 1e6, stiffness: Stiffness::Gradient(0.0), damping: None };
    Rod::new(nodes, 1.0, &material, MassLumping::Tributary, false)
}

/// The force on every node of a chain at `q` that moves at `v`, in a fluid of viscosity one; returns what the fluid takes.
fn visit(force: &dyn Force, q: &[f64], v: &[f64], look: impl FnMut(usize, Vector2<f64>)) -> f64 {
    let edges: Vec<Edge> = (1..q.len() / 2).map(|k| Edge::new(node(q, k) - node(q, k - 1))).collect();
    let a = vec![0.0; q.len()];
    let fluid = Fluid { viscosity: 1.0, ..Fluid::NONE };
    let rod = Kinematics::within(fluid, &edges, [q, v, &a]);
    force::visit_alone(force, &rod, look);
    force::powers(force, &rod).against_fluid
}

/// Force and moment about the origin on that chain, and what the fluid takes.
fn applied(force: &dyn Force, q: &[f64], v: &[f64]) -> (Vector3<f64>, f64) {
    let mut sum = Vector3::zeros();
    let power = visit(force, q, v, |k, f| sum -= Vector3::new(f.x, f.y, node(q, k).perp(&f)));
    (sum, power)
}

/// Drag of a straight rod along and across itself, at speed one.
fn straight(law: &DragLaw, law_inputs: &LawInputs<'_>) -> [f64; 2] {
    let force = (law.build)(law_inputs);
    let q: Vec<f64> = (0..law_inputs.rod.nodes).flat_map(|k| [law_inputs.rod.arc_length(k), 0.0]).collect();
    [0, 1].map(|axis| {
        let v: Vec<f64> = (0..q.len()).map(|i| f64::from(u8::from(i % 2 == axis))).collect();
        -applied(&*force, &q, &v).0[axis]
    })
}

#[test]
fn a_straight_rod_has_the_drag_of_tirado_s_cylinder() {
    let p: f64 = 50.0;
    let tirado = [
        2.0 * PI / (p.ln() - 0.207 + 0.980 / p - 0.133 / (p * p)),
        4.0 * PI / (p.ln() + 0.839 + 0.185 / p + 0.233 / (p * p)),
    ];
    let rod = rod(65, 0.5 / p);
    let found = straight(&nonlocal::LAW, &LawInputs::plain(&rod));
    let off = [0, 1].map(|i| found[i] / tirado[i] - 1.0);
    println!("off Tirado: {:+.4} along, {:+.4} across", off[0], off[1]);
    assert!(off.iter().all(|off| off.abs() < 0.02), "{off:?}");
}

#[test]
fn a_wall_far_away_adds_to_drag_as_katz_says_and_a_near_one_as_jeffrey_and_onishi() {
    let rod = rod(65, 0.01);
    let plain = LawInputs::plain(&rod);
    let free = straight(&nonlocal::LAW, &plain);
    // Katz takes the image for a point at the depth h. Of a rod the image is as long as the rod: the mean of the velocity that
    // it makes there, by a force that is the same all along, is the wall's effect to first order without that.
    let heights = [0.35, 0.45, 0.5, 1.0, 2.0, 5.0];
    for (i, (unit, share)) in [(2.0 * PI, 3.0 / 16.0), (4.0 * PI, 3.0 / 8.0)].into_iter().enumerate() {
        let image = |height: f64| {
            const PARTS: usize = 400;
            let blob = 0.01 * 0.5_f64.exp();
            let at = |d: f64| {
                let place = |h: f64| if i == 0 { [d, 0.0, h] } else { [0.0, d, h] };
                2.0 * (1.0 - d) * (above_a_wall(place(height), height, blob) - above_a_wall(place(1e12), 1e12, blob)).x
            };
            let weight = |k: usize| if k == 0 || k == PARTS { 1.0 } else { [2.0, 4.0][k % 2] };
            (0..=PARTS).map(|k| weight(k) * at(k as f64 / PARTS as f64) / (3 * PARTS) as f64).sum::<f64>()
        };
        let off = heights.map(|height| {
            let found = straight(&nonlocal::LAW, &LawInputs { height, ..plain.clone() })[i];
            let katz = unit / (unit / free[i] - share / height);
            let long = 8.0 * PI / (8.0 * PI / free[i] + image(height));
            [found / katz - 1.0, found / long - 1.0, long / katz - 1.0]
        });
        for (height, [katz, long, between]) in heights.iter().zip(off) {
            println!(
                "h = {height}: off Katz {katz:+.4}, off an image of the rod's length {long:+.4}, that off Katz {between:+.4}"
            );
        }
        // Measured: at most 0.5 %; Katz himself is off that image by 4.7 % across at 0.35, by 2.6 % at 0.45.
        assert!(off.iter().all(|off| off[1].abs() < 0.006), "{off:?}");
        let from = [0, 1][i];
        assert!(off[from..].iter().all(|off| off[0].abs() < 0.03) && off[5][0].abs() < 1e-4, "{off:?}");
        assert!(i == 0 || off[0][2] < -0.04, "{off:?}");
    }
    let mut range = [[f64::INFINITY, 0.0_f64]; 2];
    for height in [0.03, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0] {
        let law_inputs = LawInputs { height, ..plain.clone() };
        let [local, whole] = [&wall::LAW, &nonlocal::LAW].map(|law| straight(law, &law_inputs));
        for i in 0..2 {
            let ratio = local[i] / whole[i];
            range[i] = [range[i][0].min(ratio), range[i][1].max(ratio)];
        }
    }
    println!("law \"wall\" over nonlocal, along and across: {range:.3?}");
    // Where the wall is near, a long cylinder is in two dimensions: 2πμ/acosh(h/a) and twice that, of its middle.
    let middle = |height: f64| {
        let law_inputs = LawInputs { height, ..plain.clone() };
        let fluid = Fluid { density: 1.0, viscosity: 1.0, ..Fluid::NONE };
        let found = Forces(vec![(nonlocal::LAW.build)(&law_inputs)]).coefficients(&rod, fluid, 1.0).unwrap();
        let exact = 2.0 * PI / (height / 0.01).acosh();
        [found[0] / exact - 1.0, found[1] / (2.0 * exact) - 1.0]
    };
    for near in [1.05, 1.2, 1.5, 2.0, 3.0, 5.0] {
        let off = middle(0.01 * near);
        println!("h/a {near}: off the plane cylinder {off:.4?}");
        // Measured: −60 and −63 %, −31 and −36 %, −13 and −18 %, −5.1 and −8.6 %; within its range −1.2 and −3.2 %, 0.5 and −1.0 %.
        let holds = nonlocal::LAW
            .validity
            .bounds
            .iter()
            .filter(|bound| bound.number == DimensionlessNumber::Height)
            .all(|b| near >= b.least);
        assert_eq!(holds, off.iter().all(|off| off.abs() < 0.04), "{near}: {off:?}");
    }
    assert!(range[0][0] > 0.80 && range[0][1] < 0.95 && range[1][0] > 0.86 && range[1][1] < 1.0, "{range:?}");
}

/// 8πμ times the velocity at `x` by a unit force along x, with blob ε, at height h above the plane z = 0 that it leaves at rest:
/// Stokeslet, image, and h/H times Blake's correction for a point force at the depth H = √(h² + ε²), whose derivatives are
/// written out.
fn above_a_wall([x, y, z]: [f64; 3], height: f64, blob: f64) -> Vector3<f64> {
    let stokeslet = |r: Vector3<f64>| {
        let square = r.norm_squared() + blob * blob;
        (Vector3::x() * (square + blob * blob) + r * r.x) / square.powf(1.5)
    };
    let depth = height.hypot(blob);
    let r = Vector3::new(x, y, z + depth);
    let n = r.norm();
    // ∂/∂x of H r/R³ − (ẑ/R + r r_z/R³).
    let factor = depth - r.z;
    let by_x =
        Vector3::x() * (factor / n.powi(3)) - r * (3.0 * factor * r.x / n.powi(5)) + Vector3::z() * (r.x / n.powi(3));
    stokeslet(Vector3::new(x, y, z - height)) - stokeslet(Vector3::new(x, y, z + height)) + by_x * (2.0 * height)
}

#[test]
fn a_wall_is_at_rest_and_edges_are_sums_of_points() {
    let (height, blob) = (0.3, 0.1);
    let mut dice = Dice(3);
    for _ in 0..50 {
        let [x, y] = [0; 2].map(|_| dice.between(-1.0, 1.0));
        // Measured: at most 1e-15.
        assert!(above_a_wall([x, y, 0.0], height, blob).norm() < 1e-13);
    }
    let mut worst = 0.0_f64;
    for _ in 0..20 {
        let angle = dice.between(-3.0, 3.0);
        let edge = Edge::along(Vector2::new(angle.cos(), angle.sin()), 0.4);
        let d = Vector2::new(dice.between(-0.6, 0.6), dice.between(-0.6, 0.6));
        for walled in [false, true] {
            let exact = Segment { edge: &edge, blob_squared: blob * blob, height: walled.then_some(height) }.at(d);
            // Simpson's rule over the edge; far above a wall there is none.
            let h = if walled { height } else { 1e12 };
            let point = |r: Vector2<f64>| {
                let along = above_a_wall([r.x, r.y, h], h, blob);
                let across = above_a_wall([r.y, r.x, h], h, blob);
                [along.x, along.y, across.x]
            };
            const PARTS: usize = 2000;
            let mut sum = [[0.0; 3]; 2];
            for i in 0..=PARTS {
                let s = i as f64 / PARTS as f64;
                let weight =
                    if i == 0 || i == PARTS { 1.0 } else { [2.0, 4.0][i % 2] } * edge.length / (3 * PARTS) as f64;
                let value = point(d - edge.t * (s * edge.length));
                for j in 0..3 {
                    sum[0][j] += weight * (1.0 - s) * value[j];
                    sum[1][j] += weight * s * value[j];
                }
            }
            for (a, b) in exact.iter().flatten().zip(sum.iter().flatten()) {
                worst = worst.max((a - b).abs());
            }
        }
    }
    println!("edges off sums: {worst:.1e}");
    assert!(worst < 2e-9, "{worst:e}");
}

#[test]
fn an_edge_s_derivatives_are_those_of_the_velocities_that_it_makes() {
    let mut dice = Dice(5);
    let mut worst = 0.0_f64;
    for _ in 0..200 {
        let height = (dice.between(0.0, 1.0) < 0.5).then(|| dice.between(0.15, 0.5));
        let blob: f64 = 0.1;
        let mut vector = |size: f64| Vector2::new(dice.between(-size, size), dice.between(-size, size));
        let (d, ends, along) = (vector(0.6), [vector(1.0), vector(1.0)], vector(0.3) + Vector2::new(0.4, 0.0));
        let velocity = |d: Vector2<f64>, along: Vector2<f64>| -> Vector2<f64> {
            let segment = Segment { edge: &Edge::new(along), blob_squared: blob * blob, height };
            let blocks = segment.at(d).into_iter().zip(ends);
            blocks.map(|([xx, xy, yy], f)| Vector2::new(xx * f.x + xy * f.y, xy * f.x + yy * f.y)).sum()
        };
        let edge = Edge::new(along);
        let [by_place, by_edge] = Segment { edge: &edge, blob_squared: blob * blob, height }.change(d, ends);
        for unit in [Vector2::x(), Vector2::y()] {
            let difference = |of: &dyn Fn(Vector2<f64>) -> Vector2<f64>| {
                const H: f64 = 1e-3;
                let central = |h: f64| (of(unit * h) - of(unit * -h)) / (2.0 * h);
                (central(H) * 4.0 - central(2.0 * H)) / 3.0
            };
            let of_place = difference(&|by| velocity(d + by, along)) - by_place * unit;
            let of_edge = difference(&|by| velocity(d, along + by)) - by_edge * unit;
            worst = worst.max(of_place.norm()).max(of_edge.norm());
        }
    }
    println!("derivatives off differences: {worst:.1e}");
    assert!(worst < 1e-6, "{worst:e}"); // velocities are of size 10; differences of fourth order
}

/// A fibre of length 1 and radius 0.01 that falls broadside, EI = 0.7854 N m²; its weight is B EI/L³.
const FIBRE: &str = r#"name = "fibre"
[rod]
nodes = 65
length_m = 1.0
outer_radius_m = 0.01
youngs_modulus_pa = 1e8
density_kg_m3 = 2548.42
[medium]
viscosity_pa_s = 10.0
density_kg_m3 = 1.0
[drag]
law = "nonlocal"
[loads]
gravity_m_s2 = [0.0, -9.81]
[solver]
duration_s = 2.0
"#;

/// How far its ends are above its middle.
fn bent(stepper: &Stepper) -> f64 {
    let y: Vec<f64> = stepper.state().q.chunks(2).map(|x| x[1]).collect();
    0.5 * (y[0] + y[y.len() - 1]) - y[y.len() / 2]
}

#[test]
fn a_falling_fibre_takes_the_shape_of_a_u_and_under_local_drag_stays_straight() {
    // B = 10, 100: an independent program, within 0.0002 and 0.003.
    for (density, expected, within) in [(2548.42, 0.0109, 0.0002), (25484.2, 0.117, 0.003)] {
        for model in ["full", "overdamped"] {
            let scene = [format!("rod.density_kg_m3={density}"), format!("solver.model={model}")];
            let changes = [scene[0].as_str(), scene[1].as_str()];
            let found = bent(&run(&scene_of(FIBRE, &changes)));
            println!("{model}: {found:.5}, expected {expected}");
            assert!((found - expected).abs() < within, "{model}: {found}");
            let local = bent(&run(&scene_of(FIBRE, &[changes[0], changes[1], "drag.law=cox"])));
            assert!(local.abs() < 1e-9, "{model}: {local:e}");
        }
    }
}

#[test]
fn how_far_a_fibre_bends_hangs_on_the_mesh_by_drag_at_the_ends_and_not_by_elasticity() {
    // The end's height over the middle, for B = 10 and small bends, by the forces on a straight fibre that falls broadside: as of a
    // continuous beam under the forces at the nodes, and of the rod's own joints.
    let bends = [17, 33, 49, 65, 81, 97, 121].map(|nodes: usize| {
        let rod = rod(nodes, 0.01);
        let force = (nonlocal::LAW.build)(&LawInputs::plain(&rod));
        let q: Vec<f64> = (0..nodes).flat_map(|k| [rod.arc_length(k), 0.0]).collect();
        let v: Vec<f64> = (0..2 * nodes).map(|i| (i % 2) as f64).collect();
        let mut drag = vec![0.0; nodes];
        visit(&*force, &q, &v, |k, f| drag[k] += f.y);
        let total: f64 = drag.iter().sum();
        let middle = nodes / 2;
        let load = |k: usize| drag[k] / total - rod.spacing * if k + 1 == nodes { 0.5 } else { 1.0 };
        let far = |k: usize| (k - middle) as f64 * rod.spacing;
        let beam: f64 = (middle..nodes).map(|k| load(k) * far(k).powi(2) * (1.5 - far(k)) / 6.0).sum();
        let (mut slope, mut joints) = (0.0, 0.0);
        for j in middle..nodes - 1 {
            let moment: f64 = (j..nodes).map(|k| load(k) * (far(k) - far(j))).sum();
            slope += moment * rod.spacing * if j == middle { 0.5 } else { 1.0 };
            joints += slope * rod.spacing;
        }
        let blobs = rod.spacing / (0.5_f64.exp() * 0.01);
        println!(
            "{nodes} nodes, {blobs:.2} blobs: total {total:.4}, bend {:.5}, of a continuous beam {:.5}",
            10.0 * joints,
            10.0 * beam
        );
        [blobs, total, 10.0 * joints, 10.0 * beam]
    });
    for [blobs, total, joints, beam] in bends {
        // Measured: 0.7 % on 17 nodes, 0.2 % on 33.
        assert!((joints / beam - 1.0).abs() < 0.008 * (blobs / 3.8).powi(2), "{joints} {beam}");
        if blobs < 1.3 {
            // Measured: 0.01102 … 0.01118 and 0.1 %. The density at the ends grows on from mesh to mesh, so there is no limit.
            assert!((0.0110..0.0112).contains(&joints) && (total / bends[3][1] - 1.0).abs() < 0.0015, "{bends:?}");
        }
    }
    assert!((1.04..1.08).contains(&(bends[1][2] / bends[3][2])), "{bends:?}"); // measured: 1.061
}

/// Positions of node 0 and of the others, and velocities, of a chain of `nodes` nodes and length 1 whose tangent turns as
/// A cos 2π(ns − t), node 0 at rest.
fn wave(nodes: usize, amplitude: f64, waves: f64, t: f64) -> [Vec<f64>; 2] {
    let spacing = 1.0 / (nodes - 1) as f64;
    let (mut q, mut v) = (vec![0.0; 2], vec![0.0; 2]);
    for k in 1..nodes {
        let phase = TAU * (waves * (k as f64 - 0.5) * spacing - t);
        let (angle, rate) = (amplitude * phase.cos(), amplitude * TAU * phase.sin());
        q.extend([q[2 * k - 2] + spacing * angle.cos(), q[2 * k - 1] + spacing * angle.sin()]);
        v.extend([v[2 * k - 2] - spacing * rate * angle.sin(), v[2 * k - 1] + spacing * rate * angle.cos()]);
    }
    [q, v]
}

/// Distance in a period, and mean power, of that swimmer without inertia, with a sphere of radius `head` before its first node.
fn swim(force: &dyn Force, nodes: usize, amplitude: f64, waves: f64, head: f64) -> [f64; 2] {
    const PHASES: usize = 16;
    let mut rates = Vec::new();
    let mut power = 0.0;
    for i in 0..PHASES {
        let [q, v] = wave(nodes, amplitude, waves, i as f64 / PHASES as f64);
        let moved = |m: Vector3<f64>| -> Vec<f64> {
            let nodes = q.as_chunks::<2>().0.iter().zip(v.as_chunks::<2>().0);
            nodes.flat_map(|(q, v)| [v[0] + m.x - m.z * q[1], v[1] + m.y + m.z * q[0]]).collect()
        };
        let acting = |v: &[f64]| {
            let (rod, power) = applied(force, &q, v);
            let edge = Edge::new(node(&q, 1) - node(&q, 0));
            let spin = edge.n().dot(&(node(v, 1) - node(v, 0))) * edge.per_length;
            let (centre, velocity) = (node(&q, 0) - edge.t * head, node(v, 0) - edge.n() * (head * spin));
            let (drag, couple) = (velocity * (6.0 * PI * head), 8.0 * PI * head.powi(3) * spin);
            let of_head = Vector3::new(drag.x, drag.y, centre.perp(&drag) + couple);
            (rod - of_head, power + drag.dot(&velocity) + couple * spin)
        };
        let here = acting(&v).0;
        let columns = [Vector3::x(), Vector3::y(), Vector3::z()].map(|unit| acting(&moved(unit)).0 - here);
        let rigid = -(Matrix3::from_columns(&columns).try_inverse().unwrap() * here);
        power += acting(&moved(rigid)).1 / PHASES as f64;
        rates.push(rigid);
    }
    // Angle and way: spins are turned into a Fourier series, whose integral is exact.
    let angle = |t: f64| -> f64 {
        (1..PHASES / 2)
            .map(|m| {
                let w = TAU * m as f64;
                let part = |f: fn(f64) -> f64| -> f64 {
                    let at = |(i, rate): (usize, &Vector3<f64>)| rate.z * f(w * i as f64 / PHASES as f64);
                    rates.iter().enumerate().map(at).sum::<f64>() * 2.0 / PHASES as f64
                };
                (part(f64::cos) * (w * t).sin() - part(f64::sin) * (w * t).cos()) / w
            })
            .sum()
    };
    let way: Vector2<f64> = (0..PHASES)
        .map(|i| nalgebra::Rotation2::new(angle(i as f64 / PHASES as f64)) * rates[i].xy() / PHASES as f64)
        .sum();
    [way.norm(), power]
}

#[test]
fn it_takes_energy_from_every_motion_that_the_mesh_resolves() {
    const NODES: usize = 65;
    const MOST: usize = 8; // half waves: eight nodes in the shortest
    let mut least = f64::INFINITY;
    for (radius, height) in [(0.01, f64::INFINITY), (0.003, f64::INFINITY), (0.01, 0.05)] {
        let rod = rod(NODES, radius);
        let [nonlocal, local] =
            [&nonlocal::LAW, &cox::LAW].map(|law| (law.build)(&LawInputs { height, ..LawInputs::plain(&rod) }));
        for seed in 0..40 {
            let mut dice = Dice(seed);
            let mut series = |size: f64| -> Vec<f64> {
                let parts = dice.many(MOST + 1, -size, size);
                let at = |k: usize, m: usize| (PI * m as f64 * k as f64 / (NODES - 1) as f64).cos();
                (0..NODES).map(|k| parts.iter().enumerate().map(|(m, part)| part * at(k, m)).sum()).collect()
            };
            let (angles, vx, vy) = (series(0.4), series(1.0), series(1.0));
            let mut q = vec![0.0; 2 * NODES];
            for k in 1..NODES {
                let (sin, cos) = angles[k].sin_cos();
                q[2 * k] = q[2 * k - 2] + rod.spacing * cos;
                q[2 * k + 1] = q[2 * k - 1] + rod.spacing * sin;
            }
            let v: Vec<f64> = vx.into_iter().zip(vy).flat_map(|(x, y)| [x, y]).collect();
            let [power, of_local] = [&nonlocal, &local].map(|force| applied(&**force, &q, &v).1);
            least = least.min(power / of_local);
        }
    }
    println!("at least {least:.3} of the power that cox takes");
    assert!(least > 1.0, "{least}"); // measured: 1.40
}

/// ξ∥ and ξ⊥ of Gray and Hancock's law as C. Brennen & H. Winet, Annu. Rev. Fluid Mech. 9 (1977), give it, over μ.
fn brennen_winet(wavelength: f64, radius: f64) -> [f64; 2] {
    let slender = (2.0 * wavelength / radius).ln();
    [2.0 * PI / (slender - 0.5), 4.0 * PI / (slender + 0.5)]
}

#[test]
fn local_laws_are_as_far_off_in_speed_and_power_as_the_table_says() {
    const NODES: usize = 65;
    /// Radius of the head that is a sphere.
    const HEAD: f64 = 0.05;
    // Speed, speed with a head and power of the bare rod, as the table has them: cells of two digits, from another mesh.
    let table = [
        ("cox, min(L, Λ)", [[0.90, 0.94], [0.94, 1.01], [0.58, 0.76]]),
        ("cox, L", [[0.90, 1.04], [0.94, 1.07], [0.49, 0.74]]),
        ("lighthill", [[1.02, 1.11], [1.13, 1.30], [0.80, 0.96]]),
        ("gray-hancock of 1977", [[0.94, 1.05], [0.92, 1.08], [0.48, 0.67]]),
        ("gray-hancock", [[1.19, 1.66], [1.20, 1.68], [0.54, 0.74]]),
    ];
    let mut ranges = [[[f64::INFINITY, 0.0_f64]; 3]; 5];
    for radius in [0.01, 0.003, 0.001] {
        let rod = rod(NODES, radius);
        for waves in [1.0, 2.0] {
            let wavelength = 1.0 / waves;
            let law_inputs = LawInputs { wavelength: Some(wavelength), ..LawInputs::plain(&rod) };
            let whole = LawInputs { slender_length: Some(1.0), ..law_inputs.clone() };
            let by_arc = [(cox::LAW.build)(&law_inputs), (cox::LAW.build)(&whole), (lighthill::LAW.build)(&law_inputs)];
            let nonlocal = (nonlocal::LAW.build)(&law_inputs);
            for amplitude in [0.5_f64, 1.0] {
                // Gray and Hancock's λ is that along the axis: a wavelength of the rod reaches Λ⟨cos θ⟩.
                let axial = (0..64).map(|i| (amplitude * (TAU * f64::from(i) / 64.0).cos()).cos() / 64.0).sum::<f64>();
                let [along, across] = brennen_winet(axial * wavelength, radius);
                let later = LawInputs { along: along.into(), across: across.into(), ..law_inputs.clone() };
                let first = LawInputs { slender_length: Some(axial * wavelength), ..law_inputs.clone() };
                let by_axis = [(coefficients::LAW.build)(&later), (gray_hancock::LAW.build)(&first)];
                let of = |law: &dyn Force| {
                    let [bare, power] = swim(law, NODES, amplitude, waves, 0.0);
                    [bare, swim(law, NODES, amplitude, waves, HEAD)[0], power]
                };
                let expected = of(&*nonlocal);
                for (range, law) in ranges.iter_mut().zip(by_arc.iter().chain(&by_axis)) {
                    for (range, (found, expected)) in range.iter_mut().zip(of(&**law).into_iter().zip(expected)) {
                        let ratio = found / expected;
                        *range = [range[0].min(ratio), range[1].max(ratio)];
                    }
                }
            }
        }
    }
    let mut worst = 0.0_f64;
    for ((name, expected), found) in table.into_iter().zip(ranges) {
        println!("{name}: speed, with a head, power {found:.3?}; the table: {expected:?}");
        for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
            worst = worst.max((found - expected).abs());
        }
    }
    println!("at most {worst:.3} off"); // measured: 0.014
    assert!(worst < 0.02, "{worst}");
}

/// A tail of length 1 whose base turns to and fro once a second, without inertia, EI = 1 N m².
const TAIL: &str = r#"name = "tail"
[rod]
nodes = 49
length_m = 1.0
outer_radius_m = 0.01
youngs_modulus_pa = 1.2732395447e8
density_kg_m3 = 1.0
[medium]
viscosity_pa_s = 1.0
density_kg_m3 = 1e-3
[drag]
law = "nonlocal"
[head]
kind = "driven"
angle_rad = { amplitude = 0.1, frequency_hz = 1.0, phase_rad = 1.5707963267948966 }
[solver]
model = "overdamped"
time_step_s = 0.04
duration_s = 10.0
"#;

#[test]
fn the_thrust_of_a_driven_tail_by_local_laws_is_off_as_the_table_says() {
    let table = [
        ("cox", "drag.slender_length_m=1.0", [0.80, 0.99, 1.09]),
        ("lighthill", "drag.slender_length_m=1.0", [1.57, 1.38, 1.31]),
        ("gray-hancock", "drag.slender_length_m=1.0", [1.09, 1.35, 1.48]),
    ];
    let resistance = 4.0 * PI / (100.0_f64.ln() + 0.1931);
    let mut worst = 0.0_f64;
    for (i, sperm_number) in [1.5_f64, 2.0, 3.0].into_iter().enumerate() {
        // Sp = L (ξ⊥ ω/EI)^¼.
        let viscosity = format!("medium.viscosity_pa_s={:e}", sperm_number.powi(4) / (resistance * TAU));
        let thrust = |changes: &[&str]| {
            let all: Vec<&str> = changes.iter().copied().chain([viscosity.as_str()]).collect();
            run(&scene_of(TAIL, &all)).get_scalar("cycle_thrust_n").unwrap()
        };
        let expected = thrust(&[]);
        for (name, change, ratios) in &table {
            let found = thrust(&[&format!("drag.law={name}"), change]) / expected;
            println!("Sp {sperm_number}, {name}: {found:.3}; the table: {}", ratios[i]);
            worst = worst.max((found / ratios[i] - 1.0).abs());
        }
    }
    println!("at most {worst:.3} of it off"); // measured: 0.015
    assert!(worst < 0.02, "{worst}");
}

/// A worm of 1 mm.
const WORM: &str = r#"name = "worm"
[rod]
nodes = 33
length_m = 1e-3
outer_radius_m = 1e-5
youngs_modulus_pa = 1e6
density_kg_m3 = 1050.0
[actuation]
kind = "travelling-wave"
kappa_amp = 6.0
kappa_reference_length_m = 1e-3
frequency_hz = 2.0
wavelength_m = 1e-3
envelope = [1.0, 0.0]
[start]
kind = "ramp"
ramp_s = 0.5
[medium]
viscosity_pa_s = 1e-3
density_kg_m3 = 1000.0
[drag]
law = "nonlocal"
[solver]
time_step_s = 5e-3
duration_s = 1.0
"#;

#[test]
fn newton_s_method_takes_at_most_three_iterations_per_step() {
    for (nodes, changes) in
        [(33, vec![]), (65, vec![]), (33, vec!["drag.height_m=1e-4"]), (33, vec!["head.kind=clamped"])]
    {
        let nodes = format!("rod.nodes={nodes}");
        let all: Vec<&str> = changes.iter().copied().chain([nodes.as_str()]).collect();
        let stepper = run(&scene_of(WORM, &all));
        let per_step = stepper.work().newton_iterations as f64 / stepper.metrics().totals.steps as f64;
        let local = run(&scene_of(WORM, &[nodes.as_str(), "drag.law=cox"]));
        let of_local = local.work().newton_iterations as f64 / local.metrics().totals.steps as f64;
        println!("{all:?}: {per_step:.2} iterations per step; cox {of_local:.2}");
        assert!(per_step <= 3.0, "{per_step}"); // measured: 2.00, with a held head 2.83
        assert_eq!(stepper.metrics().totals.halvings, 0);
    }
}

#[test]
fn what_drag_takes_is_what_the_balance_of_energy_lacks_whatever_the_head_and_the_wall() {
    let heads =
        ["head.kind=free", "head.kind=clamped", "head_body={ semi_axis_along_m = 5e-5, semi_axis_across_m = 5e-5 }"];
    for head in heads {
        for wall in ["", "drag.height_m=1e-4"] {
            let mut changes = vec![head, "solver.time_step_s=1e-2", "solver.duration_s=1.0", "rod.nodes=17"];
            changes.extend((!wall.is_empty()).then_some(wall));
            let defect = |step: f64| {
                let step = format!("solver.time_step_s={step:e}");
                let stepper = run(&scene_of(WORM, &[changes.as_slice(), &[step.as_str()]].concat()));
                let metrics = stepper.metrics();
                (metrics.numerical_dissipation() / metrics.totals.work.viscous).abs()
            };
            let (coarse, fine) = (defect(1e-2), defect(5e-3));
            println!("{head} {wall}: {coarse:.1e}, {fine:.1e}");
            assert!(fine < 0.35 * coarse && fine < 2e-2, "{head} {wall}: {coarse:e} {fine:e}");
        }
    }
}

#[test]
fn a_stiff_worm_swims_as_its_shape_says() {
    let at = |model: &str, modulus: &str| {
        let changes = [format!("solver.model={model}"), format!("rod.youngs_modulus_pa={modulus}")];
        let own = [
            "rod.nodes=17",
            "medium.viscosity_pa_s=1e-5",
            "medium.density_kg_m3=1e-3",
            "solver.duration_s=0.6",
            "solver.time_step_s=1e-3",
        ];
        run(&scene_of(WORM, &[&own[..], &[changes[0].as_str(), changes[1].as_str()]].concat()))
    };
    let shape = at("shape", "1e6");
    let path = shape.metrics().totals.path;
    let off =
        ["1e4", "1e5"].map(|modulus| (at("full", modulus).metrics().now.com - shape.metrics().now.com).norm() / path);
    println!("off the shape: {off:?} of the path");
    assert!(off[1] < 1e-3 && off[1] < 0.5 * off[0], "{off:?}");
}

#[test]
fn what_it_cannot_do_is_refused_by_name() {
    let cases = [
        ("rod.nodes=200", "rod.nodes", "at most 122"),
        ("solver.form=chain", "solver.form", "nonlocal"),
        ("drag.head_weight=2.0", "drag", "nonlocal"),
        ("drag.ratio=2.0", "drag.ratio", "nonlocal"),
        ("drag.height_m=0.005", "drag.height_m", "above what the rod reaches across"),
        (
            "medium.beyond={ normal = [0.0, 1.0], offset_m = 0.0, thickness_m = 0.1, viscosity_pa_s = 1.0, density_kg_m3 = 1.0 }",
            "drag.law",
            "layers",
        ),
    ];
    for (change, key, text) in cases {
        let mut document = Document::new("test.toml", FIBRE);
        document.set(change).unwrap();
        if change.contains("head_weight") {
            document.set("drag.head_length_m=0.1").unwrap();
        }
        let error = document.scene().unwrap_err().to_string();
        println!("{error}");
        assert!(error.contains(key) && error.contains(text), "{error}");
    }
    let scene = scene_of(FIBRE, &["solver.time_step_s=0.01", "solver.integrator=implicit-euler"]);
    let error = Problem::of(&scene).unwrap_err().to_string();
    assert!(error.contains("drag.law") && error.contains("nonlocal") && error.contains("cox"), "{error}");
}

#[test]
fn a_run_is_the_same_to_the_bit_each_time_and_after_a_snapshot() {
    let scene = scene_of(WORM, &["solver.duration_s=0.2", "rod.nodes=17"]);
    let mut seen = 0;
    let one = run_with(&scene, |_| seen += 1);
    assert!(seen > 10);
    let other = run(&scene);
    assert_eq!(one.state(), other.state());
    let mut first = Stepper::of(&scene).unwrap();
    first.do_step(0.1).unwrap();
    let saved = first.save();
    first.do_step(0.1).unwrap();
    let after = first.state().clone();
    first.restore(&saved).unwrap();
    first.do_step(0.1).unwrap();
    assert_eq!(first.state(), &after);
}
