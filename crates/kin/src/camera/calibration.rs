//! Cameras from calibration files.
//!
//! | format | file | pose of the camera |
//! |---|---|---|
//! | Pose2Sim | `.toml` | `rotation` (Rodrigues) and `translation`, world to camera |
//! | ROS `camera_calibration` / `camera_info` | `.yaml`, `.yml` | none: place it with [`Calibration::placed`] |
//! | OpenCV `FileStorage` | `.yaml`, `.yml` beginning with `%YAML:1.0` or holding `!!opencv-matrix` | `rvec` and `tvec`, or `R` and `T`, if present |
//!
//! Distortion is OpenCV's vector in each of them. Fisheye models are refused.

use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use saphyr::{LoadableYamlNode, Scalar, Yaml};
use serde_json::Value;

use super::{Camera, Distortion, Intrinsics};
use crate::Error;

/// A camera as its calibration file describes it, perhaps without a place in `world`.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Name in the file.
    pub name: String,
    /// Image width and height (px).
    pub size_px: [u32; 2],
    /// Focal lengths and principal point.
    pub intrinsics: Intrinsics,
    /// Lens distortion.
    pub distortion: Distortion,
    /// Takes `world` coordinates to the optical frame, where the file says so.
    pub camera_from_world: Option<Isometry3<f64>>,
}

impl Calibration {
    /// The camera at a known place.
    pub fn placed(self, camera_from_world: Isometry3<f64>) -> Camera {
        Camera {
            name: self.name,
            size_px: self.size_px,
            intrinsics: self.intrinsics,
            distortion: self.distortion,
            camera_from_world,
        }
    }
}

/// A kind of calibration file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum CalibrationFormat {
    /// One table per camera.
    Pose2SimToml,
    /// One camera, without pose.
    RosYaml,
    /// One camera, with or without pose.
    OpenCvYaml,
}

impl CalibrationFormat {
    fn name(self) -> &'static str {
        match self {
            Self::Pose2SimToml => "Pose2Sim TOML",
            Self::RosYaml => "ROS camera_info YAML",
            Self::OpenCvYaml => "OpenCV YAML",
        }
    }
}

/// Reads every camera of a calibration file.
///
/// # Errors
/// [`Error::Read`], [`Error::CalibrationSyntax`], [`Error::Calibration`].
pub fn read_calibration(path: impl AsRef<Path>) -> Result<Vec<Calibration>, Error> {
    let path = path.as_ref();
    let text = std::fs::read_to_string(path).map_err(|source| Error::Read { path: path.to_owned(), source })?;
    let origin = path.display().to_string();
    let format = match path.extension().and_then(|extension| extension.to_str()) {
        Some("toml") => CalibrationFormat::Pose2SimToml,
        Some("yaml" | "yml") if text.contains("!!opencv-matrix") || text.starts_with("%YAML:") => {
            CalibrationFormat::OpenCvYaml
        }
        Some("yaml" | "yml") => CalibrationFormat::RosYaml,
        _ => {
            return Err(Error::CalibrationSyntax {
                origin,
                format: "Pose2Sim TOML, ROS YAML or OpenCV YAML",
                reason: "the file name ends in none of .toml, .yaml, .yml".to_owned(),
            });
        }
    };
    parse_calibration(&text, format, &origin)
}

/// Reads the cameras of a calibration file, each of which must have a place in `world`.
///
/// # Errors
/// As [`read_calibration`]; [`Error::Calibration`] for a camera without pose.
pub fn read_cameras(path: impl AsRef<Path>) -> Result<Vec<Camera>, Error> {
    let path = path.as_ref();
    read_calibration(path)?
        .into_iter()
        .map(|calibration| match calibration.camera_from_world {
            Some(camera_from_world) => Ok(calibration.placed(camera_from_world)),
            None => Err(Error::Calibration {
                origin: path.display().to_string(),
                key: format!("{}: rvec, tvec", calibration.name),
                expected: "the pose of the camera".to_owned(),
                got: "nothing".to_owned(),
            }),
        })
        .collect()
}

