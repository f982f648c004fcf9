"""Importers of scenes that were written for other packages."""
