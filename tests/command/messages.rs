//! What is said of wrong and of unusual scenes, sweeps, designs, tables and calls, each at, below and above its limits, is kept in
//! `tests/recorded/messages`: a limit that moved, or an error that names another key, is a changed line there. See `digest.rs`.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use caudal::assessment::Assessment;
use caudal::design::DesignTable;
use caudal::scene::files::Contents;
use caudal::scene::{Document, Files};
use caudal::stepper::Stepper;
use caudal::sweep::Sweep;

use crate::common::recorded::{is_as_recorded, rounded};

/// A free swimmer in water.
const FREE: &str = r#"rod.nodes = 9
rod.length_m = 0.3
rod.outer_radius_m = 0.004
rod.youngs_modulus_pa = 1e6
rod.density_kg_m3 = 1000.0
actuation.kind = "travelling-wave"
actuation.kappa_amp = 8.0
actuation.frequency_hz = 2.0
actuation.wavelength_m = 0.3
medium.viscosity_pa_s = 1e-3
medium.density_kg_m3 = 1000.0
drag.law = "cross-flow"
solver.time_step_s = 5e-3
solver.duration_s = 2.0
"#;

/// A passive tail on a driven head.
const HELD: &str = r#"rod.nodes = 9
rod.length_m = 0.3
rod.outer_radius_m = 0.004
rod.youngs_modulus_pa = 1e6
rod.density_kg_m3 = 1000.0
medium.viscosity_pa_s = 1.0
medium.density_kg_m3 = 1000.0
drag.law = "cox"
head.kind = "driven"
head.angle_rad = { amplitude = 0.2, frequency_hz = 1.0 }
solver.time_step_s = 5e-3
solver.duration_s = 2.0
"#;

/// The scene without the lines of some keys, marked by a minus, and with the other changes.
fn document(base: &str, changes: &str) -> Document {
    let changes: Vec<&str> = changes.split(" ; ").map(str::trim).filter(|change| !change.is_empty()).collect();
    let lost = |line: &str| changes.iter().any(|own| own.strip_prefix('-').is_some_and(|key| line.starts_with(key)));
    let text: String = base.lines().filter(|line| !lost(line)).map(|line| format!("{line}\n")).collect();
    let mut document = Document::new("folder/scene.toml", text);
    for change in changes.iter().filter(|change| !change.starts_with('-')) {
        document.set(change).unwrap_or_else(|error| panic!("{change}: {error}"));
    }
    document
}

/// What is said of the scene: why it is refused, or what is noted of it.
fn said(document: &Document) -> String {
    let scene = match document.scene() {
        Ok(scene) => scene,
        Err(error) => return error.to_string(),
    };
    let stepper = match Stepper::of(&scene) {
        Ok(stepper) => stepper,
        Err(error) => return format!("at the start: {error}"),
    };
    // Its short runs take seconds.
    if scene.has_nonlocal_drag() {
        return "accepted".to_string();
    }
    match Assessment::of(&scene, &stepper) {
        Err(error) => format!("at its assessment: {error}"),
        Ok(assessment) => {
            let notes: Vec<&str> = assessment.all_warnings().map(String::as_str).collect();
            format!("accepted; {} with {}; {}", scene.integrator_name(), scene.solver.model, notes.join(" / "))
        }
    }
}

/// A line for a case, and those of what is said.
fn case(text: &mut String, name: &str, said: &str) {
    let fingerprint = |word: &&str| word.len() == 32 && word.bytes().all(|byte| byte.is_ascii_hexdigit());
    let words = said.split(|c: char| !c.is_ascii_alphanumeric()).filter(fingerprint);
    let said = words.fold(said.to_string(), |said, word| said.replace(word, "fingerprint"));
    writeln!(text, "{name}").unwrap();
    said.lines().for_each(|line| writeln!(text, "    {}", rounded(line.trim())).unwrap());
}

