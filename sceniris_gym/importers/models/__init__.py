"""First scene files, written from MuJoCo models: `sceniris-gym init`."""
