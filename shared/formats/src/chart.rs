//! A chart of errors: panels side by side, each with points, a line through the origin, and a band around it.

use std::path::Path;

use image::ImageError;

use crate::canvas::{Canvas, INK, LETTER_PX};
use crate::whole_file::{WriteError, write_whole};

const POINT: [u8; 3] = [40, 90, 170];
const LINE: [u8; 3] = [210, 60, 50];
const BAND: [u8; 3] = [250, 226, 214];
const RULE: [u8; 3] = [214, 214, 214];

const PLOT_WIDTH_PX: usize = 440;
const PLOT_HEIGHT_PX: usize = 340;
/// Left of a plot: the numbers of its vertical axis.
const LEFT_PX: usize = 92;
/// Above it: its title, and what its vertical axis is.
const ABOVE_PX: usize = 60;
/// Below it: the numbers of the horizontal axis, and what it is.
const BELOW_PX: usize = 62;
const RIGHT_PX: usize = 28;
/// Letters are so many times as large as the font's.
const SCALE: usize = 2;
const LINE_PX: usize = 24;
/// About so many marks to an axis.
const MARKS: f64 = 6.0;

/// One panel of a chart.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// What stands above it.
    pub title: String,
    /// What the horizontal axis is, with its unit.
    pub x: String,
    /// What the vertical axis is, with its unit.
    pub y: String,
    /// The points, x and y each.
    pub points: Vec<[f64; 2]>,
    /// The line is y = slope x.
    pub slope: f64,
    /// The band is within ± band √|x| of the line.
    pub band: f64,
}

