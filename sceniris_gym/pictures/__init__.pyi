"""The public names of this module. Each is imported on first use."""

from .layout_picture import captioned as captioned
from .layout_picture import render as render
from .layout_picture import save as save

__all__: list[str]
