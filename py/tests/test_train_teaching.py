"""Labels from a teacher: what is kept, where it lands in the pictures written, and that a second call does no work twice."""

import json

import pytest

from train_support import require_training_packages

require_training_packages()

import numpy as np  # noqa: E402
from PIL import Image  # noqa: E402

from ogg_rs.train import teaching  # noqa: E402
from ogg_rs.train.coco import CocoKeypoints  # noqa: E402
from ogg_rs.train.skeleton import COCO17, PARTS  # noqa: E402

WIDTH, HEIGHT = 400, 600
PLACES = {
    "nose": (200, 100), "left_eye": (208, 92), "right_eye": (192, 92), "left_ear": (218, 95), "right_ear": (182, 95),
    "left_shoulder": (250, 160), "right_shoulder": (150, 160), "left_elbow": (290, 240), "right_elbow": (110, 240),
    "left_wrist": (300, 320), "right_wrist": (60, 200), "left_hip": (230, 330), "right_hip": (170, 330),
    "left_knee": (230, 440), "right_knee": (170, 440), "left_ankle": (230, 550), "right_ankle": (170, 550),
}  # fmt: skip
JOINTS = np.array([(*PLACES[name], 0.8) for name in COCO17])
MIRROR = [COCO17.index(n.replace("left", "*").replace("right", "left").replace("*", "right")) for n in COCO17]


def picture() -> Image.Image:
    """Grey, with a red square at the right wrist and a blue one at the top left corner."""
    pixels = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
    x, y = PLACES["right_wrist"]
    pixels[y - 6 : y + 7, x - 6 : x + 7] = (255, 0, 0)
    pixels[:4, :4] = (0, 0, 255)
    return Image.fromarray(pixels)


class Knows:
    """A teacher that knows the picture above, mirrored or not, and may be wrong about a joint of the mirrored one."""

    def __init__(self, wrong: str | None = None, off_px: float = 0.0, score: float = 0.8) -> None:
        self.calls, self.wrong, self.off_px, self.score = 0, wrong, off_px, score

    def __call__(self, image: Image.Image) -> np.ndarray:
        self.calls += 1
        if image.getpixel((1, 1))[2] > 200:
            return JOINTS.copy()
        seen = JOINTS[MIRROR].copy()
        seen[:, 0] = WIDTH - 1 - seen[:, 0]
        if self.wrong:
            row = MIRROR.index(COCO17.index(self.wrong))
            seen[row, 0] += self.off_px
            seen[row, 2] = self.score
        return seen


def folder_with(tmp_path, *names):
    source = tmp_path / "photos"
    source.mkdir()
    for name in names:
        picture().save(source / name)
    return source


def test_joints_lie_on_the_same_spot_of_the_pictures_written(tmp_path):
    source = folder_with(tmp_path, "a.png")
    assert teaching.write(tmp_path / "out", [source], Knows()) == (1, 1)
    data = CocoKeypoints(tmp_path / "out")
    assert len(data) == 2, "the whole person and the upper body"
    for i in range(2):
        x, y = data[i].joints_px[0, PARTS.index("right_wrist")]
        pixels = np.asarray(data.image(i)).astype(int)
        red = np.argwhere(pixels[..., 0] - pixels[..., 1] > 60) + 0.5
        np.testing.assert_allclose((x, y), red.mean(0)[::-1], atol=0.6)
    upper = next(i for i in range(2) if data.records[i]["file_name"].endswith("upper.jpg"))
    seen = data.visible(upper)[0]
    assert seen[PARTS.index("right_wrist")] and not seen[PARTS.index("right_ankle")]
    assert data.torso_px(upper) > data.torso_px(1 - upper)


@pytest.mark.parametrize(
    ("off_share", "score", "kept"), [(0.0, 0.8, True), (0.9, 0.8, True), (1.1, 0.8, False), (0.0, 0.29, False), (0.0, 0.31, True)]
)
def test_a_joint_is_labelled_where_both_views_agree(off_share, score, kept):
    torso = teaching.torso_px(JOINTS)
    assert torso == pytest.approx(np.hypot(20, 170)), "shoulder to hip"
    teacher = Knows("left_wrist", off_share * teaching.TOLERANCE * torso, score)
    joints = teaching.agreed(picture(), teacher)
    assert (joints[COCO17.index("left_wrist"), 2] > 0) == kept
    assert (joints[:, 2] > 0).sum() == (17 if kept else 16)
    if kept:
        middle = PLACES["left_wrist"][0] - off_share * teaching.TOLERANCE * torso / 2
        assert joints[COCO17.index("left_wrist"), 0] == pytest.approx(middle)


def test_an_arm_seen_along_its_length_measures_a_torso_without_hips():
    joints = JOINTS.copy()
    joints[[COCO17.index("left_hip"), COCO17.index("right_hip")], 2] = 0
    assert teaching.torso_px(joints) == pytest.approx(teaching.TORSO_PER_UPPER_ARM * np.hypot(40, 80))
    joints[[COCO17.index("left_elbow"), COCO17.index("right_elbow")], 2] = 0
    assert np.isnan(teaching.torso_px(joints))


def test_the_same_call_again_asks_the_teacher_only_about_new_pictures(tmp_path):
    source = folder_with(tmp_path, "a.png", "b.png")
    teacher = Knows()
    assert teaching.write(tmp_path / "out", [source], teacher) == (2, 2)
    before = (tmp_path / "out/annotations.json").read_bytes()
    assert teacher.calls == 4
    assert teaching.write(tmp_path / "out", [source], teacher) == (2, 2)
    assert teacher.calls == 4
    assert (tmp_path / "out/annotations.json").read_bytes() == before
    picture().save(source / "c.png")
    assert teaching.write(tmp_path / "out", [source], teacher) == (3, 3)
    assert teacher.calls == 6


def test_a_picture_of_nobody_is_counted_and_left_out(tmp_path):
    source = folder_with(tmp_path, "a.png")
    assert teaching.write(tmp_path / "out", [source], lambda image: None) == (1, 0)
    assert json.loads((tmp_path / "out/annotations.json").read_text())["images"] == []


def test_what_is_not_there_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere: expected a picture, a video or a folder"):
        teaching.write(tmp_path / "out", [tmp_path / "nowhere"], Knows())
