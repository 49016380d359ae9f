"""Opens a recording with the reference Python reader and prints its topics.

    python mcap_check.py RUN.mcap

Needs `mcap` and `mcap-protobuf-support`. Every chunk's checksum is verified, every protobuf message is decoded with the schema in
the file, and the conventions of docs/recording.md that a viewer depends on are checked. Exit code 1 names what is wrong.
"""

import struct
import sys
from collections import Counter

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

FOXGLOVE = {
    "/joint_states": "foxglove.JointStates",
    "/setpoints": "foxglove.JointStates",
    "/targets": "foxglove.JointStates",
    "/tf": "foxglove.FrameTransforms",
    "/human/keypoints3d": "foxglove.PosesInFrame",
    "/human/keypoints": "ogg.Keypoints",
    "/metrics": "ogg.Metrics",
    "/log": "foxglove.Log",
    "/robot_description": "std_msgs/msg/String",
}
CAMERA = {"": "foxglove.CompressedImage", "calibration": "foxglove.CameraCalibration", "annotations": "foxglove.ImageAnnotations"}


def expected_schema(topic: str) -> str | None:
    if topic.startswith("/camera"):
        return CAMERA.get(topic.partition("/")[2].partition("/")[2])
    return FOXGLOVE.get(topic)


def check(path: str) -> list[str]:
    problems: list[str] = []
    counts: Counter[str] = Counter()
    schemas: dict[str, str] = {}
    factory = DecoderFactory()
    frames: set[str] = set()
    names: dict[str, list[str]] = {}
    with open(path, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        if summary is None or summary.statistics is None:
            return ["no summary section with statistics"]
        for schema, channel, message in reader.iter_messages():
            topic = channel.topic
            counts[topic] += 1
            schemas[topic] = schema.name
            if expected_schema(topic) not in (None, schema.name):
                problems.append(f"{topic}: expected {expected_schema(topic)}, got {schema.name}")
            if channel.message_encoding == "protobuf":
                decoded = factory.decoder_for("protobuf", schema)(message.data)
                if topic == "/tf":
                    frames.update(t.child_frame_id for t in decoded.transforms)
                elif schema.name == "foxglove.JointStates":
                    names.setdefault(topic, [joint.name for joint in decoded.joints])
                elif schema.name == "foxglove.CompressedImage" and bytes(decoded.data[:2]) != b"\xff\xd8":
                    problems.append(f"{topic}: expected a JPEG")
                elif schema.name == "foxglove.CameraCalibration" and (len(decoded.K), len(decoded.P)) != (9, 12):
                    problems.append(f"{topic}: expected K of 9 and P of 12 numbers")
            elif channel.message_encoding == "cdr":
                header, length = message.data[:4], struct.unpack("<I", message.data[4:8])[0]
                if header != b"\x00\x01\x00\x00" or len(message.data) != 8 + length or message.data[-1] != 0:
                    problems.append(f"{topic}: expected a little-endian CDR string")
            else:
                problems.append(f"{topic}: expected protobuf or cdr, got {channel.message_encoding}")
        if sum(counts.values()) != summary.statistics.message_count:
            problems.append(f"statistics say {summary.statistics.message_count} messages, read {sum(counts.values())}")
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        attachments = [f"{a.name} ({a.media_type}, {len(a.data)} bytes)" for a in reader.iter_attachments()]
        statistics = summary.statistics
    seconds = (statistics.message_end_time - statistics.message_start_time) / 1e9
    print(f"{path}: {statistics.message_count} messages in {statistics.chunk_count} chunks over {seconds:.3f} s")
    for topic in sorted(counts):
        print(f"  {topic:<28} {schemas[topic]:<28} {counts[topic]:>8}")
    for topic, joints in sorted(names.items()):
        print(f"  joints of {topic}: {', '.join(joints)}")
    if frames:
        print(f"  frames: {', '.join(sorted(frames))}")
    for name, facts in metadata.items():
        print(f"  metadata {name}: {facts}")
    for attachment in attachments:
        print(f"  attachment {attachment}")
    return sorted(set(problems))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    found = check(sys.argv[1])
    for problem in found:
        print(problem, file=sys.stderr)
    sys.exit(1 if found else 0)
