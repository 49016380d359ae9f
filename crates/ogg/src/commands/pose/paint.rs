//! Skeletons on pictures.

use image::{Rgb, RgbImage};
use pose::{ArmJoint, ArmKeypoints, Part, Person, Side};

const RIGHT_ARM: Rgb<u8> = Rgb([255, 140, 0]);
const LEFT_ARM: Rgb<u8> = Rgb([0, 160, 255]);
const REST: Rgb<u8> = Rgb([190, 190, 190]);
const MEASURED: Rgb<u8> = Rgb([0, 230, 60]);
const INFERRED: Rgb<u8> = Rgb([255, 220, 0]);

/// Line width that grows with the picture.
fn width_px(image: &RgbImage) -> f32 {
    (image.width().max(image.height()) as f32 / 320.0).max(1.0)
}

/// A person: right arm orange, left arm blue, the rest grey; keypoints go from red to yellow with their score.
pub(super) fn person(image: &mut RgbImage, person: &Person) {
    let width = width_px(image);
    let parts = person.skeleton.parts();
    for (a, b) in person.skeleton.bones() {
        let (Some(from), Some(to)) = (person.keypoints[a], person.keypoints[b]) else { continue };
        let both = |side| {
            let arm = Part::arm(side);
            arm.contains(&parts[a]) && arm.contains(&parts[b])
        };
        let colour = match (both(Side::Right), both(Side::Left)) {
            (true, _) => RIGHT_ARM,
            (_, true) => LEFT_ARM,
            _ => REST,
        };
        line(image, (from.u_px, from.v_px), (to.u_px, to.v_px), width, colour);
    }
    for (_, k) in person.iter() {
        disc(image, (k.u_px, k.v_px), width, Rgb([255, (255.0 * k.score.clamp(0.0, 1.0)) as u8, 0]));
    }
}

/// The gated arm of the worker: a ring of two sigmas per joint, green where it was measured, yellow where it was inferred.
pub(super) fn arm(image: &mut RgbImage, arm: &ArmKeypoints) {
    let width = width_px(image);
    for joint in arm.joints() {
        let colour = if joint.is_measured() { MEASURED } else { INFERRED };
        if let ArmJoint::Measured(e) | ArmJoint::Inferred(e) = joint {
            ring(image, (e.u_px as f32, e.v_px as f32), (2.0 * e.sigma_px) as f32 + 2.0 * width, width, colour);
        }
    }
}

fn line(image: &mut RgbImage, from: (f32, f32), to: (f32, f32), width: f32, colour: Rgb<u8>) {
    let (dx, dy) = (to.0 - from.0, to.1 - from.1);
    let steps = dx.hypot(dy).min(1e4) as usize + 1;
    for i in 0..=steps {
        let u = i as f32 / steps as f32;
        disc(image, (from.0 + u * dx, from.1 + u * dy), 0.5 * width, colour);
    }
}

fn disc(image: &mut RgbImage, centre: (f32, f32), radius: f32, colour: Rgb<u8>) {
    spot(image, centre, radius, colour, |r| r <= radius);
}

fn ring(image: &mut RgbImage, centre: (f32, f32), radius: f32, width: f32, colour: Rgb<u8>) {
    let radius = radius.min(image.width().max(image.height()) as f32);
    spot(image, centre, radius, colour, |r| r <= radius && r >= radius - width);
}

fn spot(image: &mut RgbImage, centre: (f32, f32), radius: f32, colour: Rgb<u8>, inside: impl Fn(f32) -> bool) {
    if !(centre.0.is_finite() && centre.1.is_finite() && radius.is_finite()) {
        return;
    }
    let range = |c: f32, limit: u32| {
        let to = |x: f32| x.clamp(0.0, limit as f32) as u32;
        to((c - radius).floor())..to((c + radius).ceil() + 1.0)
    };
    for y in range(centre.1, image.height()) {
        for x in range(centre.0, image.width()) {
            if inside((x as f32 - centre.0).hypot(y as f32 - centre.1)) {
                image.put_pixel(x, y, colour);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disc_at_the_border_or_far_outside_stays_in_the_picture() {
        let mut image = RgbImage::new(8, 6);
        disc(&mut image, (0.0, 0.0), 2.0, RIGHT_ARM);
        disc(&mut image, (1e9, -1e9), 3.0, RIGHT_ARM);
        disc(&mut image, (f32::NAN, 0.0), 3.0, RIGHT_ARM);
        line(&mut image, (-50.0, 3.0), (70.0, 3.0), 1.0, LEFT_ARM);
        assert_eq!(*image.get_pixel(0, 0), RIGHT_ARM);
        assert_eq!(*image.get_pixel(1, 1), RIGHT_ARM);
        assert_eq!(*image.get_pixel(2, 2), Rgb([0, 0, 0]));
        assert_eq!(*image.get_pixel(7, 3), LEFT_ARM);
    }
}
