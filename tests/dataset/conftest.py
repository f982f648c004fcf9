"""The crane of the tests of layouts."""

from tests.layout.conftest import crane

__all__ = ["crane"]
