//! A person drawn on a picture.

use foxglove::messages::{Color, Point2, PointsAnnotation, Timestamp, points_annotation};

use crate::record::sample::{KeypointState, Skeleton};

/// Where a pixel is in a picture whose blocks of `n x n` became one.
pub(super) fn shifted(pixel: f64, n: f64) -> f64 {
    f64::midpoint(2.0 * pixel / n, 1.0 / n - 1.0)
}

/// Limbs as a line list and keypoints as points; a lost keypoint is left out with its limbs.
pub(super) fn marks(person: &Skeleton, timestamp: Option<Timestamp>, divisor: u32) -> [PointsAnnotation; 2] {
    let colour = |r, g, b| Color { r, g, b, a: 1.0 };
    let limb_colour = if person.followed { colour(0.1, 0.9, 0.3) } else { colour(0.6, 0.6, 0.6) };
    let n = f64::from(divisor);
    let point = |index: usize| {
        let point = person.points.get(index).filter(|point| point.state != KeypointState::Lost)?;
        Some(Point2 { x: shifted(point.x_px, n), y: shifted(point.y_px, n) })
    };
    let ends = person.limbs.iter().filter_map(|&(a, b)| Some([point(a)?, point(b)?]));
    let limbs = PointsAnnotation {
        timestamp,
        r#type: points_annotation::Type::LineList as i32,
        points: ends.flatten().collect(),
        outline_color: Some(limb_colour),
        thickness: 3.0,
        ..PointsAnnotation::default()
    };
    let seen: Vec<(Point2, Color)> = (0..person.points.len())
        .filter_map(|index| {
            let shade = match person.points[index].state {
                KeypointState::Measured => colour(1.0, 1.0, 1.0),
                KeypointState::Inferred | KeypointState::Lost => colour(1.0, 0.6, 0.0),
            };
            Some((point(index)?, shade))
        })
        .collect();
    let joints = PointsAnnotation {
        timestamp,
        r#type: points_annotation::Type::Points as i32,
        points: seen.iter().map(|(point, _)| *point).collect(),
        outline_colors: seen.iter().map(|(_, shade)| *shade).collect(),
        outline_color: Some(limb_colour),
        thickness: 6.0,
        ..PointsAnnotation::default()
    };
    [limbs, joints]
}
