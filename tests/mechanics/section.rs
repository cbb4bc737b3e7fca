//! Cross-sections against closed forms and published tables.

use crate::common;

use std::f64::consts::{FRAC_PI_2, PI};

use caudal::assessment::Assessment;
use caudal::fluid::laws::{LAWS, LawInputs, SectionInput};
use caudal::modes::Modes;
use caudal::rod::{Measured, Profile, Section, Sections, Shape};
use caudal::scene::Document;
use caudal::stepper::Stepper;
use common::{equilibrium, order, run, scene_of};

/// Semi-axes in the plane and across it, m: thin strips, near round, and flat across.
const AXES: [[f64; 2]; 6] = [[0.002, 0.015], [0.006, 0.015], [0.01, 0.01], [0.01, 0.011], [0.02, 0.003], [1e-4, 0.3]];
const HOLES: [f64; 3] = [0.0, 0.4, 0.95];

fn close(found: f64, wanted: f64, what: &str) {
    assert!((found / wanted - 1.0).abs() < 1e-12, "{what}: {found:e} against {wanted:e}");
}

fn section(shape: Shape, [a, b]: [f64; 2], hole: f64) -> Section {
    Section { shape, outer: a, inner: hole * a, depth: 2.0 * b }
}

#[test]
fn areas_and_second_moments_are_those_of_the_outline_less_those_of_the_hole() {
    for axes @ [a, b] in AXES {
        for hole in HOLES {
            let [c, d] = axes.map(|axis| hole * axis);
            let round = section(Shape::Round, axes, hole);
            close(round.area(), PI * (a * a - c * c), "disc");
            close(round.inertia(), PI / 4.0 * (a.powi(4) - c.powi(4)), "disc");
            close(round.inertia_across(), round.inertia(), "disc");
            close(round.displaced(), PI * a * a, "disc");
            let ellipse = section(Shape::Ellipse, axes, hole);
            close(ellipse.area(), PI * (a * b - c * d), "ellipse");
            close(ellipse.inertia(), PI / 4.0 * (a.powi(3) * b - c.powi(3) * d), "ellipse");
            close(ellipse.inertia_across(), PI / 4.0 * (a * b.powi(3) - c * d.powi(3)), "ellipse");
            close(ellipse.displaced(), PI * a * b, "ellipse");
            let rectangle = section(Shape::Rectangle, axes, hole);
            close(rectangle.area(), 4.0 * (a * b - c * d), "rectangle");
            close(rectangle.inertia(), 4.0 / 3.0 * (a.powi(3) * b - c.powi(3) * d), "rectangle");
            close(rectangle.inertia_across(), 4.0 / 3.0 * (a * b.powi(3) - c * d.powi(3)), "rectangle");
            close(rectangle.displaced(), 4.0 * a * b, "rectangle");
            close(rectangle.perimeter(), 4.0 * (a + b), "rectangle");
            for section in [round, ellipse, rectangle] {
                close(PI * section.equivalent_radius().powi(2), section.area(), section.shape.name());
            }
        }
    }
}

/// ∫ f over 0 … π/2 of a function that is even about both ends, which the trapezium rule takes exactly but for rounding.
fn over_a_quadrant(f: impl Fn(f64) -> f64) -> f64 {
    const N: usize = 40_000;
    let ends = 0.5 * (f(0.0) + f(FRAC_PI_2));
    (ends + (1..N).map(|i| f(FRAC_PI_2 * i as f64 / N as f64)).sum::<f64>()) * FRAC_PI_2 / N as f64
}

#[test]
fn the_perimeter_of_an_ellipse_is_the_integral_along_it() {
    for axes @ [a, b] in AXES {
        let arc = 4.0 * over_a_quadrant(|phase| (a * phase.sin()).hypot(b * phase.cos()));
        close(section(Shape::Ellipse, axes, 0.0).perimeter(), arc, "arc");
    }
    // A disc's is exact by Ramanujan's formula too, and his is short by 0.4 % at most.
    close(Section::round(0.01, 0.0).perimeter(), 2.0 * PI * 0.01, "disc");
    let [exact, short] = [Shape::Ellipse, Shape::Round].map(|shape| section(shape, [1e-9, 0.3], 0.0).perimeter());
    close(exact, 1.2, "plate");
    assert!((0.995..0.9965).contains(&(short / exact)), "{}", short / exact);
}

