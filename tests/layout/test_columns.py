"""The list of columns: whatever has rows of layouts has these, so that none drifts away."""

from sceniris_gym.layout.columns import BANKED, columns
from sceniris_gym.layout.layouts import Layouts, LayoutsView
from sceniris_gym.program.device_bank import Bank
from sceniris_gym.scene.layout_table import COLUMNS


def test_all_that_has_rows_of_layouts_has_these_columns():
    """Kernels, batches, tables and the bank; tables also tell what follows from their columns."""
    assert {*columns()} <= LayoutsView.vars.keys()
    assert {*columns()} <= vars(Layouts).keys()
    assert {*COLUMNS} == {*columns(), "valid", "grasp_pose"}
    assert {*BANKED, "ntrain"} == Bank.vars.keys()
