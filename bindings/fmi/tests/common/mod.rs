//! Shared helpers of the tests: unpacked FMUs of scenes, and access to the functions of their library by name.
#![allow(
    dead_code,
    missing_docs,
    clippy::unwrap_used,
    clippy::panic,
    clippy::missing_safety_doc,
    clippy::undocumented_unsafe_blocks,
    reason = "every test file takes what it needs; a failure ends the test; the tests are the host, who promises"
)]

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::path::{Path, PathBuf};
use std::ptr::{null, null_mut};
use std::sync::Mutex;

use caudal::fmu::{Catalogue, Fmu, FmuOptions, Standard, Target};
use caudal::scene::Document;
use caudal::variable::VARIABLES;
use libloading::Library;
use tempfile::TempDir;

/// The models of the project.
pub fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models")
}

/// The shared library that cargo has built for these tests.
pub fn library_path() -> PathBuf {
    let executable = std::env::current_exe().unwrap();
    executable.parent().unwrap().join(caudal::fmu::library_name())
}

/// An override that replaces the driven head by one on a hinge with a servo.
pub const HINGE: &str =
    "head={kind=\"hinged\",inertia_kg_m2=1e-4,stiffness_n_m=0.5,damping_n_m_s=1e-3,largest_torque_n_m=1.0}";

pub fn document(model: &str, changes: &[&str]) -> Document {
    let mut document = Document::read(&models().join(format!("{model}.toml"))).unwrap();
    for change in changes {
        document.set(change).unwrap();
    }
    document
}

/// Writes the FMU of a scene into a folder.
pub fn write(document: &Document, standard: Standard, folder: &Path) -> PathBuf {
    let version = if standard == Standard::Fmi2 { 2 } else { 3 };
    let name = document.scene().unwrap().name;
    let path = folder.join(format!("{name}-{version}.fmu"));
    Fmu::of(document).unwrap().write(standard, &[library_path()], &path).unwrap();
    path
}

/// An FMU, unpacked and loaded.
pub struct Unpacked {
    pub folder: TempDir,
    pub library: Library,
    pub token: CString,
    pub resources: PathBuf,
    pub description: String,
}

impl Unpacked {
    pub fn of(document: &Document, standard: Standard) -> Self {
        Self::with(document, standard, FmuOptions::default())
    }

    /// An FMU that exposes the variables of `choice`.
    pub fn with(document: &Document, standard: Standard, choice: FmuOptions) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("chosen.fmu");
        Fmu::of(document).unwrap().showing(choice).unwrap().write(standard, &[library_path()], &path).unwrap();
        let mut archive = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
        archive.extract(folder.path()).unwrap();
        let fmu = Fmu::of(document).unwrap();
        let binaries = folder.path().join("binaries");
        let platform = std::fs::read_dir(binaries).unwrap().next().unwrap().unwrap().path();
        let binary = std::fs::read_dir(platform).unwrap().next().unwrap().unwrap().path();
        let library = unsafe { Library::new(binary) }.unwrap();
        let description = std::fs::read_to_string(folder.path().join("modelDescription.xml")).unwrap();
        let resources = folder.path().join("resources");
        Self { library, token: CString::new(fmu.token()).unwrap(), resources, folder, description }
    }

    /// A function of the library, whose type is given by the caller.
    pub fn function<T: Copy>(&self, name: &str) -> T {
        unsafe { *self.library.get::<T>(name.as_bytes()).unwrap_or_else(|error| panic!("{name}: {error}")) }
    }
}

/// The messages of all instances of the tests in this process.
pub static MESSAGES: Mutex<Vec<String>> = Mutex::new(Vec::new());

pub unsafe extern "C" fn log3(_: *mut c_void, status: c_int, category: *const c_char, message: *const c_char) {
    let [category, message] = [category, message].map(|text| unsafe { CStr::from_ptr(text) }.to_string_lossy());
    MESSAGES.lock().unwrap().push(format!("{status} {category}: {message}"));
}

/// Callbacks of an FMI 2.0 host.
#[repr(C)]
pub struct Callbacks {
    logger: *const c_void,
    allocate: *const c_void,
    free: *const c_void,
    finished: *const c_void,
    environment: *mut c_void,
}

// SAFETY: its pointers are never dereferenced.
unsafe impl Sync for Callbacks {}

/// The callbacks of a host that provides none.
pub static NO_CALLBACKS: Callbacks =
    Callbacks { logger: null(), allocate: null(), free: null(), finished: null(), environment: null_mut() };

/// `fmi2Instantiate`.
pub type Instantiate2 = unsafe extern "C" fn(
    *const c_char,
    c_int,
    *const c_char,
    *const c_char,
    *const Callbacks,
    c_int,
    c_int,
) -> *mut c_void;

pub type Update = unsafe extern "C" fn(*mut c_void, f64, u8, u8, u8, u8, *mut u8, *mut f64);