#[test]
fn torsion_constants_are_those_of_the_theory_of_elasticity() {
    for axes @ [a, b] in AXES {
        for hole in HOLES {
            let [c, d] = axes.map(|axis| hole * axis);
            let of = |a: f64, b: f64| PI * (a * b).powi(3) / (a * a + b * b);
            let ellipse = of(a, b) - if hole > 0.0 { of(c, d) } else { 0.0 };
            close(section(Shape::Ellipse, axes, hole).torsion().unwrap(), ellipse, "ellipse");
            close(section(Shape::Round, axes, hole).torsion().unwrap(), FRAC_PI_2 * (a.powi(4) - c.powi(4)), "disc");
            assert_eq!(section(Shape::Rectangle, axes, hole).torsion().is_some(), hole == 0.0);
        }
        // Its series by plain summation; what is left of 20000 terms is below 10⁻¹⁷.
        let (thin, deep) = (2.0 * a.min(b), 2.0 * a.max(b));
        let term = |n: f64| (n * PI * deep / (2.0 * thin)).tanh() / n.powi(5);
        let sum: f64 = (0..20_000).rev().map(|i| term(f64::from(2 * i + 1))).sum();
        let series = deep * thin.powi(3) / 3.0 * (1.0 - 192.0 / PI.powi(5) * thin / deep * sum);
        close(section(Shape::Rectangle, axes, 0.0).torsion().unwrap(), series, "rectangle");
    }
    // S. Timoshenko & J. N. Goodier, Theory of Elasticity (1970), article 109: J/(D t³) over D/t, in three digits.
    for (ratio, published) in [(1.0, 0.1406), (1.5, 0.196), (2.0, 0.229), (3.0, 0.263), (5.0, 0.291), (10.0, 0.312)] {
        for axes in [[0.5, 0.5 * ratio], [0.5 * ratio, 0.5]] {
            let found = section(Shape::Rectangle, axes, 0.0).torsion().unwrap() / ratio;
            assert!((found - published).abs() <= 6e-4, "D/t = {ratio}: {found}");
        }
    }
}

#[test]
fn added_mass_of_a_rectangle_is_the_published_and_that_of_the_others_that_of_their_depth() {
    for axes @ [_, b] in AXES {
        for shape in [Shape::Round, Shape::Ellipse] {
            close(section(shape, axes, 0.3).added(), 4.0 * b * b, shape.name());
        }
    }
    let coefficient = |aspect: f64| section(Shape::Rectangle, [0.5 * aspect, 0.5], 0.0).added();
    // R. D. Blevins, Formulas for Natural Frequency and Mode Shape (1979), table 14-1: by depth over thickness.
    let published =
        [(0.1, 2.23), (0.2, 1.98), (0.5, 1.70), (1.0, 1.51), (2.0, 1.36), (5.0, 1.21), (10.0, 1.14), (1e9, 1.0)];
    for (ratio, wanted) in published {
        let found = coefficient(1.0 / ratio);
        // Measured: at most 8.8e-3, of the first; 7.0e-3 at D/t = 5.
        assert!((found - wanted).abs() < 0.011, "D/t = {ratio}: {found} against {wanted}");
    }
    // J. N. Newman, Marine Hydrodynamics (1977), table 4.3: 4.754 ρ (D/2)² of a square.
    assert!((coefficient(1.0) * PI - 4.754).abs() < 5e-4);
    // Continuous where the sides change places, and none without a depth.
    close(coefficient(1.0 + 1e-14), coefficient(1.0 - 1e-14), "square");
    assert_eq!(section(Shape::Rectangle, [0.01, 0.0], 0.0).added(), 0.0);
    // By the map itself: the sides that its angle and radius make, 2R∫√|sin²α − sin²φ| dφ, with a substitution that takes the root's end
    // away, are those of the rectangle.
    for axes @ [a, b] in AXES {
        let rectangle = section(Shape::Rectangle, axes, 0.0);
        let radius = rectangle.slender_radius();
        // m from the added mass, ¼π C D² = 4πmR² − tD.
        let m = (PI * rectangle.added() / 4.0 + 4.0 * a * b) / (4.0 * PI * radius * radius);
        let side = |m: f64| {
            // sin φ = √m sin ψ.
            2.0 * radius * over_a_quadrant(|psi| m * psi.cos().powi(2) / (1.0 - m * psi.sin().powi(2)).sqrt())
        };
        close(if a < b { side(m) } else { side(1.0 - m) }, a.max(b), "longer side");
        let short = if a < b { side(1.0 - m) } else { side(m) };
        assert!((short / a.min(b) - 1.0).abs() < 1e-12 * a.max(b) / a.min(b), "shorter side {axes:?}: {short}");
    }
}

