//! Points become pixels: discs with a depth, the nearest of which is seen.

use rayon::prelude::*;

use super::color::{self, Rgb};
use super::{Background, Picture};

/// Rows of pixels that one thread fills.
const BAND: usize = 64;
/// What a pixel that no point covers has for its depth.
pub(super) const EMPTY: f32 = f32::NEG_INFINITY;

/// A disc that faces the viewer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Splat {
    /// Place in pixels from the top left, and nearness in pixels.
    pub(super) at: [f32; 3],
    /// In pixels.
    pub(super) radius: f32,
    pub(super) color: Rgb,
}

/// Colour and depth of every pixel.
pub(super) struct Raster {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) depth: Vec<f32>,
    color: Vec<Rgb>,
}

impl Raster {
    pub(super) fn new(width: usize, height: usize) -> Self {
        Self { width, height, depth: vec![EMPTY; width * height], color: vec![[0.0; 3]; width * height] }
    }

    /// Draws discs. Between discs at about the same depth a pixel belongs to the one whose centre is nearest: towards
    /// its rim a disc recedes by its radius.
    pub(super) fn splat(&mut self, splats: &[Splat]) {
        let (width, height) = (self.width, self.height);
        let bands = height.div_ceil(BAND);
        let mut of_band: Vec<Vec<u32>> = vec![Vec::new(); bands];
        for (index, splat) in splats.iter().enumerate() {
            let top = (splat.at[1] - splat.radius).max(0.0) as usize / BAND;
            let bottom = (splat.at[1] + splat.radius).max(0.0) as usize / BAND;
            (top..=bottom.min(bands - 1)).for_each(|band| of_band[band].push(index as u32));
        }
        let rows = self.depth.par_chunks_mut(BAND * width).zip(self.color.par_chunks_mut(BAND * width));
        rows.zip(of_band).enumerate().for_each(|(band, ((depth, color), splats_of_band))| {
            let mut nearest = vec![EMPTY; depth.len()];
            let rows = band * BAND..(band * BAND + BAND).min(height);
            for index in splats_of_band {
                let Splat { at: [x, y, z], radius, color: paint } = splats[index as usize];
                pixels([x, y], radius, width, rows.clone(), |pixel, squared| {
                    let pixel = pixel - rows.start * width;
                    let receding = z - squared / radius;
                    if receding > nearest[pixel] {
                        (nearest[pixel], depth[pixel], color[pixel]) = (receding, z, paint);
                    }
                });
            }
        });
    }

    /// Draws balls and shades them. They are seen unless something lies before them by more than their size: a steep
    /// surface that they sit on does not cut them.
    pub(super) fn mark(&mut self, marks: &[Splat], mut shade: Vec<f32>) -> Vec<f32> {
        for &Splat { at: [x, y, z], radius, color } in marks {
            let (width, height) = (self.width, self.height);
            pixels([x, y], radius, width, 0..height, |pixel, squared| {
                let share = squared / (radius * radius);
                if z + 2.0 * radius >= self.depth[pixel] {
                    self.depth[pixel] = z + 2.0 * radius;
                    self.color[pixel] = color;
                    shade[pixel] = 1.0 - 0.6 * share * share;
                }
            });
        }
        shade
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
                let here =
                    self.depth[samples.clone()].iter().zip(&self.color[samples.clone()]).zip(&shade[samples]);
                for ((&depth, color), shade) in here {
                    if depth > EMPTY {
                        covered += 1.0;
                        let lit = color.map(|channel| channel * shade);
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
fn pixels(
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
