//! A triangle known by its sides alone, so that it is the same in any ambient dimension.

use super::points::Points;

/// Squared lengths of the sides opposite to corners 0, 1 and 2, in length².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriangleMetric {
    squared: [f64; 3],
    area: f64,
}

impl TriangleMetric {
    /// The triangle of three points; the bits do not depend on the order of the corners, other than in their order.
    #[must_use]
    pub fn of(points: &Points, corners: [u32; 3]) -> Self {
        Self::from_squared_sides(std::array::from_fn(|i| {
            points.squared_distance(corners[(i + 1) % 3] as usize, corners[(i + 2) % 3] as usize)
        }))
    }

    /// The same with an area that is accurate for needles too: from sides alone, rounding gives a triangle without area
    /// about 1e-8 of its longest squared side.
    #[must_use]
    pub fn accurate(points: &Points, corners: [u32; 3]) -> Self {
        let mut triangle = Self::of(points, corners);
        let squared = triangle.squared;
        let longest = (0..3).max_by(|&a, &b| squared[a].total_cmp(&squared[b])).unwrap_or(0);
        let (a, b) = (corners[(longest + 1) % 3], corners[(longest + 2) % 3]);
        // from one end, whatever the order of the corners
        let (a, b, c) = (points.point(a.min(b) as usize), points.point(a.max(b) as usize), corners[longest]);
        let c = points.point(c as usize);
        let base = squared[longest];
        let along = a.iter().zip(b).zip(c).map(|((a, b), c)| (b - a) * (c - a)).sum::<f64>() / base;
        let height: f64 =
            a.iter().zip(b).zip(c).map(|((a, b), c)| c - a - along * (b - a)).map(|x| x * x).sum();
        triangle.area = if base > 0.0 { 0.5 * (base * height).sqrt() } else { 0.0 };
        triangle
    }

    /// Squared sides opposite to corners 0, 1 and 2, in length².
    #[must_use]
    pub fn squared_sides(&self) -> [f64; 3] {
        self.squared
    }

    /// The triangle with these squared sides.
    #[must_use]
    pub fn from_squared_sides(squared: [f64; 3]) -> Self {
        // 16 A² = 4a²b² − (a² + b² − c²)², with c the longest side: the least cancellation, the same bits in any order
        let [mut a, mut b, mut c] = squared;
        if a > b {
            std::mem::swap(&mut a, &mut b);
        }
        if b > c {
            std::mem::swap(&mut b, &mut c);
        }
        if a > b {
            std::mem::swap(&mut a, &mut b);
        }
        let area = 0.25 * (4.0 * a * b - (a + b - c) * (a + b - c)).max(0.0).sqrt();
        Self { squared, area }
    }

    /// Area in length².
    #[must_use]
    pub fn area(&self) -> f64 {
        self.area
    }

    /// Scalar product of the two sides that leave a corner.
    fn product(&self, corner: usize) -> f64 {
        0.5 * (self.squared[(corner + 1) % 3] + self.squared[(corner + 2) % 3] - self.squared[corner])
    }

    /// Cotangent of the angle at a corner; not finite when the corners lie on a line.
    #[must_use]
    pub fn cotangent(&self, corner: usize) -> f64 {
        self.product(corner) / (2.0 * self.area)
    }

    /// Angle at a corner, 0 to π.
    #[must_use]
    pub fn angle(&self, corner: usize) -> f64 {
        (2.0 * self.area).atan2(self.product(corner))
    }

    /// Radius of the circumcircle: infinite when the corners lie on a line.
    #[must_use]
    pub fn circumradius(&self) -> f64 {
        let mut sorted = self.squared;
        sorted.sort_unstable_by(f64::total_cmp);
        (sorted[0] * sorted[1] * sorted[2]).sqrt() / (4.0 * self.area)
    }

    /// Signed area between a corner, the midpoints of its sides and the circumcenter: of the corner's Voronoi cell
    /// what one triangle carries. Negative parts occur in obtuse triangles.
    #[must_use]
    pub fn voronoi_area(&self, corner: usize) -> f64 {
        let (next, last) = ((corner + 1) % 3, (corner + 2) % 3);
        (self.squared[next] * self.cotangent(next) + self.squared[last] * self.cotangent(last)) / 8.0
    }

    /// The same, but half of an obtuse triangle to its obtuse corner and a quarter to each other (Meyer et al. 2003,
    /// §3.3): never negative.
    #[must_use]
    pub fn mixed_area(&self, corner: usize) -> f64 {
        match (0..3).find(|&other| self.product(other) < 0.0) {
            None => self.voronoi_area(corner),
            Some(obtuse) if obtuse == corner => self.area / 2.0,
            Some(_) => self.area / 4.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_near(found: f64, expected: f64) {
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }

    #[test]
    fn the_triangle_3_4_5_has_its_textbook_measures() {
        let triangle = TriangleMetric::from_squared_sides([9.0, 16.0, 25.0]);
        assert_near(triangle.area(), 6.0);
        assert_near(triangle.circumradius(), 2.5);
        assert_near(triangle.cotangent(0), 4.0 / 3.0);
        assert_near(triangle.cotangent(2), 0.0);
        assert_near(triangle.angle(2), std::f64::consts::FRAC_PI_2);
        // the circumcenter is the middle of the hypotenuse: half to the right angle, a quarter to each other
        for (corner, share) in [(0, 0.25), (1, 0.25), (2, 0.5)] {
            assert_near(triangle.voronoi_area(corner), 6.0 * share);
            assert_near(triangle.mixed_area(corner), 6.0 * share);
        }
    }

    #[test]
    fn the_parts_of_an_obtuse_triangle_add_up_either_way() {
        // 120° between sides of 1 and 1; by hand: area √3/4, circumradius 1
        let triangle = TriangleMetric::from_squared_sides([3.0, 1.0, 1.0]);
        assert_near(triangle.area(), 3.0_f64.sqrt() / 4.0);
        assert_near(triangle.circumradius(), 1.0);
        assert_near(triangle.angle(0), std::f64::consts::PI * 2.0 / 3.0);
        assert_near((0..3).map(|corner| triangle.voronoi_area(corner)).sum(), triangle.area());
        assert_near((0..3).map(|corner| triangle.mixed_area(corner)).sum(), triangle.area());
        assert!(triangle.mixed_area(1) > 0.0);
    }

    #[test]
    fn corners_on_a_line_have_no_area_and_an_infinite_circumradius() {
        let triangle = TriangleMetric::from_squared_sides([1.0, 1.0, 4.0]);
        assert_near(triangle.area(), 0.0);
        assert!(triangle.circumradius().is_infinite());
    }
}
