//! Scenes.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use caudal::assessment::Assessment;
use caudal::fmu::{Fmu, Standard};
use caudal::scene::Document;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyTuple};

use crate::error::OrRaise;
use crate::values::{fields, shown, to_toml};

/// A scene, read and checked: the complete description of a run.
///
/// A scene is immutable; :func:`caudal.load` creates another one with other values. It holds the contents of the tables that it
/// names, so later changes of files or of the working directory do not affect it. The same holds for a pickled scene.
///
/// Parameters
/// ----------
/// source : Scene, str, os.PathLike or dict
///     The path of a TOML file, the scene's tables themselves, or another scene to start from.
/// set : dict, optional
///     Overrides by dotted key, such as ``{"solver.time_step_s": 1e-3}``.
///
/// Raises
/// ------
/// caudal.errors.SceneError
///     For an unknown key or a value that is not allowed, with the place in the file.
/// caudal.errors.ReadError
///     For a file that cannot be read.
#[pyclass(frozen, module = "caudal")]
pub struct Scene {
    pub document: Document,
    pub scene: Arc<caudal::scene::Scene>,
    path: PathBuf,
}

/// The name in errors of a scene that was given as a dictionary.
const UNNAMED: &str = "scene";

#[pymethods]
impl Scene {
    #[new]
    #[pyo3(signature = (source, set=None))]
    fn new(py: Python<'_>, source: &Bound<'_, PyAny>, set: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let (path, mut document) = if let Ok(other) = source.cast::<Self>() {
            (other.get().path.clone(), other.get().document.clone())
        } else if let Ok(tables) = source.cast::<PyDict>() {
            let text = toml::to_string(&to_toml(tables)?).map_err(|error| PyValueError::new_err(error.to_string()))?;
            (PathBuf::from(UNNAMED), Document::new(UNNAMED, text))
        } else {
            let wrong = |_| {
                let found = source.repr().map_or_else(|_| "this value".to_string(), |text| text.to_string());
                PyTypeError::new_err(format!("scene: found {found}; allowed: a Scene, a path, or a dict of tables"))
            };
            let given: PathBuf = source.extract().map_err(wrong)?;
            let read = Document::read(&given).or_raise(py)?;
            let path = std::path::absolute(&given)?;
            (path.clone(), Document::new(path, read.text()))
        };
        document.begin_layer();
        for (key, value) in set.into_iter().flatten() {
            document.set(&format!("{key}={}", to_toml(&value)?)).or_raise(py)?;
        }
        Self::of(py, path, document)
    }

    /// Name of the scene, which is also the name of the folder for a run's files.
    #[getter]
    fn name(&self) -> &str {
        &self.scene.name
    }

    /// The file from which it was read; ``"scene"`` for a scene given as a dictionary.
    #[getter]
    fn file(&self) -> &PathBuf {
        &self.path
    }

    /// Number of nodes.
    #[getter]
    fn nodes(&self) -> usize {
        self.scene.nodes()
    }

    /// Duration of a run, s.
    #[getter]
    fn duration_s(&self) -> f64 {
        self.scene.solver.duration_s.get()
    }

    /// The scene's text (TOML), without overrides.
    #[getter]
    fn text(&self) -> &str {
        self.document.text()
    }

    /// The overrides as ``key=value``.
    #[getter]
    fn overrides(&self) -> Vec<String> {
        self.document.overrides().to_vec()
    }

