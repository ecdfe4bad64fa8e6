//! The core of echogrid for Python: mapping, map files, how good a map is. `python/echogrid/core.py` gives it its Python face; arrays go
//! over as bytes, so that no version of NumPy is bound to.

use std::path::PathBuf;

use echogrid_core::{
    CellIndex, Echo, Estimate, Footprint, Grid, GridMapper, Matrix3, Odometry, Pose2, Reading, Robot, Sensor,
    SensorKind, TILE_SIDE,
};
use echogrid_core::{MapperConfig, OdometryConfig};
use echogrid_formats::map::{MapDocument, PathPoint, Provenance, native};
use echogrid_formats::world;
use echogrid_judge::quality::{Quality, Truth};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use serde_json::{Map, Value};

/// A sensor as a tuple: kind, x, y, theta, transducers, first bearing, step, aperture, range from and to, error.
type SensorTuple = (u8, f64, f64, f64, u16, f64, f64, f64, f64, f64, f64);
/// A map: log-odds as bytes of f32, rows, columns, x and y of its lower left corner, side of a cell.
type DenseMap<'py> = (Bound<'py, PyBytes>, usize, usize, f64, f64, f64);
/// A point of a path: stamp in nanoseconds, x, y, theta, trust.
type PathTuple = (u64, f64, f64, f64, f64);

fn wrong(error: impl core::fmt::Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Settings over the defaults; a key that nobody knows is an error.
fn settings<T: serde_like::Settings>(json: &str) -> PyResult<T> {
    let given: Map<String, Value> = serde_json::from_str(json).map_err(wrong)?;
    let mut all = match T::defaults() {
        Value::Object(all) => all,
        _ => Map::new(),
    };
    for (key, value) in given {
        if !all.contains_key(&key) {
            let known: Vec<&String> = all.keys().collect();
            return Err(wrong(format!("unknown setting {key:?}; known are {known:?}")));
        }
        all.insert(key, value);
    }
    T::read(Value::Object(all)).map_err(wrong)
}

/// Configurations that are made of JSON.
mod serde_like {
    use echogrid_core::{MapperConfig, OdometryConfig};
    use serde_json::{Error, Value, from_value, to_value};

    pub(crate) trait Settings: Sized {
        fn defaults() -> Value;
        fn read(value: Value) -> Result<Self, Error>;
    }

    macro_rules! settings {
        ($($config:ty),*) => { $(impl Settings for $config {
            fn defaults() -> Value {
                to_value(Self::default()).unwrap_or_default()
            }
            fn read(value: Value) -> Result<Self, Error> {
                from_value(value)
            }
        })* };
    }
    settings!(MapperConfig, OdometryConfig);
}

fn robot(name: &str, length_m: f64, width_m: f64, sensors: Vec<SensorTuple>) -> PyResult<Robot> {
    let mut first = 0_u16;
    let mut sensor = |of: SensorTuple| {
        let (
            kind,
            x,
            y,
            theta,
            transducers,
            first_bearing_rad,
            bearing_step_rad,
            aperture_rad,
            range_min_m,
            range_max_m,
            error,
        ) = of;
        let sensor = Sensor {
            kind: if kind == 1 { SensorKind::Sonar } else { SensorKind::Lidar },
            base_from_sensor: Pose2::new(x, y, theta),
            first_transducer: first,
            transducers,
            first_bearing_rad,
            bearing_step_rad,
            aperture_rad,
            range_min_m,
            range_max_m,
            range_error_ratio: error,
        };
        first = first.checked_add(transducers).ok_or_else(|| wrong("more than 65535 transducers"))?;
        Ok(sensor)
    };
    let sensors = sensors.into_iter().map(&mut sensor).collect::<PyResult<_>>()?;
    Ok(Robot { name: name.to_owned(), footprint: Footprint { length_m, width_m }, sensors })
}

/// Where the robot is, and how far that can be trusted.
// Python's allocator aligns to 16 bytes, and no class of pyo3 may need more.
const _: () = assert!(align_of::<PyEstimate>() <= 16 && align_of::<PyOdometry>() <= 16 && align_of::<PyMapper>() <= 16);

#[pyclass(frozen, name = "Estimate", module = "echogrid")]
struct PyEstimate(Estimate);

#[pymethods]
impl PyEstimate {
    /// A pose in the map frame; `covariance`: of x, y and theta, row by row, or none for a pose that is exact.
    #[new]
    #[pyo3(signature = (x, y, theta, covariance=None))]
    fn new(x: f64, y: f64, theta: f64, covariance: Option<[f64; 9]>) -> PyResult<Self> {
        let pose = Pose2::new(x, y, theta);
        if !pose.is_finite() {
            return Err(wrong(format!("pose ({x}, {y}, {theta}): expected finite numbers")));
        }
        Ok(Self(match covariance {
            None => Estimate::certain(pose),
            Some(rows) if rows.iter().all(|number| number.is_finite()) => {
                Estimate::with_covariance(pose, &Matrix3::from_row_slice(&rows))
            }
            Some(rows) => return Err(wrong(format!("covariance {rows:?}: expected finite numbers"))),
        }))
    }

    /// x, y and theta in the map frame.
    #[getter]
    fn pose(&self) -> (f64, f64, f64) {
        let Pose2 { x, y, theta } = self.0.pose;
        (x, y, theta)
    }

    /// Of x, y and theta, row by row.
    #[getter]
    fn covariance_rows(&self) -> Vec<f64> {
        self.0.pose_covariance().transpose().iter().copied().collect()
    }
}

/// Dead reckoning with the paper's errors.
#[pyclass(name = "Odometry", module = "echogrid")]
struct PyOdometry(Odometry);

#[pymethods]
impl PyOdometry {
    #[new]
    fn new(json: &str) -> PyResult<Self> {
        let config: OdometryConfig = settings(json)?;
        config.validate().map_err(wrong)?;
        Ok(Self(Odometry::new(&config)))
    }

    fn step(&mut self, x: f64, y: f64, theta: f64) -> PyResult<PyEstimate> {
        let pose = Pose2::new(x, y, theta);
        if !pose.is_finite() {
            return Err(wrong(format!("pose ({x}, {y}, {theta}): expected finite numbers")));
        }
        Ok(PyEstimate(self.0.step(pose)))
    }
}

/// The mapper: Algorithm 1 of the paper.
#[pyclass(name = "Mapper", module = "echogrid")]
struct PyMapper {
    mapper: GridMapper,
    sequence: u64,
    path: Vec<PathPoint>,
    transducers: usize,
}

#[pymethods]
impl PyMapper {
    #[new]
    fn new(json: &str, name: &str, length_m: f64, width_m: f64, sensors: Vec<SensorTuple>) -> PyResult<Self> {
        let config: MapperConfig = settings(json)?;
        let robot = robot(name, length_m, width_m, sensors)?;
        let transducers = robot.transducer_count();
        let mapper = GridMapper::with_defaults_of_odometry(&config, robot).map_err(wrong)?;
        Ok(Self { mapper, sequence: 0, path: Vec::new(), transducers })
    }

    /// Fuses readings (transducer, echo as on the wire, range) that were taken at an estimate; their verdicts in words.
    fn scan(&mut self, stamp_ns: u64, estimate: &PyEstimate, readings: Vec<(u16, u8, f64)>) -> PyResult<Vec<String>> {
        let mut scan = Vec::with_capacity(readings.len());
        for (transducer, echo, range_m) in readings {
            if usize::from(transducer) >= self.transducers {
                return Err(wrong(format!("transducer {transducer}: the robot has {}", self.transducers)));
            }
            let echo = match echo {
                0 => Echo::Hit { range_m },
                1 => Echo::NoEcho,
                _ => Echo::Invalid,
            };
            scan.push((Reading { transducer, echo, offset_ns: 0 }, Some(estimate.0)));
        }
        self.sequence += 1;
        let verdicts = self.mapper.integrate_scan(self.sequence, &scan);
        self.path.push(PathPoint { stamp_ns, pose: estimate.0.pose, trust: 1.0 });
        Ok(verdicts.iter().map(|verdict| verdict.name().to_owned()).collect())
    }

    fn dense<'py>(&self, py: Python<'py>) -> Option<DenseMap<'py>> {
        dense(py, &self.mapper.shown())
    }

    /// Saves the map as echogrid's own file.
    fn save(&self, path: PathBuf) -> PyResult<()> {
        let software = concat!("echogrid-python ", env!("CARGO_PKG_VERSION")).to_owned();
        let provenance = Provenance { software, ..Provenance::default() };
        let document = MapDocument {
            grid: self.mapper.shown().into_owned(),
            doubt: None,
            facing: None,
            path: self.path.clone(),
            provenance,
        };
        native::write(&path, &document).map_err(wrong)
    }
}

