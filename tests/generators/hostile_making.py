"""A hostile model under construction, and chains of links, of which its arms and robots are made."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from tests.generators.hostile_bodies import Parts, add_body, add_joint, text
from tests.generators.hostile_couplings import add_actuator
from tests.generators.hostile_words import Thing


@dataclass
class Making:
    """A model under construction: its parts, half the width [m] of its workspace, and the scene so far."""

    parts: Parts
    width: float
    objects: dict[str, Any] = field(default_factory=dict)
    things: list[Thing] = field(default_factory=list)
    loose: list[str] = field(default_factory=list)
    free: list[str] = field(default_factory=list)

    def somewhere(self, low: float = 0.0, high: float = 3.0) -> np.ndarray:
        """A point above the workspace; heights are in units."""
        x, y = self.parts.rng.uniform(-self.width, self.width, 2)
        return np.array([x, y, self.parts.unit * float(self.parts.rng.uniform(low, high))])


def add_chain(making: Making, parts: Parts, base: Element, prefix: str, count: int) -> list[Element]:
    """Put a chain of links with held hinges on a base. No link reaches the next one, nor the base, however it turns."""
    unit = parts.unit
    half = text(0.8 * unit, 0.8 * unit, 0.4 * unit)
    SubElement(base, "geom", name=f"{prefix}base", type="box", size=half, pos=text(0, 0, 0.5 * unit))
    touches = making.parts.has("base_touch")
    links: list[Element] = []
    for i in range(count):
        rise = 2.0 * unit if i else 1.6 * unit - 0.0002 if touches else 1.8 * unit
        at = np.array([0.0, 0.0, rise])
        link = add_body(parts, links[-1] if links else base, f"{prefix}link{i}", at, str(base.get("name")))
        joint = add_joint(parts, link, f"{prefix}j{i}", "hinge", unit, str(base.get("name")))
        shape = {"type": "sphere", "size": text(0.7 * unit)} if touches and i == 0 else {"type": "capsule"}
        SubElement(link, "geom", {"size": text(0.3 * unit, 0.4 * unit), **shape}, name=f"{prefix}link{i}")
        parts.geoms[f"{prefix}link{i}"] = f"{prefix}link{i}"
        add_actuator(parts, "position", joint, 500.0 * unit**3)
        links.append(link)
    return links