#[test]
fn slow_flow_far_away_is_that_around_the_circle_that_conforms() {
    for axes @ [a, b] in AXES {
        close(section(Shape::Ellipse, axes, 0.2).slender_radius(), 0.5 * (a + b), "ellipse");
        close(section(Shape::Round, axes, 0.2).slender_radius(), a, "round");
        let turned = section(Shape::Rectangle, [b, a], 0.0).slender_radius();
        close(section(Shape::Rectangle, axes, 0.0).slender_radius(), turned, "rectangle");
    }
    // Γ(1/4)²/(4 π^{3/2}) of the side of a square, a fourth of a plate's breadth. Source: G. Pólya & G. Szegő, Isoperimetric
    // Inequalities in Mathematical Physics (1951), table 1.21.
    close(section(Shape::Rectangle, [0.5, 0.5], 0.0).slender_radius(), 0.590_170_299_508_048_1, "square");
    let plate = section(Shape::Rectangle, [1e-12, 0.5], 0.0).slender_radius();
    assert!((plate - 0.25).abs() < 1e-11, "{plate}");
    assert_eq!(section(Shape::Rectangle, [0.01, 0.0], 0.0).slender_radius(), 0.005);
}

#[test]
fn slow_flow_across_an_elliptic_rod_is_that_of_oberbeck_s_ellipsoid() {
    // 16πμ abc/(χ + a²α) is the drag along a, over 8πμc; c is so long that ends are nothing. λ = abeˣ.
    let oberbeck = |[a, b]: [f64; 2]| {
        const C: f64 = 1e6;
        let sum = |f: &dyn Fn(f64) -> f64| -> f64 {
            (-3000..=4000).map(|i| a * b * (0.02 * f64::from(i)).exp()).map(|x| 0.02 * x * f(x)).sum()
        };
        let root = |x: f64| ((a * a + x) * (b * b + x) * (C * C + x)).sqrt();
        0.5 * C * (sum(&|x| 1.0 / root(x)) + a * a * sum(&|x| 1.0 / ((a * a + x) * root(x))))
    };
    for axes @ [a, b] in [[1.0, 1.0], [0.3, 1.5], [1.5, 0.3], [0.01, 1.0]] {
        let ellipse = section(Shape::Ellipse, axes, 0.0);
        let theory = (2e6 / ellipse.slender_radius()).ln() + ellipse.slender_across();
        assert!((oberbeck(axes) - theory).abs() < 1e-9, "{a} {b}: {} {theory}", oberbeck(axes));
        assert_eq!(section(Shape::Round, axes, 0.0).slender_across(), 0.5);
        assert_eq!(section(Shape::Rectangle, axes, 0.0).slender_across(), ellipse.slender_across());
    }
    // In the laws of slender rods 4πμ/ξ⊥ differs from that of the round rod of its radius by the same.
    let halves = |section: &str, radius: &str| {
        let scene = strip(33, section, &[radius, "rod.depth_m=0.006"]);
        scene.model().unwrap().rod
    };
    let (ellipse, round) = (halves("ellipse", "rod.outer_radius_m=0.001"), halves("round", "rod.outer_radius_m=0.002"));
    for law in LAWS.iter().filter(|law| ["cox", "lighthill"].contains(&law.name)) {
        let [flat, round] = [&ellipse, &round].map(|rod| {
            let half = rod.halves().next().unwrap()[0];
            law.resistance.unwrap()(&LawInputs::plain(rod), &half)
        });
        close(flat[0], round[0], law.name);
        assert!((4.0 * PI / flat[1] - 4.0 * PI / round[1] - (0.25 - 0.5)).abs() < 1e-12, "{}", law.name);
    }
}