    /// The scalar values by key, as written in overrides, such as ``rod.length_m``; for pairs ``key.0`` and ``key.1``, for tables
    /// in a list ``tendons.0.offset_m``.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dictionary = PyDict::new(py);
        for parameter in self.scene.parameters() {
            dictionary.set_item(parameter.path(), parameter.value)?;
        }
        fields(&dictionary)
    }

    /// Warnings to consider before trusting a run: where the model, the mesh or the step size is out of range.
    ///
    /// Returns
    /// -------
    /// list of str
    ///     The warnings of ``caudal check``; empty without warnings.
    ///
    /// Raises
    /// ------
    /// caudal.errors.SceneError
    ///     If a run would be meaningless.
    fn check(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        let assessment = py.detach(|| {
            let stepper = self.document.stepper(&self.scene)?;
            Assessment::of(&self.scene, &stepper)
        });
        Ok(assessment.or_raise(py)?.all_warnings().cloned().collect())
    }

    /// Write the scene as an FMU for co-simulation.
    ///
    /// Parameters
    /// ----------
    /// path : str or os.PathLike
    ///     The file.
    /// fmi : {3, 2}
    ///     Version of the standard.
    /// library : str or os.PathLike, optional
    ///     The shared library to include; by default the package's own.
    ///
    /// Raises
    /// ------
    /// caudal.errors.FmuError, caudal.errors.ReadError, caudal.errors.WriteError
    ///     If there is no library, or the file cannot be written.
    #[pyo3(signature = (path, fmi=3, library=None))]
    fn fmu(&self, py: Python<'_>, path: PathBuf, fmi: u32, library: Option<PathBuf>) -> PyResult<()> {
        let standard = match fmi {
            2 => Standard::Fmi2,
            3 => Standard::Fmi3,
            other => return Err(PyValueError::new_err(format!("fmi: found {other}; allowed: 2, 3"))),
        };
        let library = match library {
            Some(library) => library,
            None => {
                let module: PathBuf = py.import("caudal._caudal")?.filename()?.extract()?;
                caudal::fmu::library(&module).or_raise(py)?
            }
        };
        py.detach(|| Fmu::of(&self.document)?.write(standard, &[library], &path)).or_raise(py)
    }

    fn __repr__(&self) -> String {
        format!("<caudal.Scene {:?}: {} nodes, {} s>", self.scene.name, self.nodes(), self.duration_s())
    }

    fn _repr_html_(slf: &Bound<'_, Self>) -> PyResult<String> {
        shown(slf.as_any())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let rebuild = py.import("caudal._caudal")?.getattr("_rebuild")?;
        let tables = self.document.tables(&self.scene).or_raise(py)?;
        Ok((rebuild, (&self.path, self.text(), self.document.override_lines(), tables).into_pyobject(py)?))
    }

    /// Names and contents of the files of an equivalent scene without overrides that can be moved to any folder: its text in
    /// `name`, and its tables.
    fn _standalone<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Vec<(String, Bound<'py, PyBytes>)>> {
        let files = self.document.standalone(name).or_raise(py)?;
        Ok(files.into_iter().map(|(name, content)| (name, PyBytes::new(py, &content))).collect())
    }

    /// The paths and contents of its tables.
    fn _tables<'py>(&self, py: Python<'py>) -> PyResult<Vec<(PathBuf, Bound<'py, PyBytes>)>> {
        let tables = self.document.tables(&self.scene).or_raise(py)?;
        Ok(tables.into_iter().map(|(path, content)| (path, PyBytes::new(py, &content))).collect())
    }
}

impl Scene {
    fn of(py: Python<'_>, path: PathBuf, document: Document) -> PyResult<Self> {
        let read = || {
            let scene = document.scene()?;
            let tables = document.tables(&scene)?;
            if tables.is_empty() {
                return Ok((document, scene));
            }
            let document = document.with_files(tables);
            let scene = document.scene()?;
            Ok((document, scene))
        };
        let (document, scene) = py.detach(read).or_raise(py)?;
        Ok(Self { document, scene: Arc::new(scene), path })
    }
}

/// A scene from its pickled data.
#[pyfunction]
#[pyo3(name = "_rebuild")]
pub fn rebuild(
    py: Python<'_>,
    path: PathBuf,
    text: String,
    overrides: Vec<String>,
    tables: BTreeMap<PathBuf, Vec<u8>>,
) -> PyResult<Scene> {
    let mut document = Document::new(path.clone(), text).with_files(tables);
    document.set_override_lines(overrides.iter().map(String::as_str)).or_raise(py)?;
    Scene::of(py, path, document)
}
