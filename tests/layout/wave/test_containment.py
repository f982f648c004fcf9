"""One inside another: what encloses a solid, or is enclosed by it, collides; what is in a hollow is free."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.layout.scenes import box_mjcf, collisions, compile_on_cpu, make, valid, write_mjcf


@pytest.mark.parametrize("geometry", ["physics", "visual"])
@pytest.mark.parametrize("solid", ["box", "hull", "apart"])
def test_what_is_wholly_inside_a_solid_collides(tmp_path: Path, geometry: str, solid: str):
    """An apple in the heart of a large solid, far from every face of it; and the same the other way round."""
    (tmp_path / "gem.obj").write_text(
        "v .5 0 0\nv -.5 0 0\nv 0 .5 0\nv 0 -.5 0\nv 0 0 .5\nv 0 0 -.5\n"
        "f 1 3 5\nf 3 2 5\nf 2 4 5\nf 4 1 5\nf 3 1 6\nf 2 3 6\nf 4 2 6\nf 1 4 6\n"
    )
    geoms = {
        "box": '<geom type="box" size=".4 .4 .4"/>',
        "hull": '<geom type="mesh" mesh="gem"/>',
        "apart": '<geom type="box" size=".1 .1 .1" pos="0 0 2"/><geom type="box" size=".4 .4 .4"/>',
    }
    asset = write_mjcf(tmp_path, "rock", geoms[solid], '<asset><mesh name="gem" file="gem.obj"/></asset>')
    still, low = {"kind": "static"}, -0.05  # the apple's middle, and so the solid's, is 4 cm above its bottom
    for rock, apple in (
        ({"asset": asset, **still}, {"asset": "apple", "region": {"box": [[0, 0, low], [1, 0, low]]}}),
        ({"asset": asset, "region": {"box": [[0, 0, -0.4], [1, 0, -0.4]]}}, {"asset": "apple", **still}),
    ):
        objects = {"apple": apple, "rock": rock}
        compiled = compile_on_cpu({"geometry": geometry, "objects": objects}, bank=1)
        x = valid(make(compiled, 300)).qpos[:, 0]
        assert len(x) > 200
        assert x.min() > 0.3


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_what_is_in_the_hollow_of_a_mug_is_free(tmp_path: Path, geometry: str):
    """A pea floats inside the mug: neither its visual mesh nor its walls of convex pieces fill the hollow."""
    pea = {"asset": box_mjcf(tmp_path, "pea", 0.008, 0.008, 0.008)}
    mug = {"asset": "mug", "kind": "static"}
    hollow = {"box": [[-0.02, -0.005, 0.03], [-0.01, 0.005, 0.05]]}
    scene = {"geometry": geometry, "objects": {"mug": mug, "pea": {**pea, "region": hollow}}}
    assert collisions(scene, "pea") == (0, 200)


def test_a_ball_in_a_crate_and_a_crate_in_a_ball_collide(tmp_path: Path):
    """Seen as they are, far from each other's surface."""
    small, large = (
        '<geom type="{}" size="{} {} {}"/>'.format(k, *[s] * 3) for k, s in (("sphere", 0.01), ("box", 0.4))
    )
    tiny, round_large = '<geom type="box" size=".01 .01 .01"/>', '<geom type="sphere" size=".4"/>'
    for i, (inner, outer) in enumerate([(small, large), (tiny, round_large), (small, round_large)]):
        inside = {"asset": write_mjcf(tmp_path, f"in{i}", inner), "region": {"box": [[0, 0, 0], [1, 0, 0]]}}
        around = {"asset": write_mjcf(tmp_path, f"out{i}", outer), "kind": "static"}
        compiled = compile_on_cpu({"geometry": "visual", "objects": {"inner": inside, "outer": around}}, bank=1)
        x = valid(make(compiled, 300)).qpos[:, 0]
        assert x.min() > 0.4 and len(x) > 200
