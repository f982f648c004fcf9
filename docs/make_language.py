"""The pictures of docs/language: 64 layouts of each example, seen from above.

python -m docs.make_language            # all examples, about half a minute
python -m docs.make_language near any   # some examples
"""

from __future__ import annotations

import io
import sys
from collections.abc import Iterable, Sequence

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from docs.examples import PAGES, TEXT_KEY, Example, read_examples
from docs.seen import Bounds, View
from sceniris_gym.config.fields import FLOOR

LAYOUTS = 64
_SIZE, _DPI = (4.8, 3.6), 100  # inches and pixels per inch, so 480 x 360 pixels
_COLORS = 64  # in a picture's palette, which halves the size of the file
_DOTS = ("#1668b8", "#d2601a", "#2e8b3d", "#8a4fb0")
_INK, _PALE, _SHADE, _NAMED, _OTHER = "#333333", "#8c8c8c", "#d3e6f6", "#dcb988", "#e2e2e2"
_TICK, _WEDGE = 0.022, 0.04  # sizes of marks, as fractions of the width
_FROM_THE_FRONT = ("region_space", "gap")  # examples about height
_WITHOUT_REGIONS = ("first",)  # examples whose anchors move, so that each world has a different region
_NEARER = {"beside": (-0.3, 0.45, -0.1, 0.46)}  # closer views of examples: low and high x, low and high y [m]


def draw(example: Example) -> bytes:
    """Draw one example as a PNG that contains the example's text."""
    view = View(example.load(), LAYOUTS)
    placed = [name for name in example.own_objects if view.is_placed(name)]
    jointed = list(view.config.all_robots) or example.jointed_objects
    figure, axes = plt.subplots(figsize=_SIZE, dpi=_DPI)
    from_the_front = example.name in _FROM_THE_FRONT
    if from_the_front:
        _draw_from_the_front(axes, view, placed)
    else:
        _draw_surroundings(axes, view, placed, jointed)
        for name, color in zip(placed, _DOTS, strict=False):
            _draw_object(axes, view, name, color, _TICK * _width(example, view))
            for body in view.moving_bodies(name) if name in jointed else []:
                _draw_moving(axes, view, body, view.worlds(name))
    if len(axes.get_legend_handles_labels()[0]) > 1:
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, fontsize=7, frameon=False, handletextpad=0.1)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.04)
    if example.name in _NEARER:
        axes.axis(_NEARER[example.name])
    axes.tick_params(labelsize=7, colors=_PALE)
    axes.set_xlabel("x [m]", fontsize=7, color=_PALE, labelpad=1)
    axes.set_ylabel("z [m]" if from_the_front else "y [m]", fontsize=7, color=_PALE, labelpad=1)
    for spine in axes.spines.values():
        spine.set_color("#cccccc")
    figure.tight_layout(pad=0.4)
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=_DPI)
    plt.close(figure)
    return _small(picture, example)


def _draw_surroundings(axes: Axes, view: View, placed: Sequence[str], jointed: Sequence[str]) -> None:
    """Draw the supports with the regions on them, and the objects that the example does not place."""
    owners = [view.owner(name) for name in placed]
    named = {other for name in placed for _, other in view.config.parts[name].references}
    for name in view.names:
        if name not in placed:
            color = "white" if name in owners else _NAMED if name in named else _OTHER
            _draw_other(axes, view, name, color, zorder=2 if name in owners else 5, jointed=name in jointed)
    for name in placed:
        owner = view.owner(name)
        if owner in (None, FLOOR) or (owner in view.names and view.stays(str(owner))):
            # the world with the most present objects
            i = max(range(LAYOUTS), key=lambda i: sum(view.is_present(other, i) for other in view.names))
            below, thick = (1, 0.9) if owner == FLOOR else (3, 0.9) if owner else (5.5, 0.6)
            for support in view.supports(name, i):
                _fill(axes, support, facecolor="none", edgecolor=_INK, linewidth=1.1, zorder=5.8)
                _fill(axes, support, facecolor="white", edgecolor="none", alpha=thick, zorder=below)
            if view.config.name not in _WITHOUT_REGIONS and (region := view.region(name, i)) is not None:
                _fill(axes, region, facecolor=_SHADE, edgecolor="none", alpha=thick, zorder=below)


def _draw_other(axes: Axes, view: View, name: str, color: str, zorder: int, jointed: bool) -> None:
    """Draw an object that the example does not place: filled if it never moves, otherwise faintly in all worlds."""
    worlds = view.worlds(name)
    moving = view.moving_bodies(name) if jointed else []
    bodies = [body for body in view.bodies(name) if body not in moving]
    if not jointed and not view.stays(name):
        for i in worlds:
            _fill(axes, view.root_bounds(name, i).shape, facecolor="none", edgecolor=_PALE, alpha=0.4, zorder=zorder)
        return
    for outline in (view.outline(body, worlds[0]) for body in bodies):
        if outline is not None:
            _fill(axes, outline, facecolor=color, edgecolor=_PALE, linewidth=0.8, zorder=zorder)
    _draw_front(axes, view.root_bounds(name, worlds[0]), _WEDGE * view.extent)
    for body in moving:
        _draw_moving(axes, view, body, range(LAYOUTS))


def _width(example: Example, view: View) -> float:
    low, high, *_ = _NEARER.get(example.name, (0.0, view.extent))
    return high - low


