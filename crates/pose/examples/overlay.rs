//! Draws what a network finds: `overlay MODEL OUT_DIR [--library LIB | --tract] [--weights DIR] [--region full|track] [--json FILE] PICTURE...`
//!
//! Pictures are taken in order as the pictures of one camera. Every one is written to `OUT_DIR` with its people drawn;
//! `--json` writes one line for each picture with its people, and then nothing is drawn.

use std::{
    error::Error,
    io::Write as _,
    path::{Path, PathBuf},
};

use image::{Rgb, RgbImage};
use pose::{
    Estimator, ImageView, LibraryCandidate, LibraryChoice, LibraryOrigin, Model, Person, Region, RegionOptions,
    Runtime, RuntimeOptions, Side,
};

fn main() -> Result<(), Box<dyn Error>> {
    let mut options = RuntimeOptions::default();
    let (mut weights, mut region, mut json, mut rest) = (Vec::new(), None, None, Vec::new());
    let mut args = std::env::args_os().skip(1);
    while let Some(arg) = args.next() {
        let mut value = || args.next().ok_or("an option lacks its value");
        match arg.to_str() {
            Some("--tract") => options.library = LibraryChoice::PureRust,
            Some("--library") => {
                let path = value()?.into();
                let wish = LibraryCandidate { path, origin: LibraryOrigin::Explicit };
                options.library = LibraryChoice::Search(vec![wish]);
            }
            Some("--weights") => weights.push(PathBuf::from(value()?)),
            Some("--json") => json = Some(std::fs::File::create(value()?)?),
            Some("--region") => {
                region = Some(if value()? == "track" { Region::Track } else { Region::Full });
            }
            _ => rest.push(PathBuf::from(arg)),
        }
    }
    let [model, out, pictures @ ..] = &rest[..] else {
        return Err("usage: overlay MODEL OUT_DIR PICTURE...".into());
    };
    let model = Model::find(model, &weights)?;
    let runtime = Runtime::load(options)?;
    let region = region.unwrap_or(model.card.region());
    let mut estimator = Estimator::with_region(&model, &runtime, region, RegionOptions::default())?;
    eprintln!("{} on {}", model.card.name, estimator.runtime_info());
    std::fs::create_dir_all(out)?;
    for picture in pictures {
        let image = image::open(picture)?.into_rgb8();
        let (width, height) = (image.width() as usize, image.height() as usize);
        let people = estimator.estimate(ImageView::new(width, height, image.as_raw())?)?;
        eprintln!("{}: {} people, scores {:.2?}", picture.display(), people.len(), scores(&people));
        if let Some(file) = &mut json {
            serde_json::to_writer(&mut *file, &people)?;
            writeln!(file)?;
            continue;
        }
        let mut image = image;
        for person in &people {
            draw(&mut image, person);
        }
        let name = picture.file_name().unwrap_or(picture.as_os_str());
        image.save(out.join(Path::new(name).with_extension("png")))?;
    }
    Ok(())
}

fn scores(people: &[Person]) -> Vec<f32> {
    people.iter().map(|p| p.score).collect()
}

/// Right arm orange, left arm blue, the rest grey; line width grows with the picture.
fn draw(image: &mut RgbImage, person: &Person) {
    let right = pose::Part::arm(Side::Right);
    let left = pose::Part::arm(Side::Left);
    let parts = person.skeleton.parts();
    let width = (image.width().max(image.height()) as f32 / 300.0).max(1.0);
    for (a, b) in person.skeleton.bones() {
        let (Some(from), Some(to)) = (person.keypoints[a], person.keypoints[b]) else { continue };
        let both = |arm: &[pose::Part]| arm.contains(&parts[a]) && arm.contains(&parts[b]);
        let colour = if both(&right) {
            Rgb([255, 140, 0])
        } else if both(&left) {
            Rgb([0, 160, 255])
        } else {
            Rgb([190, 190, 190])
        };
        let length = from.distance_px(&to).max(1.0);
        for i in 0..=length as usize {
            let u = i as f32 / length;
            dot(
                image,
                from.u_px + u * (to.u_px - from.u_px),
                from.v_px + u * (to.v_px - from.v_px),
                width * 0.5,
                colour,
            );
        }
    }
    for (_, k) in person.iter() {
        dot(image, k.u_px, k.v_px, width, Rgb([255, (255.0 * k.score) as u8, 0]));
    }
}

fn dot(image: &mut RgbImage, u: f32, v: f32, radius: f32, colour: Rgb<u8>) {
    let r = radius.ceil() as i64;
    for dy in -r..=r {
        for dx in -r..=r {
            let (x, y) = (u.round() as i64 + dx, v.round() as i64 + dy);
            let inside = x >= 0 && y >= 0 && x < i64::from(image.width()) && y < i64::from(image.height());
            if inside && (dx * dx + dy * dy) as f32 <= radius * radius {
                image.put_pixel(x as u32, y as u32, colour);
            }
        }
    }
}
