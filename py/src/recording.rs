//! Recordings of runs, topic by topic.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use foxglove::messages::{CompressedImage, FrameTransforms, Log};
use mcap::MessageStream;
use mcap::read::Options;
use numpy::{PyArray1, PyArray2};
use ogg::record::{JointRecord, KeypointState};
use prost::Message;
use pyo3::prelude::*;

use crate::array::{moved, moved2};
use crate::failure::Failure;

/// Times, then values.
type Times<'py> = Bound<'py, PyArray1<u64>>;
type Numbers<'py> = Bound<'py, PyArray2<f64>>;

/// What a recording holds, without pictures.
#[pyclass(frozen, module = "ogg_rs._native")]
pub(crate) struct Recording {
    path: PathBuf,
    inner: ogg::record::Recording,
}

/// A metric as `ogg.Metrics` has it.
#[derive(Clone, PartialEq, Message)]
struct Metric {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(double, tag = "2")]
    value: f64,
    #[prost(string, tag = "3")]
    unit: String,
}

#[derive(Clone, PartialEq, Message)]
struct Metrics {
    #[prost(message, repeated, tag = "1")]
    metrics: Vec<Metric>,
}

fn not_mcap(path: &Path, message: impl ToString) -> Failure {
    ogg::record::Error::NotMcap { path: path.to_owned(), message: message.to_string() }.into()
}

impl Recording {
    /// Calls `take` with time and bytes of each message of a topic, as many as [`ogg::record::open`] vouches for.
    fn each(&self, topic: &str, mut take: impl FnMut(u64, Cow<'_, [u8]>) -> Result<(), String>) -> Result<(), Failure> {
        let Some(known) = self.inner.topics.iter().find(|t| t.name == topic) else {
            return Err(Failure::Argument {
                what: "topic",
                expected: format!("one of {:?}", self.inner.topics.iter().map(|t| &t.name).collect::<Vec<_>>()),
                got: format!("{topic:?}"),
            });
        };
        let bytes = std::fs::read(&self.path).map_err(|source| Failure::File { path: self.path.clone(), source })?;
        let options = Options::IgnoreEndMagic | Options::ValidateChunkCrcs;
        let stream = MessageStream::new_with_options(&bytes, options).map_err(|e| not_mcap(&self.path, e))?;
        let mut left = known.messages;
        for message in stream {
            if left == 0 {
                break;
            }
            let message = message.map_err(|e| not_mcap(&self.path, e))?;
            if message.channel.topic == topic {
                take(message.log_time, message.data).map_err(|e| not_mcap(&self.path, format!("{topic}: {e}")))?;
                left -= 1;
            }
        }
        Ok(())
    }

    fn joints(&self, stream: &str) -> Result<&[JointRecord], Failure> {
        match stream {
            "joint_states" => Ok(&self.inner.joint_states),
            "setpoints" => Ok(&self.inner.setpoints),
            "targets" => Ok(&self.inner.targets),
            _ => Err(Failure::Argument {
                what: "stream",
                expected: "'joint_states', 'setpoints' or 'targets'".to_owned(),
                got: format!("{stream:?}"),
            }),
        }
    }
}

#[pymethods]
impl Recording {
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let inner = py.detach(|| ogg::record::open(&path)).map_err(Failure::from)?;
        Ok(Self { path, inner })
    }

    #[getter]
    fn facts(&self) -> BTreeMap<String, String> {
        self.inner.facts.clone()
    }

    /// Name, schema, encoding and number of messages.
    #[getter]
    fn topics(&self) -> Vec<(String, String, String, u64)> {
        let row = |t: &ogg::record::Topic| (t.name.clone(), t.schema.clone(), t.encoding.clone(), t.messages);
        self.inner.topics.iter().map(row).collect()
    }