/// Numbers and their ranges: keys that a scene may have, and the values that are tried of each.
const RANGES: &[(&str, &[&str], &str)] = &[
    (
        "free",
        &[
            "rod.length_m",
            "rod.outer_radius_m",
            "rod.youngs_modulus_pa",
            "rod.density_kg_m3",
            "actuation.wavelength_m",
            "actuation.kappa_reference_length_m",
            "medium.viscosity_pa_s",
            "medium.density_kg_m3",
            "solver.duration_s",
            "solver.accuracy",
            "record.interval_s",
        ],
        "0 -1 nan text true",
    ),
    (
        "free",
        &[
            "rod.inner_radius_m",
            "rod.damping_time_s",
            "actuation.frequency_hz",
            "record.nodes_from_s",
            "drag.form_drag",
            "drag.thinning",
            "drag.skin_friction",
            "drag.turbulent_friction",
            "reactive.shedding",
        ],
        "-1e-9 0 inf text",
    ),
    ("free", &["rod.stiffness_gradient"], "-1 -0.999 1e-300 3"),
    ("free", &["reactive.shedding"], "1 1.0001 0.5"),
    ("free", &["solver.newton_tolerance"], "0 1e-300 0.999 1"),
    ("free", &["rod.nodes"], "2 3 10000000000 9.5 -1"),
    ("free", &["record.every"], "0 1 1000000000 1000000001"),
    ("free", &["start.spin_rad_s", "actuation.kappa_amp"], "-3 inf text"),
    ("free", &["solver.duration_s"], "1e12 5e12 5.1e12"),
    ("free", &["solver.time_step_s"], "0 1e-15 1.9e-15 2.1e-15 3"),
    ("free", &["record.interval_s"], "1.9e-9 2e-9 2.1e-9 5"),
    ("free", &["rod.inner_radius_m"], "0.0039999 0.004 0.005 [[0,0.001],[1,0.004]]"),
    (
        "free",
        &["head.kind", "start.kind", "solver.linear", "solver.form", "rod.section", "rod.damping_of"],
        "free odd 3",
    ),
    ("free", &["rod.mass_lumping"], "uniform tributary lumped"),
    ("free", &["head.input"], "now begin odd"),
    ("held", &["head.input"], "now begin end odd"),
    ("free", &["solver.model"], "full rigid shape overdamped auto other"),
    ("held", &["solver.model"], "full shape overdamped auto"),
    ("free", &["solver.accuracy_of"], "[] [\"force\"] [\"tip\"] [\"moment\",\"tip\"] [\"speed\"]"),
    ("held", &["solver.accuracy_of"], "[\"force\"] [\"moment\"]"),
    (
        "free",
        &["drag.law"],
        "cox lighthill gray-hancock spheroid coefficients wall weak-inertia nonlocal stokes-like auto cux",
    ),
    ("free", &["drag.viscous"], "cox lighthill gray-hancock coefficients wall nonlocal auto odd"),
    ("free", &["reactive"], "auto other {} {shedding=2} 3"),
    ("free", &["record.nodes"], "[0,8] [-9] [9] [-10] [] [1.5] 3"),
    ("free", &["record.nodes_table"], "csv parquet none xls"),
    ("free", &["loads.gravity_m_s2"], "[0,-9.81] [0,0] [1] 9.81"),
    ("free", &["loads.buoyancy"], "true false 1"),
    (
        "free",
        &["medium.flow_m_s"],
        "[0.1,0] [0.1] 0.1 {amplitude=[0.1,0],frequency_hz=1} {amplitude=[0.1,0]} {frequency_hz=1}",
    ),
    (
        "free",
        &["medium.flow_m_s"],
        "{amplitude=[0.1,0],frequency_hz=1,phase_rad=[0,1],offset=[0.1,0]} {amplitude=[0.1,0],frequency_hz=1,phase_rad=[0,1,2]} {table=\"none.csv\"} {table=\"a.csv\",offset=[0,0]}",
    ),
    (
        "held",
        &["head.angle_rad"],
        "0.1 [0.1,0.2] {amplitude=0.1} {amplitude=0.1,frequency_hz=-1} {amplitude=0.1,frequency_hz=1,phase_deg=3} {table=3}",
    ),
    (
        "free",
        &["rod.outer_radius_m"],
        "[[0,0.004],[1,0.002]] [[0,0.004],[0,0.002]] [[0.5,0.004]] [[-0.1,0.004]] [[0,0.004],[1.1,0.002]] [] [[0]] [[0,0]] [[0.2,0.001],[0.1,0.002]]",
    ),
    ("free", &["rod.depth_m"], "0 0.008 0.02 [[0,0],[0.5,0.02],[1,0]] [[0,0.01],[0.5,0],[1,0.01]] [[0,0.02],[1,-1]]"),
    ("free", &["rod.density_kg_m3"], "[[0,1000],[1,900]] [[0,1000],[1,0]] 1e-90 1e95 1e106"),
    ("free", &["rod.mass_profile"], "1 0 [[0,1],[1,0]] [[0,1],[0.5,0],[1,1]] [[1,1],[0,1]]"),
    ("free", &["rod.loss_factor"], "0.1 -0.1 [[0,0.1],[1,0.2]] [[1,0.1],[0,0.2]]"),
    (
        "free",
        &["rod.damping_time_s"],
        "{stretch=0.1} {stretch=0.1,bend=1} [[0,0.1],[1,0.2]] [[1,0.1],[0,0.2]] {stretch=[[1,0.1],[0,0.2]]}",
    ),
    (
        "free",
        &["rod.stiffness_profile"],
        "[[0,1],[1,2]] [[0,1],[1,0]] [[0,1],[0.5,-1]] [[0.5,1],[0.5,2]] [[0,1],[1.01,2]] [] 2",
    ),
    ("free", &["rod.youngs_modulus_pa"], "1e-70 1e-88 1e-89 1e-90 1e120"),
    ("free", &["rod.length_m"], "1e-90 1e-99 8e-100 7e-100 0.03 0.02 0.01"),
    ("free", &["actuation.envelope"], "[1,0] [1] [1,2,3] 1"),
    ("free", &["actuation.amplitude_profile"], "[[0,1],[1,0]] [[0,-1]] [[1,1],[0,1]] [] 1"),
    ("free", &["actuation.phase_profile_rad"], "[[0,1],[1,-1]] [[1,1],[0,1]] [] [[0,1,2]]"),
    ("free", &["actuation.harmonics"], "[0.1,0.2] [] 0.1 [\"a\"]"),
    ("free", &["actuation.kind"], "standing-wave sine-wave travelling"),
    ("free", &["start.curvature_1_m"], "1 [[0,1],[1,2]] [[1,1],[0,2]] text"),
    ("free", &["name"], "good a/b .. 3"),
];

