//! Points and triangles become pixels, the nearest of which is seen.
//!
//! Written here: crates that fill shapes on a processor have no depth, or no discs, and bands of rows give the same bits for
//! any number of threads.

use rayon::prelude::*;

use super::color::{self, Rgb};
use super::{Background, Picture};

/// Rows of pixels that one thread fills.
pub(super) const BAND: usize = 64;
/// What a pixel that nothing covers has for its depth.
pub(super) const EMPTY: f32 = f32::NEG_INFINITY;

/// Grains by which a steep surface rises before a point on it.
const STEEP: f32 = 4.0;
/// Radius in pixels from which a mark has a rim.
const RIMMED: f32 = 6.0;

/// A disc that faces the viewer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Splat {
    /// Place in pixels from the top left, and nearness in pixels.
    pub(super) at: [f32; 3],
    /// In pixels.
    pub(super) radius: f32,
    pub(super) color: Rgb,
}

/// What a pixel shows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pixel {
    /// Nearness in pixels; [`EMPTY`] where nothing is seen.
    pub(super) depth: f32,
    /// Distance in pixels to what the same surface consists of: the radius of the point, or the side of the triangle.
    pub(super) grain: f32,
    /// Share of the light that the surface faces; NaN if derived from neighboring depths.
    pub(super) facing: f32,
    pub(super) color: Rgb,
}

const NOTHING: Pixel = Pixel { depth: EMPTY, grain: 1.0, facing: f32::NAN, color: [0.0; 3] };

/// Every pixel, row by row from the top.
pub(super) struct Raster {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) pixels: Vec<Pixel>,
}

impl Raster {
    pub(super) fn new(width: usize, height: usize) -> Self {
        Self { width, height, pixels: vec![NOTHING; width * height] }
    }

    /// Draws discs. Between discs at about the same depth a pixel belongs to the one whose center is nearest: towards
    /// its rim a disc recedes by its radius.
    pub(super) fn splat(&mut self, splats: &[Splat]) {
        let width = self.width;
        self.in_bands(
            splats,
            |splat| [splat.at[1] - splat.radius, splat.at[1] + splat.radius],
            |rows, band, splats| {
                let mut nearest: Vec<f32> = band.iter().map(|pixel| pixel.depth).collect();
                for &Splat { at: [x, y, z], radius, color } in splats {
                    disc([x, y], radius, width, rows.clone(), |pixel, squared| {
                        let pixel = pixel - rows.start * width;
                        let receding = z - squared / radius;
                        if receding > nearest[pixel] {
                            nearest[pixel] = receding;
                            band[pixel] = Pixel { depth: z, grain: radius, facing: f32::NAN, color };
                        }
                    });
                }
            },
        );
    }

    /// Fills the picture band by band of rows, with the shapes that reach into each: `reach` tells from which row to
    /// which a shape does, `fill` draws them into the pixels of some rows.
    pub(super) fn in_bands<S: Copy + Sync>(
        &mut self,
        shapes: &[S],
        reach: impl Fn(&S) -> [f32; 2],
        fill: impl Fn(std::ops::Range<usize>, &mut [Pixel], &mut dyn Iterator<Item = &S>) + Sync,
    ) {
        let (width, height) = (self.width, self.height);
        let bands = height.div_ceil(BAND);
        let mut of_band: Vec<Vec<u32>> = vec![Vec::new(); bands];
        for (index, shape) in shapes.iter().enumerate() {
            let [top, bottom] = reach(shape).map(|row| row.max(0.0) as usize / BAND);
            (top..=bottom.min(bands - 1)).for_each(|band| of_band[band].push(index as u32));
        }
        self.pixels.par_chunks_mut(BAND * width).zip(of_band).enumerate().for_each(
            |(band, (pixels, indices))| {
                let rows = band * BAND..(band * BAND + BAND).min(height);
                fill(rows, pixels, &mut indices.iter().map(|&index| &shapes[index as usize]));
            },
        );
    }

