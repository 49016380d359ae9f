"""From which side a labelled person is seen, and how often each view is shown."""

from __future__ import annotations

import pytest
from train_support import require_training_packages

require_training_packages()

import numpy as np

from ogg_rs.train.batches import Joined
from ogg_rs.train.skeleton import PARTS
from ogg_rs.train.targets import State
from ogg_rs.train.views import from_behind, from_the_side


def person(**places: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    joints, states = np.zeros((1, 18, 2), np.float32), np.full((1, 18), State.UNKNOWN)
    for name, place in places.items():
        joints[0, PARTS.index(name)], states[0, PARTS.index(name)] = place, State.LABELLED
    return joints, states


FRONT = person(right_shoulder=(40, 50), left_shoulder=(80, 50), right_elbow=(35, 90), left_elbow=(85, 90))
BACK = person(right_shoulder=(80, 50), left_shoulder=(40, 50), right_elbow=(85, 90), left_elbow=(35, 90))
SIDE = person(right_shoulder=(62, 50), left_shoulder=(58, 50), right_elbow=(60, 90), left_elbow=(60, 90))
HALF = person(right_shoulder=(80, 50), right_elbow=(85, 90), left_elbow=(35, 90))
FOLDED = person(right_shoulder=(55, 50), left_shoulder=(65, 50), right_elbow=(55, 60), left_elbow=(65, 60), left_hip=(60, 120))
BARE = person(right_shoulder=(58, 50), left_shoulder=(62, 50))


def test_a_back_is_told_by_the_order_of_the_shoulders() -> None:
    assert [from_behind(*who) for who in (FRONT, BACK, SIDE, HALF)] == [False, True, False, False]


def test_a_side_is_told_by_shoulders_closer_than_the_body_is_long() -> None:
    assert [from_the_side(*who) for who in (FRONT, BACK, SIDE, HALF, FOLDED, BARE)] == [False, False, True, False, True, False]


@pytest.mark.parametrize("degrees", range(-180, 181, 10))
def test_the_view_of_a_turned_person_follows_from_the_angle(degrees: int) -> None:
    # Shoulders 1.39 upper arms apart (0.259 and 0.186 of the body height), arms hanging, seen along the ground from afar.
    half = 0.5 * 1.39 * 50 * np.cos(np.radians(degrees))
    right, left = 100 - half, 100 + half
    who = person(right_shoulder=(right, 50), left_shoulder=(left, 50), right_elbow=(right, 100), left_elbow=(left, 100))
    off = min(abs(degrees), 360 - abs(degrees))
    assert from_the_side(*who) == (78 <= off <= 102)
    assert from_behind(*who) == (off >= 100)


def test_views_are_shown_more_often_and_all_else_as_often_as_its_set() -> None:
    class Set:
        people = [FRONT, BACK, SIDE]

        def __len__(self) -> int:
            return 3

        def __getitem__(self, i: int) -> int:
            return i

    def counts(behind: int, sideways: int) -> list[int]:
        joined = Joined([(Set(), 2)], behind=behind, sideways=sideways)
        return np.bincount([joined[i] for i in range(len(joined))]).tolist()

    assert (counts(1, 1), counts(4, 1), counts(1, 3), counts(4, 3)) == ([2, 2, 2], [2, 8, 2], [2, 2, 6], [2, 8, 6])