/// Reads every camera out of calibration text. `origin` names the text in errors.
///
/// # Errors
/// [`Error::CalibrationSyntax`], [`Error::Calibration`].
///
/// ```
/// use kin::{CalibrationFormat, parse_calibration};
/// let text = r#"
/// [left]
/// size = [640, 480]
/// matrix = [[600, 0, 320], [0, 600, 240], [0, 0, 1]]
/// distortions = [0, 0, 0, 0]
/// rotation = [0, 0, 0]
/// translation = [0, 0, 2]
/// fisheye = false
/// "#;
/// let cameras = parse_calibration(text, CalibrationFormat::Pose2SimToml, "example")?;
/// assert_eq!(cameras[0].intrinsics.fx_px, 600.0);
/// let spoilt = text.replace("translation = [0, 0, 2]", "translation = [0, 2]");
/// let error = parse_calibration(&spoilt, CalibrationFormat::Pose2SimToml, "example").unwrap_err();
/// assert_eq!(error.to_string(), "example: key `left.translation`: expected 3 numbers, got [0,2]");
/// # Ok::<(), kin::Error>(())
/// ```
pub fn parse_calibration(text: &str, format: CalibrationFormat, origin: &str) -> Result<Vec<Calibration>, Error> {
    let syntax = |reason: String| Error::CalibrationSyntax { origin: origin.to_owned(), format: format.name(), reason };
    let root = match format {
        CalibrationFormat::Pose2SimToml => toml::from_str(text).map_err(|error| syntax(error.to_string()))?,
        CalibrationFormat::RosYaml | CalibrationFormat::OpenCvYaml => yaml(text).map_err(syntax)?,
    };
    let root = Node { value: &root, key: String::new(), origin };
    let cameras = match format {
        CalibrationFormat::Pose2SimToml => pose2sim(&root)?,
        CalibrationFormat::RosYaml => vec![ros(&root)?],
        CalibrationFormat::OpenCvYaml => vec![opencv(&root)?],
    };
    if cameras.is_empty() {
        return Err(syntax("no camera in it".to_owned()));
    }
    Ok(cameras)
}

/// YAML as JSON; tags are dropped, and OpenCV's first line, which is not YAML, is skipped.
fn yaml(text: &str) -> Result<Value, String> {
    let body = text.strip_prefix("%YAML:").map_or(text, |rest| rest.split_once('\n').map_or("", |(_, body)| body));
    let documents = Yaml::load_from_str(body).map_err(|error| error.to_string())?;
    documents.first().map(json).ok_or_else(|| "the file is empty".to_owned())
}

fn json(yaml: &Yaml) -> Value {
    match yaml {
        Yaml::Tagged(_, inner) => json(inner),
        Yaml::Sequence(items) => Value::Array(items.iter().map(json).collect()),
        Yaml::Mapping(entries) => Value::Object(
            entries.iter().filter_map(|(key, value)| Some((key.as_str()?.to_owned(), json(value)))).collect(),
        ),
        Yaml::Value(Scalar::Boolean(value)) => Value::from(*value),
        Yaml::Value(Scalar::Integer(value)) => Value::from(*value),
        Yaml::Value(Scalar::FloatingPoint(value)) => Value::from(value.into_inner()),
        Yaml::Value(Scalar::String(value)) => Value::from(value.as_ref()),
        Yaml::Representation(text, ..) => Value::from(text.as_ref()),
        Yaml::Value(Scalar::Null) | Yaml::Alias(_) | Yaml::BadValue => Value::Null,
    }
}

/// A place in the document that knows its key, so that every complaint can name it.
struct Node<'a> {
    value: &'a Value,
    key: String,
    origin: &'a str,
}

impl<'a> Node<'a> {
    fn refuse(&self, expected: impl Into<String>) -> Error {
        let mut got = if self.value.is_null() { "nothing".to_owned() } else { self.value.to_string() };
        if got.len() > 120 {
            got.truncate(got.floor_char_boundary(120));
            got.push_str(" ...");
        }
        Error::Calibration { origin: self.origin.to_owned(), key: self.key.clone(), expected: expected.into(), got }
    }

