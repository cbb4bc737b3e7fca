//! The documentation inside an FMU: a description of the model, and the licences.

use super::component::Fmu;
use crate::variable::Size;

/// Names and contents of the files.
pub(super) fn files(fmu: &Fmu<'_>) -> Vec<(String, String)> {
    let licences = [
        ("license.txt", include_str!("../../LICENSE")),
        ("LICENSE-MIT.txt", include_str!("../../LICENSE-MIT")),
        ("LICENSE-APACHE.txt", include_str!("../../LICENSE-APACHE")),
        ("THIRD-PARTY.txt", include_str!("../../THIRD-PARTY.txt")),
    ];
    let mut files = vec![("documentation/index.html".to_string(), index(fmu))];
    files.extend(licences.map(|(name, text)| (format!("documentation/licenses/{name}"), text.to_string())));
    files
}

fn escape(text: &str) -> String {
    quick_xml::escape::escape(text).into_owned()
}

fn index(fmu: &Fmu<'_>) -> String {
    let mut rows = String::new();
    for (_, variable) in fmu.catalogue.variables() {
        let size = match variable.size {
            Size::Scalar => "1",
            Size::Nodes => "one a node",
            Size::Joints => "one a joint",
        };
        let cells = [variable.name, variable.causality.name(), size, variable.unit, variable.description];
        rows.push_str(&row(cells.map(escape)));
    }
    for parameter in &fmu.catalogue.parameters {
        let cells = [&parameter.name(), "parameter", "1", parameter.unit, &parameter.description];
        rows.push_str(&row(cells.map(escape)));
    }
    include_str!("documentation.html")
        .replace("@NAME@", &escape(&fmu.scene.name))
        .replace("@VERSION@", env!("CARGO_PKG_VERSION"))
        .replace("@ROWS@", &rows)
}

fn row(cells: [String; 5]) -> String {
    format!("<tr><td>{}</td></tr>\n", cells.join("</td><td>"))
}
