//! A directory of JPEG and PNG files as a video.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use super::{Error, Frame, Source, SourceInfo};

/// The pictures of one directory, in order of file name, at a constant rate.
///
/// Names are compared with runs of digits as numbers, so `frame_2.png` comes before `frame_10.png`.
#[derive(Debug)]
pub struct ImageDirectory {
    files: Vec<PathBuf>,
    info: SourceInfo,
    rate_hz: f64,
    camera: usize,
    next: usize,
}

impl ImageDirectory {
    /// Lists the directory and reads the size of its first picture.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] unless `rate_hz` is positive and finite, [`Error::Read`], [`Error::NoImages`],
    /// [`Error::Image`].
    pub fn open(path: &Path, rate_hz: f64, camera: usize) -> Result<Self, Error> {
        if !(rate_hz > 0.0 && rate_hz.is_finite()) {
            return Err(Error::Parameter {
                field: "image_rate_hz",
                expected: "a positive rate",
                got: rate_hz.to_string(),
            });
        }
        let read = |source| Error::Read { path: path.to_owned(), source };
        let mut files = Vec::new();
        let mut entries = 0;
        for entry in std::fs::read_dir(path).map_err(read)? {
            let file = entry.map_err(read)?.path();
            entries += 1;
            if is_picture(&file) {
                files.push(file);
            }
        }
        files.sort_by_cached_key(|file| sort_key(file));
        let Some(first) = files.first() else {
            return Err(Error::NoImages { path: path.to_owned(), entries });
        };
        let (width, height) =
            image::image_dimensions(first).map_err(|source| Error::Image { path: first.clone(), source })?;
        let info = SourceInfo {
            name: path.display().to_string(),
            width,
            height,
            rate_hz: Some(rate_hz),
            frames: Some(files.len() as u64),
            decoder: "image files".to_owned(),
            live: false,
        };
        Ok(Self { files, info, rate_hz, camera, next: 0 })
    }
}

impl Source for ImageDirectory {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn next_frame(&mut self) -> Result<Option<Frame>, Error> {
        let Some(file) = self.files.get(self.next) else { return Ok(None) };
        let sequence = self.next as u64;
        let image = image::open(file)
            .map_err(|source| Error::Image { path: file.clone(), source })
            .map(image::DynamicImage::into_rgb8);
        let (file, expected) = (file.clone(), (self.info.width, self.info.height));
        self.next = if image.is_ok() { self.next + 1 } else { self.files.len() };
        let image = image?;
        if image.dimensions() != expected {
            self.next = self.files.len();
            return Err(Error::SizeChanged { path: file, frame: sequence, expected, got: image.dimensions() });
        }
        let captured = Duration::try_from_secs_f64(sequence as f64 / self.rate_hz).unwrap_or(Duration::MAX);
        Ok(Some(Frame { image: Arc::new(image), captured, media_time: captured, sequence, camera: self.camera }))
    }
}

fn is_picture(path: &Path) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    ["jpg", "jpeg", "png"].iter().any(|known| extension.eq_ignore_ascii_case(known)) && path.is_file()
}

/// Splits a name into text and numbers; a number of any length compares by its digits.
fn sort_key(path: &Path) -> Vec<(String, usize, String)> {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let mut key = Vec::new();
    let mut rest = name.as_str();
    while !rest.is_empty() {
        let text_end = rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len());
        let (text, tail) = rest.split_at(text_end);
        let digits_end = tail.find(|c: char| !c.is_ascii_digit()).unwrap_or(tail.len());
        let (digits, tail) = tail.split_at(digits_end);
        let digits = digits.trim_start_matches('0');
        key.push((text.to_owned(), digits.len(), digits.to_owned()));
        rest = tail;
    }
    // Equal numbers with different zeros ("1", "01") still need one fixed order.
    key.push((name, 0, String::new()));
    key
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;

    fn grey(value: u8) -> RgbImage {
        RgbImage::from_pixel(6, 4, Rgb([value; 3]))
    }

    #[test]
    fn pictures_come_in_numeric_order_of_name_with_times_from_the_rate() {
        let folder = tempfile::tempdir().unwrap();
        for (name, value) in [("f10.png", 30), ("f2.png", 20), ("f1.PNG", 10), ("notes.txt.png.bak", 0)] {
            grey(value).save_with_format(folder.path().join(name), image::ImageFormat::Png).unwrap();
        }
        let mut source = ImageDirectory::open(folder.path(), 4.0, 3).unwrap();
        assert_eq!(source.info().frames, Some(3));
        let mut seen = Vec::new();
        while let Some(frame) = source.next_frame().unwrap() {
            seen.push((frame.image.get_pixel(0, 0).0[0], frame.captured.as_millis(), frame.camera));
        }
        assert_eq!(seen, [(10, 0, 3), (20, 250, 3), (30, 500, 3)]);
    }

    #[test]
    fn a_directory_without_pictures_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.txt"), b"x").unwrap();
        let message = ImageDirectory::open(folder.path(), 30.0, 0).unwrap_err().to_string();
        assert!(message.ends_with("expected at least one .jpg, .jpeg or .png file, got 1 other entries"), "{message}");
    }

    #[test]
    fn a_rate_that_is_not_a_number_is_refused() {
        let message = ImageDirectory::open(Path::new("."), f64::NAN, 0).unwrap_err().to_string();
        assert_eq!(message, "image_rate_hz: expected a positive rate, got NaN");
    }

    #[test]
    fn a_picture_of_another_size_ends_the_source_with_an_error() {
        let folder = tempfile::tempdir().unwrap();
        grey(1).save(folder.path().join("a.png")).unwrap();
        RgbImage::new(5, 4).save(folder.path().join("b.png")).unwrap();
        let mut source = ImageDirectory::open(folder.path(), 30.0, 0).unwrap();
        assert!(source.next_frame().unwrap().is_some());
        let message = source.next_frame().unwrap_err().to_string();
        assert!(message.ends_with("frame 1: expected 6 x 4 pixels as before, got 5 x 4"), "{message}");
        assert!(source.next_frame().unwrap().is_none());
    }

    #[test]
    fn a_damaged_picture_names_its_file() {
        let folder = tempfile::tempdir().unwrap();
        grey(1).save(folder.path().join("a.png")).unwrap();
        std::fs::write(folder.path().join("b.png"), b"\x89PNG\r\n\x1a\nbroken").unwrap();
        let mut source = ImageDirectory::open(folder.path(), 30.0, 0).unwrap();
        assert!(source.next_frame().unwrap().is_some());
        let message = source.next_frame().unwrap_err().to_string();
        assert!(message.contains("b.png: expected a JPEG or PNG picture"), "{message}");
    }
}
