//! The outline of a body as seen across its plane of motion: a polygon around the rod with a round head and a round tip, and an
//! ellipse around the head that has a body of its own.

use nalgebra::Vector2;

use super::rod_motion::DrawnRod;

/// Minimum and maximum number of points along the rod at which the outline has corners on both sides; in between, twice the number
/// of nodes.
const STATIONS: [usize; 2] = [33, 97];

/// Corners of a rounded end between its two sides, and of an ellipse.
const CORNERS_OF_END: usize = 7;
const CORNERS_OF_ELLIPSE: usize = 44;

/// Fraction of the minimum width at the tip, so that the direction of a thin rod is visible.
const TAPER: f64 = 0.5;

impl DrawnRod {
    /// Half the width at a point, m; 0 if it is unknown, which is drawn as thin as can be seen.
    fn half_width(&self, point: usize) -> f64 {
        self.half_widths.as_ref().and_then(|widths| widths.get(point)).copied().unwrap_or(0.0)
    }

    /// The largest distance of the outline from a node, m.
    pub fn reach(&self) -> f64 {
        let head = self.body.map_or(0.0, |[along, across]| along.max(across));
        self.half_widths.iter().flatten().copied().fold(head, f64::max)
    }

    /// Half the width of the head, m; 0 if the first point is another node.
    pub fn head_half_width(&self) -> f64 {
        let own = if self.shows_head() { self.half_width(0) } else { 0.0 };
        self.body.map_or(own, |[_, across]| across)
    }

    /// The closed polygons around the nodes at `points`, all in the same sense of rotation: the rod, and the body at its head. Their numbers
    /// of corners do not depend on the shape. No half width is below `least`, in the unit of the points, which is `unit` per metre.
    pub fn polygons(&self, points: &[Vector2<f64>], unit: f64, least: f64) -> Vec<Vec<Vector2<f64>>> {
        let mut polygons = Vec::new();
        if points.len() < 2 {
            return polygons;
        }
        let last = points.len() - 1;
        let [fewest, most] = STATIONS;
        let stations = (2 * points.len()).clamp(fewest, most);
        let (mut spine, mut widths) = (Vec::with_capacity(stations), Vec::with_capacity(stations));
        for station in 0..stations {
            let xi = station as f64 / (stations - 1) as f64;
            let at = xi * last as f64;
            let k = (at as usize).min(last - 1);
            let part = at - k as f64;
            spine.push(between(points, k, part));
            let own = unit * ((1.0 - part) * self.half_width(k) + part * self.half_width(k + 1));
            widths.push(own.max(least * (1.0 - TAPER * xi)));
        }
        polygons.push(around(&spine, &widths));
        if let Some([along, across]) = self.body {
            let axis = direction(points[1] - points[0]);
            let side = Vector2::new(-axis.y, axis.x);
            let corner = |i: usize| {
                let (sin, cos) = (-std::f64::consts::TAU * i as f64 / CORNERS_OF_ELLIPSE as f64).sin_cos();
                points[0] + axis * (cos * (unit * along).max(least)) + side * (sin * (unit * across).max(least))
            };
            polygons.push((0..CORNERS_OF_ELLIPSE).map(corner).collect());
        }
        polygons
    }
}

/// A point between points `k` and `k + 1`, on the cubic whose slopes at these are the mean ones of their neighbours.
fn between(points: &[Vector2<f64>], k: usize, part: f64) -> Vector2<f64> {
    let slope = |i: usize| {
        let (before, after) = (i.saturating_sub(1), (i + 1).min(points.len() - 1));
        (points[after] - points[before]) / (after - before) as f64
    };
    let (p, q, u, v) = (points[k], points[k + 1], slope(k), slope(k + 1));
    let (s, s2, s3) = (part, part * part, part * part * part);
    p * (2.0 * s3 - 3.0 * s2 + 1.0) + u * (s3 - 2.0 * s2 + s) + q * (3.0 * s2 - 2.0 * s3) + v * (s3 - s2)
}

fn direction(vector: Vector2<f64>) -> Vector2<f64> {
    vector.try_normalize(0.0).unwrap_or(Vector2::x())
}