/// The other mistakes: of keys together.
const TOGETHER: &str = r#"
free: -rod.nodes
free: -rod.length
free: -rod.outer
free: -rod.youngs
free: -rod.density
free: -actuation.kind
free: -actuation.kappa
free: -actuation.frequency
free: -actuation.wavelength
free: -medium
free: -medium.viscosity
free: -medium.density
free: -drag
free: -drag ; -medium
free: -drag ; -medium ; reactive={}
free: -drag ; -medium ; loads.buoyancy=true
free: -solver.time
free: -solver.duration
free: -solver.time ; solver.tolerance=0
free: -solver.time ; solver.tolerance=1
free: -solver.time ; solver.tolerance=0.5
free: -solver.time ; solver.tolerance=1e-12
free: solver.tolerance=1e-4 ; solver.time_step_s=1e-3
free: solver.integrator=newmark ; solver.tolerance=1e-3
free: -solver.time ; solver.integrator=newmark
free: -solver.time ; solver.integrator=newmark ; solver.tolerance=1e-3
free: solver.integrator=neumark
free: solver.integrator=newmark ; solver.beta=1e-6
free: solver.integrator=newmark ; solver.beta=0.9e-6
free: solver.integrator=newmark ; solver.beta=1
free: solver.integrator=newmark ; solver.beta=1.01
free: solver.integrator=newmark ; solver.gamma=-0.01
free: solver.integrator=newmark ; solver.gamma=0
free: solver.integrator=newmark ; solver.gamma=1
free: solver.integrator=newmark ; solver.gamma=1.01
free: solver.integrator=newmark ; solver.gamma=text
free: solver.integrator=generalized-alpha ; solver.rho_inf=-0.1
free: solver.integrator=generalized-alpha ; solver.rho_inf=0
free: solver.integrator=generalized-alpha ; solver.rho_inf=1
free: solver.integrator=generalized-alpha ; solver.rho_inf=1.1
free: solver.integrator=generalized-alpha ; solver.beta=0.3
free: solver.integrator=implicit-euler ; solver.rho=0.5
free: solver.rubbish=1
free: solver.integrator=symplectic-euler
free: solver.integrator=symplectic-euler ; solver.form=chain
free: solver.integrator=esdirk3
free: solver.form=chain
free: solver.form=positions
free: solver.linear=general
free: solver.linear=faer-lu
free: solver.linear=block-band ; drag.law=nonlocal
free: start.kind=ramp
free: start.kind=ramp ; start.ramp_s=0.5
free: start.kind=ramp ; start.ramp_s=0
free: start.kind=jump ; start.ramp_s=1
free: start.ramp_s=1
free: start.kind=jump
held: start.spin_rad_s=1
held: start.spin_rad_s=0
held: head.kind=clamped
held: head.kind=free
held: -head.angle ; head.kind=clamped ; head.position_m=[0,0]
held: head.position_m=[0,{table="a.csv"}]
held: head_body.semi_axis_along_m=0.02 ; head_body.semi_axis_across_m=0.01
free: head_body.semi_axis_along_m=0.02
free: head_body.semi_axis_along_m=0.02 ; head_body.semi_axis_across_m=0
free: head_body.semi_axis_along_m=0.02 ; head_body.semi_axis_across_m=0.01
free: head_body.semi_axis_along_m=0.02 ; head_body.semi_axis_across_m=0.01 ; head_body.mass_kg=0
free: head_body.semi_axis_along_m=0.02 ; head_body.semi_axis_across_m=0.01 ; head_body.mass_kg=1e-100
free: head_body.semi_axis_along_m=0.02 ; head_body.semi_axis_across_m=0.01 ; head_body.mass_kg=0.9e-100
free: head_body.semi_axis_along_m=0.02 ; head_body.semi_axis_across_m=0.01 ; head_body.mass_kg=1.1e100
free: head_body.semi_axis_along_m=1e-34 ; head_body.semi_axis_across_m=0.01
free: head_body.semi_axis_along_m=1e-34 ; head_body.semi_axis_across_m=1 ; head_body.mass_kg=1
free: head_body.semi_axis_along_m=0.02 ; head_body.semi_axis_across_m=1e-50 ; head_body.mass_kg=1
free: head_body.semi_axis_along_m=0.02 ; head_body.semi_axis_across_m=0.01 ; head_body.moment_of_inertia_kg_m2=1e-6
free: head_body.semi_axis_along_m=0.02 ; head_body.semi_axis_across_m=0.01 ; head_body.moment_of_inertia_kg_m2=1e-6 ; reactive={}
free: head_body.semi_axis_along_m=0.02 ; head_body.semi_axis_across_m=0.01 ; head_body.form_drag_along=1
free: -drag ; head_body.semi_axis_along_m=0.02 ; head_body.semi_axis_across_m=0.01 ; head_body.form_drag_along=1
free: -drag ; head_body.semi_axis_along_m=0.02 ; head_body.semi_axis_across_m=0.01 ; head_body.form_drag_across=1
free: -drag ; -medium ; head_body.semi_axis_along_m=0.02 ; head_body.semi_axis_across_m=0.01
free: drag.viscous=wall ; drag.height_m=0.005 ; head_body.semi_axis_along_m=0.02 ; head_body.semi_axis_across_m=0.005
free: drag.viscous=wall ; drag.height_m=0.0051 ; head_body.semi_axis_along_m=0.02 ; head_body.semi_axis_across_m=0.005
free: drag.viscous=wall
free: drag.viscous=wall ; drag.height_m=0.004
free: drag.viscous=wall ; drag.height_m=0.0041
free: drag.viscous=wall ; drag.height_m=0
free: drag.height_m=0.1
free: drag.law=wall ; drag.height_m=0.1
free: drag.law=cox ; drag.height_m=0.1
free: drag.law=cox ; drag.ratio=2
free: drag.law=stokes-like ; drag.ratio=2
free: drag.law=stokes-like ; drag.ratio=0
free: drag.law=cox ; drag.slender_length_m=0.1
free: drag.law=cox ; drag.slender_length_m=0.0055
free: drag.law=cox ; drag.slender_length_m=0.0107
free: drag.law=cox ; drag.slender_length_m=0.0110
free: drag.law=lighthill ; drag.slender_length_m=0.0107
free: drag.law=coefficients ; drag.along_n_s_m2=1
free: drag.law=coefficients ; drag.along_n_s_m2=1 ; drag.across_n_s_m2=2
free: drag.law=coefficients ; drag.along_n_s_m2=-1 ; drag.across_n_s_m2=2
free: drag.law=coefficients ; drag.along_n_s_m2=1 ; drag.across_n_s_m2=[[1,1],[0,2]]
free: drag.law=coefficients ; drag.along_n_s_m2=[[0.5,1],[0.5,2]] ; drag.across_n_s_m2=2
free: drag.viscous=coefficients ; drag.along_n_s_m2=1 ; drag.across_n_s_m2=2
free: drag.law=nonlocal ; rod.nodes=5
free: drag.law=nonlocal ; rod.nodes=40
free: drag.law=nonlocal ; rod.nodes=92
free: drag.law=nonlocal ; rod.nodes=100
free: drag.law=nonlocal ; drag.head_weight=2 ; drag.head_length_m=0.1
free: drag.law=nonlocal ; solver.form=chain
free: drag.law=nonlocal ; medium.shear.rate_per_s=1 ; medium.shear.normal=[0,1]
free: drag.law=nonlocal ; drag.height_m=0.1
free: drag.head_weight=2
free: drag.head_weight=1
free: drag.head_weight=2 ; drag.head_length_m=0.1
free: drag.head_weight=0 ; drag.head_length_m=0.1 ; solver.model=overdamped
free: drag.head_weight=0 ; drag.head_length_m=0.0187 ; solver.model=overdamped
free: drag.head_weight=0 ; drag.head_length_m=0.0188 ; solver.model=overdamped
held: drag.head_weight=0 ; drag.head_length_m=0.0562 ; solver.model=overdamped
held: drag.head_weight=0 ; drag.head_length_m=0.0563 ; solver.model=overdamped
free: -drag ; solver.model=overdamped
free: reactive={} ; solver.model=overdamped
free: reactive=auto ; solver.model=overdamped
free: reactive={} ; solver.model=shape
free: rod.section=rectangle ; rod.depth_m=0.01 ; drag.law=cox
free: rod.section=rectangle ; rod.depth_m=0.01 ; drag.viscous=cox
free: rod.section=rectangle ; rod.depth_m=0.01
free: rod.section=ellipse ; rod.depth_m=0.001
free: rod.section=round ; rod.depth_m=0.001
free: rod.section=round ; rod.depth_m=0.02
free: rod.section=round ; rod.depth_m=0.008
free: rod.depth_m=1e-60
free: rod.axial_stiffness_n=10
free: rod.bending_stiffness_n_m2=1e-4
free: rod.axial_stiffness_n=10 ; rod.bending_stiffness_n_m2=1e-4
free: -rod.youngs ; rod.axial_stiffness_n=10
free: -rod.youngs ; rod.bending_stiffness_n_m2=1e-4
free: -rod.youngs ; rod.axial_stiffness_n=10 ; rod.bending_stiffness_n_m2=1e-4
free: -rod.youngs ; rod.axial_stiffness_n=0 ; rod.bending_stiffness_n_m2=1e-4
free: -rod.youngs ; rod.axial_stiffness_n=[[1,1],[0,1]] ; rod.bending_stiffness_n_m2=1e-4
free: -rod.youngs ; rod.axial_stiffness_n=10 ; rod.bending_stiffness_n_m2=[[1,1],[0,1]]
free: rod.mass_per_length_kg_m=0.05
free: -rod.density ; rod.mass_per_length_kg_m=0.05
free: -rod.density ; rod.mass_per_length_kg_m=[[1,1],[0,1]]
free: -rod.density ; -rod.outer ; -rod.youngs ; rod.mass_per_length_kg_m=0.05 ; rod.axial_stiffness_n=10 ; rod.bending_stiffness_n_m2=1e-4
free: -rod.density ; -rod.outer ; -rod.youngs ; -drag ; rod.mass_per_length_kg_m=0.05 ; rod.axial_stiffness_n=10 ; rod.bending_stiffness_n_m2=1e-4
free: -rod.density ; -rod.outer ; -rod.youngs ; -drag ; rod.mass_per_length_kg_m=0.05 ; rod.axial_stiffness_n=10 ; rod.bending_stiffness_n_m2=1e-4 ; reactive={}
free: -rod.density ; -rod.outer ; -rod.youngs ; -drag ; rod.mass_per_length_kg_m=0.05 ; rod.axial_stiffness_n=10 ; rod.bending_stiffness_n_m2=1e-4 ; loads.buoyancy=true ; loads.gravity_m_s2=[0,-9.81]
free: -rod.density ; -rod.outer ; -rod.youngs ; -drag ; rod.mass_per_length_kg_m=0.05 ; rod.axial_stiffness_n=10 ; rod.bending_stiffness_n_m2=1e-4 ; rod.section=ellipse
free: -rod.density ; -rod.outer ; -rod.youngs ; -drag ; rod.mass_per_length_kg_m=0.05 ; rod.axial_stiffness_n=10 ; rod.bending_stiffness_n_m2=1e-4 ; rod.depth_m=0.1
free: -rod.density ; -rod.outer ; -rod.youngs ; -drag ; rod.mass_per_length_kg_m=0.05 ; rod.axial_stiffness_n=10 ; rod.bending_stiffness_n_m2=1e-4 ; rod.inner_radius_m=0.001
free: -rod.density ; -rod.outer ; -rod.youngs ; rod.mass_per_length_kg_m=0.05 ; rod.axial_stiffness_n=10 ; rod.bending_stiffness_n_m2=1e-4 ; drag.law=coefficients ; drag.along_n_s_m2=1 ; drag.across_n_s_m2=2
free: rod.damping_time_s=0.01 ; rod.loss_factor=0.1
free: rod.loss_frequency_hz=1
free: rod.loss_factor=0.1 ; rod.loss_frequency_hz=1
free: rod.loss_factor=0.1 ; actuation.frequency_hz=0
free: rod.loss_factor=0.1 ; actuation.kappa_amp=0
held: rod.loss_factor=0.1
held: rod.loss_factor=0.1 ; head.position_m=[0,{amplitude=0.1,frequency_hz=1}]
held: rod.loss_factor=0.1 ; head.position_m=[0,{amplitude=0.1,frequency_hz=3}]
held: rod.loss_factor=0.1 ; head.position_m=[0,{amplitude=0,frequency_hz=3}]
held: rod.loss_factor=0.1 ; head.angle_rad=0.1
free: rod.damping_of=elastic
free: rod.damping_of=elastic ; rod.damping_time_s=0.01
free: rod.damping_of=elastic ; rod.loss_factor=0.01 ; -actuation.kappa ; actuation.moment_amp_n_m=1e-4
free: rod.damping_of=whole ; rod.loss_factor=0.01 ; -actuation.kappa ; actuation.moment_amp_n_m=1e-4
free: rod.stiffness_gradient=0.5 ; rod.stiffness_profile=[[0,1]]
free: actuation.moment_amp_n_m=1e-4 ; actuation.kappa_amp=1
free: actuation.moment_amp_n_m=1e-4
free: -actuation.kappa ; actuation.moment_amp_n_m=1e-4 ; actuation.kappa_reference_length_m=1
free: -actuation.kappa ; actuation.moment_amp_n_m=1e-4
free: actuation.slope=1
free: -actuation.kappa ; actuation.kind=sine-wave ; actuation.slope=1
free: -actuation.kappa ; actuation.kind=sine-wave ; actuation.slope=4
free: -actuation.kappa ; actuation.kind=sine-wave ; actuation.slope=4.01
free: -actuation.kappa ; actuation.kind=sine-wave
free: -actuation.kappa ; actuation.kind=sine-wave ; actuation.slope=1 ; actuation.harmonics=[0.1]
free: -actuation.wavelength ; actuation.kind=standing-wave
free: actuation.kappa_amp=200
free: actuation.kappa_amp=80 ; start.kind=jump
free: actuation.kappa_amp=1e300
held: head.angle_rad=4
held: head.angle_rad={amplitude=3,frequency_hz=10}
free: record.every=2 ; record.interval_s=0.1
free: loads.point=[{node=8,force_n=[0,1]}]
free: loads.point=[{node=-9,force_n=[0,1],follows=true}]
free: loads.point=[{node=9,force_n=[0,1]}]
free: loads.point=[{node=0,force_n=[0,1]},{node=-10,force_n=[0,1]}]
free: loads.point=[{node=0,force_n=[0]}]
free: loads.point=[{node=0,force=[0,1]}]
free: loads.point=[{force_n=[0,1]}]
free: loads.point=[3]
free: loads.buoyancy=true ; loads.gravity_m_s2=[0,-9.81]
free: medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200
free: medium.beyond.normal=[0,0] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200
free: medium.beyond.normal=[0,2] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200
free: medium.beyond.normal=[0,2] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200
free: medium.beyond.normal=[0,2] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.001 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200
free: medium.beyond.normal=[0,2] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1
free: medium.beyond.normal=[0,1] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200 ; medium.layers=[{normal=[0,1],offset_m=1,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1}]
free: medium.beyond.normal=[0,1] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200 ; loads.gravity_m_s2=[0,-9.81]
free: medium.beyond.normal=[1,1] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200 ; loads.gravity_m_s2=[0,-9.81]
free: medium.beyond.normal=[0,1] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200 ; medium.flow_m_s=[0.1,0]
free: medium.beyond.normal=[0,1] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200 ; medium.flow_m_s=[0,0.1]
free: medium.beyond.normal=[0,1] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200 ; medium.beyond.flow_m_s=[0.2,0]
free: medium.beyond.normal=[0,1] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200 ; medium.beyond.flow_m_s=[0.2,0.1]
free: medium.beyond.normal=[0,1] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200 ; medium.beyond.flow_m_s=[0.2,0] ; reactive={}
free: medium.beyond.normal=[0,1] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200 ; medium.flow_m_s={amplitude=[0.1,0],frequency_hz=1}
free: medium.beyond.normal=[0,1] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200 ; head_body.semi_axis_along_m=0.02 ; head_body.semi_axis_across_m=0.01
free: medium.beyond.normal=[0,1] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200 ; solver.model=shape
free: medium.beyond.normal=[0,1] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200 ; solver.model=auto
free: medium.shear.rate_per_s=1
free: medium.shear.rate_per_s=1 ; medium.shear.normal=[0,1]
free: medium.shear.rate_per_s=1 ; medium.shear.normal=[0,1] ; reactive={}
free: medium.shear.rate_per_s=0 ; medium.shear.normal=[0,1] ; reactive={}
free: medium.shear.rate_per_s=1 ; medium.shear.normal=[0,1] ; solver.model=overdamped
free: medium.shear.rate_per_s=1 ; medium.shear.normal=[0,1] ; medium.beyond.normal=[1,0] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200
free: medium.shear.rate_per_s=1 ; medium.shear.normal=[0,-1] ; medium.beyond.normal=[0,1] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200
free: medium.shear.rate_per_s=1 ; medium.shear.normal=[1e-8,1] ; medium.beyond.normal=[0,1] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200
free: medium.shear.rate_per_s=1 ; medium.shear.normal=[1e-10,1] ; medium.beyond.normal=[0,1] ; medium.beyond.offset_m=0.1 ; medium.beyond.thickness_m=0.05 ; medium.beyond.viscosity_pa_s=1 ; medium.beyond.density_kg_m3=1200
free: medium.layers=[{normal=[0,1],offset_m=0.1,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1},{offset_m=0.2,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1}]
free: medium.layers=[{normal=[0,1],offset_m=0.1,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1},{offset_m=0.201,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1}]
free: medium.layers=[{normal=[0,1],offset_m=0.1,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1},{offset_m=0.19,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1}]
free: medium.layers=[{offset_m=0.1,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1}]
free: medium.layers=[{normal=[0,1],offset_m=0,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1},{offset_m=1,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1},{offset_m=2,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1},{offset_m=3,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1},{offset_m=4,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1},{offset_m=5,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1},{offset_m=6,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1},{offset_m=7,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1}]
free: medium.layers=[{normal=[0,1],offset_m=0,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1},{offset_m=1,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1},{offset_m=2,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1},{offset_m=3,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1},{offset_m=4,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1},{offset_m=5,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1},{offset_m=6,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1},{offset_m=7,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1},{offset_m=8,thickness_m=0.1,viscosity_pa_s=1,density_kg_m3=1}]
free: nodes=9
free: length_m=1
free: kappa_amp=1
free: rod.nodez=9
free: rod=3
free: rod.nodes=2 ; rod.length_m=-1 ; solver.duration_s=0 ; drag.law=other
free: rod.nodes=2 ; -rod.length ; medium.viscosity=1
free: axes.x=[1] ; scene=a
free: loads.point.0.node=3
free: rod.nodes=9 ; rod.nodes.x=3
free: medium.flow_m_s.2=0.1
"#;

