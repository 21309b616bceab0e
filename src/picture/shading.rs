//! Light on surfaces. Points have no normals: these follow from the depth of the pixels around.

use rayon::prelude::*;

use super::raster::{EMPTY, Raster};

/// Samples to either side along a row and a column.
const REACH: isize = 3;
/// Direction to the light in the picture: right, up, towards the viewer. From the upper left, over the shoulder.
const LIGHT: [f32; 3] = [-0.41, 0.47, 0.78];
/// Light from everywhere; the rest depends on the direction of the surface.
const AMBIENT: f32 = 0.45;
/// Darkness of a pixel before which others stand [eye-dome lighting: Boucheny 2009, ch. 4], per radius of a point.
const OCCLUSION: f32 = 0.035;

/// Share of the light that a unit normal faces: right, up, towards the viewer. Surfaces of scans have two sides.
pub(super) fn facing(normal: [f32; 3]) -> f32 {
    let side = if normal[2] < 0.0 { -1.0 } else { 1.0 };
    (0..3).map(|axis| side * normal[axis] * LIGHT[axis]).sum()
}

/// Brightness of every pixel, 0 to 1.
///
/// The slope is fitted to samples about as far away as three points: nearer ones lie on the same disc.
pub(super) fn shade(raster: &Raster) -> Vec<f32> {
    (0..raster.pixels.len()).into_par_iter().map(|pixel| of_pixel(raster, pixel)).collect()
}

fn of_pixel(raster: &Raster, pixel: usize) -> f32 {
    let seen = &raster.pixels[pixel];
    if seen.depth <= EMPTY {
        return 1.0;
    }
    let step = (seen.grain * 0.75).round().max(1.0) as isize;
    let tolerance = step as f32 * REACH as f32 + 2.0 * seen.grain;
    let (x, y) = ((pixel % raster.width).cast_signed(), (pixel / raster.width).cast_signed());
    let at = |right: isize, down: isize| {
        let (x, y) = (x + right * step, y + down * step);
        let inside = x >= 0 && y >= 0 && x < raster.width.cast_signed() && y < raster.height.cast_signed();
        inside
            .then(|| raster.pixels[y as usize * raster.width + x as usize].depth)
            .filter(|depth| *depth > EMPTY)
    };
    let (mut slope, mut weight, mut before) = ([0.0_f32; 2], [0.0_f32; 2], 0.0_f32);
    for down in -REACH..=REACH {
        for right in -REACH..=REACH {
            let Some(rise) = at(right, down).map(|other| other - seen.depth) else { continue };
            before += (rise - tolerance).max(0.0).min(4.0 * tolerance);
            // What lies much nearer or farther is another part of the surface.
            if rise.abs() <= 3.0 * tolerance {
                for (axis, offset) in [(0, right), (1, -down)] {
                    let offset = (offset * step) as f32;
                    slope[axis] += offset * rise;
                    weight[axis] += offset * offset;
                }
            }
        }
    }
    let facing = if seen.facing.is_nan() {
        let [dx, dy] = [0, 1].map(|axis| if weight[axis] > 0.0 { slope[axis] / weight[axis] } else { 0.0 });
        (LIGHT[2] - dx * LIGHT[0] - dy * LIGHT[1]) / (1.0 + dx * dx + dy * dy).sqrt()
    } else {
        seen.facing
    };
    let samples = ((2 * REACH + 1) * (2 * REACH + 1)) as f32;
    let hidden = (-OCCLUSION * before / samples / tolerance * samples.sqrt()).exp();
    (AMBIENT + (1.0 - AMBIENT) * facing.clamp(0.0, 1.0)) * hidden
}
