//! What stands below a picture of a map: a scale bar, the axes, and what the colours mean.

use super::picture::{PATH, ROBOT, UNKNOWN};
use crate::canvas::{Canvas, INK, LETTER_PX, PAPER};

/// Between things, pixels.
const GAP_PX: usize = 12;
/// From line to line, pixels.
const LINE_PX: usize = 20;
/// The narrowest picture that a legend fits below, pixels.
const WIDTH_MIN_PX: usize = 200;
/// Side of a patch of colour, pixels.
const PATCH_PX: usize = 10;

/// A picture of a map, `pixels` of three bytes, with a legend below it.
pub(super) fn below(pixels: &[u8], width: usize, height: usize, pixels_per_m: f64, has_path: bool) -> Canvas {
    let across = width.max(WIDTH_MIN_PX);
    let mut patches = vec![("free", PAPER), ("occupied", [0; 3]), ("undecided", [128; 3]), ("unknown", UNKNOWN)];
    patches.extend(has_path.then_some(("path", PATH)));
    patches.push(("robot", ROBOT));
    let (bar_m, bar_px) = bar(pixels_per_m, across);
    let label = label(bar_m);
    let bar_end = GAP_PX + bar_px + GAP_PX / 2 + label.len() * LETTER_PX;
    let axes_fit = bar_end + 5 * GAP_PX < across;
    // Where each patch goes: as many as fit in a line.
    let (mut left, mut line) = (GAP_PX, 1);
    let mut places = Vec::new();
    for (word, _) in &patches {
        let patch_px = PATCH_PX + GAP_PX / 2 + word.len() * LETTER_PX;
        if left + patch_px + GAP_PX > across && left > GAP_PX {
            (left, line) = (GAP_PX, line + 1);
        }
        places.push([left, line]);
        left += patch_px + GAP_PX;
    }
    let mut canvas = Canvas::new(across, height + GAP_PX + (line + 1) * LINE_PX);
    for (index, pixel) in pixels.chunks_exact(3).enumerate() {
        canvas.set(index % width.max(1), index / width.max(1), [pixel[0], pixel[1], pixel[2]]);
    }
    let top = height + GAP_PX;
    for x in GAP_PX..=GAP_PX + bar_px {
        let is_end = x < GAP_PX + 2 || x + 2 > GAP_PX + bar_px;
        let rows = if is_end { top..top + 9 } else { top + 3..top + 6 };
        rows.for_each(|y| canvas.set(x, y, INK));
    }
    canvas.text([GAP_PX + bar_px + GAP_PX / 2, top], &label, 1, INK);
    if axes_fit {
        axes(&mut canvas, [across - 4 * GAP_PX, top]);
    }
    for ((word, colour), [left, line]) in patches.into_iter().zip(places) {
        let top = top + line * LINE_PX;
        for (x, y) in (0..PATCH_PX).flat_map(|x| (0..PATCH_PX).map(move |y| (x, y))) {
            let is_edge = [0, PATCH_PX - 1].contains(&x) || [0, PATCH_PX - 1].contains(&y);
            canvas.set(left + x, top + y, if is_edge { INK } else { colour });
        }
        canvas.text([left + PATCH_PX + GAP_PX / 2, top + 1], word, 1, INK);
    }
    canvas
}

/// x to the right, y up.
fn axes(canvas: &mut Canvas, [left, top]: [usize; 2]) {
    for step in 0..14 {
        canvas.set(left + step, top + 12, INK);
        canvas.set(left, top + 12 - step.min(12), INK);
    }
    for step in 0..3 {
        canvas.set(left + 13 - step, top + 12 - step, INK);
        canvas.set(left + 13 - step, top + 12 + step, INK);
        canvas.set(left + step, top + step, INK);
        canvas.set(left.saturating_sub(step), top + step, INK);
    }
    canvas.text([left + 16, top + 8], "x", 1, INK);
    canvas.text([left + 5, top], "y", 1, INK);
}

/// 1, 2 or 5 times a power of ten, metres, and so many pixels: the longest that takes no more than a third of the width.
fn bar(pixels_per_m: f64, across: usize) -> (f64, usize) {
    let most_px = across as f64 / 3.0;
    let lengths = (-3..9).flat_map(|power| [1.0, 2.0, 5.0].map(|digit| digit * 10_f64.powi(power)));
    let fits = lengths.take_while(|metres| metres * pixels_per_m <= most_px).last().unwrap_or(1e-3);
    (fits, (fits * pixels_per_m).round().clamp(1.0, most_px.max(1.0)) as usize)
}

fn label(metres: f64) -> String {
    if metres >= 1000.0 {
        format!("{} km", metres / 1000.0)
    } else if metres >= 1.0 {
        format!("{metres} m")
    } else {
        format!("{:.0} cm", metres * 100.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_have_round_lengths_and_fit() {
        let check = |pixels_per_m: f64, across: usize, metres: f64, text: &str| {
            let (bar_m, bar_px) = bar(pixels_per_m, across);
            assert!((bar_m - metres).abs() < 1e-9 * metres, "{bar_m}");
            assert!((bar_px as f64 - metres * pixels_per_m).abs() <= 0.5 && bar_px * 3 <= across + 3);
            assert_eq!(label(bar_m), text);
        };
        check(20.0, 800, 10.0, "10 m");
        check(60.0, 900, 5.0, "5 m");
        check(1000.0, 900, 0.2, "20 cm");
        check(0.05, 800, 5000.0, "5 km");
    }

    #[test]
    fn the_map_stays_as_it_is_and_all_words_fit() {
        for (width, height) in [(1, 1), (30, 800), (800, 10)] {
            let pixels = [7, 8, 9].repeat(width * height);
            let canvas = below(&pixels, width, height, 20.0, true);
            assert!(canvas.width >= width && canvas.height > height);
            let png = canvas.encode().unwrap();
            let picture = image::load_from_memory(&png).unwrap().to_rgb8();
            assert_eq!(picture.get_pixel(width as u32 - 1, height as u32 - 1).0, [7, 8, 9]);
            assert!(picture.pixels().any(|pixel| pixel.0 == ROBOT), "its patch is there");
        }
    }
}
