"""The bus as python-can and cantools see it.

decode DBC LOG      one JSON line per frame of a candump log: its message and signals
encode DBC          candump lines of valid frames of every message, checksums made here
listen DBC IF S     reads an interface for S seconds and reports what it saw
echo IF S           answers identifier 0x500 with 0x501, for round-trip times
speed IF N          round trips and one-way sends with python-can, as JSON
"""

import json
import random
import sys
import time

DATA_ID_SLOT = {
    "HOST_STOP": 0x00, "HOST_STOP_INVERTED": 0x01, "SET_12": 0x02, "SET_34": 0x03, "SET_56": 0x04,
    "COMMIT": 0x05, "CONFIG": 0x06, "CTRL_STOP": 0x80, "CTRL_STOP_INVERTED": 0x81, "FB_12": 0x82,
    "FB_34": 0x83, "FB_56": 0x84, "STATUS": 0x85, "CONFIG_REPLY": 0x86,
}
VERSION = 1


def crc16(data):
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = ((crc << 1) ^ 0x3D65 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def decode(dbc, log):
    import cantools

    db = cantools.database.load_file(dbc)
    for line in open(log):
        identifier, data = line.split()[2].split("#")
        message = db.get_message_by_frame_id(int(identifier, 16))
        signals = message.decode(bytes.fromhex(data), decode_choices=False)
        print(json.dumps({"message": message.name, "signals": signals}))


def encode(dbc):
    import cantools

    rng = random.Random(1)
    db = cantools.database.load_file(dbc)
    for message in db.messages:
        for _ in range(50):
            values = {}
            for signal in message.signals:
                if signal.choices:
                    raw = rng.choice(sorted(signal.choices))
                    values[signal.name] = raw * signal.scale + signal.offset
                elif signal.name in ("Zero", "Crc"):
                    values[signal.name] = 0
                else:
                    low, high = signal.minimum, signal.maximum
                    steps = int((high - low) / abs(signal.scale))
                    values[signal.name] = low + rng.randint(0, steps) * abs(signal.scale)
                    if signal.scale == 1:
                        values[signal.name] = int(values[signal.name])
            # A value's name stands for its physical value, so that the inverted messages come out right.
            if message.name.endswith("INVERTED"):
                values["Cause"] = rng.choice([0, 1, 9, 64, 200])
            data = bytearray(message.encode(values, strict=False))
            if message.name in DATA_ID_SLOT:
                flip = 0xFF if message.name.endswith("INVERTED") else 0x00
                plain = bytes(b ^ flip for b in data[:6])
                data_id = VERSION << 12 | DATA_ID_SLOT[message.name]
                crc = crc16(data_id.to_bytes(2, "big") + plain)
                data[6:] = bytes(b ^ flip for b in crc.to_bytes(2, "big"))
            print(f"(0.000000) vcan0 {message.frame_id:03X}#{data.hex().upper()}")


def listen(dbc, interface, seconds):
    import can
    import cantools

    db = cantools.database.load_file(dbc)
    report = {"frames": 0, "undecodable": 0, "states": [], "joint1_min": 1e9, "joint1_max": -1e9}
    end = time.monotonic() + float(seconds)
    with can.Bus(interface="socketcan", channel=interface) as bus:
        while time.monotonic() < end:
            frame = bus.recv(0.1)
            if frame is None:
                continue
            report["frames"] += 1
            try:
                signals = db.decode_message(frame.arbitration_id, frame.data)
            except Exception:
                report["undecodable"] += 1
                continue
            if "State" in signals and str(signals["State"]) not in report["states"]:
                report["states"].append(str(signals["State"]))
            if frame.arbitration_id == 0x180:
                report["joint1_min"] = min(report["joint1_min"], signals["Joint1"])
                report["joint1_max"] = max(report["joint1_max"], signals["Joint1"])
    print(json.dumps(report))


def echo(interface, seconds):
    import can

    end = time.monotonic() + float(seconds)
    with can.Bus(interface="socketcan", channel=interface, can_filters=[{"can_id": 0x500, "can_mask": 0x7FF}]) as bus:
        print("ready", flush=True)
        while time.monotonic() < end:
            frame = bus.recv(0.05)
            if frame is not None:
                bus.send(can.Message(arbitration_id=0x501, data=frame.data, is_extended_id=False))


def speed(interface, count):
    import can

    count = int(count)
    filters = [{"can_id": 0x501, "can_mask": 0x7FF}]
    with can.Bus(interface="socketcan", channel=interface, can_filters=filters) as bus:
        trips = []
        for k in range(count):
            message = can.Message(arbitration_id=0x500, data=k.to_bytes(8, "little"), is_extended_id=False)
            begin = time.perf_counter()
            bus.send(message)
            answer = bus.recv(1.0)
            trips.append((time.perf_counter() - begin) * 1e6)
            assert answer is not None and bytes(answer.data) == bytes(message.data)
    with can.Bus(interface="socketcan", channel=interface) as sender, \
            can.Bus(interface="socketcan", channel=interface) as receiver:
        begin = time.perf_counter()
        received = 0
        for k in range(0, count, 50):
            for i in range(50):
                sender.send(can.Message(arbitration_id=0x400, data=(k + i).to_bytes(8, "little"), is_extended_id=False))
            for i in range(50):
                frame = receiver.recv(1.0)
                assert frame is not None and int.from_bytes(frame.data, "little") == k + i
                received += 1
        rate = received / (time.perf_counter() - begin)
    trips.sort()
    print(json.dumps({"round_trip_p50_us": trips[len(trips) // 2], "round_trip_p99_us": trips[len(trips) * 99 // 100],
                      "through_hz": rate}))


if __name__ == "__main__":
    {"decode": decode, "encode": encode, "listen": listen, "echo": echo, "speed": speed}[sys.argv[1]](*sys.argv[2:])
