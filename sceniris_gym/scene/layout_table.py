"""`LayoutTable`: layouts on the host, to be stored, written to files, audited or shown in pictures.

This module depends only on MuJoCo states, so that code that judges layouts shares no code with the generator.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Integral
from typing import Annotated, Any, NamedTuple, get_origin, get_type_hints

import mujoco
import numpy as np

from sceniris_gym.config.fields import short
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, SceneMismatchError, check_type


class Column(NamedTuple):
    """The type, shape and purpose of a column of LayoutTable.

    Attributes:
        part: The purpose of the column. "key" identifies the layout, and "draw" its draws of physics and appearance.
            "pose" is the state of the world, "grasp" the accepted grasps, "count" the work to make the layout, and
            "table" a value derived from these.
        dtype: NumPy's name of the column's type.
        shape: Shape of a row. Each width is a number, or a name such as "nq" for a number that depends on the scene.
        blank: The value of an unknown entry.
    """

    part: str
    dtype: str
    shape: tuple[str | int, ...] = ()
    blank: float = 0

    def row(self, widths: Mapping[str, int]) -> tuple[int, ...]:
        """Return the shape of a row. `widths` gives the number for each name in `shape`. Missing names count as 0."""
        return tuple(widths.get(width, 0) if isinstance(width, str) else width for width in self.shape)

    def blanks(self, nrow: int) -> np.ndarray:
        """Return `nrow` rows in which all entries are unknown."""
        return np.full((nrow, *self.row({})), self.blank, self.dtype)


@dataclass(frozen=True)
class LayoutTable:
    """Layouts and how they were made, one row each. The fields define all columns of a layout.

    Columns with wide types come first, so that a row of a data set has no gaps.

    Attributes:
        seed: Seed of the world, shape (nrow,), uint64.
        draw_seed, draw_episode, draw_stream: The key that draws physics and appearance, as in `Layouts`, shape (nrow,),
            uint64 and int32. An unknown `draw_episode` is -1.
        episode: Episode of the world, -1 if unknown, shape (nrow,), int32.
        qpos: Joint positions [m, rad], quaternions wxyz, shape (nrow, nq).
        mocap_pos: Positions of the mocap bodies [m], world frame, shape (nrow, nmocap, 3).
        mocap_quat: Orientations of the mocap bodies, wxyz, shape (nrow, nmocap, 4).
        status: Codes of `layout.layouts.LayoutStatus`, shape (nrow,), int32.
        attempts: Number of candidates drawn for the layout, shape (nrow,), int32.
        start: Index of the kind of start in the scene file, -1 for scenes without starts, shape (nrow,), int32.
        grasp: The accepted grasp of each reach target, as an index into the grasps of the target, shape (nrow, nreach),
            int32. It is -1 for absent objects.
        grasp_pose: The TCP's pose in the accepted grasp, world frame, position [m] and orientation (wxyz), nan without
            a grasp, shape (nrow, nreach, 7), float32.
        grasp_qpos: The arm's joints [rad or m] in the accepted grasp, nan for tiers that use only the arm's map, shape
            (nrow, nreach, njoint), float32.
        pregrasp_qpos: The arm's joints in the pre-grasp, nan below `clear` or if not needed, shaped as `grasp_qpos`.
        path: The start and the two vias of the path to the pre-grasp, 8 joints each, nan without a path, shape (nrow,
            nreach, 24). Of width 0 if no layout has a path.
        param: Values of the params, shape (nrow, nvalue), float32.
        present: Whether each object is present, not left out by its group. The objects come in the order of the scene
            file, then the robots, shape (nrow, nslot), bool.
        valid: Whether the layout is fresh and valid, not taken from the bank, shape (nrow,), bool.
        first_pass_valid: Whether the layout was valid without a restart, shape (nrow,), bool.
        scene: Hash of the scene. It is empty if the scene is unknown, as in a table by `from_states`.
        split: The split of seeds and episodes, "train" or "eval".
        params: Names of the params.
    """

    seed: Annotated[np.ndarray, Column("key", "uint64")]
    draw_seed: Annotated[np.ndarray, Column("draw", "uint64")]
    draw_episode: Annotated[np.ndarray, Column("draw", "int32", blank=-1)]
    draw_stream: Annotated[np.ndarray, Column("draw", "int32")]
    episode: Annotated[np.ndarray, Column("key", "int32", blank=-1)]
    qpos: Annotated[np.ndarray, Column("pose", "float32", ("nq",))]
    mocap_pos: Annotated[np.ndarray, Column("pose", "float32", ("nmocap", 3))]
    mocap_quat: Annotated[np.ndarray, Column("pose", "float32", ("nmocap", 4))]
    status: Annotated[np.ndarray, Column("count", "int32")]
    attempts: Annotated[np.ndarray, Column("count", "int32")]
    start: Annotated[np.ndarray, Column("pose", "int32", blank=-1)]
    grasp: Annotated[np.ndarray, Column("grasp", "int32", ("nreach",), blank=-1)]
    grasp_pose: Annotated[np.ndarray, Column("table", "float32", ("nreach", 7))]
    grasp_qpos: Annotated[np.ndarray, Column("grasp", "float32", ("nreach", "njoint"), blank=np.nan)]
    pregrasp_qpos: Annotated[np.ndarray, Column("grasp", "float32", ("nreach", "njoint"), blank=np.nan)]
    path: Annotated[np.ndarray, Column("grasp", "float32", ("nreach", "npath"), blank=np.nan)] = field(
        default_factory=lambda: np.zeros((0, 0, 0), np.float32), kw_only=True
    )
    param: Annotated[np.ndarray, Column("key", "float32", ("nvalue",))]
    present: Annotated[np.ndarray, Column("pose", "bool", ("nslot",))]
    valid: Annotated[np.ndarray, Column("table", "bool")]
    first_pass_valid: Annotated[np.ndarray, Column("count", "bool")]
    scene: str = ""
    split: str = "train"
    params: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Complete tables without paths: files of earlier versions lack the column."""
        shape = np.shape(self.grasp)[:2]
        if np.size(self.path) == 0 and np.shape(self.path)[:2] != shape:
            object.__setattr__(self, "path", np.zeros((*shape, 0), np.float32))

    @classmethod
    def from_states(
        cls, qpos: np.ndarray, mocap_pos: np.ndarray, mocap_quat: np.ndarray, present: np.ndarray
    ) -> LayoutTable:
        """Return a table of states. All other columns are unknown. The class describes the arguments.

        Raises:
            ArgumentTypeError: An argument is not a NumPy array.
        """
        states: dict[str, Any] = {"qpos": qpos, "mocap_pos": mocap_pos, "mocap_quat": mocap_quat, "present": present}
        for name, array in states.items():
            if not isinstance(array, np.ndarray) or array.ndim == 0:
                raise ArgumentTypeError(
                    f"LayoutTable.from_states: {name} should be a NumPy array with a row for each layout, "
                    f"got {type(array)}."
                )
        blanks: dict[str, Any] = {name: column.blanks(len(qpos)) for name, column in COLUMNS.items()}
        return cls(**blanks | states)

    @classmethod
    def concatenate(cls, tables: Sequence[LayoutTable]) -> LayoutTable:
        """Return the rows of one or more tables as one table.

        Raises:
            ArgumentError: `tables` is empty, or has an element that is not a LayoutTable.
            SceneMismatchError: The tables differ in scene, split, params or widths of columns.
        """
        if not isinstance(tables, Sequence) or not tables or not all(isinstance(t, LayoutTable) for t in tables):
            raise ArgumentError("LayoutTable.concatenate: tables should be a list of one LayoutTable or more.")
        widths = {tuple(getattr(table, name).shape[1:] for name in COLUMNS) for table in tables}
        first, *others = ((table.scene, table.split, table.params) for table in tables)
        if any(other != first for other in others) or len(widths) > 1:
            raise SceneMismatchError(
                "LayoutTable.concatenate: all tables should have the same scene, split, params and row shapes."
            )
        # pyrefly: ignore[bad-argument-type]
        return replace(tables[0], **{name: np.concatenate([getattr(t, name) for t in tables]) for name in COLUMNS})

    def __len__(self) -> int:
        return len(self.qpos)

    def __getitem__(self, index: Any) -> LayoutTable:
        rows = row_numbers(index, len(self), "LayoutTable")
        return replace(self, **{name: getattr(self, name)[rows] for name in COLUMNS})

    def chunks(self, size: int) -> Iterator[tuple[int, LayoutTable]]:
        """Yield chunks of at most `size` rows, each with the index of its first row.

        Raises:
            ArgumentError: The size is not an integer of at least 1.
        """
        if not isinstance(size, Integral) or size < 1:
            raise ArgumentError(f"LayoutTable.chunks: size should be an integer of at least 1, got {short(size)}.")
        for start in range(0, len(self), size):
            yield start, self[slice(start, start + size)]

    def put(self, data: mujoco.MjData, i: int) -> None:
        """Write row `i` into `data`, without updating derived fields such as `xpos`.

        Raises:
            ArgumentTypeError: `data` is not an MjData, or `i` is not an integer.
        """
        check_type(data, mujoco.MjData, "LayoutTable.put: data")
        if not isinstance(i, Integral):
            raise ArgumentTypeError(f"LayoutTable.put: i should be the number of a row, got {short(i)}.")
        data.qpos[:] = self.qpos[i]
        data.mocap_pos[:] = self.mocap_pos[i]
        data.mocap_quat[:] = self.mocap_quat[i]


_HINTS = get_type_hints(LayoutTable, include_extras=True)
COLUMNS: dict[str, Column] = {n: hint.__metadata__[0] for n, hint in _HINTS.items() if get_origin(hint) is Annotated}
"""The columns of a LayoutTable by name."""


def row_numbers(index: Any, nrow: int, name: str) -> np.ndarray:
    """Return the numbers of the rows that a NumPy index selects, shape (n,). An integer selects one row.

    Raises:
        IndexError: The index is an integer beyond the rows. This error also ends a `for` loop over the table.
        ArgumentError: The index is invalid for another reason.
    """
    try:
        return np.arange(nrow)[index].reshape(-1)
    except (IndexError, TypeError, ValueError):
        if isinstance(index, Integral):
            raise IndexError(f"{name}: row {index} should be below {nrow}, the number of rows.") from None
        raise ArgumentError(
            f"{name}: the index should be rows from 0 to {nrow - 1}, a slice or a mask, got {short(index)}."
        ) from None