/// Why there is no chart.
#[derive(Debug, thiserror::Error)]
pub enum ChartError {
    /// A number is not finite, or nothing is to be drawn.
    #[error("nothing that could be drawn: expected finite points")]
    Nothing,
    /// It could not be made a PNG.
    #[error("the chart can't be encoded: {0}")]
    Encode(#[from] ImageError),
    /// It could not be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

/// The panels as a PNG file's bytes. The same panels give the same bytes.
///
/// # Errors
/// When a panel has no point or a number that is not finite.
pub fn encode(panels: &[Panel]) -> Result<Vec<u8>, ChartError> {
    let panel_px = LEFT_PX + PLOT_WIDTH_PX + RIGHT_PX;
    let mut canvas = Canvas::new(panels.len() * panel_px, ABOVE_PX + PLOT_HEIGHT_PX + BELOW_PX);
    for (index, panel) in panels.iter().enumerate() {
        let plot = Plot::of(panel, index * panel_px + LEFT_PX).ok_or(ChartError::Nothing)?;
        plot.draw(&mut canvas, panel);
    }
    if panels.is_empty() { Err(ChartError::Nothing) } else { Ok(canvas.encode()?) }
}

/// Writes [`encode`] to a file, whole or not at all.
///
/// # Errors
/// When the chart can't be encoded or written.
pub fn write(file: &Path, panels: &[Panel]) -> Result<(), ChartError> {
    Ok(write_whole(file, &encode(panels)?)?)
}

/// What a panel shows of the plane.
struct Plot {
    /// Of the canvas, pixels.
    left: usize,
    low: [f64; 2],
    high: [f64; 2],
}

impl Plot {
    /// All points, the origin, and the band as far as the points go.
    fn of(panel: &Panel, left: usize) -> Option<Self> {
        let (mut low, mut high) = ([0.0_f64; 2], [0.0_f64; 2]);
        let ends = panel.points.iter().flat_map(|[x, y]| {
            let (line, band) = (panel.slope * x, panel.band * x.abs().sqrt());
            [[*x, *y], [*x, line + band], [*x, line - band]]
        });
        for point in ends {
            for axis in 0..2 {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
            }
        }
        for axis in 0..2 {
            let margin = 0.06 * (high[axis] - low[axis]);
            low[axis] -= margin;
            high[axis] += margin;
            // A straight line of points has a height, too.
            if high[axis] - low[axis] < 1e-9 {
                (low[axis], high[axis]) = (low[axis] - 1e-3, high[axis] + 1e-3);
            }
        }
        let finite = panel.points.iter().flatten().all(|value| value.is_finite());
        let fits = low.iter().chain(&high).all(|value| value.abs() < 1e12);
        (!panel.points.is_empty() && finite && fits && panel.slope.is_finite() && panel.band.is_finite())
            .then_some(Self { left, low, high })
    }

    fn column(&self, x: f64) -> f64 {
        self.left as f64 + (x - self.low[0]) / (self.high[0] - self.low[0]) * PLOT_WIDTH_PX as f64
    }

    fn row(&self, y: f64) -> f64 {
        ABOVE_PX as f64 + (self.high[1] - y) / (self.high[1] - self.low[1]) * PLOT_HEIGHT_PX as f64
    }

    /// A pixel within the frame.
    fn set(&self, canvas: &mut Canvas, column: f64, row: f64, colour: [u8; 3]) {
        let right = (self.left + PLOT_WIDTH_PX) as f64;
        let bottom = (ABOVE_PX + PLOT_HEIGHT_PX) as f64;
        if (self.left as f64..=right).contains(&column) && (ABOVE_PX as f64..=bottom).contains(&row) {
            canvas.set(column as usize, row as usize, colour);
        }
    }

    fn draw(&self, canvas: &mut Canvas, panel: &Panel) {
        self.draw_band(canvas, panel);
        self.draw_axes(canvas, panel);
        self.draw_line(canvas, panel);
        for [x, y] in &panel.points {
            for (dx, dy) in (-2..=2).flat_map(|dx| (-2..=2).map(move |dy| (f64::from(dx), f64::from(dy)))) {
                if dx.abs() + dy.abs() < 3.0 {
                    self.set(canvas, self.column(*x) + dx, self.row(*y) + dy, POINT);
                }
            }
        }
    }

    /// The x of each column of pixels.
    fn columns(&self) -> impl Iterator<Item = (f64, f64)> + use<> {
        let (left, low, span) = (self.left as f64, self.low[0], self.high[0] - self.low[0]);
        (0..=PLOT_WIDTH_PX).map(move |px| (left + px as f64, low + span * px as f64 / PLOT_WIDTH_PX as f64))
    }

    fn draw_band(&self, canvas: &mut Canvas, panel: &Panel) {
        for (column, x) in self.columns() {
            let (line, band) = (panel.slope * x, panel.band * x.abs().sqrt());
            let first = self.row(line + band).max(ABOVE_PX as f64).floor() as usize;
            let last = self.row(line - band).min((ABOVE_PX + PLOT_HEIGHT_PX) as f64).ceil() as usize;
            for row in first..=last {
                self.set(canvas, column, row as f64, BAND);
            }
        }
    }

    fn draw_line(&self, canvas: &mut Canvas, panel: &Panel) {
        let mut before: Option<f64> = None;
        for (column, x) in self.columns() {
            let row = self.row(panel.slope * x);
            // Without holes where it is steep.
            let (first, last) = before.map_or((row, row), |before| (row.min(before), row.max(before)));
            let steps = ((last - first) as usize).min(PLOT_HEIGHT_PX);
            for step in 0..=steps {
                self.set(canvas, column, first + step as f64, LINE);
                self.set(canvas, column, first + step as f64 + 1.0, LINE);
            }
            before = Some(row);
        }
    }

    fn draw_axes(&self, canvas: &mut Canvas, panel: &Panel) {
        let letter = LETTER_PX * SCALE;
        let bottom = ABOVE_PX + PLOT_HEIGHT_PX;
        for (x, label) in marks(self.low[0], self.high[0]) {
            let column = self.column(x);
            for row in ABOVE_PX..bottom {
                self.set(canvas, column, row as f64, RULE);
            }
            let left = (column as usize).saturating_sub(label.chars().count() * letter / 2);
            canvas.text([left, bottom + 10], &label, SCALE, INK);
        }
        for (y, label) in marks(self.low[1], self.high[1]) {
            let row = self.row(y);
            for column in self.left..self.left + PLOT_WIDTH_PX {
                self.set(canvas, column as f64, row, RULE);
            }
            let left = self.left.saturating_sub(label.chars().count() * letter + 6);
            canvas.text([left, (row as usize).saturating_sub(letter / 2)], &label, SCALE, INK);
        }
        for column in self.left..=self.left + PLOT_WIDTH_PX {
            canvas.set(column, ABOVE_PX, INK);
            canvas.set(column, bottom, INK);
        }
        for row in ABOVE_PX..=bottom {
            canvas.set(self.left, row, INK);
            canvas.set(self.left + PLOT_WIDTH_PX, row, INK);
        }
        // Above the numbers, too: titles are long.
        let left = self.left - LEFT_PX / 2;
        canvas.text([left, 8], &panel.title, SCALE, INK);
        canvas.text([left, 8 + LINE_PX], &panel.y, SCALE, INK);
        let width = panel.x.chars().count() * letter;
        canvas.text([(self.left + PLOT_WIDTH_PX).saturating_sub(width), bottom + 10 + LINE_PX], &panel.x, SCALE, INK);
    }
}

/// Round numbers within an axis, as they are written.
fn marks(low: f64, high: f64) -> Vec<(f64, String)> {
    let rough = (high - low) / MARKS;
    let exponent = rough.log10().floor();
    let power = 10_f64.powf(exponent);
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|digit| digit * power).find(|step| *step >= rough);
    let step = step.unwrap_or(10.0 * power);
    let digits = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    let (first, last) = ((low / step).ceil() as i64, (high / step).floor() as i64);
    let mark = |count: i64| {
        let value = count as f64 * step;
        (value, format!("{value:.digits$}"))
    };
    (first..=last).take(20).map(mark).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn panel(points: Vec<[f64; 2]>) -> Panel {
        let name = |name: &str| name.to_owned();
        Panel { title: name("translations"), x: name("Δl, m"), y: name("error, m"), points, slope: 0.1, band: 0.02 }
    }

    #[test]
    fn points_line_and_band_are_where_they_belong() {
        let panels = [panel(vec![[1.0, 0.13], [4.0, 0.38]]), panel(vec![[-2.0, -0.2], [2.0, 0.21]])];
        let png = encode(&panels).unwrap();
        assert_eq!(png, encode(&panels).unwrap());
        let picture = image::load_from_memory(&png).unwrap().to_rgb8();
        assert_eq!(picture.dimensions(), (2 * 560, 462));
        for (index, panel) in panels.iter().enumerate() {
            let plot = Plot::of(panel, index * 560 + LEFT_PX).unwrap();
            let at = |x: f64, y: f64| picture.get_pixel(plot.column(x) as u32, plot.row(y) as u32).0;
            assert!(panel.points.iter().all(|[x, y]| at(*x, *y) == POINT));
            assert_eq!((at(1.7, 0.17 + 0.02), at(1.7, 0.05)), (BAND, [255; 3]));
            let (column, row) = (plot.column(1.7) as u32, plot.row(0.17) as u32);
            assert!((row - 1..=row + 1).any(|row| picture.get_pixel(column, row).0 == LINE));
        }
        // What an axis is must be readable: no letter is missing from the fonts.
        let inked = |text: &str| {
            let mut canvas = Canvas::new(16, 16);
            canvas.text([0, 0], text, 1, INK);
            let png = canvas.encode().unwrap();
            image::load_from_memory(&png).unwrap().to_rgb8().pixels().any(|pixel| pixel.0 == INK)
        };
        assert!(["Δ", "θ", "σ", "±"].into_iter().all(inked));
    }

    #[test]
    fn marks_are_round_and_within() {
        let texts = |low, high| marks(low, high).into_iter().map(|(_, text)| text).collect::<Vec<_>>();
        assert_eq!(texts(-0.1, 5.2), ["0", "1", "2", "3", "4", "5"]);
        assert_eq!(texts(-0.02, 0.03), ["-0.02", "-0.01", "0.00", "0.01", "0.02", "0.03"]);
        assert_eq!(texts(-2.0, 2.0), ["-2", "-1", "0", "1", "2"]);
    }

    #[test]
    fn what_can_not_be_drawn_is_refused() {
        assert!(matches!(encode(&[]), Err(ChartError::Nothing)));
        for points in [vec![], vec![[f64::NAN, 0.0]], vec![[1e300, 0.0]]] {
            assert!(matches!(encode(&[panel(points)]), Err(ChartError::Nothing)));
        }
        assert!(encode(&[panel(vec![[0.0, 0.0]])]).is_ok());
        let flat = Panel { slope: 0.0, band: 0.0, ..panel(vec![[1.0, 0.0]]) };
        assert!(encode(&[flat]).is_ok());
    }
}