/// The functions of FMI 3.0.
pub struct Fmi3 {
    pub instantiate: unsafe extern "C" fn(
        *const c_char,
        *const c_char,
        *const c_char,
        u8,
        u8,
        u8,
        u8,
        *const u32,
        usize,
        *mut c_void,
        Option<unsafe extern "C" fn(*mut c_void, c_int, *const c_char, *const c_char)>,
        Option<Update>,
    ) -> *mut c_void,
    pub free: unsafe extern "C" fn(*mut c_void),
    pub enter: unsafe extern "C" fn(*mut c_void, u8, f64, f64, u8, f64) -> c_int,
    pub exit: unsafe extern "C" fn(*mut c_void) -> c_int,
    pub reset: unsafe extern "C" fn(*mut c_void) -> c_int,
    pub get: unsafe extern "C" fn(*mut c_void, *const u32, usize, *mut f64, usize) -> c_int,
    pub set: unsafe extern "C" fn(*mut c_void, *const u32, usize, *const f64, usize) -> c_int,
    pub step: unsafe extern "C" fn(*mut c_void, f64, f64, u8, *mut u8, *mut u8, *mut u8, *mut f64) -> c_int,
    pub save: unsafe extern "C" fn(*mut c_void, *mut *mut c_void) -> c_int,
    pub restore: unsafe extern "C" fn(*mut c_void, *mut c_void) -> c_int,
    pub forget: unsafe extern "C" fn(*mut c_void, *mut *mut c_void) -> c_int,
    pub size: unsafe extern "C" fn(*mut c_void, *mut c_void, *mut usize) -> c_int,
    pub serialize: unsafe extern "C" fn(*mut c_void, *mut c_void, *mut u8, usize) -> c_int,
    pub deserialize: unsafe extern "C" fn(*mut c_void, *const u8, usize, *mut *mut c_void) -> c_int,
    pub configure: unsafe extern "C" fn(*mut c_void) -> c_int,
    pub configured: unsafe extern "C" fn(*mut c_void) -> c_int,
    pub set_u64: unsafe extern "C" fn(*mut c_void, *const u32, usize, *const u64, usize) -> c_int,
    pub get_u64: unsafe extern "C" fn(*mut c_void, *const u32, usize, *mut u64, usize) -> c_int,
    token: CString,
    resources: CString,
}

impl Fmi3 {
    pub fn of(fmu: &Unpacked) -> Self {
        Self {
            instantiate: fmu.function("fmi3InstantiateCoSimulation"),
            free: fmu.function("fmi3FreeInstance"),
            enter: fmu.function("fmi3EnterInitializationMode"),
            exit: fmu.function("fmi3ExitInitializationMode"),
            reset: fmu.function("fmi3Reset"),
            get: fmu.function("fmi3GetFloat64"),
            set: fmu.function("fmi3SetFloat64"),
            step: fmu.function("fmi3DoStep"),
            save: fmu.function("fmi3GetFMUState"),
            restore: fmu.function("fmi3SetFMUState"),
            forget: fmu.function("fmi3FreeFMUState"),
            size: fmu.function("fmi3SerializedFMUStateSize"),
            serialize: fmu.function("fmi3SerializeFMUState"),
            deserialize: fmu.function("fmi3DeserializeFMUState"),
            configure: fmu.function("fmi3EnterConfigurationMode"),
            configured: fmu.function("fmi3ExitConfigurationMode"),
            set_u64: fmu.function("fmi3SetUInt64"),
            get_u64: fmu.function("fmi3GetUInt64"),
            token: fmu.token.clone(),
            resources: CString::new(format!("{}/", fmu.resources.display())).unwrap(),
        }
    }

    /// A new instance, not initialised; `update` and `environment` are for intermediate updates.
    pub fn instance(&self, update: Option<Update>, environment: *mut c_void) -> *mut c_void {
        let instance = unsafe {
            (self.instantiate)(
                c"one".as_ptr(),
                self.token.as_ptr(),
                self.resources.as_ptr(),
                0,
                0,
                0,
                1,
                std::ptr::null(),
                0,
                environment,
                Some(log3),
                update,
            )
        };
        assert!(!instance.is_null(), "{:?}", MESSAGES.lock().unwrap());
        instance
    }

    /// A new instance at time zero of its experiment.
    pub fn start(&self) -> *mut c_void {
        let instance = self.instance(None, std::ptr::null_mut());
        self.initialize(instance);
        instance
    }

    pub fn initialize(&self, instance: *mut c_void) {
        unsafe {
            assert_eq!((self.enter)(instance, 0, 0.0, 0.0, 0, 0.0), 0);
            assert_eq!((self.exit)(instance), 0);
        }
    }

    pub fn read(&self, instance: *mut c_void, name: &str, len: usize) -> Vec<f64> {
        let mut values = vec![f64::NAN; len];
        let status = unsafe { (self.get)(instance, &reference(name), 1, values.as_mut_ptr(), len) };
        assert_eq!(status, 0, "{name}: {:?}", MESSAGES.lock().unwrap().last());
        values
    }

