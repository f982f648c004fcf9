"""The shard of a data set that one of several processes writes."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass

from sceniris_gym.errors import ArgumentError
from sceniris_gym.vector.ranks import Rank

_TORCHRUN = ("RANK", "WORLD_SIZE")
_ARRAY = ("SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_MIN", "SLURM_ARRAY_TASK_MAX", "SLURM_ARRAY_TASK_COUNT")
_STEP = "SLURM_ARRAY_TASK_STEP"


@dataclass(frozen=True)
class Shard:
    """The share of one of `size` processes: every `size`-th part of the data set, from part `number` on."""

    number: int = 0
    size: int = 1

    @property
    def device(self) -> str | None:
        """The GPU of this process if torchrun started it and every process has a GPU. None means the default device."""
        return Rank.current().device if self.size > 1 else None

    @classmethod
    def parse(cls, text: str, wrong: str = "") -> Shard:
        """Read `R/K`, process R of K.

        Raises:
            ArgumentError: The text has another form. The message is `wrong` or, by default, about --shard.
        """
        wrong = wrong or f"--shard {text:.40}: should be R/K with R below K, such as 0/8 for the first of 8."
        found = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text)
        shard = None if found is None else cls(int(found[1]), int(found[2]))
        if shard is None or shard.number >= shard.size:
            raise ArgumentError(wrong)
        return shard

    @classmethod
    def current(cls, environment: Mapping[str, str] = os.environ) -> Shard:
        """Return the shard that torchrun (RANK, WORLD_SIZE) or a Slurm array gives this process.

        Without these environment variables, the shard is the whole data set.

        Raises:
            ArgumentError: The rank is not below the size, or the task numbers of the array have gaps.
        """
        number, size = (environment.get(name, "") for name in _TORCHRUN)
        if number.isdecimal() and size.isdecimal():
            wrong = f"generate: RANK={number:.40} should be below WORLD_SIZE={size:.40}, as torchrun sets them."
            return cls.parse(f"{number}/{size}", wrong)
        array = [environment.get(name, "") for name in _ARRAY]
        if not all(word.isdecimal() for word in array):
            return cls()
        task, first, last, count = map(int, array)
        word = environment.get(_STEP, "") or "1"
        if not re.fullmatch("[0-9]{1,9}", word) or int(word) == 0:
            raise ArgumentError(f"generate: {_STEP}={word:.40} should be a positive integer, as Slurm sets it.")
        step = int(word)
        if (last - first) // step + 1 != count or (task - first) % step:
            raise ArgumentError(
                f"generate: this is task {task} of a Slurm array of {count} tasks from {first} to {last} with gaps. "
                "Tell each task its shard by --shard R/K."
            )
        return cls((task - first) // step, count)
