//! Messages that Foxglove's well-known types do not cover, and the ROS 2 string.
//!
//! `ogg.Metrics` and `ogg.Keypoints` are protobuf with their own descriptors, which both viewers unfold into fields; JSON is left out
//! because Rerun does not decode it. The robot description is `std_msgs/msg/String` in CDR, the only type that both viewers
//! take a URDF from.

use prost::Message;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet};

/// A named number.
#[derive(Clone, PartialEq, Message)]
pub(super) struct MetricMessage {
    #[prost(string, tag = "1")]
    pub(super) name: String,
    #[prost(double, tag = "2")]
    pub(super) value: f64,
    #[prost(string, tag = "3")]
    pub(super) unit: String,
}

/// `ogg.Metrics`.
#[derive(Clone, PartialEq, Message)]
pub(super) struct MetricsMessage {
    #[prost(message, repeated, tag = "1")]
    pub(super) metrics: Vec<MetricMessage>,
}

/// A named point with its uncertainty.
#[derive(Clone, PartialEq, Message)]
pub(super) struct KeypointMessage {
    #[prost(string, tag = "1")]
    pub(super) name: String,
    /// `measured`, `inferred` or `lost`.
    #[prost(string, tag = "2")]
    pub(super) state: String,
    #[prost(double, tag = "3")]
    pub(super) x: f64,
    #[prost(double, tag = "4")]
    pub(super) y: f64,
    #[prost(double, tag = "5")]
    pub(super) z: f64,
    /// Row-major 3x3 in square metres, or empty.
    #[prost(double, repeated, tag = "6")]
    pub(super) covariance: Vec<f64>,
}

/// `ogg.Keypoints`.
#[derive(Clone, PartialEq, Message)]
pub(super) struct KeypointsMessage {
    #[prost(string, tag = "1")]
    pub(super) frame_id: String,
    #[prost(message, repeated, tag = "2")]
    pub(super) keypoints: Vec<KeypointMessage>,
}

fn field(name: &str, number: i32, label: Label, kind: Type, of: Option<&str>) -> FieldDescriptorProto {
    FieldDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(number),
        label: Some(label as i32),
        r#type: Some(kind as i32),
        type_name: of.map(str::to_owned),
        json_name: Some(name.to_owned()),
        ..FieldDescriptorProto::default()
    }
}

fn message(name: &str, field: Vec<FieldDescriptorProto>) -> DescriptorProto {
    DescriptorProto { name: Some(name.to_owned()), field, ..DescriptorProto::default() }
}

fn descriptor_set(file: &str, message_type: Vec<DescriptorProto>) -> Vec<u8> {
    let file = FileDescriptorProto {
        name: Some(file.to_owned()),
        package: Some("ogg".to_owned()),
        syntax: Some("proto3".to_owned()),
        message_type,
        ..FileDescriptorProto::default()
    };
    FileDescriptorSet { file: vec![file] }.encode_to_vec()
}

/// Descriptor of `ogg.Metrics`.
pub(super) fn metrics_schema() -> Vec<u8> {
    let one = Label::Optional;
    descriptor_set(
        "ogg/metrics.proto",
        vec![
            message(
                "Metric",
                vec![
                    field("name", 1, one, Type::String, None),
                    field("value", 2, one, Type::Double, None),
                    field("unit", 3, one, Type::String, None),
                ],
            ),
            message("Metrics", vec![field("metrics", 1, Label::Repeated, Type::Message, Some(".ogg.Metric"))]),
        ],
    )
}

/// Descriptor of `ogg.Keypoints`.
pub(super) fn keypoints_schema() -> Vec<u8> {
    let one = Label::Optional;
    descriptor_set(
        "ogg/keypoints.proto",
        vec![
            message(
                "Keypoint",
                vec![
                    field("name", 1, one, Type::String, None),
                    field("state", 2, one, Type::String, None),
                    field("x", 3, one, Type::Double, None),
                    field("y", 4, one, Type::Double, None),
                    field("z", 5, one, Type::Double, None),
                    field("covariance", 6, Label::Repeated, Type::Double, None),
                ],
            ),
            message(
                "Keypoints",
                vec![
                    field("frame_id", 1, one, Type::String, None),
                    field("keypoints", 2, Label::Repeated, Type::Message, Some(".ogg.Keypoint")),
                ],
            ),
        ],
    )
}

/// `std_msgs/msg/String` in CDR: encapsulation header (version 1, little-endian), length with the closing NUL, text, NUL.
pub(super) fn cdr_string(text: &str) -> Vec<u8> {
    let length = u32::try_from(text.len() + 1).unwrap_or(u32::MAX);
    let mut out = Vec::with_capacity(text.len() + 9);
    out.extend_from_slice(&[0, 1, 0, 0]);
    out.extend_from_slice(&length.to_le_bytes());
    out.extend_from_slice(text.as_bytes());
    out.push(0);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cdr_string_has_header_length_text_and_nul() {
        assert_eq!(cdr_string("ab"), [0, 1, 0, 0, 3, 0, 0, 0, b'a', b'b', 0]);
    }
}
