//! The pictures of docs/model.md: what a reading does to a map, by rule of fusion and by how well the pose is known.
//!
//! `cargo run --release --example beam_pictures [DIR]` writes beams.png, beam-profiles.png and beam-second.png to DIR, docs/images
//! unless said. The map is made by the library's own mapper with the defaults of `[mapper]`; the error is that of the defaults of
//! `[odometry]` after a straight way, with noise = "one_sigma", so that no draw decides what is shown.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use echogrid_core::config::{Fusion, Noise};
use echogrid_core::log_odds::probability_of;
use echogrid_core::sensor_model::Deviations;
use echogrid_core::{
    Echo, Estimate, GridMapper, MapperConfig, Odometry, OdometryConfig, Pose2, Reading, Robot, Sensor, SensorKind,
    Verdict,
};
use echogrid_formats::canvas::{Canvas, INK, LETTER_PX};
use echogrid_formats::map::picture;

const APERTURE_RAD: f64 = core::f64::consts::FRAC_PI_6;
const RANGE_ERROR_RATIO: f64 = 0.01;
const RANGE_M: f64 = 2.0;
/// Sonars of the robot: one looks ahead, one to the right.
const AHEAD: u16 = 0;
const RIGHT: u16 = 1;
/// The axis of a beam runs through the middle of a row of cells, metres.
const AXIS_Y_M: f64 = 0.025;
/// What the way to the place of a reading was, metres.
const WAYS_M: [f64; 3] = [0.0, 5.0, 20.0];
const WAY_NAMES: [&str; 3] = ["pose known", "5 m after a fix", "20 m after a fix"];

const CELL_PX: usize = 6;
const GAP_PX: usize = 18;
/// Letters are so many times as large as the font's.
const SCALE: usize = 2;
const LINE_PX: usize = 22;
const AXIS: [u8; 3] = [205, 120, 30];
const MARK: [u8; 3] = [220, 30, 30];
const CURVES: [[u8; 3]; 3] = [[20, 40, 150], [205, 120, 30], [200, 30, 60]];
const RULE: [u8; 3] = [214, 214, 214];

fn main() -> Result<()> {
    let folder = std::env::args().nth(1).unwrap_or_else(|| "docs/images".to_owned());
    for (name, canvas) in [("beams.png", beams()?), ("beam-profiles.png", profiles()?), ("beam-second.png", second()?)]
    {
        let file = Path::new(&folder).join(name);
        std::fs::write(&file, canvas.encode()?).with_context(|| format!("{}", file.display()))?;
    }
    Ok(())
}

/// Two sonars at the middle of the robot.
fn robot() -> Robot {
    let sonar = |first_transducer: u16, bearing_rad: f64| Sensor {
        kind: SensorKind::Sonar,
        base_from_sensor: Pose2::new(0.0, 0.0, bearing_rad),
        first_transducer,
        transducers: 1,
        first_bearing_rad: 0.0,
        bearing_step_rad: 0.0,
        aperture_rad: APERTURE_RAD,
        range_min_m: 0.1,
        range_max_m: 5.0,
        range_error_ratio: RANGE_ERROR_RATIO,
    };
    Robot { sensors: vec![sonar(AHEAD, 0.0), sonar(RIGHT, -core::f64::consts::FRAC_PI_2)], ..Robot::default() }
}

fn mapper(fusion: Fusion) -> Result<GridMapper> {
    let config = MapperConfig { fusion, min_trust: 0.0, ..MapperConfig::default() };
    Ok(GridMapper::new(&config, Noise::OneSigma, 1, robot())?)
}

fn hear(mapper: &mut GridMapper, sequence: u64, transducer: u16, range_m: f64, estimate: &Estimate) -> Result<()> {
    let reading = Reading { transducer, echo: Echo::Hit { range_m }, offset_ns: 0 };
    let verdict = mapper.integrate(sequence, &reading, Some(estimate));
    ensure!(verdict == Verdict::Accepted, "the reading was refused: {verdict:?}");
    Ok(())
}

/// After `way_m` straight on without a fix, ending where the axis of the beam lies along x: ahead, or to the right of a robot that
/// looks along y.
fn after(way_m: f64, transducer: u16) -> Result<Estimate> {
    let config = OdometryConfig { noise: Noise::OneSigma, ..OdometryConfig::default() };
    let mut odometry = Odometry::new(&config);
    let steps = (way_m / 0.1).round() as i32;
    for step in 0..=steps {
        let back_m = way_m - 0.1 * f64::from(step);
        odometry.step(match transducer {
            AHEAD => Pose2::new(-back_m, AXIS_Y_M, 0.0),
            _ => Pose2::new(0.0, AXIS_Y_M - back_m, core::f64::consts::FRAC_PI_2),
        });
    }
    odometry.estimate().context("an estimate after the way")
}