/// The polygon at these distances on both sides of a line, with round ends; clockwise where y points upwards. On the inside of a bend that
/// is tighter than the line is wide, it stays at the centre of the bend.
fn around(line: &[Vector2<f64>], widths: &[f64]) -> Vec<Vector2<f64>> {
    let last = line.len() - 1;
    let tangent = |i: usize| direction(line[(i + 1).min(last)] - line[i.saturating_sub(1)]);
    // Left of the line where `sign` is one.
    let side = |i: usize, sign: f64| {
        let t = tangent(i);
        let mut width = widths[i];
        if 0 < i && i < last {
            let [before, after] = [line[i] - line[i - 1], line[i + 1] - line[i]];
            let turn = sign * before.perp(&after).atan2(before.dot(&after));
            if turn > 0.0 {
                width = width.min(0.5 * (before.norm() + after.norm()) / turn);
            }
        }
        line[i] + Vector2::new(-t.y, t.x) * (sign * width)
    };
    // From the left to the right side around the end that `t` leaves, or back around the other.
    let end = |i: usize, t: Vector2<f64>| {
        let n = Vector2::new(-t.y, t.x);
        (1..=CORNERS_OF_END).map(move |j| {
            let (sin, cos) = (std::f64::consts::PI * j as f64 / (CORNERS_OF_END + 1) as f64).sin_cos();
            line[i] + (n * cos + t * sin) * widths[i]
        })
    };
    let left = (0..=last).map(|i| side(i, 1.0));
    let right = (0..=last).rev().map(|i| side(i, -1.0));
    left.chain(end(last, tangent(last))).chain(right).chain(end(0, -tangent(0))).collect()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    fn rod(nodes: usize, half_width: f64, body: [f64; 2]) -> DrawnRod {
        let half_widths = Some(vec![half_width; nodes]);
        DrawnRod { half_widths, body: Some(body), ..DrawnRod::unknown((0..nodes).collect()) }
    }

    /// Area inside a polygon; negative where it goes clockwise.
    fn area(polygon: &[Vector2<f64>]) -> f64 {
        let next = polygon.iter().cycle().skip(1);
        polygon.iter().zip(next).map(|(a, b)| 0.5 * a.perp(b)).sum()
    }

    /// An arc of this radius through `nodes` nodes of a rod of length 1.
    fn arc(radius: f64, nodes: usize) -> Vec<Vector2<f64>> {
        let angle = |k: usize| k as f64 / (nodes - 1) as f64 / radius;
        (0..nodes).map(|k| Vector2::new(radius * angle(k).sin(), radius * (1.0 - angle(k).cos()))).collect()
    }

    #[test]
    fn the_area_of_the_outline_is_the_integral_of_the_width_and_two_half_discs() {
        for nodes in [3, 9, 33, 10_000] {
            for radius in [0.3, 1.0, 1e6] {
                for size in [1e-6, 1.0, 10.0] {
                    // Half widths from 0.05 to 0.02 of the length.
                    let widths = (0..nodes).map(|k| size * (0.05 - 0.03 * k as f64 / (nodes - 1) as f64)).collect();
                    let body = DrawnRod { half_widths: Some(widths), ..DrawnRod::unknown((0..nodes).collect()) };
                    let points: Vec<_> = arc(radius, nodes).into_iter().map(|point| point * size).collect();
                    let found = -area(&body.polygons(&points, 1.0, 0.0)[0]) / size.powi(2);
                    let wanted = 0.07 + 0.5 * PI * (0.05f64.powi(2) + 0.02f64.powi(2));
                    // Through three nodes on most of a circle, the cubic is longer or shorter than the arc.
                    let tolerance = if nodes == 3 && radius < 1.0 { 0.25 } else { 0.01 };
                    assert!((found / wanted - 1.0).abs() < tolerance, "{nodes} nodes, {radius}: {found}, {wanted}");
                }
            }
        }
    }

    #[test]
    fn a_body_at_the_head_is_the_ellipse_of_its_semi_axes_along_the_first_edge() {
        let body = rod(3, 0.01, [0.2, 0.1]);
        let points = [Vector2::zeros(), Vector2::new(0.0, 0.5), Vector2::new(0.0, 1.0)];
        let polygons = body.polygons(&points, 1.0, 0.0);
        assert_eq!(polygons.len(), 2);
        let furthest = |of: fn(&Vector2<f64>) -> f64| polygons[1].iter().map(of).fold(0.0, f64::max);
        assert!((furthest(|p| p.y.abs()) - 0.2).abs() < 1e-12 && (furthest(|p| p.x.abs()) - 0.1).abs() < 1e-12);
        assert!((-area(&polygons[1]) / (PI * 0.02) - 1.0).abs() < 0.01);
        assert!(area(&polygons[0]) < 0.0, "both turn the same way, so that they fill what they share");
    }

    #[test]
    fn a_rod_that_is_folded_over_or_has_no_length_has_an_outline_of_numbers() {
        let body = rod(5, 0.1, [0.1, 0.1]);
        let folded = [0.0, 0.5, 1.0, 0.5, 0.0].map(|x| Vector2::new(x, 0.0));
        for points in [folded, [Vector2::zeros(); 5]] {
            let polygons = body.polygons(&points, 100.0, 1.0);
            assert!(polygons.iter().flatten().all(|point| point.x.is_finite() && point.y.is_finite()));
            assert!(polygons[0].iter().all(|point| (-10.1..=110.1).contains(&point.x) && point.y.abs() < 10.1));
        }
        assert!(body.polygons(&[], 1.0, 1.0).is_empty());
        let thin = DrawnRod::unknown(vec![0, 1]).polygons(&[Vector2::zeros(), Vector2::new(100.0, 0.0)], 1.0, 2.0);
        assert!((-area(&thin[0]) - 300.0).abs() < 10.0, "as wide as can be seen: {}", area(&thin[0]));
    }
}
