//! The two-hole torus (x²(1−x²)−y²)² + z² = r²: independent points, uniform by area.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// Radius r of the tube, measured in values of x²(1−x²)−y² and along z. Below ¼, the largest such value, the
/// two loops of the figure eight stay open.
pub(super) const TUBE: f64 = 0.15;

/// Signed function whose zero set is the surface; negative inside.
pub(super) fn value([x, y, z]: [f64; 3]) -> f64 {
    let eight = x * x * (1.0 - x * x) - y * y;
    eight * eight + z * z - TUBE * TUBE
}

/// Gradient of [`value`]; nowhere 0 on the surface.
pub(super) fn gradient([x, y, z]: [f64; 3]) -> [f64; 3] {
    let eight = x * x * (1.0 - x * x) - y * y;
    [2.0 * eight * (2.0 * x - 4.0 * x * x * x), -4.0 * eight * y, 2.0 * z]
}

/// Half the extents of the surface's bounding box.
pub(super) fn half_extent() -> [f64; 3] {
    // x²(x²−1) = r at the far ends, y² = ¼ + r above x² = ½.
    [f64::midpoint(1.0, (1.0 + 4.0 * TUBE).sqrt()).sqrt(), (0.25 + TUBE).sqrt(), TUBE]
}

/// Most points of a line along x, y, z on the surface.
const ROOTS_MAX: [usize; 3] = [8, 4, 2];

/// Draws a point, uniform by area.
///
/// A line along an axis through a uniform point of the bounding box meets the surface with density |n·axis| per
/// area; of the points where the axis is the largest component of the normal n, each is kept with probability
/// 1/(√3 |n·axis|) ≤ 1. Axis and point on the line are drawn so that every axis has the same factor. The
/// polynomials along the axes have closed roots, so the distribution is exact.
pub(super) fn draw(random: &mut ChaCha8Rng) -> [f64; 3] {
    let half = half_extent();
    let share = [0, 1, 2].map(|axis| half[(axis + 1) % 3] * half[(axis + 2) % 3] * ROOTS_MAX[axis] as f64);
    let total: f64 = share.iter().sum();
    loop {
        let pick = random.random::<f64>() * total;
        let axis = if pick < share[0] { 0 } else { 1 + usize::from(pick >= share[0] + share[1]) };
        let mut point = half.map(|extent| extent * (2.0 * random.random::<f64>() - 1.0));
        let root = random.random_range(0..ROOTS_MAX[axis]);
        let Some(coordinate) = roots(axis, point)[root] else { continue };
        point[axis] = coordinate;
        let normal = gradient(point);
        let length = normal.iter().map(|g| g * g).sum::<f64>().sqrt();
        let component = normal[axis].abs();
        let is_largest = normal.iter().all(|g| g.abs() <= component);
        if is_largest && random.random::<f64>() < length / (3.0_f64.sqrt() * component) {
            return point;
        }
    }
}

/// Where the line along an axis through a point meets the surface.
fn roots(axis: usize, [x, y, z]: [f64; 3]) -> [Option<f64>; 8] {
    let mut found = [None; 8];
    let mut push_both = |slot: usize, square: f64| {
        if square >= 0.0 {
            found[slot] = Some(square.sqrt());
            found[slot + 1] = Some(-square.sqrt());
        }
    };
    let rest = TUBE * TUBE - z * z;
    match axis {
        0 if rest >= 0.0 => {
            // q = x² solves q(1−q) = y² ± √(r²−z²).
            for (i, sign) in [1.0, -1.0].into_iter().enumerate() {
                let discriminant = 0.25 - y * y - sign * rest.sqrt();
                if discriminant >= 0.0 {
                    push_both(4 * i, 0.5 + discriminant.sqrt());
                    push_both(4 * i + 2, 0.5 - discriminant.sqrt());
                }
            }
        }
        1 if rest >= 0.0 => {
            let middle = x * x * (1.0 - x * x);
            push_both(0, middle + rest.sqrt());
            push_both(2, middle - rest.sqrt());
        }
        2 => {
            let eight = x * x * (1.0 - x * x) - y * y;
            push_both(0, TUBE * TUBE - eight * eight);
        }
        _ => {}
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_root_along_every_axis_is_on_the_surface() {
        let mut count = [0; 3];
        for i in 0..1000 {
            let fraction = |step: f64| 2.0 * (f64::from(i) * step).fract() - 1.0;
            let half = half_extent();
            let point = [half[0] * fraction(0.61), half[1] * fraction(0.41), half[2] * fraction(0.37)];
            for axis in 0..3 {
                for root in roots(axis, point).into_iter().flatten() {
                    let mut on = point;
                    on[axis] = root;
                    assert!(value(on).abs() < 1e-12, "{on:?}");
                    assert!(root.abs() <= half[axis] + 1e-12);
                    count[axis] += 1;
                }
            }
        }
        assert!(count.iter().all(|&roots| roots > 100), "{count:?}");
    }

    #[test]
    fn the_gradient_is_the_derivative_of_the_value() {
        let at = [0.7, 0.3, 0.1];
        for axis in 0..3 {
            let shifted = |by: f64| {
                let mut point = at;
                point[axis] += by;
                value(point)
            };
            let slope = (shifted(1e-6) - shifted(-1e-6)) / 2e-6;
            assert!((slope - gradient(at)[axis]).abs() < 1e-8);
        }
    }
}
