//! The fluid and its forces on the rod, one force per file.

pub mod audit;
pub mod body;
pub mod buoyancy;
pub mod fluid_along;
pub mod force;
pub mod froude_krylov;
pub mod laws;
pub mod local;
pub mod medium;
#[cfg(feature = "faer")]
pub mod nonlocal;
pub mod reactive;
pub mod spray;
pub mod uncertainty;
pub mod validity;
pub mod warnings;

pub use buoyancy::Buoyancy;
pub use fluid_along::{FluidAlong, FluidRuns};
pub use force::{Force, Forces, GlobalForce, Kinematics, PowerKind};
pub use froude_krylov::FroudeKrylov;
pub use local::{HeadWeight, LocalDrag};
pub use medium::{DENSITY, Fluid, Key, Layer, Layers, VISCOSITY};
pub use reactive::Reactive;
pub use spray::Spray;