    /// Draws balls with a white rim and tells which of them are seen: those before whose middle nothing lies by more than
    /// their size. They are seen whole, for a steep surface that they sit on does not cut them.
    pub(super) fn mark(&mut self, marks: &[Splat], shade: &mut [f32]) -> Vec<bool> {
        let is_seen = |&Splat { at: [x, y, z], radius, .. }: &Splat| {
            let inside = x >= 0.0 && y >= 0.0 && (x as usize) < self.width && (y as usize) < self.height;
            let before = inside.then(|| self.pixels[y as usize * self.width + x as usize]);
            before.is_some_and(|pixel| z + 2.0 * radius + STEEP * pixel.grain >= pixel.depth)
        };
        let seen: Vec<bool> = marks.iter().map(is_seen).collect();
        let mut order: Vec<usize> = (0..marks.len()).filter(|&mark| seen[mark]).collect();
        order.sort_by(|&a, &b| marks[a].at[2].total_cmp(&marks[b].at[2]));
        for Splat { at: [x, y, z], radius, color } in order.into_iter().map(|mark| marks[mark]) {
            disc([x, y], radius, self.width, 0..self.height, |pixel, squared| {
                let is_rim = radius >= RIMMED && squared > 0.66 * radius * radius;
                let color = if is_rim { [1.0; 3] } else { color };
                self.pixels[pixel] = Pixel { depth: z + 2.0 * radius, grain: radius, facing: 1.0, color };
                shade[pixel] = 1.0;
            });
        }
        seen
    }

    /// The picture, each of its pixels the mean of `oversampling²`.
    pub(super) fn picture(&self, shade: &[f32], oversampling: usize, background: Background) -> Picture {
        let (width, height) = (self.width / oversampling, self.height / oversampling);
        let behind = if background == Background::Black { 0.0 } else { 1.0 };
        let samples = (oversampling * oversampling) as f32;
        let pixel = |at: usize| {
            let (left, top) = (at % width * oversampling, at / width * oversampling);
            let (mut light, mut covered) = ([0.0_f32; 3], 0.0_f32);
            for row in top..top + oversampling {
                let samples = row * self.width + left..row * self.width + left + oversampling;
                for (pixel, shade) in self.pixels[samples.clone()].iter().zip(&shade[samples]) {
                    if pixel.depth > EMPTY {
                        covered += 1.0;
                        let lit = pixel.color.map(|channel| channel * shade);
                        light = [0, 1, 2].map(|channel| light[channel] + lit[channel]);
                    }
                }
            }
            if background == Background::Transparent {
                let [r, g, b] = light.map(|x| color::to_srgb(if covered > 0.0 { x / covered } else { 0.0 }));
                return [r, g, b, (covered / samples * 255.0).round() as u8];
            }
            let [r, g, b] = light.map(|x| color::to_srgb((x + behind * (samples - covered)) / samples));
            [r, g, b, 255]
        };
        let pixels = (0..width * height).into_par_iter().flat_map_iter(pixel).collect();
        Picture { width, height, pixels }
    }
}

/// Calls `each` with every pixel of a disc within some rows, and its squared distance to the middle. A disc has one
/// pixel at least.
fn disc(
    [x, y]: [f32; 2],
    radius: f32,
    width: usize,
    rows: std::ops::Range<usize>,
    mut each: impl FnMut(usize, f32),
) {
    let range = |middle: f32, from: usize, to: usize| {
        let first = (middle - radius).floor().max(from as f32) as usize;
        let last = ((middle + radius).ceil().max(0.0) as usize).min(to);
        first..last
    };
    let squared_radius = (radius * radius).max(0.5);
    for row in range(y, rows.start, rows.end) {
        let down = row as f32 + 0.5 - y;
        for column in range(x, 0, width) {
            let across = column as f32 + 0.5 - x;
            let squared = across * across + down * down;
            if squared <= squared_radius {
                each(row * width + column, squared);
            }
        }
    }
}
