"""Draw the diagrams of docs/how_it_works.md: `python -m docs.make_drawings`.

Text is in filled boxes on a transparent background, so a drawing reads well on light and dark pages. Drawings are
narrow enough for a telephone's screen.
"""

from __future__ import annotations

from html import escape
from pathlib import Path

FOLDER = Path(__file__).parent / "drawings"
WIDTH = 380
FILLS = {
    "host": "#37518f",
    "device": "#1f6f6b",
    "user": "#6a4c93",
    "good": "#2e7d32",
    "bad": "#a83a32",
    "kept": "#5f6b7a",
    "label": "#5f6b7a",
}
"""Colours by the role of a box. White text on each has a contrast of 4.5 or more."""
LINE = "#8592a6"


class Drawing:
    """Boxes and arrows as SVG.

    Args:
        title: Title for screen readers.
        height: Height [px]. The width is WIDTH.
    """

    def __init__(self, title: str, height: int) -> None:
        self.parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}" '
            f'viewBox="0 0 {WIDTH} {height}" role="img" font-family="system-ui, sans-serif" text-anchor="middle">',
            f"<title>{escape(title)}</title>",
            f'<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" '
            f'orient="auto"><path d="M0 0 8 4 0 8z" fill="{LINE}"/></marker></defs>',
        ]

    def box(self, x: float, y: float, w: float, h: float, role: str, *lines: str, size: float = 13) -> None:
        """Add a box with centred lines of text. If there are several, the first line is bold."""
        self.parts.append(f'<rect x="{x}" y="{y}" width="{w}" height="{h}" rx="6" fill="{FILLS[role]}"/>')
        for i, line in enumerate(lines):
            bold = ' font-weight="600"' if i == 0 and len(lines) > 1 else ""
            base = y + h / 2 + size * (0.35 + 1.25 * (i - (len(lines) - 1) / 2))
            self.parts.append(
                f'<text x="{x + w / 2:g}" y="{base:g}" fill="#fff" font-size="{size}"{bold}>{escape(line)}</text>'
            )

    def frame(self, y: float, h: float, label: str) -> None:
        """Add a dashed frame over the whole width with a label on its upper edge."""
        self.parts.append(
            f'<rect x="4" y="{y}" width="{WIDTH - 8}" height="{h}" rx="10" fill="none" stroke="{LINE}" '
            f'stroke-width="1.5" stroke-dasharray="5 4"/>'
        )
        self.box(16, y - 11, 7.2 * len(label) + 16, 22, "label", label, size=12)

    def arrow(self, *points: tuple[float, float]) -> None:
        """Add an arrow along straight lines."""
        path = " ".join(f"{x:g},{y:g}" for x, y in points)
        self.parts.append(
            f'<polyline points="{path}" fill="none" stroke="{LINE}" stroke-width="2" marker-end="url(#tip)"/>'
        )

    def text(self) -> str:
        """Return the SVG."""
        return "\n".join([*self.parts, "</svg>", ""])


def pipeline() -> Drawing:
    """Draw the way from a scene file to observations."""
    d = Drawing("From a scene file to observations", 646)
    steps = [
        ("user", "scene file", "YAML, or a mapping"),
        ("host", "SceneConfig", "words and values are checked"),
        ("host", "SceneModel", "one MuJoCo model of all assets"),
        ("host", "Plan", "regions, orders, pairs, by name"),
        ("host", "CompiledScene", "arrays that kernels read; a layout is proven"),
        ("device", "LayoutSource", "fresh, prefetched or stored layouts"),
        ("device", "ResetRandomizer", "qpos, mocap poses, controls of the mask"),
        ("device", "Data of mujoco_warp", "your loop steps it"),
        ("device", "SceneVectorEnv", "observations, rewards, episodes"),
    ]
    d.frame(84, 264, "once, on the host")
    d.frame(378, 258, "resets, on the device")
    y = 8.0
    for i, (role, *lines) in enumerate(steps):
        d.box(30, y, WIDTH - 60, 46, role, *lines)
        if i + 1 < len(steps):
            gap = {0: 46, 4: 62}.get(i, 16 if i < 4 else 14)
            d.arrow((WIDTH / 2, y + 46), (WIDTH / 2, y + 46 + gap - 1))
            y += 46 + gap
    return d


def candidate() -> Drawing:
    """Draw how a candidate is drawn, tested, and accepted or rejected."""
    d = Drawing("How a candidate is drawn, tested, and accepted or rejected", 540)
    left, width, right = 30, 212, 266
    aside, middle = WIDTH - right - 4, right + 55
    steps = [
        ("device", "draw a candidate", "joints, orientation, a point"),
        ("device", "region", "exact test of the point"),
        ("device", "cover, edge, map", "cheap tests of one object"),
        ("device", "collision", "all pairs, with clearance"),
        ("good", "accepted", "the lowest trial that passes"),
        ("device", "all objects are placed", "ik and clear, if asked for"),
        ("good", "served", "status VALID"),
    ]
    for i, (role, *lines) in enumerate(steps):
        y = 8 + 68 * i
        d.box(left, y, width, 48, role, *lines)
        if i + 1 < len(steps):
            d.arrow((left + width / 2, y + 48), (left + width / 2, y + 66))
        if i in (1, 2, 3, 5):
            d.arrow((left + width, y + 24), (right - 2, y + 24))
    d.arrow((left, 304), (12, 304), (12, 32), (left - 2, 32))
    d.box(right, 76, aside, 184, "bad", "rejected", "counted by", "object and", "cause")
    d.arrow((middle, 76), (middle, 32), (left + width + 2, 32))
    d.arrow((middle, 260), (middle, 346))
    d.box(right, 348, aside, 48, "bad", "start again", "attempts used up", size=11.5)
    d.arrow((middle, 396), (middle, 414))
    d.box(right, 416, aside, 48, "kept", "FALLBACK", "restarts used up", size=11.5)
    d.box(4, 484, WIDTH - 8, 48, "label", "The lowest trial wins,", "however many candidates are tried at once.")
    return d


def partial_reset() -> Drawing:
    """Draw which arrays a reset of two of six worlds touches."""
    d = Drawing("What a reset of two of six worlds touches", 330)
    masked = (1, 4)
    rows = [
        ("world", None),
        ("qpos, ctrl, mocap", ("good", "kept")),
        ("velocities, time", ("bad", "kept")),
        ("contacts", ("bad", "kept")),
        ("episode, layout", ("good", "kept")),
        ("xpos, site_xmat ...", ("device", "device")),
    ]
    y = 8
    for name, roles in rows:
        d.box(8, y, 132, 34, "label", name, size=12)
        for world in range(6):
            role = ("host" if world in masked else "kept") if roles is None else roles[world not in masked]
            d.box(146 + 38 * world, y, 34, 34, role, str(world) if roles is None else "")
        y += 40
    for i, (role, words) in enumerate(
        [("host", "in the mask"), ("good", "new"), ("bad", "cleared"), ("kept", "same bits"), ("device", "updated")]
    ):
        x, below = 8 + 124 * (i % 3), y + 10 + 34 * (i // 3)
        d.box(x, below, 116, 28, role, words, size=12)
    return d


DRAWINGS = {"pipeline": pipeline, "candidate": candidate, "partial_reset": partial_reset}


def main() -> None:
    """Write all drawings."""
    FOLDER.mkdir(exist_ok=True)
    for name, draw in DRAWINGS.items():
        (FOLDER / f"{name}.svg").write_text(draw().text(), encoding="utf-8")


if __name__ == "__main__":
    main()