fn deviations(fusion: Fusion, estimate: &Estimate, resolution_m: f64) -> Deviations {
    match fusion.of(SensorKind::Sonar) {
        Fusion::Auto | Fusion::Paper => {
            let noise = echogrid_core::noise::NoiseTerms::one_sigma(&estimate.errors);
            Deviations::of(RANGE_M, APERTURE_RAD, RANGE_ERROR_RATIO, resolution_m, &estimate.errors, noise)
        }
        Fusion::Covariance | Fusion::FirstEcho | Fusion::Oriented => {
            let covariance = estimate.pose_covariance();
            Deviations::of_covariance(RANGE_M, 0.0, APERTURE_RAD, RANGE_ERROR_RATIO, resolution_m, &covariance)
        }
    }
}

/// A window of the map.
#[derive(Clone, Copy)]
struct View {
    low_m: [f64; 2],
    cells: [usize; 2],
}

impl View {
    fn size_px(self) -> [usize; 2] {
        self.cells.map(|cells| cells * CELL_PX)
    }

    fn pixel(self, [left, top]: [usize; 2], [x, y]: [f64; 2], resolution_m: f64) -> [usize; 2] {
        let scale = CELL_PX as f64 / resolution_m;
        let right = ((x - self.low_m[0]) * scale).max(0.0) as usize;
        let down = (self.size_px()[1] as f64 - (y - self.low_m[1]) * scale).max(0.0) as usize;
        [left + right, top + down]
    }

    /// Cells in the colours of map.png, in a frame.
    fn draw(self, canvas: &mut Canvas, [left, top]: [usize; 2], mapper: &GridMapper) {
        let grid = mapper.grid();
        let [width, height] = self.size_px();
        for (row, column) in (0..height).flat_map(|row| (0..width).map(move |column| (row, column))) {
            let resolution_m = grid.resolution_m();
            let x = self.low_m[0] + ((column / CELL_PX) as f64 + 0.5) * resolution_m;
            let y = self.low_m[1] + ((height - 1 - row) / CELL_PX) as f64 * resolution_m + 0.5 * resolution_m;
            let colour = grid.log_odds(grid.cell_at(x, y)).map_or(picture::UNKNOWN, |log_odds| {
                [((1.0 - probability_of(f64::from(log_odds))) * 255.0).round() as u8; 3]
            });
            canvas.set(left + column, top + row, colour);
        }
        for column in 0..=width {
            canvas.set(left + column, top, INK);
            canvas.set(left + column, top + height, INK);
        }
        for row in 0..=height {
            canvas.set(left, top + row, INK);
            canvas.set(left + width, top + row, INK);
        }
    }
}

fn text(canvas: &mut Canvas, at: [usize; 2], text: &str) {
    canvas.text(at, text, SCALE, INK);
}

fn disc(canvas: &mut Canvas, [x, y]: [usize; 2], radius: i32, colour: [u8; 3]) {
    for (dx, dy) in (-radius..=radius).flat_map(|dx| (-radius..=radius).map(move |dy| (dx, dy))) {
        if let (Some(x), Some(y)) = (x.checked_add_signed(dx as isize), y.checked_add_signed(dy as isize))
            && dx * dx + dy * dy <= radius * radius
        {
            canvas.set(x, y, colour);
        }
    }
}

fn ring(canvas: &mut Canvas, at: [usize; 2], radius: f64, colour: [u8; 3]) {
    for step in 0..720 {
        let angle = f64::from(step).to_radians() / 2.0;
        for wide in [0.0, 0.7, 1.4] {
            let (x, y) = ((radius + wide) * angle.cos(), (radius + wide) * angle.sin());
            canvas.set((at[0] as f64 + x).round() as usize, (at[1] as f64 + y).round() as usize, colour);
        }
    }
}

