//! What the program printed and wrote for a few scenes, sweeps, studies and designs is kept in `tests/recorded`: a changed number, word or
//! row is a changed line there, whatever computed it. Whether the numbers are right is for the other tests; this one notices that one of
//! thousands is no longer what it was. A change that is meant is recorded anew, one entry or all, and its diff read:
//!
//!     CAUDAL_WRITE_RECORDED=1 cargo test --test command recorded::run_eel
//!     CAUDAL_WRITE_RECORDED=1 cargo test --test command recorded

use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

use crate::common::recorded::is_as_recorded;

/// A longer table is recorded by about so many of its rows.
const ROWS: usize = 16;

/// Columns of tables, and lines of JSON, that depend on the time that something took.
const TIMES: &[&str] = &[
    "wall_s",
    "processor_s",
    "times_as_long",
    "step_s",
    "ns_per_node_and_step",
    "ns_per_node_and_iteration",
    "memory_bytes_per_node",
];

/// A test of each entry: its name, as that of its file in `tests/recorded`, and its commands, a line each, without their folders. Words
/// with spaces are between single quotes.
macro_rules! recorded {
    ($($name:ident: $commands:literal;)*) => {
        const ALL: &[(&str, &str)] = &[$((stringify!($name), $commands)),*];
        $(#[test]
        fn $name() {
            is_as_recorded(&file_of(stringify!($name)), |longer| made($commands, longer));
        })*
    };
}