#[test]
fn what_is_said_of_wrong_and_unusual_scenes_is_what_was_said() {
    is_as_recorded("messages/scenes", |_| {
        let mut text = String::new();
        for (base, keys, values) in RANGES {
            for (key, value) in keys.iter().flat_map(|key| values.split(' ').map(move |value| (key, value))) {
                let own = if *base == "free" { FREE } else { HELD };
                case(&mut text, &format!("{base}: {key} = {value}"), &said(&document(own, &format!("{key}={value}"))));
            }
        }
        for line in TOGETHER.lines().filter(|line| !line.is_empty()) {
            let (base, changes) = line.split_once(": ").unwrap();
            case(&mut text, line, &said(&document(if base == "free" { FREE } else { HELD }, changes)));
        }
        text
    });
}

/// Tables of a function of time, with `|` for the ends of lines.
const TABLES: &[&str] = &[
    "time_s,angle_rad|0,0|2,1",
    "time_s,angle_rad|0,0|1.9999999999,1",
    "time_s,angle_rad|0,0|1.9999,1",
    "time_s,angle_rad|0.001,0|2,1",
    "time_s,angle_rad|-1,0|2,1",
    "time_s,angle_rad,spin_rad_s|0,0,0|2,1,0.5",
    "time_s,angle_rad,angle2_rad|0,0,0|2,1,0.5",
    "time_s,spin_rad_s|0,0|2,1",
    "angle_rad,time_s|0,0|2,1",
    "time_s,time_2|0,0|2,1",
    "time_s,angle_deg|0,0|2,1",
    "time_ms,angle_rad|0,0|2,1",
    "t [min],angle|0,0|2,1",
    "time_s|0|2",
    "time_s,a,b,c|0,0,0,0|2,0,0,0",
    "0,0|2,1",
    "time_s,angle_rad",
    "",
    "time_s,angle_rad|0,0|2",
    "time_s,angle_rad|0,0|1,0,0|2,1",
    "time_s,angle_rad|0,zero|2,1",
    "time_s,angle_rad|0,nan|2,1",
    "time_s,angle_rad|0,0|1,inf|2,1",
    "time_s,angle_rad|0,0|0,1|2,1",
    "time_s,angle_rad|0,0|1,1|0.5,1|2,1",
    "# said|time_s,angle_rad|# more||0,0|2,x",
    "time_s,angle_rad|0,0",
];

