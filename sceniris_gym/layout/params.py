"""`ParamTable`: values of a scene file that can change at run time, per world, without recompilation.

A param can only narrow a value of the scene file, such as a count, an interval or a region. All guarantees and
capacities computed for the scene therefore stay valid.
"""

import fnmatch
from collections.abc import Mapping, Sequence
from typing import Any
from urllib.parse import quote, unquote

import numpy as np
import warp as wp

from sceniris_gym.config.fields import short
from sceniris_gym.errors import ArgumentError, UnknownNameError, as_names, check_names, check_type
from sceniris_gym.layout.masks import as_numbers, selects
from sceniris_gym.layout.scene_params import Param, scene_params
from sceniris_gym.program.compiled import CompiledScene

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


class ParamTable:
    """The params of a batch of worlds. The values of one world form a row, in which each param has its columns.

    Args:
        compiled: The scene.
        names: Names of params, or patterns such as "objects.*.region".

    Attributes:
        params: The params by name, sorted.
        first: The first column of each param, by its name.
        default: The numbers of the scene file, shape (nvalue,), float32.
        of_draws: For each draw of physics or appearance, by its name, the name of the param that would narrow it. The
            table may lack this param.
        are_kept: Whether each layout keeps its param values, as stored layouts do. Setting params then raises an error.

    Raises:
        ArgumentTypeError: `names` are not strings.
        UnknownNameError: There is no such param.
        ArgumentError: A name belongs to a part of the scene file that cannot be a param. The message has the reason.
    """

    def __init__(self, compiled: CompiledScene, names: str | Sequence[str]) -> None:
        every = scene_params(compiled) if names else {}
        known = {name: param for name, param in every.items() if isinstance(param, Param)}
        chosen: dict[str, Param] = {}
        for name in as_names(names, "params"):
            found = [name] if name in known else fnmatch.filter(known, name)
            if not found and name in every:
                raise ArgumentError(f"params: '{name}' cannot be a param: {every[name]}")
            if not found:
                raise UnknownNameError("param", str(name), "params", known)
            chosen |= {one: known[one] for one in found}
        self.params = {name: chosen[name] for name in sorted(chosen)}
        numbers = [param.default for param in self.params.values()]
        self.first = dict(zip(self.params, np.cumsum([0, *map(len, numbers)]).tolist(), strict=False))
        self.default = np.concatenate([np.zeros(0, np.float32), *numbers])
        self.are_kept = False
        self.of_draws = {draw.name: draw.key for draw in compiled.scene.sim.draws}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the params, sorted."""
        return tuple(self.params)

    def param(self, name: str, where: str = "set_param") -> Param:
        """Return a param by its name.

        Raises:
            UnknownNameError: The table has no such param.
        """
        check_names("param", [name], f"{where} (the argument `params` should name it)", self.names)
        return self.params[name]

    def named(self, rows: Any) -> dict[str, Any]:
        """Return the values of each param in the given rows, by name of the param, shape (nrow, number of values)."""
        ends = {name: self.first[name] + len(param.default) for name, param in self.params.items()}
        return {name: rows[:, self.first[name] : end] for name, end in ends.items()}

    def checked(self, rows: Any, nrow: int) -> np.ndarray:
        """Check full rows of param values, shape (nrow, nvalue), and return them as float32.

        Raises:
            ArgumentError: Wrong shape, not numbers, or numbers that a param cannot have.
        """
        given = as_numbers(rows)
        if given.shape != (nrow, len(self.default)):
            raise ArgumentError(f"params should have shape {(nrow, len(self.default))}, got {short(rows)}.")
        for name, values in self.named(given).items():
            self.params[name].checked(values, nrow)
        return given.astype(np.float32)

    def text(self, row: np.ndarray) -> str:
        """Return the fifth part of a layout id: params that differ from the scene file, sorted, as float32 in hex."""
        parts = []
        for name, values in self.named(np.asarray(row, np.float32)[None]).items():
            if (values[0] != self.params[name].default).any():
                bits = "".join(f"{number:08x}" for number in values[0].view(np.uint32))
                parts.append(f"{quote(name, safe='.')}={bits}")
        return ",".join(parts)

    def rows(self, values: Mapping[str, Any], nworld: int) -> np.ndarray:
        """Return full rows with given values of some params and default values of the others.

        The result has shape (nworld, nvalue), float32.

        Raises:
            UnknownNameError, ArgumentError: A param is not in the table, or cannot have the given values.
        """
        rows = np.tile(self.default, (nworld, 1))
        columns, found = self.part(values, nworld)
        rows[:, columns] = found
        return rows

    def part(self, values: Mapping[str, Any], nworld: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the columns of some params, and rows of values for these columns.

        The result has one row for all worlds, or a row per world if some of the `values` are given per world.

        Raises:
            UnknownNameError, ArgumentError: As in `rows`.
            ArgumentTypeError: Not a mapping of names to values.
        """
        check_type(values, Mapping, "params")
        found = [self.param(name).checked(value, nworld) for name, value in values.items()]
        columns = [self.first[name] + k for name in values for k in range(len(self.param(name).default))]
        blank = np.zeros((max(map(len, found), default=1), 1), np.float32)
        return np.array(columns, np.int32), np.concatenate([blank[:, :0], *(blank + rows for rows in found)], axis=1)

    def boxes(self, compiled: CompiledScene) -> wp.array | None:
        """Return, for each placed object, the first column of the param that narrows its region on a support.

        The array is int32, with -1 for objects without such a param. The result is None if no param of the table is a
        region on a support.
        """
        keys = [f"{compiled.config.key(name)}.region" for name in compiled.placed]
        # the region of an object without a support has copies in the program instead
        first = [self.first[key] if key in self.params and not self.params[key].copies else -1 for key in keys]
        return wp.array(first, dtype=int, device=compiled.device) if max(first, default=-1) >= 0 else None


def params_in(text: str) -> dict[str, np.ndarray]:
    """Read the fifth part of a layout id: the values of each param, by its name."""
    found = {}
    for part in text.split(",") if text else ():
        name, digits = part.split("=")
        bits = [int(digits[i : i + 8], 16) for i in range(0, len(digits), 8)]
        found[unquote(name)] = np.array(bits, np.uint32).view(np.float32)
    return found


@wp.kernel
def _set(
    mask: wp.array[wp.bool],
    columns: wp.array[int],
    values: wp.array2d[float],
    # Out:
    param: wp.array2d[float],
):
    worldid, k = wp.tid()
    if not selects(mask, worldid):
        return
    param[worldid, columns[k]] = values[worldid % values.shape[0], k]


def launch_set(param: wp.array, columns: wp.array, values: wp.array, mask: wp.array | None) -> None:
    """Write `values` into the given columns of the masked worlds.

    `values` has one row for all worlds, or one row per world. If `mask` is None, all worlds are selected.
    """
    dim = (param.shape[0], values.shape[1])
    wp.launch(_set, dim, inputs=[mask, columns, values], outputs=[param], device=param.device)