recorded! {
    // Runs.
    run_eel: "run models/eel.toml --set solver.duration_s=1.1 --set record.interval_s=0.27";
    run_driven_head: "run models/driven-head.toml --set solver.duration_s=2.0 --set record.interval_s=0.51";
    run_dipping_tail: "run models/dipping-tail.toml --set solver.duration_s=2.0 --set record.interval_s=0.63";
    run_worm_over_a_wall: "run models/worm-over-a-wall.toml --set solver.duration_s=0.6 --set record.interval_s=0.2";
    run_sinking_sphere: "run models/validation/sinking-sphere.toml --set record.interval_s=2.5";
    run_beck_column_damped: "run models/beck-column.toml --set rod.damping_time_s=0.01 --set solver.duration_s=1.0 --set record.interval_s=0.3";
    run_snake_as_shape: "run models/snake.toml --set solver.model=shape --set record.interval_s=3.0";
    run_sperm_overdamped: "run models/sperm.toml --set solver.model=overdamped --set record.interval_s=0.2";
    run_fish: "run models/fish.toml --set solver.duration_s=1.1 --set record.interval_s=0.27";
    run_muscle_eel: "run models/muscle-eel.toml --set solver.duration_s=1.1 --set record.interval_s=0.27";
    run_tendon_fish: "run models/tendon-fish.toml --set solver.duration_s=1.1 --set record.interval_s=0.27";
    run_servo_tail: "run models/servo-tail.toml --set solver.duration_s=1.1 --set record.interval_s=0.27";
    run_heaving_foil: "run models/heaving-foil.toml --set solver.duration_s=2.2 --set record.interval_s=0.53";
    run_out_of_glycerol: "run models/out-of-glycerol.toml --set solver.duration_s=2.0 --set record.interval_s=0.53";
    run_glycerol: "run models/glycerol.toml --set solver.duration_s=2.0 --set record.interval_s=0.53";
    run_spinning_bar: "run models/spinning-bar.toml --set record.interval_s=0.53";
    run_cantilever: "run models/cantilever.toml --set record.interval_s=1.0";
    run_flag: "run models/flag.toml --set rod.nodes=17 --set solver.duration_s=3.0 --set record.interval_s=0.7";
    run_baseline: "run models/baseline.toml --set solver.duration_s=1.0 --set record.interval_s=0.26";
    run_silicone_tail_adaptive: r#"run models/silicone-tail.toml --set 'solver={ integrator = "esdirk3", tolerance = 1e-3, duration_s = 1.0 }' --set record.interval_s=0.21"#;
    run_auto: "run models/silicone-tail.toml --set drag.law=auto --set reactive=auto --set solver.model=auto --set solver.duration_s=1.0 --set record.interval_s=0.3
        run models/snake.toml --set solver.model=auto --set record.interval_s=3.0
        run models/glycerol.toml --set solver.model=auto --set solver.duration_s=2.0 --set record.interval_s=0.6";
    run_verified: "run tests/recorded/tail.toml --verify --set record.interval_s=0.6
        run tests/recorded/tail.toml --verify --set solver.model=overdamped --set record.interval_s=0.6
        run models/eel.toml --verify --set solver.model=shape --set rod.nodes=9 --set solver.duration_s=1.0 --set record.interval_s=0.6";
    run_json: "run tests/recorded/tail.toml --json --set record.interval_s=0.6";
    run_warned: "run tests/recorded/tail.toml --set rod.youngs_modulus_pa=1e3 --set actuation.kappa_amp=20 --set solver.time_step_s=0.02 --set record.interval_s=0.6
        run models/spinning-bar.toml --set solver.time_step_s=0.05 --set record.interval_s=0.5
        run models/eel.toml --set solver.integrator=implicit-euler --set solver.time_step_s=0.05 --set solver.duration_s=1.5 --set record.interval_s=0.5";
    run_measures: r#"run tests/recorded/tail.toml --set medium.flow_m_s=[0.1,0.0] --set rod.damping_time_s=0.01 --set record.interval_s=0.7
        run models/eel.toml --set rod.nodes=9 --set solver.duration_s=2 --set loads.gravity_m_s2=[0.0,-0.1] --set record.interval_s=0.7
        run models/eel.toml --set rod.nodes=9 --set solver.duration_s=2 --set actuation.frequency_hz=0 --set record.interval_s=0.7
        run models/driven-head.toml --set rod.nodes=9 --set solver.duration_s=3 --set head.angle_rad.frequency_hz=1.37 --set record.interval_s=0.7
        run models/validation/oblique-fall.toml --set record.interval_s=1.3
        run models/validation/kirchhoff-spheroid.toml --set solver.duration_s=2.0 --set record.interval_s=0.7
        run models/validation/sznitman-worm.toml --set rod.nodes=9 --set record.interval_s=0.7
        run models/validation/kern-koumoutsakos-eel.toml --set rod.nodes=13 --set solver.duration_s=3.0 --set record.interval_s=0.7
        run tests/recorded/tail.toml --set drag.law=nonlocal --set record.interval_s=0.7"#;
    run_failing: "run tests/recorded/tail.toml --set loads.gravity_m_s2=[-3000.0,1.0] --set record.interval_s=0.01";

    // Checks.
    check_eel: "check models/eel.toml";
    check_flag: "check models/flag.toml";
    check_sperm: "check models/sperm.toml --set solver.model=auto";
    check_dipping_tail: "check models/dipping-tail.toml";
    check_silicone_tail_auto: "check models/silicone-tail.toml --set drag.law=auto --set reactive=auto --set rod.loss_factor=0.2";
    check_sphere: "check models/validation/sinking-sphere.toml";
    check_studies_tail: "check models/baseline.toml
        check models/baseline-in-water.toml
        check models/baseline-smooth.toml
        check models/glycerol.toml
        check models/isotropic.toml
        check models/newmark-compare-implicit-euler.toml
        check models/newmark-compare-newmark.toml
        check models/spinning-bar.toml";
    check_swimmers: "check models/fish.toml
        check models/muscle-eel.toml
        check models/tendon-fish.toml
        check models/servo-tail.toml
        check models/snake.toml
        check models/worm-over-a-wall.toml
        check models/design-silicone-eel.toml
        check models/design-actuation.toml
        check models/design-aluminium.toml";
    check_held: "check models/beck-column.toml
        check models/cantilever.toml
        check models/driven-head.toml
        check models/elastic-tail-in-oil.toml
        check models/heaving-foil.toml
        check models/out-of-glycerol.toml
        check models/design-tip.toml
        check models/design-identify-drag.toml
        check tests/recorded/tail.toml";
    check_fine: "check models/fine-1e3.toml
        check models/fine-1e4.toml
        check models/fine-1e5.toml --set solver.duration_s=0.1";
    check_validation: "check models/validation/falling-fibre.toml --set rod.nodes=33
        check models/validation/kern-koumoutsakos-eel.toml
        check models/validation/kirchhoff-spheroid.toml
        check models/validation/oblique-fall.toml
        check models/validation/pyelastica-flagella.toml --set rod.nodes=17
        check models/validation/sznitman-worm.toml
        check models/validation/yu-lauga-hosoi-tail.toml --set rod.nodes=17";
    check_models: "check tests/recorded/tail.toml --set solver.model=auto
        check tests/recorded/tail.toml --set solver.model=overdamped
        check tests/recorded/tail.toml --set solver.model=shape
        check tests/recorded/tail.toml --set solver.model=auto --set start.kind=shaped
        check models/eel.toml --set solver.model=auto
        check models/eel.toml --set solver.model=shape
        check models/baseline.toml --set solver.model=auto
        check models/snake.toml --set solver.model=auto
        check models/glycerol.toml --set solver.model=auto
        check models/driven-head.toml --set solver.model=auto
        check models/driven-head.toml --set solver.model=overdamped
        check models/cantilever.toml --set solver.model=auto
        check models/cantilever.toml --set solver.model=shape
        check models/flag.toml --set solver.model=auto
        check models/worm-over-a-wall.toml --set solver.model=auto";
    check_fluids: r#"check models/eel.toml --set drag.law=auto --set reactive=auto
        check models/fish.toml --set drag.law=auto --set reactive=auto
        check models/snake.toml --set drag.law=auto
        check models/glycerol.toml --set drag.law=cross-flow
        check models/worm-over-a-wall.toml --set 'drag={ law = "auto" }'
        check models/elastic-tail-in-oil.toml --set 'drag={ law = "auto" }' --set reactive=auto
        check models/flag.toml --set drag.law=auto --set reactive=auto
        check models/heaving-foil.toml --set drag.law=auto --set reactive=auto
        check tests/recorded/tail.toml --set drag.law=auto --set reactive=auto
        check tests/recorded/tail.toml --set drag.law=nonlocal
        check tests/recorded/tail.toml --set drag.law=gray-hancock
        check tests/recorded/tail.toml --set drag.law=lighthill
        check tests/recorded/tail.toml --set drag.law=stokes-like --set drag.ratio=2
        check tests/recorded/tail.toml --set drag.law=weak-inertia
        check tests/recorded/tail.toml --set drag.law=cross-flow --set medium.viscosity_pa_s=1e-3"#;
    check_warned: r#"check tests/recorded/tail.toml --set solver.time_step_s=0.3
        check tests/recorded/tail.toml --set solver.integrator=symplectic-euler
        check tests/recorded/tail.toml --set actuation.kappa_amp=60
        check tests/recorded/tail.toml --set actuation.frequency_hz=0
        check tests/recorded/tail.toml --set rod.nodes=101
        check tests/recorded/tail.toml --set rod.nodes=3001 --set solver.time_step_s=1
        check models/driven-head.toml --set 'head={ kind = "driven" }'
        check models/driven-head.toml --set rod.nodes=5 --set 'head={ kind = "driven", angle_rad = { amplitude = 0.4, frequency_hz = 20.0 } }' --set solver.time_step_s=1e-3
        check models/driven-head.toml --set solver.model=shape
        check models/muscle-eel.toml --set start.kind=jump
        check models/muscle-eel.toml --set start.kind=shaped
        check models/muscle-eel.toml --set actuation.moment_amp_n_m=3
        check models/baseline.toml --set start.kind=jump --set solver.time_step_s=0.01
        check models/baseline.toml --set 'solver={ integrator = "esdirk3", tolerance = 1e-3, duration_s = 1.0 }'
        check models/dipping-tail.toml --set rod.nodes=9 --set medium.beyond.thickness_m=1e-4"#;
    check_damped: "check tests/recorded/tail.toml --set rod.damping_time_s=0.01
        check tests/recorded/tail.toml --set rod.loss_factor=0.3
        check models/muscle-eel.toml --set rod.loss_factor=0.2
        check models/driven-head.toml --set rod.damping_time_s=1
        check models/fish.toml --set rod.loss_factor=0.2
        check models/silicone-tail.toml --set rod.damping_time_s=0.01";
    check_refused: "check tests/recorded/nothing.toml
        check tests/recorded/tail.toml --set rod.nods=9
        check tests/recorded/tail.toml --set rod.nodes=2
        check tests/recorded/tail.toml --set rod.nodes=nine
        check tests/recorded/tail.toml --set drag.law=stokes
        check tests/recorded/tail.toml --set solver.integrator=newton
        check tests/recorded/tail.toml --set medium.viscosity_pa_s=-1
        check tests/recorded/tail.toml --set actuation.wavelength_m=0
        check tests/recorded/tail.toml --set head.kind=loose";
    check_models_taken: "check models/snake.toml --set solver.model=auto --set solver.accuracy=0.9
        check models/elastic-tail-in-oil.toml --set solver.model=auto --set solver.accuracy=0.9
        check models/elastic-tail-in-oil.toml --set solver.model=auto --set solver.accuracy=1e-6
        check models/glycerol.toml --set solver.model=auto --set solver.accuracy=0.9
        check models/validation/sznitman-worm.toml --set solver.model=auto --set solver.accuracy=0.5
        run models/elastic-tail-in-oil.toml --set rod.nodes=9 --set solver.model=auto --set solver.accuracy=0.9 --set record.interval_s=13";
    check_more: r#"check models/validation/kirchhoff-spheroid.toml --set head_body.semi_axis_across_m=1.5
        check tests/recorded/tail.toml --set rod.nodes=3001 --set solver.form=positions --set start.kind=shaped --set solver.time_step_s=1e-6 --set solver.duration_s=1e-4
        check tests/recorded/tail.toml --set start.curvature_1_m=2.0 --set solver.model=auto
        check tests/recorded/tail.toml --set start.curvature_1_m=2.0 --set solver.model=shape
        check models/beck-column.toml --set start.curvature_1_m=0.5 --set solver.time_step_s=0.1
        check models/muscle-eel.toml --set start.kind=shaped --set actuation.frequency_hz=10
        check tests/recorded/tail.toml --set 'rod.damping_time_s=[[0, 0.01], [1, 0.02]]'
        check models/beck-column.toml --set rod.nodes=9 --set solver.integrator=symplectic-euler
        check tests/recorded/tail.toml --set rod.section=round --set rod.depth_m=0.03
        check tests/recorded/tail.toml --set rod.inner_radius_m=0.003 --set rod.density_kg_m3=500
        check models/dipping-tail.toml --set medium.beyond.density_kg_m3=1.0
        check tests/recorded/tail.toml --set head.kind=free --set rod.density_kg_m3=2000
        check models/driven-head.toml --set solver.model=shape --set head.angle_rad=0.1
        check models/silicone-tail.toml --set solver.integrator=esdirk3 --set solver.time_step_s=0.2"#;
    variables: "variables models/dipping-tail.toml";
    variables_of_others: "variables models/muscle-eel.toml
        variables models/tendon-fish.toml
        variables models/servo-tail.toml
        variables models/driven-head.toml";

    // Studies.
    modes_silicone_tail: "study modes models/silicone-tail.toml --count 5";
    modes_others: "study modes models/flag.toml --count 4 --set rod.nodes=9
        study modes models/flag.toml --count 4 --set rod.nodes=9 --set 'medium.flow_m_s=[0.5, 0.0]'
        study modes models/eel.toml --count 4 --set rod.nodes=9
        study modes models/baseline.toml --count 4
        study modes models/beck-column.toml --count 4 --set rod.nodes=9
        study modes models/cantilever.toml --count 4 --set rod.nodes=9
        study modes tests/recorded/tail.toml --count 4 --set rod.damping_time_s=0.01
        study modes models/snake.toml --count 4 --set rod.nodes=9
        study modes models/dipping-tail.toml --count 4 --set rod.nodes=9
        study modes models/spinning-bar.toml --count 20
        study modes models/validation/kirchhoff-spheroid.toml
        study modes models/validation/yu-lauga-hosoi-tail.toml --count 3
        study modes models/driven-head.toml --count 3 --set rod.nodes=601";
    stability_beck: "study stability models/beck-column.toml --vary load --points 4 --set rod.nodes=9";
    stability_load: "study stability models/beck-column.toml --vary load --points 4 --set rod.nodes=9 --set rod.damping_time_s=0.01
        study stability models/beck-column.toml --vary load --points 3 --range 0.01,0.02 --set rod.nodes=9
        study stability models/beck-column.toml --vary load --points 3 --range 3,6 --set rod.nodes=9
        study stability models/cantilever.toml --vary load --points 3 --set rod.nodes=9
        study stability models/beck-column.toml --vary load --points 3 --set rod.nodes=9 --set 'loads.point=[{ node = -1, force_n = [-1.0, 0.0] }]'
        study stability models/eel.toml --vary load
        study stability tests/recorded/tail.toml --vary load";
    stability_flag: "study stability models/flag.toml --vary flow --points 4 --set rod.nodes=9";
    stability_flow: "study stability models/flag.toml --vary flow --points 3 --set rod.nodes=9 --set 'medium.flow_m_s=[0.5, 0.0]'
        study stability models/flag.toml --vary flow --points 3 --range 0.1,0.2 --set rod.nodes=9
        study stability models/flag.toml --vary flow --points 3 --set rod.nodes=9 --set 'medium.flow_m_s=[-0.5, 0.0]'
        study stability models/flag.toml --vary flow --points 3 --set rod.nodes=9 --set 'medium.flow_m_s=[0.5, 0.1]'
        study stability models/silicone-tail.toml --vary flow --points 3 --set rod.nodes=9";
    stability_flow_of_others: r#"study stability models/flag.toml --vary flow --points 3 --set rod.nodes=9 --set 'rod.stiffness_profile=[[0, 1.5], [1, 0.5]]' --set 'head={ kind = "driven", angle_rad = 0.1 }'
        study stability models/flag.toml --vary flow --points 3 --set rod.nodes=9 --set 'loads={ gravity_m_s2 = [1.0, 0.0] }'
        study stability models/eel.toml --vary flow
        study stability tests/recorded/tail.toml --vary flow"#;
    stability_steps: "study stability tests/recorded/tail.toml --vary modulus --points 3 --set solver.duration_s=0.2
        study stability tests/recorded/tail.toml --vary amplitude --points 3 --steps 2e-3,5e-2 --set solver.duration_s=0.3";
    stability_spin: "study stability models/spinning-bar.toml --vary spin --points 3 --range 1,300 --steps 1e-4,1e-2 --set solver.duration_s=0.05";
    stability_meshes: "study stability tests/recorded/tail.toml --vary nodes --points 3 --range 5,17 --set solver.duration_s=0.3 --accurate 0.01
        study stability tests/recorded/tail.toml --vary damping --points 3 --range 1e-4,1e-2 --set solver.duration_s=0.3
        study stability models/driven-head.toml --vary amplitude
        study stability tests/recorded/tail.toml --vary spin
        study stability tests/recorded/tail.toml --vary colour
        study stability tests/recorded/tail.toml --points 1
        study stability tests/recorded/tail.toml --range 2,1";
    fluid_driven_head: "study fluid models/driven-head.toml --set solver.duration_s=2.0";
    fluid_swimmers: "study fluid models/eel.toml --set rod.nodes=9 --set solver.duration_s=1.0 --set solver.time_step_s=0.01
        study fluid models/glycerol.toml --set solver.duration_s=2.0
        study fluid models/snake.toml --set rod.nodes=9 --set solver.duration_s=4.0
        study fluid models/worm-over-a-wall.toml --set rod.nodes=9 --set solver.duration_s=0.6";
    fluid_held: "study fluid tests/recorded/tail.toml --set solver.duration_s=1.0
        study fluid tests/recorded/tail.toml --set solver.duration_s=1.0 --set medium.viscosity_pa_s=100
        study fluid tests/recorded/tail.toml --set solver.duration_s=1.0 --set medium.viscosity_pa_s=1e-3 --set reactive={}";
    fluid_of_others: "study fluid models/silicone-tail.toml --set rod.nodes=9 --set solver.duration_s=1.0 --set solver.time_step_s=0.01
        study fluid models/elastic-tail-in-oil.toml --set rod.nodes=9 --set solver.duration_s=14
        study fluid models/flag.toml --set rod.nodes=9 --set solver.duration_s=0.5
        study fluid models/baseline.toml --set solver.duration_s=0.5
        study fluid models/dipping-tail.toml
        study fluid models/beck-column.toml";
    accuracy_driven_head: "study accuracy models/driven-head.toml --nodes 9 --steps 1e-2,2e-3 --tolerances 1e-3 --set solver.duration_s=1.0";
    accuracy_alone: "study accuracy tests/recorded/tail.toml --nodes 5,9,17 --steps 1e-2 --tolerances 1e-3 --set solver.duration_s=1.0 --set solver.integrator=generalized-alpha --without implicit-euler,newmark,esdirk3,symplectic-euler,shape,overdamped
        study accuracy models/eel.toml --nodes 5 --steps 1e-3 --tolerances 1e-2 --set solver.time_step_s=1e-3 --set solver.duration_s=0.5 --without implicit-euler,newmark,esdirk3,symplectic-euler,shape,overdamped
        study accuracy models/baseline.toml --nodes 5 --steps 1e-3 --set solver.duration_s=0.1 --without nothing";
    accuracy_without_reference: "study accuracy tests/recorded/tail.toml --nodes 9 --steps 0.1 --set solver.time_step_s=0.1 --set solver.integrator=generalized-alpha --set solver.duration_s=1.0 --without implicit-euler,newmark,esdirk3,symplectic-euler,shape,overdamped";
    accuracy_of_others: "study accuracy tests/recorded/tail.toml --nodes 9 --steps 0.02 --set solver.time_step_s=0.02 --set solver.integrator=generalized-alpha --set solver.duration_s=1.0 --without implicit-euler,newmark,esdirk3,symplectic-euler,shape,overdamped
        study accuracy models/snake.toml --nodes 5 --steps 0.02 --tolerances 1e-2 --set solver.duration_s=1.0";
    scaling: "study scaling tests/recorded/tail.toml --nodes 9,17 --steps 3";

    // Sweeps.
    sweep: "sweep tests/recorded/sweep.toml";
    sweep_of_two: "sweep tests/recorded/sweep-of-two.toml
        sweep tests/recorded/sweep-of-two.toml --dry-run
        sweep tests/recorded/sweep-of-two.toml --shard 1/2";
    sweep_of_swimmers: "sweep tests/recorded/sweep-of-swimmers.toml
        sweep models/sweep-192.toml --dry-run
        sweep models/sweep-muscles.toml --dry-run
        sweep models/sweep-192.toml --shard 1/64 --set solver.duration_s=0.05";

    // Designs.
    design_tip: "design models/design-tip.toml --set design.iterations=4";
    design_driven_head: "design models/design-driven-head.toml --set design.iterations=2 --set rod.nodes=9 --set solver.duration_s=3.0";
    design_actuation: "design models/design-actuation.toml --set rod.nodes=9 --set solver.duration_s=3.0 --set solver.time_step_s=1e-2 --set design.iterations=6";
    design_front: r#"design models/eel.toml --set rod.nodes=9 --set solver.time_step_s=0.01 --set solver.duration_s=2.0 --set 'design={ goal = "cycle_forward_speed_m_s", variables = ["actuation.kappa_amp", "actuation.wavelength_m"], number_bounds = [0.6, 1.5], front = { goal = "cycle_cost_of_transport", better = "smaller", points = 3 }, starts = 1, iterations = 5 }'"#;
    design_front_of_ways: r#"design models/design-silicone-eel.toml --set rod.nodes=9 --set solver.duration_s=2.0 --set solver.time_step_s=1e-2 --set 'design={ goal = "distance", direction = "-x", knots = [0.1, 0.9], front = { goal = "efficiency", points = 3 }, starts = 1, iterations = 6 }'"#;
    design_neutral_body: r#"design models/eel.toml --set rod.nodes=9 --set solver.time_step_s=0.01 --set solver.duration_s=1.5 --set 'rod.inner_radius_m=[[0.0, 0.002], [0.1, 0.004], [1.0, 0.0008]]' --set 'design={ goal = "cycle_forward_speed_m_s", variables = ["rod.density_kg_m3", "rod.outer_radius_m", "rod.inner_radius_m"], number_bounds = [0.5, 1.6], neutral_buoyancy = true, least_wall_m = 1.2e-3, starts = 1, iterations = 3 }'"#;
    design_limits: r#"design models/eel.toml --set rod.nodes=9 --set solver.time_step_s=0.01 --set solver.duration_s=2.0 --set 'design={ goal = "cycle_actuation_power_w", better = "smaller", variables = ["actuation.kappa_amp", "stiffness", "amplitude", "phase"], knots = [0.2, 0.8], number_bounds = [0.5, 2.0], least_speed_m_s = 0.3, largest_moment_n_m = 0.05, largest_strain = 0.1, largest_power_w = 1.0, starts = 2, iterations = 4 }'"#;
    design_mass: r#"design models/eel.toml --set rod.nodes=9 --set solver.time_step_s=0.01 --set solver.duration_s=2.0 --set 'design={ goal = "cycle_forward_speed_m_s", variables = ["rod.outer_radius_m"], number_bounds = { "rod.outer_radius_m" = [0.8, 1.3] }, largest_mass_kg = 0.11, starts = 1, iterations = 5 }'"#;
    design_thrust: r#"design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", knots = [0.5], starts = 2, iterations = 20 }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_head_power_w", knots = [0.5], starts = 1 }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_actuation_power_w", better = "smaller", monotone = true, smoothness = 1e-3, bounds = [0.5, 2.0], mean = 1.0, least_thrust_n = 1e-5, starts = 1, iterations = 6 }'"#;
    design_robust: r#"design tests/recorded/tail.toml --set solver.duration_s=1.5 --set 'design={ goal = "cycle_thrust_n", knots = [0.5], starts = 1, iterations = 10, over = "cases.toml" }'
        design tests/recorded/tail.toml --set solver.duration_s=1.0 --set 'design={ goal = "cycle_thrust_n", knots = [0.2, 0.8], starts = 1, iterations = 4, over = "cases.toml", robust = "mean", largest_moment_n_m = 0.01 }'"#;
    design_robust_way: r#"design models/design-silicone-eel.toml --set rod.nodes=9 --set solver.duration_s=2.0 --set solver.time_step_s=1e-2 --set 'design={ goal = "efficiency", direction = "+x", variables = ["stiffness", "phase"], knots = [0.5], over = "../tests/recorded/cases.toml", starts = 2, iterations = 6 }'"#;
    design_identify_drag: "design models/design-identify-drag.toml";
    design_identify_drag_badly: "design models/design-identify-drag.toml --set design.noise_m=2e-5 --set rod.density_kg_m3=4000
        design models/design-identify-drag.toml --set design.iterations=2
        design models/design-identify-drag.toml --set solver.time_step_s=1e-2 --set design.number_bounds=[0.9,1.1]";
    design_identify: r#"design tests/recorded/tail.toml --set 'design={ goal = "identify", data = "tail-markers.csv", bounds = [0.05, 20.0], actuation_gain = true }'
        design tests/recorded/tail.toml --set 'design={ goal = "identify", data = "tail-markers.csv" }'"#;
    design_identify_badly: r#"design tests/recorded/tail.toml --set medium.viscosity_pa_s=0.3 --set 'design={ goal = "identify", data = "tail-markers.csv", bounds = [0.05, 20.0] }'
        design tests/recorded/tail.toml --set rod.youngs_modulus_pa=2e7 --set 'design={ goal = "identify", data = "tail-markers.csv", bounds = [0.5, 2.0], monotone = true, smoothness = 1e3, noise_m = 1e-4, window_s = 0.2 }'
        design tests/recorded/tail.toml --set actuation.kappa_amp=60 --set 'design={ goal = "identify", data = "tail-markers.csv", knots = [0.2, 0.8], mean = 1.0, actuation_gain = true }'"#;
    design_identify_by_search: r#"design tests/recorded/tail.toml --set 'design={ goal = "identify", data = "tail-few-markers.csv", variables = ["stiffness", "actuation.kappa_amp", "medium.viscosity_pa_s"], knots = [0.0, 1.0] }'
        design tests/recorded/tail.toml --set 'design={ goal = "identify", data = "tail-few-markers.csv", variables = ["rod.density_kg_m3", "actuation.frequency_hz"], noise_m = 2e-6 }'
        design tests/recorded/tail.toml --set 'design={ goal = "identify", data = "tail-few-markers.csv", variables = ["rod.youngs_modulus_pa", "stiffness"], knots = [0.5] }'"#;
    design_track: r#"design tests/recorded/tail.toml --set 'design={ goal = "track-tip", data = "tail-tip.csv", knots = [0.0, 1.0] }'
        design tests/recorded/tail.toml --set 'design={ goal = "track-tip", data = "tail-tip.csv", variables = ["actuation.kappa_amp", "amplitude", "phase"], knots = [0.5], noise_m = 1e-5 }'"#;
    design_identify_free: "design models/design-identify.toml --set solver.time_step_s=5e-3";
    design_aluminium: "design models/design-aluminium.toml --set solver.time_step_s=5e-3";
    design_without_gain: r#"design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", bounds = [1.0, 1.0], starts = 1 }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", knots = [0.5], bounds = [0.1, 0.11], mean = 0.11, starts = 1 }'
        design tests/recorded/tail.toml --set drag.law=cross-flow --set medium.viscosity_pa_s=1e-3 --set solver.duration_s=0.6 --set 'design={ goal = "cycle_thrust_n", knots = [0.5], starts = 1, iterations = 3 }'
        design models/eel.toml --set rod.nodes=9 --set solver.time_step_s=0.01 --set solver.duration_s=0.75 --set 'design={ goal = "cycle_forward_speed_m_s", variables = ["actuation.kappa_amp"], number_bounds = [0.9, 1.1], starts = 1, iterations = 3, least_speed_m_s = 5.0 }'"#;
    design_impossible: r#"design tests/recorded/tail.toml --set solver.duration_s=1.0 --set 'design={ goal = "cycle_thrust_n", knots = [0.5], starts = 1, iterations = 2, least_thrust_n = 10.0 }'
        design tests/recorded/tail.toml --set 'design={ goal = "identify", data = "tail-markers.csv", bounds = [0.9, 1.0], mean = 3.0 }'
        design models/cantilever.toml --set rod.nodes=9 --set 'loads={ point = [{ node = 4, force_n = [0.0, -0.1] }] }' --set 'design={ goal = "static-shape", data = "../tests/recorded/hanging.csv" }'
        design models/driven-head.toml --set 'design={ goal = "identify", data = "../tests/recorded/tail-markers.csv" }'
        design models/driven-head.toml --set rod.nodes=9 --set 'design={ goal = "identify", data = "../tests/recorded/tail-markers.csv", actuation_gain = true }'"#;
    design_shape: r#"design models/cantilever.toml --set rod.nodes=9 --set 'design={ goal = "static-shape", data = "../tests/recorded/hanging.csv" }'
        design models/cantilever.toml --set rod.nodes=9 --set 'design={ goal = "static-shape", data = "../tests/recorded/hanging.csv", bounds = [1.2, 3.0], knots = [0.1, 0.9], smoothness = 1e-3 }'
        design models/cantilever.toml --set rod.nodes=9 --set 'loads.gravity_m_s2=[0.0, 0.89]' --set 'design={ goal = "static-shape", data = "../tests/recorded/hanging.csv" }'
        design models/eel.toml --set rod.nodes=9 --set 'design={ goal = "static-shape", data = "../tests/recorded/hanging.csv" }'
        design models/cantilever.toml --set rod.nodes=9 --set 'design={ goal = "static-shape", data = "../tests/recorded/hanging-in-millimetres.csv" }'
        design models/cantilever.toml --set rod.nodes=9 --set 'design={ goal = "static-shape", data = "../tests/recorded/hanging-off-the-rod.csv" }'
        design models/cantilever.toml --set rod.nodes=17 --set 'design={ goal = "static-shape", data = "../tests/recorded/hanging.csv" }'
        design models/cantilever.toml --set rod.nodes=9 --set 'design={ goal = "identify", data = "../tests/recorded/hanging.csv" }'
        design models/cantilever.toml --set rod.nodes=9 --set 'design={ goal = "static-shape", data = "../tests/recorded/nothing.csv" }'"#;
    design_refused: r#"design tests/recorded/tail.toml
        design tests/recorded/tail.toml --set 'design={ goal = "thrust" }'
        design tests/recorded/tail.toml --set 'design={ goal = "distance" }'
        design tests/recorded/tail.toml --set 'design={ goal = "distance", direction = "+y" }'
        design tests/recorded/tail.toml --set 'design={ goal = "distance", direction = "+x" }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", direction = "+x" }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", better = "best" }'
        design tests/recorded/tail.toml --set 'design={ goal = "distance", direction = "+x", better = "larger" }'
        design tests/recorded/tail.toml --set 'design={ goal = "identify" }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", bounds = [2.0, 1.0] }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", smoothness = -1.0 }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", mean = -1.0 }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", mean = 0.001 }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", knots = [0.5, 0.2] }'
        design tests/recorded/tail.toml --set 'design={ goal = "identify", data = "tail-markers.csv", noise_m = 0.0 }'
        design tests/recorded/tail.toml --set 'design={ goal = "identify", data = "tail-few-markers.csv" }'
        design tests/recorded/tail.toml --set 'design={ goal = "identify", data = "tail-markers.csv", variables = ["stiffness", "phase"] }'
        design tests/recorded/tail.toml --set 'design={ goal = "identify", data = "tail-markers.csv", variables = ["rod.density_kg_m3"], actuation_gain = true }'
        design tests/recorded/tail.toml --set 'design={ goal = "identify", data = "tail-markers.csv", over = "cases.toml" }'
        design tests/recorded/tail.toml --set drag.law=nonlocal --set 'design={ goal = "identify", data = "tail-markers.csv" }'
        design tests/recorded/tail.toml --set solver.time_step_s=0.03 --set 'design={ goal = "track-tip", data = "tail-tip.csv" }'
        design tests/recorded/tail.toml --set 'design={ goal = "track-tip", data = "tail-tip.csv", largest_strain = 0.1 }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", variables = [] }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", variables = ["rod.colour"] }'
        design tests/recorded/tail.toml --set rod.loss_factor=0.0 --set 'design={ goal = "cycle_thrust_n", variables = ["rod.loss_factor"] }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", number_bounds = [0.5, 2.0] }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", variables = ["rod.density_kg_m3"], number_bounds = [2.0, 0.5] }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", variables = ["rod.density_kg_m3"], number_bounds = { "rod.length_m" = [0.5, 2.0] } }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", amplitude_bounds = [0.5, 2.0] }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", variables = ["amplitude"], amplitude_bounds = [0.0, 2.0] }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", variables = ["phase"], phase_bounds_rad = [2.0, 1.0] }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", variables = ["amplitude"], amplitude_mean = -1.0 }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", least_speed_m_s = 0.1 }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", largest_strain = 0.0 }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", largest_mass_kg = 0.1 }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", robust = "mean" }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", variables = ["rod.youngs_modulus_pa"], over = "cases.toml" }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", front = { goal = "cycle_thrust_n" } }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", front = { goal = "distance" } }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", front = { goal = "cycle_actuation_power_w", points = 2 } }'
        design tests/recorded/tail.toml --set 'design={ goal = "cycle_thrust_n", front = { goal = "cycle_actuation_power_w", better = "best" } }'
        design models/driven-head.toml --set 'design={ goal = "cycle_thrust_n", largest_power_w = 1.0 }'
        design models/driven-head.toml --set 'design={ goal = "cycle_thrust_n", variables = ["amplitude"] }'
        design models/muscle-eel.toml --set 'design={ goal = "identify", data = "../tests/recorded/tail-markers.csv", actuation_gain = true }'
        design models/cantilever.toml --set 'design={ goal = "cycle_thrust_n" }'
        design models/eel.toml --set 'design={ goal = "cycle_thrust_n" }'
        design models/eel.toml --set 'design={ goal = "cycle_forward_speed_m_s", least_thrust_n = 1.0 }'"#;
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The name of an entry's file.
fn file_of(name: &str) -> String {
    name.replace('_', "-")
}

/// The words of a command; those with spaces are between single quotes.
fn words(command: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    for (i, part) in command.trim().split('\'').enumerate() {
        if i % 2 == 1 {
            words.last_mut().unwrap().push_str(part);
            continue;
        }
        for (k, word) in part.split(' ').enumerate() {
            if k > 0 {
                words.push(String::new());
            }
            words.last_mut().unwrap().push_str(word);
        }
    }
    words.retain(|word| !word.is_empty());
    words
}

/// The length (m) of the rod of the scene, or of the sweep's scene, in `file`.
fn length_in(file: &Path) -> Option<f64> {
    let table: toml::Table = toml::from_str(&std::fs::read_to_string(file).ok()?).ok()?;
    match table.get("scene") {
        Some(scene) => length_in(&file.parent()?.join(scene.as_str()?)),
        None => table.get("rod")?.get("length_m")?.as_float(),
    }
}

/// What the commands print and write, of a rod that is `longer` by this part of its length.
fn made(commands: &str, longer: f64) -> String {
    let mut text = String::new();
    for command in commands.lines() {
        let words = words(command);
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let mut caudal = Command::new(env!("CARGO_BIN_EXE_caudal"));
        caudal.current_dir(root()).args(&words);
        if matches!(&*words[0], "run" | "study" | "sweep" | "design") {
            caudal.arg("--out").arg(&out);
        }
        let scene = words.iter().find(|word| word.ends_with(".toml")).filter(|_| words[0] != "variables");
        if let Some(length) = scene.and_then(|scene| length_in(&root().join(scene))).filter(|_| longer != 0.0) {
            caudal.arg("--set").arg(format!("rod.length_m={:e}", length * (1.0 + longer)));
        }
        let output = caudal.output().unwrap();
        writeln!(text, "$ caudal {}, which ends with {:?}", command.trim(), output.status.code()).unwrap();
        // Where several ways are compared, it is said which was the quickest.
        let raced = words.iter().any(|word| word == "accuracy") && !words.iter().any(|word| word == "--without");
        let said = String::from_utf8([&output.stderr[..], &output.stdout].concat()).unwrap();
        let said = said.replace(out.to_str().unwrap(), "OUT").replace(folder.path().to_str().unwrap(), "FOLDER");
        for line in said.lines() {
            text.extend(told(line, raced).map(|line| line + "\n"));
        }
        let mut files: Vec<String> = std::fs::read_dir(&out)
            .map(|all| all.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect())
            .unwrap_or_default();
        files.sort();
        // Pages, figures and bodies are for others; whose a folder is depends on the build.
        for file in files.iter().filter(|file| *file != "manifest.json") {
            let kind = file.rsplit('.').next().unwrap_or_default();
            // What the quickest of several methods takes for an error is another every time.
            let quickest = raced && file == "targets.csv";
            if quickest || !matches!(kind, "csv" | "json" | "md" | "mtx" | "toml") {
                continue;
            }
            writeln!(text, "\n== {file}").unwrap();
            let content = std::fs::read_to_string(out.join(file)).unwrap();
            let lines = match kind {
                "csv" => columns(&content),
                "mtx" => some_of(&content.lines().collect::<Vec<_>>()).join("\n"),
                "json" if raced => without_races(&content),
                _ => content,
            };
            for line in lines.lines() {
                text.extend(told(line, raced).map(|line| line + "\n"));
            }
        }
        text.push('\n');
    }
    text
}

/// A line without what depends on times, and on which of several ways was the quickest where they are `raced`; none where nothing is left.
fn told(line: &str, raced: bool) -> Option<String> {
    if TIMES.iter().any(|key| line.trim_start().starts_with(&format!("\"{key}\":"))) {
        return None;
    }
    let mut line = line.to_string();
    if line.contains("Newton iterations,") {
        line.truncate(line.rfind(", ").unwrap()); // how long it took
    }
    if let Some((cases, _)) = line.split_once(" cases in ").filter(|_| line.ends_with(" s")) {
        line = format!("{cases} cases in ~ s"); // as above
    }
    if raced && let Some((kept, _)) = line.split_once(" The full model by ") {
        line = kept.to_string();
    }
    let best = line.contains("\"For ") || line.starts_with("For ");
    if raced && best && !line.contains("none of these steps") {
        line.truncate(line.find(':').unwrap());
    }
    for what in [" ms", " times the processor time", " times as long", " bytes of memory"] {
        line = without_numbers_before(&line, what);
    }
    Some(line)
}

/// The line with the numbers before `what` left open.
fn without_numbers_before(line: &str, what: &str) -> String {
    let parts: Vec<&str> = line.split(what).collect();
    let number = |c: char| c.is_ascii_digit() || matches!(c, '.' | '-');
    let open = |(i, part): (usize, &&str)| {
        let shorter = part.trim_end_matches(number);
        if i + 1 < parts.len() && shorter.len() < part.len() { format!("{shorter}~") } else { (*part).to_string() }
    };
    parts.iter().enumerate().map(open).collect::<Vec<_>>().join(what)
}

/// The lines of the JSON of a comparison without what was quickest in it.
fn without_races(json: &str) -> String {
    let mut kept = Vec::new();
    let mut inside = false;
    for line in json.lines() {
        let key = line.trim_start();
        inside |= ["\"own_method\"", "\"best_method\"", "\"recommended_"].iter().any(|name| key.starts_with(name));
        if !inside {
            kept.push(line.trim_end_matches(','));
        }
        inside &= !key.starts_with('}');
    }
    kept.join("\n")
}

/// About [`ROWS`] of many rows, the first and the last among them.
fn some_of<T: Clone>(rows: &[T]) -> Vec<T> {
    let every = rows.len().div_ceil(ROWS).max(1);
    let last = rows.last().filter(|_| !(rows.len() - 1).is_multiple_of(every));
    rows.iter().step_by(every).chain(last).cloned().collect()
}

/// The columns of a table, a line each, so that a changed one is a changed line.
fn columns(table: &str) -> String {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).flexible(true).from_reader(table.as_bytes());
    let mut rows = reader.records().map(Result::unwrap);
    let Some(header) = rows.next() else { return String::new() };
    let rows: Vec<csv::StringRecord> = rows.collect();
    let some = some_of(&rows);
    let cell = |row: &csv::StringRecord, i: usize| row.get(i).unwrap_or_default().to_string();
    let column = |i: usize| [vec![header[i].to_string()], some.iter().map(|row| cell(row, i)).collect()].concat();
    let shown = (0..header.len()).filter(|i| !TIMES.contains(&&header[*i]));
    let table = shown.map(|i| column(i).join(", ") + "\n").collect::<String>();
    format!("{} rows\n{table}", rows.len())
}

#[test]
fn every_file_belongs_to_an_entry_and_every_entry_has_its_file() {
    let files = || std::fs::read_dir(root().join("tests/recorded")).unwrap().map(|entry| entry.unwrap().path());
    let named = |kind: &str| {
        let of = files().filter(|path| path.extension().is_some_and(|own| own == kind));
        of.map(|path| path.file_stem().unwrap().to_str().unwrap().to_string()).collect::<BTreeSet<_>>()
    };
    let entries: BTreeSet<String> = ALL.iter().map(|(name, _)| file_of(name)).collect();
    assert_eq!(named("txt"), entries);
    let said: String = ALL.iter().map(|(_, commands)| *commands).collect();
    for kind in ["toml", "csv"] {
        for name in named(kind) {
            assert!(said.contains(&format!("{name}.{kind}")), "no entry needs {name}.{kind}");
        }
    }
}
