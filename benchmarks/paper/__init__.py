"""The experiments of the Sceniris paper, measured again here, beside its own figures and those of peers."""
