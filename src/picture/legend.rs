//! The color bar: what the colors stand for, between which values, in which unit.

use super::letters::{self, Align, Ink};
use super::{Background, Paint, Picture, color};

/// Height of the picture for which the sizes below are.
const HEIGHT: f32 = 600.0;
/// Place of the bar from the left and from the bottom, and its size, in pixels of such a picture.
const LEFT: f32 = 20.0;
const BOTTOM: f32 = 40.0;
const SIZE: [f32; 2] = [220.0, 9.0];
/// Height of a line of the title, and of the numbers.
const TITLE: f32 = 17.0;
const NUMBERS: f32 = 14.0;

/// What stands beside the colors.
#[derive(Debug, Clone, Copy)]
pub struct Legend<'a> {
    /// What is shown.
    pub title: &'a str,
    /// Its unit; empty for none.
    pub unit: &'a str,
}

/// The title of a basis: its index, and its eigenvalue λ in 1/length² where it has one.
#[must_use]
pub fn legend_of_basis(index: usize, eigenvalue: Option<f64>) -> String {
    match eigenvalue {
        Some(eigenvalue) => format!("basis {index}, λ = {}", number(eigenvalue)),
        None => format!("basis {index}"),
    }
}

impl Picture {
    /// Lays the bar of a paint's colors over the lower left corner; nothing where the colors stand for no numbers.
    pub fn add_legend(&mut self, legend: &Legend<'_>, paint: &Paint<'_>, background: Background) {
        let Some(scale) = paint.scale() else { return };
        let unit = (self.height as f32 / HEIGHT).clamp(0.6, 3.0);
        let ink = if background == Background::Black { [235; 3] } else { [32; 3] };
        let width = (SIZE[0] * unit).min(self.width as f32 - 2.0 * LEFT * unit).max(2.0);
        let (left, top) = (LEFT * unit, self.height as f32 - BOTTOM * unit);
        for column in 0..width as usize {
            let share = (column as f32 + 0.5) / width;
            let color = color::srgb(scale.map.at(f64::from(share)));
            for row in 0..(SIZE[1] * unit) as usize {
                self.cover(left as usize + column, top.max(0.0) as usize + row, color, 1.0);
            }
        }
        let title = if legend.unit.is_empty() {
            legend.title.to_owned()
        } else {
            format!("{} ({})", legend.title, legend.unit)
        };
        let line = Ink { size: TITLE * unit, color: ink };
        letters::write(self, &title, [left, top - 7.0 * unit], Align::Left, line);
        let line = Ink { size: NUMBERS * unit, color: ink };
        let middle = 0.5 * (scale.low + scale.high);
        for (align, share, value) in
            [(Align::Left, 0.0, scale.low), (Align::Middle, 0.5, middle), (Align::Right, 1.0, scale.high)]
        {
            let place = [left + share * width, top + (SIZE[1] + 14.0) * unit];
            letters::write(self, &number(value), place, align, line);
        }
        if scale.is_gappy {
            self.add_absent(left + width + 18.0 * unit, top, unit, line);
        }
    }

    /// A dot in the color of rows without a value, and what it means.
    fn add_absent(&mut self, left: f32, top: f32, unit: f32, ink: Ink) {
        let (radius, color) = (0.5 * SIZE[1] * unit, color::srgb(color::ABSENT));
        for row in 0..(SIZE[1] * unit) as usize {
            for column in 0..(SIZE[1] * unit) as usize {
                let away = f32::hypot(column as f32 + 0.5 - radius, row as f32 + 0.5 - radius);
                self.cover(
                    left as usize + column,
                    top as usize + row,
                    color,
                    (radius - away + 0.5).clamp(0.0, 1.0),
                );
            }
        }
        letters::write(
            self,
            "no value",
            [left + (SIZE[1] + 5.0) * unit, top + SIZE[1] * unit],
            Align::Left,
            ink,
        );
    }
}

/// Three significant digits; powers of ten for the very large and small.
fn number(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 {
        return "0".to_owned();
    }
    let text = if (1e-3..1e6).contains(&size) {
        let decimals = (2 - size.log10().floor() as i32).max(0) as usize;
        let text = format!("{value:.decimals$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    } else {
        format!("{value:.2e}")
    };
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn blank() -> Picture {
        Picture { width: 400, height: 300, pixels: vec![255; 400 * 300 * 4] }
    }

    fn changed(picture: &Picture, rows: std::ops::Range<usize>) -> usize {
        rows.flat_map(|row| (0..400).map(move |column| (row, column)))
            .filter(|(row, column)| picture.pixels[4 * (row * 400 + column)] != 255)
            .count()
    }

    #[test]
    fn the_bar_has_the_colors_of_the_map_with_title_above_and_numbers_below() {
        let mut picture = blank();
        let values = [-2.0, 2.0];
        let legend = Legend { title: "basis 4", unit: "1/length" };
        picture.add_legend(&legend, &Paint::Diverging(&values), Background::White);
        // Sizes are 0.6 times those of a picture of 600 rows: the bar begins 12 pixels from the left, 24 from the bottom.
        let pixel = |column: usize| {
            let at = 4 * (278 * 400 + column);
            [0, 1, 2].map(|i| picture.pixels[at + i])
        };
        let map = super::super::Map::diverging();
        assert_eq!(pixel(12), color::srgb(map.at(0.5 / 132.0)));
        assert_eq!(pixel(12 + 131), color::srgb(map.at(131.5 / 132.0)));
        assert!(changed(&picture, 255..274) > 50, "the title");
        assert!(changed(&picture, 284..300) > 30, "the numbers");
        assert_eq!(changed(&picture, 0..240), 0);
    }

    #[test]
    fn a_picture_without_numbers_has_none_and_one_with_gaps_says_so() {
        let mut picture = blank();
        picture.add_legend(&Legend { title: "x", unit: "" }, &Paint::Plain, Background::White);
        assert_eq!(changed(&picture, 0..300), 0);
        let right = |values: &[f64]| {
            let mut picture = blank();
            picture.add_legend(
                &Legend { title: "x", unit: "" },
                &Paint::Sequential(values),
                Background::White,
            );
            (150..250).filter(|column| picture.pixels[4 * (278 * 400 + column)] != 255).count()
        };
        assert_eq!(right(&[1.0, 2.0]), 0);
        assert!(right(&[1.0, f64::NAN, 2.0]) > 3);
    }

    #[test]
    fn numbers_have_three_digits() {
        let shown = [0.0, 1.0, -0.012_345, 1234.4, 99.96, 1e-7, 2.5e9].map(number);
        assert_eq!(shown, ["0", "1", "−0.0123", "1234", "100", "1.00e−7", "2.50e9"]);
    }
}
