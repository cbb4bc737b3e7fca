//! Random scenes of every kind of part: seven nodes or so, and some two cycles of what drives them.

use caudal::scene::Document;

use super::Dice;

/// Their rod and solver, before chance changes them.
pub const ROD: &str = "[rod]\nnodes = 7\nlength_m = 0.3\nouter_radius_m = 0.007\ndensity_kg_m3 = 1100.0\nyoungs_modulus_pa = 1e6\n\
    [solver]\nintegrator = \"newmark\"\ntime_step_s = 0.004\nduration_s = 0.5\nnewton_tolerance = 1e-13\n";

/// What decides by chance, the same for the same seed.
pub struct RandomChoices(pub Dice);

impl RandomChoices {
    /// Whether it happens, with this chance.
    pub fn of(&mut self, part: f64) -> bool {
        self.0.between(0.0, 1.0) < part
    }

    /// One of some.
    pub fn one<T: Copy>(&mut self, of: &[T]) -> T {
        of[(self.0.between(0.0, of.len() as f64) as usize).min(of.len() - 1)]
    }

    /// A number, or with this chance a profile.
    fn along(&mut self, part: f64, low: f64, high: f64) -> String {
        if !self.of(part) {
            return format!("{:e}", self.0.between(low, high));
        }
        let middle = self.0.between(0.1, 0.9);
        let mut point = |xi: f64| format!("[{xi:e},{:e}]", self.0.between(low, high));
        format!("[{},{},{}]", point(0.0), point(middle), point(1.0))
    }
}

/// A random scene with any of the parts of a planar scene: sections, drives, heads, media, laws, loads, materials, methods.
pub fn random(seed: u64) -> Document {
    random_of(seed, ROD)
}

