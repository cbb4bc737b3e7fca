//! The quantities by which runs are compared.

use crate::scene::{HeadKind, Scene};

/// A quantity by which runs are compared.
pub struct ComparedQuantity {
    /// Its name.
    pub name: &'static str,
    /// Its name within a sentence, after "in".
    pub within: &'static str,
    /// Its name in keys, columns and files.
    pub key: &'static str,
    /// The columns of its value; empty for a trajectory.
    pub columns: &'static [&'static str],
}

const DISPLACEMENT: ComparedQuantity = ComparedQuantity {
    name: "net displacement",
    within: "displacement",
    key: "displacement",
    columns: &["net_displacement_m"],
};
const HEAD_FORCE: ComparedQuantity = ComparedQuantity {
    name: "mean head force",
    within: "the mean head force",
    key: "head_force",
    columns: &["mean_head_force_x_n", "mean_head_force_y_n"],
};
const TIP: ComparedQuantity = ComparedQuantity { name: "tip path", within: "the tip's path", key: "tip", columns: &[] };
const ENERGY: ComparedQuantity =
    ComparedQuantity { name: "energy supplied", within: "energy", key: "energy", columns: &["energy_put_in_j"] };

/// The quantities that are compared: displacement of a free head or mean force on a held one, the tip's path, and the energy put in.
pub fn quantities(scene: &Scene) -> [&'static ComparedQuantity; 3] {
    [if scene.head.kind == HeadKind::Free { &DISPLACEMENT } else { &HEAD_FORCE }, &TIP, &ENERGY]
}

/// The errors of the three quantities in a sentence.
pub fn describe_errors(quantities: [&ComparedQuantity; 3], errors: [String; 3]) -> String {
    let parts: Vec<_> = quantities.iter().zip(errors).map(|(q, error)| format!("{error} in {}", q.within)).collect();
    parts.join(", ")
}
