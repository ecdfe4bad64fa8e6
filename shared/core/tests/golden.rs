//! The reference code against tables that an independent implementation of the model computed.
//!
//! The tables are looked for in `$ECHOGRID_GOLDEN`, else beside the workspace; without them these tests say so and pass.

#![allow(clippy::print_stdout, clippy::panic, clippy::expect_used, reason = "tests")]

use std::path::PathBuf;

use echogrid_core::config::Systematic;
use echogrid_core::first_echo::{FirstEcho, SeenCell};
use echogrid_core::grid::{CellIndex, Grid};
use echogrid_core::kernel::{BOUND, Kernel};
use echogrid_core::log_odds::{log_odds_of, probability_of};
use echogrid_core::noise::NoiseTerms;
use echogrid_core::odometry::{ErrorModel, Increment, Odometry, OdometryErrors, move_by};
use echogrid_core::oriented::{DIRECTIONS, FacedCell, Oriented, Response};
use echogrid_core::sensor_model::{BAND, Cone, Deviations, Region};
use echogrid_core::{Matrix3, OdometryConfig, Pose2, wrap_angle};

const RELATIVE: f64 = 1e-9;
const ABSOLUTE: f64 = 1e-12;

/// One row, by column name.
struct Row<'a> {
    table: &'a Table,
    line: usize,
}

struct Table {
    name: &'static str,
    columns: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    /// The table, or none (with a note) where there are no tables.
    fn load(name: &'static str) -> Option<Self> {
        let folder = std::env::var_os("ECHOGRID_GOLDEN")
            .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/golden"), PathBuf::from);
        if !folder.is_dir() {
            println!("skipped: no golden tables at {}", folder.display());
            return None;
        }
        let path = folder.join(name);
        let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let mut lines = text.lines();
        let columns = lines.next().expect("a head line").split(',').map(str::to_owned).collect();
        let rows: Vec<Vec<f64>> = lines.map(|line| line.split(',').map(number).collect()).collect();
        assert!(!rows.is_empty(), "{name} has no rows");
        Some(Self { name, columns, rows })
    }

    fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        (0..self.rows.len()).map(|line| Row { table: self, line })
    }
}

impl Row<'_> {
    fn get(&self, column: &str) -> f64 {
        let place = self.table.columns.iter().position(|c| c == column);
        self.table.rows[self.line][place.unwrap_or_else(|| panic!("{}: no column {column}", self.table.name))]
    }

    /// `ours` must agree with this column.
    fn check(&self, column: &str, ours: f64) {
        let golden = self.get(column);
        let agrees = (ours - golden).abs() <= ABSOLUTE + RELATIVE * golden.abs();
        assert!(agrees, "{} row {}: {column} is {golden:e}, computed {ours:e}", self.table.name, self.line);
    }
}

/// An empty field is none, and so is the word.
fn number(field: &str) -> f64 {
    if field.is_empty() || field == "none" { f64::NAN } else { field.parse().expect("a number") }
}

#[test]
fn error_model() {
    let Some(table) = Table::load("error_model.csv") else { return };
    for row in table.rows() {
        let config = OdometryConfig {
            systematic: Systematic::Carry,
            lin_scale: row.get("lin_scale"),
            lin_offset_m: row.get("lin_offset_m"),
            ang_scale: row.get("ang_scale"),
            ang_offset_rad: row.get("ang_offset_rad"),
            k_ll: row.get("k_ll"),
            k_lt: row.get("k_lt"),
            k_tt: row.get("k_tt"),
            k_tl: row.get("k_tl"),
            ..OdometryConfig::default()
        };
        let (travel_m, turn_rad) = (row.get("travel_m"), row.get("turn_rad"));
        let errors = ErrorModel::new(&config).errors(travel_m, turn_rad);
        row.check("e_lin_m", errors.e_lin_m);
        row.check("e_ang_rad", errors.e_ang_rad);
        row.check("eps_lin_m2", errors.eps_lin_m2);
        row.check("eps_ang_rad2", errors.eps_ang_rad2);
        for systematic in [Systematic::Correct, Systematic::Off] {
            let not_carried =
                ErrorModel::new(&OdometryConfig { systematic, ..config.clone() }).errors(travel_m, turn_rad);
            assert_eq!(not_carried, OdometryErrors { e_lin_m: 0.0, e_ang_rad: 0.0, ..errors });
        }
    }
}

#[test]
fn beam_sigmas() {
    let Some(table) = Table::load("beam_sigmas.csv") else { return };
    for row in table.rows() {
        let c = |column: &str| row.get(column);
        let covariance = Matrix3::new(
            c("c_xx"),
            c("c_xy"),
            c("c_xt"),
            c("c_xy"),
            c("c_yy"),
            c("c_yt"),
            c("c_xt"),
            c("c_yt"),
            c("c_tt"),
        );
        let aperture_rad = core::f64::consts::FRAC_PI_6;
        let found =
            Deviations::of_covariance(c("z_m"), c("bearing_rad"), aperture_rad, 0.01, c("resolution_m"), &covariance);
        row.check("sigma_z_m", found.sigma_z_m);
        row.check("sigma_theta_rad", found.sigma_theta_rad);
        row.check("trust", found.trust);
    }
}

