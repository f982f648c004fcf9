"""Configurations of the original Sceniris package."""
