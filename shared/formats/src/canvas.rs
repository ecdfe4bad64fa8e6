//! A picture in the making: pixels and letters. Row 0 is on top.

use font8x8::UnicodeFonts as _;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _, ImageError};

/// White: red, green, blue.
pub const PAPER: [u8; 3] = [255, 255, 255];
/// What letters are written in.
pub const INK: [u8; 3] = [30, 30, 30];
/// Width and height of a letter, pixels.
pub const LETTER_PX: usize = 8;

/// Pixels, and how many there are.
#[derive(Debug, Clone)]
pub struct Canvas {
    /// The number of pixels across.
    pub width: usize,
    /// The number of pixels down.
    pub height: usize,
    pixels: Vec<u8>,
}

impl Canvas {
    /// A canvas on which nothing is drawn: all of it is paper.
    #[must_use]
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, pixels: PAPER.repeat(width * height) }
    }

    /// Colours a pixel. What lies outside is left out.
    pub fn set(&mut self, x: usize, y: usize, colour: [u8; 3]) {
        if x < self.width
            && let Some(pixel) = self.pixels.get_mut((y * self.width + x) * 3..(y * self.width + x) * 3 + 3)
        {
            pixel.copy_from_slice(&colour);
        }
    }

    /// Lines of text, one below the other.
    pub fn lines(&mut self, [left, top]: [usize; 2], lines: &[String], line_px: usize) {
        for (index, line) in lines.iter().enumerate() {
            self.text([left, top + index * line_px], line, 1, INK);
        }
    }

    /// One line of letters that are `scale` times as large.
    pub fn text(&mut self, [left, top]: [usize; 2], text: &str, scale: usize, colour: [u8; 3]) {
        for (letter, x) in text.chars().zip((left..).step_by(LETTER_PX * scale)) {
            let fonts = font8x8::BASIC_FONTS.get(letter).or_else(|| font8x8::LATIN_FONTS.get(letter));
            let bits = fonts.or_else(|| font8x8::GREEK_FONTS.get(letter)).unwrap_or_default();
            for row in 0..LETTER_PX * scale {
                for column in (0..LETTER_PX * scale).filter(|column| bits[row / scale] >> (column / scale) & 1 == 1) {
                    self.set(x + column, top + row, colour);
                }
            }
        }
    }

    /// The picture as the bytes of a PNG file; the same pixels give the same bytes.
    ///
    /// # Errors
    /// When there is no pixel.
    pub fn encode(&self) -> Result<Vec<u8>, ImageError> {
        let side = |pixels: usize| u32::try_from(pixels).unwrap_or(u32::MAX);
        let mut png = Vec::new();
        // Few colours that repeat: no filter helps, a thorough search does.
        PngEncoder::new_with_quality(&mut png, CompressionType::Best, FilterType::NoFilter).write_image(
            &self.pixels,
            side(self.width),
            side(self.height),
            ExtendedColorType::Rgb8,
        )?;
        Ok(png)
    }
}