/// The same of two values.
const PAIRS: &[&str] = &[
    "time_s,x_m,y_m|0,0,0|2,1,1",
    "time_s,y_m,x_m|0,0,0|2,1,1",
    "time_s,x_m,x2_m|0,0,0|2,1,1",
    "time_s,x_m_s,y_m_s|0,0,0|2,1,1",
    "time_s,x_m,y_m,x_m_s,y_m_s|0,0,0,0,0|2,1,1,0,0",
    "time_s,x_m,y_m,x2_m,y2_m|0,0,0,0,0|2,1,1,0,0",
    "time_s,x_m,y_m,x_m_s|0,0,0,0|2,1,1,0",
    "time_s,x_mm,y_mm|0,0,0|2,1,1",
];

#[test]
fn what_is_said_of_wrong_tables_is_what_was_said() {
    is_as_recorded("messages/tables", |_| {
        let mut text = String::new();
        let both = [("head.angle_rad", TABLES), ("head.position_m", PAIRS)];
        for (key, table) in both.iter().flat_map(|(key, tables)| tables.iter().map(move |table| (key, table))) {
            let content = table.replace('|', "\n").into_bytes();
            let files = Contents::from([(PathBuf::from("folder/a.csv"), content)]);
            let document = document(HELD, &format!("{key}={{table=\"a.csv\"}}")).with_files(files);
            case(&mut text, &format!("{key}: {table}"), &said(&document));
        }
        text
    });
}

