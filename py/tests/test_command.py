"""The `ogg` command inside the wheel."""

import json
import os
import signal
import subprocess
import sys
from importlib.metadata import entry_points, version
from pathlib import Path

import pytest

from ogg_rs import recording

BESIDE = Path(sys.executable).parent / "ogg"


def run(*arguments, program=(sys.executable, "-m", "ogg_rs")):
    return subprocess.run([*program, *arguments], capture_output=True, text=True, timeout=60, check=False)


def test_module_and_script_are_the_same_command():
    for program in ([sys.executable, "-m", "ogg_rs"], [str(BESIDE)]):
        done = run("--version", program=program)
        assert (done.returncode, done.stdout) == (0, f"ogg {version('ogg_rs')}\n")
    assert any(point.name == "ogg" for point in entry_points(group="console_scripts"))


def test_answers_and_exit_codes_are_those_of_the_binary(ogg, tmp_path):
    (tmp_path / "broken.toml").write_text("nonsense = 1\n")
    for arguments in (
        ["describe"],
        ["follow", "config"],
        ["no-such-command"],
        ["describe", str(tmp_path / "absent.urdf")],
        ["follow", "check-config", "--config", str(tmp_path / "broken.toml")],
    ):
        ours, binary = run(*arguments), run(*arguments, program=[ogg])
        assert (ours.returncode, ours.stdout, ours.stderr) == (binary.returncode, binary.stdout, binary.stderr)


def test_ctrl_c_ends_the_daemon_with_a_summary(tmp_path):
    summary = tmp_path / "summary.json"
    command = [sys.executable, "-m", "ogg_rs", "follow", "daemon", "--record", str(tmp_path), "--summary", str(summary)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        # The line about Ctrl-C comes after the signal handler is in place, the next one when pictures were seen.
        for line in process.stdout:
            if "Ctrl-C" in line:
                break
        process.stdout.readline()
        os.kill(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 0, err
    assert "the arm comes to rest" in out and "Traceback" not in err
    assert json.loads(summary.read_text())["frames"] > 0
    [path] = tmp_path.glob("*.mcap")
    done = run("inspect", str(path))
    assert done.returncode == 0 and "cut short" not in done.stdout
    metrics = recording.open(path).table("metrics")
    assert metrics.rows > 0 and {"ms", ""} & set(metrics["unit"])


@pytest.mark.parametrize("name", ["-h", "--help"])
def test_help_is_an_answer_and_no_error(name):
    done = run(name)
    assert done.returncode == 0 and "Usage: ogg" in done.stdout and done.stderr == ""