#[test]
fn form_drag_is_that_of_a_plate_a_disc_and_sharp_rectangles() {
    for (aspect, round, rectangle) in [
        (1e-6, 2.0, 2.0),
        (0.2, 1.82, 2.0),
        (0.7, 1.37, 2.4),
        (1.0, 1.1, 2.146),
        (2.0, 1.1, 1.652),
        (5.0, 1.1, 1.0),
        (50.0, 1.1, 0.9),
    ] {
        let of = |shape| section(shape, [0.5 * aspect, 0.5], 0.0).form_drag();
        assert!((of(Shape::Ellipse) - round).abs() < 1e-5 && (of(Shape::Round) - round).abs() < 1e-5);
        assert!((of(Shape::Rectangle) - rectangle).abs() < 1e-3, "{aspect}: {}", of(Shape::Rectangle));
    }
}

#[test]
fn means_over_halves_are_exact_where_thickness_and_depth_are_linear() {
    let profile = |points: &[[f64; 2]]| Profile::through(points.to_vec()).unwrap();
    // t from 0.02 to 0.04 and D from 0.03 to 0.01 over 0 … ½, then constant.
    for shape in [Shape::Ellipse, Shape::Rectangle] {
        let sections = Sections {
            shape,
            outer: profile(&[[0.0, 0.01], [0.5, 0.02]]),
            inner: profile(&[[0.0, 0.002], [0.5, 0.004]]),
            depth: Some(profile(&[[0.0, 0.03], [0.5, 0.01]])),
            density: 1200.0.into(),
            mass_factor: 1.0.into(),
            measured: Measured::default(),
        };
        let whole = if shape == Shape::Ellipse { PI / 4.0 } else { 1.0 };
        // ∫ (2 + 2x)(3 − 2x) dx over 0 … 1 is 6 + 1 − 4/3, in 1e-4 m².
        let (sloping, even) = (1e-4 * (6.0 + 1.0 - 4.0 / 3.0), 4e-4);
        let half = sections.half(0.25, 0.5, 1.0);
        // From the middle of the slope, 3 · 2: ∫ over ½ … 1 of (2 + 2x)(3 − 2x) = 3 + ¾ − 7/6.
        let upper = 2.0 * 1e-4 * (3.0 + 0.75 - 7.0 / 6.0);
        close(half.displaced, whole * (0.5 * upper + 0.5 * even), shape.name());
        let mass = sections.mean(0.0, 1.0, |xi| sections.line_density(xi));
        close(mass, 1200.0 * whole * (1.0 - 0.04) * 0.5 * (sloping + even), shape.name());
        let inertia = |a: f64, d: f64| section(shape, [a, 0.5 * d], 0.2).inertia();
        close(sections.at(0.25).inertia(), inertia(0.015, 0.02), shape.name());
    }
}

/// A strip of silicone, clamped: 150 mm × 30 mm × 6 mm.
const STRIP: &str = "[rod]\nnodes = 33\nlength_m = 0.15\nsection = \"rectangle\"\nouter_radius_m = 0.003\ndepth_m = 0.03\n\
    youngs_modulus_pa = 1e6\ndensity_kg_m3 = 1100.0\n[head]\nkind = \"clamped\"\n[solver]\ntime_step_s = 1e-3\nduration_s = 1.0\n";
const WATER: [&str; 2] = ["medium={viscosity_pa_s=1e-3,density_kg_m3=1000}", "reactive={shedding=1.0}"];
const MESHES: [usize; 3] = [33, 65, 129];
/// EI (N m²), and areas (m²) of material and outline, of the strip in every section.
const STRIPS: [(&str, f64, f64); 3] = [
    ("round", PI / 4.0 * 81e-12 * 1e6, PI * 9e-6),
    ("ellipse", PI / 4.0 * 27e-9 * 0.015 * 1e6, PI * 0.003 * 0.015),
    ("rectangle", 0.03 * 216e-9 / 12.0 * 1e6, 0.03 * 0.006),
];

/// The strip on a mesh.
fn strip(nodes: usize, section: &str, changes: &[&str]) -> caudal::scene::Scene {
    let (nodes, section) = (format!("rod.nodes={nodes}"), format!("rod.section={section}"));
    scene_of(STRIP, &[&[&*nodes, &section], changes].concat())
}

