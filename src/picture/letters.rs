//! Text in pictures, in one typeface that comes with the service.

use std::sync::LazyLock;

use ab_glyph::{Font as _, FontRef, ScaleFont as _, point};

use super::Picture;

/// `DejaVu Sans`, cut down to Latin and Greek letters and the signs of formulas; its license stands beside it.
static FONT: LazyLock<Option<FontRef<'static>>> =
    LazyLock::new(|| FontRef::try_from_slice(include_bytes!("letters.ttf")).ok());

/// Where a text stands beside its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Align {
    Left,
    Middle,
    Right,
}

/// Size and color of a text.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ink {
    /// Height of a line in pixels.
    pub(super) size: f32,
    /// sRGB.
    pub(super) color: [u8; 3],
}

/// Pixels from the beginning of a text to its end.
pub(super) fn width(text: &str, size: f32) -> f32 {
    let Some(font) = FONT.as_ref() else { return 0.0 };
    let font = font.as_scaled(size);
    text.chars().map(|letter| font.h_advance(font.glyph_id(letter))).sum()
}

/// Writes a line of text whose baseline begins, has its middle, or ends at `[x, y]` in pixels from the top left.
pub(super) fn write(picture: &mut Picture, text: &str, [x, y]: [f32; 2], align: Align, ink: Ink) {
    let Some(font) = FONT.as_ref() else { return };
    let scaled = font.as_scaled(ink.size);
    let share = match align {
        Align::Left => 0.0,
        Align::Middle => 0.5,
        Align::Right => 1.0,
    };
    let mut x = x - share * width(text, ink.size);
    for letter in text.chars() {
        let glyph = scaled.glyph_id(letter);
        if let Some(outline) = font.outline_glyph(glyph.with_scale_and_position(ink.size, point(x, y))) {
            let corner = outline.px_bounds().min;
            outline.draw(|right, down, covered| {
                let (column, row) = (corner.x + right as f32, corner.y + down as f32);
                if column >= 0.0 && row >= 0.0 {
                    picture.cover(column as usize, row as usize, ink.color, covered.min(1.0));
                }
            });
        }
        x += scaled.h_advance(glyph);
    }
}

impl Picture {
    /// Lays a color over a pixel, which it covers by a share; nothing outside of the picture.
    pub(super) fn cover(&mut self, column: usize, row: usize, color: [u8; 3], covered: f32) {
        if column >= self.width || row >= self.height {
            return;
        }
        let pixel = &mut self.pixels[4 * (row * self.width + column)..][..4];
        let under = f32::from(pixel[3]) / 255.0 * (1.0 - covered);
        let opacity = covered + under;
        if opacity <= 0.0 {
            return;
        }
        for (channel, over) in pixel.iter_mut().zip(color) {
            *channel = ((f32::from(over) * covered + f32::from(*channel) * under) / opacity).round() as u8;
        }
        pixel[3] = (255.0 * opacity).round() as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn white() -> Picture {
        Picture { width: 60, height: 20, pixels: vec![255; 60 * 20 * 4] }
    }

    fn dark(picture: &Picture, columns: std::ops::Range<usize>) -> usize {
        let is_dark = |at: usize| picture.pixels[4 * at] < 128;
        (0..60 * 20).filter(|at| columns.contains(&(at % 60)) && is_dark(*at)).count()
    }

    #[test]
    fn text_stands_beside_its_place() {
        let ink = Ink { size: 14.0, color: [0; 3] };
        for (align, left, right) in
            [(Align::Left, false, true), (Align::Right, true, false), (Align::Middle, true, true)]
        {
            let mut picture = white();
            write(&mut picture, "MM", [30.0, 15.0], align, ink);
            assert_eq!((dark(&picture, 0..30) > 10, dark(&picture, 30..60) > 10), (left, right), "{align:?}");
        }
    }

    #[test]
    fn every_letter_of_titles_and_units_has_a_form() {
        let font = FONT.as_ref().unwrap();
        for letter in "basis 12, λ = −1.5e−3 (1/length²) √· äöü…".chars() {
            assert_ne!(font.glyph_id(letter).0, 0, "{letter}");
        }
    }

    #[test]
    fn what_reaches_beyond_the_picture_is_cut() {
        let mut picture = white();
        write(&mut picture, "wide and tall", [-20.0, 2.0], Align::Left, Ink { size: 40.0, color: [0; 3] });
        assert_eq!(picture.pixels.len(), 60 * 20 * 4);
    }
}