    /// The first of these keys that is present; else a null node named after the first.
    fn any(&self, keys: &[&str]) -> Node<'a> {
        let key = keys.iter().find(|key| self.value.get(**key).is_some()).unwrap_or(&keys[0]);
        let path = if self.key.is_empty() { (*key).to_owned() } else { format!("{}.{key}", self.key) };
        Node { value: self.value.get(*key).unwrap_or(&Value::Null), key: path, origin: self.origin }
    }

    fn get(&self, key: &str) -> Node<'a> {
        self.any(&[key])
    }

    fn optional(self) -> Option<Self> {
        (!self.value.is_null()).then_some(self)
    }

    fn text(&self) -> Option<String> {
        self.value.as_str().map(str::to_owned)
    }

    /// Numbers of a list, of a list of lists row by row, or of `{rows, cols, data}`.
    fn numbers(&self, what: &str, allowed: impl Fn(usize) -> bool) -> Result<Vec<f64>, Error> {
        fn collect(value: &Value, numbers: &mut Vec<f64>) -> Option<()> {
            match value {
                Value::Array(items) => items.iter().try_for_each(|item| collect(item, numbers)),
                other => {
                    numbers.push(other.as_f64().filter(|number| number.is_finite())?);
                    Some(())
                }
            }
        }
        let list = self.value.get("data").unwrap_or(self.value);
        let mut numbers = Vec::new();
        let complete = list.is_array() && collect(list, &mut numbers).is_some();
        if complete && allowed(numbers.len()) { Ok(numbers) } else { Err(self.refuse(what)) }
    }

    fn exactly<const N: usize>(&self, what: &str) -> Result<[f64; N], Error> {
        let numbers = self.numbers(what, |count| count == N)?;
        Ok(std::array::from_fn(|i| numbers[i]))
    }

    fn pixels(&self) -> Result<u32, Error> {
        self.value
            .as_f64()
            .filter(|&value| (1.0..=1e6).contains(&value) && value.fract() == 0.0)
            .map(|value| value as u32)
            .ok_or_else(|| self.refuse("a whole number of pixels >= 1"))
    }

    fn intrinsics(&self) -> Result<Intrinsics, Error> {
        let k: [f64; 9] = self.exactly("a 3x3 matrix")?;
        let zero_one = k[3] == 0.0 && k[6] == 0.0 && k[7] == 0.0 && (k[8] - 1.0).abs() < 1e-12;
        if !(zero_one && k[0] > 0.0 && k[4] > 0.0) {
            return Err(self.refuse("[[fx, skew, cx], [0, fy, cy], [0, 0, 1]] with fx, fy > 0"));
        }
        Ok(Intrinsics { fx_px: k[0], skew_px: k[1], cx_px: k[2], fy_px: k[4], cy_px: k[5] })
    }

    fn distortion(&self) -> Result<Distortion, Error> {
        let what = "0, 4, 5 or 8 numbers k1 k2 p1 p2 [k3 [k4 k5 k6]]";
        let values = self.numbers(what, |_| true)?;
        Distortion::from_opencv(&values).ok_or_else(|| self.refuse(what))
    }

    /// Three numbers (Rodrigues) or a 3x3 rotation matrix.
    fn rotation(&self) -> Result<UnitQuaternion<f64>, Error> {
        let what = "3 numbers (Rodrigues) or a 3x3 rotation matrix";
        let values = self.numbers(what, |count| count == 3 || count == 9)?;
        if values.len() == 3 {
            return Ok(UnitQuaternion::from_scaled_axis(Vector3::new(values[0], values[1], values[2])));
        }
        let matrix = Matrix3::from_row_slice(&values);
        // Published matrices carry six digits or more.
        let off = (matrix * matrix.transpose() - Matrix3::identity()).norm();
        if !(off < 1e-4 && matrix.determinant() > 0.0) {
            return Err(self.refuse("a rotation matrix (orthonormal, determinant +1)"));
        }
        Ok(UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&matrix)))
    }

    fn translation(&self) -> Result<Translation3<f64>, Error> {
        let [x, y, z] = self.exactly("3 numbers")?;
        Ok(Translation3::new(x, y, z))
    }
}

