//! `terminalsAndIcons.xml` of FMI 3.0: terminals, which group variables for connections between FMUs, and the icon.
//!
//! The head of a held tail is a bus with pose, rates and accelerations as inputs and force and moment as outputs. The tip of any
//! tail provides pose and rates under the same names, so that it can drive a second tail. The drive of the actuation is a plug.

use std::io::Result;

use quick_xml::events::{BytesDecl, Event};
use quick_xml::writer::Writer;

use super::component::Fmu;
use super::description::{Xml, element, leaf};

/// A terminal: name, description, kind, matching rule, and member names with their variables.
type Terminal = (&'static str, &'static str, &'static str, &'static str, &'static [(&'static str, &'static str)]);

const TERMINALS: [Terminal; 4] = [
    (
        "head",
        "flange in the plane at the held head: pose, rates and accelerations in, force and moment of the tail out",
        "planar-flange",
        "bus", // the tip of one tail provides only some members for the head of another
        &[
            ("x", "head_x_m"),
            ("y", "head_y_m"),
            ("angle", "head_angle_rad"),
            ("vx", "head_vx_m_s"),
            ("vy", "head_vy_m_s"),
            ("spin", "head_spin_rad_s"),
            ("ax", "head_ax_m_s2"),
            ("ay", "head_ay_m_s2"),
            ("spin_rate", "head_spin_rate_rad_s2"),
            ("force_x", "head_force_x_n"),
            ("force_y", "head_force_y_n"),
            ("moment", "head_moment_n_m"),
        ],
    ),
    (
        "tip",
        "pose and rates of the tip",
        "planar-flange",
        "bus",
        &[
            ("x", "tip_x_m"),
            ("y", "tip_y_m"),
            ("angle", "tip_angle_rad"),
            ("vx", "tip_vx_m_s"),
            ("vy", "tip_vy_m_s"),
            ("spin", "tip_spin_rad_s"),
        ],
    ),
    (
        "hinge",
        "motor of a head on a hinge: torque and commanded angle in, angle, angular velocity and torque out",
        "motor",
        "bus",
        &[
            ("added_torque", "hinge_added_torque_n_m"),
            ("added_angle", "hinge_added_angle_rad"),
            ("angle", "hinge_angle_rad"),
            ("spin", "hinge_spin_rad_s"),
            ("torque", "hinge_torque_n_m"),
        ],
    ),
    (
        "drive",
        "the actuation's drive",
        "drive",
        "plug",
        &[
            ("amplitude", "actuation_amplitude"),
            ("moment", "actuation_moment_n_m"),
            ("frequency", "actuation_frequency_hz"),
            ("phase", "actuation_phase_rad"),
        ],
    ),
];

/// The icon, 128 pixels square.
pub(super) const ICON: &[u8] = include_bytes!("icon.png");

/// The content of the file.
pub(super) fn write(fmu: &Fmu<'_>) -> Result<Vec<u8>> {
    let mut xml = Writer::new_with_indent(Vec::new(), b' ', 2);
    xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    let attributes =
        |pairs: &[(&'static str, &str)]| pairs.iter().map(|(name, value)| (*name, value.to_string())).collect();
    let square = [("x1", "-100"), ("y1", "-100"), ("x2", "100"), ("y2", "100")];
    let has = |name: &str| fmu.shows(name) && fmu.catalogue.variables().any(|(_, variable)| variable.name == name);
    element(&mut xml, "fmiTerminalsAndIcons", attributes(&[("fmiVersion", "3.0")]), |xml| {
        element(xml, "GraphicalRepresentation", Vec::new(), |xml| {
            let system: Vec<_> = square.into_iter().chain([("suggestedScalingFactorTo_mm", "0.1")]).collect();
            leaf(xml, "CoordinateSystem", attributes(&system))?;
            leaf(xml, "Icon", attributes(&square))
        })?;
        let there = |terminal: &&Terminal| terminal.4.iter().any(|(_, variable)| has(variable));
        if TERMINALS.iter().all(|terminal| !there(&terminal)) {
            return Ok(());
        }
        element(xml, "Terminals", Vec::new(), |xml: &mut Xml| {
            TERMINALS.iter().filter(there).try_for_each(|(name, description, kind, matching, members)| {
                let own = [
                    ("name", *name),
                    ("matchingRule", *matching),
                    ("terminalKind", *kind),
                    ("description", *description),
                ];
                element(xml, "Terminal", attributes(&own), |xml| {
                    members.iter().filter(|(_, variable)| has(variable)).try_for_each(|(member, variable)| {
                        let own = [("variableName", *variable), ("memberName", *member), ("variableKind", "signal")];
                        leaf(xml, "TerminalMemberVariable", attributes(&own))
                    })
                })
            })
        })
    })?;
    Ok(xml.into_inner())
}
