//! `[head]`: how the head is held, and the signals that drive it.

use std::path::PathBuf;

use serde::Deserialize;

use super::key_error::KeyError;
use super::keys_by_choice::KeysByChoice;
use super::value::{self, NotNegative, Positive, ScalarSignal, SignalValue, VectorSignal};
use super::{Scene, csv_table};
use crate::error::Result;
use crate::head::{HeadInput, HeadMotion, Hinge, Signal};

/// `[head]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct HeadTable {
    /// How the head is held. By default `free`.
    #[serde(default)]
    pub kind: HeadKind,
    /// Position of a driven or hinged head, m.
    pub position_m: Option<VectorSignal>,
    /// Angle of a driven head from +x, rad. For a hinged head, the angle at the start, and the commanded angle of the servo with
    /// `stiffness_n_m`.
    pub angle_rad: Option<ScalarSignal>,
    /// Torque of the motor of a hinged head, N m: a number, a sinusoid or a table. By default 0. The ramp of the start applies to
    /// it.
    pub torque_n_m: Option<ScalarSignal>,
    /// Stiffness of the servo of a hinged head, N m/rad: it adds the torque k (angle_rad - angle). By default 0.
    pub stiffness_n_m: Option<NotNegative>,
    /// Damping of the bearing of a hinged head, N m s/rad. By default 0.
    pub damping_n_m_s: Option<NotNegative>,
    /// Moment of inertia of the parts that turn with a hinged head, kg m^2: the rotor of its motor with the gear, and the head
    /// itself. Required for a hinged head.
    pub inertia_kg_m2: Option<Positive>,
    /// The largest torque that the motor of a hinged head can give, N m: for a commanded torque T it gives M tanh(T/M). By
    /// default unlimited.
    pub largest_torque_n_m: Option<Positive>,
    /// The time to which a pose set by a host belongs. By default `now`.
    pub input: Option<HeadInput>,
}

/// Kinds of head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum HeadKind {
    /// Free: no force or moment at the head.
    #[default]
    Free,
    /// Clamped at the origin, along +x.
    Clamped,
    /// Held in a pose that the scene or a host prescribes over time.
    Driven,
    /// Held in a position that the scene or a host prescribes, and free to turn under the torque of a motor.
    Hinged,
}

/// The keys of a moving head, and those of a head that a motor turns.
const POSE_KEYS: [&str; 2] = ["position_m", "angle_rad"];
const MOTOR_KEYS: [&str; 5] = ["torque_n_m", "stiffness_n_m", "damping_n_m_s", "inertia_kg_m2", "largest_torque_n_m"];

impl HeadTable {
    /// The keys that belong to a kind.
    pub(super) const KEYS_BY_KIND: KeysByChoice = KeysByChoice {
        table: "head",
        choices: &["kind"],
        keys: || [&["input"][..], &POSE_KEYS, &MOTOR_KEYS].concat(),
        accepted: |chosen| {
            Some(match chosen("kind")?.as_str() {
                "free" => Vec::new(),
                "clamped" => vec!["input"],
                "driven" => [&["input"][..], &POSE_KEYS].concat(),
                "hinged" => [&["input"][..], &POSE_KEYS, &MOTOR_KEYS].concat(),
                _ => return None,
            })
        },
    };