#[test]
fn a_strip_sags_under_its_weight_in_water_as_a_cantilever() {
    for (section, stiffness, area) in STRIPS {
        // wL⁴/8EI by weight less buoyancy: 1.3e-4 of the length and less, where nothing is curved.
        let deflection = 100.0 * area * 0.1 * 0.15_f64.powi(4) / (8.0 * stiffness);
        let errors = MESHES.map(|nodes| {
            let loads = "loads={gravity_m_s2=[0,-0.1],buoyancy=true}";
            let scene = strip(nodes, section, &[WATER[0], loads, "solver.newton_tolerance=1e-14"]);
            let q = equilibrium(&scene, &vec![0.0; 2 * nodes], 1).1.q;
            -q[2 * nodes - 1] / deflection - 1.0
        });
        println!("{section}: {errors:?}");
        assert!(errors[0].abs() < 1e-3, "{section}: {errors:?}");
        assert!((order(errors[0], errors[1]) - 2.0).abs() < 0.02, "{section}: {errors:?}");
    }
}

#[test]
fn first_frequencies_of_a_strip_are_those_of_theory_in_vacuum_and_with_the_published_added_mass_in_water() {
    for (section, stiffness, area) in STRIPS {
        // Blevins, table 14-1: 1.21 of a rectangle five times as deep as thick (1.217 here), 1 of the others. Measured: 2.6e-3.
        let [published, digits] = if section == "rectangle" { [1.21, 3e-3] } else { [1.0, 1e-3] };
        let in_water = PI / 4.0 * 1000.0 * published * 9e-4;
        for (added, tolerance, changes) in [(0.0, 1e-3, &[][..]), (in_water, digits, &WATER)] {
            let line_density = 1100.0 * area + added;
            let theory = 1.875_104_068_711_961_f64.powi(2) * (stiffness / line_density / 0.15_f64.powi(4)).sqrt();
            let found =
                MESHES.map(|nodes| Modes::of_model(strip(nodes, section, changes).model().unwrap()).unwrap().lowest());
            println!("{section}: {} Hz of {} Hz", found[1] / (2.0 * PI), theory / (2.0 * PI));
            assert!((found[1] / theory - 1.0).abs() < tolerance, "{section} {added}: {found:?} of {theory}");
            // Of second order in the mesh.
            let observed = order(found[0] - found[1], found[1] - found[2]);
            assert!((observed - 2.0).abs() < 0.02, "{section} {added}: {observed}");
        }
    }
}

#[test]
fn laws_of_round_rods_refuse_a_rectangle_and_take_an_ellipse_and_all_others_take_both() {
    let keys = |name: &str| match name {
        "coefficients" => ",along_n_s_m2=0.1,across_n_s_m2=0.3",
        "wall" => ",height_m=0.1",
        "stokes-like" => ",ratio=2.0",
        _ => "",
    };
    for law in LAWS {
        for (section, taken) in [("round", true), ("ellipse", true), ("rectangle", law.takes != SectionInput::Round)] {
            let mut document = Document::new("strip.toml", STRIP);
            let drag = format!("drag={{law=\"{}\"{}}}", law.name, keys(law.name));
            let radius = ["rod.outer_radius_m=0.001", "rod.depth_m=0.006"];
            for change in [radius[0], radius[1], WATER[0], &format!("rod.section={section}"), &drag] {
                document.set(change).unwrap();
            }
            let scene = document.scene();
            assert_eq!(scene.is_ok(), taken, "{}: {section}: {scene:?}", law.name);
            if let Err(error) = scene {
                assert!(error.to_string().contains("it is valid for round rods only; allowed: cox"), "{error}");
            }
        }
    }
}