/// The cells of a grid from its lowest to its highest tile; none of an empty one.
fn dense<'py>(py: Python<'py>, grid: &Grid) -> Option<DenseMap<'py>> {
    let side = i32::try_from(TILE_SIDE).ok()?;
    let indices = || grid.tiles().map(|(index, _)| index);
    let (left, right) = (indices().map(|tile| tile.x).min()?, indices().map(|tile| tile.x).max()?);
    let (low, high) = (indices().map(|tile| tile.y).min()?, indices().map(|tile| tile.y).max()?);
    let (rows, columns) = ((high - low + 1) * side, (right - left + 1) * side);
    let mut bytes = Vec::new();
    for j in low * side..low * side + rows {
        for i in left * side..left * side + columns {
            bytes.extend(grid.log_odds(CellIndex { i, j }).unwrap_or(f32::NAN).to_ne_bytes());
        }
    }
    let resolution_m = grid.resolution_m();
    let corner = |tile: i32| f64::from(tile * side) * resolution_m;
    let array = PyBytes::new(py, &bytes);
    Some((array, rows.try_into().ok()?, columns.try_into().ok()?, corner(left), corner(low), resolution_m))
}

/// A map file: its cells, the path of the robot, and the configuration that it was made with.
#[pyfunction]
fn read_map(py: Python<'_>, path: PathBuf) -> PyResult<(Option<DenseMap<'_>>, Vec<PathTuple>, String)> {
    let document = native::read(&path).map_err(wrong)?;
    let point = |point: &PathPoint| (point.stamp_ns, point.pose.x, point.pose.y, point.pose.theta, point.trust);
    Ok((dense(py, &document.grid), document.path.iter().map(point).collect(), document.provenance.config_toml))
}

/// How well a map file shows a known world, as JSON; the map's own path is taken for true.
#[pyfunction]
fn score(map: PathBuf, known: PathBuf) -> PyResult<String> {
    let document = native::read(&map).map_err(wrong)?;
    let (walls, _) = world::find(&known).map_err(wrong)?.walls_only().map_err(wrong)?;
    let path: Vec<Pose2> = document.path.iter().map(|point| point.pose).collect();
    let truth = Truth::of(&walls, &path, &document.grid).map_err(wrong)?;
    let quality = Quality::against(&document.grid, &truth).map_err(wrong)?;
    serde_json::to_string(&quality).map_err(wrong)
}

#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyEstimate>()?;
    module.add_class::<PyOdometry>()?;
    module.add_class::<PyMapper>()?;
    module.add_function(wrap_pyfunction!(read_map, module)?)?;
    module.add_function(wrap_pyfunction!(score, module)?)
}
