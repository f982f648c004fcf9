"""Find the packages: all of `sceniris_gym`, and the two beside it that `package-dir` in pyproject.toml names."""

from setuptools import find_packages, setup

setup(packages=[*find_packages(include=["sceniris_gym*"]), "sceniris_gym.envs", "sceniris_gym.assets"])
