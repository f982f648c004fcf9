"""The simulation: batches of worlds, the masked write of layouts, and the randomizer for your own mujoco_warp loop."""

import gc

# Warp keeps the syntax trees of all kernels: half a million objects for those of MuJoCo-Warp. While they are made, the
# garbage collector would walk them several times, which takes a second. To freeze and unfreeze all objects puts them
# into its oldest generation at once; where a program has frozen some itself, they stay frozen.
_collecting = gc.isenabled()
gc.disable()
try:
    import mujoco_warp as mujoco_warp
finally:
    if not gc.get_freeze_count():
        gc.freeze()
        gc.unfreeze()
    if _collecting:
        gc.enable()