    #[getter]
    fn attachments(&self) -> BTreeMap<String, Cow<'_, [u8]>> {
        self.inner.attachments.iter().map(|(name, bytes)| (name.clone(), Cow::Borrowed(bytes.as_slice()))).collect()
    }

    #[getter]
    fn cut(&self) -> Option<String> {
        self.inner.cut.clone()
    }

    #[getter]
    fn time_range_ns(&self) -> Option<(u64, u64)> {
        self.inner.time_range_ns
    }

    /// Times `(m)`, joint names, and for each quantity a table `(m, n)`; NaN where a message does not say.
    fn joint_table<'py>(
        &self,
        py: Python<'py>,
        stream: &str,
    ) -> PyResult<(Times<'py>, Vec<String>, BTreeMap<&'static str, Numbers<'py>>)> {
        let records = self.joints(stream)?;
        let mut names: Vec<String> = Vec::new();
        for joint in records.iter().flat_map(|r| &r.joints) {
            if !names.contains(&joint.name) {
                names.push(joint.name.clone());
            }
        }
        let shape = [records.len(), names.len()];
        let mut tables = BTreeMap::new();
        for quantity in ["position", "velocity", "acceleration", "effort"] {
            let mut numbers = Vec::with_capacity(shape[0] * shape[1]);
            for record in records {
                // By name, never by place.
                numbers.extend(names.iter().map(|name| {
                    let joint = record.joints.iter().find(|joint| joint.name == *name);
                    let value = joint.and_then(|joint| match quantity {
                        "position" => joint.position,
                        "velocity" => joint.velocity,
                        "acceleration" => joint.acceleration,
                        _ => joint.effort,
                    });
                    value.unwrap_or(f64::NAN)
                }));
            }
            tables.insert(quantity, moved2(py, numbers, shape)?);
        }
        Ok((moved(py, records.iter().map(|r| r.time_ns).collect()), names, tables))
    }

    /// Times `(m)`, names `n`, per row and name x, y, z and the nine numbers of the covariance `(m, 12 n)`, and the state
    /// (0 lost, 1 inferred, 2 measured) `(m, n)`.
    fn keypoint_table<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Times<'py>, Vec<String>, Numbers<'py>, Bound<'py, PyArray2<u8>>)> {
        let records = &self.inner.keypoints;
        let mut names: Vec<String> = Vec::new();
        for point in records.iter().flat_map(|r| &r.points) {
            if !names.contains(&point.name) {
                names.push(point.name.clone());
            }
        }
        let mut numbers = Vec::with_capacity(12 * records.len() * names.len());
        let mut states = Vec::with_capacity(records.len() * names.len());
        for record in records {
            for name in &names {
                let point = record.points.iter().find(|p| p.name == *name);
                let place = point.filter(|p| p.state != KeypointState::Lost);
                numbers.extend(place.map_or([f64::NAN; 3], |p| p.position_m));
                numbers.extend(place.and_then(|p| p.covariance_m2).unwrap_or([f64::NAN; 9]));
                states.push(match point.map(|p| p.state) {
                    Some(KeypointState::Measured) => 2_u8,
                    Some(KeypointState::Inferred) => 1,
                    Some(KeypointState::Lost) | None => 0,
                });
            }
        }
        Ok((
            moved(py, records.iter().map(|r| r.time_ns).collect()),
            names.clone(),
            moved2(py, numbers, [records.len(), 12 * names.len()])?,
            moved2(py, states, [records.len(), names.len()])?,
        ))
    }

    /// One row per metric: times, names, values, units.
    fn metrics<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Times<'py>, Vec<String>, Bound<'py, PyArray1<f64>>, Vec<String>)> {
        let mut rows = Vec::new();
        py.detach(|| {
            self.each("/metrics", |time, data| {
                let message = Metrics::decode(&*data).map_err(|e| e.to_string())?;
                rows.extend(message.metrics.into_iter().map(|metric| (time, metric)));
                Ok(())
            })
        })?;
        Ok((
            moved(py, rows.iter().map(|(t, _)| *t).collect()),
            rows.iter().map(|(_, m)| m.name.clone()).collect(),
            moved(py, rows.iter().map(|(_, m)| m.value).collect()),
            rows.iter().map(|(_, m)| m.unit.clone()).collect(),
        ))
    }

    /// One row per line: times, level, part of the program, text.
    fn log<'py>(&self, py: Python<'py>) -> PyResult<(Times<'py>, Vec<u8>, Vec<String>, Vec<String>)> {
        let mut rows = Vec::new();
        py.detach(|| {
            self.each("/log", |time, data| {
                rows.push((time, Log::decode(&*data).map_err(|e| e.to_string())?));
                Ok(())
            })
        })?;
        Ok((
            moved(py, rows.iter().map(|(t, _)| *t).collect()),
            rows.iter().map(|(_, m)| u8::try_from(m.level).unwrap_or(0)).collect(),
            rows.iter().map(|(_, m)| m.name.clone()).collect(),
            rows.iter().map(|(_, m)| m.message.clone()).collect(),
        ))
    }

    /// One row per pose: times, parent, child, x, y, z and the quaternion x, y, z, w `(m, 7)`.
    fn transforms<'py>(&self, py: Python<'py>) -> PyResult<(Times<'py>, Vec<String>, Vec<String>, Numbers<'py>)> {
        let mut rows = Vec::new();
        py.detach(|| {
            self.each("/tf", |time, data| {
                let message = FrameTransforms::decode(&*data).map_err(|e| e.to_string())?;
                rows.extend(message.transforms.into_iter().map(|pose| (time, pose)));
                Ok(())
            })
        })?;
        let numbers = rows.iter().flat_map(|(_, pose)| {
            let t = pose.translation.map_or([f64::NAN; 3], |t| [t.x, t.y, t.z]);
            let r = pose.rotation.map_or([f64::NAN; 4], |r| [r.x, r.y, r.z, r.w]);
            t.into_iter().chain(r)
        });
        let numbers = moved2(py, numbers.collect(), [rows.len(), 7])?;
        Ok((
            moved(py, rows.iter().map(|(t, _)| *t).collect()),
            rows.iter().map(|(_, m)| m.parent_frame_id.clone()).collect(),
            rows.iter().map(|(_, m)| m.child_frame_id.clone()).collect(),
            numbers,
        ))
    }

    /// Times and JPEG files of a picture topic.
    fn pictures<'py>(&self, py: Python<'py>, topic: &str) -> PyResult<(Times<'py>, Vec<Cow<'static, [u8]>>)> {
        let mut rows = Vec::new();
        py.detach(|| {
            self.each(topic, |time, data| {
                let message = CompressedImage::decode(&*data).map_err(|e| e.to_string())?;
                rows.push((time, message.data.to_vec()));
                Ok(())
            })
        })?;
        let times = moved(py, rows.iter().map(|(t, _)| *t).collect());
        Ok((times, rows.into_iter().map(|(_, jpeg)| Cow::Owned(jpeg)).collect()))
    }
}