/// One reading, by rule and by way.
fn beams() -> Result<Canvas> {
    let view = View { low_m: [-0.2, -0.65], cells: [60, 26] };
    let rows = [
        (Fusion::Paper, AHEAD, "paper: the same in all directions"),
        (Fusion::Covariance, AHEAD, "covariance, beam along the way driven"),
        (Fusion::Covariance, RIGHT, "covariance, beam across the way driven"),
        (Fusion::FirstEcho, AHEAD, "first_echo, beam along the way driven"),
        (Fusion::FirstEcho, RIGHT, "first_echo, beam across the way driven"),
    ];
    let [width, height] = view.size_px();
    let row_px = LINE_PX + height + 6 + LINE_PX + GAP_PX;
    let head_px = GAP_PX + 4 * LINE_PX;
    let mut canvas = Canvas::new(GAP_PX + WAYS_M.len() * (width + GAP_PX), head_px + rows.len() * row_px + LINE_PX);
    text(&mut canvas, [GAP_PX, GAP_PX], "An echo at 2 m. White: free, black: occupied, bluish: not touched.");
    for (column, name) in WAY_NAMES.into_iter().enumerate() {
        text(&mut canvas, [GAP_PX + column * (width + GAP_PX), GAP_PX + 2 * LINE_PX], name);
    }
    for (row, (fusion, transducer, title)) in rows.into_iter().enumerate() {
        let top = head_px + row * row_px;
        text(&mut canvas, [GAP_PX, top], title);
        for (column, way_m) in WAYS_M.into_iter().enumerate() {
            let (left, top) = (GAP_PX + column * (width + GAP_PX), top + LINE_PX);
            let mut mapper = mapper(fusion)?;
            let estimate = after(way_m, transducer)?;
            hear(&mut mapper, 1, transducer, RANGE_M, &estimate)?;
            view.draw(&mut canvas, [left, top], &mapper);
            let resolution_m = mapper.grid().resolution_m();
            disc(&mut canvas, view.pixel([left, top], [0.0, AXIS_Y_M], resolution_m), 4, MARK);
            for metre in [0.0, 1.0, 2.0] {
                let [x, y] = view.pixel([left, top], [metre, view.low_m[1]], resolution_m);
                (0..6).for_each(|down| canvas.set(x, y + down - 6, AXIS));
                (0..6).for_each(|down| canvas.set(x + 1, y + down - 6, AXIS));
            }
            let Deviations { sigma_z_m, sigma_theta_rad, .. } = deviations(fusion, &estimate, resolution_m);
            let caption = format!("σz {sigma_z_m:.3} m  σθ {:.0}°", sigma_theta_rad.to_degrees());
            text(&mut canvas, [left, top + height + 6], &caption);
        }
    }
    let top = head_px + rows.len() * row_px - GAP_PX + 6;
    text(&mut canvas, [GAP_PX, top], "Red: the sonar. Ticks: 0, 1, 2 m.");
    Ok(canvas)
}

/// What a reading adds to the cells on its axis.
fn profiles() -> Result<Canvas> {
    const PLOT: [usize; 2] = [340, 300];
    const LEFT_PX: usize = 70;
    let rules = [(Fusion::Paper, "paper"), (Fusion::Covariance, "covariance"), (Fusion::FirstEcho, "first_echo")];
    let curves = |fusion: Fusion| -> Result<Vec<Vec<[f64; 2]>>> {
        WAYS_M
            .into_iter()
            .map(|way_m| {
                let mut mapper = mapper(fusion)?;
                hear(&mut mapper, 1, AHEAD, RANGE_M, &after(way_m, AHEAD)?)?;
                let grid = mapper.grid();
                let of = |cell: i32| {
                    let x = (f64::from(cell) + 0.5) * grid.resolution_m();
                    Some([x, f64::from(grid.log_odds(grid.cell_at(x, AXIS_Y_M))?)])
                };
                Ok((0..).map_while(of).collect())
            })
            .collect()
    };
    let all = rules.map(|(fusion, _)| curves(fusion));
    let all = all.into_iter().collect::<Result<Vec<_>>>()?;
    let (mut low, mut high) = (0.0_f64, 0.0_f64);
    for [_, y] in all.iter().flatten().flatten() {
        (low, high) = (low.min(*y), high.max(*y));
    }
    let (low, high) = (low - 0.15, high + 0.15);
    let head_px = GAP_PX + 2 * LINE_PX;
    let mut canvas = Canvas::new(rules.len() * (LEFT_PX + PLOT[0] + GAP_PX), head_px + PLOT[1] + 3 * LINE_PX + GAP_PX);
    text(&mut canvas, [GAP_PX, GAP_PX / 2], "Log-odds that an echo at 2 m adds on the axis; beam along the way");
    for (index, ((_, name), curves)) in rules.into_iter().zip(&all).enumerate() {
        let left = LEFT_PX + index * (LEFT_PX + PLOT[0] + GAP_PX);
        let at = |x: f64, y: f64| {
            let right = left as f64 + x / 3.0 * PLOT[0] as f64;
            [right, head_px as f64 + (high - y) / (high - low) * PLOT[1] as f64]
        };
        text(&mut canvas, [left, head_px - LINE_PX], name);
        for tick in 0..=3 {
            let [x, y] = at(f64::from(tick), low);
            line(&mut canvas, [x, y], [x, head_px as f64], 1, RULE);
            text(&mut canvas, [x as usize - LETTER_PX, y as usize + 6], &tick.to_string());
        }
        for tick in low.ceil() as i32..=high.floor() as i32 {
            let [x, y] = at(0.0, f64::from(tick));
            line(&mut canvas, [x, y], [x + PLOT[0] as f64, y], if tick == 0 { 2 } else { 1 }, RULE);
            text(&mut canvas, [left - 40, y as usize - LETTER_PX], &format!("{tick:2}"));
        }
        for (curve, colour) in curves.iter().zip(CURVES) {
            for pair in curve.windows(2) {
                line(&mut canvas, at(pair[0][0], pair[0][1]), at(pair[1][0], pair[1][1]), 3, colour);
            }
        }
        text(&mut canvas, [left + PLOT[0] - 12 * LETTER_PX * SCALE, head_px + PLOT[1] + 6 + LINE_PX], "distance, m");
    }
    for (index, (name, colour)) in WAY_NAMES.into_iter().zip(CURVES).enumerate() {
        let left = GAP_PX + index * 330;
        let y = (head_px + PLOT[1] + 6 + 2 * LINE_PX + LETTER_PX) as f64;
        line(&mut canvas, [left as f64, y], [left as f64 + 30.0, y], 4, colour);
        text(&mut canvas, [left + 40, y as usize - LETTER_PX], name);
    }
    Ok(canvas)
}

