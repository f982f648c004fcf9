"""Pictures of a reachability map: side and top view, each for all approach directions and for straight down."""

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from sceniris_gym.config.tier import Tier, Verdict
from sceniris_gym.reach.map import ReachMap

_PIXELS = 240  # of a panel's side
_DIRECTIONS = 100
_GAP, _STRIP = 24, 22
_INK, _PAPER, _AXES = (40, 44, 50), (255, 255, 255), (150, 155, 162)
_NEVER = np.array([238.0, 240.0, 243.0])
_OFTEN = np.array([22.0, 98.0, 160.0])
_COLOURS = {
    Verdict.NO: _NEVER,
    Verdict.MIXED_NO: (226, 205, 178),
    Verdict.MIXED_YES: (127, 186, 150),
    Verdict.YES: (38, 133, 84),
}


def draw(reach_map: ReachMap, height: float, device: str) -> Image.Image:
    """Draw 2 x 2 panels: on the left the plane y = 0 of the base frame, on the right the plane z = `height` [m].

    The upper panels show the fraction of approach directions that reach a point, from light (0) to dark (1). The lower
    panels show whether a point is reached from straight above: dark green is certainly reached, light gray is out of
    reach. In cells on the boundary of the reach, interpolation decides: light green is reached, brown is not reached.
    """
    span, low = -reach_map.u_low, reach_map.z_low
    ticks = np.linspace(-span, span, _PIXELS)
    across, down = np.meshgrid(ticks, -ticks)
    side = np.stack([across, np.zeros_like(across), down + low + span], axis=-1)
    top = np.stack([across, down, np.full_like(across, height)], axis=-1)
    sheet = Image.new("RGB", (2 * _PIXELS + 3 * _GAP, 2 * (_PIXELS + _STRIP) + 3 * _GAP), _PAPER)
    titles = (("side, y = 0", side, low + span), (f"top, z = {height:g} m", top, 0.0))
    for column, (title, points, middle) in enumerate(titles):
        points = points + [*reach_map.arm.axis_xy, 0.0]
        share = reached_share(reach_map, points, _DIRECTIONS, device)
        _panel(sheet, column, 0, _NEVER + share[..., None] * (_OFTEN - _NEVER), f"any approach: {title}", span, middle)
        verdicts = _verdicts(reach_map, points, np.array([0.0, 0.0, -1.0]), device)
        colours = np.array([_COLOURS[v] for v in Verdict])[verdicts]
        _panel(sheet, column, 1, colours, f"from above: {title}", span, middle)
    return sheet


def reached_share(reach_map: ReachMap, points: np.ndarray, count: int, device: str) -> np.ndarray:
    """Return for each point (..., 3) in the base frame [m] the fraction of `count` approach directions that reach it.

    The directions are spread evenly over the sphere (a Fibonacci lattice).
    """
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    directions = np.stack([np.sqrt(1.0 - z**2) * np.cos(angle), np.sqrt(1.0 - z**2) * np.sin(angle), z], axis=1)
    reached = [_verdicts(reach_map, points, d, device) >= Tier.MAP.least_verdict for d in directions]
    return np.mean(reached, axis=0)


def _verdicts(reach_map: ReachMap, points: np.ndarray, approach: np.ndarray, device: str) -> np.ndarray:
    """Return the Verdict for each point (..., 3) and one approach direction, at any roll about this direction."""
    pos = points.reshape(-1, 3)
    return reach_map.verdict_at(pos, np.tile(approach, (len(pos), 1)), device).reshape(points.shape[:-1])


def _panel(
    sheet: Image.Image, column: int, row: int, colours: np.ndarray, title: str, span: float, middle: float
) -> None:
    """Paste one panel with its title and a labelled line every half metre."""
    x, y = _GAP + column * (_PIXELS + _GAP), _GAP + row * (_PIXELS + _STRIP + _GAP)
    sheet.paste(Image.fromarray(np.round(colours).astype(np.uint8)), (x, y + _STRIP))
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=11)
    draw.text((x, y + 4), title, _INK, font)
    y += _STRIP
    for mark in np.arange(-2.0, 2.01, 0.5):
        right, below = (_PIXELS * (span + at) / (2.0 * span) for at in (mark, middle - mark))
        if 0.0 < right < _PIXELS:
            draw.line([(x + right, y), (x + right, y + _PIXELS)], _AXES)
            draw.text((x + right + 2, y + _PIXELS - 14), f"{mark:g}", _INK, font)
        if 0.0 < below < _PIXELS:
            draw.line([(x, y + below), (x + _PIXELS, y + below)], _AXES)
            draw.text((x + 2, y + below), f"{mark:g}", _INK, font)