#[test]
fn dead_reckoning() {
    let Some(table) = Table::load("dead_reckoning.csv") else { return };
    let mut odometry = Odometry::new(&OdometryConfig::default());
    for row in table.rows() {
        let config = OdometryConfig {
            systematic: Systematic::Off,
            k_ll: row.get("k_ll"),
            k_lt: row.get("k_lt"),
            k_tt: row.get("k_tt"),
            k_tl: row.get("k_tl"),
            ..OdometryConfig::default()
        };
        let before = Pose2::new(row.get("x0_m"), row.get("y0_m"), row.get("theta0_rad"));
        let step = Increment { forward_m: row.get("dl_m"), lateral_m: 0.0, turn_rad: row.get("dtheta_rad") };
        let after = move_by(before, step);
        let check_pose = |pose: Pose2| {
            row.check("x_m", pose.x);
            row.check("y_m", pose.y);
            assert!(wrap_angle(pose.theta - row.get("theta_rad")).abs() < 1e-9, "row {}", row.line);
        };
        check_pose(after);
        // The whole of a track, as the drive would report it.
        if row.get("step") == 0.0 {
            odometry = Odometry::new(&config);
            odometry.step(before);
        }
        let estimate = odometry.step(after);
        check_pose(estimate.pose);
        for (column, (r, c)) in
            [("c_xx", (0, 0)), ("c_xy", (0, 1)), ("c_xt", (0, 2)), ("c_yy", (1, 1)), ("c_yt", (1, 2)), ("c_tt", (2, 2))]
        {
            row.check(column, estimate.covariance[(r, c)]);
            row.check(column, estimate.covariance[(c, r)]);
        }
    }
}

fn golden_cone(row: &Row<'_>) -> Cone {
    assert_eq!(row.get("band"), BAND);
    let errors = OdometryErrors {
        e_lin_m: row.get("e_lin_m"),
        e_ang_rad: row.get("e_ang_rad"),
        eps_lin_m2: 0.0,
        eps_ang_rad2: 0.0,
    };
    let noise = NoiseTerms { lin_m: row.get("n_lin_m"), ang_rad: row.get("n_ang_rad") };
    let (range_m, aperture_rad) = (row.get("z_m"), row.get("aperture_rad"));
    Cone {
        range_m,
        aperture_rad,
        range_cap_m: row.get("r_cap_m"),
        deviations: Deviations::of(range_m, aperture_rad, row.get("eta"), row.get("resolution_m"), &errors, noise),
        p_occupied: row.get("p_occupied"),
        p_free: row.get("p_free"),
        leaves_gaps: false,
    }
}

#[test]
fn sensor_model() {
    let Some(table) = Table::load("sensor_model.csv") else { return };
    for row in table.rows() {
        let cone = golden_cone(&row);
        row.check("sigma_z_m", cone.deviations.sigma_z_m);
        row.check("sigma_theta_rad", cone.deviations.sigma_theta_rad);
        let (d, phi) = (row.get("d_m"), row.get("phi_rad"));
        let region = match cone.region(d, phi) {
            Region::Free => 1.0,
            Region::Echo => 2.0,
            Region::Unseen => 3.0,
        };
        assert_eq!(region, row.get("region"), "row {}", row.line);
        let p = cone.probability(d, phi).unwrap_or_else(|| probability_of(0.0));
        row.check("p", p);
        row.check("log_odds", log_odds_of(p));
    }
}

/// The fast kernel on the golden cells: the transducer is put where the centre of cell (0, 0) has the row's d and φ.
#[test]
fn kernel_on_golden_cells() {
    let Some(table) = Table::load("sensor_model.csv") else { return };
    let mut touched = 0;
    for row in table.rows() {
        let (d, phi) = (row.get("d_m"), row.get("phi_rad"));
        if d <= 0.0 {
            continue; // no cell lies at a negative distance
        }
        let cone = golden_cone(&row);
        let cell = CellIndex { i: 0, j: 0 };
        for axis in [0.0, 1.0, 2.5, -2.0] {
            let mut grid = Grid::new(row.get("resolution_m"));
            let [x, y] = grid.centre(cell);
            let (s, c) = libm::sincos(axis + phi);
            let map_from_transducer = Pose2::new(x - d * c, y - d * s, axis);
            let added = Kernel::new(0.0, 8.0).add(&mut grid, map_from_transducer, &cone, 1);
            assert!(added.is_ok());
            if row.get("region") == 3.0 {
                assert_eq!(grid.log_odds(cell), None, "row {}", row.line);
            } else {
                let ours = f64::from(grid.log_odds(cell).expect("in the cone"));
                assert!((ours - row.get("log_odds")).abs() < BOUND, "row {}: {ours}", row.line);
                touched += 1;
            }
        }
    }
    assert!(touched > 1000);
}