const DESIGNS: &str = r#"
free: design.iterations=3
free: design.goal=fly
free: design.goal=3
free: design.goal=identify
free: design.goal=static-shape
free: design.goal=track-tip
free: design.goal=track-tip ; design.data=a.csv
free: design.goal=identify ; design.data=a.csv
free: design.goal=distance
free: design.goal=distance ; design.direction=x
free: design.goal=distance ; design.direction=+x
free: design.goal=efficiency ; design.direction=-x
free: design.goal=identify ; design.data=a.csv ; design.direction=-x
free: design.goal=cycle_forward_speed_m_s
free: design.goal=cycle_forward_sped_m_s
free: design.goal=cycle_forward_speed_m_s ; design.direction=-x
free: design.goal=cycle_forward_speed_m_s ; design.better=smaller
free: design.goal=cycle_forward_speed_m_s ; design.better=lower
free: design.goal=distance ; design.direction=-x ; design.better=larger
free: design.goal=distance ; design.direction=-x ; design.rubbish=1
free: design.goal=distance ; design.direction=-x ; design.bounds=[0,1]
free: design.goal=distance ; design.direction=-x ; design.bounds=[2,1]
free: design.goal=distance ; design.direction=-x ; design.bounds=[1,1]
free: design.goal=distance ; design.direction=-x ; design.bounds=[1,inf]
free: design.goal=distance ; design.direction=-x ; design.bounds=1
free: design.goal=distance ; design.direction=-x ; design.smoothness=-1
free: design.goal=distance ; design.direction=-x ; design.smoothness=0
free: design.goal=distance ; design.direction=-x ; design.smoothness=inf
free: design.goal=distance ; design.direction=-x ; design.mean=0
free: design.goal=distance ; design.direction=-x ; design.mean=0.009
free: design.goal=distance ; design.direction=-x ; design.mean=0.01
free: design.goal=distance ; design.direction=-x ; design.knots=[]
free: design.goal=distance ; design.direction=-x ; design.knots=[0,1]
free: design.goal=distance ; design.direction=-x ; design.knots=[0.5,0.5]
free: design.goal=distance ; design.direction=-x ; design.knots=[0,1.1]
free: design.goal=identify ; design.data=a.csv ; design.noise_m=0
free: design.goal=identify ; design.data=a.csv ; design.window_s=-1
free: design.goal=identify ; design.data=a.csv ; design.noise_m=1e-4 ; design.window_s=1
free: design.goal=distance ; design.direction=-x ; design.variables=[]
free: design.goal=distance ; design.direction=-x ; design.variables=["stiffness","stiffness"]
free: design.goal=distance ; design.direction=-x ; design.variables=["amplitude","phase"]
free: design.goal=identify ; design.data=a.csv ; design.variables=["amplitude"]
free: design.goal=distance ; design.direction=-x ; design.variables=["rod.youngs"]
free: design.goal=distance ; design.direction=-x ; design.variables=["medium.viscosity_pa_s"]
free: design.goal=distance ; design.direction=-x ; design.variables=["rod.damping_time_s"] ; rod.damping_time_s=0
free: design.goal=static-shape ; design.data=a.csv ; design.variables=["medium.viscosity_pa_s"]
free: design.goal=distance ; design.direction=-x ; design.number_bounds=[0.5,2]
free: design.goal=distance ; design.direction=-x ; design.variables=["medium.viscosity_pa_s"] ; design.number_bounds=[0,2]
free: design.goal=distance ; design.direction=-x ; design.variables=["medium.viscosity_pa_s"] ; design.number_bounds=[2,1]
free: design.goal=distance ; design.direction=-x ; design.variables=["medium.viscosity_pa_s"] ; design.number_bounds={"rod.length_m"=[1,2]}
free: design.goal=distance ; design.direction=-x ; design.variables=["medium.viscosity_pa_s"] ; design.number_bounds={"medium.viscosity_pa_s"=[1,2]}
free: design.goal=identify ; design.data=a.csv ; design.variables=["medium.viscosity_pa_s"] ; design.actuation_gain=true
free: design.goal=identify ; design.data=a.csv ; design.variables=["medium.viscosity_pa_s"] ; design.window_s=1
free: design.goal=identify ; design.data=a.csv ; design.actuation_gain=true
free: design.goal=identify ; design.data=a.csv ; design.actuation_gain=true ; -actuation.kappa ; actuation.moment_amp_n_m=1e-4
held: design.goal=cycle_thrust_n ; design.variables=["amplitude"]
free: design.goal=distance ; design.direction=-x ; design.amplitude_bounds=[0.5,2]
free: design.goal=distance ; design.direction=-x ; design.amplitude_mean=1
free: design.goal=distance ; design.direction=-x ; design.phase_bounds_rad=[-1,1]
free: design.goal=distance ; design.direction=-x ; design.variables=["amplitude"] ; design.amplitude_bounds=[0,2]
free: design.goal=distance ; design.direction=-x ; design.variables=["amplitude"] ; design.amplitude_bounds=[0.5,0.4]
free: design.goal=distance ; design.direction=-x ; design.variables=["amplitude"] ; design.amplitude_bounds=[0.5,2] ; design.amplitude_mean=0.49
free: design.goal=distance ; design.direction=-x ; design.variables=["amplitude"] ; design.amplitude_bounds=[0.5,2] ; design.amplitude_mean=0.5
free: design.goal=distance ; design.direction=-x ; design.variables=["amplitude"] ; design.amplitude_mean=0
free: design.goal=distance ; design.direction=-x ; design.variables=["phase"] ; design.phase_bounds_rad=[1,-1]
free: design.goal=distance ; design.direction=-x ; design.variables=["phase"] ; design.phase_bounds_rad=[-inf,1]
free: design.goal=distance ; design.direction=-x ; design.largest_mass_kg=0
free: design.goal=distance ; design.direction=-x ; design.largest_mass_kg=1
free: design.goal=distance ; design.direction=-x ; design.neutral_buoyancy=true
free: design.goal=distance ; design.direction=-x ; design.least_wall_m=0.001
free: design.goal=distance ; design.direction=-x ; design.largest_moment_n_m=-1
free: design.goal=distance ; design.direction=-x ; design.largest_strain=0.1 ; design.largest_power_w=1
free: design.goal=distance ; design.direction=-x ; design.least_speed_m_s=0.1
free: design.goal=distance ; design.direction=-x ; design.least_thrust_n=0.1
held: design.goal=cycle_thrust_n ; design.least_speed_m_s=0.1
held: design.goal=cycle_thrust_n ; design.least_thrust_n=0.1
held: design.goal=cycle_thrust_n ; design.largest_power_w=0.1
free: design.goal=identify ; design.data=a.csv ; design.largest_strain=0.1
free: design.goal=identify ; design.data=a.csv ; design.over=a.toml
free: design.goal=distance ; design.direction=-x ; design.robust=mean
free: design.goal=distance ; design.direction=-x ; design.over=a.toml ; design.robust=best
free: design.goal=distance ; design.direction=-x ; design.over=a.toml ; design.robust=mean
free: design.goal=distance ; design.direction=-x ; design.front={goal="distance"}
free: design.goal=distance ; design.direction=-x ; design.front={goal="efficiency",points=2}
free: design.goal=distance ; design.direction=-x ; design.front={goal="efficiency",points=3}
free: design.goal=distance ; design.direction=-x ; design.front={goal="efficiency",points=100}
free: design.goal=distance ; design.direction=-x ; design.front={goal="efficiency",points=101}
free: design.goal=distance ; design.direction=-x ; design.front={goal="efficiency",better="smaller"}
free: design.goal=distance ; design.direction=-x ; design.front={goal="cycle_forward_speed_m_s",better="lower"}
free: design.goal=distance ; design.direction=-x ; design.front={goal="cycle_forward_speed_m_s",better="smaller"}
free: design.goal=cycle_forward_speed_m_s ; design.front={goal="distance"}
free: design.goal=distance ; design.direction=-x ; design.front={goal="identify"}
free: design.goal=distance ; design.direction=-x ; design.over=a.toml ; design.front={goal="efficiency"}
free: design.goal=identify ; design.data=a.csv ; design.front={goal="efficiency"}
"#;