fn line(canvas: &mut Canvas, from: [f64; 2], to: [f64; 2], wide: usize, colour: [u8; 3]) {
    let steps = (to[0] - from[0]).abs().max((to[1] - from[1]).abs()).ceil().max(1.0) as usize;
    for step in 0..=steps {
        let share = step as f64 / steps as f64;
        let [x, y] = [0, 1].map(|axis| (from[axis] + share * (to[axis] - from[axis])).max(0.0) as usize);
        for (dx, dy) in (0..wide).flat_map(|dx| (0..wide).map(move |dy| (dx, dy))) {
            canvas.set(x + dx, y + dy, colour);
        }
    }
}

/// A post that is heard from one side, from another, and from many places on both.
fn second() -> Result<Canvas> {
    const POST_M: [f64; 2] = [1.8, 0.325];
    let view = View { low_m: [-0.2, -1.45], cells: [56, 45] };
    let [width, height] = view.size_px();
    let from_below = |x: f64| Pose2::new(x, -1.3, core::f64::consts::PI);
    let one = vec![(AHEAD, Pose2::new(0.0, AXIS_Y_M, 0.0))];
    let two = [one.clone(), vec![(RIGHT, from_below(1.7))]].concat();
    let past = (-6..=6).flat_map(|n| {
        let off = 0.06 * f64::from(n);
        [(RIGHT, from_below(POST_M[0] - off)), (AHEAD, Pose2::new(0.0, POST_M[1] + off, 0.0))]
    });
    let many: Vec<_> = two.iter().copied().chain(past).collect();
    let columns = [("an echo", one), ("a second from below", two), ("13 more of each", many)];
    let rows = [(Fusion::Paper, "paper"), (Fusion::FirstEcho, "first_echo")];
    let row_px = LINE_PX + height + GAP_PX;
    let head_px = GAP_PX + LINE_PX + GAP_PX / 2;
    let mut canvas = Canvas::new(GAP_PX + columns.len() * (width + GAP_PX), head_px + rows.len() * row_px);
    let title = "A post (in the green ring), pose known. Red: where the sonar was.";
    text(&mut canvas, [GAP_PX, GAP_PX / 2], title);
    for (row, (fusion, rule)) in rows.into_iter().enumerate() {
        for (column, (name, readings)) in columns.iter().enumerate() {
            let (left, top) = (GAP_PX + column * (width + GAP_PX), head_px + row * row_px);
            text(&mut canvas, [left, top], &if column == 0 { format!("{rule}: {name}") } else { (*name).to_owned() });
            let top = top + LINE_PX;
            let mut mapper = mapper(fusion)?;
            for (sequence, (transducer, map_from_base)) in (1..).zip(readings) {
                let post = Pose2::new(POST_M[0], POST_M[1], 0.0);
                hear(
                    &mut mapper,
                    sequence,
                    *transducer,
                    map_from_base.distance_m(post),
                    &Estimate::certain(*map_from_base),
                )?;
            }
            view.draw(&mut canvas, [left, top], &mapper);
            let resolution_m = mapper.grid().resolution_m();
            for (_, map_from_base) in readings {
                let [x, y] = view.pixel([left, top], [map_from_base.x, map_from_base.y], resolution_m);
                disc(&mut canvas, [x, y], 4, MARK);
            }
            ring(&mut canvas, view.pixel([left, top], POST_M, resolution_m), 14.0, [0, 140, 60]);
        }
    }
    Ok(canvas)
}