    pub fn write(&self, instance: *mut c_void, name: &str, values: &[f64]) -> c_int {
        unsafe { (self.set)(instance, &reference(name), 1, values.as_ptr(), values.len()) }
    }

    /// Steps; returns status, early return and last successful time.
    pub fn advance(&self, instance: *mut c_void, t: f64, h: f64) -> (c_int, bool, f64) {
        let (mut event, mut terminate, mut early, mut last) = (9, 9, 9, f64::NAN);
        let status = unsafe { (self.step)(instance, t, h, 0, &mut event, &mut terminate, &mut early, &mut last) };
        if status == 0 {
            assert_eq!((event, terminate), (0, 0));
        }
        (status, early == 1, last)
    }

    /// Serialises a state.
    pub fn bytes(&self, instance: *mut c_void, state: *mut c_void) -> Vec<u8> {
        let mut size = 0;
        assert_eq!(unsafe { (self.size)(instance, state, &mut size) }, 0);
        let mut bytes = vec![0; size];
        assert_eq!(unsafe { (self.serialize)(instance, state, bytes.as_mut_ptr(), size) }, 0);
        bytes
    }
}

/// The value reference of a variable in FMI 3.0.
pub fn reference(name: &str) -> u32 {
    VARIABLES.iter().position(|variable| variable.name == name).unwrap_or_else(|| panic!("{name}")) as u32
}

/// A pseudo-random number generator: splitmix64.
pub struct Dice(pub u64);

impl Dice {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, bound: usize) -> usize {
        (self.next() % bound as u64) as usize
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// The functions of FMI 2.0.
pub struct Fmi2 {
    pub instantiate: Instantiate2,
    pub free: unsafe extern "C" fn(*mut c_void),
    pub setup: unsafe extern "C" fn(*mut c_void, c_int, f64, f64, c_int, f64) -> c_int,
    pub enter: unsafe extern "C" fn(*mut c_void) -> c_int,
    pub exit: unsafe extern "C" fn(*mut c_void) -> c_int,
    pub get: unsafe extern "C" fn(*mut c_void, *const u32, usize, *mut f64) -> c_int,
    pub set: unsafe extern "C" fn(*mut c_void, *const u32, usize, *const f64) -> c_int,
    pub rates: unsafe extern "C" fn(*mut c_void, *const u32, usize, *const c_int, *const f64) -> c_int,
    pub slopes: unsafe extern "C" fn(*mut c_void, *const u32, usize, *const c_int, *mut f64) -> c_int,
    pub step: unsafe extern "C" fn(*mut c_void, f64, f64, c_int) -> c_int,
    pub real_status: unsafe extern "C" fn(*mut c_void, c_int, *mut f64) -> c_int,
    pub terminate: unsafe extern "C" fn(*mut c_void) -> c_int,
    pub reset: unsafe extern "C" fn(*mut c_void) -> c_int,
    pub directional: Directional2,
}

/// `fmi2GetDirectionalDerivative`.
pub type Directional2 =
    unsafe extern "C" fn(*mut c_void, *const u32, usize, *const u32, usize, *const f64, *mut f64) -> c_int;

impl Fmi2 {
    pub fn of(fmu: &Unpacked) -> Self {
        Self {
            instantiate: fmu.function("fmi2Instantiate"),
            free: fmu.function("fmi2FreeInstance"),
            setup: fmu.function("fmi2SetupExperiment"),
            enter: fmu.function("fmi2EnterInitializationMode"),
            exit: fmu.function("fmi2ExitInitializationMode"),
            get: fmu.function("fmi2GetReal"),
            set: fmu.function("fmi2SetReal"),
            rates: fmu.function("fmi2SetRealInputDerivatives"),
            slopes: fmu.function("fmi2GetRealOutputDerivatives"),
            step: fmu.function("fmi2DoStep"),
            real_status: fmu.function("fmi2GetRealStatus"),
            terminate: fmu.function("fmi2Terminate"),
            reset: fmu.function("fmi2Reset"),
            directional: fmu.function("fmi2GetDirectionalDerivative"),
        }
    }

    pub fn instance(&self, fmu: &Unpacked) -> *mut c_void {
        let location = CString::new(format!("file://{}", fmu.resources.display())).unwrap();
        let instance = unsafe {
            (self.instantiate)(c"two".as_ptr(), 1, fmu.token.as_ptr(), location.as_ptr(), &raw const NO_CALLBACKS, 0, 0)
        };
        assert!(!instance.is_null());
        instance
    }

    pub fn start(&self, fmu: &Unpacked) -> *mut c_void {
        let instance = self.instance(fmu);
        unsafe {
            assert_eq!((self.setup)(instance, 0, 0.0, 0.0, 0, 0.0), 0);
            assert_eq!((self.enter)(instance), 0);
            assert_eq!((self.exit)(instance), 0);
        }
        instance
    }
}

pub fn references2(name: &str, nodes: std::ops::Range<usize>) -> Vec<u32> {
    let place = reference(name) as usize;
    nodes.map(|node| Catalogue::reference(Standard::Fmi2, Target::Variable(place, node))).collect()
}
