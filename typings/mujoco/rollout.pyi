from typing import Any

import numpy as np

def rollout(
    model: Any,
    data: Any,
    initial_state: np.ndarray,
    control: np.ndarray | None = None,
    *,
    control_spec: int = ...,
    skip_checks: bool = False,
    nstep: int | None = None,
    initial_warmstart: np.ndarray | None = None,
    state: np.ndarray | None = None,
    sensordata: np.ndarray | None = None,
    chunk_size: int | None = None,
    persistent_pool: bool = False,
) -> tuple[np.ndarray, np.ndarray]: ...