#[test]
fn calibration_from_trials() {
    use echogrid_core::calibration::{Calibration, Trial};
    // The phase of a trial is a word: the table is split into two of numbers.
    let folder = std::env::var_os("ECHOGRID_GOLDEN")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/golden"), PathBuf::from);
    let Some(expected) = Table::load("calibration_expected.csv") else { return };
    let text = std::fs::read_to_string(folder.join("calibration_trials.csv")).expect("the trials");
    assert!(text.starts_with("series,phase,measured_dl_m,measured_dtheta_rad,true_dl_m,true_dtheta_rad\n"));
    let trials = |series: f64, phase: &str| -> Vec<Trial> {
        let rows = text.lines().skip(1).map(|line| line.split(',').collect::<Vec<_>>());
        let rows = rows.filter(|row| row[0].parse() == Ok(series) && row[1] == phase);
        let number = |word: &str| word.parse().expect("a number");
        rows.map(|row| Trial {
            measured_m: number(row[2]),
            measured_rad: number(row[3]),
            true_m: number(row[4]),
            true_rad: number(row[5]),
        })
        .collect()
    };
    for row in expected.rows() {
        let series = row.get("series");
        let fit = Calibration::fit(&trials(series, "translation"), &trials(series, "rotation")).expect("a model");
        for (name, value) in [
            ("lin_scale", fit.lin_scale),
            ("lin_offset_m", fit.lin_offset_m),
            ("ang_scale", fit.ang_scale),
            ("ang_offset_rad", fit.ang_offset_rad),
            ("k_ll", fit.k_ll),
            ("k_lt", fit.k_lt),
            ("k_tt", fit.k_tt),
            ("k_tl", fit.k_tl),
        ] {
            row.check(name, value);
        }
    }
}

#[test]
fn first_echo() {
    let Some(table) = Table::load("first_echo.csv") else { return };
    let mut from = 0;
    while from < table.rows.len() {
        let row = |line| Row { table: &table, line };
        let cone = row(from).get("cone");
        let to = (from..table.rows.len()).find(|line| row(*line).get("cone") != cone).unwrap_or(table.rows.len());
        let first = row(from);
        let range_m = Some(first.get("z_m")).filter(|range_m| range_m.is_finite());
        let reading = FirstEcho {
            range_m,
            sigma_z_m: first.get("sigma_z_m"),
            sigma_theta_rad: first.get("sigma_theta_rad"),
            detection: first.get("r0"),
            clutter: first.get("clutter"),
            range_cap_m: first.get("r_cap_m"),
            lost: first.get("clutter"),
        };
        let cells: Vec<SeenCell> = (from..to)
            .map(|line| SeenCell {
                distance_m: row(line).get("d_m"),
                bearing_rad: row(line).get("phi_rad"),
                probability: row(line).get("p_before"),
            })
            .collect();
        for ((line, cell), gain) in (from..to).zip(&cells).zip(reading.gains(&cells)) {
            row(line).check("p_after", probability_of(log_odds_of(cell.probability) + gain));
        }
        from = to;
    }
}

#[test]
fn oriented_response() {
    let Some(table) = Table::load("oriented_response.csv") else { return };
    let response = Response::new(25.0_f64.to_radians(), DIRECTIONS);
    for row in table.rows() {
        // That table was integrated step by step.
        let ours = response.share(row.get("direction") as usize, row.get("ray_rad"));
        assert!((ours - row.get("response_share")).abs() < 1e-9, "row {}: {ours}", row.line);
    }
}

/// Cones of few cells, whose gains were found by going through all worlds.
#[test]
fn oriented_update() {
    let Some(table) = Table::load("oriented_update.csv") else { return };
    let rows: Vec<Row<'_>> = table.rows().collect();
    for cone in rows.chunk_by(|a, b| a.get("case") == b.get("case")) {
        let column = |cell: &[Row<'_>], name| cell.iter().map(|row| row.get(name)).collect::<Vec<_>>();
        let cells: Vec<_> = cone
            .chunk_by(|a, b| a.get("cell") == b.get("cell"))
            .map(|cell| (cell, column(cell, "v_before"), column(cell, "response")))
            .collect();
        let faced: Vec<FacedCell<'_>> = cells
            .iter()
            .map(|(cell, log_weights, responses)| FacedCell {
                distance_m: cell[0].get("distance_m"),
                log_weights,
                responses,
            })
            .collect();
        let first = &cone[0];
        let reading = Oriented {
            range_m: Some(first.get("range_m")).filter(|range_m| range_m.is_finite()),
            sigma_z_m: first.get("sigma_z_m"),
            clutter: first.get("clutter_per_m"),
            range_cap_m: 1.0,
            lost: first.get("echo_lost"),
        };
        for ((cell, ..), gains) in cells.iter().zip(reading.gains(&faced)) {
            cell.iter().zip(gains).for_each(|(row, gain)| row.check("gain", gain));
        }
    }
}