/// The same of another rod and solver.
pub fn random_of(seed: u64, rod: &str) -> Document {
    let mut dice = RandomChoices(Dice(7919 * seed));
    let mut document = Document::new(format!("random-{seed}.toml"), rod);
    let mut set = |text: String| document.set(&text).unwrap();
    let log = |dice: &mut RandomChoices, low: f64, high: f64| dice.0.between(f64::ln(low), f64::ln(high)).exp();
    set(format!("rod.nodes={}", dice.one(&[5, 7, 9])));
    let modulus = log(&mut dice, 1e5, 1e7);
    set(format!("rod.youngs_modulus_pa={modulus:e}"));
    // Without a draw of chance.
    let moments = seed % 3 == 1;
    let tendons = seed % 5 == 3;
    set(format!("rod.density_kg_m3={}", dice.along(0.25, 900.0, 1300.0)));
    set(format!("rod.outer_radius_m={}", dice.along(0.3, 0.004, 0.01)));
    if dice.of(0.3) {
        set(format!("rod.inner_radius_m={}", dice.along(0.4, 0.001, 0.003)));
    }
    if dice.of(0.4) {
        set(format!("rod.depth_m={}", dice.along(0.5, 0.01, 0.04)));
    }
    match dice.one(&[0, 1, 2, 2, 2]) {
        0 => set("rod.stiffness_gradient=0.7".into()),
        1 => set(format!("rod.stiffness_profile={}", dice.along(1.0, 0.5, 2.0))),
        _ => {}
    }
    if dice.of(0.3) {
        set(format!("rod.mass_lumping={}", dice.one(&["tributary", "uniform"])));
    }
    if dice.of(0.15) {
        set(format!("rod.mass_profile={}", dice.along(1.0, 0.5, 2.0)));
    }
    let frequency = dice.one(&[4.0, 6.0]);
    let has_wave = dice.of(0.75);
    if has_wave {
        let kind = dice.one(&["travelling-wave", "standing-wave", "sine-wave"]);
        let mut keys = format!("kind=\"{kind}\",frequency_hz={frequency:e}");
        if kind == "sine-wave" {
            keys += ",slope=0.3";
        } else if moments {
            // That which gives a round rod of 7 mm this curvature.
            keys += &format!(",moment_amp_n_m={:e}", dice.0.between(2.0, 6.0) * modulus * 1.89e-9);
        } else {
            keys += &format!(",kappa_amp={:e}", dice.0.between(2.0, 6.0));
        }
        if kind != "standing-wave" {
            keys += ",wavelength_m=0.31";
        }
        if kind != "sine-wave" && dice.of(0.3) && !moments {
            keys += ",kappa_reference_length_m=1.3";
        }
        if dice.of(0.6) {
            keys += ",envelope=[0.4,0.6]";
        }
        if kind != "sine-wave" && dice.of(0.3) {
            keys += ",harmonics=[0.1,-0.2]";
        }
        if dice.of(0.3) {
            keys += &format!(",amplitude_profile={}", dice.along(1.0, 0.5, 1.5));
        }
        if dice.of(0.3) {
            keys += &format!(",phase_profile_rad={}", dice.along(1.0, -0.5, 0.5));
        }
        set(format!("actuation={{{keys}}}"));
        let start = dice.one(&["kind=\"shaped\"", "kind=\"ramp\",ramp_s=0.1", "kind=\"jump\""]);
        set(format!("start={{{start}}}"));
    }
    let head = dice.one(&["free", "free", "clamped", "driven"]);
    let (layered, mut reactive) = (dice.of(0.3), dice.of(0.45));
    let sheared = dice.of(0.25);
    reactive &= !sheared;
    let oblique = dice.of(0.3);
    let normal = if oblique { "[0.6,0.8]" } else { "[0.0,1.0]" };
    let along = if oblique { [0.8, -0.6] } else { [1.0, 0.0] };
    let mut medium = format!("viscosity_pa_s={:e},density_kg_m3=1000.0", log(&mut dice, 1e-3, 1.0));
    if layered {
        medium += &format!(
            ",beyond={{normal={normal},offset_m={:e},thickness_m=0.08,viscosity_pa_s={:e},density_kg_m3={:e}",
            dice.0.between(-0.05, 0.05),
            log(&mut dice, 1e-2, 1.0),
            dice.one(&[700.0, 1300.0])
        );
        if dice.of(0.4) && !reactive {
            medium += &format!(",flow_m_s=[{:e},{:e}]", 0.16 * along[0], 0.16 * along[1]);
        }
        medium += "}";
    }
    if dice.of(0.6) {
        let [x, y] = [dice.0.between(-0.3, 0.3), dice.0.between(-0.3, 0.3)];
        medium += &match (layered || sheared, dice.of(0.25)) {
            (true, _) => format!(",flow_m_s=[{:e},{:e}]", x * along[0], x * along[1]),
            (false, true) => {
                format!(",flow_m_s=[{{amplitude=0.2,frequency_hz={frequency:e},offset={x:e}}},{y:e}]")
            }
            (false, false) => format!(",flow_m_s=[{x:e},{y:e}]"),
        };
    }
    if sheared {
        let normal = if layered { String::new() } else { format!(",normal={normal}") };
        medium += &format!(",shear={{rate_per_s=3.0{normal}}}");
    }
    set(format!("medium={{{medium}}}"));
    if dice.of(0.92) {
        let law = dice.one(&[
            "cox",
            "lighthill",
            "gray-hancock",
            "spheroid",
            "wall",
            "coefficients",
            "weak-inertia",
            "cross-flow",
            "cross-flow",
            "cross-flow",
            "stokes-like",
            "auto",
        ]);
        let mut keys = format!("law=\"{law}\"");
        match law {
            "wall" => keys += ",height_m=0.05",
            "coefficients" => {
                keys +=
                    &format!(",along_n_s_m2={},across_n_s_m2={}", dice.along(0.5, 0.1, 1.0), dice.along(0.5, 0.5, 3.0));
            }
            "stokes-like" => keys += ",ratio=3.0",
            "cox" if dice.of(0.4) => keys += ",slender_length_m=0.2",
            "cross-flow" => {
                for (part, key) in [
                    (0.4, "form_drag=0.9"),
                    (0.3, "thinning=0.5"),
                    (0.3, "skin_friction=1.2"),
                    (0.3, "turbulent_friction=0.004"),
                ] {
                    if dice.of(part) {
                        keys += ",";
                        keys += key;
                    }
                }
                if dice.of(0.3) {
                    keys += dice.one(&[
                        ",viscous=\"lighthill\"",
                        ",viscous=\"spheroid\"",
                        ",viscous=\"wall\",height_m=0.05",
                    ]);
                }
            }
            _ => {}
        }
        if dice.of(0.3) && law != "wall" {
            keys += ",head_weight=5.0,head_length_m=0.08";
        }
        set(format!("drag={{{keys}}}"));
    }
    if reactive {
        set(match dice.one(&[0, 1, 1]) {
            0 => "reactive=\"auto\"".to_string(),
            _ => format!("reactive={{shedding={:e}}}", dice.one(&[0.0, 0.5, 1.0])),
        });
    }
    if head == "free" && dice.of(0.35) && !layered && !sheared {
        let mut keys = "semi_axis_along_m=0.03,semi_axis_across_m=0.015".to_string();
        for (part, key) in [
            (0.5, "mass_kg=0.05"),
            (0.5, "form_drag_along=0.4"),
            (0.3, "form_drag_across=0.9"),
            (0.3, "moment_of_inertia_kg_m2=2e-5"),
        ] {
            if dice.of(part) {
                keys += ",";
                keys += key;
            }
        }
        set(format!("head_body={{{keys}}}"));
    }
    match head {
        "free" => {}
        "clamped" => set("head={kind=\"clamped\"}".into()),
        _ => set(format!(
            "head={{kind=\"driven\",position_m=[{{amplitude=0.02,frequency_hz={frequency:e},phase_rad=0.3}},0.01],\
             angle_rad={{amplitude=0.2,frequency_hz={frequency:e}}}}}"
        )),
    }
    if dice.of(0.35) {
        let gravity = if layered || sheared { "[0.0,-9.81]" } else { "[1.0,-9.0]" };
        if dice.of(0.7) {
            set(format!("loads.gravity_m_s2={gravity}"));
            if dice.of(0.5) {
                set("loads.buoyancy=true".into());
            }
        }
        if dice.of(0.4) {
            set("loads.point=[{node=-1,force_n=[0.01,0.02]}]".into());
        }
    }
    if dice.of(0.4) {
        // One frequency moves all that moves here.
        let moves = head == "driven" || has_wave;
        let material = dice.one(&[
            "0.004",
            "0.0",
            "{stretch=1e-4,bending=0.01}",
            "[[0.0,0.002],[0.6,0.0],[1.0,0.01]]",
            "loss",
            "loss",
        ]);
        match material {
            "loss" if moves => set(format!("rod.loss_factor={}", dice.along(0.4, 0.05, 0.4))),
            "loss" => {
                set("rod.loss_factor=0.2".into());
                set("rod.loss_frequency_hz=3.0".into());
            }
            time => set(format!("rod.damping_time_s={time}")),
        }
        if dice.of(0.4) && !moments && !tendons {
            set("rod.damping_of=elastic".into());
        }
    }
    if dice.of(0.15) && head != "free" {
        set("loads.point=[{node=-1,force_n=[-0.02,0.01],follows=true},{node=2,force_n=[0.01,0.0]}]".into());
    }
    if tendons {
        // That which bends a round rod of 7 mm by 1/m or so, and a short one on the other side.
        let tension = modulus * 1.89e-9 / 0.005;
        set(format!(
            "tendons=[{{offset_m=0.005,tension_n={{offset={:e},amplitude={:e},frequency_hz={frequency:e},phase_rad=0.4}}}},\
             {{offset_m=-0.003,from_xi=0.3,to_xi=0.8,tension_n={:e}}}]",
            1.1 * tension,
            -tension,
            0.7 * tension
        ));
    }
    let method = dice.one(&["implicit-euler", "newmark", "generalized-alpha"]);
    set(format!("solver.integrator={method}"));
    if method == "newmark" && dice.of(0.3) {
        set("solver.beta=0.3025".into());
        set("solver.gamma=0.6".into());
    }
    // No end of a cycle is an end of a step, nor one of the run.
    let duration = if dice.of(0.6) { 2.4 / frequency + 0.0013 } else { 2.2 / frequency };
    set(format!("solver.duration_s={duration:e}"));
    // The first outline that its law takes, without a draw of chance.
    let deep = document.scene().is_ok_and(|scene| scene.rod.depth_m.is_some());
    let outlines = [["rectangle", "ellipse"], ["ellipse", "rectangle"], ["round", "ellipse"]][(seed % 3) as usize];
    for outline in outlines.into_iter().filter(|_| deep) {
        let mut other = document.clone();
        other.set(&format!("rod.section={outline}")).unwrap();
        if other.scene().is_ok() {
            return other;
        }
    }
    document
}
