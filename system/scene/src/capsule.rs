//! [`Capsule`]: the shape of a link, to find out which fingers meet.

use nalgebra::Vector3;

use crate::finger::{Finger, Link};

/// The radius, in m, of the palm, and of each link that the configuration describes without a cuboid.
pub(crate) const RADIUS_M: f64 = 0.008;

/// All points within a radius of a segment.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Capsule {
    /// The ends of the segment, m.
    pub(crate) ends: [Vector3<f64>; 2],
    /// The radius, m.
    pub(crate) radius: f64,
}

impl Capsule {
    /// Returns the shape of a link in its own frame; `None` for a link without length. The surface of a link that
    /// carries no other one ends at its end, such as the tip.
    pub(crate) fn of(finger: &Finger, place: usize, link: &Link) -> Option<Self> {
        let along = finger.along(place);
        let length = along.norm();
        let direction = along.try_normalize(f64::EPSILON)?;
        let is_last = finger.is_end(place);
        let mut radius = link
            .cuboid
            .map_or(RADIUS_M, |edges| across(edges, &direction) / 2.0);
        if is_last {
            radius = radius.min(length);
        }
        let end = if is_last { length - radius } else { length };
        Some(Self {
            ends: [Vector3::zeros(), direction * end],
            radius,
        })
    }

    /// Returns the nearest points of two segments, and the distance between the surfaces around them, m.
    pub(crate) fn clearance(&self, other: &Self) -> ([Vector3<f64>; 2], f64) {
        let points = nearest(&self.ends, &other.ends);
        let [here, there] = points;
        let distance = (there - here).norm() - self.radius - other.radius;
        (points, distance)
    }
}

/// Returns the longer of the edges of a cuboid that are not along a direction.
fn across([x, y, z]: [f64; 3], direction: &Vector3<f64>) -> f64 {
    match direction.iamax() {
        0 => y.max(z),
        1 => x.max(z),
        _ => x.max(y),
    }
}

/// Returns the nearest points of two segments (C. Ericson, *Real-Time Collision Detection*, 2005, section
/// 5.1.9).
fn nearest(first: &[Vector3<f64>; 2], second: &[Vector3<f64>; 2]) -> [Vector3<f64>; 2] {
    let [start, other] = [first, second].map(|[start, _]| *start);
    let [way, other_way] = [first, second].map(|[start, end]| end - start);
    let between = start - other;
    let (square, other_square) = (way.norm_squared(), other_way.norm_squared());
    let (both, ahead) = (way.dot(&other_way), way.dot(&between));
    let other_ahead = other_way.dot(&between);
    // A segment without length is a point: any part of it will do.
    let part = |above: f64, below: f64| {
        if below > 0.0 {
            (above / below).clamp(0.0, 1.0)
        } else {
            0.0
        }
    };
    let of_lines = part(
        both * other_ahead - ahead * other_square,
        square * other_square - both * both,
    );
    let of_other = part(both * of_lines + other_ahead, other_square);
    // The best place on the first segment for the one on the second.
    let of_first = part(both * of_other - ahead, square);
    [start + way * of_first, other + other_way * of_other]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(from: [f64; 3], to: [f64; 3]) -> [Vector3<f64>; 2] {
        [from.into(), to.into()]
    }

    /// Checks the distance, in both orders.
    fn check(first: [Vector3<f64>; 2], second: [Vector3<f64>; 2], distance: f64) {
        for [first, second] in [[first, second], [second, first]] {
            let [here, there] = nearest(&first, &second);
            let found = (there - here).norm();
            assert!((found - distance).abs() < 1e-12, "{found}, not {distance}");
        }
    }

    #[test]
    fn segments_are_nearest_inside_at_ends_and_where_they_are_parallel() {
        let x = segment([-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]);
        // Crossing in the middle of both.
        check(x, segment([0.2, -1.0, 0.5], [0.2, 2.0, 0.5]), 0.5);
        // An end over the middle, an end beyond an end.
        check(x, segment([0.3, 3.0, 0.0], [0.3, 7.0, 0.0]), 3.0);
        check(x, segment([4.0, 4.0, 0.0], [9.0, 4.0, 0.0]), 5.0);
        // Parallel and beside, parallel and behind, on one line, crossing, a point, two points.
        check(x, segment([0.5, 0.0, 2.0], [8.0, 0.0, 2.0]), 2.0);
        check(x, segment([4.0, 4.0, 0.0], [5.0, 4.0, 0.0]), 5.0);
        check(x, segment([1.5, 0.0, 0.0], [2.0, 0.0, 0.0]), 0.5);
        check(x, segment([0.1, -1.0, 0.0], [0.1, 1.0, 0.0]), 0.0);
        check(x, segment([0.4, 0.0, 0.3], [0.4, 0.0, 0.3]), 0.3);
        let point = segment([0.0, 3.0, 4.0], [0.0, 3.0, 4.0]);
        check(point, segment([0.0; 3], [0.0; 3]), 5.0);
    }
}