fn pose2sim(root: &Node) -> Result<Vec<Calibration>, Error> {
    let tables = root.value.as_object().ok_or_else(|| root.refuse("one table per camera"))?;
    let mut cameras = Vec::with_capacity(tables.len());
    for (name, _) in tables.iter().filter(|(name, _)| name.as_str() != "metadata") {
        let table = root.get(name);
        if !table.value.is_object() {
            return Err(table.refuse("a table with matrix, distortions, rotation, translation, size"));
        }
        if table.get("fisheye").value.as_bool().unwrap_or(false) {
            return Err(table.get("fisheye").refuse("false (fisheye lenses are not supported)"));
        }
        let size: [f64; 2] = table.get("size").exactly("2 numbers")?;
        if !size.iter().all(|side| (1.0..=1e6).contains(side)) {
            return Err(table.get("size").refuse("width and height in pixels, each >= 1"));
        }
        let rotation: [f64; 3] = table.get("rotation").exactly("3 numbers (Rodrigues)")?;
        cameras.push(Calibration {
            name: table.get("name").text().unwrap_or_else(|| name.clone()),
            size_px: size.map(|side| side.round() as u32),
            intrinsics: table.get("matrix").intrinsics()?,
            distortion: table.get("distortions").distortion()?,
            camera_from_world: Some(Isometry3::from_parts(
                table.get("translation").translation()?,
                UnitQuaternion::from_scaled_axis(Vector3::from(rotation)),
            )),
        });
    }
    Ok(cameras)
}

fn ros(root: &Node) -> Result<Calibration, Error> {
    let model = root.get("distortion_model");
    if let Some(name) = model.text()
        && !matches!(name.as_str(), "plumb_bob" | "rational_polynomial" | "")
    {
        return Err(model.refuse("plumb_bob or rational_polynomial"));
    }
    Ok(Calibration {
        name: root.get("camera_name").text().unwrap_or_else(|| "camera".to_owned()),
        size_px: [root.any(&["image_width", "width"]).pixels()?, root.any(&["image_height", "height"]).pixels()?],
        intrinsics: root.any(&["camera_matrix", "k", "K"]).intrinsics()?,
        distortion: root.any(&["distortion_coefficients", "d", "D"]).distortion()?,
        camera_from_world: None,
    })
}

fn opencv(root: &Node) -> Result<Calibration, Error> {
    let rotation = root.any(&["rvec", "R", "rotation"]).optional();
    let translation = root.any(&["tvec", "T", "translation"]).optional();
    let camera_from_world = match (rotation, translation) {
        (None, None) => None,
        (Some(rotation), Some(translation)) => {
            Some(Isometry3::from_parts(translation.translation()?, rotation.rotation()?))
        }
        (Some(_), None) => return Err(root.get("tvec").refuse("3 numbers, because there is a rotation")),
        (None, Some(_)) => return Err(root.get("rvec").refuse("a rotation, because there is a translation")),
    };
    Ok(Calibration {
        name: root.any(&["camera_name", "name"]).text().unwrap_or_else(|| "camera".to_owned()),
        size_px: [
            root.any(&["image_width", "imageWidth", "width"]).pixels()?,
            root.any(&["image_height", "imageHeight", "height"]).pixels()?,
        ],
        intrinsics: root.any(&["camera_matrix", "cameraMatrix", "Camera_Matrix", "K"]).intrinsics()?,
        distortion: root
            .any(&["distortion_coefficients", "distCoeffs", "dist_coeffs", "Distortion_Coefficients", "D"])
            .distortion()?,
        camera_from_world,
    })
}
