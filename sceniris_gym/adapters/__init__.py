"""Adapters for training libraries, each with an extra of its name."""
