"""The joint protocol, judged by cantools reading the DBC file that the wheel brings."""

import math

import cantools
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ogg_rs
from ogg_rs import _native, can

ANGLE = st.one_of(st.floats(-6.28, 6.28), st.just(math.nan))
BYTE = st.integers(0, 255)
CAUSE = st.sampled_from([0, *can.CAUSES, 128, 255])
MILLISECONDS = st.integers(0, 255).map(lambda n: n / 1000)
MESSAGES = st.one_of(
    st.builds(can.Set, slot=st.integers(0, 2), angles_rad=st.tuples(ANGLE, ANGLE)),
    st.builds(can.Feedback, slot=st.integers(0, 2), angles_rad=st.tuples(ANGLE, ANGLE)),
    st.builds(
        can.Commit,
        position=st.booleans(),
        enable=st.booleans(),
        quick_stop=st.booleans(),
        reset=st.booleans(),
        test=st.booleans(),
        speed_scale=st.integers(0, 200).map(lambda n: n * 0.005),
        horizon_s=MILLISECONDS,
        host_time=st.integers(0, 65535),
    ),
    st.builds(
        can.Status,
        state=st.sampled_from(can.STATES),
        powered=st.booleans(),
        at_rest=st.booleans(),
        limiting=st.booleans(),
        set_dropped=st.booleans(),
        cause=CAUSE,
        echo=BYTE,
        echo_age_s=MILLISECONDS,
        tracking_error_rad=MILLISECONDS,
    ),
    st.builds(can.Stop, to_controller=st.booleans(), inverted=st.booleans(), cause=CAUSE, joint=BYTE),
    st.builds(can.Config, key=BYTE, value=st.integers(-(2**31), 2**31 - 1)),
    st.builds(can.ConfigReply, key=BYTE, value=st.integers(-(2**31), 2**31 - 1)),
    st.builds(can.Heartbeat, node_state=BYTE),
)


def test_the_dbc_file_is_the_protocols():
    assert can.DBC_PATH.read_text() == _native.dbc_text()
    assert {m.name for m in cantools.database.load_file(can.DBC_PATH).messages} >= {"SET_12", "COMMIT", "STATUS"}


@settings(max_examples=500, deadline=None)
@given(MESSAGES, BYTE, st.integers(0, 15))
def test_decoding_undoes_encoding(message, counter, robot):
    protocol = can.Protocol(robot)
    frame = protocol.encode(message, counter)
    back = protocol.decode(*frame)
    assert type(back.message) is type(message)
    assert back.counter == (0 if isinstance(message, can.Heartbeat) else counter)
    for name, value in vars(message).items():
        got = getattr(back.message, name)
        if name == "angles_rad":
            for a, b in zip(value, got, strict=True):
                assert (math.isnan(a) and math.isnan(b)) or abs(a - b) <= can.ANGLE_LSB_RAD / 2 + 1e-12
        else:
            assert got == pytest.approx(value) if isinstance(value, float) else got == value


def test_cantools_reads_the_same_angles():
    database = cantools.database.load_file(can.DBC_PATH)
    frame = can.Protocol().encode(can.Set(slot=0, angles_rad=(0.5, -1.25)), counter=9)
    signals = database.decode_message(frame.id, frame.data)
    assert signals["Joint1"] == pytest.approx(0.5, abs=can.ANGLE_LSB_RAD)
    assert signals["Joint2"] == pytest.approx(-1.25, abs=can.ANGLE_LSB_RAD)
    assert signals["Counter"] == 9


@settings(max_examples=300, deadline=None)
@given(MESSAGES.filter(lambda m: not isinstance(m, can.Heartbeat)), BYTE, st.integers(0, 63))
def test_a_flipped_bit_is_an_error_and_never_another_message(message, counter, bit):
    protocol = can.Protocol(2)
    identifier, data = protocol.encode(message, counter)
    damaged = bytearray(data)
    damaged[bit // 8] ^= 1 << bit % 8
    with pytest.raises(ogg_rs.InvalidParameter) as caught:
        protocol.decode(identifier, bytes(damaged))
    assert caught.value.kind == "CorruptFrame"


@settings(max_examples=1000, deadline=None)
@given(st.integers(0, 0x7FF), st.binary(max_size=8))
def test_any_frame_is_a_message_foreign_or_an_error(identifier, data):
    try:
        can.Protocol().decode(identifier, data)
    except ogg_rs.InvalidParameter as error:
        assert error.kind == "CorruptFrame"


@pytest.mark.parametrize(
    "message",
    [can.Set(slot=3, angles_rad=(0.0, 0.0)), can.Set(slot=0, angles_rad=(7.0, 0.0)), can.Set(slot=0, angles_rad=(0.0,)),
     can.Commit(speed_scale=1.5), can.Commit(horizon_s=-1.0), can.Commit(host_time=65536), can.Status(state="dozing"),
     can.Status(cause=40), can.Status(tracking_error_rad=math.inf), can.Config(key=256, value=0),
     can.Config(key=0, value=2**31), can.Stop(joint=-1), "stop"],
)  # fmt: skip
def test_what_the_wire_cannot_carry_is_refused(message):
    with pytest.raises(ogg_rs.InvalidParameter):
        can.Protocol().encode(message)


def test_identifiers_and_robots_out_of_range_are_refused():
    for call in (
        lambda: can.Protocol(16),
        lambda: can.Protocol().decode(0x800, b""),
        lambda: can.Protocol().decode(0x100, bytes(9)),
        lambda: can.crc16(65536, b""),
    ):
        with pytest.raises(ogg_rs.InvalidParameter):
            call()
    assert can.Protocol().decode(0x7FF, b"") is None


def test_a_candump_log_becomes_arrays(tmp_path):
    path = tmp_path / "candump.log"
    path.write_text("(1436509052.249713) can0 123#DEADBEEF\n(1436509052.349713) vcan1 7FF#\n\n(1.000000) can0 12345678#00\n")
    log = can.read_candump(path)
    assert log.interface == ["can0", "vcan1"] and log.id.tolist() == [0x123, 0x7FF] and log.length.tolist() == [4, 0]
    assert log.data.tolist() == [[0xDE, 0xAD, 0xBE, 0xEF, 0, 0, 0, 0], [0] * 8]
    assert log.time_s[1] - log.time_s[0] == pytest.approx(0.1, abs=1e-6)
    path.write_text("no log at all\n")
    with pytest.raises(ogg_rs.InvalidParameter, match="line 1") as caught:
        can.read_candump(path)
    assert caught.value.kind == "Candump"
    with pytest.raises(ogg_rs.DeviceError):
        can.read_candump(tmp_path / "absent.log")
