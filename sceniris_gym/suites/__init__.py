"""Suites: cases that change one axis of a task in grades, and comparisons of policies case by case."""