#[test]
fn what_is_said_of_wrong_designs_is_what_was_said() {
    is_as_recorded("messages/designs", |_| {
        let mut text = String::new();
        for line in DESIGNS.lines().filter(|line| !line.is_empty()) {
            let (base, changes) = line.split_once(": ").unwrap();
            let document = document(if base == "free" { FREE } else { HELD }, changes);
            let said = match document.scene() {
                Err(error) => error.to_string(),
                Ok(scene) => match DesignTable::of(&scene) {
                    Err(fault) => document.error_at(&fault).to_string(),
                    Ok(table) => {
                        let whole = [table.is_over_cycles(), table.is_searched(), table.smaller_is_better()];
                        format!("accepted; {} {:?} {} starts", table.goal.label(), whole, table.start_count())
                    }
                },
            };
            case(&mut text, line, &said);
        }
        text
    });
}

/// Sweeps, with `|` for the ends of lines; the scene is `scene.toml`.
const SWEEPS: &[&str] = &[
    "axes.rod.nodes=[5,9]",
    "axes.rod.nodes=[]",
    "axes.rod.nodes=5",
    "axes.rod.nodes={from=3,to=9,count=1}",
    "axes.rod.nodes={from=3,to=9,count=2}",
    "axes.rod.nodes={from=3,to=9,count=3}",
    "axes.rod.nodes={from=3,to=9,count=4}",
    "axes.rod.nodes={from=3,to=9}",
    "axes.rod.nodes={from=3,to=9,step=1}",
    "axes.rod.length_m={from=0,to=1,count=3,scale=\"log\"}",
    "axes.rod.length_m={from=0.1,to=1,count=3,scale=\"log\"}",
    "axes.rod.length_m={from=0.1,to=inf,count=3}",
    "axes.rod.length_m={from=\"a\",to=1,count=3}",
    "axes.rod.length_m={from=0.1,to=1,count=3,scale=\"square\"}",
    "axes.rod.length_m={between=[0.1,1]}",
    "axes.rod.length_m={between=[0.1,1]}|samples={count=3,seed=1}",
    "axes.rod.length_m={between=[1,0.1]}|samples={count=3,seed=1}",
    "axes.rod.length_m={between=[0.1,1]}|samples={count=0,seed=1}",
    "axes.rod.length_m={between=[0.1,1],labels=[\"a\",\"b\"]}|samples={count=2,seed=1}",
    "axes.rod.length_m={between=[0,1],scale=\"log\"}|samples={count=2,seed=1}",
    "axes.rod.nodes=[5,9]|samples={count=3,seed=1}",
    "axes.rod.length_m={values=[0.1,0.2],labels=[\"a\",\"b\"]}",
    "axes.rod.length_m={values=[0.1,0.2],labels=[\"a\"]}",
    "axes.rod.length_m={values=[0.1,0.2],factors=[1,2]}",
    "axes.rod.length_m={values=[0.1,0.2],count=2}",
    "axes.rod.length_m={factors=[1,2]}",
    "axes.rod.length_m={factors=[1,0]}",
    "axes.rod.length_m={factors=[1,\"a\"]}",
    "axes.drag.law={factors=[1,2]}",
    "axes.both={factors=[1,2],keys=[\"rod.length_m\",\"rod.outer_radius_m\"]}",
    "axes.both={factors=[1,2],keys=[]}",
    "axes.both={factors=[1,2],keys=3}",
    "axes.both={zip={rod.length_m=[0.1,0.2],rod.nodes=[5,9]}}",
    "axes.both={zip={rod.length_m=[0.1,0.2],rod.nodes=[5]}}",
    "axes.both={zip={rod.length_m=[0.1,0.2]}}",
    "axes.both={zip={rod.length_m=[0.1,0.2],rod.nodes=5}}",
    "axes.both={zip={rod.length_m=[0.1,0.2],rod.nodes=[5,9]},labels=[\"a\",\"b\"]}",
    "axes.both={zip={rod.length_m=[0.1,0.2],rod.nodes=[5,9]},count=2}",
    "axes.rod.length={values=[0.1,0.2]}",
    "axes.rod.length_m={value=[0.1,0.2]}",
    "axes.rod.lenght_m=[0.1,0.2]",
    "axes.rod.length_m=[0.1,-0.2]",
    "axes.rod.nodes=[5,9.5]",
    "axes.solver.integrator=[\"newmark\",\"other\"]",
    "axes.solver.time_step_s=[1e-3,2e-3]|set.solver.tolerance=1e-3",
    "axes.rod.nodes=[5,9]|set.rod.nodes=7",
    "axes.rod.nodes=[5,9]|set.rod.length_m=-1",
    "axes.rod.nodes=[5,9]|set.rod.width_m=1",
    "axes.rod.nodes=[5,9]|name=\"a/b\"",
    "axes.rod.nodes=[5,9]|name=\"..\"",
    "axes.rod.nodes=[5,9]|record.frames=1",
    "axes.rod.nodes=[5,9]|record.frames=0",
    "axes.rod.nodes=[5,9]|record.frames=2",
    "axes.rod.nodes=[5,9]|record.frames=1000000",
    "axes.rod.nodes=[5,9]|record.frames=1000001",
    "axes.rod.nodes=[5,9]|record.traces=1000000",
    "axes.rod.nodes=[5,9]|record.traces=1000001",
    "axes.rod.nodes=[5,9]|record.played=0",
    "axes.rod.nodes=[5,9]|record.shown=0",
    "axes.rod.nodes=[5,9]|report.split=\"rod.nodes\"",
    "axes.rod.nodes=[5,9]|report.split=\"rod.length_m\"",
    "axes.rod.nodes=[5,9]|scene=\"none.toml\"",
    "axes.rod.nodes={from=3,to=1000000,count=1001}|axes.rod.length_m={from=1,to=2,count=1001}",
    "axes={}",
    "set.rod.nodes=3",
    "rod.nodes=3",
    "axes.steps=[1,2]",
    "axes.medium.flow_m_s=[[0,0],[0.1,0]]",
    "axes.head.kind=[\"free\",\"clamped\"]",
    "axes.rod.nodes=[5,5]",
];

