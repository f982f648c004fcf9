"""The bank on the device: a scene that was only uploaded has one without rows."""

from sceniris_gym.program.device_bank import Bank, empty_bank


def test_an_empty_bank_has_all_columns_without_rows():
    """So that it can be stored, and read by kernels that count its rows."""
    bank = empty_bank("cpu")
    assert bank.ntrain == 0
    # pyrefly: ignore[missing-attribute]
    assert all(getattr(bank, name).numpy().size == 0 for name in Bank.vars if name != "ntrain")