    pub(super) fn check(&self) -> std::result::Result<(), KeyError> {
        if self.input.is_some() && self.kind == HeadKind::Free {
            let problem = "found with a free head; allowed: only with a held one".into();
            return Err(KeyError { key: "head.input".into(), problem });
        }
        let moved = [("head.position_m", self.position_m.is_some()), ("head.angle_rad", self.angle_rad.is_some())];
        let turned = [
            ("head.torque_n_m", self.torque_n_m.is_some()),
            ("head.stiffness_n_m", self.stiffness_n_m.is_some()),
            ("head.damping_n_m_s", self.damping_n_m_s.is_some()),
            ("head.inertia_kg_m2", self.inertia_kg_m2.is_some()),
            ("head.largest_torque_n_m", self.largest_torque_n_m.is_some()),
        ];
        let held = matches!(self.kind, HeadKind::Driven | HeadKind::Hinged);
        let first = |keys: &[(&'static str, bool)]| keys.iter().find(|(_, found)| *found).map(|(key, _)| *key);
        if let Some(key) = first(&moved).filter(|_| !held) {
            let problem = "found without kind = \"driven\" or \"hinged\"; allowed: only with one of them".into();
            return Err(KeyError { key: key.into(), problem });
        }
        if self.kind != HeadKind::Hinged {
            return first(&turned).map_or(Ok(()), |key| {
                let problem = "found without kind = \"hinged\"; allowed: only with it: any other head is free, or follows its prescribed motion";
                Err(KeyError { key: key.into(), problem: problem.into() })
            });
        }
        if self.inertia_kg_m2.is_none() {
            let problem = "missing; a hinged head needs its moment of inertia: that of the motor's rotor times the square of the gear ratio, plus the head's own";
            return Err(KeyError { key: "head.inertia_kg_m2".into(), problem: problem.into() });
        }
        let constant = |ScalarSignal(angle): &ScalarSignal| angle.formula().and_then(Signal::constant);
        let commanded = self.angle_rad.as_ref().is_some_and(|angle| constant(angle).is_none());
        if commanded && self.stiffness() == 0.0 {
            let found = "an angle that changes, without head.stiffness_n_m";
            let allowed = "a number, the initial angle: a servo without stiffness does not turn the head to an angle";
            return Err(KeyError { key: "head.angle_rad".into(), problem: value::refused(found, allowed) });
        }
        Ok(())
    }

    /// The signals that move the head.
    pub(super) fn signals(&self) -> impl Iterator<Item = &SignalValue> {
        let position = self.position_m.iter().flat_map(|VectorSignal(signals)| signals);
        position.chain(self.angle_rad.iter().chain(&self.torque_n_m).map(|ScalarSignal(signal)| signal))
    }

    fn stiffness(&self) -> f64 {
        self.stiffness_n_m.map_or(0.0, NotNegative::get)
    }
}

impl Scene {
    pub(super) fn head_motion(&self) -> Result<Option<HeadMotion>> {
        let still = Signal::Constant(0.0);
        match self.head.kind {
            HeadKind::Free => Ok(None),
            HeadKind::Clamped => Ok(Some([still.clone(), still.clone(), still])),
            HeadKind::Driven | HeadKind::Hinged => {
                let [x, y] = match &self.head.position_m {
                    Some(position) => self.vector_signal(position)?,
                    None => [still.clone(), still.clone()],
                };
                let angle = match &self.head.angle_rad {
                    Some(ScalarSignal(angle)) => self.signal(angle, 0, 1)?,
                    None => still,
                };
                Ok(Some([x, y, angle]))
            }
        }
    }

    /// The hinge of a hinged head.
    pub(super) fn hinge(&self) -> Result<Option<Hinge>> {
        let HeadTable { inertia_kg_m2, torque_n_m, damping_n_m_s, largest_torque_n_m, .. } = &self.head;
        let Some(inertia) = inertia_kg_m2.filter(|_| self.head.kind == HeadKind::Hinged) else { return Ok(None) };
        Ok(Some(Hinge {
            torque: match torque_n_m {
                Some(ScalarSignal(torque)) => self.signal(torque, 0, 1)?,
                None => Signal::Constant(0.0),
            },
            stiffness: self.head.stiffness(),
            damping: damping_n_m_s.map_or(0.0, NotNegative::get),
            inertia: inertia.get(),
            largest_torque: largest_torque_n_m.map(Positive::get),
        }))
    }

    /// The signals x and y. A single table contains both.
    pub(super) fn vector_signal(&self, VectorSignal([x, y]): &VectorSignal) -> Result<[Signal; 2]> {
        let columns = if matches!((x, y), (SignalValue::Table(a), SignalValue::Table(b)) if a == b) { 2 } else { 1 };
        Ok([self.signal(x, 0, columns)?, self.signal(y, columns - 1, columns)?])
    }

    /// A signal, or value `column` of `columns` of a table.
    pub(super) fn signal(&self, wanted: &SignalValue, column: usize, columns: usize) -> Result<Signal> {
        Ok(match wanted {
            SignalValue::Formula(signal) => signal.clone(),
            SignalValue::Table(file) => {
                csv_table::read(&self.read_from, &self.table_path(file), column, columns, self.solver.duration_s.get())?
            }
        })
    }

    /// The names of its tables, without repetition, in the order of their keys.
    pub fn tables(&self) -> Vec<&str> {
        let flow = self.medium.iter().flat_map(|medium| &medium.flow_m_s.0);
        let mut tables: Vec<&str> = Vec::new();
        for wanted in self.head.signals().chain(flow).chain(self.tendon_signals()) {
            if let SignalValue::Table(file) = wanted
                && !tables.contains(&file.as_str())
            {
                tables.push(file);
            }
        }
        tables
    }

    /// The path of one of its tables.
    pub fn table_path(&self, file: &str) -> PathBuf {
        self.folder.join(file)
    }

    /// The paths of its tables.
    pub fn files(&self) -> Vec<PathBuf> {
        self.tables().into_iter().map(|table| self.table_path(table)).collect()
    }
}
