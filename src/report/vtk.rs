//! VTK files (for ParaView): one polyline with its fields per time, and a collection of them.

use std::collections::HashMap;
use std::fmt::Write;

use super::folder::Folder;
use super::trajectory::TrajectoryColumn;
use crate::error::{Error, Result};
use crate::files::WrittenFiles;
use crate::rod::Rod;
use crate::stepper::Stepper;
use crate::variable::Size;

/// The coordinates of the points.
pub const POSITIONS: [&str; 2] = ["x_m", "y_m"];

/// Pairs of variables that are vectors in VTK, with their names there.
const VECTORS: [(&str, &str, &str); 2] = [("vx_m_s", "vy_m_s", "velocity_m_s"), ("force_x_n", "force_y_n", "force_n")];

/// The exported variables: those of nodes and joints, and those of trajectory.csv.
pub fn fields(stepper: &Stepper) -> Vec<String> {
    let chosen = stepper.variables().iter().filter(|variable| variable.recorded || variable.size != Size::Scalar);
    chosen.map(|variable| variable.name.to_string()).collect()
}

/// Writes `name`.pvd and one `name`_000000.vtp per time of the `columns` of a run: positions as points, arc length and radius,
/// quantities of nodes and joints as point data (NaN without a joint), scalars as field data.
///
/// # Errors
/// [`Error::UnknownVariable`] without positions or times.
pub fn write(folder: &mut Folder, name: &str, rod: &Rod, columns: &[TrajectoryColumn]) -> Result<WrittenFiles> {
    let find = |name: &'static str| {
        let found = columns.iter().find(|column| column.variable.name == name);
        let needs = Some("x_m, y_m and time_s to be recorded");
        found.ok_or_else(|| Error::UnknownVariable { name: name.to_string(), nearest: None, needs })
    };
    let (time, [x, y]) = (find("time_s")?, [find(POSITIONS[0])?, find(POSITIONS[1])?]);
    let nodes = &x.nodes;
    let file_of = |row: usize| format!("{name}_{row:06}.vtp");
    let mut files = folder.exports();
    let names: Vec<String> = (0..time.values.len()).map(file_of).chain([format!("{name}.pvd")]).collect();
    files.list(names.iter().map(String::as_str));
    let mut collection = String::new();
    for (row, t) in time.values.iter().enumerate() {
        let file = file_of(row);
        let _ = writeln!(collection, r#"    <DataSet timestep="{t}" file="{file}"/>"#);
        let of = |column: &TrajectoryColumn| -> Vec<f64> {
            let own = &column.values[row * column.nodes.len()..(row + 1) * column.nodes.len()];
            if column.nodes == *nodes {
                return own.to_vec();
            }
            let entries: HashMap<usize, f64> = column.nodes.iter().copied().zip(own.iter().copied()).collect();
            nodes.iter().map(|node| entries.get(node).copied().unwrap_or(f64::NAN)).collect()
        };
        let mut points = String::new();
        for (x, y) in of(x).into_iter().zip(of(y)) {
            let _ = write!(points, "{x} {y} 0 ");
        }
        let mut data = String::new();
        let mut add = |name: &str, components: usize, values: &mut dyn Iterator<Item = f64>| {
            let _ = write!(
                data,
                r#"        <DataArray type="Float64" Name="{name}" NumberOfComponents="{components}" format="ascii">"#
            );
            values.for_each(|value| {
                let _ = if value.is_nan() { write!(data, "nan ") } else { write!(data, "{value} ") };
            });
            data.push_str("</DataArray>\n");
        };
        add("arc_length_m", 1, &mut nodes.iter().map(|k| rod.arc_length(*k)));
        add("radius_m", 1, &mut nodes.iter().map(|k| rod.sections.at(rod.xi(*k)).outer));
        for column in columns.iter().filter(|column| column.variable.size != Size::Scalar) {
            let own = column.variable.name;
            if POSITIONS.contains(&own) || VECTORS.iter().any(|(_, second, _)| *second == own) {
                continue;
            }
            let vector = VECTORS.iter().find(|(first, ..)| *first == own);
            let second = vector.and_then(|(_, second, _)| columns.iter().find(|c| c.variable.name == *second));
            match vector.zip(second) {
                Some(((.., name), second)) => {
                    let pairs = of(column).into_iter().zip(of(second));
                    add(name, 3, &mut pairs.flat_map(|(x, y)| [x, y, 0.0]));
                }
                None => add(own, 1, &mut of(column).into_iter()),
            }
        }
        let mut numbers = String::new();
        for column in columns.iter().filter(|column| column.variable.size == Size::Scalar) {
            let _ = writeln!(
                numbers,
                r#"      <DataArray type="Float64" Name="{}" NumberOfTuples="1" format="ascii">{}</DataArray>"#,
                column.variable.name, column.values[row]
            );
        }
        let count = nodes.len();
        let connectivity: String = (0..count).map(|k| format!("{k} ")).collect();
        let text = format!(
            r#"<?xml version="1.0"?>
<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian">
  <PolyData>
    <FieldData>
{numbers}    </FieldData>
    <Piece NumberOfPoints="{count}" NumberOfVerts="0" NumberOfLines="1" NumberOfStrips="0" NumberOfPolys="0">
      <Points>
        <DataArray type="Float64" NumberOfComponents="3" format="ascii">{points}</DataArray>
      </Points>
      <Lines>
        <DataArray type="Int64" Name="connectivity" format="ascii">{connectivity}</DataArray>
        <DataArray type="Int64" Name="offsets" format="ascii">{count}</DataArray>
      </Lines>
      <PointData>
{data}      </PointData>
    </Piece>
  </PolyData>
</VTKFile>
"#
        );
        files.put_file(&file, Ok(text));
    }
    let text = format!(
        r#"<?xml version="1.0"?>
<VTKFile type="Collection" version="1.0" byte_order="LittleEndian">
  <Collection>
{collection}  </Collection>
</VTKFile>
"#
    );
    files.put_file(&format!("{name}.pvd"), Ok(text));
    Ok(files.finish())
}
