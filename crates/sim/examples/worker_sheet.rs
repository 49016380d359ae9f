//! Writes one PNG with a grid of pictures: three instants of each action in the default look, or random variations.
//!
//! `cargo run --release -p sim --example worker_sheet -- FILE.png [--random SEED] [--size WxH] [--joints]`

use std::time::Duration;

use image::{GenericImage, Rgb, RgbImage};
use sim::{
    Action, GroundTruth, Keypoint, Scene, SceneVariation, Script, Visibility, Worker, WorkerParams, default_camera,
};

const COLUMNS: u32 = 3;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut file = None;
    let mut seed = None;
    let mut size = [320, 240];
    let mut joints = false;
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--random" => seed = Some(args.next().ok_or("--random wants a seed")?.parse::<u64>()?),
            "--size" => {
                let text = args.next().ok_or("--size wants WxH")?;
                let (w, h) = text.split_once('x').ok_or("--size wants WxH")?;
                size = [w.parse()?, h.parse()?];
            }
            "--joints" => joints = true,
            _ => file = Some(arg),
        }
    }
    let file = file.ok_or("name the PNG to write")?;
    let mut sheet = RgbImage::new(size[0] * COLUMNS, size[1] * 3);
    for cell in 0..COLUMNS * 3 {
        let (mut picture, truth) = if let Some(seed) = seed {
            let variation = SceneVariation::random(seed + u64::from(cell), size)?;
            let worker = Worker::new(variation.worker.clone())?;
            Scene::varied(&variation).render(&worker.pose_at(variation.at))
        } else {
            let action = Action::ALL[(cell / COLUMNS) as usize];
            let worker = Worker::new(WorkerParams { script: Script::Repeat(action), ..WorkerParams::default() })?;
            let at = Duration::from_millis(u64::from(cell % COLUMNS) * 700 + 100);
            Scene::new(default_camera(size)?, worker.params()).render(&worker.pose_at(at))
        };
        if joints {
            mark(&mut picture, &truth);
        }
        sheet.copy_from(&picture, cell % COLUMNS * size[0], cell / COLUMNS * size[1])?;
    }
    sheet.save(file)?;
    Ok(())
}

/// Draws a dot per keypoint: green seen, red hidden.
fn mark(picture: &mut RgbImage, truth: &GroundTruth) {
    for keypoint in Keypoint::ALL {
        let Some(at) = truth.pixel(keypoint) else { continue };
        let seen = truth.visibility[keypoint.index()] == Visibility::Visible;
        let colour = if seen { Rgb([40, 255, 60]) } else { Rgb([255, 40, 40]) };
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let (x, y) = (at.x as u32 + dx, at.y as u32 + dy);
            if x < picture.width() && y < picture.height() {
                picture.put_pixel(x, y, colour);
            }
        }
    }
}
