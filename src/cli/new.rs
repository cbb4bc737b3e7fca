//! `caudal new`: writes a commented scene to start from.

use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::str::FromStr;

use caudal::error::Result;
use caudal::files::write_file;
use caudal::scene::Document;
use clap::{Args, ValueEnum};

use super::{exit, print_error, print_unless_quiet};

/// What swims.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TemplateKind {
    /// A body that bends in a travelling wave and swims freely
    Swimmer,
    /// The same body with its head held, to measure its thrust
    Held,
    /// A passive elastic tail whose base oscillates in angle
    Tail,
}

/// What it swims in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TemplateFluid {
    /// Viscosity 1 mPa s, density 1000 kg/m³
    Water,
    /// 1.4 Pa s, 1260 kg/m³
    Glycerol,
    /// Silicone oil, 5 Pa s, 970 kg/m³
    Oil,
}

impl TemplateFluid {
    /// Viscosity (Pa s) and density (kg/m³).
    fn properties(self) -> [f64; 2] {
        match self {
            Self::Water => [1e-3, 1000.0],
            Self::Glycerol => [1.4, 1260.0],
            Self::Oil => [5.0, 970.0],
        }
    }
}

#[derive(Debug, Args)]
pub struct NewArguments {
    /// The file to write; asks for what is not given, if it can
    file: PathBuf,
    /// What swims [default: swimmer]
    #[arg(long, value_enum)]
    kind: Option<TemplateKind>,
    /// What it swims in [default: water]
    #[arg(long, value_enum)]
    fluid: Option<TemplateFluid>,
    /// Its length, m [default: 0.2]
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    length: Option<f64>,
    /// Its beat frequency, Hz [default: 2]
    #[arg(long, value_name = "HZ", allow_negative_numbers = true)]
    frequency: Option<f64>,
    /// Replace a file of that name
    #[arg(long)]
    force: bool,
}

/// Reasonable lengths (m) and frequencies (Hz).
const LENGTHS: [f64; 2] = [1e-6, 1e3];
const FREQUENCIES: [f64; 2] = [1e-4, 1e4];

pub fn new(arguments: &NewArguments) -> Result<ExitCode> {
    let NewArguments { file, force, .. } = arguments;
    if !force && file.exists() {
        print_error(&format!("{}: already exists; --force replaces it", file.display()));
        return Ok(ExitCode::from(exit::WRONG_INPUT));
    }
    let choices = |values: &[&str]| values.join(", ");
    let kind =
        asked(arguments.kind, "what swims", &choices(&["swimmer", "held", "tail"]), TemplateKind::Swimmer, by_name)?;
    let fluid =
        asked(arguments.fluid, "in what", &choices(&["water", "glycerol", "oil"]), TemplateFluid::Water, by_name)?;
    let number = |text: &str| f64::from_str(text).ok();
    let length = asked(arguments.length, "its length, m", "0.2", 0.2, number)?;
    let frequency = asked(arguments.frequency, "its beat frequency, Hz", "2", 2.0, number)?;
    for (name, value, [least, most]) in [("length", length, LENGTHS), ("frequency", frequency, FREQUENCIES)] {
        if !(least..=most).contains(&value) {
            print_error(&format!("--{name}: found {value}; allowed: {least:e} to {most:e}"));
            return Ok(ExitCode::from(exit::WRONG_INPUT));
        }
    }
    let stem = file.file_stem().map_or_else(|| "scene".into(), |stem| stem.to_string_lossy());
    let text = scene(&stem, kind, fluid, length, frequency);
    Document::new(file.clone(), text.clone()).scene()?;
    write_file(file, text)?;
    print_unless_quiet(&format!("{}: caudal run {}", file.display(), for_a_shell(&file.display().to_string())));
    Ok(ExitCode::SUCCESS)
}

/// Quotes a word for a shell.
fn for_a_shell(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+:,@%".contains(c);
    match word.chars().all(is_plain) {
        true => word.to_string(),
        false => format!("'{}'", word.replace('\'', r"'\''")),
    }
}

fn by_name<T: ValueEnum>(text: &str) -> Option<T> {
    T::from_str(text, true).ok()
}

