"""Bodies seen from a side: sides by name, scale, direction and floor."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.motion import concat, make_markers, positions, read, write_bvh
from bayesmotion.plots.bodies import body_of


def test_bones_without_length_are_left_out(walk):
    body = body_of(walk)
    skeleton_bones = 37  # of which both hip joints, the lower back and the root add none
    assert len(body.bones) == skeleton_bones - 3
    assert body.sides.count("left") == body.sides.count("right") > 10


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.0, -2.5])
def test_every_walk_goes_to_the_right(turned, angle):
    side = body_of(turned(angle))
    reference = body_of(turned(0.0))
    np.testing.assert_allclose(
        side.points - side.points[:1, :1], reference.points - reference.points[:1, :1], atol=1e-6
    )
    assert side.points[-1, 0, 0] - side.points[0, 0, 0] > 0.5


def test_the_view_decides_where_right_is(walk):
    front, side = body_of(walk, "front"), body_of(walk, "side")
    left, right = (np.array(front.sides) == name for name in ("left", "right"))
    ends = front.bones[:, 1]
    # Who comes closer has the left hand on the right of the picture.
    assert front.points[:, ends[left], 0].mean() > front.points[:, ends[right], 0].mean() + 0.1
    # Seen from the right, the right side is nearer.
    assert side.depth[:, ends[right]].mean() > side.depth[:, ends[left]].mean() + 0.1


def test_who_stays_faces_right(walk):
    still = walk.assign(root_position=walk["root_position"] * [0.0, 1.0, 0.0])
    body = body_of(still)
    toes = positions(still)["joint"].values.tolist().index("ltoes_end")
    foot = positions(still)["joint"].values.tolist().index("lfoot")
    assert (body.points[:, toes, 0] - body.points[:, foot, 0]).mean() > 0.05


def test_metres_or_else_an_adults_height(walk, bvh_like):
    where = positions(walk).values
    np.testing.assert_allclose(np.ptp(body_of(walk).points[..., 1]), np.ptp(where[..., 1]))
    assert body_of(bvh_like).stature == pytest.approx(1.7)


def test_a_bvh_file_that_is_read_back_is_drawn_at_its_own_size(walk, tmp_path):
    write_bvh(walk, tmp_path / "walk.bvh")
    back = body_of(read(tmp_path / "walk.bvh"))
    assert back.stature == pytest.approx(body_of(walk).stature, rel=1e-4)
    assert back.stature != pytest.approx(1.7, abs=1e-3)


def test_what_hangs_on_a_joint_that_was_filled_in_is_marked(walk):
    body = body_of(walk, made_up=["lhumerus"])
    names = [walk_joint(walk, bone[1]) for bone in body.bones]
    marked = {name for name, made in zip(names, body.made_up, strict=True) if made}
    assert {"lradius", "lwrist"} <= marked
    assert not {"lhumerus", "rradius", "ltibia"} & marked
    assert not any(body_of(walk).made_up)


def walk_joint(walk, index):
    return positions(walk)["joint"].values.tolist()[index]


def test_feet_are_on_the_floor(walk):
    lowest = body_of(walk).points[..., 1].min(axis=1)
    assert np.abs(lowest).max() < 0.05


def test_the_head_ends_at_the_top(walk, bvh_like):
    for motion in (walk, bvh_like):
        body = body_of(motion)
        top = body.points[:, body.head[1]]
        np.testing.assert_allclose(
            np.linalg.norm(body.skull - top, axis=1), 0.055 * body.stature, rtol=1e-6
        )
        assert (body.skull[:, 1] < top[:, 1]).all()


def test_what_cannot_be_drawn_is_refused(walk, walkers):
    with pytest.raises(InputError, match="one clip is needed"):
        body_of(concat([walkers["ann-walk"], walkers["ann-run"]]))
    markers = make_markers(["a"], np.zeros((3, 1, 3)), frame_rate=30.0, clip="c")
    with pytest.raises(InputError, match="only markers"):
        body_of(markers)
    path = walk["root_position"].values.copy()
    path[4] = np.nan
    with pytest.raises(InputError, match="frame 4"):
        body_of(walk.assign(root_position=(("frame", "space"), path)))
