//! 3D printing: the surface of a rod as an STL file, and its cross-sections as a table.

use std::f64::consts::TAU;
use std::fmt::Write;

use serde_json::{Value, json};

use crate::rod::{Rod, Sections, Shape};

/// Stations along the rod in addition to the points of its profiles, and corners of a section.
const STATIONS: usize = 64;
const CORNERS: usize = 48;

/// Least semi-axis, over the length, so that a body that ends in an edge has a closed surface.
const MIN_SEMI_AXIS: f64 = 1e-6;

/// Columns of [`sections`].
pub(super) const COLUMNS: [&str; 8] = [
    "s (m)",
    "s/L",
    "outer radius (m)",
    "inner radius (m)",
    "depth (m)",
    "density (kg/m^3)",
    "mass per length (kg/m)",
    "EI (N m^2)",
];

/// Positions ξ of the sections.
fn stations(sections: &Sections) -> Vec<f64> {
    let even = (0..=STATIONS).map(|i| i as f64 / STATIONS as f64);
    let mut all: Vec<f64> = even.chain(sections.profiles().flat_map(|profile| profile.places())).collect();
    all.sort_by(f64::total_cmp);
    all.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
    all
}

/// The sections along `rod` with this `stiffness` of its joints (N m²), one row per station.
pub(super) fn sections(rod: &Rod, stiffness: &[f64]) -> Vec<Vec<Value>> {
    let points: Vec<[f64; 2]> = rod.joints().zip(stiffness).map(|(k, ei)| [rod.xi(k), *ei]).collect();
    let stiffness = crate::rod::Profile::through(points);
    let row = |xi: f64| {
        let section = rod.sections.at(xi);
        vec![
            json!(xi * rod.length),
            json!(xi),
            json!(section.outer),
            json!(section.inner),
            json!(rod.sections.depth_at(xi)),
            json!(rod.sections.density.at(xi)),
            json!(rod.sections.line_density(xi)),
            json!(stiffness.as_ref().map(|stiffness| stiffness.at(xi))),
        ]
    };
    stations(&rod.sections).into_iter().map(row).collect()
}

/// The straight rod as a closed surface in STL (text, mm). Its sections have the thickness 2R_o in the plane of motion, y, and the
/// depth across it, z; a hollow rod has a hole. For a round core with a membrane it is the core. Source: 3D Systems,
/// StereoLithography Interface Specification (1989).
pub fn stl(name: &str, rod: &Rod) -> String {
    let least = MIN_SEMI_AXIS * rod.length;
    // Round sections are polygons; a rectangle's corners are at odd eighths of a turn.
    let unit = |i: usize| -> [f64; 2] {
        let (sin, cos) = (TAU * i as f64 / CORNERS as f64).sin_cos();
        match rod.sections.shape {
            Shape::Round | Shape::Ellipse => [cos, sin],
            Shape::Rectangle => [cos, sin].map(|x| x / sin.abs().max(cos.abs())),
        }
    };
    let ring = |xi: f64, part: f64| -> Vec<[f64; 3]> {
        let [across, deep] = rod.sections.at(xi).semi_axes().map(|axis| part * axis.max(least));
        let corner = |[y, z]: [f64; 2]| [xi * rod.length, across * y, deep * z].map(|x| 1e3 * x);
        (0..CORNERS).map(unit).map(corner).collect()
    };
    let places = stations(&rod.sections);
    let outer: Vec<_> = places.iter().map(|xi| ring(*xi, 1.0)).collect();
    let hollow = places.iter().any(|xi| rod.sections.at(*xi).inner > 0.0);
    let hole = |xi: f64| rod.sections.at(xi).inner / rod.sections.at(xi).outer;
    let inner: Vec<_> = places.iter().map(|xi| ring(*xi, hole(*xi))).collect();
    let mut text = format!("solid {name}\n");
    let mut quad = |a: [f64; 3], b: [f64; 3], c: [f64; 3], d: [f64; 3]| {
        triangle(&mut text, [a, b, c]);
        triangle(&mut text, [a, c, d]);
    };
    for i in 0..CORNERS {
        let next = (i + 1) % CORNERS;
        for pair in outer.windows(2) {
            quad(pair[0][i], pair[0][next], pair[1][next], pair[1][i]);
        }
        let (first, last) = (0, places.len() - 1);
        if hollow {
            for pair in inner.windows(2) {
                quad(pair[1][i], pair[1][next], pair[0][next], pair[0][i]);
            }
            quad(inner[first][i], inner[first][next], outer[first][next], outer[first][i]);
            quad(outer[last][i], outer[last][next], inner[last][next], inner[last][i]);
        }
    }
    if !hollow {
        for (ring, begins) in [(outer.first(), true), (outer.last(), false)] {
            for pair in ring.into_iter().flat_map(|ring| ring[1..].windows(2).map(|pair| [ring[0], pair[0], pair[1]])) {
                triangle(&mut text, if begins { [pair[0], pair[2], pair[1]] } else { pair });
            }
        }
    }
    text + &format!("endsolid {name}\n")
}

fn triangle(text: &mut String, [a, b, c]: [[f64; 3]; 3]) {
    let [p, q] = [b, c].map(|x| nalgebra::Vector3::from(x) - nalgebra::Vector3::from(a));
    let n = p.cross(&q).try_normalize(0.0).unwrap_or_default();
    let _ = writeln!(text, "facet normal {:e} {:e} {:e}\nouter loop", n.x, n.y, n.z);
    for [x, y, z] in [a, b, c] {
        let _ = writeln!(text, "vertex {x:e} {y:e} {z:e}");
    }
    text.push_str("endloop\nendfacet\n");
}