/// The given value; otherwise the answer of a user at a terminal, otherwise the default.
fn asked<T: Copy>(
    given: Option<T>,
    question: &str,
    allowed: &str,
    default: T,
    read: fn(&str) -> Option<T>,
) -> Result<T> {
    if let Some(given) = given {
        return Ok(given);
    }
    let (input, mut output) = (std::io::stdin(), std::io::stderr());
    if !input.is_terminal() || !output.is_terminal() {
        return Ok(default);
    }
    loop {
        let _ = write!(output, "{question} [{allowed}; Enter selects the first]: ");
        let _ = output.flush();
        let mut line = String::new();
        if input.read_line(&mut line).unwrap_or(0) == 0 || line.trim().is_empty() {
            return Ok(default);
        }
        match read(line.trim()) {
            Some(answer) => return Ok(answer),
            None => print_error(&format!("found {:?}; allowed: {allowed}", line.trim())),
        }
    }
}

/// A product without its rounding error.
fn short(x: f64) -> String {
    format!("{:e}", format!("{x:.11e}").parse().unwrap_or(x))
}

/// The scene, with a comment on every key.
fn scene(name: &str, kind: TemplateKind, fluid: TemplateFluid, length: f64, frequency: f64) -> String {
    let file = for_a_shell(&format!("{name}.toml")).replace(char::is_control, " "); // in a comment, which ends with its line
    // The name is also that of a folder, on any system.
    let quoted = toml::Value::String(name.replace(|c: char| c.is_control() || c == '\\', "-"));
    let [viscosity, density] = fluid.properties();
    // A body is so stiff that it takes its prescribed shape despite its inertia and the fluid; a tail is so soft that it bends.
    let by_inertia = density * (frequency * length).powi(2);
    let by_viscosity = viscosity * frequency;
    let swims = kind != TemplateKind::Tail;
    let stiffness = match swims {
        true => (1.6e3 * by_inertia).max(6e8 * by_viscosity),
        false => (5.1e5 * by_inertia).max(1.3e7 * by_viscosity),
    };
    let depth = 0.1 * length;
    let (period, profile) = (1.0 / frequency, [0.01, 0.0275, 0.0225, 0.005].map(|part| short(part * length)));
    let radius = match swims {
        true => format!(
            "[[0.0, {}], [0.1, {}], [0.6, {}], [1.0, {}]]   # a number, or points [xi, value] along it",
            profile[0], profile[1], profile[2], profile[3]
        ),
        false => short(0.02 * length),
    };
    let actuation = match swims {
        true => format!(
            r#"
[actuation]                        # the natural curvature that muscles or motors impose
kind = "travelling-wave"
kappa_amp = {}                # curvature, 1/m
frequency_hz = {frequency}
wavelength_m = {}
envelope = [0.3, 0.7]              # grows from 0.3 of it at the head to 1 at the tip

[start]                            # bends from straight over the first period
kind = "ramp"
ramp_s = {}
"#,
            short(5.6 / length),
            short(0.8 * length),
            short(period)
        ),
        false => String::new(),
    };
    let head = match kind {
        TemplateKind::Swimmer => String::new(),
        TemplateKind::Held => {
            "\n[head]                             # held where it is: its force is the thrust\nkind = \"clamped\"\n"
                .into()
        }
        TemplateKind::Tail => format!(
            r#"
[head]                             # moves as given here; a host may move it instead
kind = "driven"
angle_rad = {{ amplitude = 0.4, frequency_hz = {frequency}, phase_rad = 1.5707963267948966 }}
"#
        ),
    };
    format!(
        r#"#:schema scene.schema.json
# An editor that knows the schema completes and checks keys: caudal schema > scene.schema.json
# `caudal check {file}` shows what this scene will compute; `caudal run {file}` runs it.
name = {quoted}
reactive = "auto"                  # the added mass of the water, if it matters

[rod]
nodes = 33                         # `caudal study accuracy` shows the error of a mesh
length_m = {length:e}
outer_radius_m = {radius}
# depth_m = {depth:.2e}                # across the plane of motion; with it the section is an ellipse, or section = "rectangle" (a strip)
youngs_modulus_pa = {stiffness:.3e}
density_kg_m3 = {density:.1}             # neutrally buoyant
{actuation}
[medium]
viscosity_pa_s = {viscosity:e}
density_kg_m3 = {density:.1}

[drag]
law = "auto"                       # chosen for the flow of this motion; `caudal check` shows which
{head}
[solver]                           # without time_step_s the step size is adaptive
duration_s = {}               # ten periods

[record]
interval_s = {}             # a hundredth of a period
"#,
        short(10.0 * period),
        short(0.01 * period)
    )
}
