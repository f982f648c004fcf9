"""The importer of configurations for the original Sceniris package."""
