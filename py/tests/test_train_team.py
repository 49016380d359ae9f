"""Training in several processes."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from train_support import require_training_packages

require_training_packages()

import torch

from ogg_rs.train import cli, puppets
from ogg_rs.train.nets import build
from ogg_rs.train.skeleton import OPENPOSE18
from ogg_rs.train.team import Team, launch

HALVES = """
import sys, torch
from ogg_rs.train.team import Team
team = Team.join()
torch.manual_seed(3)
layer = torch.nn.Linear(5, 2)
x, y = torch.randn(8, 5), torch.randn(8, 2)
mine = slice(4 * team.rank, 4 * team.rank + 4)
((layer(x[mine]) - y[mine]) ** 2).mean().backward()
team.average_gradients(layer)
torch.save([p.grad for p in layer.parameters()], f"{sys.argv[1]}/{team.rank}.pt")
"""


def test_the_mean_of_two_halves_is_the_gradient_of_the_whole(tmp_path: Path) -> None:
    launch(2, [sys.executable, "-c", HALVES, str(tmp_path)])
    torch.manual_seed(3)
    layer = torch.nn.Linear(5, 2)
    x, y = torch.randn(8, 5), torch.randn(8, 2)
    ((layer(x) - y) ** 2).mean().backward()
    for rank in (0, 1):
        for got, parameter in zip(torch.load(tmp_path / f"{rank}.pt"), layer.parameters(), strict=True):
            torch.testing.assert_close(got, parameter.grad, rtol=1e-6, atol=1e-7)


def test_no_batch_is_taken_twice_or_left_out() -> None:
    taken = [Team(rank, 3).batch(step) for step in range(5) for rank in range(3)]
    assert sorted(taken) == list(range(15))


def test_one_that_fails_ends_the_others_and_is_named(tmp_path: Path) -> None:
    survived = tmp_path / "survived"
    waits = "import os, sys, time; sys.exit(7) if os.environ['RANK'] == '1' else (time.sleep(30), open(sys.argv[1], 'w'))"
    with pytest.raises(ChildProcessError, match="process 1 of 2: .*ended with 7"):
        launch(2, [sys.executable, "-c", waits, str(survived)])
    assert not survived.exists(), "the first process was waited for"


def test_fit_in_two_processes_writes_one_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    puppets.write(tmp_path / "data", 16, 1)
    order = ["fit", "--data", str(tmp_path / "data"), "--out", str(tmp_path / "run"), "--size", "64x64", "--batch", "2"]
    assert cli.main([*order, "--steps", "50", "--processes", "2"]) == 0
    assert [json.loads(line)["step"] for line in (tmp_path / "run/log.jsonl").read_text().splitlines()] == [50]
    state = torch.load(tmp_path / "run/checkpoint.pt", weights_only=True)
    assert state["step"] == 50
    build("ogg-lite", OPENPOSE18).load_state_dict(state["average"])
    assert cli.main([*order, "--steps", "50", "--processes", "0"]) == 2
    assert "--processes: expected at least 1, got 0" in capsys.readouterr().err
