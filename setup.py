"""Find the packages: all of `sceniris_gym`, and the two beside it that `package-dir` in pyproject.toml names."""

import re
from pathlib import Path

from setuptools import find_packages, setup

PICTURE = re.compile(r"^!\[[^\]]*\]\([^)]*\)\n\n", re.MULTILINE)
FILE_LINK = re.compile(r"\[([^\]]+)\]\((?!https?:)[^)]*\)")


def description() -> str:
    """Return the README without pictures and links to files of the repository, which a package index does not have."""
    readme = Path(__file__).with_name("README.md").read_text(encoding="utf-8")
    return FILE_LINK.sub(r"\1", PICTURE.sub("", readme))


setup(
    packages=[*find_packages(include=["sceniris_gym*"]), "sceniris_gym.envs", "sceniris_gym.assets"],
    long_description=description(),
    long_description_content_type="text/markdown",
)