#[test]
fn what_is_said_of_wrong_sweeps_is_what_was_said() {
    is_as_recorded("messages/sweeps", |_| {
        let mut text = String::new();
        for sweep in SWEEPS {
            let own = if sweep.contains("scene=") { "" } else { "scene=\"scene.toml\"\n" };
            let content = format!("{own}{}", sweep.replace('|', "\n"));
            let files = [("folder/sweep.toml", content.as_str()), ("folder/scene.toml", FREE)];
            let files = files.map(|(path, text)| (PathBuf::from(path), text.as_bytes().to_vec()));
            let files = Files::of(Contents::from(files));
            let said = match Sweep::read_from(&files, Path::new("folder/sweep.toml"), &[]) {
                Err(error) => error.to_string(),
                Ok(sweep) => {
                    let cases: Vec<String> = (0..sweep.size().min(3))
                        .map(|i| match sweep.case(i).and_then(|case| sweep.scene(&case)) {
                            Ok(_) => "accepted".to_string(),
                            Err(error) => error.to_string(),
                        })
                        .collect();
                    format!("{} cases: {}", sweep.size(), cases.join("\n"))
                }
            };
            case(&mut text, sweep, &said);
        }
        text
    });
}

/// Calls of the command, a line each; SCENE, SWEEP, DESIGN and OUT are files of the test's own.
const CALLS: &str = r#"

--help
--version
nothing
run
run none.toml
run SCENE --set rod.nodes
run SCENE --set =3
run SCENE --set rod.nodes=2
run SCENE --rubbish
run SWEEP
run SCENE --json --out OUT --set solver.duration_s=0.01 -q
check SCENE --set rod.nodes=1
check SCENE --set rod.nodes=5 -q
check none.toml
sweep SCENE
sweep none.toml
sweep SWEEP --dry-run
sweep SWEEP --jobs 0
sweep SWEEP --jobs x
sweep SWEEP --shard 0/2
sweep SWEEP --shard 1/2 --dry-run
sweep SWEEP --shard 3/2
sweep SWEEP --shard 1
sweep SWEEP --set rod.nodes=5 --dry-run
sweep merge
sweep merge OUT
design SCENE
design DESIGN --set design.goal=fly
study
study other SCENE
study modes SCENE --count 0
study modes SCENE --count 501
study modes SCENE --count -1
study scaling SCENE --nodes 2
study scaling SCENE --steps 0
study scaling SCENE --nodes 10000001
study accuracy SCENE --nodes 2
study accuracy SCENE --steps 0
study accuracy SCENE --steps -1,1
study accuracy SCENE --tolerances 0
study accuracy SCENE --without other
study stability SCENE --vary other
study stability SCENE --points 1
study stability SCENE --points 201
study stability SCENE --accurate 0
study stability SCENE --range 2,1
study stability SCENE --range 1,1
study stability SCENE --range 1
study stability SCENE --range 0,1
study stability SCENE --steps 0.2,0.1
study stability SCENE --vary flow
study stability SCENE --vary flow --steps 0.1,0.2
study stability SCENE --vary load
study stability SCENE --vary spin --range a,b
study stability SCENE --vary spin --range 0,1
study fluid none.toml
fmu SCENE --fmi 4
fmu SCENE --variables other --out OUT/a.fmu
fmu SCENE --nodes 99 --out OUT/a.fmu
fmu SCENE --library none.so --out OUT/a.fmu
variables none.toml
new
new OUT/made.toml --kind bird
new OUT/made.toml --fluid air
new OUT/made.toml --length 0.9e-6
new OUT/made.toml --length 1001
new OUT/made.toml --frequency 1.1e4
new OUT/made.toml --frequency 0.9e-4
new OUT/made.toml --length x
new OUT/made.toml --length 1e3 --frequency 1e-4
new OUT/made.toml
new OUT/made.toml --force
new OUT/least.toml --length 1e-6 --frequency 1e4 --fluid oil --kind tail
export
export none
export none --png
export OUT --png
export OUT --vtk
export SCENE --gif --fps 0 --out OUT/film
export SCENE --gif --speed 0 --out OUT/film
export SCENE --gif --speed nan --out OUT/film
export SCENE --gif --from 5 --out OUT/film
export SCENE --gif --from 0.5 --until 0.4 --out OUT/film
export SCENE --gif --fps 100000000 --out OUT/film
export SCENE OUT/film.svg --fps 30
export SCENE --gif --from 0 --speed 1e-6 --out OUT/film
export SCENE --vtk --fields other --out OUT/vtk
export SCENE --vtk --fields time_s,curvature_1_m --out OUT/vtk
compare
compare OUT
compare none OUT
compare SCENE OUT
compare OUT OUT
schema other
completions tcsh
man
"#;

#[test]
fn what_is_said_of_wrong_calls_is_what_was_said() {
    is_as_recorded("messages/calls", |_| {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
        let short = FREE.replace("duration_s = 2.0", "duration_s = 0.02");
        std::fs::write(path("scene.toml"), &short).unwrap();
        std::fs::write(path("sweep.toml"), "scene = \"scene.toml\"\naxes.rod.nodes = [5, 6, 7]\n").unwrap();
        std::fs::write(path("design.toml"), format!("{FREE}design.goal = \"distance\"\n")).unwrap();
        std::fs::create_dir(path("out")).unwrap();
        let files = [("SCENE", "scene.toml"), ("SWEEP", "sweep.toml"), ("DESIGN", "design.toml"), ("OUT", "out")];
        let mut text = String::new();
        for line in CALLS.lines().skip(1) {
            let full = files.iter().fold(line.to_string(), |line, (name, file)| line.replace(name, file));
            let mut command = Command::new(env!("CARGO_BIN_EXE_caudal"));
            let output = command.current_dir(folder.path()).args(full.split_whitespace()).output().unwrap();
            let mut said = format!("ends with {:?}\n", output.status.code());
            for (name, words) in [("out", &output.stdout), ("err", &output.stderr)] {
                let words = String::from_utf8_lossy(words).replace(folder.path().to_str().unwrap(), "FOLDER");
                let words = words.replace(env!("CARGO_PKG_VERSION"), "VERSION");
                // What is long is so for other tests.
                if words.lines().count() > 25 {
                    writeln!(said, "{name}: {} lines", words.lines().count()).unwrap();
                } else {
                    words.lines().for_each(|line| writeln!(said, "{name}: {line}").unwrap());
                }
            }
            case(&mut text, &format!("$ caudal {line}"), &said);
        }
        text
    });
}