#[test]
fn the_assessment_says_section_stiffness_and_weight_as_they_are_used() {
    let facts = |changes: &[&str]| {
        let scene = scene_of(STRIP, changes);
        Assessment::of(&scene, &Stepper::of(&scene).unwrap()).unwrap().facts
    };
    let says = |changes: &[&str], name: &str, words: &str| {
        let facts = facts(changes);
        let found: Vec<&str> = facts.iter().filter(|fact| fact.name == name).map(|fact| &*fact.text).collect();
        assert!(found.len() == 1 && found[0].contains(words), "{name}: {found:?}, not {words:?}");
    };
    says(&[], "section", "rectangle, 6.0000e-3 m thick in the plane of motion, 3.0000e-2 m deep across it");
    says(
        &["rod.section=round"],
        "section",
        "a core 6.0000e-3 m thick with a membrane 3.0000e-2 m deep that only affects the fluid forces",
    );
    says(&["rod.section=ellipse", "rod.inner_radius_m=0.001"], "section", "the hole 2.0000e-3 m");
    // 5.4e-4 N m² times the profile at the clamp, in the middle and one node before the tip.
    let profile = "rod.stiffness_profile=[[0,4],[1,0.8]]";
    let stiffness = "EI = 2.1600e-3 N m^2 at the head, 1.2960e-3 in the middle, 4.8600e-4 at the tip; EA = 1.8000e2 N";
    says(&[profile], "stiffness", stiffness);
    let free = |density: &str| [WATER[0].to_string(), "head.kind=free".into(), format!("rod.density_kg_m3={density}")];
    for (density, words) in [("1020", "1.020"), ("500", "it floats up if nothing"), ("2000", "it sinks if nothing")] {
        let changes = free(density);
        says(&changes.each_ref().map(|change| &**change), "mass over displaced mass", words);
    }
    let held = facts(&[WATER[0]]);
    assert!(held.iter().any(|fact| fact.name == "mass over displaced mass" && fact.text == "1.100"), "{held:?}");
}

#[test]
fn a_depth_that_vanishes_is_none_but_at_the_ends() {
    for (depth, taken) in [
        ("0", false),
        ("[[0,0.01],[0.3,0],[1,0.01]]", false),
        ("[[0.2,0],[1,0.01]]", false),
        ("[[0,0.01],[1,0]]", true),
        ("[[0,0],[0.5,0.01],[1,0.01]]", false), // where the clamp holds it
    ] {
        let mut document = Document::new("strip.toml", STRIP);
        document.set(&format!("rod.depth_m={depth}")).unwrap();
        let scene = document.scene();
        assert_eq!(scene.is_ok(), taken, "{depth}: {scene:?}");
        assert!(
            scene.map_or_else(|error| error.to_string(), |_| "rod.depth_m".into()).contains("rod.depth_m"),
            "{depth}"
        );
    }
}

#[test]
fn the_table_of_the_guide_is_that_of_its_runs() {
    let page = include_str!("../../docs/src/sections.md");
    let scene = page.split_once("```toml\n").unwrap().1.split_once("```").unwrap().0;
    let rows = page.lines().filter(|line| line.contains(" mN | "));
    let mut seen = 0;
    for row in rows {
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        let radius = match cells[0].split_once(" to ") {
            Some(_) => "[[0,0.006],[1,0.002]]".to_string(),
            None => format!("{:e}", 5e-4 * cells[0].trim_end_matches(" mm").parse::<f64>().unwrap()),
        };
        let changes = [format!("rod.section={}", cells[1]), format!("rod.outer_radius_m={radius}")];
        let scene = scene_of(scene, &changes.each_ref().map(|change| &**change));
        let model = scene.model().unwrap();
        let mass = 1e3 * model.rod.total_mass();
        let frequency = Modes::of_model(scene.model().unwrap()).unwrap().lowest() / (2.0 * PI);
        let end = run(&scene);
        let means = ["cycle_thrust_n", "cycle_head_power_w"].map(|name| 1e3 * end.get_scalar(name).unwrap());
        let found = [
            format!("{mass:.1} g"),
            format!("{frequency:.2} Hz"),
            format!("{:.1} mN", means[0]),
            format!("{:.1} mW", means[1]),
        ];
        assert_eq!(found[..], cells[2..], "{row}");
        seen += 1;
    }
    assert_eq!(seen, 12);
}

#[test]
fn a_membrane_is_one_wherever_the_core_is_thinner_than_it() {
    let sections = |depth: f64| Sections {
        outer: Profile::through(vec![[0.0, 0.01], [1.0, 0.003]]).unwrap(),
        depth: Some(depth.into()),
        ..Sections::even(Section::round(0.01, 0.0), 1000.0)
    };
    assert!(sections(0.02).is_flat());
    assert_eq!(sections(0.02).reach_across(), 0.01);
    assert!(!Sections { depth: None, ..sections(0.02) }.is_flat());
}