def _draw_object(axes: Axes, view: View, name: str, color: str, tick: float) -> None:
    """Draw the pivots of an object, with ticks of length `tick` [m] to the front and faint bounds.

    A cross marks a world with a layout from the bank, a ring a world without an object from this object's relations.
    """
    others = [other for _, other in view.config.parts[name].references]
    labels: dict[str, tuple[list[Bounds], dict]] = {
        name: ([], {"marker": "o", "markersize": 3.2}),
        f"{name} (bank)": ([], {"marker": "x", "markersize": 4.0}),
        f"{name} without {' and '.join(others)}": ([], {"marker": "o", "markersize": 4.0, "markerfacecolor": "white"}),
    }
    fresh, bank, without = (found for found, _ in labels.values())
    for i in view.worlds(name):
        lacking = any(not view.is_present(other, i) for other in others)
        bounds = view.root_bounds(name, i) if name in view.config.all_robots else view.bounds(name, i)
        (bank if not view.is_fresh(i) else without if lacking else fresh).append(bounds)
    for label, (found, style) in labels.items():
        if not found:
            continue
        at = np.array([b.pivot[:2] for b in found])
        axes.plot(at[:, 0], at[:, 1], color=color, linestyle="none", zorder=7, label=label, **style)
        if view.is_point(name):
            continue
        tips = at + tick * np.array([b.front for b in found])
        axes.plot(*np.stack([at, tips], axis=-1).transpose(1, 2, 0), color=color, linewidth=1.0, zorder=6)
        for b in found:
            _fill(axes, b.shape, facecolor="none", edgecolor=color, linewidth=0.5, alpha=0.22, zorder=6)


def _draw_moving(axes: Axes, view: View, body: int, worlds: Iterable[int]) -> None:
    """Draw the rectangle around a body with sampled joints, and a dot in its centre, for each world."""
    for i in worlds:
        if (outline := view.outline(body, i)) is not None:
            _fill(axes, outline, facecolor="none", edgecolor=_DOTS[1], linewidth=0.6, alpha=0.3, zorder=6)
            middle = shapely.centroid(outline)
            axes.plot(*shapely.get_coordinates(middle)[0], "o", color=_DOTS[1], markersize=2.4, alpha=0.6, zorder=6)


def _draw_front(axes: Axes, bounds: Bounds, size: float) -> None:
    """Draw a dark wedge inside the bounds, pointing to the front."""
    size = min(size, 0.28 * float((bounds.high - bounds.low).min()))
    middle, low = 0.5 * (bounds.low + bounds.high)[0], bounds.low[1]
    wedge = shapely.Polygon([(middle, low), (middle + 0.7 * size, low + size), (middle - 0.7 * size, low + size)])
    _fill(axes, bounds.to_world(wedge), facecolor="#5a5a5a", edgecolor="none", zorder=5.1)


def _draw_from_the_front(axes: Axes, view: View, placed: Sequence[str]) -> None:
    """Draw pivots and bounds in x and z, and fixed objects as rectangles."""
    for name in view.names:
        if name not in placed:
            for body in view.bodies(name):
                for low, high in view.boxes_from_the_front(body):
                    _fill(axes, shapely.box(*low, *high), facecolor=_OTHER, edgecolor=_PALE, linewidth=0.6, zorder=2)
    for name, color in zip(placed, _DOTS, strict=False):
        region = view.config.parts[name].region
        if region is not None and region.is_3d and region.corners is not None:
            (x0, _, z0), (x1, _, z1) = region.corners
            _fill(axes, shapely.box(x0, z0, x1, z1), facecolor=_SHADE, edgecolor=_INK, linewidth=0.8, zorder=1)
        for i in view.worlds(name):
            pivot = view.bounds(name, i).pivot
            axes.plot(pivot[0], pivot[2], "o", color=color, markersize=3.2, zorder=7)
            for low, high in view.boxes_from_the_front(view.bodies(name)[0], i):
                _fill(
                    axes,
                    shapely.box(*low, *high),
                    facecolor="none",
                    edgecolor=color,
                    linewidth=0.5,
                    alpha=0.25,
                    zorder=6,
                )


def _fill(axes: Axes, shape: shapely.Geometry, **style: object) -> None:
    """Draw one or more polygons with their holes."""
    for part in shapely.get_parts(shape):
        if isinstance(part, shapely.Polygon) and not part.is_empty:
            rings = [Path(np.asarray(r.coords), closed=True) for r in (part.exterior, *part.interiors)]
            axes.add_patch(PathPatch(Path.make_compound_path(*rings), **style))


def _small(picture: io.BytesIO, example: Example) -> bytes:
    """Return the picture with a palette and with the text of its example."""
    info = PngInfo()
    info.add_text(TEXT_KEY, example.text)
    small = io.BytesIO()
    image = Image.open(picture).convert("RGB")
    image.quantize(_COLORS, dither=Image.Dither.NONE).save(small, format="PNG", optimize=True, pnginfo=info)
    return small.getvalue()


def main(names: Sequence[str]) -> None:
    """Draw the named pictures, or all of them."""
    matplotlib.use("Agg")
    examples = {e.name: e for e in read_examples(*PAGES)}
    if unknown := set(names) - set(examples):
        sys.exit(f"Unknown examples: {', '.join(sorted(unknown))}. Valid examples: {', '.join(examples)}.")
    for name in names or examples:
        picture = draw(examples[name])
        examples[name].picture.write_bytes(picture)
        print(f"{examples[name].picture.name}: {len(picture) / 1024:.0f} KB")


if __name__ == "__main__":
    main(sys.argv[1:])
