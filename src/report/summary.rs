//! The content of summary.json: the results of a run as one flat record.

use std::path::PathBuf;

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use crate::cycle::CycleAverages;
use crate::metrics::TendonExtremes;
use crate::system::Form;
use crate::verification::Verification;

/// Relative errors of the fluid model, or its uncertainty: of speed or thrust, and of power.
#[derive(Debug, Clone, Copy, Serialize)]
#[expect(missing_docs, reason = "the names say what they are")]
pub struct FluidError {
    pub motion: f64,
    pub power: f64,
}

impl From<[f64; 2]> for FluidError {
    fn from([motion, power]: [f64; 2]) -> Self {
        Self { motion, power }
    }
}

/// The largest tension, power, speed and travel of each tendon: a flat map of `max_tendon_1_tension_n` and so on.
#[derive(Debug, Clone, Default)]
pub struct TendonMaxima(pub Vec<TendonExtremes>);

impl Serialize for TendonMaxima {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for (i, tendon) in (1..).zip(&self.0) {
            map.serialize_entry(&format!("max_tendon_{i}_tension_n"), &tendon.tension)?;
            map.serialize_entry(&format!("max_tendon_{i}_power_w"), &tendon.power)?;
            map.serialize_entry(&format!("max_tendon_{i}_speed_m_s"), &tendon.speed)?;
            map.serialize_entry(&format!("max_tendon_{i}_travel_m"), &tendon.travel())?;
        }
        map.end()
    }
}

/// The results of a run, in SI units; written as summary.json.
#[derive(Debug, Clone, Serialize)]
#[expect(missing_docs, reason = "the names say what they are, with units; time_step_s is the mean of adaptive steps")]
pub struct Summary {
    pub name: String,
    pub scene_file: PathBuf,
    pub scene_fingerprint: String,
    pub caudal_version: &'static str,
    pub complete: bool,
    pub ending: String,
    pub end_time_s: f64,
    pub nodes: usize,
    pub model: &'static str,
    pub model_reason: Option<String>,
    pub forces: Vec<&'static str>,
    pub fluid_reason: Option<String>,
    pub fluid_error: Option<FluidError>,
    pub fluid_uncertainty: Option<FluidError>,
    pub integrator: String,
    pub form: Form,
    pub time_step_s: f64,
    pub tolerance: Option<f64>,
    pub steps: u64,
    pub rejected_steps: u64,
    pub newton_iterations: u64,
    pub factorisations: u64,
    pub linear_solver: &'static str,
    pub linear_fallbacks: u64,
    pub step_halvings: u64,
    pub newton_floor_stops: u64,
    pub max_strain: f64,
    pub max_rotation_per_step_rad: f64,
    pub x_com_m: f64,
    pub y_com_m: f64,
    pub net_displacement_m: f64,
    pub max_lateral_excursion_m: f64,
    pub com_path_m: f64,
    pub initial_energy_j: f64,
    pub stretching_energy_j: f64,
    pub bending_energy_j: f64,
    pub kinetic_energy_j: f64,
    pub fluid_energy_j: f64,
    pub mean_stretching_energy_j: f64,
    pub mean_bending_energy_j: f64,
    pub mean_kinetic_energy_j: f64,
    pub actuation_work_j: f64,
    pub material_work_j: f64,
    pub viscous_work_j: f64,
    pub wake_work_j: f64,
    pub spray_work_j: f64,
    pub other_work_j: f64,
    pub load_work_j: f64,
    pub head_work_j: f64,
    pub flow_work_j: f64,
    pub mean_actuation_power_w: f64,
    pub mean_material_power_w: f64,
    pub mean_viscous_power_w: f64,
    pub mean_wake_power_w: f64,
    pub mean_spray_power_w: f64,
    pub mean_load_power_w: f64,
    pub mean_head_power_w: f64,
    pub mean_flow_power_w: f64,
    pub mean_other_power_w: f64,
    pub numerical_dissipation_j: f64,
    pub rod_momentum_n_s: [f64; 2],
    pub fluid_momentum_n_s: [f64; 2],
    pub drag_impulse_n_s: [f64; 2],
    pub wake_impulse_n_s: [f64; 2],
    pub flow_impulse_n_s: [f64; 2],
    pub load_impulse_n_s: [f64; 2],
    pub head_impulse_n_s: [f64; 2],
    pub spray_impulse_n_s: [f64; 2],
    pub other_impulse_n_s: [f64; 2],
    pub momentum_defect_n_s: [f64; 2],
    pub notes: Vec<String>,
    pub cost_of_transport: Option<f64>,
    pub efficiency: Option<f64>,
    pub head_force_n: Option<[f64; 2]>,
    pub head_moment_n_m: Option<f64>,
    pub mean_head_force_n: Option<[f64; 2]>,
    pub mean_thrust_n: Option<f64>,
    pub mean_head_moment_n_m: Option<f64>,
    pub max_head_force_n: Option<f64>,
    pub max_head_moment_n_m: Option<f64>,
    /// Largest torque of the motor of a hinged head at any step, N m.
    pub max_hinge_torque_n_m: Option<f64>,
    pub max_hinge_power_w: Option<f64>,
    pub max_hinge_speed_rad_s: Option<f64>,
    pub max_head_power_w: Option<f64>,
    pub max_joint_moment_n_m: f64,
    pub max_actuation_power_w: Option<f64>,
    #[serde(flatten)]
    pub tendons: TendonMaxima,
    #[serde(flatten)]
    pub cycles: CycleAverages,
    pub wall_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verification: Option<Verification>,
    pub final_positions_m: Vec<[f64; 2]>,
}
